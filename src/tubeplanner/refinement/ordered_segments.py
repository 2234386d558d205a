"""Which segment of its chain each sample of a spline belongs to: in order, and as near as can be.

The judge asks for segments one after the other too: the tool may not skip back where a path comes
near itself, and a closed path begins in its first segment and ends in its last. Nor may it leave
segments out, though that is not seen at samples: each of them may be near some segment or other.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.polyline import arc_lengths
from tubeplanner.refinement.phased_spline import Samples

# The tool takes a short cut between two samples if it leaves out so many radii more of the path
# than it moves. Segments left out count from so many radii away, if they are farther than the
# samples' own, by this factor: so the program sees them before the tool has left them.
_SHORT_CUT, _FAR, _FARTHER = 0.5, 0.3, 1.1
_NO_SQUARE = 1e-30  # [m^2]
# What segments that are asked for count at least, in radii.
_LEAST_SHARE = 1e-9


@dataclass(frozen=True, eq=False)
class OrderedSegments:
    """The segments of N samples of a spline, wherever the tool is.

    Attributes:
        points: Reference points, shape (m+1, 3) [m].
        radius: Of the segments, shape (m,) [m].
        chains: The segments of every phase.
        samples: The samples, in any order.
        is_asked: Which segments are given a sample wherever the tool is, shape (m,): of those that
            it missed, which samples do not tell. None: no segment.
    """

    points: FloatArray
    radius: FloatArray
    chains: tuple[range, ...]
    samples: Samples
    is_asked: BoolArray | None = None

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
            segment[members] += self._passage(tool, chain, members).segments()
        return segment

    def missed(self, tool: FloatArray) -> BoolArray:
        """Return which segments of chains no sample is in if the tool is at (N, 3), shape (m,)."""
        missed = np.zeros(len(self.radius), dtype=bool)
        for chain, members in self._members:
            missed[chain.start : chain.stop] = self._passage(tool, chain, members).missed()
        return missed

    def _passage(self, tool: FloatArray, chain: range, members: IntArray) -> "_Passage":
        here = slice(chain.start, chain.stop)
        points, radius = self.points[chain.start : chain.stop + 1], self.radius[here]
        asked = np.zeros(len(chain), dtype=bool) if self.is_asked is None else self.is_asked[here]
        return _Passage(tool[members], points, radius, asked)

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


@dataclass(frozen=True, eq=False)
class _Passage:
    """How the tool passes a chain's segments.

    Attributes:
        tool: Where it is at N samples, in the order of time, shape (N, 3) [m].
        points: The chain's reference points, shape (m+1, 3) [m].
        radius: Of its segments, shape (m,) [m].
        is_asked: Which of them get a sample in any case, shape (m,).
    """

    tool: FloatArray
    points: FloatArray
    radius: FloatArray
    is_asked: BoolArray

    def missed(self) -> BoolArray:
        """Return in which segments the tool never is, shape (m,)."""
        missed: BoolArray = self._square.min(axis=0) > self.radius**2
        return missed

    def segments(self) -> IntArray:
        """Return the samples' segments, in order, shape (N,).

        The nearest in order leave out whole bends where the tool is as near to what follows. So
        where it takes short cuts, what is left out has a price too, by its distance from the line
        between two samples. If it still is far off, one of the two belongs to it.
        """
        cost = (self._square / self.radius**2) ** 2
        choice = ordered_choice(cost)
        if not self._left_out(choice)[1].any():
            return choice  # as a rule
        choice = ordered_choice_paying(cost, (self._square_from_lines() / self.radius**2) ** 2)
        farthest, share = self._left_out(choice)
        has_moved = np.zeros(len(choice), dtype=bool)
        has_moved[[0, -1]] = True  # these stay in the first segment and the last
        for step in np.argsort(-share, kind="stable")[: np.count_nonzero(share)]:
            segment = farthest[step]
            nearer = step + np.argsort(self._square[step : step + 2, segment], kind="stable")
            free = nearer[~has_moved[nearer]][:1]
            choice[free], has_moved[free] = segment, True
        return choice

    @cached_property
    def _square(self) -> FloatArray:
        """The samples' squared distances from the segments, shape (N, m) [m^2]."""
        return _squared_distances(self.tool, self.points[:-1], self.points[1:])

    @cached_property
    def _along(self) -> FloatArray:
        """How far along the path the reference points are, shape (m+1,) [m]."""
        return arc_lengths(self.points)

    def _square_from_lines(self) -> FloatArray:
        """Return squared distances of segments from the lines between samples, (N-1, m) [m^2].

        To the ends of either: no more is needed where one of both is short.
        """
        from_points = _squared_distances(self.points, self.tool[:-1], self.tool[1:]).T
        from_samples = np.minimum(self._square[:-1], self._square[1:])
        return np.minimum(from_samples, np.minimum(from_points[:, :-1], from_points[:, 1:]))

    def _left_out(self, choice: IntArray) -> tuple[IntArray, FloatArray]:
        """Return of the segments that short cuts leave out the farthest, and how far off it is.

        Returns:
            For every step between two samples, both of shape (N-1,): the segment, and its distance
            in radii from the line between them; 0 where none is left out that counts.
        """
        farthest, share = np.zeros(len(choice) - 1, dtype=np.int64), np.zeros(len(choice) - 1)
        left_out = self._along[choice[1:]] - self._along[choice[:-1] + 1]
        moved = np.linalg.norm(np.diff(self.tool, axis=0), axis=1)
        own = np.sqrt(self._square[np.arange(len(choice)), choice]) / self.radius[choice]
        beside = np.maximum(own[:-1], own[1:])
        several = np.diff(choice) > 1
        asked = np.concatenate([[0], np.cumsum(self.is_asked)])
        leaves_asked = several & (asked[choice[1:]] > asked[choice[:-1] + 1])
        for step in np.flatnonzero((several & (left_out > moved)) | leaves_asked):
            segments = np.arange(choice[step] + 1, choice[step + 1])
            line = self.tool[step : step + 2]
            between = self.points[segments[0] : segments[-1] + 2]
            from_line = _squared_distances(between, line[:1], line[1:])[:, 0]
            square = np.minimum(from_line[:-1], from_line[1:])
            square = np.minimum(square, self._square[step : step + 2, segments].min(axis=0))
            away = np.sqrt(square) / self.radius[segments]
            worst = int(away.argmax())
            segment, distance = segments[worst], away[worst]
            is_short_cut = left_out[step] > moved[step] + _SHORT_CUT * self.radius[segment]
            is_far = distance > 1 or distance > max(_FAR, _FARTHER * beside[step])
            if is_short_cut and is_far:
                farthest[step], share[step] = segment, distance
            elif leaves_asked[step]:
                away[~self.is_asked[segments]] = 0.0
                worst = int(away.argmax())
                farthest[step], share[step] = segments[worst], max(away[worst], _LEAST_SHARE)
        return farthest, share


def ordered_choice_paying(cost: FloatArray, passing: FloatArray) -> IntArray:
    """Return the cheapest ordered choice if what is left out between two samples has a price.

    Args:
        cost: As in `ordered_choice`.
        passing: What a choice costs if it lies between those of a sample and the next, shape
            (N-1, m).

    Returns:
        The choices, shape (N,).
    """
    cost = cost.copy()
    cost[0, 1:] = cost[-1, :-1] = np.inf
    count, choices = cost.shape
    best, every = cost[0], np.arange(choices)
    origin = np.empty((count - 1, choices), dtype=np.int64)
    for step, paid in enumerate(np.cumsum(passing, axis=1)):
        left = best - paid  # from j to k > j it takes paid[k - 1] - paid[j]
        least = np.minimum.accumulate(left)
        cheapest = np.maximum.accumulate(np.where(left <= least, every, 0))
        onward = np.concatenate([[np.inf], (least + paid)[:-1]])
        moves = onward < best
        origin[step] = np.where(moves, np.concatenate([[0], cheapest[:-1]]), every)
        best = np.where(moves, onward, best) + cost[step + 1]
    choice = np.full(count, choices - 1)
    for step in range(count - 2, -1, -1):
        choice[step] = origin[step, choice[step + 1]]
    return choice


def _squared_distances(points: FloatArray, begin: FloatArray, end: FloatArray) -> FloatArray:
    """Return the squared distances of points (N, 3) to segments (m, 3): (N, m), to rounding.

    By products of matrices, as there may be a million pairs.
    """
    origin = begin.mean(axis=0)
    points, begin, axis = points - origin, begin - origin, end - begin
    squared_length = np.einsum("mi,mi->m", axis, axis)
    along = points @ axis.T - np.einsum("mi,mi->m", begin, axis)
    share = np.clip(along / np.maximum(squared_length, _NO_SQUARE), 0.0, 1.0)
    square = np.einsum("ni,ni->n", points, points)[:, None] - 2 * points @ begin.T
    square += np.einsum("mi,mi->m", begin, begin) - share * (2 * along - share * squared_length)
    return np.maximum(square, 0.0)
