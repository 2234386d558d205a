"""Limits on the speed of the tool centre point, segment by segment."""

from collections.abc import Mapping

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.constraints.path_samples import PathSamples
from tubeplanner.constraints.speed_limit import LimitKey
from tubeplanner.constraints.speed_of_points import speed_by_path
from tubeplanner.constraints.speed_polynomial import SpeedPolynomial
from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.problem.problem import PlanningProblem


class ToolSpeed:
    """A `SpeedLimit` on one quantity: the tool's speed as a share of its segment's limit.

    Attributes:
        limit: Of each segment, the robot's own included, shape (m,) [m/s]; inf where it is free.
    """

    kind = "tool_speed"
    order = 1
    signs = (1.0,)

    def __init__(self, problem: PlanningProblem) -> None:
        """Take the limits of a problem's robot and tube."""
        robot, tube = problem.robot, problem.tube
        free = np.full(tube.segment_count, robot.limits.tool_speed)
        self.limit = free if tube.tool_speed is None else np.minimum(free, tube.tool_speed)
        self._limited = np.flatnonzero(np.isfinite(self.limit))
        self.keys = tuple(LimitKey(self.kind, segment=k) for k in self._limited.tolist())

    def used(self, at: PathSamples) -> SpeedPolynomial:
        """Return the tool's speed as a share of its limit."""
        speed = np.linalg.norm(at.tool_rate[0], axis=1)
        return SpeedPolynomial({1: (speed / self.limit[at.segment])[:, None]})

    def by_path(self, at: PathSamples, speed: float) -> Mapping[int, FloatArray]:
        """Return how the share changes with the path; where the tool rests, not at all."""
        by = speed_by_path(at.tool_rate, speed / self.limit[at.segment])
        return {order: change[:, None] for order, change in enumerate(by)}

    def key_of(self, at: PathSamples) -> IntArray:
        """Return the key of each sample's segment; any, where that is free."""
        places = np.searchsorted(self._limited, at.segment)
        return np.minimum(places, len(self._limited) - 1)[:, None]

    def refusal(self, at: PathSamples) -> Infeasible:
        """Return that there is none: a path can be run as slowly as one likes."""
        return Infeasible(PlanStatus.NO_TRAJECTORY, f"{self.kind} allows no motion", Place())
