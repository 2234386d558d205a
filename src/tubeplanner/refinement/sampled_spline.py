"""A spline at samples, and how it changes with its control points and switching times."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.refinement.phased_spline import (
    DEGREE,
    EvaluationPoints,
    KnotGrid,
    PhasedSpline,
    basis_by_switching,
)


@dataclass(frozen=True, eq=False)
class SampledSpline:
    """A spline over phases at N points.

    Attributes:
        spline: The spline.
        evaluation_points: The N points.
        basis: Weights of the four control points that count, shape (orders, N, 4).
        by_x: Position and derivatives by x, as many as there are weights, shape (orders, N, n).
    """

    spline: PhasedSpline
    evaluation_points: EvaluationPoints
    basis: FloatArray
    by_x: FloatArray

    @property
    def position(self) -> FloatArray:
        """Shape (N, n)."""
        return self.by_x[0]

    @property
    def first(self) -> IntArray:
        """The first of the four control points that count, shape (N,)."""
        return self.evaluation_points.first

    @cached_property
    def by_switching(self) -> FloatArray:
        """Derivatives of `by_x` by the inner switching times, shape (m-1, orders, N, n)."""
        spline = self.spline
        basis = basis_by_switching(self.evaluation_points, spline.grid, spline.switching_times)
        return np.matmul(basis[:, :, :, None], self._taken)[:, :, :, 0]

    def change(self, control: FloatArray, switching: FloatArray) -> FloatArray:
        """Return how positions change with a step, to first order, shape (N, n).

        Args:
            control: Change of the control points, shape (K, n).
            switching: Change of the inner switching times, shape (m-1,).
        """
        taken = control[self.first[:, None] + np.arange(DEGREE + 1)]
        change = np.einsum("nr,nrj->nj", self.basis[0], taken)
        if switching.any():
            change += np.einsum("gnj,g->nj", self.by_switching[:, 0], switching)
        return change

    def chained(
        self, by_path: Mapping[int, FloatArray], samples: IntArray | slice = slice(None)
    ) -> tuple[FloatArray, FloatArray]:
        """Return how I quantities of each sample change with control points and switching times.

        Args:
            by_path: Their derivatives by position (0) and by its derivatives by x, each (N, I, n).
            samples: Whose quantities they are, if not those of all samples.

        Returns:
            By the four control points that count, (N, I, 4, n), and by the inner switching times,
            (N, I, m-1).
        """
        orders = list(by_path)
        by_state = np.stack([by_path[order] for order in orders])
        basis, by_switching = self.basis[orders], self.by_switching[:, orders]
        control = np.einsum("onr,onij->nirj", basis[:, samples], by_state)
        switching = np.einsum("gonj,onij->nig", by_switching[:, :, samples], by_state)
        return control, switching

    @cached_property
    def _taken(self) -> FloatArray:
        return _taken(self.spline, self.evaluation_points)


def sampled(spline: PhasedSpline, evaluation_points: EvaluationPoints) -> SampledSpline:
    """Return a spline at some points."""
    basis = _basis(spline.grid, evaluation_points, spline.switching_times.tobytes())
    by_x = np.matmul(basis[:, :, None], _taken(spline, evaluation_points))[:, :, 0]
    return SampledSpline(spline, evaluation_points, basis, by_x)


@lru_cache(maxsize=8)  # switching times often stay where they are; those of one phase always do
def _basis(
    grid: KnotGrid, evaluation_points: EvaluationPoints, switching_times: bytes
) -> FloatArray:
    return evaluation_points.basis(grid, np.frombuffer(switching_times))


def _taken(spline: PhasedSpline, evaluation_points: EvaluationPoints) -> FloatArray:
    """Return the control points that count at each point, shape (N, 4, n)."""
    taken: FloatArray = spline.control_points[evaluation_points.first[:, None] + np.arange(4)]
    return taken
