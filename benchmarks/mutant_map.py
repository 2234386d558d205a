"""Which tests run a line, and what each of them costs.

As a plugin of pytest (`-p mutant_map`) it writes a line a test into the folder `MUTANT_TIMES`:
seconds of the processor, seconds, and the test's name.
"""

import os
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

SOURCES = "src/tubeplanner/"
_OF_A_FILE = 0.1  # of collecting a file of tests [s]: a dear test may come first for it


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Write what a test costs [s]."""
    cpu, wall = time.process_time(), time.perf_counter()
    try:
        return (yield)
    finally:
        cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
        with Path(os.environ["MUTANT_TIMES"], f"times.{os.getpid()}").open("a") as file:
            file.write(f"{cpu:.3f}\t{wall:.3f}\t{item.nodeid}\n")


def make_map(file: Path, checkout: Path, processes: int) -> None:
    """Run the quick tests of a checkout once, and write the map of their coverage."""
    file.parent.mkdir(parents=True, exist_ok=True)
    for old in file.parent.glob("times.*"):
        old.unlink()
    path = os.pathsep.join([str(Path(__file__).parent), str(checkout / "src")])
    own = {"MUTANT_TIMES": str(file.parent), "COVERAGE_FILE": str(file), "PYTHONPATH": path}
    command = [sys.executable, "-m", "pytest", "-q", "-p", "mutant_map", "-m", "not slow"]
    covered = [f"--cov={checkout / SOURCES}", "--cov-context=test", "--cov-report="]
    # What fails here fails without any mutant as well, and is left out then.
    subprocess.run(
        [*command, *covered, "-n", str(processes)], cwd=checkout, env=os.environ | own, check=False
    )


class CoverageMap:
    """The map of coverage of one checkout; costs are read from files `times.*` beside it."""

    def __init__(self, file: Path) -> None:
        address = file.absolute().as_uri() + "?mode=ro"
        self._data = sqlite3.connect(address, uri=True, check_same_thread=False)
        rows = self._data.execute("select id, path from file")
        self._files = {path.rpartition(SOURCES)[2]: number for number, path in rows}
        self._costs: dict[str, float] = {}
        for times in sorted(file.parent.glob("times.*")):
            for line in times.read_text().splitlines():
                cpu, wall, test = line.split("\t", 2)
                # Children's time is not in the first; others' is in the second.
                self._costs[test] = max(float(cpu), float(wall) / 4)

    def covered(self, module: str) -> int:
        """Return the lines of a module that tests run, each a bit."""
        lines = 0
        for _, bits in self._rows(module):
            lines |= bits
        return lines

    def tests(self, module: str, lines: tuple[int, int]) -> set[str]:
        """Return the tests that run one of the lines of a module."""
        return {test for test, bits in self._rows(module) if bits & bits_of(lines)}

    def within(self, tests: set[str], budget: float) -> list[str]:
        """Return the cheapest of some tests, cheapest first, as far as a budget [s] goes."""
        chosen, files, spent = [], set(), 0.0
        for cost, test in sorted((self.cost(test), test) for test in tests):
            file = test.partition("::")[0]
            spent += cost if file in files else cost + _OF_A_FILE
            if chosen and spent > budget:
                break
            files.add(file)
            chosen.append(test)
        return chosen

    def cost(self, *tests: str) -> float:
        """Return what tests cost together [s]."""
        return sum(self._costs.get(test, 1.0) for test in tests)

    def _rows(self, module: str) -> Iterator[tuple[str, int]]:
        """Yield a test and the lines it runs, but for what runs while tests are collected."""
        query = (
            "select context, numbits from line_bits join context on context.id = context_id"
            " where file_id = ? and context != ''"
        )
        for context, bits in self._data.execute(query, (self._files.get(module, -1),)):
            yield context.rpartition("|")[0], int.from_bytes(bits, "little")


def bits_of(lines: tuple[int, int]) -> int:
    """Return the lines from a first to a last one, each a bit."""
    return (1 << (lines[1] + 1)) - (1 << lines[0])
