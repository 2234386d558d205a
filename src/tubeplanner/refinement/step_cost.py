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
        third = _differences(count, 3)
        weight = 2 * _SMOOTHING * grid.interval_count**5 / 250_000
        self._smoothing = (selection.T @ (third.T @ third)).tocsr() * weight
        first = _differences(count, 1) @ selection
        self._rates = (first.T @ first).tocsr() * grid.interval_count
        inner = self._smoothing @ selection + sparse.identity(selection.shape[1]) * _PROXIMITY
        # Real and imaginary: two matrices with one pattern, so that their sum costs no search.
        both = sparse.kron(inner + 1j * self._rates, sparse.identity(joints))
        others = len(grid.shares) - 1 + 2
        parts = [both, sparse.identity(others) * _OTHERS]
        self._both = sparse.block_diag(parts, format="csc")

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


def _differences(count: int, order: int) -> sparse.csr_matrix:
    """Return the matrix of differences of an order of so many points."""
    steps = sparse.identity(count, format="csr")
    for _ in range(order):
        steps = steps[1:] - steps[:-1]
    return steps
