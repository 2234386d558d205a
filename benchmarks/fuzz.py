"""Damaged files for every reader: each is read or refused in one line, in bounded time and memory.

    python benchmarks/fuzz.py --minutes 30 --folder fuzzed
    python benchmarks/fuzz.py --only stl --only dae --cases 100

Case k of a kind is always the same file. With --folder, what is done is noted there as soon as it
is done, and the same command goes on with the seeds that are left; the files of what fails are kept
in it. Exit status 1 if a case is a fault.
"""

import argparse
import os
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import nullcontext
from itertools import count
from pathlib import Path

# The cache of collision geometry is the fuzzer's own; warnings of what is read are not its output.
os.environ.setdefault("TUBEPLANNER_CACHE", tempfile.mkdtemp(prefix="fuzz-cache-"))

from fuzz_case import Outcome, run_case
from fuzz_kinds import KINDS
from tubeplanner.studies.journal import Journal


def main() -> int:
    """Run the cases asked for and print a table of what came of each kind."""
    given = _arguments()
    kinds = given.only or list(KINDS)
    faults = None if given.folder is None else given.folder / "faults"
    if given.folder is not None:
        given.folder.mkdir(exist_ok=True)
    path = None if given.folder is None else given.folder / "cases.jsonl"
    with nullcontext() if path is None else Journal(path) as journal:
        outcomes = list(_outcomes(kinds, given, journal, faults))
    print(table(outcomes))
    return int(any(each.status == "fault" for each in outcomes))


def _outcomes(
    kinds: list[str], given: argparse.Namespace, journal: Journal | None, faults: Path | None
) -> Iterator[Outcome]:
    """Yield what comes of case after case, one of each kind in turns."""
    end = time.monotonic() + 60 * given.minutes if given.minutes else float("inf")
    seeds = range(given.seed, given.seed + given.cases) if given.cases else count(given.seed)
    for seed in seeds:
        for kind in kinds:
            key = f"{kind} {seed}"
            if journal is not None and key in journal:
                yield journal.made(key, lambda row: Outcome(**row))
                continue
            if time.monotonic() > end:
                return
            outcome = run_case(kind, seed, faults)
            if journal is not None:
                journal.add(key, {}, outcome.as_dict())
            if outcome.status == "fault":
                print(f"{key}: {outcome.what}: {outcome.message[-1000:]}", flush=True)
            yield outcome


def table(outcomes: Iterable[Outcome]) -> str:
    """Return a row for every kind: how many cases, what came of them, the slowest, the largest."""
    by_kind: dict[str, list[Outcome]] = {}
    for outcome in outcomes:
        by_kind.setdefault(outcome.kind, []).append(outcome)
    lines = ["| kind | cases | refused | accepted | faults | slowest [s] | memory [MB] |"]
    lines.append("|---|---|---|---|---|---|---|")
    for kind, found in by_kind.items():
        counts = Counter(each.status for each in found)
        numbers = [len(found), *(counts[name] for name in ("refused", "accepted", "fault"))]
        slowest = max(each.seconds for each in found)
        largest = max(each.memory for each in found) / 1e6
        words = [kind, *map(str, numbers), f"{slowest:.1f}", f"{largest:.0f}"]
        lines.append("| " + " | ".join(words) + " |")
    return "\n".join(lines)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--minutes", type=float, help="end after so many")
    parser.add_argument("--cases", type=int, help="so many of each kind")
    parser.add_argument("--seed", type=int, default=0, help="of the first case")
    parser.add_argument("--only", action="append", choices=KINDS, help="this kind; repeatable")
    parser.add_argument("--folder", type=Path, help="journal, and files of what fails")
    given = parser.parse_args()
    if not given.minutes and not given.cases:
        parser.error("give --minutes or --cases")
    return given


if __name__ == "__main__":
    sys.exit(main())
