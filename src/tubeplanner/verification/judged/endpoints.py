"""Start and goal."""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.outcome import Place
from tubeplanner.problem.goal_region import GoalRegion
from tubeplanner.problem.problem import Seed
from tubeplanner.problem.tool_pose import ToolPose
from tubeplanner.verification.judged_condition import FOR_ALL_TIMES, JudgedCondition
from tubeplanner.verification.judged_motion import JudgedMotion


def judge_start(motion: JudgedMotion) -> JudgedCondition:
    """Judge where the trajectory begins."""
    return _judge_end(motion, 0, motion.problem.start, 0.0)


def judge_goal(motion: JudgedMotion) -> JudgedCondition:
    """Judge where the trajectory ends."""
    goal, duration = motion.problem.goal, motion.trajectory.duration
    if not isinstance(goal, GoalRegion):
        return _judge_end(motion, -1, goal, duration)
    tool = motion.robot.tool_position(motion.trajectory.position(duration)[None])[0]
    coverage = f"tool within {goal.tolerance:g} m of the goal's position"
    return JudgedCondition(goal.margin(tool), "m", Place(time=duration), coverage)


def _judge_end(
    motion: JudgedMotion, index: int, given: FloatArray | Seed | ToolPose | None, time: float
) -> JudgedCondition:
    """Judge one end against the given configuration (n,) or pose, or else the reference point.

    Args:
        motion: What is judged.
        index: The end's reference point.
        given: What the problem asks there.
        time: When the trajectory is there [s].
    """
    q = motion.trajectory.position(time)
    if isinstance(given, ToolPose):
        rotation, position = (part[0] for part in motion.robot.tool_pose(q[None]))
        away, turned = given.errors(rotation, position)
        unit, worst = ("m", away) if away >= turned else ("rad", turned)
        return JudgedCondition(0.0 - worst, unit, Place(time=time), "tool at its pose")
    if given is None or isinstance(given, Seed):
        tool = motion.robot.tool_position(q[None])[0]
        error = float(np.linalg.norm(tool - motion.tube.points[index]))
        return JudgedCondition(0.0 - error, "m", Place(time=time), "tool at the reference point")
    off = abs(q - given)
    joint = motion.robot.joint_names[int(off.argmax())]
    place = Place(time=time, joint=joint)
    return JudgedCondition(
        0.0 - float(off.max()), motion.position_unit(joint), place, FOR_ALL_TIMES
    )
