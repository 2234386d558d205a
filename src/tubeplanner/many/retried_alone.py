"""An executor that finds out which of the calls that were on a lost worker it died of."""

import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any, TypeVar

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
