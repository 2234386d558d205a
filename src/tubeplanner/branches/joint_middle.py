"""The middle of joint ranges, open ones included."""

import numpy as np

from tubeplanner.arrays import FloatArray


def middle_of(lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Return the middle (n,) of joint bounds; where one is infinite, what is nearest zero."""
    with np.errstate(invalid="ignore"):
        middle = (lower + upper) / 2
    return np.where(np.isfinite(middle), middle, np.clip(0.0, lower, upper))


def half_ranges(lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Return half the widths (n,) of joint bounds; half a turn where one is infinite."""
    half = (upper - lower) / 2
    return np.where(np.isfinite(half), half, np.pi)
