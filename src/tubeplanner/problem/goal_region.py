"""A goal that is a tool position, within a tolerance, instead of joints."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray, read_only
from tubeplanner.collision.obstacle import MAX_SIZE
from tubeplanner.errors import ProblemError, shown
from tubeplanner.options import are_numbers, in_figures, is_number
from tubeplanner.short_repr import short_repr
from tubeplanner.tube.rotational_tube import (
    RotationalTube,
    RotationBound,
    rotation_bound,
    rotational_tube,
)
from tubeplanner.tube.tube import Tube


@dataclass(frozen=True, eq=False)
class GoalRegion:
    """A ball in which the tool ends, in whichever configuration the answer ends in.

    Attributes:
        position: Its centre, shape (3,), base frame [m].
        tolerance: Its radius [m]; 0: the tool ends at the centre.
        rotation_tolerance: How far the tool may be turned there from the tube's last orientation:
            one angle, or bounds on the three components of log(R_ref^T R) [rad]; None: as far as
            the tube allows.

    Raises:
        ProblemError: On construction, if a value is none of these.
    """

    position: FloatArray
    tolerance: float = 0.0
    rotation_tolerance: RotationBound | None = None

    __repr__ = short_repr

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", _position(self.position))
        if not is_number(self.tolerance) or not 0 <= self.tolerance <= MAX_SIZE:
            raise ProblemError(
                f"goal.tolerance is {in_figures(self.tolerance)} m; 0 to {MAX_SIZE:g} m are "
                "accepted"
            )
        if self.rotation_tolerance is not None:
            bound = rotation_bound("goal.rotation_tolerance", self.rotation_tolerance)
            object.__setattr__(self, "rotation_tolerance", bound)

    @property
    def bounds_rotation(self) -> bool:
        """Whether the tool may not be turned at will."""
        tolerance = self.rotation_tolerance
        return tolerance is not None and bool(np.isfinite(tolerance).any())

    def rotation(self, tube: Tube) -> RotationalTube | None:
        """Return a tube's rotational part and, where the rotation is bounded here, one row more.

        That is a segment beyond the last one whose reference is the last orientation. None where
        all is free.
        """
        if not self.bounds_rotation:
            return tube.rotation
        assert tube.orientations is not None and tube.rotation_tolerance is not None
        assert self.rotation_tolerance is not None
        beyond = 2 * tube.points[-1] - tube.points[-2]
        return rotational_tube(
            np.vstack([tube.points, beyond]),
            np.vstack([tube.orientations, tube.orientations[-1:]]),
            (*tube.rotation_tolerance, self.rotation_tolerance),
        )

    def margin(self, tool: FloatArray) -> float:
        """Return how far inside the ball a tool (3,) is [m]."""
        return self.tolerance - self.distance(tool)

    def distance(self, tool: FloatArray) -> float:
        """Return how far a tool (3,) is from the position [m]."""
        return float(np.linalg.norm(tool - self.position))

    def nearest(self, tool: FloatArray, share: float = 1.0) -> FloatArray:
        """Return the point (3,) nearest to a tool (3,) in the ball scaled by a share."""
        distance, allowed = self.distance(tool), share * self.tolerance
        if distance <= allowed:
            return tool
        nearest: FloatArray = self.position + (tool - self.position) * (allowed / distance)
        return nearest


def _position(given: Any) -> FloatArray:
    """Return a position (3,) [m].

    Raises:
        ProblemError: It is no list of three finite numbers.
    """
    if not are_numbers(given, 3):
        raise ProblemError(f"goal.position is {shown(given)}; give [x, y, z], finite numbers [m]")
    return read_only(np.array(given, dtype=float))
