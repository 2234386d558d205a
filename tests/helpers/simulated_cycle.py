"""A cycle of an arm that takes a part and lets it go, and its motion, for tests of several folders.

The arm is `cases.SLIDE`; the part hangs beside its tip, so that it pulls at the joint that lifts.
"""

import numpy as np
from cases import SLIDE, rest_to_rest

from tubeplanner import Tube, load_robot
from tubeplanner.execution.plants import Draw
from tubeplanner.execution.simulation import AFTERWARDS, Execution, motion_stages
from tubeplanner.geometry.solids import Obstacle
from tubeplanner.robot.pinocchio_model import Payload
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.demands import Robustness
from tubeplanner.task.motion import LegMotion, cycle_motion
from tubeplanner.task.steps import Attach, Detach, Event, Move

LEVER = 0.3  # [m]
PART = Payload(2.0, (LEVER, 0.0, 0.0))
SEAMS = np.array([[0.0, 0.0, 0.0], [0.4, 0.1, 0.0], [-0.3, 0.2, 0.1], [0.0, 0.0, 0.0]])
PLACE = (0.6, 0.4, 0.05)  # of the part [m]
NAMES = ("reach", "carry", "back")
DURATION, DWELL = 1.0, 0.1  # [s], of each move and before and after something changes hands


def slide(folder, **fields):
    """Return the arm."""
    path = folder / "slide.urdf"
    path.write_text(SLIDE)
    return load_robot(path, "tip", **fields)


def moves_of(robot, radius=0.2):
    """Return moves between the seams, in straight tubes."""
    tools = robot.tool_position(SEAMS)
    return [
        Move(name, robot, Tube(tools[k : k + 2], radius), goal=SEAMS[k + 1])
        for k, name in enumerate(NAMES)
    ]


def picking(folder, payload=PART, robot=None, radius=0.2):
    """Return a cycle that takes a part after its first move and lets it go after its second."""
    reach, carry, back = moves_of(robot or slide(folder), radius)
    steps = [
        reach,
        Event("close", dwell=DWELL),
        Attach("part", payload),
        Event("settle", dwell=DWELL),
        carry,
        Event("open", dwell=DWELL),
        Detach("part"),
        back,
    ]
    placement = np.eye(4)
    placement[:3, 3] = PLACE
    part = Obstacle.box("part", (0.1, 0.1, 0.1), placement)
    return Cycle(SEAMS[0], steps, [part], closed=True)


def motion_of(cycle, duration=DURATION):
    """Return a motion of a cycle, smooth from seam to seam."""
    names = cycle.robot.joint_names
    legs = [
        LegMotion(rest_to_rest(names, SEAMS[k], SEAMS[k + 1], duration))
        for k in range(len(cycle.legs))
    ]
    return cycle_motion(cycle, legs)


def followed_cycle(motion, runs=1, period=0.004):
    """Return an execution in which all joints follow the plan, efforts and velocities zero."""
    time = np.arange(0.0, motion.trajectory.duration + AFTERWARDS, period)
    planned = motion.trajectory.position(np.minimum(time, motion.trajectory.duration))
    q = np.array([planned] * runs)
    plants = motion_stages(motion, Robustness.exact(), Draw(runs))[0].plants
    return Execution(plants, time, q, np.zeros_like(q), np.zeros_like(q), q > np.inf)
