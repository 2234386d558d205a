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

# ---- An executor that finds out which of the calls that were on a lost worker it died of.

_R = TypeVar("_R")


class RetriedAlone(Executor):
    """Another executor, whose calls that died are made once more, each while no other is made.

    Where workers are sent calls ahead, as Dask's are, the one that a worker dies of is not known:
    all that were with it are blamed. Alone, a call that dies again did it by itself.
    """

    def __init__(self, executor: Executor, died: type[Exception]) -> None:
        """Keep what to call by.

        Args:
            executor: What makes the calls.
            died: What their futures raise if it lost the workers that were to answer.
        """
        self._executor, self._died = executor, died
        self._lock = threading.Lock()
        self._made, self._alone = 0, False
        self._suspects: deque[_Call] = deque()
        self._waiting: deque[_Call] = deque()

    def __repr__(self) -> str:
        return f"<RetriedAlone: {self._executor!r}>"

    def submit(self, fn: Callable[..., _R], /, *args: Any, **kwargs: Any) -> "Future[_R]":
        """Send a call; while one that died is made again, it waits."""
        call = _Call(fn, args, kwargs)
        with self._lock:
            if self._alone:
                self._waiting.append(call)
                return call.future
            self._made += 1
        self._make(call)
        return call.future

    def _make(self, call: "_Call", last: bool = False) -> None:
        try:
            made = call.sent(self._executor)
        except BaseException:
            self._go_on()
            raise
        made.add_done_callback(lambda made: self._ended(call, made, last))

    def _ended(self, call: "_Call", made: "Future[Any]", last: bool) -> None:
        died = not made.cancelled() and isinstance(made.exception(), self._died)
        if died and not last and not call.future.cancelled():
            with self._lock:
                self._suspects.append(call)
        else:
            call.answer(made)
        self._go_on()

    def _go_on(self) -> None:
        """Count a call as no longer made; send what waited for that."""
        with self._lock:
            self._made -= 1
            if self._made:
                return
            self._alone = bool(self._suspects)
            calls = [self._suspects.popleft()] if self._alone else list(self._waiting)
            if not self._alone:
                self._waiting.clear()
            self._made, last = len(calls), self._alone
        for call in calls:
            try:
                self._make(call, last)
            except Exception as error:
                call.refuse(error)


class _Call:
    """A call and the future that its user holds."""

    def __init__(
        self, function: Callable[..., Any], args: tuple[Any, ...], named: dict[str, Any]
    ) -> None:
        self._function, self._args, self._named = function, args, named
        self.future: Future[Any] = Future()

    def sent(self, executor: Executor) -> "Future[Any]":
        """Send it; the future that comes is dropped with the user's."""
        made = executor.submit(self._function, *self._args, **self._named)
        self.future.add_done_callback(lambda future: future.cancelled() and made.cancel())
        return made

    def answer(self, made: "Future[Any]") -> None:
        """Pass on what came of it."""
        if made.cancelled():
            self.future.cancel()
        if not self.future.set_running_or_notify_cancel():
            return
        if (error := made.exception()) is not None:
            self.future.set_exception(error)
        else:
            self.future.set_result(made.result())

    def refuse(self, error: Exception) -> None:
        """Say why it was not sent."""
        if self.future.set_running_or_notify_cancel():
            self.future.set_exception(error)


# ---- The workers of a Dask cluster as an executor.

_PATIENCE = 10.0  # [s]


@contextmanager
def dask_executor(address: str, timeout: float = _PATIENCE) -> Iterator[Executor]:
    """Connect to a Dask cluster, for `plan_many` and `study`.

    All workers must have the sources of tubeplanner that this process has, and one thread each,
    for plans and for linear algebra. Those that join later are not looked at. A call that Dask
    gives up, as too many workers died with it, is made once more, alone.

    Args:
        address: Of its scheduler, such as tcp://10.0.0.1:8786.
        timeout: How long to wait for scheduler and workers [s].

    Yields:
        An executor, open for the `with` statement.

    Raises:
        OptionError: Dask is not installed, the scheduler or its workers are not there, workers
            have other sources or other numbers of threads, or the scheduler is lost.
    """
    client = _connected(address, timeout)
    try:
        _check_workers(client, address, timeout)
        yield _executor_of(client)
    except OptionError as error:
        if client.status != "running":
            raise OptionError(
                f"the Dask scheduler at {address} was lost; what is not done yet will not be: "
                "start a scheduler with workers, and begin again with what is left"
            ) from error
        raise
    finally:
        client.close(timeout)


def _connected(address: str, timeout: float) -> Any:
    try:
        from distributed import Client
    except ImportError:
        raise OptionError(not_installed("dask", f"scheduler {address}", "Dask")) from None
    try:
        return Client(address, timeout=timeout)
    except (OSError, ValueError) as error:
        raise OptionError(
            f"there is no Dask scheduler at {address} ({error}); give the address that "
            "`dask scheduler` prints, such as tcp://10.0.0.1:8786"
        ) from error


def _executor_of(client: Any) -> Executor:
    from distributed import KilledWorker

    return RetriedAlone(client.get_executor(pure=False), KilledWorker)


def _check_workers(client: Any, address: str, timeout: float) -> None:
    try:
        client.wait_for_workers(1, timeout=timeout)
    except TimeoutError:
        raise OptionError(
            f"the Dask scheduler at {address} has no workers after {timeout:g} s; start some with "
            f"`dask worker {address} --nworkers auto --nthreads 1`"
        ) from None
    threads = client.nthreads()
    found = client.run(_package_and_threads, on_error="return").items()
    wrong = {worker: said for worker, has in found if (said := _wrong(has, threads.get(worker, 1)))}
    if wrong:
        worker, said = min(wrong.items())
        raise OptionError(
            f"{len(wrong)} of {len(found)} workers of the Dask scheduler at {address} cannot be "
            f"used; the one at {worker} {said}"
        )


def _package_and_threads() -> tuple[str, str | None]:
    """Return, on a worker, what sources it has, and how many threads linear algebra has there."""
    threads = os.environ.get("OPENBLAS_NUM_THREADS") or os.environ.get("OMP_NUM_THREADS")
    return package_hash(), threads


def _wrong(has: tuple[str, str | None] | Exception, threads: int) -> str:
    """Return what is wrong with a worker, and what to do; empty if nothing is."""
    if isinstance(has, Exception):
        return f"cannot load tubeplanner ({has}); install there what is installed here"
    sources, linear_algebra = has
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
