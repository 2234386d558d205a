"""A Dask cluster as an executor, with a retry of each lost call alone."""

import os
import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from typing import Any, TypeVar

from tubeplanner.errors import OptionError, not_installed
from tubeplanner.studies.problem_spec import package_hash

_PATIENCE = 10.0  # [s]


@contextmanager
def dask_executor(address: str, timeout: float = _PATIENCE) -> Iterator[Executor]:
    """Connect to a Dask cluster, for `plan_many` and `study`.

    All workers must have the sources of tubeplanner that this process has, and one thread each, for
    plans and for linear algebra. Workers that join later are not checked. A call that Dask gives
    up, as too many workers died with it, is made once more, alone.

    Args:
        address: Address of its scheduler, such as tcp://10.0.0.1:8786.
        timeout: Longest wait for scheduler and workers [s].

    Yields:
        An executor, open for the `with` statement.

    Raises:
        OptionError: Dask is not installed, the scheduler or its workers are not there, workers have
            other sources or other numbers of threads, or the scheduler is lost.
    """
    try:
        from distributed import Client, KilledWorker
    except ImportError:
        raise OptionError(not_installed("dask", f"scheduler {address}", "Dask")) from None
    try:
        client = Client(address, timeout=timeout)
    except (OSError, ValueError) as error:
        raise OptionError(
            f"there is no Dask scheduler at {address} ({error}); give the address that "
            "`dask scheduler` prints, such as tcp://10.0.0.1:8786"
        ) from error
    try:
        _check_workers(client, address, timeout)
        yield RetriedAlone(client.get_executor(pure=False), KilledWorker)
    except OptionError as error:
        if client.status != "running":
            raise OptionError(
                f"the Dask scheduler at {address} was lost; what is not done yet will not be: "
                "start a scheduler with workers, and begin again with what is left"
            ) from error
        raise
    finally:
        client.close(timeout)


def _check_workers(client: Any, address: str, timeout: float) -> None:
    try:
        client.wait_for_workers(1, timeout=timeout)
    except TimeoutError:
        raise OptionError(
            f"the Dask scheduler at {address} has no workers after {timeout:g} s; start some with "
            f"`dask worker {address} --nworkers auto --nthreads 1`"
        ) from None
    threads = client.nthreads()
    states = client.run(_package_and_threads, on_error="return")
    faults = {name: _fault(state, threads.get(name, 1)) for name, state in states.items()}
    faults = {name: fault for name, fault in faults.items() if fault}
    if faults:
        worker, fault = min(faults.items())
        raise OptionError(
            f"{len(faults)} of {len(states)} workers of the Dask scheduler at {address} cannot be "
            f"used; the one at {worker} {fault}"
        )


def _package_and_threads() -> tuple[str, str | None]:
    """Return a worker's hash of sources and threads of linear algebra."""
    threads = os.environ.get("OPENBLAS_NUM_THREADS") or os.environ.get("OMP_NUM_THREADS")
    return package_hash(), threads


def _fault(state: tuple[str, str | None] | Exception, threads: int) -> str:
    """Return the fault of a worker with its remedy; empty if there is none."""
    if isinstance(state, Exception):
        return f"cannot load tubeplanner ({state}); install there what is installed here"
    sources, linear_algebra = state
    if sources != package_hash():
        return "has other sources of tubeplanner; install there what is installed here"
    if linear_algebra != "1":
        return (
            f"has {linear_algebra or 'any number of'} threads for linear algebra, whose answers "
            "differ in their last bits; set OPENBLAS_NUM_THREADS=1 there, as Dask's nanny does"
        )
    if threads > 1:
        return f"has {threads} threads, whose plans hold each other up; give it `--nthreads 1`"
    return ""


_R = TypeVar("_R")


class RetriedAlone(Executor):
    """Another executor, whose lost calls are made once more, each while no other call runs.

    Where workers receive calls ahead, as Dask's do, all calls of a dead worker fail alike. A call
    that is lost again alone ended its worker itself.
    """

    def __init__(self, executor: Executor, died: type[Exception]) -> None:
        """Wrap an executor.

        Args:
            executor: The executor.
            died: Exception of the futures whose worker was lost.
        """
        self._executor, self._died = executor, died
        self._lock = threading.Lock()
        self._running, self._alone = 0, False
        self._suspects: deque[_Call] = deque()
        self._waiting: deque[_Call] = deque()

    def __repr__(self) -> str:
        return f"<RetriedAlone: {self._executor!r}>"

    def submit(self, fn: Callable[..., _R], /, *args: Any, **kwargs: Any) -> "Future[_R]":
        """Send a call, which waits while a lost call is made again."""
        call = _Call(fn, args, kwargs)
        with self._lock:
            if self._alone:
                self._waiting.append(call)
                return call.future
            self._running += 1
        self._make(call)
        return call.future

    def _make(self, call: "_Call", last: bool = False) -> None:
        try:
            future = call.sent(self._executor)
        except BaseException:
            self._go_on()
            raise

        def end(future: "Future[Any]") -> None:
            died = not future.cancelled() and isinstance(future.exception(), self._died)
            if died and not last and not call.future.cancelled():
                with self._lock:
                    self._suspects.append(call)
            else:
                call.answer(future)
            self._go_on()

        future.add_done_callback(end)

    def _go_on(self) -> None:
        """Count a running call less; when none runs, send the waiting calls."""
        with self._lock:
            self._running -= 1
            if self._running:
                return
            self._alone = bool(self._suspects)
            calls = [self._suspects.popleft()] if self._alone else list(self._waiting)
            if not self._alone:
                self._waiting.clear()
            self._running, last = len(calls), self._alone
        for call in calls:
            try:
                self._make(call, last)
            except Exception as error:
                call.refuse(error)


class _Call:
    """A call and the future that its user holds."""

    def __init__(
        self, function: Callable[..., Any], args: tuple[Any, ...], keywords: dict[str, Any]
    ) -> None:
        self._function, self._args, self._keywords = function, args, keywords
        self.future: Future[Any] = Future()

    def sent(self, executor: Executor) -> "Future[Any]":
        """Send the call; cancelling the user's future cancels the sent future."""
        sent = executor.submit(self._function, *self._args, **self._keywords)
        self.future.add_done_callback(lambda future: future.cancelled() and sent.cancel())
        return sent

    def answer(self, sent: "Future[Any]") -> None:
        """Pass on the result of a future."""
        if sent.cancelled():
            self.future.cancel()
        if not self.future.set_running_or_notify_cancel():
            return
        if (error := sent.exception()) is not None:
            self.future.set_exception(error)
        else:
            self.future.set_result(sent.result())

    def refuse(self, error: Exception) -> None:
        """Fail with the reason for which the call was not sent."""
        if self.future.set_running_or_notify_cancel():
            self.future.set_exception(error)
