"""Linearization: the constraints of a leg to first order.

Far rows and tangent planes of regions are added where a step breaks them, so that its prediction is
inside the convex regions themselves, not inside a few planes about them.
"""

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import starmap

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.optimizer.control_variables import ControlVariables, LegShape
from tubeplanner.optimizer.region_constraints import Planes
from tubeplanner.optimizer.rows import Rows
from tubeplanner.optimizer.spline_constraints import Iterate
from tubeplanner.optimizer.step_program import (
    Block,
    Bounds,
    Quadratic,
    SparseRows,
    Step,
    sparse_rows,
)

BROKEN = 1e-4


@dataclass(frozen=True, eq=False)
class Slack:
    """The slack of all rows and planes."""

    rows: FloatArray  # of all rows, shape (R,)
    bends: list[FloatArray]  # corrections of the vectors of every kind of regions, shape (N, 3)


class Linearization:
    """The constraints at a leg's trajectory to first order.

    Attributes:
        penalty: Weight of the elastic constraints.
    """

    def __init__(
        self,
        current: Iterate,
        rows: tuple[Rows, FloatArray],
        near: BoolArray,
        planes: tuple[Planes, ...],
        ignored: tuple[BoolArray, ...],
        variables: ControlVariables,
        bounds: Bounds,
        quadratic: Quadratic,
        penalty: float,
    ) -> None:
        """Take the constraints and the cost of a step.

        Args:
            current: The trajectory.
            rows: All constraints but regions, and 1 for rows that may be violated, else 0.
            near: Whether the first program has each row, shape (R,).
            planes: Of the first program, of every kind of regions.
            ignored: Of every kind, whether no program has planes of a sample, shape (N,).
            variables: The variable control points.
            bounds: Of the step.
            quadratic: Cost of the step.
            penalty: Weight of the elastic constraints.
        """
        self._current, self._variables, self._bounds = current, variables, bounds
        self._rows, self._is_elastic = rows
        self._near, self._active = near, near.copy()
        self._planes, self._ignored = planes, ignored
        self._quadratic, self.penalty = quadratic, penalty
        self._parts: list[_Part] = []
        self._give(np.flatnonzero(near))
        for kind, own in enumerate(planes):
            self._give_planes(kind, own)

    @property
    def added(self) -> IntArray:
        """Numbers of the rows that steps broke, without the rows of the first program."""
        return self._rows.index[self._active & ~self._near]

    def weighted(self, weight: float) -> "Linearization":
        """Return the linearization with all costs times a weight."""
        weighted = copy(self)
        weighted._quadratic = self._quadratic.weighted(weight)
        weighted.penalty = self.penalty * weight
        return weighted

    @property
    def shape(self) -> LegShape:
        """Numbers of the leg's variables."""
        configurations, joints = self._bounds.lower.shape
        grid, switches = self._current.spline.grid, len(self._bounds.switching)
        intervals = grid.intervals_of_phases
        beside = np.maximum(intervals[:-1], intervals[1:])[:switches]
        behind = self._variables.before(np.cumsum(intervals)[:switches])
        return LegShape(configurations, joints, switches, beside, behind)

    @property
    def plain(self) -> Slack:
        """The slack at the trajectory."""
        bends = [np.zeros_like(regions.vector) for regions in self._current.convex]
        return Slack(self._rows.slack, bends)

    def block(self, slack: Slack, extra: FloatArray | float = 0.0) -> Block:
        """Return the leg's block of a program, with a slack and some extra slack of its rows."""
        rows = [part.rows for part in self._parts]
        by_part = [part.slack(slack.rows, slack.bends) for part in self._parts]
        total = np.concatenate([np.zeros(0), *by_part]) + extra
        return Block(rows, total, self._bounds, self._quadratic, self.penalty)

    def gained(self, rows: FloatArray, vectors: list[FloatArray]) -> FloatArray:
        """Return the slack that the program's rows gain, shape (R,).

        Args:
            rows: Gain of all rows, by their numbers.
            vectors: Changes of the vectors of every kind of regions.
        """
        plain = self.plain
        more = Slack(plain.rows + rows[self._rows.index], vectors)
        return self.block(more).slack - self.block(plain).slack

    @property
    def elastic_rows(self) -> FloatArray:
        """1 for rows of the program that may be violated, else 0."""
        return np.concatenate([np.zeros(0), *(part.is_elastic for part in self._parts)])

    def limits(self) -> tuple[IntArray, IntArray]:
        """Return the numbers of limits of the program's rows, and of the rows, -1 for planes."""
        limit = np.concatenate([part.limit for part in self._parts])
        return limit, np.concatenate([part.index for part in self._parts])

    def binding(self, step: Step) -> tuple[Planes, ...]:
        """Return the planes, of every kind of regions, that bind a step."""
        each = zip(self._current.convex, self._planes, self._after(step), strict=True)
        return tuple(
            planes.where(
                regions.slack(planes, vector - regions.vector)
                < regions.binding - regions.room(step)
            )
            for regions, planes, vector in each
        )

    def absorb(self, step: Step) -> bool:
        """Add rows and planes that a step breaks; return True if there are some."""
        broken = np.flatnonzero((self._slack_after(step) < -BROKEN) & ~self._active)
        self._give(broken)
        return self._add_planes(self._after(step), step) or len(broken) > 0

    def corrected(self, step: Step, trial: Iterate, slack: FloatArray) -> Slack:
        """Return the slack corrected for curvature, the error of a first step's prediction.

        Planes are added where the trial after the step is outside; `slack` is that of the rows
        there, by their numbers.
        """
        rows = self._rows
        predicted = self._slack_after(step) - self._is_elastic * step.elastic
        run = (self._current.duration, step.duration)
        vectors = [regions.vector_in(*run) for regions in trial.convex]
        bends = [there - here for there, here in zip(vectors, self._after(step), strict=True)]
        self._add_planes(vectors, step, are_alone=True)
        return Slack(rows.slack + slack[rows.index] - predicted, bends)

    def absorb_bent(self, step: Step, slack: Slack, elastic: float) -> bool:
        """Add planes that a corrected step breaks; return True if there are some."""
        after = zip(self._after(step), slack.bends, strict=True)
        vectors = [vector + bend for vector, bend in after]
        return self._add_planes(vectors, replace(step, elastic=elastic), are_alone=True)

    def _give(self, which: IntArray) -> None:
        if len(which):
            self._active[which] = True
            own, is_elastic = self._rows.where(which), self._is_elastic[which]
            self._add(own, is_elastic, lambda slack, _: slack[which])

    def _give_planes(self, kind: int, planes: Planes) -> None:
        if len(planes):
            regions = self._current.convex[kind]
            is_elastic = np.full(len(planes), 0.0 if regions.is_speed else 1.0)
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

    def _add_planes(
        self, vectors: list[FloatArray], step: Step, *, are_alone: bool = False
    ) -> bool:
        """Add tangent planes where a step does not allow vectors; return True if there are some.

        In corrections planes of chains hold the segment that a sample has moved to alone: on the
        inner side of a bend, a plane that holds two segments leaves out their sagitta.
        """
        added = []
        for kind, (regions, vector) in enumerate(zip(self._current.convex, vectors, strict=True)):
            room = regions.room(step)
            planes = regions.planes_where_outside(vector, room, are_alone=are_alone)
            fresh = planes.where(~self._ignored[kind][planes.sample])
            self._give_planes(kind, fresh)
            added.append(fresh)
        self._planes = tuple(starmap(Planes.and_also, zip(self._planes, added, strict=True)))
        return any(len(planes) for planes in added)

    def _after(self, step: Step) -> list[FloatArray]:
        """Return the regions' vectors after a step, to first order."""
        change = (self._variables.change(step.control), step.switching, step.duration)
        return [regions.after(*change) for regions in self._current.convex]

    def _slack_after(self, step: Step) -> FloatArray:
        """Return the slack of all rows after a step, to first order."""
        rows = self._rows
        change = self._variables.change(step.control)
        used = rows.used_by_step(change, step.switching, step.duration)
        slack: FloatArray = rows.slack - used + self._is_elastic * step.elastic
        return slack


@dataclass(frozen=True, eq=False)
class _Part:
    """R rows of a program, attributes as of `Rows`; planes have the index -1."""

    rows: SparseRows
    is_elastic: FloatArray  # 1 for rows that may be violated, else 0, shape (R,)
    limit: IntArray
    index: IntArray
    # returns their slack (R,) from `Slack.rows` and `Slack.bends`
    slack: Callable[[FloatArray, Sequence[FloatArray]], FloatArray]
