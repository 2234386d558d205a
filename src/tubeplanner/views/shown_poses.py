"""Where an arm is seen: along a trajectory, or at rest; and from where it is seen best."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray
from tubeplanner.branches.reference_branch import end_configuration
from tubeplanner.collision.convex_shape import ConvexShape, convex_hull
from tubeplanner.collision.obstacle import Obstacle
from tubeplanner.outcome import Infeasible
from tubeplanner.problem.problem import PlanningProblem, Seed
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.views.scene import ShownTrajectory
from tubeplanner.views.viewpoint import best_direction

# Of the way through a trajectory: when the arm should not hide the path.
_SAMPLED_SHARES = (0.1, 0.5, 0.9)


class MovingBody(Protocol):
    """A body beside those of the arm: its poses (T, 4, 4), and whether it is there, (T,)."""

    @property
    def poses(self) -> FloatArray:
        """Of its frame, base frame, shape (T, 4, 4)."""

    @property
    def present(self) -> BoolArray:
        """When it is there, shape (T,)."""


def poses_along(
    robot: RobotModel, name: str, trajectory: JointTrajectory, time: FloatArray
) -> ShownTrajectory:
    """Return where an arm is at times (T,) of a trajectory of its joints, in their order."""
    return _posed(robot, name, time, trajectory.position(time), trajectory.velocity(time))


def poses_at_rest(problem: PlanningProblem, notes: list[str]) -> ShownTrajectory:
    """Return the arm at its start; near it, with a note, if seed or pose do not lead there."""
    try:
        q = end_configuration(problem, problem.start, 0)
    except Infeasible as error:
        limits, given = problem.robot.limits, problem.start
        seed = given.joints if isinstance(given, Seed) else getattr(given, "seed", None)
        where = "near zero" if seed is None else "at the seed"
        notes.append(f"the arm is drawn {where}: {error}")
        q = limits.clip(np.zeros(problem.robot.joint_count)) if seed is None else seed
    return poses_standing(problem.robot, "at its start", q)


def poses_standing(robot: RobotModel, where: str, q: FloatArray) -> ShownTrajectory:
    """Return an arm that stands still in a configuration (n,); `where` that is, in words."""
    return _posed(robot, where, np.zeros(1), q[None], np.zeros((1, len(q))))


def direction_of(
    trajectory: ShownTrajectory,
    points: Sequence[FloatArray],
    obstacles: Sequence[Obstacle],
    hulls: list[tuple[int, FloatArray]],
) -> FloatArray:
    """Return from where path and tube are seen best, as `best_direction` does.

    Args:
        trajectory: Where the arm is.
        points: Of the middle lines of tubes, each (N, 3) [m].
        obstacles: What stands still.
        hulls: Bodies, and points (V, 3) of what they carry.
    """
    solids = [shape for obstacle in obstacles for shape in obstacle.shapes]
    arms = [_moving_shapes(trajectory, share, hulls) for share in _SAMPLED_SHARES]
    return best_direction(np.vstack([trajectory.tool, *points]), solids, arms)


def with_bodies(shown: ShownTrajectory, bodies: Sequence[MovingBody]) -> ShownTrajectory:
    """Return where bodies are, others after those that there were."""
    count = shown.rotation.shape[1]
    rotation = [shown.rotation, *(body.poses[:, None, :3, :3] for body in bodies)]
    position = [shown.position, *(body.poses[:, None, :3, 3] for body in bodies)]
    present = {count + k: body.present for k, body in enumerate(bodies)}
    return replace(
        shown,
        rotation=np.concatenate(rotation, axis=1),
        position=np.concatenate(position, axis=1),
        present={**shown.present, **present},
    )


def _posed(
    robot: RobotModel, name: str, time: FloatArray, q: FloatArray, velocity: FloatArray
) -> ShownTrajectory:
    rotation, position = robot.body_poses(q)
    tool, jacobian = robot.tool_jacobian(q)
    speed = np.linalg.norm(np.einsum("tij,tj->ti", jacobian[:, :3], velocity), axis=1)
    return ShownTrajectory(name, time, rotation, position, tool, speed)


def _moving_shapes(
    trajectory: ShownTrajectory, share: float, hulls: list[tuple[int, FloatArray]]
) -> list[ConvexShape]:
    """Return hulls of the moving links after a share of a trajectory, in the base frame."""
    step = round(share * (len(trajectory.time) - 1))
    return [
        convex_hull(points).transformed(trajectory.placement(step, body))
        for body, points in hulls
        if body > 0
    ]
