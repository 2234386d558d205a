"""MeasureOptions, TubeMeasurement: radii, ranges, binding pairs."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.checks import require_between, require_count
from tubeplanner.errors import FormerName, OptionError
from tubeplanner.geometry.tube.segment_values import JointRange
from tubeplanner.outcome import Location, PlanStatus
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.text import short_repr


@dataclass(frozen=True)
class MeasureOptions:
    """How to measure.

    Attributes:
        max_radius: Largest radius of a segment [m].
        samples: Number of configurations of a segment that the last counterexample search draws
            without finding a collision. Time is proportional.
        seed: Of the random numbers: the same seed gives the same tube.
        max_segments: Largest number of segments, since each takes one to two seconds.
    """

    max_radius: float = 0.2
    samples: int = 12_000
    seed: int = 0
    max_segments: int = 20

    def __post_init__(self) -> None:
        require_between(self, 0, np.inf, "max_radius", unit="m")
        require_count(self, 1, "samples")
        require_count(self, 0, "seed")
        require_count(self, 1, "max_segments")

    def require_few(self, count: int) -> None:
        """Check that a tube has few enough segments to be measured.

        Raises:
            OptionError: The tube has more than `max_segments`.
        """
        if count > self.max_segments:
            raise OptionError(
                f"measure: {count} segments; at most {self.max_segments} are measured, at one to "
                "two seconds each: measure a part of the path, leave out points where it hardly "
                "turns, or allow more (max_segments, --max-segments)"
            )


@dataclass(frozen=True, eq=False)
class Binding:
    """The collision that bounds a radius or a side of a joint range.

    Attributes:
        bound: "radius", or "lower" or "upper" side of the joint's range.
        location: Links and obstacle that come too close, the joint, and where the tool is then.
        configuration: The configuration of the collision, shape (n,) [rad or m].
    """

    bound: str
    location: Location
    configuration: FloatArray

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        location = self.location.as_dict()
        return {"bound": self.bound, **location, "configuration": self.configuration.tolist()}


@dataclass(frozen=True, eq=False)
class SegmentMeasurement:
    """The largest set found for a segment.

    Attributes:
        radius: Of the tube, the tool radius included [m].
        joint_ranges: By joint name [rad or m]; joints that need no range are left out.
        bindings: One entry per bound of the set that a collision limits.
        samples: Number of configurations tested by the last counterexample search, which found no
            collision.
        searched: Number of configurations tested by all counterexample searches for this set.
        collisions: Number of collisions found by all searches; all are outside the set now.
        least_clearance: Least distance beyond the required one in the last counterexample search
            [m]; None if no pair came near.
    """

    radius: float
    joint_ranges: Mapping[str, JointRange]
    bindings: tuple[Binding, ...]
    samples: int
    searched: int
    collisions: int
    least_clearance: float | None

    __repr__ = short_repr

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as JSON values; sides of ranges without an end are null."""
        ranges = {
            name: [bound if np.isfinite(bound) else None for bound in pair]
            for name, pair in self.joint_ranges.items()
        }
        return {
            "radius": self.radius,
            "joint_ranges": ranges,
            "bindings": [binding.as_dict() for binding in self.bindings],
            "samples": self.samples,
            "attacked": self.searched,
            "collisions": self.collisions,
            "least_room": self.least_clearance,
        }


@dataclass(frozen=True, eq=False)
class TubeMeasurement:
    """The result of measuring a tube.

    Attributes:
        status: Success, or why there is no tube.
        message: One sentence.
        location: Where, if there is no tube.
        segments: One per segment; empty unless successful.
        problem: The planning problem, with the measured tube; None unless successful.
        measuring_time: Wall time from the loaded problem [s].
    """

    status: PlanStatus
    message: str
    location: Location
    segments: tuple[SegmentMeasurement, ...] = ()
    problem: PlanningProblem | None = None
    measuring_time: float = 0.0

    __repr__ = short_repr

    place = FormerName("location")

    @property
    def succeeded(self) -> bool:
        """True if there is a measured tube."""
        return self.status is PlanStatus.SUCCESS

    def as_dict(self) -> dict[str, Any]:
        """Return the fields of the command line's JSON, but for loading_time."""
        return {
            "status": str(self.status),
            "message": self.message,
            "where": self.location.as_dict(),
            "measuring_time": self.measuring_time,
            "segments": [segment.as_dict() for segment in self.segments],
        }
