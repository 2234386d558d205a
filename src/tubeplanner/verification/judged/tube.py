"""The tool in the tube."""

from tubeplanner.verification.judged_condition import JudgedCondition, bracketed
from tubeplanner.verification.judged_motion import JudgedMotion
from tubeplanner.verification.tube_visits import least_margin


def judge_tube(motion: JudgedMotion) -> JudgedCondition:
    """Judge the tool's place in the tube, segment by segment or in their union."""
    least = least_margin(motion.tube, motion.tool, motion.visits)
    place = motion.place_in_segment(least.segment, least.time)
    return bracketed(least.lower_bound, least.attained, "m", place)
