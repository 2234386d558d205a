"""The tool's orientation against the reference, and at the end against what the goal asks."""

from tubeplanner.outcome import Place
from tubeplanner.verification.judged_condition import JudgedCondition, bracketed, not_required
from tubeplanner.verification.judged_motion import JudgedMotion
from tubeplanner.verification.rotation_visits import least_rotation_margin


def judge_rotation(motion: JudgedMotion) -> JudgedCondition:
    """Judge the tool's orientation, segment by segment and at the goal."""
    along, at_goal = _judge_along(motion), _judge_at_goal(motion)
    if along.margin is None or at_goal.margin is None:
        return along if at_goal.margin is None else at_goal
    return min(along, at_goal, key=lambda condition: condition.margin or 0.0)


def _judge_along(motion: JudgedMotion) -> JudgedCondition:
    """Judge it against the tube's tolerances."""
    if motion.tube.rotation is None or motion.pose is None:
        return not_required("rad", "the tool's orientation is free")
    least = least_rotation_margin(motion.tube.rotation, motion.pose, motion.visits)
    if least is None:
        return not_required("rad", "free in every segment visited")
    place = motion.place_in_segment(least.segment, least.time)
    return bracketed(least.lower_bound, least.attained, "rad", place)


def _judge_at_goal(motion: JudgedMotion) -> JudgedCondition:
    """Judge the last orientation against the goal's tolerance."""
    goal, duration = motion.problem.open_goal, motion.trajectory.duration
    if goal is None or not goal.bounds_rotation or motion.problem.rotation is None:
        return not_required("rad", "the goal bounds no rotation")
    rotation, tool = motion.robot.tool_pose(motion.trajectory.position(duration)[None])
    margin = motion.problem.rotation.margin(rotation, tool, motion.tube.segment_count)[0]
    return JudgedCondition(float(margin), "rad", Place(time=duration), "at the goal")
