"""The convex quadratic part of a step's cost: smoothing, proximity and damping."""

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.refinement.control_variables import FIXED, ControlVariables
from tubeplanner.refinement.phased_spline import KnotGrid, PhasedSpline
from tubeplanner.refinement.step_block import Quadratic
from tubeplanner.refinement.symmetric_entries import SymmetricEntries, merged_entries

# Weights of third differences, against wiggles of joints that do not matter, and of the step.
_SMOOTHING = 1e-5
_PROXIMITY = 1e-3
# Of switching times, eta and the elastic variable: next to none.
_OTHERS = 1e-9
DURATION_AND_ELASTIC = 2
_FIRST, _THIRD = (-1.0, 1.0), (-1.0, 3.0, -3.0, 1.0)


class StepCost:
    """The quadratic costs of steps on one knot grid."""

    def __init__(self, variables: ControlVariables, grid: KnotGrid, joints: int) -> None:
        """Prepare it.

        Args:
            variables: What may change.
            grid: The splines' knots.
            joints: How many there are.
        """
        self._variables, self._intervals = variables, grid.interval_count
        self._weight = 2 * _SMOOTHING * grid.interval_count**5 / 250_000
        count, others = len(variables.lower), grid.switch_count + DURATION_AND_ELASTIC
        alone = np.arange(count)
        smoothing = _squared_differences(variables.column, _THIRD)
        rates = _squared_differences(variables.column, _FIRST)
        row, column = np.hstack([smoothing[0], rates[0], [alone, alone]])
        nothing = np.zeros(len(smoothing[1]))
        still = np.concatenate([self._weight * smoothing[1], 0 * rates[1], 0 * alone + _PROXIMITY])
        damped = np.concatenate([nothing, self._intervals * rates[1], 0.0 * alone])
        row, column, place = merged_entries(row, column, count)
        rest = count * joints + np.arange(others)
        self._row, self._column = (
            np.append(np.add.outer(which * joints, np.arange(joints)), rest)
            for which in (row, column)
        )
        self._still, self._damped = (
            np.append(
                np.repeat(np.bincount(place, value, len(row)), joints), np.full(others, other)
            )
            for value, other in ((still, _OTHERS), (damped, 0.0))
        )
        self._size = count * joints + others
        # Of every phase, how its width changes with the switching times at its ends.
        self._switches, self._first_switch = grid.switch_count, count * joints

    def quadratic(self, spline: PhasedSpline, damping: float = 0.0) -> Quadratic:
        """Return the cost at a spline, squared rates weighted with a damping."""
        value = self._still + damping * self._damped
        hessian = SymmetricEntries(self._row, self._column, value, self._size)
        if damping and self._switches:
            hessian = hessian.plus(self._of_widths(spline, damping))
        control_points = spline.control_points
        bends = np.diff(control_points, len(_THIRD) - 1, axis=0)
        by_point = np.zeros_like(control_points)
        for place, weight in enumerate(_THIRD):
            by_point[place : place + len(bends)] += weight * bends
        gradient = np.zeros(self._size - DURATION_AND_ELASTIC)
        by_variable = self._weight * self._variables.collected(by_point)
        gradient[: by_variable.size] = by_variable.ravel()
        return Quadratic(hessian, gradient)

    def squared_rates(self, spline: PhasedSpline, step: FloatArray, switching: FloatArray) -> float:
        """Return the integral of the squared rates of a step, run in one second.

        Nearly: knots are taken as evenly spaced, and so is the motion where phases change widths.

        Args:
            spline: Before.
            step: Of the variables, shape (F, n).
            switching: Of the switching times, shape (S,).
        """
        found = self._squared_rates(self._variables.change(step))
        if self._switches:
            changes = np.diff(switching, prepend=0.0, append=0.0)
            found += self._squared_rates(spline.control_points) * float(
                (changes**2 / np.diff(spline.switching_times)).sum()
            )
        return found

    def _squared_rates(self, control_points: FloatArray) -> float:
        rates = np.diff(control_points, axis=0)
        return self._intervals * float(np.vdot(rates, rates))

    def _of_widths(self, spline: PhasedSpline, damping: float) -> SymmetricEntries:
        """Return the squared rates of a motion whose phases change their widths, weighted."""
        weight = damping * self._squared_rates(spline.control_points)
        inverse = weight / np.diff(spline.switching_times)
        own = self._first_switch + np.arange(self._switches)
        row = np.concatenate([own, own[:-1], own[1:]])
        column = np.concatenate([own, own[1:], own[:-1]])
        value = np.concatenate([inverse[:-1] + inverse[1:], -inverse[1:-1], -inverse[1:-1]])
        return SymmetricEntries(row, column, value, self._size)


def _squared_differences(
    column: IntArray, weights: tuple[float, ...]
) -> tuple[IntArray, FloatArray]:
    """Return the sum of squared differences of control points, as entries over the variables.

    Args:
        column: The variable of every control point, -1 where it is fixed, shape (K,).
        weights: Of consecutive control points in a difference.

    Returns:
        Rows and columns (2, E), and values (E,); they may repeat.
    """
    order = len(weights)
    which = column[np.arange(len(column) - order + 1)[:, None] + np.arange(order)]
    row, other = np.broadcast_arrays(which[:, :, None], which[:, None, :])
    value = np.broadcast_to(np.outer(weights, weights), row.shape)
    both = (row != FIXED) & (other != FIXED)
    return np.stack([row[both], other[both]]), value[both]
