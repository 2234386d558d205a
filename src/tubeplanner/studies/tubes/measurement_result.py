"""MeasureOptions, TubeMeasurement: radii, ranges, binding pairs."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.checks import require_between, require_count
from tubeplanner.errors import OptionError
from tubeplanner.geometry.tube.segment_values import JointRange
from tubeplanner.outcome import Place, PlanStatus
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.text import short_repr


@dataclass(frozen=True)
class MeasureOptions:
    """How to measure.

    Attributes:
        max_radius: No segment gets a larger radius [m].
        samples: How many configurations of a segment the last counterexample search draws without
            finding a collision. Time is proportional.
        seed: Of the random numbers: the same seed gives the same tube.
        max_segments: A tube of more segments is refused: each of them takes one to two seconds.
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
        """Raise unless a tube has few enough segments to be measured.

        Raises:
            OptionError: It has more than `max_segments`.
        """
        if count > self.max_segments:
            raise OptionError(
                f"measure: {count} segments; at most {self.max_segments} are measured, at one to "
                "two seconds each: measure a part of the path, leave out points where it hardly "
                "turns, or allow more (max_segments, --max-segments)"
            )


@dataclass(frozen=True, eq=False)
class Binding:
    """What keeps a radius or one side of a joint range from being larger.

    Attributes:
        bound: "radius", or "lower" or "upper" side of the joint's range.
        place: Links and obstacle that come too close, the joint, and where the tool is then.
        configuration: In which they do, shape (n,) [rad or m].
    """

    bound: str
    place: Place
    configuration: FloatArray

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        place = self.place.as_dict()
        return {"bound": self.bound, **place, "configuration": self.configuration.tolist()}


@dataclass(frozen=True, eq=False)
class SegmentMeasurement:
    """The largest set found for one segment.

    Attributes:
        radius: Of the tube, the tool radius included [m].
        joint_ranges: By joint name [rad or m]; joints that need no range are left out.
        bindings: What limits the set, one entry per bound that something limits.
        samples: How many configurations the last counterexample search drew; it found no collision.
        searched: How many configurations all counterexample searches for this set drew.
        collisions: How many collisions all searches found; all are outside the set now.
        least_clearance: The least distance beyond what is required that the last counterexample
            search found [m]; None if nothing came near.
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
        place: Where, if there is no tube.
        segments: One per segment; empty unless successful.
        problem: The planning problem, with the measured tube; None unless successful.
        measuring_time: Wall time from the loaded problem [s].
    """

    status: PlanStatus
    message: str
    place: Place
    segments: tuple[SegmentMeasurement, ...] = ()
    problem: PlanningProblem | None = None
    measuring_time: float = 0.0

    __repr__ = short_repr

    @property
    def succeeded(self) -> bool:
        """Whether there is a measured tube."""
        return self.status is PlanStatus.SUCCESS

    def as_dict(self) -> dict[str, Any]:
        """Return the fields of the command line's JSON, but for loading_time."""
        return {
            "status": str(self.status),
            "message": self.message,
            "where": self.place.as_dict(),
            "measuring_time": self.measuring_time,
            "segments": [segment.as_dict() for segment in self.segments],
        }
