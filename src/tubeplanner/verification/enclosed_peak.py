"""The largest share of their limits that enclosed quantities of the joints use."""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.outcome import Place
from tubeplanner.trajectory.bernstein import peak_magnitudes
from tubeplanner.verification.enclosure import Enclosure
from tubeplanner.verification.judged_condition import (
    FOR_ALL_TIMES,
    RELATIVE,
    JudgedCondition,
    undecided,
)
from tubeplanner.verification.judged_motion import JudgedMotion


def judged_peak(
    motion: JudgedMotion, quantity: Enclosure, limit: FloatArray, closeness: float
) -> JudgedCondition:
    """Judge the magnitudes of a quantity of every joint against limits.

    Args:
        motion: Whose quantity it is.
        quantity: c = n.
        limit: Shape (n,), infinite where there is none, but not everywhere.
        closeness: What errors, as shares of the limits, leave the condition decided.
    """
    bounded = np.flatnonzero(np.isfinite(limit))
    used = quantity.coefficients[:, :, bounded] / limit[bounded]
    error = quantity.error[:, bounded].max(axis=0) / limit[bounded]
    peaks = peak_magnitudes(used, np.ones_like(quantity.width))
    above = peaks.value + error
    worst = int(above.argmax())
    interval = peaks.piece[worst]
    time = quantity.start[interval] + peaks.local_time[worst] * quantity.width[interval]
    coverage = FOR_ALL_TIMES
    if error[worst] > closeness:
        coverage = undecided(1 - float(peaks.value[worst]), RELATIVE)
    place = Place(time=float(time), joint=motion.robot.joint_names[bounded[worst]])
    return JudgedCondition(1 - float(above[worst]), RELATIVE, place, coverage)
