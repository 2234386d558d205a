"""Is every damaged file read or refused in one line, in bounded time and memory?

    python benchmarks/fuzz.py --minutes 30 --folder fuzzed
    python benchmarks/fuzz.py --only stl --only dae --cases 100

Case k of a kind is always the same file. With --folder, what is done is noted there as soon as it
is done, and the same command goes on with the seeds that are left; the files of what fails are kept
in it. Exit status 1 if a case is a fault.
"""

import argparse
import json
import os
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import asdict, dataclass
from itertools import count
from pathlib import Path
from random import Random

from fuzz_files import attacks, mutated, put_something_else
from fuzz_kinds import KINDS, Kind
from tubeplanner import TubePlannerError
from tubeplanner.studies.journal import Journal

TIME_LIMIT = 20.0  # [s]
MEMORY_LIMIT = 1_000_000_000  # [bytes], beside what the process begins with
_ADDRESSES = 3 * MEMORY_LIMIT
_ATTACKS, _NO_FILES, _COMMANDS = 0.1, 0.15, 0.25  # shares of the cases, the first two together
_OUTPUTS = {"page.html", "plot.png"}
_KEPT = 1_000_000  # [bytes] of a file that is kept
# The cache of collision geometry is the fuzzer's own; warnings of what is read are not its output.
os.environ.setdefault("TUBEPLANNER_CACHE", tempfile.mkdtemp(prefix="fuzz-cache-"))


@dataclass(frozen=True)
class Outcome:
    """What came of a case.

    Attributes:
        kind: Of the file.
        seed: Of the case.
        status: "accepted", "refused" or "fault".
        what: How it was read, and what was done to the file.
        message: Of the refusal, or what is wrong.
        seconds: Wall time [s].
        memory: Largest growth of the process [bytes].
    """

    kind: str
    seed: int
    status: str
    what: str
    message: str
    seconds: float
    memory: int

    def as_dict(self) -> dict[str, object]:
        """Return it as JSON values."""
        return asdict(self)


def run_case(kind: str, seed: int, faults: Path | None = None) -> Outcome:
    """Damage a file and read it, in a new process.

    Args:
        kind: One of `KINDS`.
        seed: All of the case follows from kind and seed.
        faults: A folder to keep the case's files in, if there is a fault; None: it is not kept.
    """
    rng = Random(f"{kind} {seed}")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "case"
        what = _prepare(KINDS[kind], folder, rng)
        command = rng.choice(KINDS[kind].commands) if KINDS[kind].commands else ()
        is_command = bool(command) and rng.random() < _COMMANDS
        if is_command:
            arguments = [*command, *(["--json"] * (rng.random() < 0.3))]
            what = f"{' '.join(arguments)}; {what}"
            status, message, seconds, memory = _ran(lambda: _command(folder, arguments), name)
        else:
            status, message, seconds, memory = _ran(lambda: _read(KINDS[kind], folder), name)
        outcome = Outcome(kind, seed, status, what, message, round(seconds, 3), memory)
        if faults is not None and status == "fault":
            _keep(folder / KINDS[kind].file, faults / f"{kind}.{seed}", outcome)
    return outcome


def page_fault(page: str) -> str | None:
    """Return what in a page of `view` may come from a name that was taken for markup."""
    head, _, rest = page.partition("</title>")
    tags = (r"<script\b", r"</script\b")
    opened, closed = (len(re.findall(tag, rest, re.IGNORECASE)) for tag in tags)
    inner = head.partition("<title>")[2]
    if "<" in inner:
        return f"the page's title has markup: {inner!r}"
    if "<!--" in re.sub(r"^.*?(?=<body)", "", rest, count=1, flags=re.S).split("<script", 1)[0]:
        return "the page has a comment"
    return None if opened == closed else f"{opened} <script> for {closed} </script>"


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


def _prepare(kind: Kind, folder: Path, rng: Random) -> str:
    """Make the folder of a case; return what was done to its file."""
    folder.mkdir()
    (folder / "folder").mkdir()
    os.mkfifo(folder / "pipe")
    (folder / "zero").symlink_to("/dev/zero")
    for name, content in kind.others().items():
        (folder / name).write_bytes(content)
    path, draw = folder / kind.file, rng.random()
    if draw < _ATTACKS:
        form = rng.choice(kind.attacks or (kind.form,))
        files = attacks(form)
        k = rng.randrange(len(files))
        path.write_bytes(files[k])
        return f"attack {form} {k}"
    contents = rng.choice(kind.contents())
    if draw < _NO_FILES:
        path.write_bytes(contents)
        return put_something_else(path, rng)
    path.write_bytes(mutated(contents, kind.form, rng))
    return "mutated"


def _ran(work: Callable[[], tuple[str, str]], folder: str) -> tuple[str, str, float, int]:
    """Do some work in a new process; return its answer, the time [s] and the memory [bytes]."""
    report, begin, before = Path(folder) / "report", time.monotonic(), _resident()
    child = os.fork()
    if child == 0:
        _work_and_exit(work, report)
    with _killed_after(child, TIME_LIMIT) as killed:
        _, code, usage = os.wait4(child, 0)
    seconds = time.monotonic() - begin
    memory = max(0, usage.ru_maxrss * 1024 - before)
    if killed:
        return "fault", f"not done after {TIME_LIMIT:g} s", seconds, memory
    try:
        status, message = json.loads(report.read_text())
    except (OSError, ValueError):
        return "fault", f"the process ended with {code}", seconds, memory
    if memory > MEMORY_LIMIT:
        return "fault", f"took {memory / 1e6:.0f} MB; {status}: {message}", seconds, memory
    return status, message, seconds, memory


def _work_and_exit(work: Callable[[], tuple[str, str]], report: Path) -> None:
    """Do the work in this process, which has bounds of its own, and end it."""
    os.setsid()
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + _ADDRESSES,) * 2)
    try:
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            warnings.simplefilter("ignore", DeprecationWarning)  # of compiled parts of libraries
            answer = work()
        if warned:
            told = warned[0]
            answer = ("fault", f"warned: {told.message} ({told.filename}, line {told.lineno})")
    except BaseException:
        answer = ("fault", traceback.format_exc())
    report.write_text(json.dumps(answer))
    os._exit(0)


@contextmanager
def _killed_after(child: int, seconds: float) -> Iterator[list[int]]:
    """Kill a process, and all it started, that takes longer; yield a list that is filled then."""
    killed: list[int] = []

    def kill(number: int, frame: object) -> None:
        killed.append(number)
        os.kill(child, signal.SIGKILL)

    before = signal.signal(signal.SIGALRM, kill)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield killed
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def _resident() -> int:
    """Return what a new process begins with: of pages that are no file's [bytes]."""
    pages = list(map(int, Path("/proc/self/statm").read_text().split()))
    return (pages[1] - pages[2]) * resource.getpagesize()


def _read(kind: Kind, folder: Path) -> tuple[str, str]:
    """Read the file by Python; only errors of our family may come out."""
    os.chdir(folder)
    before = set(os.listdir())
    try:
        kind.read(folder / kind.file)
        status, message = "accepted", ""
    except TubePlannerError as error:
        status, message = "refused", str(error)
    stray = set(os.listdir()) - before - {kind.file}
    if stray:
        return "fault", f"left {sorted(stray)}"
    if fault := _text_fault(message):
        return "fault", f"{fault}: {message!r}"
    return status, message


def _text_fault(text: str) -> str | None:
    """Return what a terminal would obey in a text, or that it has several lines."""
    hidden = next((c for c in text if not c.isprintable()), None)
    return None if hidden is None else f"a message with {hidden!r}"


def _command(folder: Path, arguments: list[str]) -> tuple[str, str]:
    """Read the file by the command line, and judge what it prints and leaves."""
    os.chdir(folder)
    before = set(os.listdir())
    streams = [os.open(folder.parent / name, os.O_RDWR | os.O_CREAT) for name in ("out", "err")]
    for number, stream in enumerate(streams, start=1):
        os.dup2(stream, number)
    try:
        from tubeplanner.cli.start import run

        sys.argv = ["tubeplanner", *arguments]
        run()
    except SystemExit as end:
        sys.stdout.flush()
        sys.stderr.flush()
        out, err = ((folder.parent / name).read_bytes().decode() for name in ("out", "err"))
        is_answered = arguments[0] == "explain" and not err and ": bad_input: " in out
        fault = _command_fault(end.code, out, err, "--json" in arguments, is_answered)
        fault = fault or _left_behind(folder, set(os.listdir()) - before, end.code)
        if fault is not None:
            return "fault", f"{fault}; exit status {end.code}, {out[-1500:]!r}, {err[-1500:]!r}"
        return ("refused" if end.code else "accepted"), (err or out)[-300:]
    return "fault", "did not exit"


def _command_fault(
    code: object, out: str, err: str, as_json: bool, is_answered: bool
) -> str | None:
    """Return what is wrong with an exit status and what was printed.

    Args:
        code: The exit status.
        out: What was printed on standard output.
        err: On standard error.
        as_json: Whether JSON was asked for.
        is_answered: Whether standard output alone says what is wrong with bad input, and what
            helps, as `explain` does.
    """
    if code not in (0, 1, 2):
        return "another exit status"
    if "internal error" in out + err or "Traceback" in out + err:
        return "an internal error"
    if as_json and (err or not _is_json_object(out)):
        return "what is printed is not one JSON object alone"
    if not as_json and code == 2 and not is_answered and (out or len(err.splitlines()) != 1):
        return "bad input is not told in one line"
    return _text_fault((out + err).replace("\n", ""))


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is no JSON")


def _is_json_object(text: str) -> bool:
    """Return whether a text is one JSON object, in which there is no NaN."""
    try:
        return isinstance(json.loads(text, parse_constant=_refuse), dict)
    except ValueError:
        return False


def _left_behind(folder: Path, new: set[str], code: object) -> str | None:
    """Return what is wrong with the files that a command wrote."""
    stray = new - (_OUTPUTS if code == 0 else set())
    if stray:
        return f"left {sorted(stray)}"
    page = folder / "page.html"
    if "page.html" in new and (fault := page_fault(page.read_text())):
        return fault
    return None


def _keep(file: Path, folder: Path, outcome: Outcome) -> None:
    """Keep a case that is a fault."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "outcome.json").write_text(json.dumps(outcome.as_dict(), indent=2) + "\n")
    if file.is_file() and not file.is_symlink() and file.stat().st_size < _KEPT:
        shutil.copy(file, folder / file.name)


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
