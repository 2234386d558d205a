"""A problem seen from somewhere else: all that is in its cell moved as one, and its robot too."""

import copy

import numpy as np
from scipy.spatial.transform import Rotation
from yaml import safe_load

from tubeplanner.resources import bundled_problems

SHIFT = {"position": [0.75, -0.5, 1.25]}
# About an axis along no diagonal and no side.
TURN = {"position": [0.3, -0.2, 1.1], "rpy": [0.4, -1.2, 2.5]}


def bundled_fields(name):
    """Return what the file of a bundled problem holds."""
    return safe_load(bundled_problems()[name].read_text())


def placed_fields(fields, base):
    """Return the fields of a problem whose cell, gravity included, is moved with its robot."""
    moved = copy.deepcopy(fields)
    turn = turn_of(base)

    def there(point):
        return (turn.apply(point) + base["position"]).tolist()

    def turned(place):
        own = turn_of(place)
        return {"position": there(place.get("position", [0, 0, 0]))} | {
            "quaternion": (turn * own).as_quat().tolist()
        }

    robot, tube, goal = moved["robot"], moved["tube"], moved.get("goal") or {}
    robot["base"] = base
    robot["gravity"] = turn.apply(robot.get("gravity", [0, 0, -9.81])).tolist()
    tube["points"] = [there(point) for point in tube["points"]]
    if tube.get("orientations"):
        own = Rotation.from_quat(tube["orientations"])
        tube["orientations"] = (turn * own).as_quat().tolist()
    if "position" in goal:
        goal["position"] = there(goal["position"])
    for place in [*moved.get("obstacles", []), *filter(None, [goal.get("pose")])]:
        place |= turned(place)
        place.pop("rpy", None)
    return moved


def turn_of(place):
    """Return how something with rpy, a quaternion or neither is turned."""
    if place.get("quaternion") is not None:
        return Rotation.from_quat(place["quaternion"])
    return Rotation.from_euler("xyz", place.get("rpy") or np.zeros(3))
