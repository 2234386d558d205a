"""Objective of a step: duration or measures; smoothing, proximity and damping."""

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.optimizer.control_variables import FIXED, ControlVariables
from tubeplanner.optimizer.motion_measures import POINTS, IntervalMotion, MeasureModel, Weighted
from tubeplanner.optimizer.phased_spline import KnotGrid, PhasedSpline
from tubeplanner.optimizer.rows import MERIT_TOLERANCE
from tubeplanner.optimizer.spline_constraints import Iterate
from tubeplanner.optimizer.step_program import Quadratic, Step, SymmetricEntries, merged_entries

# ---- The convex quadratic part of a step's cost: smoothing, proximity and damping.

# Weights of third differences, against wiggles of joints without effect, and of the step.
_SMOOTHING = 1e-5
_PROXIMITY = 1e-3
# Of switching times, eta and the elastic variable: next to none.
_OTHERS = 1e-9
DURATION_AND_ELASTIC = 2
_FIRST, _THIRD = (-1.0, 1.0), (-1.0, 3.0, -3.0, 1.0)


class StepCost:
    """The quadratic costs of steps on one knot grid."""

    def __init__(self, variables: ControlVariables, grid: KnotGrid, units: FloatArray) -> None:
        """Find the pattern of the Hessian. Joints are measured in units (n,) [rad or m]."""
        self._variables, self._intervals, self._units = variables, grid.interval_count, units
        joints = len(units)
        # Knots of turns are closer than usual: by their number, wide intervals would be stiff.
        usual = grid.usual_count or grid.interval_count
        self._weight = 2 * _SMOOTHING * usual**5 / 250_000
        count, others = len(variables.lower), grid.switch_count + DURATION_AND_ELASTIC
        alone = np.arange(count)
        smoothing = _squared_differences(variables.column, _THIRD)
        rates = _squared_differences(variables.column, _FIRST)
        row, column = np.hstack([smoothing[0], rates[0], [alone, alone]])
        nothing = np.zeros(len(smoothing[1]))
        still = np.concatenate([self._weight * smoothing[1], 0 * rates[1], 0 * alone + _PROXIMITY])
        damped = np.concatenate([nothing, self._intervals * rates[1], 0.0 * alone])
        row, column, index = merged_entries(row, column, count)
        rest = count * joints + np.arange(others)
        self._row, self._column = (
            np.append(np.add.outer(which * joints, np.arange(joints)), rest)
            for which in (row, column)
        )
        self._still, self._damped = (
            np.append(
                np.outer(np.bincount(index, value, len(row)), units**-2.0), np.full(others, other)
            )
            for value, other in ((still, _OTHERS), (damped, 0.0))
        )
        self._size = count * joints + others
        self._switches, self._first_switch = grid.switch_count, count * joints

    def quadratic(self, spline: PhasedSpline, damping: float = 0.0) -> Quadratic:
        """Return the cost of steps from a spline, squared rates weighted with a damping."""
        value = self._still + damping * self._damped
        hessian = SymmetricEntries(self._row, self._column, value, self._size)
        if damping and self._switches:
            # Squared rates from changing widths of phases.
            weight = damping * self._squared_rates(spline.control_points)
            inverse = weight / np.diff(spline.switching_times)
            own = self._first_switch + np.arange(self._switches)
            row = np.concatenate([own, own[:-1], own[1:]])
            column = np.concatenate([own, own[1:], own[:-1]])
            value = np.concatenate([inverse[:-1] + inverse[1:], -inverse[1:-1], -inverse[1:-1]])
            hessian = hessian.plus(SymmetricEntries(row, column, value, self._size))
        control_points = spline.control_points
        bends = np.diff(control_points, len(_THIRD) - 1, axis=0)
        by_point = np.zeros_like(control_points)
        for index, weight in enumerate(_THIRD):
            by_point[index : index + len(bends)] += weight * bends
        gradient = np.zeros(self._size - DURATION_AND_ELASTIC)
        by_variable = self._weight * self._variables.collected(by_point) / self._units**2
        gradient[: by_variable.size] = by_variable.ravel()
        return Quadratic(hessian, gradient)

    def squared_rates(self, spline: PhasedSpline, step: FloatArray, switching: FloatArray) -> float:
        """Return the integral of the squared rates of a step (F, n), (S,) of a spline, run in 1 s.

        About: knots count as evenly spaced, and so does the motion where phases change widths.
        """
        rates = self._squared_rates(self._variables.change(step))
        if self._switches:
            changes = np.diff(switching, prepend=0.0, append=0.0)
            rates += self._squared_rates(spline.control_points) * float(
                (changes**2 / np.diff(spline.switching_times)).sum()
            )
        return rates

    def _squared_rates(self, control_points: FloatArray) -> float:
        rates = np.diff(control_points, axis=0) / self._units
        return self._intervals * float(np.vdot(rates, rates))


def _squared_differences(
    column: IntArray, weights: tuple[float, ...]
) -> tuple[IntArray, FloatArray]:
    """Return the sum of squared differences with weights of consecutive control points.

    As entries over the variables: rows and columns (2, E), and values (E,); places may repeat.
    """
    order = len(weights)
    which = column[np.arange(len(column) - order + 1)[:, None] + np.arange(order)]
    row, other = np.broadcast_arrays(which[:, :, None], which[:, None, :])
    value = np.broadcast_to(np.outer(weights, weights), row.shape)
    both = (row != FIXED) & (other != FIXED)
    return np.stack([row[both], other[both]]), value[both]


# ---- Objectives of steps: by default, a shorter duration.


class StepObjective:
    """The gain that steps aim at: here a shorter duration, the relative change of T^2.

    Attributes:
        run_in: The duration in which splines are run [s]; None: the least that limits allow.
        least_duration_step: The smallest eta of a step.
        ignored_excess: The part of an iterate's excess without a penalty.
    """

    run_in: float | None = None
    least_duration_step = -0.5
    ignored_excess: float = MERIT_TOLERANCE

    def cost(
        self, current: Iterate, variables: ControlVariables, regularization: Quadratic
    ) -> Quadratic:
        """Return the cost of a step: eta and the regularization, which all objectives have."""
        return regularization

    def predicted_gain(self, current: Iterate, step: Step) -> float:
        """Return the gain of a step by the last `cost`, as a fraction of T^2."""
        return -step.duration

    def gain(self, current: Iterate, trial: Iterate) -> float:
        """Return the gain of a trial, as a fraction of T^2."""
        return 1 - trial.squared_duration / current.squared_duration

    def after(self, step: Step) -> None:
        """Record a solution of the step's program."""


class IntervalBlocks:
    """The sum of blocks of all knot intervals over the variables of a step, in one pattern."""

    def __init__(
        self, variables: ControlVariables, intervals: int, points: int, switches: int
    ) -> None:
        """Find the pattern of M intervals with P control points each and S moving switching times.

        An interval has the control points from that with its number on.
        """
        free, n = variables.lower.shape
        # The last intervals have fewer control points.
        column = np.append(variables.column, np.full(intervals + points, FIXED))
        which = column[np.arange(intervals)[:, None] + np.arange(points)]
        index = which[:, :, None] * n + np.arange(n)
        index[which == FIXED] = FIXED
        self._index = index.reshape(intervals, -1)
        self._switching = free * n + np.arange(switches)
        self._size = free * n + switches + DURATION_AND_ELASTIC
        own = np.broadcast_to(self._switching, (intervals, switches))
        both = np.concatenate([self._index, own], axis=1)
        row, other = np.broadcast_arrays(both[:, :, None], both[:, None, :])
        self._is_free = (row != FIXED) & (other != FIXED)
        self._row, self._column, self._entry = merged_entries(
            row[self._is_free], other[self._is_free], self._size
        )

    def matrix(self, blocks: FloatArray, mixed: FloatArray, corner: FloatArray) -> SymmetricEntries:
        """Return the sum of symmetric blocks.

        By the control points of every interval, (M, P n, P n), by these and switching times,
        (M, P n, S), and by the switching times alone, of all intervals, (S, S).
        """
        shared = np.broadcast_to(corner / len(blocks), (len(blocks), *corner.shape))
        below = np.concatenate([np.swapaxes(mixed, 1, 2), shared], axis=2)
        whole = np.concatenate([np.concatenate([blocks, mixed], axis=2), below], axis=1)
        data = np.bincount(self._entry, whole[self._is_free], len(self._row)).astype(np.float64)
        return SymmetricEntries(self._row, self._column, data, self._size)

    def vector(self, by_control: FloatArray, by_switching: FloatArray) -> FloatArray:
        """Return the sum of vectors (M, P n) and (S,), without duration and elastic variable."""
        is_free = self._index != FIXED
        size = self._size - DURATION_AND_ELASTIC
        total = np.bincount(self._index[is_free], by_control[is_free], size).astype(float)
        total[self._switching] += by_switching
        return total


# ---- The objective in a given duration: smaller measures.
#
# The measures' logarithms are added, so that scales do not matter.

_NOTHING = 1e-12  # beside measures that may vanish
# First and least weight of the sum of logarithms, in fractions of T^2: halved if steps would make
# the motion longer than the given duration.
_FIRST_WORTH, _MIN_WORTH = 5e-3, 5e-4
_LONGER = 1e-4


class MeasuredObjective(StepObjective):
    """Smaller measures in a given duration."""

    run_in: float
    least_duration_step = 0.0
    ignored_excess = 0.0  # gains are large here, beside what curvature brings

    def __init__(self, measures: Weighted, run_in: float) -> None:
        self.run_in = run_in
        self._worth = _FIRST_WORTH
        self._weights = np.array([weight for weight, _ in measures])
        self._measures = tuple(measure for _, measure in measures)
        self._blocks: IntervalBlocks | None = None
        self._last: tuple[Iterate, Quadratic] | None = None
        self._measured: list[tuple[Iterate, IntervalMotion, FloatArray]] = []

    def value(self, current: Iterate) -> float:
        """Return the weighted sum of the measures' logarithms."""
        return float(np.log(self._measure(current)[1]) @ self._weights)

    def cost(
        self, current: Iterate, variables: ControlVariables, regularization: Quadratic
    ) -> Quadratic:
        """Return the cost: Gauss-Newton quadratics of the measures, and eta."""
        motion, totals = self._measure(current)
        fractions = (self._weights / totals).tolist()
        each = zip(self._measures, fractions, strict=True)
        model = MeasureModel.stacked([own.model(motion, fraction) for own, fraction in each])
        control, switching = model.control, model.switching
        weighted = control * model.curvature[:, :, None]
        blocks = np.swapaxes(control, 1, 2) @ weighted
        mixed = np.swapaxes(weighted, 1, 2) @ switching
        corner = np.einsum("mri,mr,mrk->ik", switching, model.curvature, switching)
        gradient = np.einsum("mrv,mr->mv", control, model.slope)
        by_switching = np.einsum("mri,mr->i", switching, model.slope)
        if self._blocks is None:
            intervals, _, switches = switching.shape
            self._blocks = IntervalBlocks(variables, intervals, POINTS, switches)
        quadratic = Quadratic(
            self._blocks.matrix(blocks, mixed, corner), self._blocks.vector(gradient, by_switching)
        )
        own = quadratic.times(self._worth)
        self._last = current, own
        hessian = own.hessian.plus(regularization.hessian)
        return Quadratic(hessian, own.gradient + regularization.gradient)

    def predicted_gain(self, current: Iterate, step: Step) -> float:
        """Return the gain of a step by the last `cost`."""
        assert self._last is not None
        change = np.concatenate([step.control.ravel(), step.switching])
        padded = np.append(change, [0.0, 0.0])
        own = self._last[1]
        less = -(own.gradient @ change) - padded @ own.hessian.product(padded) / 2
        return float(less + self._longer(current) - max(step.duration, 0.0))

    def gain(self, current: Iterate, trial: Iterate) -> float:
        """Return the weighted reduction of the value, less the rise of the excess of T^2."""
        if not np.isfinite(trial.squared_duration):
            return -np.inf
        longer = self._longer(trial) - self._longer(current)
        return self._worth * (self.value(current) - self.value(trial)) - longer

    def after(self, step: Step) -> None:
        """Halve the weight of the measures if the step would exceed the duration."""
        if step.duration > _LONGER:
            self._worth = max(self._worth / 2, _MIN_WORTH)

    def _longer(self, iterate: Iterate) -> float:
        """Return the excess of the least T^2 over the duration's, as a fraction of that."""
        return max(iterate.squared_duration / self.run_in**2 - 1, 0.0)

    def _measure(self, current: Iterate) -> tuple[IntervalMotion, FloatArray]:
        """Return a motion in the duration, and its measures."""
        for iterate, motion, totals in self._measured:
            if iterate is current:
                return motion, totals
        motion = IntervalMotion(current, self.run_in)
        totals = np.array([measure.total(motion) for measure in self._measures]) + _NOTHING
        self._measured = [*self._measured[-2:], (current, motion, totals)]
        return motion, totals
