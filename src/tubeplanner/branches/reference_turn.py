"""The wanted orientation of the tool along one tube segment.

At inner reference points the tool has the reference orientation; a given start or goal may deviate
from it within the tolerance. In between, the rotation vector goes from one to the other in
proportion to the arc length. Components that the segment leaves free follow from the joints, unless
the next segment bounds them: they then enter their bounds by the switching time.
"""

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray
from tubeplanner.branches.inverse_kinematics import PositionSolution, WantedRotation
from tubeplanner.outcome import MARGIN_TOLERANCE
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.tube.rotational_tube import RotationalTube

# Where the arm cannot reach the wanted orientation, it must keep this share of the distance to the
# bound, so that the planner has some freedom to start with.
_KEPT_MARGIN_SHARE = 0.1
_THERE = 1e-9  # [m or rad]: errors of a solution at the wanted position and rotation


class ReferenceTurn:
    """The wanted rotation at every share of a segment, and whether the tool deviates too far."""

    def __init__(
        self,
        problem: PlanningProblem,
        tube: RotationalTube,
        segment: int,
        begin: FloatArray,
        goal: FloatArray | None,
    ) -> None:
        """Prepare for a segment.

        Args:
            problem: The planning problem.
            tube: Its rotational part, with that of the goal.
            segment: Index of the tube's segment.
            begin: Configuration at its start, shape (n,).
            goal: Configuration at its end, if that is given.
        """
        self._robot, self._tube, self._segment = problem.robot, tube, segment
        self._following = min(segment + 1, len(tube.bounds) - 1)
        self._components = bounded_components(tube, segment)
        self._components = self._components | bounded_components(tube, self._following)
        self._begin = self._vector(begin)
        self._end = self._open_end(problem) if goal is None else self._vector(goal)
        ends = np.array([self._begin, self._end])
        self._keeps_bounds = bool(self._tube.margin_of(ends, segment).min() >= 0)

    def wanted(self, share: float, point: FloatArray) -> WantedRotation:
        """Return the tool's wanted orientation at a point (3,), after a share of the segment."""
        reference = self._tube.reference(point[None], self._segment)[0]
        return WantedRotation(reference, self._vector_after(share), self._components)

    def off_segment(self, solution: PositionSolution, share: float) -> int | None:
        """Return the segment whose rotation tolerance a solution violates, if any."""
        is_there = max(solution.error, solution.rotation_error) < _THERE
        if is_there and share < 1.0 and self._keeps_bounds:
            return None  # it is turned as wanted, between two rotations that keep the bounds
        rotation, tool = self._robot.tool_pose(solution.q[None])
        for segment in {self._segment, self._following if share == 1.0 else self._segment}:
            left = float(self._tube.margin_of(self._vector_after(share)[None], segment)[0])
            margin = float(self._tube.margin(rotation, tool, segment)[0])
            if margin < _KEPT_MARGIN_SHARE * left - MARGIN_TOLERANCE:
                return segment
        return None

    def _vector_after(self, share: float) -> FloatArray:
        return (1 - share) * self._begin + share * self._end

    def _open_end(self, problem: PlanningProblem) -> FloatArray:
        """Return the rotation vector (3,) wanted at the end if no configuration is given there."""
        goal = problem.open_goal
        if goal is None or self._following < problem.tube.segment_count:
            return np.zeros(3)
        there = goal.position[None]
        reference = self._tube.reference(there, self._following)
        return self._tube.error(reference, there, self._segment)[0] * self._components

    def _vector(self, q: FloatArray) -> FloatArray:
        """Return the rotation vector (3,) of a configuration (n,), free components set to zero."""
        rotation, tool = self._robot.tool_pose(q[None])
        return self._tube.error(rotation, tool, self._segment)[0] * self._components


def bounded_components(tube: RotationalTube, segment: int) -> BoolArray:
    """Return which components of the rotation vector a segment bounds: bool, shape (3,)."""
    return np.isfinite(tube.bounds[segment, :3]) | np.isfinite(tube.bounds[segment, 3])


def wanted_at(
    problem: PlanningProblem, point: FloatArray, segment: int, near: FloatArray | None = None
) -> WantedRotation | None:
    """Return the tool's wanted orientation at a point (3,): the reference, or that of `near`.

    Args:
        problem: The planning problem.
        point: Where the tool is, base frame [m].
        segment: In which segment; after the last one, at the goal.
        near: A configuration (n,) whose rotation vector is wanted; None: zero.
    """
    tube = problem.rotation
    if tube is None:
        return None
    vector = np.zeros(3)
    if near is not None:
        rotation, tool = problem.robot.tool_pose(near[None])
        vector = tube.error(rotation, tool, segment)[0]
    reference = tube.reference(point[None], segment)[0]
    return WantedRotation(reference, vector, bounded_components(tube, segment))
