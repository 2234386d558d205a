"""The speed of the tool, segment by segment."""

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.verification.enclosure import Quantity, enclosed
from tubeplanner.verification.judged_condition import (
    RELATIVE,
    JudgedCondition,
    bracketed,
    not_required,
)
from tubeplanner.verification.judged_motion import JudgedMotion
from tubeplanner.verification.majorants import derivative, tool_majorant
from tubeplanner.verification.tube_visits import least_concave_margin

# How closely the velocity is enclosed, as a share of the least limit: tighter than the
# certificate's tolerance, so that the planner may use most of it.
_ENCLOSURE = 1e-8


def judge_tool_speed(motion: JudgedMotion) -> JudgedCondition:
    """Judge the speed of the tool centre point, by polynomials that enclose its velocity."""
    limit = _limits(motion.problem)
    if not np.isfinite(limit).any():
        return not_required(RELATIVE, "the tool's speed is free")
    velocity = enclosed(
        motion.trajectory, _velocity(motion.robot), np.full(3, _ENCLOSURE * limit.min())
    )

    def margin(vector: FloatArray, segment: IntArray) -> FloatArray:
        return 1 - np.linalg.norm(vector, axis=2) / limit[segment]

    least = least_concave_margin(velocity, motion.visits, margin, 1 / limit)
    place = motion.place_in_segment(least.segment, least.time)
    return bracketed(least.lower_bound, least.attained, RELATIVE, place)


class ToolSpeedMargin:
    """A `SegmentMargin`: how much of each segment's limit the tool's speed leaves, relative."""

    def __init__(
        self, problem: PlanningProblem, trajectory: JointTrajectory, limit: FloatArray
    ) -> None:
        self._values = _velocity(problem.robot).values
        self._trajectory, self._limit = trajectory, limit

    def at(self, time: FloatArray) -> FloatArray:
        """Return what is left in all segments."""
        return 1 - self._speed(time)[:, None] / self._limit

    def within(self, segment: IntArray, time: FloatArray) -> FloatArray:
        """Return what is left in one segment each."""
        left: FloatArray = 1 - self._speed(time) / self._limit[segment]
        return left

    def _speed(self, time: FloatArray) -> FloatArray:
        trajectory = self._trajectory
        velocity = self._values(trajectory.position(time), trajectory.velocity(time))
        speed: FloatArray = np.linalg.norm(velocity, axis=1)
        return speed


def tool_speed_margin(
    problem: PlanningProblem, trajectory: JointTrajectory
) -> ToolSpeedMargin | None:
    """Return the margin of the tool's speed; None where no segment limits it."""
    limit = _limits(problem)
    return ToolSpeedMargin(problem, trajectory, limit) if np.isfinite(limit).any() else None


def _limits(problem: PlanningProblem) -> FloatArray:
    """Return the limit in each segment, the robot's own included, shape (m,) [m/s]."""
    own = np.full(problem.tube.segment_count, problem.robot.limits.tool_speed)
    asked = problem.tube.tool_speed
    return own if asked is None else np.minimum(own, asked)


def _velocity(robot: RobotModel) -> Quantity:
    """Return the velocity of the tool centre point, c = 3 [m/s]."""

    def values(q: FloatArray, v: FloatArray) -> FloatArray:
        return np.einsum("nij,nj->ni", robot.tool_jacobian(q)[1][:, :3], v)

    def majorant(joints: FloatArray, width: FloatArray) -> FloatArray:
        rate = derivative(tool_majorant(robot, joints).position) / width
        return np.stack([rate] * 3, axis=2)

    return Quantity(1, values, majorant)
