"""A process that has come to a stage of its work, and goes on from there as often as it is told.

Every time it forks, so that what comes before the stage is done once.
"""

import os
import select
import signal
import struct
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

_LONGEST = 120.0  # [s]
_GO, _END = b"g", b"e"
_NUMBER = struct.Struct("i")


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
