"""When a trajectory passes from one tube segment to the next.

Segments are visited in order, and at a switching time the tool is in both capsules. Of all choices
of switching times, it takes the one with the largest worst margin. A point that must be passed is
passed while one of the two segments that meet there is the current one.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray


class _State(NamedTuple):
    """In which segment a trajectory is, and whether it has passed the points at its ends."""

    segment: int
    first_passed: bool
    last_passed: bool


def best_switching_samples(
    margin: FloatArray, passing: Mapping[int, FloatArray] | None = None
) -> IntArray:
    """Return the samples at which an ordered visit passes on.

    Args:
        margin: How well each of N samples fits each of m segments, shape (N, m), samples in the
            order of time.
        passing: For points that must be passed in one of the segments beside them, inner ones by
            index: how well each sample does, shape (N,).

    Returns:
        Shape (m-1,), never decreasing: sample s belongs to segment k if it lies between the
        switching times k-1 and k, both included, so that a switching time counts in both its
        segments.
    """
    passing = passing or {}
    best = _best_margins(margin, passing)
    state, last = next(reversed(best)), len(margin) - 1
    switching_samples: list[int] = []
    while sources := _sources(state, passing, len(margin)):
        found = []
        for source, gate in sources:
            here = np.minimum(margin[:, source.segment], gate)
            entered = np.minimum(best[source], gate)
            sample = _switch_before(entered, here, margin[:, state.segment], last)
            rest = margin[sample : last + 1, state.segment].min()
            found.append((min(entered[sample], rest), sample, source))
        _, sample, source = max(found, key=lambda entry: entry[0])
        if source.segment < state.segment:
            switching_samples.insert(0, sample)
        state, last = source, sample
    return np.array(switching_samples, dtype=np.int64)


def _best_margins(
    margin: FloatArray, passing: Mapping[int, FloatArray]
) -> dict[_State, FloatArray]:
    """Return the largest worst margin with which each sample can be in each state, (N,) each.

    A state comes after its sources; the last one is the one to end in.
    """
    count = margin.shape[1]
    best: dict[_State, FloatArray] = {}
    for k in range(count):
        for first in (False, True) if k in passing else (True,):
            for last in (False, True) if k + 1 in passing else (True,):
                state = _State(k, first, last)
                sources = _sources(state, passing, len(margin))
                entered = [np.minimum(best[source], gate) for source, gate in sources]
                if not entered:  # where it begins
                    entered = [np.where(np.arange(len(margin)) == 0, np.inf, -np.inf)]
                before = np.max(entered, axis=0)
                best[state] = _best_after_switch(before, margin[:, k])
    return best


def _sources(
    state: _State, passing: Mapping[int, FloatArray], count: int
) -> list[tuple[_State, FloatArray]]:
    """Return from which states one is entered, and how well N samples pass what lies between."""
    k, first_passed, last_passed = state
    free = np.full(count, np.inf)
    sources = []
    if k > 0 and last_passed is (k + 1 not in passing):  # just entered, nothing is passed ahead
        sources.append((_State(k - 1, True, first_passed), free))
    if k in passing and first_passed:
        sources.append((_State(k, False, last_passed), passing[k]))
    if k + 1 in passing and last_passed:
        sources.append((_State(k, first_passed, False), passing[k + 1]))
    return sources


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
