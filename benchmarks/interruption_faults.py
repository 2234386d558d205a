"""What is wrong with a run that a signal met, or that could not write."""

import json
import signal
from pathlib import Path

from interruption_pauses import Ended
from interruption_runs import Answer, Place, Runs, old_content

INTERRUPTED, BAD_INPUT = 130, 2


def faults(runs: Runs, place: Place, ended: Ended, number: int, *, exact: bool = True) -> list[str]:
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


def _faults_of_next(runs: Runs, place: Place) -> list[str]:
    """Run it again where SIGKILL left something."""
    if runs.case.journal is not None:
        (place.out / runs.case.journal).unlink(missing_ok=True)
    ended = runs.forked(place)
    clean = ended.status == 0 and place.found() == runs.new
    return [] if clean else ["what is left stays"]


def faults_without_room(runs: Runs, place: Place, ended: Ended, remedy: str) -> list[str]:
    """Return what is wrong with a run that could not write."""
    found, faults, (_, err) = place.found(), [], place.printed
    found.pop("filler", None)
    found.pop(runs.case.journal or "", None)
    if found == {name: runs.new[name] for name in runs.case.files} and ended.status == 0:
        return []  # there was room
    if set(found) - set(runs.case.files):
        faults.append("files are left")
    names = runs.case.files
    if _states(runs, runs.new, found, True) != {"old"}:
        faults.append("an output is changed")
    if ended.status != BAD_INPUT or "Traceback" in err:
        faults.append(f"status {ended.status}")
    named = [*(name.split("/")[0] for name in names), *[runs.case.journal] * 1]
    if not any(name and name in err for name in named):
        faults.append("no file is named")
    if remedy not in err:
        faults.append("no remedy is named")
    return faults


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
