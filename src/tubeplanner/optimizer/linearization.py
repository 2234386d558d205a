"""Linearization: the constraints of a leg to first order.

Rows that are far away and tangent planes of regions are added where a step turns out to break
them, so that what a step predicts is inside the convex set that the regions are, not inside a few
planes about it.
"""

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass
from itertools import starmap

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.optimizer.control_variables import ControlVariables, LegShape
from tubeplanner.optimizer.region_constraints import Planes
from tubeplanner.optimizer.rows import Rows, used_by_step
from tubeplanner.optimizer.spline_constraints import Iterate
from tubeplanner.optimizer.step_block import Block, Bounds, Quadratic, SparseRows, Step, sparse_rows

BROKEN = 1e-4
# Planes with less slack after a step [radii] are given to the next program at once.
_BINDING = 0.005


@dataclass(frozen=True, eq=False)
class Given:
    """What a program gets at once.

    Attributes:
        rows: Whether it gets each row, shape (R,).
        planes: Of every kind of regions.
        ignored: The samples of every kind of regions whose planes it never gets, shape (N,).
    """

    rows: BoolArray
    planes: tuple[Planes, ...]
    ignored: tuple[BoolArray, ...]


@dataclass(frozen=True, eq=False)
class _Part:
    """R rows of a program.

    Attributes:
        rows: The rows.
        is_elastic: 1 for those that may be violated, else 0, shape (R,).
        limit: Numbers of their limits, shape (R,).
        index: Their own numbers, -1 for planes, shape (R,).
        slack: Returns their slack (R,), given that of all rows and by how much vectors are bent.
    """

    rows: SparseRows
    is_elastic: FloatArray
    limit: IntArray
    index: IntArray
    slack: Callable[[FloatArray, Sequence[FloatArray]], FloatArray]


@dataclass(frozen=True, eq=False)
class Slack:
    """What slack a program's rows have.

    Attributes:
        rows: Of all rows, shape (R,).
        bends: By how much the vectors of every kind of regions are bent.
    """

    rows: FloatArray
    bends: list[FloatArray]


class Linearization:
    """The constraints at a leg's trajectory to first order.

    Attributes:
        penalty: Weight of the elastic constraints.
    """

    def __init__(
        self,
        current: Iterate,
        rows: tuple[Rows, FloatArray],
        given: Given,
        variables: ControlVariables,
        bounds: Bounds,
        quadratic: Quadratic,
        penalty: float,
    ) -> None:
        """Set it up.

        Args:
            current: The trajectory.
            rows: All constraints but regions, and 1 for those that may be violated, else 0.
            given: Those that the first program gets.
            variables: What may change.
            bounds: Where a step must stay.
            quadratic: Its cost.
            penalty: Weight of the elastic constraints.
        """
        self._current, self._variables, self._bounds = current, variables, bounds
        self._rows, self._is_elastic = rows
        self._near, self._active = given.rows, given.rows.copy()
        self._planes, self._ignored = given.planes, given.ignored
        self._quadratic, self.penalty = quadratic, penalty
        self._parts: list[_Part] = []
        self._give(np.flatnonzero(given.rows))
        for kind, planes in enumerate(given.planes):
            self._give_planes(kind, planes)

    @property
    def added(self) -> IntArray:
        """Numbers of the rows that were not near but turned out to be broken."""
        return self._rows.index[self._active & ~self._near]

    def weighted(self, weight: float) -> "Linearization":
        """Return the linearization with all costs times a weight."""
        weighted = copy(self)
        weighted._quadratic = self._quadratic.weighted(weight)
        weighted.penalty = self.penalty * weight
        return weighted

    @property
    def shape(self) -> LegShape:
        """How much may change."""
        configurations, joints = self._bounds.lower.shape
        grid, switches = self._current.spline.grid, len(self._bounds.switching)
        intervals = grid.intervals_of_phases
        beside = np.maximum(intervals[:-1], intervals[1:])[:switches]
        behind = self._variables.before(np.cumsum(intervals)[:switches])
        return LegShape(configurations, joints, switches, beside, behind)

    @property
    def plain(self) -> Slack:
        """The slack at the trajectory."""
        bends = [np.zeros_like(regions.vector) for regions in self._current.regions]
        return Slack(self._rows.slack, bends)

    def block(self, slack: Slack, extra: FloatArray | float = 0.0) -> Block:
        """Return what a program is given, with a slack; its rows may have some more."""
        rows = [part.rows for part in self._parts]
        found = [part.slack(slack.rows, slack.bends) for part in self._parts]
        given = np.concatenate([np.zeros(0), *found]) + extra
        return Block(rows, given, self._bounds, self._quadratic, self.penalty)

    @property
    def elastic_rows(self) -> FloatArray:
        """1 for a program's rows that may be violated, else 0."""
        return np.concatenate([np.zeros(0), *(part.is_elastic for part in self._parts)])

    def limits(self) -> tuple[IntArray, IntArray]:
        """Return the limits of a program's rows, and their own numbers, -1 for planes."""
        limit, index = (
            np.concatenate([getattr(part, name) for part in self._parts])
            for name in ("limit", "index")
        )
        return limit, index

    def binding(self, step: Step) -> tuple[Planes, ...]:
        """Return the planes, of every kind of regions, that a step ends at."""
        return tuple(
            planes.where(regions.slack(planes, vector - regions.vector) < _BINDING - step.elastic)
            for regions, planes, vector in zip(
                self._current.regions, self._planes, self._after(step), strict=True
            )
        )

    def absorb(self, step: Step) -> bool:
        """Add rows and planes that a step breaks; return whether there are some."""
        broken = np.flatnonzero((self._slack_after(step) < -BROKEN) & ~self._active)
        self._give(broken)
        return self._add_planes(self._after(step), step.elastic) or len(broken) > 0

    def corrected(self, step: Step, trial: Iterate, slack: FloatArray) -> Slack:
        """Return the slack that makes up for what a first step left out: curvature.

        Planes are added where that step led outside.

        Args:
            step: The first step.
            trial: Where it led.
            slack: The rows' slack there, by their numbers.
        """
        rows = self._rows
        left = self._slack_after(step) - self._is_elastic * step.elastic
        bends = [
            there.vector - vector
            for there, vector in zip(trial.regions, self._after(step), strict=True)
        ]
        self._add_planes([regions.vector for regions in trial.regions], step.elastic)
        return Slack(rows.slack + slack[rows.index] - left, bends)

    def absorb_bent(self, step: Step, slack: Slack, elastic: float) -> bool:
        """Add planes that a corrected step breaks; return whether there are some.

        Args:
            step: That step.
            slack: What it was corrected by.
            elastic: How far outside vectors may be.
        """
        after = zip(self._after(step), slack.bends, strict=True)
        return self._add_planes([vector + bend for vector, bend in after], elastic)

    def _give(self, which: IntArray) -> None:
        """Give rows to the next program."""
        if len(which):
            self._active[which] = True
            own, is_elastic = self._rows.where(which), self._is_elastic[which]
            self._add(own, is_elastic, lambda slack, _: slack[which])

    def _give_planes(self, kind: int, planes: Planes) -> None:
        """Give planes of a kind of regions to the next program."""
        if len(planes):
            regions, is_elastic = self._current.regions[kind], np.ones(len(planes))
            own = regions.rows(planes)
            self._add(own, is_elastic, lambda _, bends: regions.slack(planes, bends[kind]))

    def _add(
        self,
        rows: Rows,
        is_elastic: FloatArray,
        slack: Callable[[FloatArray, Sequence[FloatArray]], FloatArray],
    ) -> None:
        own = sparse_rows(rows, is_elastic, self._variables.column, len(self._bounds.lower))
        self._parts.append(_Part(own, is_elastic, rows.limit, rows.index, slack))

    def _add_planes(self, vectors: list[FloatArray], elastic: float) -> bool:
        """Add tangent planes where vectors are outside; return whether some are."""
        found = []
        for kind, (regions, vector) in enumerate(zip(self._current.regions, vectors, strict=True)):
            planes = regions.planes_where_outside(vector, elastic)
            fresh = planes.where(~self._ignored[kind][planes.sample])
            self._give_planes(kind, fresh)
            found.append(fresh)
        self._planes = tuple(starmap(Planes.and_also, zip(self._planes, found, strict=True)))
        return any(len(planes) for planes in found)

    def _after(self, step: Step) -> list[FloatArray]:
        """Return the regions' vectors after a step, to first order."""
        control = self._variables.change(step.control)
        return [regions.after(control, step.switching) for regions in self._current.regions]

    def _slack_after(self, step: Step) -> FloatArray:
        """Return the slack that a step leaves to all rows, to first order."""
        rows = self._rows
        change = self._variables.change(step.control)
        used = used_by_step(rows, change, step.switching, step.duration)
        slack: FloatArray = rows.slack - used + self._is_elastic * step.elastic
        return slack
