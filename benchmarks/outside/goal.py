"""Whether the tool ends in its pose or the ball of its goal, and turned as that asks."""

import math
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from outside.arm import Arm
from outside.files import BadInput
from outside.problem import Problem
from outside.standing import placement_of
from outside.trajectory import Trajectory
from outside.verdict import Condition


def judge_ball(goal: dict[str, Any], arm: Arm, q: np.ndarray, time: float) -> Condition:
    """Return how far inside its ball the tool is in a configuration (n,)."""
    away = math.dist(arm.tool(q[None])[1][0], goal["position"])
    return Condition(float(goal.get("tolerance", 0.0)) - away, "m", time, "tool in its ball")


def judge_pose(pose: dict[str, Any], arm: Arm, q: np.ndarray, time: float) -> Condition:
    """Return how far the tool is from its pose in a configuration (n,), metres or radians."""
    asked = placement_of(pose)
    rotation, position = arm.tool(q[None])
    away = math.dist(position[0], asked.translation)
    turned = float(Rotation.from_matrix(asked.rotation.T @ rotation[0]).magnitude())
    unit = "rad" if turned > away else "m"
    return Condition(-max(away, turned), unit, time, "tool in its pose")


def judge_turn(problem: Problem, arm: Arm, trajectory: Trajectory) -> Condition:
    """Return how far inside the goal's bounds the last orientation is; no margin if it has none.

    Raises:
        BadInput: The tube has no orientations, or the bounds are no angle and no triple.
    """
    given = problem.goal.get("rotation_tolerance")
    if given is None:
        return Condition(None, "rad")
    if problem.tube.orientations is None or np.shape(given) not in ((), (3,)):
        raise BadInput("goal.rotation_tolerance needs tube.orientations, and an angle or a triple")
    time = float(trajectory.breakpoints[-1])
    last = trajectory.samples(1)
    rotation = arm.tool(trajectory.at(last)[-1:])[0][0]
    reference = Rotation.from_quat(problem.tube.orientations[-1])
    vector = (reference.inv() * Rotation.from_matrix(rotation)).as_rotvec()
    used = abs(vector) if np.ndim(given) else np.linalg.norm(vector)
    margin = float(np.min(np.array(given, dtype=float) - used))
    return Condition(margin if math.isfinite(margin) else None, "rad", time, "at the goal")
