"""Shortening a motion on one knot grid by sequential linear programs with a trust region.

Unknown are control points, gates and the squared duration. After every step the duration is made
exact by time scaling, so that each iterate keeps all limits at its samples; the tube is elastic.
"""

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.constraints import (
    Rows,
    least_squared_durations,
    limit_rows,
    sampled_motion,
    stacked,
    tube_excess,
    tube_rows,
)
from tubeplanner.linear_program import Bounds, Step, solve_step
from tubeplanner.phase_spline import DEGREE, REST_POINTS, Samples
from tubeplanner.problem import PlanningProblem
from tubeplanner.spline_start import PhasedMotion

# Samples per knot interval; more are added where it turns out to be needed.
_LIMIT_SAMPLES = np.array([0.0, 0.5])
_TUBE_SAMPLES = np.array([0.0, 1 / 3, 2 / 3])
_DENSE_SAMPLES = np.linspace(0, 1, 21)
# Steps aim this far inside the tube, a share of its radius; the merit lets go of most of it.
INNER_MARGIN = 0.005
_MERIT_TOLERANCE = 0.004
# Weights of third differences, against wiggles of joints that do not matter, and of the step.
_SMOOTHING = 1e-5
_PROXIMITY = 1e-3
# Rows are given to the solver if they are this near, or a part of the trust region away.
_NEAR, _NEAR_SHARE = 0.06, 0.1
_MOST_LAZY_ROUNDS = 5
_BROKEN = 1e-4
_LEAST_TRUST, _LARGEST_TRUST = 1e-4, 1.0
_LEAST_GAIN = 1e-5
_LARGEST_PRICE = 1e4
_DURATION_STEP = (-0.5, 1.0)
# For the multipliers: a small trust region, hardly any quadratic part, an exact solution.
_PRICE_TRUST, _PRICE_SMOOTHING, _PRICE_TOLERANCE = 0.02, 1e-3, 1e-8
_HIGHER = 1.001  # peaks of the squared duration between samples that count


@dataclass(frozen=True, eq=False)
class Iterate:
    """A motion and what it costs.

    Attributes:
        motion: Control points and gates.
        squared_duration: The least T^2 that the limits allow at the samples [s^2].
        excess: How far the hand leaves the narrowed tube at the samples, in radii, >= 0.
    """

    motion: PhasedMotion
    squared_duration: float
    excess: float

    @property
    def duration(self) -> float:
        """T [s]."""
        return float(np.sqrt(self.squared_duration))


class SequentialProgram:
    """The optimisation of motions on one knot grid.

    Attributes:
        margin: Share of the radii that is kept free.
    """

    def __init__(
        self,
        problem: PlanningProblem,
        motion: PhasedMotion,
        tube_share: float,
        checkpoint: Callable[[float], None],
    ) -> None:
        """Prepare it for motions with the knots of one.

        Args:
            problem: What is asked.
            motion: Only its knots count.
            tube_share: Which share of the radii may be used.
            checkpoint: Called with the duration [s] after every step; it may raise to end the work.
        """
        self.margin = 1 - (1 - INNER_MARGIN) * tube_share
        self._problem, self._shape, self._checkpoint = problem, motion.shape, checkpoint
        # A gate has a sample on either side, so that the hand is in both capsules there.
        ends = self._shape.phase_ends()
        self._limit_samples = self._shape.samples(_LIMIT_SAMPLES).and_also(ends)
        self._tube_samples = self._shape.samples(_TUBE_SAMPLES).and_also(ends)
        self._dense_samples = self._shape.samples(_DENSE_SAMPLES)
        self._lower, self._upper = self._control_bounds()
        self._free = slice(REST_POINTS, self._shape.control_point_count - REST_POINTS)
        self._curvature = self._smoothing()
        self._price = 1.0

    def without_checkpoint(self) -> "SequentialProgram":
        """Return the program for use after planning: nothing is told or ends it any more."""
        later = copy(self)
        later._checkpoint = lambda duration: None
        return later

    def iterate(self, motion: PhasedMotion) -> Iterate:
        """Return a motion with its cost, its control points moved into the joints' bounds."""
        points = motion.control_points.copy()
        points[self._free] = np.clip(
            points[self._free], self._lower[self._free], self._upper[self._free]
        )
        return self._evaluated(PhasedMotion(self._shape, motion.gates, points))

    def improved(
        self, current: Iterate, trust: float, least_gain: float, most_steps: int
    ) -> Iterate:
        """Return a shorter motion, if there is one.

        Args:
            current: Where to start.
            trust: First radius of the trust region [rad or m].
            least_gain: Two steps that gain less than this share of T^2 end it.
            most_steps: So many steps end it too.
        """
        small_gains = 0
        for _ in range(most_steps):
            step = self._step(current, trust)
            if step is None:
                trust *= 0.4
                continue
            predicted = -step.duration + self._price * (current.excess - step.elastic)
            trial = self._moved(current, step)
            gain = self._merit(current, current) - self._merit(current, trial)
            ratio = gain / max(predicted, 1e-12)
            size = float(abs(step.control).max(initial=0.0))
            if step.elastic > _BROKEN or trial.excess > _MERIT_TOLERANCE:
                self._price = min(4 * self._price, _LARGEST_PRICE)
            if ratio > 0.02:
                current = trial
                small_gains = small_gains + 1 if gain < least_gain else 0
            self._checkpoint(current.duration)
            trust = _next_trust(trust, ratio, size)
            if predicted < _LEAST_GAIN or small_gains == 2 or trust < _LEAST_TRUST:
                break
        return current

    def densely(self, current: Iterate) -> tuple[Iterate, bool]:
        """Return a motion's cost between samples as well, and whether samples had to be added."""
        limits, excess = self._costs(current.motion, self._dense_samples, self._dense_samples)
        higher = _peaks(limits, _HIGHER * current.squared_duration)
        outside = _peaks(excess, 0.0)
        self._limit_samples = self._limit_samples.and_also(self._dense_samples.where(higher))
        self._tube_samples = self._tube_samples.and_also(self._dense_samples.where(outside))
        worst = Iterate(current.motion, float(limits.max()), max(float(excess.max()), 0.0))
        return worst, bool(len(higher) or len(outside))

    def elasticities(self, current: Iterate) -> dict[tuple[str, int], float]:
        """Return d ln T / d ln p of a motion that is as short as it can be made, for every limit p.

        From the multipliers of its linear program: half of what a limit's rows cost, as their
        objective is the relative change of T^2.

        Returns:
            By ("effort", joint), likewise for velocity, acceleration and jerk, and by
            ("radius", segment). None of them is positive.
        """
        hard, elastic = self._all_rows(current)
        rows = stacked([hard, elastic])
        is_elastic = np.repeat([0.0, 1.0], [len(hard), len(elastic)])
        near = np.flatnonzero(rows.room < _NEAR)
        hessian, gradient = self._quadratic(current)
        step = solve_step(
            rows.where(near),
            is_elastic[near],
            self._bounds(current, _PRICE_TRUST),
            hessian * _PRICE_SMOOTHING,
            gradient * _PRICE_SMOOTHING,
            _LARGEST_PRICE,
            _PRICE_TOLERANCE,
        )
        if step is None:
            return {}
        cost = np.zeros(len(rows))
        cost[near] = np.maximum(step.multipliers, 0.0) / 2
        limits = self._problem.robot.limits
        found, first = {}, 0
        for kind in ("effort", "velocity", "acceleration", "jerk"):
            for joint in np.flatnonzero(np.isfinite(getattr(limits, kind))):
                last = first + 2 * len(self._limit_samples.phase)  # both directions
                found[kind, int(joint)] = -float(cost[first:last].sum())
                first = last
        by_plane = cost[first:].reshape(-1, len(self._tube_samples.phase)).sum(axis=0)
        for segment in range(len(self._shape.shares)):
            share = by_plane[self._tube_samples.phase == segment].sum()
            found["radius", segment] = -float(share) * (1 - self.margin)
        return found

    def _costs(
        self, motion: PhasedMotion, limit_samples: Samples, tube_samples: Samples
    ) -> tuple[FloatArray, FloatArray]:
        """Return the least squared durations at some samples, and the excess at others."""
        sampled = [
            sampled_motion(
                self._shape.basis(samples, motion.gates, with_gates=False),
                motion.control_points,
                1.0,
            )
            for samples in (limit_samples, tube_samples)
        ]
        limits = least_squared_durations(self._problem.robot, sampled[0])
        excess = tube_excess(self._problem, sampled[1], tube_samples.phase, self.margin)
        return limits, excess

    def _evaluated(self, motion: PhasedMotion) -> Iterate:
        limits, excess = self._costs(motion, self._limit_samples, self._tube_samples)
        return Iterate(motion, float(limits.max()), max(float(excess.max()), 0.0))

    def _merit(self, current: Iterate, trial: Iterate) -> float:
        """Return the cost of a trial in units of the current squared duration."""
        duration = trial.squared_duration / current.squared_duration
        return duration + self._price * max(trial.excess - _MERIT_TOLERANCE, 0.0)

    def _moved(self, current: Iterate, step: Step) -> Iterate:
        points, gates = current.motion.control_points.copy(), current.motion.gates.copy()
        points[self._free] += step.control
        gates[1:-1] += step.gate
        return self._evaluated(PhasedMotion(self._shape, gates, points))

    def _step(self, current: Iterate, trust: float) -> Step | None:
        """Return the step of one linear program, its rows added as they are broken."""
        bounds = self._bounds(current, trust)
        rows, is_elastic = self._rows(current, trust, float(bounds.gate.max(initial=0.0)))
        hessian, gradient = self._quadratic(current)
        active = (rows.room < _NEAR) | (rows.room < _NEAR_SHARE * rows.reach(trust, trust))
        step = None
        for _ in range(_MOST_LAZY_ROUNDS):
            some = np.flatnonzero(active)
            step = solve_step(
                rows.where(some), is_elastic[some], bounds, hessian, gradient, self._price
            )
            if step is None:
                return None
            broken = self._broken(rows, is_elastic, step)
            if not (broken & ~active).any():
                break
            active |= broken
        return step

    def _bounds(self, current: Iterate, trust: float) -> Bounds:
        """Return where a step must stay."""
        width = np.diff(current.motion.gates)
        points = current.motion.control_points[self._free]
        return Bounds(
            np.clip(self._lower[self._free] - points, -trust, 0.0),
            np.clip(self._upper[self._free] - points, 0.0, trust),
            np.minimum(0.5 * trust, 0.3 * np.minimum(width[:-1], width[1:])),
            _DURATION_STEP,
        )

    def _quadratic(self, current: Iterate) -> tuple[sparse.csc_matrix, FloatArray]:
        """Return the quadratic part of a step's cost: matrix and gradient."""
        points = current.motion.control_points
        free, joints = points[self._free].shape
        inner = self._curvature[self._free][:, self._free] + sparse.identity(free) * _PROXIMITY
        gradient: FloatArray = (self._curvature[self._free] @ points).ravel()
        return sparse.kron(inner, sparse.identity(joints)).tocsc(), gradient

    def _rows(self, current: Iterate, trust: float, gate_trust: float) -> tuple[Rows, FloatArray]:
        """Return the rows that can matter within the trust region, and which are elastic."""
        hard, elastic = self._all_rows(current)
        hard = hard.where(hard.room < np.maximum(0.3, hard.reach(trust, gate_trust)))
        elastic = elastic.where(elastic.room < elastic.reach(trust, gate_trust))
        is_elastic = np.repeat([0.0, 1.0], [len(hard), len(elastic)])
        return stacked([hard, elastic]), is_elastic

    def _all_rows(self, current: Iterate) -> tuple[Rows, Rows]:
        """Return the rows of the limits, and those of the tube."""
        gates, points = current.motion.gates, current.motion.control_points
        limits, tube = (
            sampled_motion(self._shape.basis(samples, gates), points, current.duration)
            for samples in (self._limit_samples, self._tube_samples)
        )
        return limit_rows(self._problem.robot, limits), tube_rows(
            self._problem, tube, self._tube_samples.phase, self.margin
        )

    def _broken(self, rows: Rows, is_elastic: FloatArray, step: Step) -> BoolArray:
        """Return which rows a step breaks."""
        change = np.zeros((self._shape.control_point_count, step.control.shape[1]))
        change[self._free] = step.control
        taken = change[rows.first[:, None] + np.arange(DEGREE + 1)]
        value = np.einsum("rkj,rkj->r", rows.control, taken)
        value += rows.gate @ step.gate + rows.duration * step.duration
        broken: BoolArray = value - is_elastic * step.elastic > rows.room + _BROKEN
        return broken

    def _control_bounds(self) -> tuple[FloatArray, FloatArray]:
        """Return joint bounds of the control points, (K, n): those of all phases they count in.

        A spline lies in the hull of its control points, so the bounds hold for all t.
        """
        shape = (self._shape.control_point_count, self._problem.robot.joint_count)
        lower, upper = np.full(shape, -np.inf), np.full(shape, np.inf)
        first = 0
        for k, shares in enumerate(self._shape.shares):
            counting = slice(first, first + len(shares) - 1 + DEGREE)
            lower[counting] = np.maximum(lower[counting], self._problem.joint_lower[k])
            upper[counting] = np.minimum(upper[counting], self._problem.joint_upper[k])
            first += len(shares) - 1
        return lower, upper

    def _smoothing(self) -> sparse.csr_matrix:
        """Return the matrix of the squared third differences, scaled with the knots' spacing."""
        count = self._shape.control_point_count
        third = sparse.diags([-1.0, 3.0, -3.0, 1.0], [0, 1, 2, 3], shape=(count - 3, count))
        weight = 2 * _SMOOTHING * self._shape.interval_count**5 / 250_000
        return (third.T @ third).tocsr() * weight


def _next_trust(trust: float, ratio: float, size: float) -> float:
    """Return the trust region's next radius, by how well a step's gain was predicted."""
    if ratio < 0.1:
        return 0.4 * min(trust, max(size, _LEAST_TRUST))
    if ratio < 0.3:
        return 0.6 * trust
    if ratio > 0.7 and size > 0.8 * trust:
        return min(2 * trust, _LARGEST_TRUST)
    return trust


def _peaks(values: FloatArray, floor: float) -> IntArray:
    """Return where samples are no lower than their neighbours, and above a floor."""
    padded = np.concatenate([[-np.inf], values, [-np.inf]])
    is_peak = (values >= padded[:-2]) & (values > padded[2:]) & (values > floor)
    return np.flatnonzero(is_peak)
