"""The tool's orientation against the reference."""

from tubeplanner.verification.judged_condition import JudgedCondition, bracketed, not_required
from tubeplanner.verification.judged_motion import JudgedMotion
from tubeplanner.verification.rotation_visits import least_rotation_margin


def judge_rotation(motion: JudgedMotion) -> JudgedCondition:
    """Judge the tool's orientation, segment by segment."""
    if motion.tube.rotation is None or motion.pose is None:
        return not_required("rad", "the tool's orientation is free")
    least = least_rotation_margin(motion.tube.rotation, motion.pose, motion.visits)
    if least is None:
        return not_required("rad", "free in every segment visited")
    place = motion.place_in_segment(least.segment, least.time)
    return bracketed(least.lower_bound, least.attained, "rad", place)
