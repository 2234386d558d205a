"""The constraints at a trajectory, to first order, and the steps that keep them.

Rows that are far away and tangent planes of regions are added where a step turns out to break
them, so that what a step predicts is inside the convex set that the regions are, not inside a few
planes about it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import starmap

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.refinement.control_variables import ControlVariables
from tubeplanner.refinement.linear_program import (
    Bounds,
    Quadratic,
    SparseRows,
    Step,
    StepProgram,
    sparse_rows,
)
from tubeplanner.refinement.linear_rows import Rows
from tubeplanner.refinement.phased_spline import DEGREE
from tubeplanner.refinement.region_constraints import Planes
from tubeplanner.refinement.spline_constraints import Iterate

_MAX_ROUNDS, _MAX_CORRECTIONS = 4, 3
BROKEN = 1e-4
# Where elastic rows cost more than this share of their penalty, multipliers say little else: then
# so many times what they are violated by is allowed, or this much.
_SHARE_OF_PENALTY, _SPARE_SHARE, _LEAST_SPARE = 0.5, 2.0, 1e-5
# d ln T^2 by a relative rise of a limit: of a velocity 2 at most. Others are tried with this rise.
_PLAUSIBLE, _RISE = 2.0, 0.1
_TOLERANCE = 1e-4  # of a step, absolute and relative
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


class Linearization:
    """The constraints at a trajectory to first order.

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
        self._program: StepProgram | None = None
        self._parts: list[_Part] = []
        self._has_more = True  # than the last program had
        self._give(np.flatnonzero(given.rows))
        for kind, planes in enumerate(given.planes):
            self._give_planes(kind, planes)

    @property
    def added(self) -> IntArray:
        """Numbers of the rows that were not near but turned out to be broken."""
        return self._rows.index[self._active & ~self._near]

    def costs(self, step: Step, count: int, rise: FloatArray) -> FloatArray:
        """Return what each of so many limits costs, shape (count,).

        By multipliers, which hold for the least change. Where the steps that a limit bars from all
        hardly use it, as next to a start on a tolerance, others bar them at once: where
        multipliers say more than any limit of a speed can cost, a whole rise is tried.

        Args:
            step: The step.
            count: Number of limits.
            rise: What slack a relative rise of its limit adds to each row, by the rows' numbers;
                to planes it adds all.
        """
        limit, index = (
            np.concatenate([getattr(part, name) for part in self._parts])[: len(step.multipliers)]
            for name in ("limit", "index")
        )
        named = limit >= 0
        gained = np.where(index >= 0, rise[index], 1.0)
        costs = np.zeros(count)
        np.add.at(costs, limit[named], np.maximum(step.multipliers * gained, 0.0)[named])
        for k in np.flatnonzero(costs > _PLAUSIBLE):
            risen = self._solved(
                self._rows.slack, self._unbent, extra=_RISE * gained * (limit == k)
            )
            if risen is not None:
                costs[k] = max(step.duration - risen.duration, 0.0) / _RISE
        return costs

    def binding(self, step: Step) -> tuple[Planes, ...]:
        """Return the planes, of every kind of regions, that a step ends at."""
        return tuple(
            planes.where(regions.slack(planes, vector - regions.vector) < _BINDING - step.elastic)
            for regions, planes, vector in zip(
                self._current.regions, self._planes, self._after(step), strict=True
            )
        )

    def solve(self) -> Step | None:
        """Return the step, or None if there is none."""
        bends, step = self._unbent, None
        for _ in range(_MAX_ROUNDS):
            better = self._solved(self._rows.slack, bends)
            if better is None:  # what there was before leaves something to the correction
                break
            step = better
            broken = np.flatnonzero((self._slack_after(step) < -BROKEN) & ~self._active)
            self._give(broken)
            if not self._add_planes(self._after(step), step.elastic) and len(broken) == 0:
                break
        return step

    def solve_exactly(self, tolerance: float) -> Step | None:
        """Return the step to a tolerance, absolute and relative, once it is known what counts.

        Where the solver does not get there, as near as steps are elsewhere. If something stays
        violated, by next to nothing, that much is allowed: else multipliers tell the penalty.
        """
        step = self.solve()
        if step is None:
            return None
        exact = self._solved(self._rows.slack, self._unbent, tolerance) or step
        if self._elastic_cost(exact) < _SHARE_OF_PENALTY * self.penalty:
            return exact
        spare = max(_SPARE_SHARE * exact.elastic, _LEAST_SPARE)
        extra = spare * self._elastic_rows
        return self._solved(self._rows.slack, self._unbent, tolerance, extra) or exact

    def solve_again(self, step: Step, trial: Iterate, slack: FloatArray) -> Step | None:
        """Return the step that is corrected by what a first step left out: curvature.

        Args:
            step: The first step.
            trial: Where it led.
            slack: The rows' slack there, by their numbers.
        """
        rows = self._rows
        left = self._slack_after(step) - self._is_elastic * step.elastic
        slack = rows.slack + slack[rows.index] - left
        bends = [
            there.vector - vector
            for there, vector in zip(trial.regions, self._after(step), strict=True)
        ]
        self._add_planes([regions.vector for regions in trial.regions], step.elastic)
        other = self._solved_again(slack, bends)
        for _ in range(_MAX_CORRECTIONS - 1):
            if other is None:
                break
            after = zip(self._after(other), bends, strict=True)
            if not self._add_planes([vector + bend for vector, bend in after], step.elastic):
                break
            other = self._solved(slack, bends)
        return other

    def _solved(
        self,
        slack: FloatArray,
        bends: list[FloatArray],
        tolerance: float = _TOLERANCE,
        extra: FloatArray | float = 0.0,
    ) -> Step | None:
        """Return the step of the program for rows with some slack, vectors being bent.

        The program's rows have extra slack, if it is given.
        """
        self._has_more = False
        self._program = StepProgram(
            [part.rows for part in self._parts],
            self._given_slack(slack, bends) + extra,
            self._bounds,
            self._quadratic,
            self.penalty,
            tolerance,
        )
        return self._program.solve()

    @property
    def _elastic_rows(self) -> FloatArray:
        """1 for the program's rows that may be violated, else 0."""
        return np.concatenate([np.zeros(0), *(part.is_elastic for part in self._parts)])

    def _elastic_cost(self, step: Step) -> float:
        """Return what all rows that may be violated cost: the penalty, if one of them is."""
        elastic = self._elastic_rows[: len(step.multipliers)]
        return float(abs(step.multipliers * elastic).sum())

    def _solved_again(self, slack: FloatArray, bends: list[FloatArray]) -> Step | None:
        """Return the step of the last program, if nothing was added, for other slack and bends."""
        if self._program is None or self._has_more:
            return self._solved(slack, bends)
        return self._program.solve_again(self._given_slack(slack, bends))

    def _given_slack(self, slack: FloatArray, bends: list[FloatArray]) -> FloatArray:
        """Return the slack of the program's rows."""
        found = [part.slack(slack, bends) for part in self._parts]
        return np.concatenate([np.zeros(0), *found])

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
        self._has_more = True

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

    @property
    def _unbent(self) -> list[FloatArray]:
        return [np.zeros_like(regions.vector) for regions in self._current.regions]

    def _after(self, step: Step) -> list[FloatArray]:
        """Return the regions' vectors after a step, to first order."""
        control = self._variables.change(step.control)
        return [regions.after(control, step.switching) for regions in self._current.regions]

    def _slack_after(self, step: Step) -> FloatArray:
        """Return the slack that a step leaves to all rows, to first order."""
        rows = self._rows
        change = self._variables.change(step.control)
        taken = change[rows.first[:, None] + np.arange(DEGREE + 1)]
        used = np.einsum("rkj,rkj->r", rows.control, taken)
        used += rows.switching @ step.switching + rows.duration * step.duration
        slack: FloatArray = rows.slack - used + self._is_elastic * step.elastic
        return slack
