"""How planning ends: the status, and the place where something is wrong."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from tubeplanner.errors import ProblemError

if TYPE_CHECKING:
    # Not needed to say that there was an interrupt: NumPy may be what it has kept from loading.
    from tubeplanner.arrays import FloatArray

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
