"""One function for many items, by any executor: what comes of each, as it comes."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Generic, TypeVar

from tubeplanner.errors import OptionError

_T = TypeVar("_T")
_R = TypeVar("_R")
# More would hold more in memory; fewer would leave some of a large cluster without work.
_SUBMITTED = 4000


@dataclass(frozen=True)
class Done(Generic[_R]):
    """What came of one item.

    Attributes:
        index: Which of the items, from 0.
        value: What the function returned; None if it did not.
        error: Why it did not: what it raised, or what became of its worker; None if it did.
    """

    index: int
    value: _R | None = None
    error: Exception | None = None


def run_many(
    work: Callable[[_T], _R], items: Iterable[_T], executor: Executor | None = None
) -> Iterator[Done[_R]]:
    """Call a function with each item, and yield what comes of it as it comes.

    Args:
        work: The function; it must be importable by name for executors that pickle.
        items: What it is called with; taken a few thousand at most ahead of what is done.
        executor: What calls it, by `submit` alone; None: this process, one after the other.

    Yields:
        One for every item, in the order in which they are done.

    Raises:
        OptionError: The executor broke, or dropped items: what is not done yet will not be.
        KeyboardInterrupt: Ctrl-C; what has not begun is dropped.
    """
    if executor is None:
        for index, item in enumerate(items):
            yield _called(index, work, item)
        return
    waiting: dict[Future[_R], int] = {}
    finished: SimpleQueue[Future[_R]] = SimpleQueue()
    numbered = enumerate(items)
    try:
        while True:
            if finished.empty() and len(waiting) < _SUBMITTED and (one := next(numbered, None)):
                future = _submitted(executor, work, one[1])
                waiting[future] = one[0]
                future.add_done_callback(finished.put)
            elif waiting:
                future = finished.get()
                yield _of_future(waiting.pop(future), future)
            else:
                return
    finally:
        for future in waiting:
            future.cancel()


def _submitted(executor: Executor, work: Callable[[_T], _R], item: _T) -> "Future[_R]":
    try:
        return executor.submit(work, item)
    except BrokenExecutor as error:
        raise _broken(error) from error


def _called(index: int, work: Callable[[_T], _R], item: _T) -> Done[_R]:
    try:
        return Done(index, work(item))
    except Exception as error:
        return Done(index, error=error)


def _of_future(index: int, future: "Future[_R]") -> Done[_R]:
    try:
        return Done(index, future.result())
    except (BrokenExecutor, CancelledError) as error:
        raise _broken(error) from error
    except Exception as error:
        return Done(index, error=error)


def _broken(error: BaseException) -> OptionError:
    return OptionError(
        f"the executor broke ({type(error).__name__}: {error}); WorkerProcesses goes on where a "
        "process dies, and so does a Dask cluster"
    )
