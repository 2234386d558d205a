"""When a trajectory passes from one tube segment to the next.

Segments are visited in order, and at a switching time the tool is in both capsules. Of all choices
of switching times, it takes the one with the largest worst margin.
"""

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray


def best_switching_samples(margin: FloatArray) -> IntArray:
    """Return the samples at which an ordered visit passes on.

    Args:
        margin: How well each of N samples fits each of m segments, shape (N, m), samples in the
            order of time.

    Returns:
        Shape (m-1,), never decreasing: sample s belongs to segment k if it lies between the
        switching times k-1 and k, both included, so that a switching time counts in both its
        segments.
    """
    best = _best_margins(margin)
    switching_samples: list[int] = []
    last = len(margin) - 1
    for k in range(margin.shape[1] - 1, 0, -1):
        last = _switch_before(best[:, k - 1], margin[:, k - 1], margin[:, k], last)
        switching_samples.insert(0, last)
    return np.array(switching_samples, dtype=np.int64)


def _best_margins(margin: FloatArray) -> FloatArray:
    """Return the largest worst margin with which each sample can be in each segment, (N, m)."""
    best = [np.minimum.accumulate(margin[:, 0])]
    for k in range(1, margin.shape[1]):
        best.append(_best_after_switch(best[-1], margin[:, k]))
    return np.column_stack(best)


def _best_after_switch(before: FloatArray, margin: FloatArray) -> FloatArray:
    """Return the largest worst margin of being in a segment at each sample, shape (N,).

    The recursion `best[i] = min(margin[i], max(best[i-1], before[i]))` is a chain of clips; clips
    compose to clips, so that the chain is a prefix scan in log2(N) steps.
    """
    low, high = np.minimum(before, margin), margin.copy()
    shift = 1
    while shift < len(margin):
        earlier_low, earlier_high = low[:-shift].copy(), high[:-shift].copy()
        later_low, later_high = low[shift:].copy(), high[shift:].copy()
        low[shift:] = np.clip(earlier_low, later_low, later_high)
        high[shift:] = np.clip(earlier_high, later_low, later_high)
        shift *= 2
    return low


def _switch_before(
    best_before: FloatArray, margin_before: FloatArray, margin_after: FloatArray, last: int
) -> int:
    """Return the best sample for a switching time, not after the sample `last`."""
    rest = np.minimum.accumulate(margin_after[last::-1])[::-1]
    worst = np.minimum(best_before[: last + 1], rest)
    candidates = np.flatnonzero(worst >= worst.max())
    local = np.minimum(margin_before[candidates], margin_after[candidates])
    return int(candidates[local.argmax()])
