"""A problem seen from somewhere else: all that is in its cell moved as one, and its robot too."""

import copy

import numpy as np
from scipy.spatial.transform import Rotation
from yaml import safe_load

from tubeplanner.resources import bundled_problems

# About an axis along no diagonal and no side.
TURN = {"position": [0.3, -0.2, 1.1], "rpy": [0.4, -1.2, 2.5]}


def bundled_fields(name):
    """Return what the file of a bundled problem holds."""
    return safe_load(bundled_problems()[name].read_text())


def placed_fields(fields, base):
    """Return the fields of a problem or cycle with its cell, gravity too, moved with its robot."""
    moved = copy.deepcopy(fields)
    turn, robot = turn_of(base), moved["robot"]
    robot["base"] = base
    robot["gravity"] = turn.apply(robot.get("gravity", [0, 0, -9.81])).tolist()
    moves = [step for step in moved.get("moves", [moved]) if "tube" in step]
    for tube in (move["tube"] for move in moves):
        tube["points"] = [_there(point, base) for point in tube["points"]]
        if tube.get("orientations"):
            own = Rotation.from_quat(tube["orientations"])
            tube["orientations"] = (turn * own).as_quat().tolist()
    for solid in moved.get("obstacles", []):
        solid["position"] = _there(solid["position"], base)
        solid["quaternion"] = (turn * turn_of(solid)).as_quat().tolist()
        solid.pop("rpy", None)
    for goal in (move.get("goal") or {} for move in moves):
        assert "pose" not in goal
        if "position" in goal:
            goal["position"] = _there(goal["position"], base)
    return moved


def _there(point, base):
    return (turn_of(base).apply(point) + base["position"]).tolist()


def turn_of(location):
    """Return how something with rpy, a quaternion or neither is turned."""
    if location.get("quaternion") is not None:
        return Rotation.from_quat(location["quaternion"])
    return Rotation.from_euler("xyz", location.get("rpy") or np.zeros(3))
