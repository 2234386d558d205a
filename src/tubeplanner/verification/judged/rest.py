"""Rest at both ends."""

import numpy as np

from tubeplanner.outcome import Place
from tubeplanner.verification.judged_condition import FOR_ALL_TIMES, RELATIVE, JudgedCondition
from tubeplanner.verification.judged_motion import JudgedMotion


def judge_rest(motion: JudgedMotion) -> JudgedCondition:
    """Judge velocity and acceleration at both ends, relative to their largest values."""
    worst, place = 0.0, Place()
    for order in (1, 2):
        values = motion.piece_ends(order)
        ends = np.array([values[0, 0], values[1, -1]])
        share = abs(ends) / motion.largest_rates[order]
        if share.max() > worst:
            end, joint = np.unravel_index(int(share.argmax()), share.shape)
            time = float(motion.trajectory.breakpoints[-end])
            worst = float(share.max())
            place = Place(time=time, joint=motion.robot.joint_names[joint])
    return JudgedCondition(0.0 - worst, RELATIVE, place, FOR_ALL_TIMES)
