"""A cycle in which much changes hands, and its motion, for tests of what is drawn.

The arm is `cases.SLIDE`. A part is taken, carried through a point without a stop, and put down; a
cap comes and goes with it. Nothing of it is certified: views judge nothing.
"""

import json
import re
from itertools import pairwise

import numpy as np
from cases import SLIDE, rest_to_rest

from tubeplanner import Tube, load_robot
from tubeplanner.geometry.solids import AttachedSolid, Obstacle
from tubeplanner.robot.pinocchio_model import Payload
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.motion import LegMotion, cycle_motion
from tubeplanner.task.steps import Attach, Detach, Event, Move

START, TAKEN, LEFT = np.array([[0.0, 0.0, 0.0], [0.4, 0.1, 0.2], [-0.3, 0.2, 0.1]])
CARRIED = Payload(2.0, (0.3, 0.0, 0.0))
GRIP, RELEASE = 0.1, 0.2  # [s]
RADII = 0.2, 0.25, 0.3, [0.2, 0.3]  # [m], of the tubes in turn


def at(*position):
    """Return a placement."""
    placement = np.eye(4)
    placement[:3, 3] = position
    return placement


def shown_cycle(folder):
    """Return the cycle; the robot file goes to a folder."""
    path = folder / "slide.urdf"
    path.write_text(SLIDE)
    robot = load_robot(path, "tip")
    stops = np.array([START, TAKEN, (TAKEN + LEFT) / 2, LEFT, START])
    tools = robot.tool_position(stops)
    lines = [[*pair] for pair in pairwise(tools)]
    lines[3].insert(1, (tools[3] + tools[4]) / 2)
    tubes = [Tube(*pair) for pair in zip(lines, RADII, strict=True)]
    part = Obstacle.box("part", (0.1, 0.1, 0.1), at(0.6, 0.4, 0.05))
    post = Obstacle.box("post", (0.1, 0.1, 0.6), at(-0.6, 0.0, 0.3))
    cap = AttachedSolid("cap", Obstacle.box("cap", (0.05, 0.05, 0.05), at(0.2, 0, 0)).shapes)
    steps = [
        Move("reach", robot, tubes[0], goal=TAKEN),
        Event("grip", "close", GRIP),
        Attach("part", CARRIED),
        Attach("cap", solid=cap),
        Move("carry", robot, tubes[1]),
        Move("on", robot, tubes[2], goal=LEFT, passes_through=True),
        Event("grip", "open", RELEASE),
        Detach("part"),
        Detach("cap", leaves_obstacle=False),
        Move("back", robot, tubes[3], goal=START),
    ]
    return Cycle(START, steps, [part, post], closed=True, self_collision=False, name="shown")


def motion_of(cycle, duration=1.0):
    """Return a motion in which each leg takes a duration [s]."""
    names, ends = cycle.robot.joint_names, (START, TAKEN, LEFT, START)
    legs = [rest_to_rest(names, *ends[k : k + 2], duration) for k in range(3)]
    passed = ((), (duration / 2,), ())
    return cycle_motion(cycle, [LegMotion(*pair) for pair in zip(legs, passed, strict=True)])


def data_of(page):
    """Return what a page hands to its script."""
    return json.loads(re.search(r'id="data">(.*?)</script>', page, re.S).group(1))


def materials_of(commands):
    """Return the material of every object that is drawn, by its path."""
    return {
        command["path"]: command["object"]["materials"][0]
        for command in commands
        if command["type"] == "set_object"
    }
