"""The highest peak of a function of time, refined between its samples."""

from collections.abc import Callable

import numpy as np

from tubeplanner.arrays import FloatArray

_MAX_PEAKS = 24
_POINTS = 9  # per peak and zoom; every zoom narrows in by a factor of 4
_ZOOMS = 6


def refined_maximum(
    function: Callable[[FloatArray], FloatArray],
    time: FloatArray,
    value: FloatArray,
    *,
    band: float,
) -> tuple[float, float]:
    """Return the largest value of a function and its time [s].

    Args:
        function: From times (N,) to values (N,).
        time: Increasing sample times, shape (N,) [s]; two may be equal where a derivative jumps.
        value: The function at these samples, shape (N,).
        band: Peaks of the samples this far below the highest are refined as well, as long as they
            may become the highest.

    Returns:
        At least the largest sample.
    """
    best, when = float(value.max()), float(time[value.argmax()])
    peaks = _peaks(value, best - band)
    # The nearest other times, not the nearest samples: at a breakpoint two samples share a time.
    low = time[np.maximum(np.searchsorted(time, time[peaks], "left") - 1, 0)]
    high = time[np.minimum(np.searchsorted(time, time[peaks], "right"), len(time) - 1)]
    for _ in range(_ZOOMS):
        grid = low[:, None] + np.linspace(0, 1, _POINTS) * (high - low)[:, None]
        found = function(grid.ravel()).reshape(grid.shape)
        rows, top = np.arange(len(grid)), found.argmax(axis=1)
        before, after = np.maximum(top - 1, 0), np.minimum(top + 1, _POINTS - 1)
        value = found[rows, top]
        highest = int(value.argmax())
        if value[highest] > best:
            best, when = float(value[highest]), float(grid[highest, top[highest]])
        # A concave peak rises above its sample by no more than it falls to the lower neighbour.
        fall = value - np.minimum(found[rows, before], found[rows, after])
        fall[(before == top) | (after == top)] = np.inf  # one neighbour is not known
        rows = rows[value + fall >= best]
        if len(rows) == 0:
            break
        low, high = grid[rows, before[rows]], grid[rows, after[rows]]
    return best, when


def _peaks(value: FloatArray, floor: float) -> np.ndarray:
    """Return the samples that are no lower than their neighbours and the floor, highest first."""
    padded = np.concatenate([[-np.inf], value, [-np.inf]])
    is_peak = (value >= padded[:-2]) & (value >= padded[2:]) & (value >= floor)
    peaks = np.flatnonzero(is_peak)
    return peaks[np.argsort(-value[peaks], kind="stable")][:_MAX_PEAKS]
