"""What does a command leave that is ended at any moment, or whose disk is full or locked?

    python benchmarks/interruptions.py [--moments 100] [--lives 5] [--only plan,view] [--seed 1]

What a command computes is kept from a first run, so that the later ones write at once: children of
this process, which SIGINT, SIGTERM or SIGKILL meets at moments spread over the measured length of
their writing stage, nearly all of them over the part from the first file on. Of SIGINT and
SIGTERM, `--lives` such moments are spread over the first ten seconds of processes that compute
everything themselves. A run is wrong if it leaves a file that was not asked for, an output that is
neither the old nor the new one, some outputs new and others old, or a traceback; if its exit status
does not fit its files; or if what SIGKILL left is still there after the next run. Root also sees
runs on a full disk and in a folder that cannot be written to. Prints a table; exit status 1 if
anything is wrong. The folder of a wrong run is kept and named.
"""

import argparse
import json
import math
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from interruption_cases import CASES, MOTION, PROBLEM, TEXTS, TRAIL, Case
from interruption_runs import Answer, Ended, Location, Pause, Runs, Stage, old_content, silenced
from tubeplanner.cli.main import main as run_command

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)
ROOMS = (0, 1, 4, 16, 64)  # what a full disk has left [KiB]
INTERRUPTED, BAD_INPUT = 130, 2


class Table:
    """What was seen, printed command by command, and the folders of what is wrong."""

    def __init__(self, kept: Path) -> None:
        """Print the head of the table.

        Args:
            kept: Folder for those of wrong runs.
        """
        self._kept, self.wrong = kept, 0
        self._seen: dict[str, list[list[str]]] = {}
        print(f"{'command':12}{'what':14}{'runs':>6}{'wrong':>7}  why", flush=True)

    def add(self, what: str, place: Location, found: list[str]) -> None:
        """Note a run: where it ran, and what is wrong with it."""
        if found:
            self.wrong += 1
            shutil.copytree(place.folder, self._kept / f"{place.folder.name}-{self.wrong}")
        self._seen.setdefault(what, []).append(found)

    def print_rows(self, case: Case) -> None:
        """Print what was seen of a command."""
        for what, seen in self._seen.items():
            why = Counter(reason for found in seen for reason in found).most_common()
            reasons = ", ".join(f"{reason} ({times})" for reason, times in why)
            wrong = sum(bool(found) for found in seen)
            print(f"{case.name:12}{what:14}{len(seen):6}{wrong:7}  {reasons}".rstrip(), flush=True)
        self._seen = {}


def interrupted(runs: Runs, moments: int, numbers: random.Random, table: Table) -> None:
    """Let each signal meet runs that draw and write.

    One moment in twenty is spread over drawing, too, the others are counted from when the first
    file is opened; half of all print JSON.
    """
    kinds: list[tuple[Stage, list[str]]]
    kinds = [(Stage.ANSWERED, []), (Stage.WRITES, []), (Stage.WRITES, ["--json"])]
    drawn, printed = max(moments // 20, 1), moments // 2
    counts = [drawn, moments - drawn - printed, printed]
    for (stage, more), count in zip(kinds, counts, strict=True):
        with runs.paused(stage, more) as run:
            length = sorted(_whole_length(runs, run) for _ in range(3))[1]
            for number in SIGNALS:
                for _ in range(count):
                    place = runs.place()
                    ended = run.go_on(number, numbers.uniform(0, 1.1 * length))
                    table.add(number.name, place, faults(runs, place, ended, number))


def ended_lives(runs: Runs, moments: int, numbers: random.Random, table: Table) -> None:
    """Let signals meet runs at any time."""
    for number in (signal.SIGINT, signal.SIGTERM):
        for _ in range(moments):
            place = runs.place()
            ended = runs.lived(place, number, numbers.uniform(0, runs.life))
            found = faults(runs, place, ended, number, exact=False)
            table.add(f"{number.name} life", place, found)


def without_room(runs: Runs, table: Table) -> None:
    """Run on disks that have little room or none, and on one that is mounted for reading alone."""
    for slack in ROOMS:
        place = runs.place()
        with _disk(place):
            _fill(place.out / "filler", slack)
            ended = runs.forked(place)
            table.add("full disk", place, faults_without_room(runs, place, ended, "make room"))
    place = runs.place()
    with _disk(place):
        subprocess.run(["mount", "-o", "remount,ro", place.out], check=True)
        ended = runs.forked(place)
        table.add("read only", place, faults_without_room(runs, place, ended, "another folder"))


def main() -> int:
    """Print the table and return the exit status."""
    options = _parsed()
    only = None if options.only is None else options.only.split(",")
    kept = Path(tempfile.mkdtemp(prefix="interruptions-"))
    table = Table(kept)
    deadline = time.monotonic() + options.seconds
    with tempfile.TemporaryDirectory() as scratch:
        inputs = Path(scratch)
        _prepare(inputs)
        for case in CASES:
            if time.monotonic() > deadline:
                print(f"left out for lack of time: {case.name}")
                continue
            if only is not None and case.name not in only:
                continue
            runs = Runs(case, inputs, inputs / "runs")
            numbers = random.Random(f"{options.seed} {case.name}")
            interrupted(runs, options.moments, numbers, table)
            ended_lives(runs, options.lives, numbers, table)
            if os.geteuid() == 0:
                without_room(runs, table)
            table.print_rows(case)
    print(f"{table.wrong} wrong" + (f", kept in {kept}" if table.wrong else ""))
    return int(table.wrong > 0)


def faults(
    runs: Runs, place: Location, ended: Ended, number: int, *, exact: bool = True
) -> list[str]:
    """Return what is wrong with a run that met a signal.

    Args:
        runs: Of the command.
        place: Where it ran.
        ended: How it ended.
        number: The signal.
        exact: Whether what it computes is what is kept, so that new files are known.
    """
    killed = number == signal.SIGKILL
    found, faults = place.found(), []
    journal = found.pop(runs.case.journal or "", b"")
    if exact and not runs.new.get(runs.case.journal or "", b"").startswith(journal):
        faults.append("journal is torn inside")
    if not killed and journal and not journal.endswith(b"\n"):
        faults.append("journal ends inside a line")
    left = set(found) - set(runs.case.files)
    allowed = {_temporary(name) for name in runs.case.files} if killed else set()
    # A folder that a killed run had just made is taken by the next.
    allowed |= {f"{Path(name).parent}/" for name in runs.case.files if killed and "/" in name}
    if left - allowed:
        faults.append("files are left")
    answer = Answer(runs.new) if killed else _nearest(runs, found)
    states = _states(runs, answer.files, found, exact)
    if "torn" in states:
        faults.append("an output is torn")
    if not killed:
        faults += _faults_of_words(ended, place.printed, states, answer.status)
        is_shortened = answer.files is not runs.new and "new" in states
        if is_shortened and "interrupt" not in place.printed[0]:
            faults.append("not said to be shortened")
    if killed and left:
        faults += _faults_of_next(runs, place)
    return faults


def faults_without_room(runs: Runs, place: Location, ended: Ended, remedy: str) -> list[str]:
    """Return what is wrong with a run that could not write all files."""
    found, faults, (_, err) = place.found(), [], place.printed
    found.pop("filler", None)
    found.pop(runs.case.journal or "", None)
    if found == {name: runs.new[name] for name in runs.case.files} and ended.status == 0:
        return []  # there was room
    if set(found) - set(runs.case.files):
        faults.append("files are left")
    names = runs.case.files
    states = _states(runs, runs.new, found, True)
    if "torn" in states:
        faults.append("an output is torn")
    if ended.status != BAD_INPUT or "Traceback" in err:
        faults.append(f"status {ended.status}")
    old = [name for name in names if found.get(name) == _old(name)]
    named = [name in err for name in old]
    # A run that is refused before its work names the first file, or its journal or folder.
    first = [*(name.split("/")[0] for name in names), *[runs.case.journal] * 1]
    if not all(named) and ("new" in states or not any(name and name in err for name in first)):
        faults.append("a file is not named")
    if remedy not in err:
        faults.append("no remedy is named")
    return faults


def _whole_length(runs: Runs, run: Pause) -> float:
    """Return how long a run takes from its stage to its end [s]."""
    runs.place()
    return run.go_on().length


@contextmanager
def _disk(place: Location) -> Iterator[None]:
    """Put a small disk where a run's outputs go, with the old ones on it."""
    before = {path.name: path.read_bytes() for path in place.out.iterdir()}
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=4m", "tmpfs", place.out], check=True)
    try:
        for name, content in before.items():
            (place.out / name).write_bytes(content)
        yield
    finally:
        subprocess.run(["umount", place.out], check=True)


def _fill(path: Path, slack: int) -> None:
    """Fill a disk up to some room [KiB], in whole pages."""
    free = os.statvfs(path.parent)
    path.write_bytes(bytes(max(free.f_bavail * free.f_bsize - 1024 * slack, 0)))


def _prepare(inputs: Path) -> None:
    """Write what commands read."""
    for name, text in TEXTS.items():
        (inputs / name).write_text(text)
    words = ["plan", PROBLEM, "-o", str(inputs / MOTION), "--csv", str(inputs / TRAIL)]
    with silenced():
        run_command(words)


def _parsed() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--moments", type=int, default=100, help="per command and signal")
    parser.add_argument("--lives", type=int, default=5, help="the same, over the whole life")
    parser.add_argument("--only", help="commands, with commas between")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=math.inf, help="begin none after these")
    return parser.parse_args()


def _nearest(runs: Runs, found: dict[str, bytes]) -> Answer:
    """Return the one answer, whole or shortened, that the files are of."""

    def same(answer: Answer) -> int:
        return sum(
            found.get(name) == answer.files.get(name, _old(name)) for name in runs.case.files
        )

    return max([Answer(runs.new), *runs.shortened], key=same)


def _states(runs: Runs, new: dict[str, bytes], found: dict[str, bytes], exact: bool) -> set[str]:
    """Return what its files are: old, new or torn; those that an answer lacks must be old."""
    states = set()
    for name in runs.case.files:
        is_old = found.get(name) == _old(name)
        if name not in new:
            states |= set() if is_old else {"torn"}
        elif is_old:
            states.add("old")
        else:
            is_new = found.get(name) == new[name] or (found.get(name) and not exact)
            states.add("new" if is_new else "torn")
    return states


def _old(name: str) -> bytes | None:
    """Return what a file had before a run; None: it was not there."""
    return None if "/" in name else old_content(name)


def _faults_of_next(runs: Runs, place: Location) -> list[str]:
    """Run it again where SIGKILL left something."""
    if runs.case.journal is not None:
        (place.out / runs.case.journal).unlink(missing_ok=True)
    ended = runs.forked(place)
    clean = ended.status == 0 and place.found() == runs.new
    return [] if clean else ["what is left stays"]


def _faults_of_words(
    ended: Ended, printed: tuple[str, str], states: set[str], status: int
) -> list[str]:
    """Return where the words and the exit status of an interrupted run do not fit its files."""
    faults, (out, err) = [], printed
    if "Traceback" in err or "internal error" in err + out:
        faults.append("traceback")
    if ended.status not in (status, INTERRUPTED):
        faults.append(f"status {ended.status}")
    elif states != {"new" if ended.status == status else "old"}:
        faults.append(f"status {ended.status} with {' and '.join(sorted(states))} files")
    if out.startswith("{"):
        try:
            json.loads(out)
        except ValueError:
            faults.append("no JSON object")
    return faults


def _temporary(name: str) -> str:
    """Return the one name that what SIGKILL leaves of a file may have."""
    path = Path(name)
    return str(path.with_name(f".{path.name}.tmp"))


if __name__ == "__main__":
    sys.exit(main())
