"""Which limit binds when: why a trajectory is not faster there, or takes no other way."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.constraints.closest_pairs import ClosestPairs
from tubeplanner.constraints.limit_use import (
    POSITION,
    ROTATION,
    TUBE,
    LimitUse,
    LimitUses,
)

TOOL, LINKS = "tool", "links"
NONE = -1
# From this share on a limit binds; of a joint's range nearer to its end: two turns are long.
_BINDS = 0.98
_BINDS_IN_RANGE = 0.998
# Solids this much farther apart than they must be use nothing of that limit [m], so that they are
# in each other's way where a millimetre is left.
_FAR = 0.05
_OF_THE_SHAPE = (POSITION, TUBE, ROTATION)


@dataclass(frozen=True)
class Span:
    """A stretch of time in which one limit binds.

    Attributes:
        kind: Of the limit.
        begin: When it begins to [s].
        end: When it ends [s].
    """

    kind: str
    begin: float
    end: float


@dataclass(frozen=True, eq=False)
class BindingRow:
    """Which limit of a joint, of the tool or of the links binds, at N samples.

    Attributes:
        name: Of the joint, "tool" or "links".
        time: Shape (N,) [s].
        kinds: The kinds of limits that it has.
        which: Index of the kind that binds, of several that of which most is used; -1: none,
            shape (N,).
    """

    name: str
    time: FloatArray
    kinds: tuple[str, ...]
    which: IntArray

    @property
    def spans(self) -> list[Span]:
        """The stretches in which a limit binds, each half way to the samples beside it."""
        changes = np.flatnonzero(np.diff(self.which)) + 1
        middles = (self.time[changes - 1] + self.time[changes]) / 2
        ends = [float(self.time[0]), *middles.tolist(), float(self.time[-1])]
        which = self.which[[0, *changes.tolist()]].tolist()
        return [
            Span(self.kinds[k], begin, end)
            for k, (begin, end) in zip(which, pairwise(ends), strict=True)
            if k != NONE and end > begin
        ]


def binding_rows(
    joint_names: Sequence[str], uses: LimitUses, closest: Sequence[ClosestPairs]
) -> list[BindingRow]:
    """Return which limits bind: a row per joint, one of the tool, and one of the links.

    Points of links whose speed is limited count as links. No row of what has no limit.

    Args:
        joint_names: The joints, in their order.
        uses: How much of its limits a trajectory uses, at N samples.
        closest: Its closest pairs at the times of these samples.
    """
    rows: dict[str, list[LimitUse]] = {name: [] for name in (*joint_names, TOOL, LINKS)}
    for use in (*uses.uses, *map(clearance_use, closest)):
        is_tool = use.name == TOOL
        owner = TOOL if is_tool else LINKS if use.joint is None else joint_names[use.joint]
        rows[owner].append(use)
    time = uses.samples.time
    return [_row(name, time, own) for name, own in rows.items() if own]


def clearance_use(closest: ClosestPairs) -> LimitUse:
    """Return how much of a required distance is used: 1 where it is just kept, 0 from 5 cm on."""
    share = np.maximum(1 - closest.margin / _FAR, 0.0)
    return LimitUse(closest.kind, LINKS, share)


def bound_share(uses: LimitUses, of: Iterable[LimitUse] | None = None) -> float:
    """Return in which share of the time some limit binds, from 0 to 1.

    Args:
        uses: How much of its limits a trajectory uses.
        of: Which of them count; None: all on the speed, without those of position, tube and
            rotation, which shape the way.
    """
    if of is None:
        of = [use for use in uses.uses if use.kind not in _OF_THE_SHAPE]
    binds = np.zeros(len(uses.samples.time), dtype=bool)
    for use in of:
        binds |= _excess(use) >= 0
    halves = np.diff(uses.samples.time) / 2
    duration: FloatArray = np.append(halves, 0.0) + np.append(0.0, halves)
    return float(duration[binds].sum() / duration.sum())


def _excess(use: LimitUse) -> FloatArray:
    """Return how far beyond the share from which on it binds a limit is used, shape (N,)."""
    return use.share - (_BINDS_IN_RANGE if use.kind == POSITION else _BINDS)


def _row(name: str, time: FloatArray, uses: Sequence[LimitUse]) -> BindingRow:
    share = np.array([use.share for use in uses])
    binding = np.array([_excess(use) >= 0 for use in uses])
    which = np.where(binding, share, -np.inf).argmax(axis=0)
    which = np.where(binding.any(axis=0), which, NONE)
    return BindingRow(name, time, tuple(use.kind for use in uses), which)
