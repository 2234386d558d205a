"""Joint ranges of the segments."""

from itertools import groupby

import numpy as np

from tubeplanner.outcome import Place
from tubeplanner.verification.joint_extremes import range_margin
from tubeplanner.verification.judged_condition import FOR_ALL_TIMES, JudgedCondition, not_required
from tubeplanner.verification.judged_motion import JudgedMotion
from tubeplanner.verification.tube_visits import Visit


def judge_joint_signs(motion: JudgedMotion) -> JudgedCondition:
    """Judge the segments' joint ranges, exactly between the switching times."""
    lower, upper = motion.tube.ranges_of(motion.robot.joint_names)
    found = []
    for visits in _visits_by_range(motion):
        segment, begin = visits[0].segment, visits[0].begin
        part = motion.trajectory.between(begin, visits[-1].end)
        least = range_margin(part, lower[segment], upper[segment])
        if least is not None:
            found.append((least._replace(time=begin + least.time), visits))
    if not found:
        return not_required("rad", "no segment has joint signs")
    worst, visits = min(found, key=lambda item: item[0].margin)
    segment = next((v.segment for v in visits if worst.time <= v.end), visits[-1].segment)
    place = Place(worst.time, worst.joint, motion.segment_number(segment, worst.time))
    return JudgedCondition(worst.margin, motion.position_unit(worst.joint), place, FOR_ALL_TIMES)


def _visits_by_range(motion: JudgedMotion) -> list[list[Visit]]:
    """Return the visits, neighbours together whose segments have the same joint ranges."""
    ranges = np.hstack(motion.tube.ranges_of(motion.robot.joint_names))
    found = groupby(motion.visits, key=lambda visit: ranges[visit.segment].tobytes())
    return [list(visits) for _, visits in found]
