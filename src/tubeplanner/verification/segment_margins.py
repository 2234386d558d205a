"""How well a trajectory keeps what each segment of a tube asks, at any instant.

The judge chooses switching times by these margins: where a segment becomes the current one, all
that it asks must hold. They are in m, rad or relative, whatever each condition is measured in.
"""

from collections.abc import Callable
from typing import Protocol, TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.verification.enclosure import Enclosure


class SegmentMargin(Protocol):
    """One condition of a tube's segments on a trajectory."""

    def at(self, time: FloatArray) -> FloatArray:
        """Return the margins at times (N,) [s] in all segments, shape (N, m)."""
        ...

    def within(self, segment: IntArray, time: FloatArray) -> FloatArray:
        """Return the margins at times (N,) [s], each in one segment (N,): shape (N,)."""
        ...


class ToolMargin:
    """The tool in the regions about the segments [m]."""

    def __init__(self, problem: PlanningProblem, tool: Enclosure) -> None:
        self._tube, self._tool = problem.tube, tool

    def at(self, time: FloatArray) -> FloatArray:
        """Return how far inside all regions the tool is."""
        return self._tube.margin(self._tool.at(time))

    def within(self, segment: IntArray, time: FloatArray) -> FloatArray:
        """Return how far inside one region each the tool is."""
        return self._tube.regions.margin(self._tool.at(time), segment)


class JointRangeMargin:
    """The joints in their ranges [rad or m]."""

    def __init__(self, problem: PlanningProblem, trajectory: JointTrajectory) -> None:
        self._trajectory = trajectory
        ranges = np.hstack(problem.tube.ranges_of(problem.robot.joint_names))
        distinct, which = np.unique(ranges, axis=0, return_inverse=True)
        self._lower, self._upper = np.hsplit(distinct, 2)
        self._range_of = which.ravel()

    def at(self, time: FloatArray) -> FloatArray:
        """Return how far inside the ranges of all segments the worst joint is."""
        q = self._trajectory.position(time)
        margin = np.minimum(q[:, None] - self._lower, self._upper - q[:, None]).min(axis=2)
        return margin[:, self._range_of]

    def within(self, segment: IntArray, time: FloatArray) -> FloatArray:
        """Return how far inside those of one segment each the worst joint is."""
        q, given = self._trajectory.position(time), self._range_of[segment]
        margin: FloatArray = np.minimum(q - self._lower[given], self._upper[given] - q).min(axis=1)
        return margin


class RotationMargin:
    """The tool's orientation within the tolerances [rad]."""

    def __init__(self, problem: PlanningProblem, tool: Enclosure, rotation: Enclosure) -> None:
        self._tube, self._tool, self._rotation = problem.tube, tool, rotation

    def at(self, time: FloatArray) -> FloatArray:
        """Return how far inside the tolerances of all segments the tool is turned."""
        rotation = self._rotation.at(time).reshape(-1, 3, 3)
        return self._tube.rotation_margin(rotation, self._tool.at(time))

    def within(self, segment: IntArray, time: FloatArray) -> FloatArray:
        """Return how far inside that of one segment each the tool is turned."""
        rotation = self._rotation.at(time).reshape(-1, 3, 3)
        if self._tube.rotation is None:
            return np.full(len(time), np.inf)
        return self._tube.rotation.margin(rotation, self._tool.at(time), segment)


# What makes the margin of a further condition; None where the problem does not ask it.
MarginMaker: TypeAlias = Callable[[PlanningProblem, JointTrajectory], SegmentMargin | None]


def segment_margins(
    problem: PlanningProblem,
    trajectory: JointTrajectory,
    tool: Enclosure,
    rotation: Enclosure | None,
    further: tuple[MarginMaker, ...],
) -> tuple[SegmentMargin, ...]:
    """Return what a problem asks of a trajectory segment by segment.

    Args:
        problem: The planning problem.
        trajectory: The trajectory.
        tool: Its tool's position.
        rotation: Its tool's rotation matrix; None: the tube leaves it free.
        further: What makes the margins of further conditions.
    """
    found: list[SegmentMargin] = [ToolMargin(problem, tool)]
    found.append(JointRangeMargin(problem, trajectory))
    if rotation is not None:
        found.append(RotationMargin(problem, tool, rotation))
    made = (make(problem, trajectory) for make in further)
    return (*found, *(margin for margin in made if margin is not None))
