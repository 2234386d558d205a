"""The largest share of limits that joints use which move one way at a time."""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.outcome import Place
from tubeplanner.trajectory.bernstein import maxima
from tubeplanner.verification.directed_efforts import DirectedEfforts
from tubeplanner.verification.judged_condition import (
    FOR_ALL_TIMES,
    RELATIVE,
    JudgedCondition,
    undecided,
)
from tubeplanner.verification.judged_motion import EFFORT_ENCLOSURE, JudgedMotion


def judged_both_ways(
    motion: JudgedMotion, efforts: DirectedEfforts, excess: FloatArray, unit: FloatArray
) -> JudgedCondition:
    """Judge efforts that must not exceed what is allowed.

    Args:
        motion: Whose efforts they are.
        efforts: On R intervals.
        excess: What they have above it forwards and backwards, errors included: polynomials as
            those of `efforts`, shape (2, N, R) [N m or N].
        unit: What margins are relative to, shape (R,) [N m or N].
    """
    used = excess / unit
    used[:, -1] += 1.0  # `maxima` resolves shares of the value, which must not be 0
    rows = np.concatenate(list(used), axis=1)[:, :, None]
    peak = maxima(rows, np.ones(rows.shape[1]))
    worst = int(peak.piece[0]) % len(unit)
    margin, error = 1 - float(peak.value[0]), float(efforts.error[worst] / unit[worst])
    coverage = FOR_ALL_TIMES
    if error > EFFORT_ENCLOSURE:
        coverage = undecided(margin + error, RELATIVE)
    time = efforts.start[worst] + peak.local_time[0] * efforts.width[worst]
    place = Place(time=float(time), joint=motion.robot.joint_names[efforts.joint[worst]])
    return JudgedCondition(margin, RELATIVE, place, coverage)
