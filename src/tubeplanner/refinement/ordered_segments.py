"""Which segment of its chain each sample of a spline belongs to: in order, and as near as can be.

The judge asks for segments one after the other too: the tool may not skip back where a path comes
near itself, and a closed path begins in its first segment and ends in its last.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.refinement.phased_spline import Samples


@dataclass(frozen=True, eq=False)
class OrderedSegments:
    """The segments of N samples of a spline, wherever the tool is.

    Attributes:
        points: Reference points, shape (m+1, 3) [m].
        radius: Of the segments, shape (m,) [m].
        chains: The segments of every phase.
        samples: The samples, in any order.
    """

    points: FloatArray
    radius: FloatArray
    chains: tuple[range, ...]
    samples: Samples

    @cached_property
    def in_chain(self) -> BoolArray:
        """Whether the phases of the samples have several segments, shape (N,)."""
        several = np.array([len(chain) > 1 for chain in self.chains])
        in_chain: BoolArray = several[self.samples.phase]
        return in_chain

    def at(self, tool: FloatArray) -> IntArray:
        """Return the samples' segments if the tool is at some places (N, 3), shape (N,)."""
        segment = np.array([chain.start for chain in self.chains])[self.samples.phase]
        for chain, members in self._members:
            here = slice(chain.start, chain.stop)
            begin, end = self.points[:-1][here], self.points[1:][here]
            share = _squared_distances(tool[members], begin, end) / self.radius[here] ** 2
            segment[members] += ordered_choice(share**2)
        return segment

    @cached_property
    def _members(self) -> list[tuple[range, IntArray]]:
        """The chains, and their samples in the order of time."""
        order = np.lexsort((self.samples.share, self.samples.phase))
        phase = self.samples.phase[order]
        return [
            (chain, order[slice(*np.searchsorted(phase, [k, k + 1]))])
            for k, chain in enumerate(self.chains)
            if len(chain) > 1
        ]


def ordered_choice(cost: FloatArray) -> IntArray:
    """Return the cheapest never decreasing choice that begins with the first and ends at the last.

    Args:
        cost: What each of m choices costs each of N samples, shape (N, m); finite.

    Returns:
        The choices, shape (N,).
    """
    cost = cost.copy()
    cost[0, 1:] = cost[-1, :-1] = np.inf
    nearest = cost.argmin(axis=1)
    if (np.diff(nearest) >= 0).all():  # as a rule: none can be cheaper
        return nearest
    # Dynamic programme: the least cost of all samples so far, this one's choice being at most k.
    least = cost
    for sample in range(1, len(cost)):
        np.minimum.accumulate(least[sample - 1], out=least[sample - 1])
        least[sample] += least[sample - 1]
    choice = np.full(len(cost), cost.shape[1] - 1)
    for sample in range(len(cost) - 2, -1, -1):
        choice[sample] = (least[sample] <= least[sample, choice[sample + 1]]).argmax()
    return choice


def _squared_distances(points: FloatArray, begin: FloatArray, end: FloatArray) -> FloatArray:
    """Return the squared distances of points (N, 3) to segments (m, 3): (N, m), to rounding.

    By products of matrices, as there may be a million pairs.
    """
    origin = begin.mean(axis=0)
    points, begin, axis = points - origin, begin - origin, end - begin
    squared_length = np.einsum("mi,mi->m", axis, axis)
    along = points @ axis.T - np.einsum("mi,mi->m", begin, axis)
    share = np.clip(along / squared_length, 0.0, 1.0)
    square = np.einsum("ni,ni->n", points, points)[:, None] - 2 * points @ begin.T
    square += np.einsum("mi,mi->m", begin, begin) - share * (2 * along - share * squared_length)
    return np.maximum(square, 0.0)
