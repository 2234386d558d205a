"""Position limits."""

from tubeplanner.outcome import Place
from tubeplanner.verification.joint_extremes import range_margin
from tubeplanner.verification.judged_condition import FOR_ALL_TIMES, JudgedCondition, not_required
from tubeplanner.verification.judged_motion import JudgedMotion


def judge_position(motion: JudgedMotion) -> JudgedCondition:
    """Judge the position limits, exactly."""
    limits = motion.robot.limits
    least = range_margin(motion.trajectory, limits.lower_position, limits.upper_position)
    if least is None:
        return not_required("rad", "no joint has position limits")
    place = Place(time=least.time, joint=least.joint)
    return JudgedCondition(least.margin, motion.position_unit(least.joint), place, FOR_ALL_TIMES)
