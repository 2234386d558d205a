"""The convex quadratic part of a step's cost: smoothing, proximity and damping."""

import numpy as np
from scipy import sparse

from tubeplanner.arrays import FloatArray
from tubeplanner.refinement.control_variables import ControlVariables
from tubeplanner.refinement.linear_program import Quadratic
from tubeplanner.refinement.phased_spline import KnotGrid

# Weights of third differences, against wiggles of joints that do not matter, and of the step.
_SMOOTHING = 1e-5
_PROXIMITY = 1e-3
# Of switching times, eta and the elastic variable: next to none.
_OTHERS = 1e-9


class StepCost:
    """The quadratic costs of steps on one knot grid."""

    def __init__(self, variables: ControlVariables, grid: KnotGrid, joints: int) -> None:
        """Prepare it.

        Args:
            variables: What may change.
            grid: The splines' knots.
            joints: How many there are.
        """
        selection, count = variables.selection, grid.control_point_count
        weight = 2 * _SMOOTHING * grid.interval_count**5 / 250_000
        third, first = _differences(count, 3), _differences(count, 1) @ selection
        by_step = third @ selection
        self._smoothing = (by_step.T @ third).tocsr() * weight
        self._rates = (first.T @ first).tocsr() * grid.interval_count
        # Real and imaginary: two matrices with one pattern, so that their sum costs no search.
        both = (by_step.T @ by_step) * weight + 1j * self._rates
        others = len(grid.shares) - 1 + 2
        diagonal = np.repeat([_PROXIMITY, _OTHERS], [selection.shape[1] * joints, others])
        self._both = _for_all_joints(both.tocoo(), joints, diagonal)

    def quadratic(self, control_points: FloatArray, damping: float = 0.0) -> Quadratic:
        """Return the cost at control points (K, n), squared rates weighted with a damping."""
        both = self._both
        data = both.data.real + damping * both.data.imag
        hessian = sparse.csc_matrix((data, both.indices, both.indptr), both.shape)
        gradient: FloatArray = self._smoothing @ control_points
        return Quadratic(hessian, gradient.ravel())

    def squared_rates(self, step: FloatArray) -> float:
        """Return the integral of the squared rates of a step (F, n), run in one second.

        Nearly: knots are taken as evenly spaced.
        """
        return float(np.vdot(step, self._rates @ step))


def _for_all_joints(
    matrix: sparse.coo_matrix, joints: int, diagonal: FloatArray
) -> sparse.csc_matrix:
    """Return the same (F, F) matrix for every joint, joints alternating, plus a diagonal.

    The diagonal, of F times the joints or more, decides the size.
    """
    joint, on_diagonal = np.arange(joints), np.arange(len(diagonal))
    rows, columns = (
        np.append(index[:, None] * joints + joint, on_diagonal)
        for index in (matrix.row, matrix.col)
    )
    data = np.append(np.repeat(matrix.data, joints), diagonal)
    return sparse.csc_matrix((data, (rows, columns)), (len(diagonal), len(diagonal)))


def _differences(count: int, order: int) -> sparse.csr_matrix:
    """Return the matrix of differences of an order of so many points."""
    weights = np.diff(np.eye(order + 1), order, axis=0)
    rows = count - order
    columns = np.arange(rows)[:, None] + np.arange(order + 1)
    ends = np.arange(rows + 1) * (order + 1)
    return sparse.csr_matrix((np.tile(weights[0], rows), columns.ravel(), ends), (rows, count))
