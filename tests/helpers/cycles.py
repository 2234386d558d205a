"""Cycles that tests of several folders use: of the two-link arm, which moves in a plane."""

from itertools import pairwise

import numpy as np
from cases import rest_to_rest

from tubeplanner import (
    Attach,
    Cycle,
    Detach,
    Event,
    Move,
    Obstacle,
    Payload,
    Tube,
    load_robot,
    placement_of,
)
from tubeplanner.task.motion import LegMotion, cycle_motion

HOME, PICK, PLACE = np.array([0.1, 0.6]), np.array([0.7, 0.9]), np.array([-0.5, 0.7])
# A ball under the hand where it picks, farther from its links than contacts are.
PART = (0.02, 0.1)  # its radius, and how far above the hand it is [m]
DWELL = 0.25


def planar_arm(gravity=(0.0, 0.0, 0.0), **more):
    return load_robot("example:two_link", "hand", gravity=gravity, **more)


def ball(robot, q=PICK, name="part"):
    """Return an obstacle above where the hand is in a configuration."""
    radius, above = PART
    location = robot.tool_position(q) + np.array([0, 0, above])
    return Obstacle.sphere(name, radius, placement_of(location))


def tube_between(robot, start, goal, radius=0.2, **more):
    return Tube(robot.tool_position(np.array([start, goal])), radius, **more)


def move(robot, name, start, goal, /, **more):
    """Return a move between the tool's places in two configurations."""
    given = {"radius": more.pop("radius")} if "radius" in more else {}
    return Move(name, robot, tube_between(robot, start, goal, **given), **more)


def pick_and_place(robot=None, *, payload=None, dwell=DWELL, closed=True, **more):
    """Return a cycle: to the part, take it, carry it away, let it go, back."""
    robot = robot or planar_arm()
    steps = [
        move(robot, "to_pick", HOME, PICK),
        Event("gripper", "close", dwell),
        Attach("part", payload),
        move(robot, "to_place", PICK, PLACE),
        Event("gripper", "open", dwell),
        Detach("part"),
        move(robot, "back", PLACE, HOME),
    ]
    return Cycle(HOME, steps, [ball(robot)], closed=closed, **more)


def slow_motion(cycle, junctions=(HOME, PICK, PLACE, HOME), duration=2.0):
    """Return a slow motion of a cycle: each leg a line in joint space between two seams."""
    names = cycle.robot.joint_names
    legs = [
        LegMotion(rest_to_rest(names, begin, end, duration)) for begin, end in pairwise(junctions)
    ]
    return cycle_motion(cycle, legs)


def weight(mass, com=(0.0, 0.0, 0.0)):
    return Payload(mass, com, (0.01, 0.02, 0.015, 0.001, 0.0, 0.0))
