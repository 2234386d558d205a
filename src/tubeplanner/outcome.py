"""The end of planning: status, location, infeasibility; progress, time limit, Ctrl-C. No NumPy."""

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypeVar

from tubeplanner.errors import FormerName, OptionError, ProblemError, shown

if TYPE_CHECKING:
    from tubeplanner.arrays import FloatArray

# ---- The status, and the location of a failure.

# Margins of a certificate may lie below zero by this much, and a given start or goal outside its
# bounds [m, rad or relative].
MARGIN_TOLERANCE = 1e-6


class PlanStatus(StrEnum):
    """End of `plan`; the command line's JSON has the same values."""

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
class Location:
    """Location of a condition or a failure; fields that do not apply are None.

    Attributes:
        time: Since the start of the trajectory [s].
        joint: Name of the joint.
        segment: Index of the tube's segment, from 0.
        links: Names of the links.
        obstacle: Name of the obstacle.
        position: Of the tool centre point, base frame [m].
        point: Index of the tube's reference point, from 0.
        point_speed: Index of the limit on a point's speed, from 0; `links` names the point's link.
        move: Name of the move of a cycle; the segment is its own.
        contact: What a contact does that holds a part: "tray slides", "cup tips, at rest".
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
    contact: str | None = None

    def at(self, tool: Iterable[float]) -> "Location":
        """Return the location with the tool centre point at a position (3,) [m], base frame."""
        x, y, z = (float(value) for value in tool)
        return replace(self, position=(x, y, z))

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return asdict(self)

    @classmethod
    def of_dict(cls, fields: Mapping[str, Any]) -> "Location":
        """Return the location of values from `as_dict`, as `json.loads` returns them."""
        values: dict[str, Any] = {
            key: tuple(value) if isinstance(value, list) else value for key, value in fields.items()
        }
        return cls(**values)

    def __str__(self) -> str:
        parts = []
        if self.links:
            parts.append(" and ".join(self.links))
        for text, value in (
            ("to '{}'", self.obstacle),
            ("{}", self.contact),
            ("{}", self.joint),
            ("move '{}'", self.move),
            ("segment {}", self.segment),
            ("point {}", self.point),
            ("point_speed {}", self.point_speed),
            ("t = {:.4f} s", self.time),
        ):
            if value is not None:
                parts.append(text.format(value))
        if self.position is not None:
            parts.append("tool at [" + ", ".join(f"{x:.3f}" for x in self.position) + "] m")
        return ", ".join(parts)


class ContradictionError(ProblemError):
    """Contradiction in a problem, with its location.

    Attributes:
        location: Location of the contradiction.
        proved: True if it is proved that there is no motion; None: bad input alone.
        configuration: Of the arm at the location, shape (n,) [rad or m]; None: there is none.
    """

    place = FormerName("location")

    def __init__(
        self,
        message: str,
        location: Location = Location(),
        *,
        proved: bool | None = None,
        configuration: "FloatArray | None" = None,
    ) -> None:
        super().__init__(f"{message}; proved: there is no motion" if proved else message)
        self.location = location
        self.proved = proved
        self.configuration = configuration


_ATTRIBUTES = ("location", "proved", "starts", "configuration")


class Infeasible(Exception):
    """A planning problem without a result, with reason and location; `plan` returns it as a result.

    Attributes:
        status: Kind of the reason.
        location: Location of the failure.
        proved: True if it is proved that there is no trajectory; else none was found.
        starts: Number of configurations or branches the search began from, if nothing is proved.
        configuration: Of the arm at the location, shape (n,) [rad or m]; None: not known.
    """

    def __init__(
        self,
        status: PlanStatus,
        message: str,
        location: Location,
        *,
        proved: bool = False,
        starts: int = 0,
        configuration: "FloatArray | None" = None,
    ) -> None:
        super().__init__(message)
        self.status = status
        self.location = location
        self.proved = proved
        self.starts = starts
        self.configuration = configuration

    def replaced(self, **changes: Any) -> "Infeasible":
        """Return a copy with changed attributes; status and message stay."""
        values: dict[str, Any] = {name: getattr(self, name) for name in _ATTRIBUTES} | changes
        return Infeasible(self.status, str(self), **values)


# ---- Progress, and the early end of planning: time limit and Ctrl-C.

StoppedBy: TypeAlias = Literal["time_limit", "interrupt"]
_Answer = TypeVar("_Answer")


class TimeLimitReached(Exception):
    """The time limit of planning has passed; a result may exist all the same."""


@dataclass(frozen=True)
class Progress:
    """Progress of planning.

    Attributes:
        stage: Name of the current stage.
        nodes: Nodes of the search so far; None outside the search.
        lower_bound: Of the durations of the search's family [s]; None where not known.
        best_duration: Of the best trajectory so far [s]; None if there is none.
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
    """Wall time since planning began, its limit, and the callback for progress."""

    def __init__(self, time_limit: float | None, callback: ProgressCallback | None) -> None:
        """Start the clock.

        The time limit is wall time [s], None for none; the callback is called with every
        `Progress`.

        Raises:
            OptionError: The callback cannot be called.
        """
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
        """Call the callback with the progress; KeyboardInterrupt passes through."""
        self._stage = progress.stage
        if self._callback is not None:
            stage = ", ".join([*self._parts, progress.stage])
            self._callback(replace(progress, stage=stage))

    @contextmanager
    def within(self, part: str) -> Iterator[None]:
        """Announce the stages inside with the name of a part in front: "route 1 of 3, ..."."""
        self._parts.append(part)
        try:
            yield
        finally:
            self._parts.pop()

    def enter(self, stage: str) -> None:
        """Announce a stage, then check the time limit.

        Raises:
            TimeLimitReached: The time limit has passed.
        """
        self.announce(Progress(stage))
        self.check()

    def check(self) -> None:
        """Raise TimeLimitReached if the time limit has passed."""
        if self.remaining <= 0:
            raise TimeLimitReached

    @property
    def past_limit(self) -> str:
        """Message that the time limit passed, with the stage of that time."""
        return f"the time limit of {self._limit:g} s passed before the end of: {self._stage}"

    @property
    def remaining(self) -> float:
        """Wall time until the limit [s]; negative after the limit."""
        return self._limit - self.elapsed

    @property
    def used(self) -> float:
        """Fraction of the time limit that has passed; 0 without a limit."""
        return self.elapsed / self._limit


def until_stopped(work: Callable[[], _Answer]) -> tuple[_Answer | None, StoppedBy | None]:
    """Return the result of work and None, or None and the reason of its end: limit or Ctrl-C."""
    try:
        return work(), None
    except TimeLimitReached:
        return None, "time_limit"
    except KeyboardInterrupt:
        return None, "interrupt"


def require_callback(progress: object) -> None:
    """Raise OptionError unless a progress callback is None or can be called."""
    if progress is not None and not callable(progress):
        raise OptionError(
            f"progress is {shown(progress)}; give a function, which is called with every stage"
        )
