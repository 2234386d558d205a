"""Which variables of the program of all legs are each leg's: legs share those of tied ends.

In the order of time, as the solver likes it: the configurations of all legs, and between them the
switching times between short phases, which count only near there. Then, as they count everywhere,
the configuration in which a cycle closes, the other switching times, every leg's eta and its
elastic variable.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tubeplanner.arrays import BoolArray, IntArray

# What a row of a cubic counts: so many configurations, if no switching time stands between them.
_CONFIGURATIONS = 4
# Else those of the own phase, and so many more; it counts the switching times that are nearer than
# so many intervals on either side.
_BESIDE, _NEAR = 2, 3


class LegShape(NamedTuple):
    """What may change in a leg.

    Attributes:
        configurations: Number F of variable configurations.
        joints: Number n of joints.
        switches: Number S of switching times.
        intervals: Of the phases beside each switching time, the number of knot intervals of the
            longer one, shape (S,); None: every switching time counts everywhere.
        behind: How many configurations are before each switching time, shape (S,); likewise.
    """

    configurations: int
    joints: int
    switches: int
    intervals: IntArray | None = None
    behind: IntArray | None = None

    @property
    def is_among(self) -> BoolArray:
        """Whether each switching time is to stand among the configurations, shape (S,)."""
        if self.intervals is None:
            return np.zeros(self.switches, dtype=bool)
        longest = min([0, *np.unique(self.intervals).tolist()], key=self._reach)
        return self.intervals <= longest

    def _reach(self, longest: int) -> int:
        """Return how many variables each one is coupled with: time goes with its square.

        Args:
            longest: Switching times beside phases of at most so many intervals stand among the
                configurations.
        """
        assert self.intervals is not None
        others = int((self.intervals > longest).sum())
        if longest == 0:
            return _CONFIGURATIONS * self.joints + others
        return (max(longest, _NEAR) + _BESIDE) * self.joints + 2 * _NEAR + others


def shared_columns(legs: Sequence[LegShape], is_tied: Sequence[bool]) -> tuple[IntArray, ...]:
    """Return the program's variable for all that may change in every leg, shape (V,) each.

    A leg counts its configurations first, then switching times, eta, elastic.

    Args:
        legs: The legs.
        is_tied: Whether each leg's last configuration is the first one of the next, after the last
            leg that of the first.
    """
    numbers, count = _numbers(legs, is_tied)
    joints = legs[0].joints
    each = zip(legs, numbers, strict=True)
    before = np.concatenate([_before(leg, own, count) for leg, own in each])
    sequence = np.argsort(before, kind="stable")
    switching = before * joints
    switching[sequence] += np.arange(len(sequence))
    by_leg = np.split(switching, np.cumsum([leg.switches for leg in legs])[:-1])
    others = count * joints + len(switching)
    columns = []
    for k, (own, switches) in enumerate(zip(numbers, by_leg, strict=True)):
        begin = own * joints + np.searchsorted(before[sequence], own, side="right")
        controls = np.add.outer(begin, np.arange(joints)).ravel()
        ends = [others + k, others + len(legs) + k]
        columns.append(np.concatenate([controls, switches, ends]))
    return tuple(columns)


def _numbers(legs: Sequence[LegShape], is_tied: Sequence[bool]) -> tuple[list[IntArray], int]:
    """Return the numbers of every leg's configurations among all, and how many there are."""
    count, numbers = 0, []
    for k, leg in enumerate(legs):
        is_behind = k > 0 and is_tied[k - 1]
        numbers.append(np.arange(leg.configurations) + count - is_behind)
        count = int(numbers[-1][-1]) + 1 if leg.configurations else count
    return (_closed(numbers), count - 1) if is_tied[-1] else (numbers, count)


def _before(leg: LegShape, numbers: IntArray, count: int) -> IntArray:
    """Return the configurations that switching times stand before; the count: behind all, (S,)."""
    before = np.full(leg.switches, count)
    if leg.behind is not None and leg.configurations:
        following = np.append(numbers, numbers[-1] + 1)
        before[leg.is_among] = following[leg.behind[leg.is_among]]
    return before


def _closed(numbers: Sequence[IntArray]) -> list[IntArray]:
    """Return configurations' numbers, the first one being the last one, and that the last."""
    last = int(numbers[-1][-1])
    closed = [own - 1 for own in numbers]
    closed[0][0] = closed[-1][-1] = last - 1
    return closed
