"""Problems with a little of every limit kept back, whose motions keep the limits themselves."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.problem.goal_region import GoalRegion
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.problem.required_distances import RequiredDistances, in_contact
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.short_repr import short_repr
from tubeplanner.tube.narrowed_tube import narrowed_tube
from tubeplanner.tube.tube import Tube

# At most this share of a radius, of a rotation tolerance or of a joint's range is kept back.
_MOST = 0.9
_ROUNDING = 1e-6  # [m or rad]: by which start and goal stay inside what is left
PARTS = ("effort", "velocity", "radius", "rotation", "clearance", "position")


@dataclass(frozen=True, eq=False)
class Tightening:
    """What is kept back of the limits of a problem with m segments and n joints.

    Attributes:
        effort: Share of the effort limits and of torque-speed lines that is left.
        velocity: Share of the velocity limits that is left.
        radius: Taken off every segment's region, at every side, shape (m,) [m].
        rotation: Taken off the rotation tolerances, shape (m,) [rad].
        clearance: Added to the clearance [m].
        position: Taken off the lower and the upper position limits, shape (2, n) [rad or m].
    """

    effort: float
    velocity: float
    radius: FloatArray
    rotation: FloatArray
    clearance: float
    position: FloatArray

    __repr__ = short_repr

    @classmethod
    def nothing(cls, problem: PlanningProblem) -> "Tightening":
        """Return the one that leaves a problem as it is."""
        segments, joints = problem.tube.segment_count, problem.robot.joint_count
        free = np.zeros(segments)
        return cls(1.0, 1.0, free, free, 0.0, np.zeros((2, joints)))

    def only(self, parts: Sequence[str]) -> "Tightening":
        """Return some of its parts, nothing of the others."""
        none: dict[str, Any] = {
            name: 1.0 if name in PARTS[:2] else 0.0 * getattr(self, name) for name in PARTS
        }
        return replace(self, **{name: none[name] for name in PARTS if name not in parts})

    def has(self, part: str) -> bool:
        """Return whether anything is kept back of one of `PARTS`."""
        value = getattr(self, part)
        return bool(value != 1.0) if part in PARTS[:2] else bool(np.any(value))

    def of_parts(self, tube: Tube) -> "Tightening":
        """Return it for the segments that were joined to those of a tube."""
        if tube.parts is None:
            return self
        joined = np.searchsorted(tube.numbers, tube.parts.numbers[:-1], side="right") - 1
        return replace(self, radius=self.radius[joined], rotation=self.rotation[joined])

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return {name: np.asarray(getattr(self, name)).tolist() for name in PARTS}


def allowed_tightening(problem: PlanningProblem, asked: Tightening, ends: FloatArray) -> Tightening:
    """Return as much of a tightening as limits, start and goal leave room for.

    Args:
        problem: The planning problem.
        asked: What would be kept back.
        ends: Configurations in which the motion begins and, if that is given, ends: (1 or 2, n).
    """
    tube, limits = problem.tube, problem.robot.limits
    turned, tool = problem.robot.tool_pose(ends)
    angle = np.zeros(tube.segment_count)
    if tube.rotation is not None:
        tightest = tube.rotation.bounds.min(axis=1)
        angle = np.where(np.isfinite(tightest), tightest, 0.0)
    radius = np.minimum(asked.radius, _MOST * tube.effective_radius)
    rotation = np.minimum(asked.rotation, _MOST * angle)
    inside, straight = tube.margin(tool), tube.rotation_margin(turned, tool)
    for end, segment in enumerate((0, -1)[: len(ends)]):
        radius[segment] = min(radius[segment], inside[end, segment] - _ROUNDING)
        rotation[segment] = min(rotation[segment], straight[end, segment] - _ROUNDING)
    if isinstance(problem.goal, GoalRegion):  # its position is to stay inside too
        inside = tube.margin(problem.goal.position[None])
        radius[-1] = min(radius[-1], inside[0, -1] - _ROUNDING)
    room = np.array([ends - limits.lower_position, limits.upper_position - ends]).min(axis=1)
    spare = _spare_distance(problem, ends) - _ROUNDING
    return replace(
        asked,
        radius=radius.clip(min=0),
        rotation=rotation.clip(min=0),
        position=np.minimum(asked.position, room - _ROUNDING).clip(min=0),
        clearance=max(min(asked.clearance, spare), 0.0),
    )


def tightened_problem(problem: PlanningProblem, kept_back: Tightening) -> PlanningProblem:
    """Return a problem that asks more; geometry is shared.

    Args:
        problem: The planning problem.
        kept_back: As `allowed_tightening` has it.

    Raises:
        ProblemError: Start or goal break a limit that is left.
    """
    farther = problem.farther_apart(kept_back.clearance)
    return replace(
        farther,
        robot=_limited(problem.robot, kept_back),
        tube=narrowed_tube(farther.tube, kept_back.radius, kept_back.rotation),
    )


def _limited(robot: RobotModel, kept_back: Tightening) -> RobotModel:
    limits, motors, share = robot.limits, robot.motors, kept_back.effort
    limits = replace(
        limits,
        effort=share * limits.effort,
        effort_ranges=tuple(each.scaled(share) for each in limits.effort_ranges),
        velocity=kept_back.velocity * limits.velocity,
        lower_position=limits.lower_position + kept_back.position[0],
        upper_position=limits.upper_position - kept_back.position[1],
    )
    return robot.with_limits(
        limits, replace(motors, saturation_effort=share * motors.saturation_effort)
    )


def _spare_distance(problem: PlanningProblem, ends: FloatArray) -> float:
    """Return by how much links are farther from obstacles at start and goal than they must be [m].

    Pairs in contact there do not count: they may stay as near.
    """
    checker, poses = problem.collision, problem.robot.body_poses(ends)
    count = len(checker.obstacle_pairs)
    counts = ~in_contact(problem)[:count]
    segments = np.array([0, problem.tube.segment_count - 1])[: len(ends)]
    asked = RequiredDistances(problem, ends[0], ends[-1]).at(
        segments, problem.robot.tool_position(ends)
    )
    distances = [
        checker.distances(*pose, checker.obstacle_pairs) for pose in zip(*poses, strict=True)
    ]
    return float((np.array(distances) - asked[:, :count])[:, counts].min(initial=np.inf))
