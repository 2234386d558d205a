"""PhasedSpline: cubic B-splines over phases of tube segments, and their values at samples."""

from collections.abc import Mapping
from ctypes import c_int64
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.native.library import Doubles, Integers, native_function
from tubeplanner.trajectory.polynomials import BSpline, basis_functions

# The library takes knots as samples: by phase and fraction of it, the end included.
_PLACES = (Doubles, c_int64, Integers, Doubles, c_int64, Integers, Doubles, Integers)
_weights = native_function("cubic_weights", *_PLACES, Doubles)
_by_switching = native_function(
    "cubic_by_switching", *_PLACES, c_int64, Doubles, c_int64, Doubles, Integers
)
_values = native_function("cubic_values", *3 * (c_int64,), Doubles, Integers, Doubles, Doubles)
# A spline at samples, and derivatives by its position and its derivatives by x.
CHANGES = (*4 * (c_int64,), Doubles, Doubles, Integers, *4 * (Doubles,))
_chained = native_function("chained_rows", *CHANGES, c_int64, Integers, Integers, Doubles, Doubles)

# ---- Cubic B-splines of joint positions over phases, each in one or more tube segments.
#
# Time x runs from 0 to 1. Phase k lies between the switching times k and k+1; its knots sit at
# fixed fractions of it, as samples do: when a switching time moves, they move with it. Joints are
# C2 everywhere. The first three control points are the start and the last three the goal, so that
# velocity and acceleration vanish exactly at both ends.

DEGREE = 3
# The error of a complex step is in proportion to its square, and no subtraction loses digits.
_IMAGINARY_STEP = 1e-30


@dataclass(frozen=True, eq=False)
class Samples:
    """N points on a spline at fixed fractions of their phases."""

    phase: IntArray  # shape (N,)
    fraction: FloatArray  # from 0 to 1 within the phase, shape (N,)
    interval: IntArray  # index of the knot interval over all phases, shape (N,)

    @property
    def first(self) -> IntArray:
        """The first of the four control points that count, shape (N,)."""
        return self.interval

    def basis(self, grid: "KnotGrid", switching_times: FloatArray) -> FloatArray:
        """Return the weights of four control points in position and derivatives, (4, N, 4)."""
        if _weights is None or np.iscomplexobj(switching_times):
            return self._by_recursion(grid, switching_times)
        weights = np.empty((DEGREE + 1, len(self.phase), DEGREE + 1))
        _weights(*self.places(grid, switching_times), weights)
        return weights

    def places(self, grid: "KnotGrid", switching_times: FloatArray) -> tuple[Any, ...]:
        """Return the library's arguments for knots and samples."""
        own = (len(self.phase), self.phase, self.fraction, self.interval)
        return switching_times, grid.interval_count, *grid.positions, *own

    def and_also(self, other: "Samples") -> "Samples":
        """Return these samples and others."""
        return Samples(
            np.concatenate([self.phase, other.phase]),
            np.concatenate([self.fraction, other.fraction]),
            np.concatenate([self.interval, other.interval]),
        )

    def where(self, keep: IntArray) -> "Samples":
        """Return some of the samples."""
        return Samples(self.phase[keep], self.fraction[keep], self.interval[keep])

    def times_by_switching(self, count: int) -> FloatArray:
        """Return the derivatives of the times by `count` inner switching times, (N, count)."""
        ends = np.arange(1, count + 1)
        before = (self.phase[:, None] == ends) * (1 - self.fraction[:, None])
        after = (self.phase[:, None] == ends - 1) * self.fraction[:, None]
        derivatives: FloatArray = before + after
        return derivatives

    def times(self, switching_times: FloatArray) -> FloatArray:
        """Return the times x of the samples for switching times (m+1,), shape (N,)."""
        widths = np.diff(switching_times)
        times: FloatArray = switching_times[self.phase] + widths[self.phase] * self.fraction
        return times

    def _by_recursion(self, grid: "KnotGrid", switching_times: FloatArray) -> FloatArray:
        """Return the weights by Taylor's formula, exact for cubics, from the knot before."""
        at_knots = _at_knots(grid, switching_times.tobytes(), switching_times.dtype.char)
        value, first, second, third = at_knots[:, self.interval]
        behind = self.times(switching_times) - grid.breakpoints(switching_times)[self.interval]
        behind = behind[:, None]
        weights = np.empty((DEGREE + 1, *value.shape), dtype=value.dtype)
        weights[3] = third
        weights[2] = second + behind * third
        weights[1] = first + behind * (second + behind * third / 2)
        weights[0] = value + behind * (first + behind * (second + behind * third / 3) / 2)
        return weights


@dataclass(frozen=True, eq=False)
class KnotGrid:
    """The knots of a spline over phases."""

    # per phase, the knots' fractions of it, from 0 to 1, both included
    fractions: tuple[FloatArray, ...]
    runs: tuple[range, ...] = ()  # the tube's segments of every phase; one each if not given
    is_fixed: bool = False  # whether switching times are fixed
    # number of knot intervals without those of turns, of which steps are smoothed; None: of all
    usual_count: int | None = None

    def __post_init__(self) -> None:
        if not self.runs:
            runs = tuple(range(k, k + 1) for k in range(len(self.fractions)))
            object.__setattr__(self, "runs", runs)

    @property
    def switch_count(self) -> int:
        """Number of switching times that may move."""
        return 0 if self.is_fixed else len(self.fractions) - 1

    @property
    def interval_count(self) -> int:
        """Number of knot intervals of all phases."""
        return int(self.intervals_of_phases.sum())

    @cached_property
    def intervals_of_phases(self) -> IntArray:
        """Number of knot intervals of every phase, shape (m,)."""
        return np.array([len(fraction) - 1 for fraction in self.fractions])

    @property
    def control_point_count(self) -> int:
        """Number K of control points."""
        return self.interval_count + DEGREE

    def breakpoints(self, switching_times: FloatArray) -> FloatArray:
        """Return all knots, the end knots once, for switching times (m+1,)."""
        phase, fraction = (positions[:-1] for positions in self.positions)
        begin: FloatArray = switching_times[phase] + np.diff(switching_times)[phase] * fraction
        return np.append(begin, switching_times[-1])

    @cached_property
    def positions(self) -> tuple[IntArray, FloatArray]:
        """Phases and fractions of all knots, the end knots once, (M+1,) each."""
        counts = self.intervals_of_phases
        phase = np.repeat(np.arange(len(counts)), counts)
        fraction = np.concatenate([*(fraction[:-1] for fraction in self.fractions), [1.0]])
        return np.append(phase, len(counts) - 1), fraction

    def knots(self, switching_times: FloatArray) -> FloatArray:
        """Return the clamped knot vector for switching times (m+1,)."""
        inner = self.breakpoints(switching_times)
        return np.concatenate([np.full(DEGREE, inner[0]), inner, np.full(DEGREE, inner[-1])])

    def samples(self, local: FloatArray) -> Samples:
        """Return samples at local times (L,) from 0 to 1 in every knot interval."""
        phase, fraction, interval, count = [], [], [], 0
        for k, fractions in enumerate(self.fractions):
            width = np.diff(fractions)
            fraction.append((fractions[:-1, None] + width[:, None] * local).ravel())
            phase.append(np.full(len(width) * len(local), k))
            interval.append(np.repeat(count + np.arange(len(width)), len(local)))
            count += len(width)
        return Samples(np.concatenate(phase), np.concatenate(fraction), np.concatenate(interval))

    def samples_at(self, switching_times: FloatArray, x: FloatArray) -> Samples:
        """Return samples at times x from 0 to 1, shape (N,)."""
        last = self.interval_count - 1
        interval = np.searchsorted(self.breakpoints(switching_times), x, side="right") - 1
        phase = np.searchsorted(switching_times, x, side="right") - 1
        phase = np.clip(phase, 0, len(switching_times) - 2)
        fraction = (x - switching_times[phase]) / np.diff(switching_times)[phase]
        return Samples(phase, np.clip(fraction, 0.0, 1.0), np.clip(interval, 0, last))

    def phase_ends(self) -> Samples:
        """Return a sample at the end of every phase."""
        count = len(self.fractions)
        return Samples(np.arange(count), np.ones(count), np.cumsum(self.intervals_of_phases) - 1)


def segments_of_pieces(grid: KnotGrid) -> IntArray:
    """Return the tube segment of each knot interval, shape (M,).

    In a chain, the first: its segments have the same conditions on the arm.
    """
    return np.repeat([run.start for run in grid.runs], grid.intervals_of_phases)


@lru_cache(maxsize=32)  # of several kinds of samples, and while switching times stay
def _at_knots(grid: KnotGrid, switching_times: bytes, kind: str) -> FloatArray:
    """Return the weights at the beginning of every knot interval, shape (4, M, 4)."""
    knots = grid.knots(np.frombuffer(switching_times, dtype=kind))
    interval = np.arange(grid.interval_count) + DEGREE
    return basis_functions(knots, DEGREE, interval, knots[interval])


@dataclass(frozen=True, eq=False)
class VelocityHull:
    """The control points of a spline's derivative: the velocity stays in their hull for all x.

    (Piegl & Tiller, "The NURBS Book", 1997, equation 3.8.)
    """

    count: int  # number K of control points of the spline

    @property
    def first(self) -> IntArray:
        """The first of the four control points that count, shape (K-1,)."""
        return np.minimum(np.arange(self.count - 1), self.count - DEGREE - 1)

    def basis(self, grid: "KnotGrid", switching_times: FloatArray) -> FloatArray:
        """Return the weights of four control points, (2, K-1, 4): zero for position."""
        knots, number = grid.knots(switching_times), np.arange(self.count - 1)
        weight = DEGREE / (knots[DEGREE + 1 : -1] - knots[1 : -DEGREE - 1])
        index = number - self.first
        basis = np.zeros((2, self.count - 1, DEGREE + 1), dtype=weight.dtype)
        basis[1, number, index], basis[1, number, index + 1] = -weight, weight
        return basis


EvaluationPoints: TypeAlias = Samples | VelocityHull


@dataclass(frozen=True, eq=False)
class PhasedSpline:
    """A spline over phases with its control points, without a duration."""

    grid: KnotGrid
    switching_times: FloatArray  # ends of the phases in time x, from 0 to 1, shape (m+1,)
    control_points: FloatArray  # shape (K, n)

    def end_directions(self, samples: Samples, slow: FloatArray) -> FloatArray:
        """Return the signs of the velocities of joints near start and goal, (N, n); nan elsewhere.

        The sign holds while the control points of the velocity have one sign, up to the first that
        is not slow, as fast as `slow` (n,) [rad or m per unit of x]; where they reverse before, in
        the first knot interval alone, and in the last.
        """
        knots, last = self.grid.knots(self.switching_times), self.grid.interval_count - 1
        spans = (knots[1 + DEGREE : -1] - knots[1 : -1 - DEGREE]) / DEGREE
        # Without those at both ends, which vanish: the velocity in knot interval k, counted from
        # either end, depends on the first k+1 of the others.
        points = (np.diff(self.control_points, axis=0) / spans[:, None])[DEGREE - 1 : 1 - DEGREE]
        signs = np.full((len(samples.interval), len(slow)), np.nan)
        for step, interval in ((1, samples.interval), (-1, last - samples.interval)):
            velocity = points[::step]
            fast, first = abs(velocity) >= slow, np.sign(velocity[0])
            has_sign = np.logical_and.accumulate(np.sign(velocity) == first, axis=0)
            already = np.logical_or.accumulate(fast, axis=0)
            has_sign[1:] &= ~already[:-1]
            has_sign[1:] &= (has_sign & fast).any(axis=0) | (first == 0)
            is_near = has_sign[np.minimum(interval, len(has_sign) - 1)]
            signs = np.where(is_near, first, signs)
        return signs

    def bspline(self) -> BSpline:
        """Return the spline over time x."""
        return BSpline(self.grid.knots(self.switching_times), self.control_points, DEGREE)


# ---- A spline at samples, and its derivatives by control points and switching times.


@dataclass(frozen=True, eq=False)
class SampledSpline:
    """A spline over phases at N points."""

    spline: PhasedSpline
    evaluation_points: EvaluationPoints  # the N points
    basis: FloatArray  # weights of the four control points that count, shape (orders, N, 4)
    # position and derivatives by x, as many as there are weights, shape (orders, N, n)
    by_x: FloatArray

    @property
    def position(self) -> FloatArray:
        """Positions of the joints, shape (N, n) [rad or m]."""
        return self.by_x[0]

    @property
    def first(self) -> IntArray:
        """The first of the four control points that count, shape (N,)."""
        return self.evaluation_points.first

    @property
    def by_switching(self) -> FloatArray:
        """Derivatives of `by_x` by the inner switching times, shape (m-1, orders, N, n)."""
        return self._changes[0]

    @property
    def switching_range(self) -> IntArray | None:
        """The first switching time that moves a sample and the one after the last, shape (N, 2).

        None: all may.
        """
        return self._changes[1]

    @cached_property
    def _changes(self) -> tuple[FloatArray, IntArray | None]:
        spline, points = self.spline, self.evaluation_points
        grid, times, control = spline.grid, spline.switching_times, spline.control_points
        switches, count, joints = grid.switch_count, len(self.first), control.shape[1]
        if _by_switching is not None and isinstance(points, Samples):
            by_switching = np.zeros((switches, DEGREE + 1, count, joints))
            moved, control = np.empty((count, 2), dtype=np.int64), np.ascontiguousarray(control)
            places = points.places(grid, times)
            _by_switching(*places, joints, control, switches, by_switching, moved)
            return by_switching, moved
        # By complex steps, which subtract nothing: exact to rounding (Squire & Trapp, "Using
        # complex variables to estimate derivatives of real functions", 1998).
        steps = times + 1j * _IMAGINARY_STEP * np.eye(len(times))
        basis = np.zeros((switches, *self.basis.shape))
        for k in range(switches):
            basis[k] = points.basis(grid, steps[k + 1]).imag / _IMAGINARY_STEP
        weights = basis.reshape(switches * len(self.basis), count, DEGREE + 1)
        by_switching = _sums(weights, self.first, control)
        return by_switching.reshape(switches, len(self.basis), count, joints), None

    def change(self, control: FloatArray, switching: FloatArray, order: int = 0) -> FloatArray:
        """Return the change of a derivative of positions by a step to first order, (N, n).

        The step is one of control points, (K, n), and of inner switching times, (m-1,).
        """
        change: FloatArray = _sums(self.basis[order : order + 1], self.first, control)[0]
        if switching.any():
            change += np.einsum("gnj,g->nj", self.by_switching[:, order], switching)
        return change

    def chained(
        self, by_path: Mapping[int, FloatArray], samples: IntArray | slice = slice(None)
    ) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives of I quantities of each sample by a step, by the chain rule.

        By the four control points that count, (N, I, 4, n), and by the inner switching times,
        (N, I, m-1), from those by position (0) and by its derivatives by x, each (N, I, n).
        """
        quantities, joints = next(iter(by_path.values())).shape[1:]
        if _chained is None:
            orders = list(by_path)
            by_state = np.stack([by_path[order] for order in orders])
            basis, by_switching = self.basis[orders], self.by_switching[:, orders]
            return (
                np.einsum("onr,onij->nirj", basis[:, samples], by_state),
                np.einsum("gonj,onij->nig", by_switching[:, :, samples], by_state),
            )
        which = np.repeat(np.arange(len(self.first))[samples], quantities)
        shape, count = (len(which) // quantities, quantities), len(which)
        control = np.empty((*shape, DEGREE + 1, joints))
        switching = np.empty((*shape, len(self.by_switching)))
        _chained(*self.arguments(by_path), count, which, np.arange(count), control, switching)
        return control, switching

    def arguments(
        self, by_path: Mapping[int, FloatArray], units: FloatArray | None = None
    ) -> tuple[Any, ...]:
        """Return the library's arguments for the spline and derivatives as of `chained`.

        Joints count in units (n,) [rad or m]; None: as they are.
        """
        sizes = (len(self.first), self.by_x.shape[2], len(self.basis), len(self.by_switching))
        by_switching = self.by_switching
        if units is not None:
            by_path = {order: by * units for order, by in by_path.items()}
            by_switching = by_switching / units
        by = [np.ascontiguousarray(by_path[k]) if k in by_path else None for k in range(4)]
        return *sizes, self.basis, by_switching, self.switching_range, *by


def sampled(spline: PhasedSpline, evaluation_points: EvaluationPoints) -> SampledSpline:
    """Return a spline at some points."""
    basis = _basis(spline.grid, evaluation_points, spline.switching_times.tobytes())
    by_x = _sums(basis, evaluation_points.first, spline.control_points)
    return SampledSpline(spline, evaluation_points, basis, by_x)


@lru_cache(maxsize=8)  # switching times often stay where they are; those of one phase always do
def _basis(
    grid: KnotGrid, evaluation_points: EvaluationPoints, switching_times: bytes
) -> FloatArray:
    return evaluation_points.basis(grid, np.frombuffer(switching_times).copy())


def _sums(basis: FloatArray, first: IntArray, control_points: FloatArray) -> FloatArray:
    """Return the sums of control points with weights (orders, N, 4), shape (orders, N, n)."""
    if _values is None:
        four = control_points[first[:, None] + np.arange(DEGREE + 1)]
        return np.matmul(basis[:, :, None], four)[:, :, 0]
    (orders, count), joints = basis.shape[:2], control_points.shape[1]
    values = np.empty((orders, count, joints))
    own = (np.ascontiguousarray(each) for each in (basis, first, control_points))
    _values(orders, count, joints, *own, values)
    return values
