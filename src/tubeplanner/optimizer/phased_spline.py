"""PhasedSpline: cubic B-splines over phases of tube segments, native and NumPy basis."""

from ctypes import c_int64
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.native.library import Doubles, Integers, native_function
from tubeplanner.trajectory.polynomials import BSpline, basis_functions

# ---- Native cubic splines: weights, derivatives by switching times, values.
#
# Knots are given as samples are: by phase and fraction of it, the end included. Every function
# returns None without the native library.

Knots: TypeAlias = tuple[IntArray, FloatArray]
SamplePosition: TypeAlias = tuple[IntArray, FloatArray, IntArray]

_PLACES = (Doubles, c_int64, Integers, Doubles, c_int64, Integers, Doubles, Integers)
_weights = native_function("cubic_weights", *_PLACES, Doubles)
_by_switching = native_function(
    "cubic_by_switching", *_PLACES, c_int64, Doubles, c_int64, Doubles, Integers
)
_values = native_function("cubic_values", *3 * (c_int64,), Doubles, Integers, Doubles, Doubles)


def cubic_weights(
    switching_times: FloatArray, knots: Knots, samples: SamplePosition
) -> FloatArray | None:
    """Return the weights of four control points in position and derivatives, shape (4, N, 4).

    Args:
        switching_times: Ends of the phases, shape (m+1,).
        knots: Phases and fractions of the M+1 knots, the end included.
        samples: Phases, fractions and knot intervals of N samples.
    """
    if _weights is None:
        return None
    count = len(samples[0])
    weights = np.empty((4, count, 4))
    _weights(switching_times, len(knots[0]) - 1, *knots, count, *samples, weights)
    return weights


def cubic_by_switching(
    switching_times: FloatArray,
    knots: Knots,
    samples: SamplePosition,
    control: FloatArray,
    switches: int,
) -> tuple[FloatArray, IntArray] | None:
    """Return the derivatives of positions and their derivatives by inner switching times.

    Args:
        switching_times: As for `cubic_weights`.
        knots: As for `cubic_weights`.
        samples: As for `cubic_weights`.
        control: Control points, shape (K, n).
        switches: Number G of the inner switching times.

    Returns:
        Shape (G, 4, N, n), and the range of switching times that move each sample: the first and
        the one after the last, shape (N, 2).
    """
    if _by_switching is None:
        return None
    count, joints, control = len(samples[0]), control.shape[1], np.ascontiguousarray(control)
    changes = np.zeros((switches, 4, count, joints))
    ranges = np.empty((count, 2), dtype=np.int64)
    positions = (switching_times, len(knots[0]) - 1, *knots, count, *samples)
    _by_switching(*positions, joints, control, switches, changes, ranges)
    return changes, ranges


def cubic_values(weights: FloatArray, first: IntArray, control: FloatArray) -> FloatArray | None:
    """Return the weighted sums of control points, shape (orders, N, n).

    Args:
        weights: Of four control points at each of N samples, shape (orders, N, 4).
        first: The first of the four, shape (N,).
        control: Control points, shape (K, n).
    """
    if _values is None:
        return None
    orders, count = weights.shape[:2]
    control = np.ascontiguousarray(control)
    values = np.empty((orders, count, control.shape[1]))
    own = (np.ascontiguousarray(weights), np.ascontiguousarray(first), control)
    _values(orders, count, control.shape[1], *own, values)
    return values


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
    """N points on a spline at fixed fractions of their phases.

    Attributes:
        phase: Shape (N,).
        fraction: From 0 to 1 within the phase, shape (N,).
        interval: Index of the knot interval over all phases, shape (N,).
    """

    phase: IntArray
    fraction: FloatArray
    interval: IntArray

    @property
    def first(self) -> IntArray:
        """The first of the four control points that count, shape (N,)."""
        return self.interval

    def basis(self, grid: "KnotGrid", switching_times: FloatArray) -> FloatArray:
        """Return the weights of four control points in position and derivatives, (4, N, 4)."""
        weights = None
        if not np.iscomplexobj(switching_times):
            weights = cubic_weights(switching_times, grid.positions, self.positions)
        return self._by_recursion(grid, switching_times) if weights is None else weights

    @cached_property
    def positions(self) -> SamplePosition:
        """Phases, fractions and knot intervals, for functions of the native library."""
        return self.phase, self.fraction, self.interval

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
    """The knots of a spline over phases.

    Attributes:
        fractions: Per phase, the knots' fractions of it, from 0 to 1, both included.
        runs: The tube's segments of every phase; one each if not given.
        is_fixed: Whether switching times are fixed.
    """

    fractions: tuple[FloatArray, ...]
    runs: tuple[range, ...] = ()
    is_fixed: bool = False

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
    def positions(self) -> Knots:
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

    Attributes:
        count: Number K of control points of the spline.
    """

    count: int

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


def basis_by_switching(
    evaluation_points: EvaluationPoints, grid: KnotGrid, switching_times: FloatArray
) -> FloatArray:
    """Return the weights' derivatives by the switching times that may move, (m-1, orders, N, 4).

    By complex steps, which subtract nothing: exact to rounding (Squire & Trapp, "Using complex
    variables to estimate derivatives of real functions", 1998).
    """
    steps = switching_times + 1j * _IMAGINARY_STEP * np.eye(len(switching_times))
    columns = range(1, grid.switch_count + 1)
    derivatives = [evaluation_points.basis(grid, steps[column]).imag for column in columns]
    if not derivatives:
        return np.zeros((0, *evaluation_points.basis(grid, switching_times).shape))
    return np.stack(derivatives) / _IMAGINARY_STEP


@dataclass(frozen=True, eq=False)
class PhasedSpline:
    """A spline over phases with its control points, without a duration.

    Attributes:
        grid: The knots.
        switching_times: Ends of the phases in time x, from 0 to 1, shape (m+1,).
        control_points: Shape (K, n).
    """

    grid: KnotGrid
    switching_times: FloatArray
    control_points: FloatArray

    def end_directions(self, samples: Samples, slow: FloatArray) -> FloatArray:
        """Return the signs of the velocities of joints near start and goal, shape (N, n).

        The sign holds while the control points of the velocity have one sign, up to the first that
        is not slow; where they reverse before, in the first knot interval alone, and in the last.

        Args:
            samples: N samples; nan at samples farther inside.
            slow: Largest velocity of slow joints, shape (n,) [rad or m per unit of x].
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
