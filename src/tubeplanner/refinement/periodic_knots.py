"""Knots at multiples of a controller's period, so that its samples are the motion itself."""

from itertools import pairwise

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.refinement.phased_spline import KnotGrid, PhasedSpline
from tubeplanner.refinement.spline_start import on_knots


def on_periodic_knots(spline: PhasedSpline, periods: int) -> PhasedSpline:
    """Return nearly the same spline, all knots at multiples of a share of its duration.

    Args:
        spline: The spline.
        periods: How many periods its duration has, at least as many as the spline has phases.
    """
    ends = _apart(spline.switching_times * periods, periods)
    breakpoints = np.round(spline.grid.breakpoints(spline.switching_times) * periods).astype(int)
    breakpoints = _filled(np.union1d(breakpoints, ends), spline.grid.interval_count)
    shares = []
    for begin, end in pairwise(ends):
        inner = breakpoints[(breakpoints > begin) & (breakpoints < end)]
        places = np.unique(np.concatenate([[begin], inner, [end]]))
        shares.append((places - begin) / (end - begin))
    grid = KnotGrid(tuple(shares), spline.grid.chains, is_fixed=True)
    return on_knots(spline, grid, ends / periods)


def _filled(places: IntArray, intervals: int) -> IntArray:
    """Return places, the widest intervals between them halved until there are so many.

    Where knots were closer than a period, several fell onto one.
    """
    while len(places) - 1 < intervals:
        widths = np.diff(places)
        widest = int(widths.argmax())
        if widths[widest] == 1:
            break
        places = np.insert(places, widest + 1, places[widest] + widths[widest] // 2)
    return places


def _apart(times: FloatArray, last: int) -> IntArray:
    """Return whole numbers near increasing times from 0 to the last, no two the same."""
    count = len(times)
    places = np.round(times).astype(int)
    for k in range(1, count):
        places[k] = max(places[k], places[k - 1] + 1)
    return np.minimum(places, last - np.arange(count)[::-1])
