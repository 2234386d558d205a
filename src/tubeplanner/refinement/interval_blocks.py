"""Sums of blocks, one for every knot interval, over all that a step may change."""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.refinement.control_variables import FIXED, ControlVariables
from tubeplanner.refinement.step_cost import DURATION_AND_ELASTIC
from tubeplanner.refinement.symmetric_entries import SymmetricEntries, merged_entries


class IntervalBlocks:
    """Where blocks go: their pattern is found once."""

    def __init__(
        self, variables: ControlVariables, intervals: int, points: int, switches: int
    ) -> None:
        """Find the pattern.

        Args:
            variables: What may change.
            intervals: How many knot intervals there are: M.
            points: How many control points count in each, from that with its number on: P.
            switches: How many switching times may move: S.
        """
        free, n = variables.lower.shape
        # After the last interval there are fewer control points; nothing depends on others.
        missing = np.full(intervals + points, FIXED)
        column = np.append(variables.column, missing)
        which = column[np.arange(intervals)[:, None] + np.arange(points)]
        place = which[:, :, None] * n + np.arange(n)
        place[which == FIXED] = FIXED
        self._place = place.reshape(intervals, -1)
        self._switching = free * n + np.arange(switches)
        self._size = free * n + switches + DURATION_AND_ELASTIC
        own = np.broadcast_to(self._switching, (intervals, switches))
        both = np.concatenate([self._place, own], axis=1)
        row, other = np.broadcast_arrays(both[:, :, None], both[:, None, :])
        self._known = (row != FIXED) & (other != FIXED)
        self._row, self._column, self._entry = merged_entries(
            row[self._known], other[self._known], self._size
        )

    def matrix(self, blocks: FloatArray, mixed: FloatArray, corner: FloatArray) -> SymmetricEntries:
        """Return the sum of symmetric blocks.

        Args:
            blocks: By the control points of every interval, shape (M, P n, P n).
            mixed: By these and the switching times, shape (M, P n, S).
            corner: By the switching times alone, of all intervals, shape (S, S).
        """
        shared = np.broadcast_to(corner / len(blocks), (len(blocks), *corner.shape))
        below = np.concatenate([np.swapaxes(mixed, 1, 2), shared], axis=2)
        whole = np.concatenate([np.concatenate([blocks, mixed], axis=2), below], axis=1)
        data = np.bincount(self._entry, whole[self._known], len(self._row)).astype(np.float64)
        return SymmetricEntries(self._row, self._column, data, self._size)

    def vector(self, by_control: FloatArray, by_switching: FloatArray) -> FloatArray:
        """Return the sum of vectors, without duration and elastic variable.

        Args:
            by_control: By the control points of every interval, shape (M, P n).
            by_switching: By the switching times, of all intervals, shape (S,).
        """
        known = self._place != FIXED
        size = self._size - DURATION_AND_ELASTIC
        total = np.bincount(self._place[known], by_control[known], size).astype(float)
        total[self._switching] += by_switching
        return total
