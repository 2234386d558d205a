"""Which variables of the program of all legs are each leg's: legs share those of tied ends.

In the order of time, as the solver likes it: the configurations of all legs; then, as they count
everywhere, the one in which a cycle closes, the switching times, every leg's eta and its elastic
variable.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tubeplanner.arrays import IntArray


class LegShape(NamedTuple):
    """What may change in a leg.

    Attributes:
        configurations: Number F of variable configurations.
        joints: Number n of joints.
        switches: Number of switching times.
    """

    configurations: int
    joints: int
    switches: int


def shared_columns(legs: Sequence[LegShape], is_tied: Sequence[bool]) -> tuple[IntArray, ...]:
    """Return the program's variable for all that may change in every leg, shape (V,) each.

    A leg counts its configurations first, then switching times, eta, elastic.

    Args:
        legs: The legs.
        is_tied: Whether each leg's last configuration is the first one of the next, after the last
            leg that of the first.
    """
    count, numbers = 0, []
    for k, leg in enumerate(legs):
        is_behind = k > 0 and is_tied[k - 1]
        numbers.append(np.arange(leg.configurations) + count - is_behind)
        count = int(numbers[-1][-1]) + 1 if leg.configurations else count
    if is_tied[-1]:
        numbers = _closed(numbers)
        count -= 1
    joints = legs[0].joints
    first = count * joints
    columns = []
    switches = np.cumsum([0] + [leg.switches for leg in legs])
    others = first + int(switches[-1])
    for k, (leg, own) in enumerate(zip(legs, numbers, strict=True)):
        controls = np.add.outer(own * joints, np.arange(joints)).ravel()
        switching = first + switches[k] + np.arange(leg.switches)
        ends = [others + k, others + len(legs) + k]
        columns.append(np.concatenate([controls, switching, ends]))
    return tuple(columns)


def _closed(numbers: Sequence[IntArray]) -> list[IntArray]:
    """Return configurations' numbers, the first one being the last one, and that the last."""
    last = int(numbers[-1][-1])
    closed = [own - 1 for own in numbers]
    closed[0][0] = closed[-1][-1] = last - 1
    return closed
