"""The convex quadratic part of a step's cost: smoothing, proximity and damping."""

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.refinement.control_variables import FIXED, ControlVariables
from tubeplanner.refinement.phased_spline import KnotGrid
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

    def quadratic(self, control_points: FloatArray, damping: float = 0.0) -> Quadratic:
        """Return the cost at control points (K, n), squared rates weighted with a damping."""
        value = self._still + damping * self._damped
        hessian = SymmetricEntries(self._row, self._column, value, self._size)
        bends = np.diff(control_points, len(_THIRD) - 1, axis=0)
        by_point = np.zeros_like(control_points)
        for place, weight in enumerate(_THIRD):
            by_point[place : place + len(bends)] += weight * bends
        gradient = np.zeros(self._size - DURATION_AND_ELASTIC)
        by_variable = self._weight * self._variables.collected(by_point)
        gradient[: by_variable.size] = by_variable.ravel()
        return Quadratic(hessian, gradient)

    def squared_rates(self, step: FloatArray) -> float:
        """Return the integral of the squared rates of a step (F, n), run in one second.

        Nearly: knots are taken as evenly spaced.
        """
        rates = np.diff(self._variables.change(step), axis=0)
        return self._intervals * float(np.vdot(rates, rates))


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
