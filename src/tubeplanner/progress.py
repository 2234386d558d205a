"""Progress callbacks and the planning time limit."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from tubeplanner.outcome import Infeasible, Place, PlanStatus

StoppedBy: TypeAlias = Literal["time_limit", "interrupt"]


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

    Attributes:
        stopped_by: What ended planning early; None if nothing did.
    """

    def __init__(self, time_limit: float | None, callback: ProgressCallback | None) -> None:
        self.stopped_by: StoppedBy | None = None
        self._begin = time.perf_counter()
        self._limit = np.inf if time_limit is None else time_limit
        self._callback = callback
        self._stage = ""

    @property
    def elapsed(self) -> float:
        """Wall time since planning began [s]."""
        return time.perf_counter() - self._begin

    def announce(self, progress: Progress) -> None:
        """Call the progress callback."""
        self._stage = progress.stage
        # A callback may raise an interrupt that was not noticed yet; one is enough.
        if self._callback is not None and self.stopped_by is None:
            self._callback(progress)

    def enter(self, stage: str) -> None:
        """Announce a stage that makes no sense after the time limit.

        Raises:
            Infeasible: Status time_limit.
        """
        self.announce(Progress(stage))
        self.check()

    def check(self) -> None:
        """Raise if the time limit has passed.

        Raises:
            Infeasible: Status time_limit.
        """
        if self.remaining <= 0:
            message = f"the time limit of {self._limit:g} s passed before the end of: {self._stage}"
            raise Infeasible(PlanStatus.TIME_LIMIT, message, Place())

    @property
    def remaining(self) -> float:
        """Wall time left before the limit [s]."""
        return self._limit - self.elapsed
