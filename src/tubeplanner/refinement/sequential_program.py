"""Shortening a trajectory on one knot grid by sequential linear programs with a trust region.

The unknowns are the control points, the switching times and the squared duration. After every step
the duration is made exact by time scaling, so that each iterate keeps all limits at its samples;
tube and clearances are elastic.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.refinement.control_variables import FIXED, ControlVariables
from tubeplanner.refinement.linear_program import Bounds, Step, StepProgram
from tubeplanner.refinement.linear_rows import INNER_MARGIN, MERIT_TOLERANCE, Rows, StepSize
from tubeplanner.refinement.link_constraints import LinkConstraints
from tubeplanner.refinement.phased_spline import DEGREE, KnotGrid, PhasedSpline
from tubeplanner.refinement.spline_constraints import Iterate, SplineConstraints

# Weights of third differences, against wiggles of joints that do not matter, and of the step.
_SMOOTHING = 1e-5
_PROXIMITY = 1e-3
# Rows are given to the solver if they are this near, or a part of the trust region away.
_NEAR, _NEAR_SHARE = 0.03, 0.03
_MAX_LAZY_ROUNDS = 5
_BROKEN = 1e-4
_MIN_TRUST, _MAX_TRUST = 1e-4, 1.0
# Steps that gain less than this share of the prediction get a second-order correction.
_GOOD_RATIO = 0.3
FIRST_PENALTY, _MAX_PENALTY = 3.0, 1e4
_DURATION_STEP = (-0.5, 1.0)
# For the multipliers: a small trust region, hardly any quadratic part, an exact solution.
_MULTIPLIER_TRUST, _MULTIPLIER_SMOOTHING, _MULTIPLIER_TOLERANCE = 0.02, 1e-3, 1e-8


@dataclass(frozen=True, eq=False)
class Improved:
    """Where an improvement ended.

    Attributes:
        iterate: The shortest trajectory.
        trust: Radius of the trust region [rad or m].
        penalty: Weight of the elastic constraints.
    """

    iterate: Iterate
    trust: float
    penalty: float


class SequentialProgram:
    """The optimisation of splines on one knot grid.

    Attributes:
        constraints: The constraints of the splines.
        grid: The splines' knots.
    """

    def __init__(
        self,
        problem: PlanningProblem,
        grid: KnotGrid,
        links: LinkConstraints | None = None,
    ) -> None:
        """Prepare it.

        Args:
            problem: The planning problem.
            grid: The splines' knots.
            links: What is watched of the links already.
        """
        self.constraints = SplineConstraints(problem, grid, links or LinkConstraints(problem))
        self._problem, self.grid = problem, grid
        self._variables = ControlVariables(problem, grid)
        self._curvature = self._smoothing()
        self._hessian = self._step_hessian()

    def iterate(self, spline: PhasedSpline) -> Iterate:
        """Return a trajectory with its cost, its control points moved into the joints' bounds."""
        points = self._variables.within_bounds(spline.control_points)
        return self.constraints.at(PhasedSpline(self.grid, spline.switching_times, points))

    def improved(
        self,
        current: Iterate,
        trust: float,
        penalty: float,
        *,
        min_gain: float,
        max_steps: int,
        checkpoint: Callable[[Iterate], None] = lambda iterate: None,
    ) -> Improved:
        """Return a shorter trajectory, if there is one.

        Args:
            current: Where to start.
            trust: First radius of the trust region [rad or m].
            penalty: First weight of the elastic constraints.
            min_gain: A step that should gain less than this share of T^2 ends it, or two that do.
            max_steps: So many steps end it too.
            checkpoint: Called with every iterate; it may raise to end the work.
        """
        small_gains, remembered = 0, np.zeros(0, dtype=np.int64)
        for _ in range(max_steps):
            linear = self._linearised(current, trust, penalty, remembered)
            step = linear.solve()
            if step is None:
                trust *= 0.4
                continue
            remembered = linear.added
            trial = self._moved(current, step)
            if trial is None:
                trust *= 0.4
                continue
            predicted, gain = _gains(current, trial, step, penalty)
            if gain < _GOOD_RATIO * predicted:
                trial, gain = self._corrected(current, linear, step, trial, gain)
            ratio = gain / max(predicted, 1e-12)
            if step.elastic > _BROKEN:
                penalty = min(4 * penalty, _MAX_PENALTY)
            if ratio > 0.02:
                current = trial
                small_gains = small_gains + 1 if gain < min_gain else 0
            checkpoint(current)
            trust = _next_trust(trust, ratio, float(abs(step.control).max(initial=0.0)))
            if predicted < min_gain or small_gains == 2 or trust < _MIN_TRUST:
                break
        return Improved(current, trust, penalty)

    def elasticities(self, current: Iterate) -> dict[tuple[str, int], float]:
        """Return d ln T / d ln p of a spline as short as it can be made, for every limit p.

        From the multipliers of its linear program: half of what a limit's rows cost, as their
        objective is the relative change of T^2.

        Returns:
            By ("effort", joint), likewise for velocity, acceleration and jerk, and by
            ("radius", segment) and ("rotation", segment). None of them is positive.
        """
        rows, is_elastic = self.constraints.rows(current, None)
        # Rows that no variable moves, such as a start on its tolerance, cost nothing.
        near = np.flatnonzero((rows.slack < _NEAR) & self._can_move(rows))
        step = StepProgram(
            rows.where(near),
            is_elastic[near],
            self._variables.column,
            self._bounds(current, _MULTIPLIER_TRUST, goal_moves=False),
            self._hessian * _MULTIPLIER_SMOOTHING,
            self._gradient(current) * _MULTIPLIER_SMOOTHING,
            _MAX_PENALTY,
            _MULTIPLIER_TOLERANCE,
        ).solve()
        if step is None or step.elastic > _BROKEN:  # then multipliers tell the penalty alone
            return {}
        names, limit = self.constraints.names, rows.limit[near]
        named = limit >= 0
        cost = np.bincount(
            limit[named], np.maximum(step.multipliers[named], 0.0) / 2, minlength=len(names)
        )
        # Rows of the tube are in radii, those of the limits in limits: the narrowing scales along.
        tolerances = ("radius", "rotation")
        share = np.array([1 - INNER_MARGIN if kind in tolerances else 1.0 for kind, _ in names])
        return dict(zip(names, -cost * share, strict=True))

    def _can_move(self, rows: Rows) -> BoolArray:
        """Return whether variables change rows at all, shape (R,)."""
        is_free = self._variables.column[rows.first[:, None] + np.arange(DEGREE + 1)] != FIXED
        by_control = (abs(rows.control).sum(axis=2) * is_free).sum(axis=1)
        return by_control + abs(rows.switching).sum(axis=1) + abs(rows.duration) > 0

    def _moved(self, current: Iterate, step: Step) -> Iterate | None:
        points = self._variables.moved(current.spline.control_points, step.control)
        if points is None:
            return None
        switching_times = current.spline.switching_times.copy()
        switching_times[1:-1] += step.switching
        return self.constraints.at(PhasedSpline(self.grid, switching_times, points))

    def _corrected(
        self, current: Iterate, linear: "_Linearised", step: Step, trial: Iterate, gain: float
    ) -> tuple[Iterate, float]:
        """Return a trial, or a better one corrected for the constraints' curvature.

        (Second-order correction: Nocedal & Wright, "Numerical Optimization", 2006, section 18.3.)
        """
        slack = self.constraints.slack(current, trial, 1 + step.duration)
        other = linear.solve_again(step, slack)
        if other is None:
            return trial, gain
        second = self._moved(current, other)
        if second is None:
            return trial, gain
        _, second_gain = _gains(current, second, other, linear.penalty)
        return (second, second_gain) if second_gain > gain else (trial, gain)

    def _linearised(
        self, current: Iterate, trust: float, penalty: float, remembered: IntArray
    ) -> "_Linearised":
        bounds = self._bounds(current, trust)
        size = StepSize(trust, float(bounds.switching.max(initial=0.0)))
        rows, is_elastic = self.constraints.rows(current, size)
        active = (rows.slack < _NEAR) | (rows.slack < _NEAR_SHARE * rows.reach(size))
        return _Linearised(
            rows,
            is_elastic,
            active | np.isin(rows.index, remembered),
            self._variables,
            bounds,
            (self._hessian, self._gradient(current)),
            penalty,
        )

    def _bounds(self, current: Iterate, trust: float, *, goal_moves: bool = True) -> Bounds:
        """Return the bounds of a step."""
        width = np.diff(current.spline.switching_times)
        points = current.spline.control_points
        now, joints = self._variables.of(points), points.shape[1]
        held = self._variables.held(points)
        return Bounds(
            np.clip(self._variables.lower - now, -trust, 0.0),
            np.clip(self._variables.upper - now, 0.0, trust),
            np.minimum(0.5 * trust, 0.3 * np.minimum(width[:-1], width[1:])),
            _DURATION_STEP,
            held if goal_moves or len(held) == 0 else np.eye(joints),
        )

    def _gradient(self, current: Iterate) -> FloatArray:
        """Return how the smoothing changes with the variables, shape (F n,)."""
        gradient: FloatArray = self._curvature @ current.spline.control_points
        return (self._variables.selection.T @ gradient).ravel()

    def _step_hessian(self) -> sparse.csc_matrix:
        """Return the curvature of a step's cost: smoothing and proximity; else next to none."""
        joints = self._problem.robot.joint_count
        selection = self._variables.selection
        inner = selection.T @ self._curvature @ selection
        inner = inner + sparse.identity(inner.shape[0]) * _PROXIMITY
        others = len(self.grid.shares) - 1 + 2  # switching times, eta, elastic
        parts = [sparse.kron(inner, sparse.identity(joints)), sparse.identity(others) * 1e-9]
        return sparse.block_diag(parts, format="csc")

    def _smoothing(self) -> sparse.csr_matrix:
        """Return the matrix of the squared third differences, scaled with the knots' spacing."""
        count = self.grid.control_point_count
        third = sparse.diags([-1.0, 3.0, -3.0, 1.0], [0, 1, 2, 3], shape=(count - 3, count))
        weight = 2 * _SMOOTHING * self.grid.interval_count**5 / 250_000
        return (third.T @ third).tocsr() * weight


class _Linearised:
    """The linear program at a trajectory, its rows added as they turn out to be broken.

    Attributes:
        penalty: Weight of the elastic constraints.
    """

    def __init__(
        self,
        rows: Rows,
        is_elastic: FloatArray,
        active: BoolArray,
        variables: ControlVariables,
        bounds: Bounds,
        quadratic: tuple[sparse.csc_matrix, FloatArray],
        penalty: float,
    ) -> None:
        self._rows, self._is_elastic = rows, is_elastic
        self._near, self._active = active, active.copy()
        self._variables, self._bounds = variables, bounds
        self._quadratic, self.penalty = quadratic, penalty
        self._program: StepProgram | None = None
        self._given = np.zeros(0, dtype=np.int64)

    @property
    def added(self) -> IntArray:
        """Numbers of the rows that were not near but turned out to be broken."""
        return self._rows.index[self._active & ~self._near]

    def solve(self) -> Step | None:
        """Return the step, or None if there is none."""
        step = None
        for _ in range(_MAX_LAZY_ROUNDS):
            self._given = np.flatnonzero(self._active)
            self._program = StepProgram(
                self._rows.where(self._given),
                self._is_elastic[self._given],
                self._variables.column,
                self._bounds,
                *self._quadratic,
                self.penalty,
            )
            step = self._program.solve()
            if step is None:
                return None
            broken = self._slack_after(step) < -_BROKEN
            if not (broken & ~self._active).any():
                break
            self._active |= broken
        return step

    def solve_again(self, step: Step, slack: FloatArray) -> Step | None:
        """Return the step for rows whose slack is corrected by the slack found after a first step.

        Args:
            step: The first step.
            slack: The rows' slack after it, by their numbers.
        """
        rows = self._rows
        correction = slack[rows.index] - (self._slack_after(step) - self._is_elastic * step.elastic)
        corrected = (rows.slack + correction)[self._given]
        return None if self._program is None else self._program.solve_again(corrected)

    def _slack_after(self, step: Step) -> FloatArray:
        """Return the slack that a step leaves to all rows, to first order."""
        rows = self._rows
        change = self._variables.change(step.control)
        taken = change[rows.first[:, None] + np.arange(DEGREE + 1)]
        used = np.einsum("rkj,rkj->r", rows.control, taken)
        used += rows.switching @ step.switching + rows.duration * step.duration
        slack: FloatArray = rows.slack - used + self._is_elastic * step.elastic
        return slack


def _gains(current: Iterate, trial: Iterate, step: Step, penalty: float) -> tuple[float, float]:
    """Return what a step should have gained, and what it did, in squared durations."""
    before = _beyond(current.excess)
    predicted = -step.duration + penalty * (before - _beyond(step.elastic))
    duration = trial.squared_duration / current.squared_duration
    return predicted, 1 - duration + penalty * (before - _beyond(trial.excess))


def _beyond(excess: float) -> float:
    """Return the counted part of an excess."""
    return max(excess - MERIT_TOLERANCE, 0.0)


def _next_trust(trust: float, ratio: float, size: float) -> float:
    """Return the trust region's next radius, by how well a step's gain was predicted."""
    if ratio < 0.1:
        return 0.4 * min(trust, max(size, _MIN_TRUST))
    if ratio < 0.3:
        return 0.6 * trust
    if ratio > 0.7 and size > 0.8 * trust:
        return min(2 * trust, _MAX_TRUST)
    return trust
