"""Progress callbacks, and how planning ends early: the time limit and Ctrl-C."""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias, TypeVar

from tubeplanner.errors import OptionError, shown

StoppedBy: TypeAlias = Literal["time_limit", "interrupt"]
_Answer = TypeVar("_Answer")


class TimeLimitReached(Exception):
    """Planning's time limit has passed; says nothing about whether there is an answer."""


@dataclass(frozen=True)
class Progress:
    """How far planning has come.

    Attributes:
        stage: The current stage.
        nodes: Nodes of the search so far; None outside the search.
        lower_bound: No trajectory of the search's family is faster [s]; None where not known.
        best_duration: Duration of the best trajectory so far [s]; None if there is none.
    """

    stage: str
    nodes: int | None = None
    lower_bound: float | None = None
    best_duration: float | None = None

    def __str__(self) -> str:
        parts = [self.stage]
        if self.nodes is not None:
            parts.append(f"{self.nodes} nodes")
        if self.lower_bound is not None:
            parts.append(f"at least {self.lower_bound:.3f} s")
        if self.best_duration is not None:
            parts.append(f"best {self.best_duration:.4f} s")
        return ", ".join(parts)


ProgressCallback: TypeAlias = Callable[[Progress], None]


class PlanningClock:
    """Wall time since planning began; announces progress and knows the time limit.

    Raises:
        OptionError: On construction, if the callback is none.
    """

    def __init__(self, time_limit: float | None, callback: ProgressCallback | None) -> None:
        require_callback(callback)
        self._begin = time.perf_counter()
        self._limit = math.inf if time_limit is None else time_limit
        self._callback = callback
        self._stage = ""
        self._parts: list[str] = []

    @property
    def elapsed(self) -> float:
        """Wall time since planning began [s]."""
        return time.perf_counter() - self._begin

    def announce(self, progress: Progress) -> None:
        """Tell how far planning has come; the callback may raise KeyboardInterrupt."""
        self._stage = progress.stage
        if self._callback is not None:
            stage = ", ".join([*self._parts, progress.stage])
            self._callback(replace(progress, stage=stage))

    @contextmanager
    def within(self, part: str) -> Iterator[None]:
        """Announce what happens inside as stages of a part of the whole, such as "route 1 of 3"."""
        self._parts.append(part)
        try:
            yield
        finally:
            self._parts.pop()

    def enter(self, stage: str) -> None:
        """Announce a stage that makes no sense after the time limit.

        Raises:
            TimeLimitReached: It has passed.
        """
        self.announce(Progress(stage))
        self.check()

    def check(self) -> None:
        """Raise if the time limit has passed.

        Raises:
            TimeLimitReached: It has.
        """
        if self.remaining <= 0:
            raise TimeLimitReached

    @property
    def past_limit(self) -> str:
        """What the time limit's passing cut short, in words."""
        return f"the time limit of {self._limit:g} s passed before the end of: {self._stage}"

    @property
    def remaining(self) -> float:
        """Wall time left before the limit [s]."""
        return self._limit - self.elapsed

    @property
    def used(self) -> float:
        """The share of the time limit that has passed; 0 where there is none."""
        return self.elapsed / self._limit


def until_stopped(work: Callable[[], _Answer]) -> tuple[_Answer | None, StoppedBy | None]:
    """Return what work returns, or None and what stopped it: the time limit or Ctrl-C."""
    try:
        return work(), None
    except TimeLimitReached:
        return None, "time_limit"
    except KeyboardInterrupt:
        return None, "interrupt"


def require_callback(progress: object) -> None:
    """Raise OptionError unless progress is reported to nobody, or to what can be called."""
    if progress is not None and not callable(progress):
        raise OptionError(
            f"progress is {shown(progress)}; give a function, which is called with every stage"
        )
