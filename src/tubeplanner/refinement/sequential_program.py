"""Shortening a trajectory on one knot grid by sequential linear programs with a trust region.

The unknowns are the control points, the switching times and the squared duration. After every step
the duration is made exact by time scaling, so that each iterate keeps all limits at its samples;
tube and clearances are elastic.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import starmap

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.constraints.speed_limit import LimitKey
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.refinement.control_variables import FIXED, ControlVariables
from tubeplanner.refinement.goal_constraints import goal_keys
from tubeplanner.refinement.linear_program import Bounds, Step
from tubeplanner.refinement.linear_rows import INNER_MARGIN, MERIT_TOLERANCE, Rows, StepSize
from tubeplanner.refinement.linearization import BROKEN, Given, Linearization
from tubeplanner.refinement.link_constraints import LinkConstraints
from tubeplanner.refinement.phased_spline import DEGREE, KnotGrid, PhasedSpline
from tubeplanner.refinement.region_constraints import EvaluatedRegions, Planes
from tubeplanner.refinement.spline_constraints import Iterate, SplineConstraints
from tubeplanner.refinement.step_cost import StepCost
from tubeplanner.refinement.step_objective import ShortestDuration, StepObjective
from tubeplanner.refinement.trust_region import Outcome, TrustRegion

# Rows are given to the solver if they are this near, or a part of the trust region away.
_NEAR, _NEAR_SHARE = 0.03, 0.03
# Steps that gain less than this share of the prediction get a second-order correction.
_GOOD_RATIO = 0.3
# Those that gain less than this share in the end are not made.
_WORTH_A_MOVE = 0.02
# A step that should lose this share of T^2 obeys planes of two segments that contradict each other.
_CONTRADICTION = 5e-4
FIRST_PENALTY, _MAX_PENALTY = 3.0, 1e4
_LARGEST_DURATION_STEP = 1.0
# Phases change by at most this share of their width, and of the trust region.
_MAX_WIDTH_SHARE, _WIDTH_SHARE = 0.3, 8.0
# For the multipliers: a small trust region, hardly any quadratic part, an exact solution.
_MULTIPLIER_TRUST = TrustRegion(0.02, 0.0)
_MULTIPLIER_SMOOTHING, _MULTIPLIER_TOLERANCE = 1e-3, 1e-6


@dataclass(frozen=True, eq=False)
class Improved:
    """Where an improvement ended.

    Attributes:
        iterate: The shortest trajectory.
        trust: The next step's trust region.
        penalty: Weight of the elastic constraints.
        has_ended: Whether it ended by itself, not after the steps that it was given.
    """

    iterate: Iterate
    trust: TrustRegion
    penalty: float
    has_ended: bool


@dataclass(frozen=True, eq=False)
class _Remembered:
    """What the last step's program needed beyond what was near: numbers of rows, and planes."""

    rows: IntArray
    planes: tuple[Planes, ...]


_NOTHING = _Remembered(np.zeros(0, dtype=np.int64), ())


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
        radius: FloatArray | None = None,
        objective: StepObjective | None = None,
        room: FloatArray | None = None,
    ) -> None:
        """Prepare it.

        Args:
            problem: The planning problem.
            grid: The splines' knots.
            links: What is watched of the links already.
            radius: Of the tube's segments, if not their own, shape (m,) [m].
            objective: What steps are to gain; None: a shorter duration.
            room: The share of the tube's regions that stays unused, shape (m,); None: none.
        """
        self._objective: StepObjective = objective or ShortestDuration()
        radius = problem.tube.effective_radius if radius is None else radius
        links = links or LinkConstraints(problem)
        self.constraints = SplineConstraints(
            problem, grid, links, radius, self._objective.run_in, room
        )
        self._problem, self.grid = problem, grid
        self._variables = ControlVariables(problem, grid)
        self._cost = StepCost(self._variables, grid, problem.robot.joint_count)

    def iterate(self, spline: PhasedSpline) -> Iterate:
        """Return a trajectory with its cost, its control points moved into the joints' bounds."""
        points = self._variables.within_bounds(spline.control_points)
        return self.constraints.at(PhasedSpline(self.grid, spline.switching_times, points))

    def improved(
        self,
        current: Iterate,
        trust: TrustRegion,
        penalty: float,
        *,
        min_gain: float,
        max_steps: int,
        checkpoint: Callable[[Iterate], None] = lambda iterate: None,
    ) -> Improved:
        """Return a shorter trajectory, if there is one.

        Args:
            current: Where to start.
            trust: The first trust region.
            penalty: First weight of the elastic constraints.
            min_gain: A step that should gain less than this share of T^2 ends it, or two that do.
            max_steps: So many steps end it too.
            checkpoint: Called with every iterate; it may raise to end the work.
        """
        small_gains, remembered = 0, _NOTHING
        for _ in range(max_steps):
            linear = self._linearized(current, trust, penalty, remembered)
            step = linear.solve()
            if step is None:
                trust = trust.smaller()
                continue
            remembered = _Remembered(linear.added, linear.binding(step))
            trial = self._moved(current, step)
            if trial is None:
                trust = trust.smaller()
                continue
            predicted, gain = self._gains(current, trial, step, penalty)
            if predicted < -_CONTRADICTION:
                trust = trust.smaller()
                continue
            first_gain = gain
            if gain < _GOOD_RATIO * predicted:
                trial, gain = self._corrected(current, linear, step, trial, gain)
            outcome = Outcome(
                predicted,
                first_gain,
                gain,
                float(abs(step.control).max(initial=0.0)),
                self._cost.squared_rates(step.control),
            )
            self._objective.after(step)
            if step.elastic > BROKEN:
                penalty = min(4 * penalty, _MAX_PENALTY)
            if outcome.ratio > _WORTH_A_MOVE:
                current = trial
                small_gains = small_gains + 1 if gain < min_gain else 0
            checkpoint(current)
            trust = trust.after(outcome)
            if predicted < min_gain or small_gains == 2 or trust.has_collapsed:
                return Improved(current, trust, penalty, has_ended=True)
        return Improved(current, trust, penalty, has_ended=False)

    def elasticities(self, current: Iterate) -> dict[LimitKey, float]:
        """Return d ln T / d ln p of a spline as short as it can be made, for every limit p.

        From the multipliers of its linear program: half of what a limit's rows cost, as their
        objective is the relative change of T^2.

        Returns:
            By the limits on the speed and the tube's tolerances. None of them is positive.
        """
        # What the answer itself is outside of the margins costs nothing.
        current = replace(current, regions=tuple(map(_holding, current.regions)))
        rows, is_elastic = self.constraints.rows(current, None)
        rows = replace(rows, slack=np.maximum(rows.slack, 0.0))
        # Nor does what variables hardly move, such as a start on its tolerance.
        # An open goal stays, unless it has tolerances of its own, which cost something too.
        has_tolerances = bool(goal_keys(self._problem))
        bounds = self._bounds(current, _MULTIPLIER_TRUST, goal_moves=has_tolerances)
        size = StepSize(_MULTIPLIER_TRUST.radius, bounds.switching)
        still = tuple(self._hardly_move(regions, size) for regions in current.regions)
        given = (rows.slack < _NEAR) & (self._reach(rows, size) + abs(rows.duration) > 0)
        linear = Linearization(
            current,
            (rows, is_elastic),
            Given(given, _near_planes(current, still), still),
            self._variables,
            bounds,
            self._cost.quadratic(current.spline.control_points).times(_MULTIPLIER_SMOOTHING),
            _MAX_PENALTY,
        )
        step = linear.solve_exactly(_MULTIPLIER_TOLERANCE)
        if step is None or step.elastic > BROKEN:  # then multipliers tell the penalty alone
            return {}
        keys = self.constraints.keys
        cost = linear.costs(step, len(keys), self.constraints.rise(current)) / 2
        # Rows of the tube are in radii, those of the limits in limits: the narrowing scales along.
        of_speed = {key for limit in current.limits for key in limit.limit.keys}
        share = [1.0 if key in of_speed else 1 - INNER_MARGIN for key in keys]
        return dict(zip(keys, -cost * np.array(share), strict=True))

    def _hardly_move(self, regions: EvaluatedRegions, size: StepSize) -> BoolArray:
        """Return which samples a step moves by less than what the merit function ignores, (N,)."""
        planes = regions.planes()
        reach = np.full(len(regions.vector), np.inf)
        reach[planes.sample] = 0.0
        np.maximum.at(reach, planes.sample, self._reach(regions.rows(planes), size))
        return (reach < MERIT_TOLERANCE) | ~self._variables.move(regions.at)

    def _reach(self, rows: Rows, size: StepSize) -> FloatArray:
        """Return how far a step of the variables can move each row, shape (R,)."""
        is_free = self._variables.column[rows.first[:, None] + np.arange(DEGREE + 1)] != FIXED
        return replace(rows, control=rows.control * is_free[:, :, None]).reach(size)

    def _moved(self, current: Iterate, step: Step) -> Iterate | None:
        points = self._variables.moved(current.spline.control_points, step.control)
        if points is None:
            return None
        switching_times = current.spline.switching_times.copy()
        if self.grid.switch_count:
            switching_times[1:-1] += step.switching
        return self.constraints.at(PhasedSpline(self.grid, switching_times, points))

    def _gains(
        self, current: Iterate, trial: Iterate, step: Step, penalty: float
    ) -> tuple[float, float]:
        """Return what a step should have gained, and what it did."""
        before, expected, found = (
            max(excess - self._objective.ignored_excess, 0.0)
            for excess in (current.excess, step.elastic, trial.excess)
        )
        predicted = self._objective.predicted_gain(current, step)
        gain = self._objective.gain(current, trial)
        return predicted + penalty * (before - expected), gain + penalty * (before - found)

    def _corrected(
        self, current: Iterate, linear: Linearization, step: Step, trial: Iterate, gain: float
    ) -> tuple[Iterate, float]:
        """Return a trial, or a better one corrected for the constraints' curvature.

        (Second-order correction: Nocedal & Wright, "Numerical Optimization", 2006, section 18.3.)
        """
        slack = self.constraints.slack(current, trial, 1 + step.duration)
        other = linear.solve_again(step, trial, slack)
        if other is None:
            return trial, gain
        second = self._moved(current, other)
        if second is None:
            return trial, gain
        _, second_gain = self._gains(current, second, other, linear.penalty)
        return (second, second_gain) if second_gain > gain else (trial, gain)

    def _linearized(
        self, current: Iterate, trust: TrustRegion, penalty: float, remembered: _Remembered
    ) -> Linearization:
        bounds = self._bounds(current, trust)
        size = StepSize(trust.radius, bounds.switching)
        rows, is_elastic = self.constraints.rows(current, size)
        near = (rows.slack < _NEAR) | (rows.slack < _NEAR_SHARE * rows.reach(size))
        none = tuple(np.zeros(len(regions.vector), bool) for regions in current.regions)
        planes = _near_planes(current, none)
        if remembered.planes:
            planes = tuple(starmap(Planes.and_also, zip(planes, remembered.planes, strict=True)))
        return Linearization(
            current,
            (rows, is_elastic),
            Given(near | np.isin(rows.index, remembered.rows), planes, none),
            self._variables,
            bounds,
            self._objective.cost(
                current,
                self._variables,
                self._cost.quadratic(current.spline.control_points, trust.damping),
            ),
            penalty,
        )

    def _bounds(self, current: Iterate, trust: TrustRegion, *, goal_moves: bool = True) -> Bounds:
        """Return the bounds of a step."""
        widths = np.diff(current.spline.switching_times)
        widths *= min(_MAX_WIDTH_SHARE, _WIDTH_SHARE * trust.radius)
        switching = np.minimum(np.cumsum(widths)[:-1], np.cumsum(widths[::-1])[-2::-1])
        switching = switching[: self.grid.switch_count]
        points = current.spline.control_points
        now, joints = self._variables.of(points), points.shape[1]
        held = self._variables.held(points)
        return Bounds(
            np.clip(self._variables.lower - now, -trust.radius, 0.0),
            np.clip(self._variables.upper - now, 0.0, trust.radius),
            switching,
            widths,
            (self._objective.least_duration_step, _LARGEST_DURATION_STEP),
            held if goal_moves or len(held) == 0 else np.eye(joints),
        )


def _holding(regions: EvaluatedRegions) -> EvaluatedRegions:
    """Return regions that hold their vectors, with less margin where they did not."""
    return replace(regions, margin=regions.margin - np.maximum(regions.excess, 0.0))


def _near_planes(current: Iterate, ignored: tuple[BoolArray, ...]) -> tuple[Planes, ...]:
    """Return the planes of every kind of regions that are near, but for some samples'."""
    found = []
    for regions, left_out in zip(current.regions, ignored, strict=True):
        planes = regions.planes()
        is_near = (regions.slack(planes) < _NEAR) | regions.is_crossed
        found.append(planes.where(is_near & ~left_out[planes.sample]))
    return tuple(found)
