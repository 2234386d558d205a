"""What benchmarks share: bundled problems, other checkouts, means, cells of tables."""

import json
import math
import os
import re
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent.parent
ARMS = (
    "two_link/around_a_post",
    "ur5/over_the_wall",
    "ur10/onto_a_conveyor",
    "panda/between_shelves",
    "xarm7/from_crate_to_crate",
)
EXAMPLES = (1, 2, 3, 4, 5)  # of the paper
RADII = (10, 30, 50)  # [mm]
# What drivers begin with, for any checkout's package, whether it makes motions smooth or not:
# durations are compared of the shortest ones.
SHORTEST = """
from tubeplanner import PlanOptions
SHORTEST = PlanOptions(slack=0.0) if hasattr(PlanOptions, "slack") else PlanOptions()
"""


def paper_example(example: int, radius: int) -> str:
    """Return the name of the problem of one of the paper's examples with a radius [mm]."""
    return f"two_link/paper_{example}_{radius}mm"


def names_with_tube() -> Iterator[str]:
    """Yield the names of all bundled problems that have a tube and are no cycles."""
    for path in sorted((HERE / "robots").glob("*/*.yaml")):
        text = path.read_text()
        if "tube:" in text and "format: tubeplanner/cycle" not in text:
            yield f"{path.parent.name}/{path.stem}"


class Checkout:
    """A process that answers questions, each a line of JSON, with a checkout's own package."""

    def __init__(self, folder: Path, driver: str) -> None:
        """Start it.

        Args:
            folder: The checkout.
            driver: Its program after `SHORTEST`: reads questions from its input and prints an
                answer to each, by names of the package that do not change.
        """
        self._folder = folder
        self._process = subprocess.Popen(
            [sys.executable, "-c", SHORTEST + driver],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=environment(folder),
            text=True,
        )

    def ask(self, question: Any) -> Any:
        """Return the answer to a question; end the program if there is none."""
        questions, answers = self._process.stdin, self._process.stdout
        assert questions is not None and answers is not None
        questions.write(json.dumps(question) + "\n")
        questions.flush()
        line = answers.readline()
        if not line:
            raise SystemExit(f"{self._folder}: the process has ended at {question}")
        return json.loads(line)


def asked_once(folder: Path, driver: str, question: Any, limit: float) -> dict[str, Any]:
    """Return the answer of a process of its own, nothing after a time limit [s]."""
    try:
        done = subprocess.run(
            [sys.executable, "-c", SHORTEST + driver],
            input=json.dumps(question) + "\n",
            stdout=subprocess.PIPE,
            env=environment(folder),
            text=True,
            timeout=limit,
            check=True,
        )
    except subprocess.TimeoutExpired:
        return {}
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer


def environment(folder: Path) -> dict[str, str]:
    """Return the variables of a process that works with a checkout's sources."""
    if not any((folder / "src/tubeplanner/native").glob("*.so")):
        # Without it answers are slower and differ in their last digits.
        print(
            f"{folder} has no native library: python -m tubeplanner.native.build", file=sys.stderr
        )
    return os.environ | {"PYTHONPATH": str(folder / "src"), "OPENBLAS_NUM_THREADS": "1"}


def cause(message: str) -> str:
    """Return a message without its numbers, names and places."""
    text = re.sub(r"'[^']*'", "'...'", message)
    text = re.sub(r"\[[^\]]*\]", "[...]", text)
    text = re.sub(r"[-+]?\d+(\.\d+)?([eE][-+]?\d+)?", "#", text)
    return text[:110]


def geometric_mean(values: Iterable[float]) -> float:
    """Return the geometric mean; nan of none."""
    logarithms = [math.log(value) for value in values]
    return math.exp(math.fsum(logarithms) / len(logarithms)) if logarithms else math.nan


def figure(value: float | None, places: int = 4) -> str:
    """Return a number for a table, a dash for none."""
    return "-" if value is None else f"{value:.{places}f}"
