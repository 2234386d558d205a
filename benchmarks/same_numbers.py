"""Whether two checkouts compute the same of random shapes: time scaling, and the optimiser's rows.

    python benchmarks/same_numbers.py OTHER_CHECKOUT [--count 1000] [--first 0] [--tolerance 1e-13]

Of splines of five bundled arms over one to three phases, with limits of effort, velocity, often of
acceleration and of some joints' jerk, with and without rotation tolerances, beside an obstacle:
how much faster each sample could be run, the shape's duration, all rows of the optimiser, and their
slacks at a second spline (those of the second-order correction). `shape_numbers.py` computes them,
with the sources of this checkout and of another one.

Differences are relative: of durations to themselves; of factors too, but times the share of a
motor that gravity leaves (rounding of the limit is that much more of the rest); of rows'
coefficients to 1 (the whole limit, a radius, 5 cm of clearance) or, if that is more, to the largest
one of all rows of that kind on the same four control points: the efforts of all joints come from
one recursion, and a wrist's small one is rounded as the shoulder's large one is; of slacks to
themselves or 1. Numbers, places and limits of rows must be the same. Exit status 1 if any differs
by more than the tolerance.
"""

import argparse
import os
import pickle
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent.parent
DRIVER = HERE / "benchmarks" / "shape_numbers.py"
RELATIVE = ("minimum duration", "estimated duration", "squared duration")
COEFFICIENTS = ("control", "switching", "duration", "slack")
LABELS = ("first", "limit", "index", "elastic")


class Checkout:
    """The sources of a checkout, in a process that is asked shape by shape."""

    def __init__(self, folder: Path) -> None:
        environment = os.environ | {"PYTHONPATH": str(folder / "src"), "OPENBLAS_NUM_THREADS": "1"}
        command = [sys.executable, str(DRIVER)]
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(command, env=environment, stdin=pipe, stdout=pipe)

    def numbers(self, seed: int) -> dict:
        """Return what `shape_numbers.numbers` is here."""
        asked, answer = self._process.stdin, self._process.stdout
        assert asked is not None
        assert answer is not None
        asked.write(f"{seed}\n".encode())
        asked.flush()
        found: dict = pickle.load(answer)
        return found

    def close(self) -> None:
        """End the process."""
        self._process.communicate()


def differences(one: dict, other: dict) -> Iterator[tuple[str, float]]:
    """Yield by how much two answers differ, by kind; inf where they cannot be compared."""
    yield "factors", _largest(one["factors"], other["factors"], 0.0, other["spare"])
    for name in RELATIVE:
        yield name, _largest(one[name], other[name], 0.0)
    yield "second slack", _largest(one["second slack"], other["second slack"], 1.0)
    yield "excess", _largest(one["excess"], other["excess"], 1.0)
    yield "names", 0.0 if one["names"] == other["names"] else np.inf
    yield from _row_differences("rows", one["rows"], other["rows"], one["names"])
    for rows, others in zip(one["regions"], other["regions"], strict=True):
        yield from _row_differences("regions", rows, others, one["names"])


def _row_differences(
    name: str, rows: dict, others: dict, names: list[tuple[str, int]]
) -> Iterator[tuple[str, float]]:
    """Yield by how much rows differ: their labels, then coefficients as shares of the largest."""
    labels = [label for label in LABELS if label in rows]
    same = all(np.array_equal(rows[label], others[label]) for label in labels)
    yield f"{name}, labels", 0.0 if same else np.inf
    if not same:
        return
    kinds = [*(kind for kind, _ in names), ""]  # rows of no limit have number -1
    kind = np.unique(kinds, return_inverse=True)[1][others["limit"]]
    size = np.max([_by_row(others[field]) for field in COEFFICIENTS], axis=0)
    largest = np.maximum(1.0, _largest_of_group(size, np.array([kind, others["first"]])))
    for field in COEFFICIENTS:
        share = _by_row(rows[field] - others[field]) / largest
        yield f"{name}, {field}", float(share.max(initial=0.0))


def _largest_of_group(size: np.ndarray, group: np.ndarray) -> np.ndarray:
    """Return the largest size in the group of each of R rows, told by the columns of (2, R)."""
    number = np.unique(group, axis=1, return_inverse=True)[1].ravel()
    largest = np.zeros(number.max(initial=-1) + 1)
    np.maximum.at(largest, number, size)
    return largest[number]


def _by_row(values: np.ndarray) -> np.ndarray:
    """Return the largest magnitude of each row, shape (R,)."""
    size: np.ndarray = abs(values).max(axis=tuple(range(1, values.ndim)), initial=0.0)
    return size


def _largest(
    one: np.ndarray | float,
    other: np.ndarray | float,
    least: float,
    weight: np.ndarray | float = 1.0,
) -> float:
    """Return the largest weighted difference relative to the values, or to a least size."""
    a, b = np.atleast_1d(one), np.atleast_1d(other)
    if a.shape != b.shape:
        return np.inf
    unequal = a != b  # what is infinite, or zero, must be so in both
    weight = np.broadcast_to(weight, a.shape)[unequal]
    a, b = a[unequal], b[unequal]
    with np.errstate(invalid="ignore"):
        share = weight * abs(a - b) / np.maximum(np.maximum(abs(a), abs(b)), least)
    return float(np.nan_to_num(share, nan=np.inf).max(initial=0.0))


def main() -> int:
    """Compute with both checkouts and compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("other", type=Path, help="the other checkout")
    parser.add_argument("--count", type=int, default=1000, help="how many shapes")
    parser.add_argument("--first", type=int, default=0, help="the first one's seed")
    parser.add_argument("--tolerance", type=float, default=1e-13)
    arguments = parser.parse_args()
    here, there = Checkout(HERE), Checkout(arguments.other.resolve())
    worst: dict[str, tuple[float, int]] = {}
    held = 0
    for seed in range(arguments.first, arguments.first + arguments.count):
        one, other = here.numbers(seed), there.numbers(seed)
        held += bool(np.isfinite(one["minimum duration"]))
        for name, found in differences(one, other):
            worst[name] = max(worst.get(name, (0.0, seed)), (found, seed))
    here.close()
    there.close()
    print(f"{arguments.count} shapes, {held} of them held by the motors; largest differences:")
    for name, (found, seed) in worst.items():
        mark = f"  <-- seed {seed}" if found > arguments.tolerance else ""
        print(f"{name:24} {found:8.2g}{mark}")
    return 1 if any(found > arguments.tolerance for found, _ in worst.values()) else 0


if __name__ == "__main__":
    raise SystemExit(main())
