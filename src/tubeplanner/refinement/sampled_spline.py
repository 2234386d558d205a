"""A spline at samples, and how it changes with its control points and switching times."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.native.spline_basis import cubic_by_switching, cubic_values
from tubeplanner.native.spline_rows import SplineChange, chained_rows
from tubeplanner.refinement.phased_spline import (
    DEGREE,
    EvaluationPoints,
    KnotGrid,
    PhasedSpline,
    Samples,
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

    @property
    def by_switching(self) -> FloatArray:
        """Derivatives of `by_x` by the inner switching times, shape (m-1, orders, N, n)."""
        return self.changes.by_switching

    @cached_property
    def changes(self) -> SplineChange:
        """How the spline changes with control points and switching times."""
        spline, points = self.spline, self.evaluation_points
        grid, times, control = spline.grid, spline.switching_times, spline.control_points
        found = None
        if isinstance(points, Samples):
            found = cubic_by_switching(
                times, grid.places, points.places, control, grid.switch_count
            )
        if found is not None:
            return SplineChange(self.basis, *found)
        basis = basis_by_switching(points, grid, times)
        switches, orders, count, _ = basis.shape
        weights = basis.reshape(switches * orders, count, DEGREE + 1)
        by_switching = _values(weights, points.first, control)
        by_switching = by_switching.reshape(switches, orders, count, control.shape[1])
        return SplineChange(self.basis, by_switching, None)

    def change(self, control: FloatArray, switching: FloatArray) -> FloatArray:
        """Return how positions change with a step, to first order, shape (N, n).

        Args:
            control: Change of the control points, shape (K, n).
            switching: Change of the inner switching times, shape (m-1,).
        """
        change: FloatArray = _values(self.basis[:1], self.first, control)[0]
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
        quantities, joints = next(iter(by_path.values())).shape[1:]
        which = np.arange(len(self.first))[samples]
        entry = np.arange(len(which) * quantities)
        found = chained_rows(self.changes, by_path, np.repeat(which, quantities), entry)
        if found is None:
            return self._chained(by_path, samples)
        control, switching = found
        return (
            control.reshape(len(which), quantities, DEGREE + 1, joints),
            switching.reshape(len(which), quantities, len(self.by_switching)),
        )

    def _chained(
        self, by_path: Mapping[int, FloatArray], samples: IntArray | slice
    ) -> tuple[FloatArray, FloatArray]:
        orders = list(by_path)
        by_state = np.stack([by_path[order] for order in orders])
        basis, by_switching = self.basis[orders], self.by_switching[:, orders]
        control = np.einsum("onr,onij->nirj", basis[:, samples], by_state)
        switching = np.einsum("gonj,onij->nig", by_switching[:, :, samples], by_state)
        return control, switching


def sampled(spline: PhasedSpline, evaluation_points: EvaluationPoints) -> SampledSpline:
    """Return a spline at some points."""
    basis = _basis(spline.grid, evaluation_points, spline.switching_times.tobytes())
    by_x = _values(basis, evaluation_points.first, spline.control_points)
    return SampledSpline(spline, evaluation_points, basis, by_x)


@lru_cache(maxsize=8)  # switching times often stay where they are; those of one phase always do
def _basis(
    grid: KnotGrid, evaluation_points: EvaluationPoints, switching_times: bytes
) -> FloatArray:
    return evaluation_points.basis(grid, np.frombuffer(switching_times).copy())


def _values(basis: FloatArray, first: IntArray, control_points: FloatArray) -> FloatArray:
    """Return what weights (orders, N, 4) of control points give, shape (orders, N, n)."""
    found = cubic_values(basis, first, control_points)
    if found is not None:
        return found
    taken = control_points[first[:, None] + np.arange(DEGREE + 1)]
    values: FloatArray = np.matmul(basis[:, :, None], taken)[:, :, 0]
    return values
