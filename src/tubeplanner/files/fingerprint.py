"""Hashes of robots and problems: are two files about the same thing?

They are taken from what a robot does, not from how its files are written: numbers are rounded to
nine digits, so that another machine or library version gives the same hash.
"""

import hashlib
from collections.abc import Iterable
from typing import Any

import numpy as np

from tubeplanner import __version__
from tubeplanner.collision.convex_shape import ConvexShape
from tubeplanner.problem.problem import PlanningProblem, Seed
from tubeplanner.robot.robot_model import RobotModel

_CONFIGURATIONS, _SEED = 4, 0


def robot_hash(robot: RobotModel) -> str:
    """Return a hash of a robot's kinematics, dynamics and limits."""
    return _hash(_robot_parts(robot))


def problem_hash(problem: PlanningProblem) -> str:
    """Return a hash of all that a certificate depends on, the robot included."""
    tube, checker = problem.tube, problem.collision
    parts: list[object] = [*_robot_parts(problem.robot), tube.points, tube.radius, tube.visit]
    parts += [tube.tool_radius, *tube.ranges_of(problem.robot.joint_names)]
    if tube.rotation is not None:
        parts += [tube.rotation.begin, tube.rotation.turn, tube.rotation.bounds]
    for given in (problem.start, problem.goal):
        parts.append(type(given).__name__)
        parts.append(given.joints if isinstance(given, Seed) else given)
    parts.append(problem.clearance)
    for pairs in (checker.obstacle_pairs, checker.link_pairs):
        parts += [name for pair in pairs for i in pair for name in (checker.shapes[i].owner,)]
    for body_shape in checker.shapes:
        parts += [body_shape.owner, *_shape_parts(body_shape.shape)]
    return _hash(parts)


def _robot_parts(robot: RobotModel) -> list[object]:
    q, v, a = np.random.default_rng(_SEED).uniform(-1, 1, (3, _CONFIGURATIONS, robot.joint_count))
    limits = robot.limits
    return [
        *robot.joint_names,
        *robot.tool_pose(q),
        robot.inverse_dynamics(q, v, a),
        limits.lower_position,
        limits.upper_position,
        limits.velocity,
        limits.effort,
        limits.acceleration,
        limits.jerk,
    ]


def _shape_parts(shape: ConvexShape) -> list[object]:
    """Return what a shape is, whatever the order of its vertices."""
    return [np.sort(shape.vertices, axis=0), shape.radius]


def origin(problem: PlanningProblem, method: str | None = None) -> dict[str, Any]:
    """Return the origin that a trajectory file states, as JSON values.

    Args:
        problem: The planning problem.
        method: How the trajectory was made; None: not known, and not stated.
    """
    return {
        **({} if method is None else {"method": method}),
        "tubeplanner_version": __version__,
        "problem": problem.name,
        "problem_hash": problem_hash(problem),
        "robot_hash": robot_hash(problem.robot),
    }


def _hash(parts: Iterable[object]) -> str:
    digest = hashlib.sha256()
    for part in parts:
        text = part if isinstance(part, str) or part is None else _digits(part)
        digest.update(f"{text};".encode())
    return digest.hexdigest()[:16]


def _digits(values: object) -> str:
    # Adding zero turns -0.0 into 0.0; what is smaller than rounding errors is zero.
    flat = np.round(np.asarray(values, dtype=np.float64).ravel(), 9) + 0.0
    return " ".join(f"{value:.8e}" for value in flat)
