"""Compulsory points."""

from tubeplanner.outcome import Place
from tubeplanner.verification.judged_condition import JudgedCondition, not_required
from tubeplanner.verification.judged_motion import JudgedMotion
from tubeplanner.verification.tube_visits import passages


def judge_points(motion: JudgedMotion) -> JudgedCondition:
    """Judge compulsory points, each at an instant when one of its two segments is the current."""
    known = (motion.problem, motion.trajectory, motion.tool, motion.visits, motion.rotation)
    found = passages(*known, motion.further)
    if not found:
        return not_required("m", "no point is to be passed")
    worst = min(found, key=lambda passage: passage.margin)
    place = Place(time=worst.time, point=int(motion.tube.numbers[worst.point]))
    return JudgedCondition(worst.margin, "m", place, "at the instant that is nearest")
