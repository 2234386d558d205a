"""SampledSpline: a spline at samples, its derivatives by control points and switching times."""

from collections.abc import Mapping
from ctypes import c_double, c_int64
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.native.library import Doubles, Integers, native_function
from tubeplanner.optimizer.phased_spline import (
    DEGREE,
    EvaluationPoints,
    KnotGrid,
    PhasedSpline,
    Samples,
    basis_by_switching,
    cubic_by_switching,
    cubic_values,
)

# ---- Native rows of linear constraints on a spline's step: chain rule, choice by reach, products.
#
# Every function returns None without the native library.

_ORDERS = range(4)


@dataclass(frozen=True, eq=False)
class SplineChange:
    """Derivatives of a spline at N samples.

    Attributes:
        weights: Of the four control points that count, shape (orders, N, 4).
        by_switching: Derivatives by G switching times, shape (G, orders, N, n).
        switching_range: The range of switching times with derivatives other than zero, the first
            and the one after the last, by sample, shape (N, 2); None: all.
    """

    weights: FloatArray
    by_switching: FloatArray
    switching_range: IntArray | None


_SPLINE = (*4 * (c_int64,), Doubles, Doubles, Integers, *(Doubles for _ in _ORDERS))
_chained = native_function("chained_rows", *_SPLINE, c_int64, Integers, Integers, Doubles, Doubles)
_near = native_function(
    "near_rows",
    *(*_SPLINE, c_int64, c_int64, Doubles, Doubles, c_double),
    *(c_double, Doubles, Integers, Doubles, Doubles),
    returns=c_int64,
)
_reach = native_function(
    "row_reach", c_int64, c_int64, Doubles, c_double, c_int64, Doubles, Doubles, Doubles
)
_used = native_function(
    "used_by_step", *3 * (c_int64,), Integers, *5 * (Doubles,), c_double, Doubles
)


def chained_rows(
    spline: SplineChange, by_path: Mapping[int, FloatArray], sample: IntArray, entry: IntArray
) -> tuple[FloatArray, FloatArray] | None:
    """Return the derivatives of R quantities by control points and switching times.

    Args:
        spline: The spline.
        by_path: The quantities' derivatives by the spline's, by order, each (..., n).
        sample: The sample of each quantity, shape (R,).
        entry: Flat index of each quantity among the derivatives, shape (R,).

    Returns:
        Derivatives by control points, (R, 4, n), and by switching times, (R, G).
    """
    if _chained is None:
        return None
    result = _empty_rows(spline, len(sample))
    positions = (np.ascontiguousarray(sample), np.ascontiguousarray(entry))
    _chained(*_arguments(spline, by_path), len(sample), *positions, *result)
    return result


def near_rows(
    spline: SplineChange,
    by_path: Mapping[int, FloatArray],
    slack: FloatArray,
    signs: tuple[float, ...],
    size: tuple[float, float, FloatArray] | None,
) -> tuple[IntArray, FloatArray, FloatArray] | None:
    """Return the rows that a step can break or that have little slack.

    Args:
        spline: The spline.
        by_path: Derivatives of I quantities of each sample, by order, each (N, I, n).
        slack: Shape (S, N, I).
        signs: Of the quantities on the S sides.
        size: Little slack, and the largest step of control points and of every switching time;
            None: all rows with a finite slack.

    Returns:
        The rows' flat indices in the slack, (R,), and their derivatives by control points,
        (R, 4, n), and by switching times, (R, G).
    """
    if _near is None:
        return None
    control, switching = _empty_rows(spline, slack.size)
    index = np.empty(slack.size, dtype=np.int64)
    little, control_size, switching_size = size or (0.0, 0.0, None)
    slack, sides = np.ascontiguousarray(slack), (len(signs), np.array(signs))
    count = _near(
        *(*_arguments(spline, by_path), slack.shape[2], *sides, slack),
        *(little, control_size, switching_size, index, control, switching),
    )
    return index[:count], control[:count], switching[:count]


def row_reach(
    control: FloatArray, switching: FloatArray, size: tuple[float, FloatArray]
) -> FloatArray | None:
    """Return the largest change of rows (R, 4, n), (R, G) by a step, shape (R,).

    Args:
        control: Derivatives by control points.
        switching: Derivatives by switching times.
        size: Largest step of control points and of every switching time.
    """
    if _reach is None:
        return None
    reach = np.empty(len(control))
    width = control.shape[1] * control.shape[2]
    by_switching = (switching.shape[1], np.ascontiguousarray(switching), size[1])
    _reach(len(control), width, np.ascontiguousarray(control), size[0], *by_switching, reach)
    return reach


def used_by_step(
    first: IntArray,
    rows: tuple[FloatArray, FloatArray, FloatArray],
    step: tuple[FloatArray, FloatArray, float],
) -> FloatArray | None:
    """Return the products of rows and a step, shape (R,).

    Args:
        first: The first of the four control points that count, shape (R,).
        rows: By control points (R, 4, n), switching times (R, G) and the duration (R,).
        step: Of the control points (K, n), the switching times (G,) and the duration.
    """
    if _used is None:
        return None
    used, sizes = np.empty(len(first)), (rows[0].shape[2], rows[1].shape[1])
    parts = [np.ascontiguousarray(part) for part in (*rows, *step[:2])]
    _used(len(first), *sizes, np.ascontiguousarray(first), *parts, step[2], used)
    return used


def _arguments(spline: SplineChange, by_path: Mapping[int, FloatArray]) -> tuple[Any, ...]:
    """Return the library's arguments for a spline and derivatives by the spline's."""
    orders, samples, _ = spline.weights.shape
    switches, joints = spline.by_switching.shape[0], spline.by_switching.shape[3]
    by = [np.ascontiguousarray(by_path[k]) if k in by_path else None for k in _ORDERS]
    own = (spline.weights, spline.by_switching, spline.switching_range)
    return samples, joints, orders, switches, *own, *by


def _empty_rows(spline: SplineChange, count: int) -> tuple[FloatArray, FloatArray]:
    switches, joints = spline.by_switching.shape[0], spline.by_switching.shape[3]
    return np.empty((count, 4, joints)), np.empty((count, switches))


# ---- A spline at samples, and its derivatives by control points and switching times.


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
        """Derivatives by control points and switching times."""
        spline, points = self.spline, self.evaluation_points
        grid, times, control = spline.grid, spline.switching_times, spline.control_points
        if isinstance(points, Samples):
            arguments = (times, grid.positions, points.positions, control, grid.switch_count)
            result = cubic_by_switching(*arguments)
            if result is not None:
                return SplineChange(self.basis, *result)
        basis = basis_by_switching(points, grid, times)
        switches, orders, count, _ = basis.shape
        weights = basis.reshape(switches * orders, count, DEGREE + 1)
        by_switching = _values(weights, points.first, control)
        by_switching = by_switching.reshape(switches, orders, count, control.shape[1])
        return SplineChange(self.basis, by_switching, None)

    def change(self, control: FloatArray, switching: FloatArray) -> FloatArray:
        """Return the change of positions by a step, to first order, shape (N, n).

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
        """Return the derivatives of I quantities of each sample by a step, by the chain rule.

        Args:
            by_path: Their derivatives by position (0) and by its derivatives by x, each (N, I, n).
            samples: The samples of the quantities, if not all.

        Returns:
            By the four control points that count, (N, I, 4, n), and by the inner switching times,
            (N, I, m-1).
        """
        quantities, joints = next(iter(by_path.values())).shape[1:]
        which = np.arange(len(self.first))[samples]
        entry = np.arange(len(which) * quantities)
        rows = chained_rows(self.changes, by_path, np.repeat(which, quantities), entry)
        if rows is None:
            return self._chained(by_path, samples)
        control, switching = rows
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
    """Return the sums of control points with weights (orders, N, 4), shape (orders, N, n)."""
    values = cubic_values(basis, first, control_points)
    if values is None:
        four = control_points[first[:, None] + np.arange(DEGREE + 1)]
        values = np.matmul(basis[:, :, None], four)[:, :, 0]
    return values
