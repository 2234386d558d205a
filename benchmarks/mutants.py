"""Whether a test notices when a line that a promise rests on is wrong.

    python benchmarks/mutants.py [--only SUBSTRING] [--list] [--processes N]

Every mutant of `mutant_list.py` changes one fragment of one function of the judge, of its geometry,
of what the planner is constrained by, or of simulation. The package is copied, one mutant is
applied, and the test files of its module are run until one test fails: killed. A mutant that lives
although it is not listed as equivalent, only stricter or only slower is a line without a guard.
Exit status 1 if there is one, if a listed one dies, if a fragment no longer matches, or if the
tests fail as they are.
"""

import argparse
import ast
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from queue import SimpleQueue

import pytest

from mutant_list import MUTANTS, TESTS, Mutant

HERE = Path(__file__).resolve().parent.parent
PACKAGE = Path("src", "tubeplanner")
COPIED = ("src", "tests", "robots", "benchmarks")
PROCESSES = 2
# A mutant that keeps its tests busy for so long [s] is noticed as well; they take half of it.
TIME_LIMIT = 240.0
PASSED, FAILED, INTERRUPTED = 0, 1, 2  # pytest's exit statuses; a module that breaks interrupts
# Tests run in forks of a process that has the libraries, but nothing of the package.
LIBRARIES = (
    *(
        "click",
        "coal",
        "fcl",
        "hypothesis",
        "lazy_loader",
        "numpy.polynomial",
        "ompl",
        "pinocchio",
        "piqp",
        "pydantic",
    ),
    *("pytest", "ruamel.yaml", "scipy.interpolate", "scipy.optimize", "scipy.sparse.linalg"),
    *("scipy.spatial.transform", "scipy.special", "toppra", "trimesh", "yourdfpy"),
)
LOG = "log.txt"
_CONTEXT = get_context("forkserver")
_CONTEXT.set_forkserver_preload(list(LIBRARIES))


@dataclass(frozen=True)
class Place:
    """Where a mutant is.

    Attributes:
        module: Path of its module below the package.
        begin: Where in its text the fragment begins.
    """

    module: Path
    begin: int


@dataclass(frozen=True)
class Outcome:
    """What became of a mutant.

    Attributes:
        mutant: The mutant.
        module: Its module.
        killed: Whether a test failed.
        seconds: How long the tests took.
    """

    mutant: Mutant
    module: Path
    killed: bool
    seconds: float

    @property
    def is_expected(self) -> bool:
        """Whether it lives if and only if there is a reason."""
        return self.killed == (not self.mutant.reason)


class Sources:
    """The modules of the package, and where in them everything is defined."""

    def __init__(self, package: Path) -> None:
        self.texts: dict[Path, str] = {}
        self._definitions: dict[str, list[tuple[Path, int, int]]] = {}
        for path in sorted(package.rglob("*.py")):
            module, text = path.relative_to(package), path.read_text()
            self.texts[module] = text
            for name, begin, end in _definitions(text):
                self._definitions.setdefault(name, []).append((module, begin, end))

    def place(self, mutant: Mutant) -> Place:
        """Return where a mutant's fragment is.

        Raises:
            ValueError: It is nowhere, or in several places.
        """
        found = [
            Place(module, begin + at)
            for module, begin, end in self._definitions.get(mutant.where, [])
            for at in _occurrences(self.texts[module][begin:end], mutant.old)
        ]
        if len(found) != 1:
            raise ValueError(f"{mutant}: the fragment is found {len(found)} times, not once")
        return found[0]

    def mutated(self, mutant: Mutant, place: Place) -> str:
        """Return the text of a mutant's module."""
        text = self.texts[place.module]
        return text[: place.begin] + mutant.new + text[place.begin + len(mutant.old) :]


def _definitions(text: str) -> Iterator[tuple[str, int, int]]:
    """Yield the functions, methods and constants of a module: name, begin and end in its text."""
    lines = text.splitlines(keepends=True)
    starts = [0]
    for line in lines:
        starts.append(starts[-1] + len(line))

    def walk(body: list[ast.stmt], prefix: str) -> Iterator[tuple[str, int, int]]:
        for node in body:
            span = starts[node.lineno - 1], starts[node.end_lineno or node.lineno]
            if isinstance(node, ast.FunctionDef):
                yield prefix + node.name, *span
            elif isinstance(node, ast.ClassDef):
                yield from walk(node.body, f"{prefix}{node.name}.")
            elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
                yield prefix + node.targets[0].id, *span

    yield from walk(ast.parse(text).body, "")


def _occurrences(text: str, fragment: str) -> Iterator[int]:
    at = text.find(fragment)
    while at >= 0:
        yield at
        at = text.find(fragment, at + 1)


def tests_of(module: Path) -> tuple[str, ...]:
    """Return the test files of a module: its own, then those that the table names."""
    folder = HERE / "tests" / module.parent
    own = [
        *sorted(folder.glob(f"test_{module.stem}.py")),
        *sorted(folder.glob(f"test_{module.stem}_*.py")),
    ]
    names = [str(path.relative_to(HERE)) for path in own]
    named = [f"tests/{name}" for name in TESTS.get(module.with_suffix("").as_posix(), ())]
    files = tuple(dict.fromkeys([*names, *named]))
    missing = [name for name in files if not (HERE / name).is_file()]
    if missing or not files:
        raise ValueError(f"{module}: no tests{''.join(f', {name} is missing' for name in missing)}")
    return files


class Copy:
    """A copy of the checkout in which one mutant at a time is tested."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        for name in COPIED:
            ignored = shutil.ignore_patterns("__pycache__", ".*")
            shutil.copytree(HERE / name, folder / name, ignore=ignored)
        shutil.copy(HERE / "pyproject.toml", folder)
        # Compiled once: what is read from then on is the module that changes.
        subprocess.run(
            [sys.executable, "-m", "compileall", "-q", "src", "tests"], cwd=folder, check=True
        )

    @property
    def log(self) -> str:
        """What the last tests printed."""
        return (self._folder / LOG).read_text()

    def killed(self, module: Path, text: str, tests: tuple[str, ...]) -> bool:
        """Return whether tests fail while a module has another text."""
        path = self._folder / PACKAGE / module
        original = path.read_text()
        for compiled in (path.parent / "__pycache__").glob(f"{path.stem}.*.pyc"):
            compiled.unlink()
        path.write_text(text)
        try:
            return not self.passes(tests)
        finally:
            path.write_text(original)

    def passes(self, tests: tuple[str, ...], time_limit: float | None = TIME_LIMIT) -> bool:
        """Return whether tests pass, in time.

        Raises:
            RuntimeError: pytest could not run them.
        """
        process = _CONTEXT.Process(target=_run_tests, args=(self._folder, tests))
        process.start()
        process.join(time_limit)
        if process.exitcode is None:
            process.kill()
            process.join()
            return False
        if process.exitcode not in (PASSED, FAILED, INTERRUPTED):
            raise RuntimeError(self.log)
        return process.exitcode == PASSED


def _run_tests(folder: Path, tests: tuple[str, ...]) -> None:
    """Run test files of a copy of the checkout; end with pytest's exit status."""
    sys.dont_write_bytecode = True
    os.chdir(folder)
    os.environ |= {"PYTHONPATH": str(folder / "src"), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    sys.path.insert(0, str(folder / "src"))
    log = os.open(LOG, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(log, 1)
    os.dup2(log, 2)
    # What is asserted counts, not how a failure reads.
    options = ["-x", "-q", "-p", "no:cacheprovider", "-p", "pytest_timeout", "--assert=plain"]
    status = pytest.main([*options, *tests])
    os._exit(int(status))


def run(sources: Sources, mutants: list[tuple[Mutant, Place]], processes: int) -> list[Outcome]:
    """Return what becomes of mutants, each printed as soon as it is known.

    Raises:
        RuntimeError: The tests fail without any mutant.
    """
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(processes) as pool:
        copies: SimpleQueue[Copy] = SimpleQueue()
        for number in range(processes):
            copies.put(Copy(Path(folder, str(number))))

        def require_passed(tests: tuple[str, ...]) -> None:
            copy = copies.get()
            try:
                if not copy.passes(tests, None):
                    raise RuntimeError(f"the tests fail without any mutant:\n{copy.log}")
            finally:
                copies.put(copy)

        def outcome(mutant: Mutant, place: Place) -> Outcome:
            copy, begin = copies.get(), time.perf_counter()
            try:
                text = sources.mutated(mutant, place)
                killed = copy.killed(place.module, text, tests_of(place.module))
            finally:
                copies.put(copy)
            found = Outcome(mutant, place.module, killed, time.perf_counter() - begin)
            print(row(found), flush=True)
            return found

        files = sorted({name for _, place in mutants for name in tests_of(place.module)})
        halves = [tuple(files[i::processes]) for i in range(min(processes, len(files)))]
        list(pool.map(require_passed, halves))
        return list(pool.map(lambda pair: outcome(*pair), mutants))


def row(outcome: Outcome) -> str:
    """Return a row of the table."""
    state = "killed" if outcome.killed else "survived"
    reason = f"  ({outcome.mutant.reason})" if outcome.mutant.reason else ""
    mark = "" if outcome.is_expected else "  <-- not expected"
    return f"{state:8} {outcome.seconds:6.1f} s  {outcome.mutant}{reason}{mark}"


def summary(outcomes: list[Outcome]) -> Iterator[str]:
    """Yield a row per module: how many mutants there are, and how many survived."""
    yield f"{'module':44}{'mutants':>8}{'killed':>8}{'survived':>9}{'time [s]':>9}"
    for module in sorted({outcome.module for outcome in outcomes}):
        own = [outcome for outcome in outcomes if outcome.module == module]
        killed, seconds = sum(o.killed for o in own), sum(o.seconds for o in own)
        name = module.as_posix()
        yield f"{name:44}{len(own):8}{killed:8}{len(own) - killed:9}{seconds:9.0f}"


def main() -> int:
    """Apply the mutants and run their tests."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="mutants whose row contains this")
    parser.add_argument("--list", action="store_true", help="print them; run nothing")
    parser.add_argument("--processes", type=int, default=PROCESSES, help="how many at a time")
    arguments = parser.parse_args()
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    sources = Sources(HERE / PACKAGE)
    mutants = [(mutant, sources.place(mutant)) for mutant in MUTANTS]
    chosen = [
        (mutant, place)
        for mutant, place in mutants
        if arguments.only in f"{place.module.as_posix()} {mutant}"
    ]
    if arguments.list:
        for mutant, place in chosen:
            print(f"{place.module.as_posix():40} {mutant}")
        print(f"{len(chosen)} mutants")
        return 0
    begin = time.perf_counter()
    outcomes = run(sources, chosen, arguments.processes)
    print(*summary(outcomes), sep="\n")
    unexpected = [outcome for outcome in outcomes if not outcome.is_expected]
    killed = sum(outcome.killed for outcome in outcomes)
    minutes = (time.perf_counter() - begin) / 60
    print(f"{len(outcomes)} mutants, {killed} killed, {len(unexpected)} not as expected; ", end="")
    print(f"{minutes:.1f} minutes")
    print(*(row(outcome) for outcome in unexpected), sep="\n")
    return 1 if unexpected else 0


if __name__ == "__main__":
    raise SystemExit(main())
