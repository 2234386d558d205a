"""WorkerProcesses: an executor that loses one call per dead process; the worker's program."""

import os
import pickle
import queue
import signal
import struct
import subprocess
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager, suppress
from typing import IO, Any, TypeVar

from tubeplanner.checks import WHOLE_NUMBER
from tubeplanner.errors import OptionError

# ---- The executor: a process that dies costs one call.
#
# The standard library's pool is broken for good once a process dies, with all calls that were on
# their way, and its processes run the main script of the program again. Here every process has one
# call at a time, so that its death has one culprit, and begins with this package alone: no
# `if __name__ == "__main__"` is needed.

_R = TypeVar("_R")
THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
_PROGRAM = """import sys
sys.path[:] = {path!r}
from tubeplanner.studies.worker_processes import serve
serve()
"""


class WorkerDied(Exception):
    """The process of a call ended without an answer, twice."""


class WorkerProcesses(Executor):
    """Processes for calls, each with one thread for linear algebra.

    A call whose process dies is made once more in a new process, while no other call runs; if that
    dies too, its future raises `WorkerDied`. The called function must be importable by name: it and
    its arguments are pickled. If a `with` statement ends by an exception, such as Ctrl-C, all
    processes are ended at once.
    """

    def __init__(self, count: int | None = None) -> None:
        """Set the number of processes; the first call starts the first process.

        Args:
            count: Largest number of processes; None: the number of processors for this process.

        Raises:
            OptionError: The count is no whole number >= 1.
        """
        if count is not None and (not isinstance(count, WHOLE_NUMBER) or count < 1):
            raise OptionError(f"count of worker processes is {count!r}; give a whole number >= 1")
        self.count = processors() if count is None else int(count)
        self._calls: queue.SimpleQueue[_Call | None] = queue.SimpleQueue()
        self._threads: list[threading.Thread] = []
        self._lock, self._floor = threading.Lock(), _Floor()
        self._running: set[_Worker] = set()
        self._closed = self._killed = False

    def __repr__(self) -> str:
        return f"<WorkerProcesses: {self.count}>"

    def submit(self, fn: Callable[..., _R], /, *args: Any, **kwargs: Any) -> "Future[_R]":
        """Send a call to the next free process; the call is pickled then.

        Raises:
            RuntimeError: The processes were shut down.
        """
        call = _Call((fn, args, kwargs))
        with self._lock:
            if self._closed:
                raise RuntimeError("these worker processes were shut down; make others")
            self._calls.put(call)
            if len(self._threads) < self.count:
                thread = threading.Thread(target=self._work, daemon=True)
                thread.start()
                self._threads.append(thread)
        return call.future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Take no more calls; end each process once its calls are done.

        Args:
            wait: True to return only then.
            cancel_futures: True to drop the calls that have not begun.
        """
        with self._lock:
            if cancel_futures:
                with suppress(queue.Empty):
                    while True:
                        if (call := self._calls.get_nowait()) is not None:
                            call.future.cancel()
            self._closed = True
            # In every shutdown: the Nones of a former one may have been dropped with waiting calls.
            for _ in self._threads:
                self._calls.put(None)
        if wait:
            for thread in self._threads:
                thread.join()

    def kill(self) -> None:
        """End all processes at once."""
        self.shutdown(wait=False, cancel_futures=True)
        with self._lock:
            self._killed = True
            for worker in self._running:
                worker.kill()

    def __exit__(self, kind: type[BaseException] | None, *exception: object) -> None:
        if kind is not None:
            self.kill()
        self.shutdown()

    def _work(self) -> None:
        """Send calls to a process, replaced if it dies, until there are no more."""
        worker: _Worker | None = None
        while (call := self._calls.get()) is not None:
            if call.future.set_running_or_notify_cancel():
                worker = self._answered(call, worker)
        self._end(worker)

    def _answered(self, call: "_Call", worker: "_Worker | None") -> "_Worker | None":
        """Answer a call; return the process for the next call if alive."""
        pickled, how = call.pickled(), ""
        if pickled is None:
            return worker
        for access in (self._floor.with_others, self._floor.alone):
            with access():
                try:
                    worker = worker or self._started()
                    call.answer(worker.ask(pickled))
                    return worker
                except _Dead as dead:
                    how = dead.how
                    self._end(worker)
                    worker = None
        call.future.set_exception(WorkerDied(f"the process that worked on it {how}"))
        return None

    def _started(self) -> "_Worker":
        """Return a new process.

        Raises:
            _Dead: It cannot be started, or all processes were ended.
        """
        with self._lock:
            if self._killed:
                raise _Dead("was ended with all others")
            try:
                worker = _Worker()
            except OSError as error:
                raise _Dead(f"could not be started: {error}") from error
            self._running.add(worker)
            return worker

    def _end(self, worker: "_Worker | None") -> None:
        if worker is not None:
            with self._lock:
                self._running.discard(worker)
            worker.end()


class _Call:
    """A function with its arguments, and the future of its answer.

    It is not pickled before it is sent: thousands of waiting calls may share large arguments.
    """

    def __init__(self, parts: tuple[Any, ...]) -> None:
        self._parts, self.future = parts, Future[Any]()

    def pickled(self) -> bytes | None:
        """Return the call, pickled; None if that fails: then its future raises the reason."""
        try:
            return pickle.dumps(self._parts)
        except Exception as error:
            self.future.set_exception(error)
            return None

    def answer(self, pickled: bytes) -> None:
        """Set the future from a pickled answer."""
        try:
            returned, value = pickle.loads(pickled)
        except Exception as error:
            self.future.set_exception(error)
            return
        if returned:
            self.future.set_result(value)
        else:
            self.future.set_exception(value)


class _Dead(Exception):
    """A process has ended; `how` says in words by which signal or status."""

    def __init__(self, how: str) -> None:
        super().__init__(how)
        self.how = how


class _Worker:
    """A process, asked by its standard input."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-c", _PROGRAM.format(path=sys.path)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, **dict.fromkeys(THREADS, "1")},
            start_new_session=True,  # Ctrl-C is the parent's
            creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),  # so on Windows
        )
        assert self._process.stdin is not None and self._process.stdout is not None
        self._calls, self._answers = self._process.stdin, self._process.stdout

    def ask(self, call: bytes) -> bytes:
        """Return the answer to a call.

        Raises:
            _Dead: The process ended before its answer.
        """
        try:
            _send(self._calls, call)
            return _received(self._answers)
        except (EOFError, OSError):
            self.kill()
            code = self._process.wait()
            if code < 0:
                raise _Dead(f"was ended by {signal.Signals(-code).name}") from None
            raise _Dead(f"ended with status {code}") from None

    def kill(self) -> None:
        self._process.kill()

    def end(self) -> None:
        """Close its standard input, so that the process ends, and wait for that."""
        with suppress(OSError):  # a dead process takes no rest of a call
            self._calls.close()
        self._answers.close()
        self._process.wait()


class _Floor:
    """A lock that many calls share, or a single call holds alone."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._together, self._waiting = 0, 0
        self._one = False

    @contextmanager
    def with_others(self) -> Iterator[None]:
        """Wait until no call is alone or waits to be."""
        with self._changed:
            self._changed.wait_for(lambda: not self._one and not self._waiting)
            self._together += 1
        try:
            yield
        finally:
            with self._changed:
                self._together -= 1
                self._changed.notify_all()

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Wait until no other call runs."""
        with self._changed:
            self._waiting += 1
            self._changed.wait_for(lambda: not self._one and not self._together)
            self._waiting -= 1
            self._one = True
        try:
            yield
        finally:
            with self._changed:
                self._one = False
                self._changed.notify_all()


def processors() -> int:
    """Return the number of processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


# ---- The worker: answers call by call.

_STANDARD_INPUT, _STANDARD_OUTPUT, _STANDARD_ERROR = 0, 1, 2
_BEGIN = b"\0tubeplanner\n"  # of a message; sitecustomize may print before


def serve() -> None:
    """Answer the calls on standard input, until its end, on standard output."""
    calls, answers = os.dup(_STANDARD_INPUT), os.dup(_STANDARD_OUTPUT)
    # Nothing that libraries read or print may come between the messages.
    with open(os.devnull) as nothing:
        os.dup2(nothing.fileno(), _STANDARD_INPUT)
    os.dup2(_STANDARD_ERROR, _STANDARD_OUTPUT)
    with suppress(EOFError, OSError), open(calls, "rb") as source, open(answers, "wb") as sink:
        while True:
            _send(sink, _answer(_received(source)))


def _send(stream: IO[bytes], message: bytes) -> None:
    stream.write(_BEGIN + struct.pack(">Q", len(message)))
    stream.write(message)
    stream.flush()


def _received(stream: IO[bytes]) -> bytes:
    """Return the next message; raise EOFError if the stream ends before its end."""
    line = stream.readline()
    while line and not line.endswith(_BEGIN):
        line = stream.readline()
    header = stream.read(8)
    length = struct.unpack(">Q", header)[0] if len(header) == 8 else 0
    message = stream.read(length)
    if len(header) < 8 or len(message) < length:
        raise EOFError
    return message


def _answer(call: bytes) -> bytes:
    """Return a pickled pair: True and the value of a pickled call, or False and its exception."""
    try:
        work, arguments, keywords = pickle.loads(call)
        return pickle.dumps((True, work(*arguments, **keywords)))
    except Exception as error:
        error.add_note("".join(traceback.format_tb(error.__traceback__)))
        # Its constructor may take other arguments, or it may hold unpicklable values.
        with suppress(Exception):
            if type(pickle.loads(pickle.dumps(error))) is type(error):
                return pickle.dumps((False, error))
        return pickle.dumps((False, RuntimeError(f"{type(error).__name__}: {error}")))
