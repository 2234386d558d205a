"""The end of planning: status, location, infeasibility; progress, time limit, Ctrl-C. No NumPy."""

import math
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypeVar

from tubeplanner.errors import OptionError, ProblemError, shown

if TYPE_CHECKING:
    from tubeplanner.arrays import FloatArray

# ---- How planning ends: the status, and the place where something is wrong.

# How far below zero the margins of a certificate may lie, and a given start or goal outside its
# bounds [m, rad or relative].
MARGIN_TOLERANCE = 1e-6


class PlanStatus(StrEnum):
    """How `plan` ended; the values are those of the command line's JSON."""

    SUCCESS = "success"
    GRAVITY_EXCEEDS_EFFORT = "gravity_exceeds_effort"
    UNREACHABLE = "unreachable"
    TUBE_BLOCKED = "tube_blocked"
    NO_TRAJECTORY = "no_trajectory"
    CERTIFICATE_FAILED = "certificate_failed"
    TIME_LIMIT = "time_limit"
    INTERRUPTED = "interrupted"
    BAD_INPUT = "bad_input"
    CRASHED = "crashed"  # of one of many plans


@dataclass(frozen=True)
class Place:
    """Where something holds or fails; fields that do not apply are None.

    Attributes:
        time: [s].
        joint: Joint name.
        segment: Index of the tube's segment, from 0.
        links: Names of the links.
        obstacle: Name of the obstacle.
        position: Of the tool, base frame [m].
        point: Index of the tube's reference point, from 0.
        point_speed: Index of the limit on a point's speed, from 0; `links` names the point's link.
        move: Name of the move of a cycle; the segment is its own.
    """

    time: float | None = None
    joint: str | None = None
    segment: int | None = None
    links: tuple[str, ...] | None = None
    obstacle: str | None = None
    position: tuple[float, float, float] | None = None
    point: int | None = None
    point_speed: int | None = None
    move: str | None = None

    def at(self, tool: Iterable[float]) -> "Place":
        """Return the place with the tool at a point (3,) [m], base frame."""
        x, y, z = (float(value) for value in tool)
        return replace(self, position=(x, y, z))

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return asdict(self)

    def __str__(self) -> str:
        parts = []
        if self.links:
            parts.append(" and ".join(self.links))
        if self.obstacle is not None:
            parts.append(f"to '{self.obstacle}'")
        if self.joint is not None:
            parts.append(self.joint)
        if self.move is not None:
            parts.append(f"move '{self.move}'")
        if self.segment is not None:
            parts.append(f"segment {self.segment}")
        if self.point is not None:
            parts.append(f"point {self.point}")
        if self.point_speed is not None:
            parts.append(f"point_speed {self.point_speed}")
        if self.time is not None:
            parts.append(f"t = {self.time:.4f} s")
        if self.position is not None:
            parts.append("tool at [" + ", ".join(f"{x:.3f}" for x in self.position) + "] m")
        return ", ".join(parts)


class ContradictionError(ProblemError):
    """A problem that cannot be posed, for a reason at a place.

    Attributes:
        place: Where.
        proved: Whether it is proved that there is no motion; None: it is bad input alone.
        configuration: Of the arm at the place, shape (n,) [rad or m]; None: there is none.
    """

    def __init__(
        self,
        message: str,
        place: Place = Place(),
        *,
        proved: bool | None = None,
        configuration: "FloatArray | None" = None,
    ) -> None:
        super().__init__(f"{message}; proved: there is no motion" if proved else message)
        self.place = place
        self.proved = proved
        self.configuration = configuration


_ATTRIBUTES = ("place", "proved", "starts", "configuration")


class Infeasible(Exception):
    """There is no answer, for a reason and at a place; `plan` turns it into its result.

    Attributes:
        status: Which kind of reason.
        place: Where.
        proved: Whether there is none for certain; else none was found.
        starts: From how many configurations or branches it was looked for, if that is not proved.
        configuration: Of the arm at the place, shape (n,) [rad or m]; None: not known.
    """

    def __init__(
        self,
        status: PlanStatus,
        message: str,
        place: Place,
        *,
        proved: bool = False,
        starts: int = 0,
        configuration: "FloatArray | None" = None,
    ) -> None:
        super().__init__(message)
        self.status = status
        self.place = place
        self.proved = proved
        self.starts = starts
        self.configuration = configuration

    def replaced(self, **changes: Any) -> "Infeasible":
        """Return the same reason with other attributes."""
        values: dict[str, Any] = {name: getattr(self, name) for name in _ATTRIBUTES} | changes
        return Infeasible(self.status, str(self), **values)


# ---- Progress callbacks, and how planning ends early: the time limit and Ctrl-C.

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
