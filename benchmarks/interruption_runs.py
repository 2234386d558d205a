"""Runs of one command in processes that are paused, go on and meet signals.

What the command computes is kept from its first run: see `interruption_cases.py`.
"""

import os
import select
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

from interruption_cases import Case, Kept
from tubeplanner.cli import start
from tubeplanner.cli.main import main as run_command

_LONGEST = 120.0  # [s]
_GO, _END = b"g", b"e"
_NUMBER = struct.Struct("i")
_CHANGES = ("open", "os.mkdir")  # as audit events are called
_MAX_LIFE, _MAX_RUN = 10.0, 120.0  # [s]
_LIFE = """
import os, sys
sys.argv[0] = "tubeplanner"
from tubeplanner.cli import start
start.interrupts_noted()
os.write(int(os.environ["BEGUN"]), b".")
start.run()
"""


@dataclass(frozen=True)
class Ended:
    """How a run ended.

    Attributes:
        status: Its exit status; the negative number of the signal that ended it.
        length: From the beginning of the stage to the end [s].
    """

    status: int
    length: float


class Pause:
    """A process that is paused; used in a `with` statement."""

    def __init__(self, live: Callable[[Callable[[], None]], object]) -> None:
        """Let it come to its stage.

        Args:
            live: What it does; calls its argument where it is to pause.
        """
        (self._read, answer), (request, self._write) = os.pipe(), os.pipe()
        self._child = os.fork()
        if self._child == 0:
            # Else it would not see the end of its parent.
            os.close(self._read)
            os.close(self._write)
            live(lambda: _serve(request, answer))
            os._exit(1)
        os.close(answer)
        os.close(request)
        if self._answer() is None:
            raise SystemExit("a run did not come to its stage")

    def __enter__(self) -> "Pause":
        return self

    def __exit__(self, *_: object) -> None:
        os.write(self._write, _END)
        os.waitpid(self._child, 0)
        os.close(self._write)
        os.close(self._read)

    def go_on(self, number: int | None = None, delay: float = 0.0) -> Ended:
        """Let it go on to its end; send it a signal after some time [s]."""
        os.write(self._write, _GO)
        child, begin = self._answer(), time.perf_counter()
        assert child is not None
        if number is not None:
            time.sleep(delay)
            with suppress(ProcessLookupError):  # it has ended
                os.kill(child, number)
        status = self._answer()
        if status is None:  # it hangs: its status tells
            os.kill(child, signal.SIGKILL)
            status = self._answer()
        assert status is not None
        return Ended(status, time.perf_counter() - begin)

    def _answer(self) -> int | None:
        if not select.select([self._read], [], [], _LONGEST)[0]:
            return None
        answer = os.read(self._read, _NUMBER.size)
        return int(_NUMBER.unpack(answer)[0]) if answer else None


class Stage(Enum):
    """What a signal is counted from: the answer is there, or the first file is opened."""

    ANSWERED = "answered"
    WRITES = "writes"


@dataclass(frozen=True)
class Location:
    """Where a run leaves its outputs, temporary files of the system, and what it prints."""

    folder: Path

    @classmethod
    def new(cls, folder: Path, case: Case) -> "Location":
        """Return an empty place, but for old files where there are folders for them."""
        shutil.rmtree(folder, ignore_errors=True)
        for name in ("out", "temporary"):
            (folder / name).mkdir(parents=True)
        for name in case.files:
            if "/" not in name:
                (folder / "out" / name).write_bytes(old_content(name))
        return cls(folder)

    @property
    def out(self) -> Path:
        """The folder of outputs."""
        return self.folder / "out"

    @property
    def printed(self) -> tuple[str, str]:
        """Standard output and standard error."""
        out, err = ((self.folder / name).read_text() for name in ("stdout", "stderr"))
        return out, err

    def found(self) -> dict[str, bytes]:
        """Return all files and empty folders by their names under it."""
        found = {}
        for root in (self.out, self.folder / "temporary"):
            for path in sorted(root.rglob("*")):
                if path.is_file():
                    found[str(path.relative_to(root))] = path.read_bytes()
                elif not any(path.iterdir()):
                    found[f"{path.relative_to(root)}/"] = b""
        return found


def old_content(name: str) -> bytes:
    """Return what a file has before a run."""
    return f"what {name} had before\n".encode()


@dataclass(frozen=True)
class Answer:
    """What is right of a run.

    Attributes:
        files: Those that it writes, by their names.
        status: Its exit status.
    """

    files: dict[str, bytes]
    status: int = 0


class Runs:
    """Runs of one command, and what is right of them.

    Attributes:
        case: The command.
        life: How long it takes [s].
        new: What is there after it, by names as `Location.found`.
        shortened: Its answers where Ctrl-C came after the first of several things it computes,
            after the second, and so on. Or before what is found last.
    """

    def __init__(self, case: Case, inputs: Path, scratch: Path) -> None:
        """Run it once whole, keep what it computes, and measure its writing stage."""
        self.case, self._inputs, self._scratch = case, inputs, scratch / case.name
        self._kept = Kept(case)
        begin = time.perf_counter()
        place = self.place()
        with self._kept.recorded(), silenced():
            status = run_command(case.arguments(inputs, place.out))
        self.life = min(time.perf_counter() - begin + 1.0, _MAX_LIFE)
        if status != 0:
            raise SystemExit(f"{case.name} does not run: exit status {status}")
        self.new = self._answer(None).files
        self.shortened = [self._answer(count) for count in range(1, self._kept.count)]
        if case.late:
            early = {name: content for name, content in self.new.items() if name not in case.late}
            self.shortened.append(Answer(early))

    def _answer(self, count: int | None) -> Answer:
        """Return its answer if Ctrl-C comes after so much is computed; None: never."""
        status = self.forked(place := self.place(), count).status
        found = place.found().items()
        return Answer({name: new for name, new in found if new != old_content(name)}, status)

    def place(self) -> Location:
        """Return a new place for a run."""
        return Location.new(self._scratch, self.case)

    def paused(self, stage: Stage = Stage.ANSWERED, more: Sequence[str] = ()) -> Pause:
        """Return it paused at a stage, in the place of the runs, with more arguments."""
        place = self.place()

        def live(pause: Callable[[], None]) -> None:
            def begun() -> None:
                pause()
                _redirect(place)

            def called(number: int) -> None:
                if stage is Stage.ANSWERED and number == 0:
                    begun()

            if stage is Stage.WRITES:
                sys.addaudithook(_opening(place.out, begun))
            self._live(place, called, more)

        return Pause(live)

    def forked(self, place: Location, count: int | None = None) -> Ended:
        """Run it in a child, to its end; with a Ctrl-C after so much is computed."""

        def interrupt(number: int) -> None:
            if number == count:
                raise KeyboardInterrupt

        begin, child = time.perf_counter(), os.fork()
        if child == 0:
            _redirect(place)
            self._live(place, interrupt, ())
        _, status = os.waitpid(child, 0)
        return Ended(os.waitstatus_to_exitcode(status), time.perf_counter() - begin)

    def _live(self, place: Location, called: Callable[[int], None], more: Sequence[str]) -> None:
        """Run the program in this child, and end it; `called` as for `Kept.given_back`."""
        status = 1
        try:
            tempfile.tempdir = str(place.folder / "temporary")
            sys.argv = ["tubeplanner", *self.case.arguments(self._inputs, place.out), *more]
            with self._kept.given_back(called):
                start.run()
        except SystemExit as ended:
            status = int(ended.code or 0)
        except BaseException:
            traceback.print_exc()
        finally:
            for stream in (sys.stdout, sys.stderr):
                stream.flush()
            os._exit(status)

    def lived(self, place: Location, number: int, delay: float) -> Ended:
        """Run it in a process that computes all, and send it a signal so long after it began."""
        begun, tell = os.pipe()
        with open(place.folder / "stdout", "w") as out, open(place.folder / "stderr", "w") as err:
            process = subprocess.Popen(
                [sys.executable, "-c", _LIFE, *self.case.arguments(self._inputs, place.out)],
                stdout=out,
                stderr=err,
                pass_fds=[tell],
                env=os.environ | {"BEGUN": str(tell), "TMPDIR": str(place.folder / "temporary")},
            )
        os.close(tell)
        select.select([begun], [], [], _MAX_RUN)
        begin = time.perf_counter()
        with suppress(subprocess.TimeoutExpired):
            process.wait(delay)
        if process.poll() is None:
            process.send_signal(number)
        with suppress(subprocess.TimeoutExpired):
            process.wait(_MAX_RUN)
        if process.poll() is None:
            process.kill()
        process.wait()
        os.close(begun)
        return Ended(process.returncode, time.perf_counter() - begin)


@contextmanager
def silenced() -> Iterator[None]:
    """Let nothing be printed."""
    kept = os.dup(1)
    sink = os.open(os.devnull, os.O_WRONLY)
    try:
        sys.stdout.flush()
        os.dup2(sink, 1)
        yield
    finally:
        sys.stdout.flush()
        os.dup2(kept, 1)
        os.close(sink)
        os.close(kept)


def _serve(request: int, answer: int) -> None:
    """Wait to be told to go on; return in the process that does."""
    os.write(answer, _NUMBER.pack(os.getpid()))
    while os.read(request, 1) == _GO:
        child = os.fork()
        if child == 0:
            return
        os.write(answer, _NUMBER.pack(child))
        _, status = os.waitpid(child, 0)
        os.write(answer, _NUMBER.pack(os.waitstatus_to_exitcode(status)))
    os._exit(0)


def _redirect(place: Location) -> None:
    """Let this process print into files."""
    for descriptor, name in ((1, "stdout"), (2, "stderr")):
        flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC
        os.dup2(os.open(place.folder / name, flags, 0o666), descriptor)


def _opening(folder: Path, begun: Callable[[], object]) -> Callable[[str, tuple[Any, ...]], None]:
    """Return a hook that calls `begun` when the first file in a folder is opened or made."""
    waiting = [begun]

    def hook(event: str, values: tuple[Any, ...]) -> None:
        if waiting and event in _CHANGES and str(values[0]).startswith(str(folder)):
            waiting.pop()()

    return hook
