"""Descent of one or more legs: SequentialProgram is one leg on one knot grid."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import starmap

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.limits.path_samples import LimitKey
from tubeplanner.optimizer.cone_constraints import EvaluatedCones
from tubeplanner.optimizer.control_variables import FIXED, ControlVariables, shared_columns
from tubeplanner.optimizer.linearization import BROKEN, Linearization
from tubeplanner.optimizer.link_constraints import LinkConstraints
from tubeplanner.optimizer.phased_spline import DEGREE, KnotGrid, PhasedSpline
from tubeplanner.optimizer.region_constraints import EvaluatedRegions, Planes, goal_keys
from tubeplanner.optimizer.rows import INNER_MARGIN, MERIT_TOLERANCE, Rows, StepSize
from tubeplanner.optimizer.spline_constraints import Iterate, SplineConstraints
from tubeplanner.optimizer.step_objective import StepCost, StepObjective
from tubeplanner.optimizer.step_program import Bounds, Step
from tubeplanner.optimizer.step_search import (
    Outcome,
    StepSearch,
    TrustRegion,
    limit_costs,
    motion_unit,
)
from tubeplanner.task.problem import PlanningProblem

# ---- Shortening a trajectory on one knot grid: one leg of a descent.
#
# The unknowns are the control points, the switching times and the squared duration. After every
# step the duration is made exact by time scaling, so that each iterate keeps all limits at its
# samples; tube and clearances are elastic.

# The first program has the rows that are this near, or a part of the trust region away.
_NEAR, _NEAR_FRACTION = 0.03, 0.03
_MAX_DURATION_STEP = 1.0
# Phases change by at most this fraction of their width, and of the trust region.
_MAX_WIDTH_FRACTION, _WIDTH_FRACTION = 0.3, 8.0
# For the multipliers: a small trust region, hardly any quadratic part.
_MULTIPLIER_TRUST = TrustRegion(0.02, 0.0)
_MULTIPLIER_SMOOTHING = 1e-3
# Largest costs that are believed: d ln T^2 by a relative rise is 2 at most for a velocity.
# (Of a tolerance that the start is on, multipliers said 0.15 where a rise gained nothing.)
_PLAUSIBLE_OF_SPEED, _PLAUSIBLE_OF_TUBE = 2.0, 0.1
FIRST_PENALTY, MAX_PENALTY = 3.0, 1e4


@dataclass(frozen=True, eq=False)
class Remembered:
    """Constraints of the last step's program that were not near: numbers of rows, and planes."""

    rows: IntArray
    planes: tuple[Planes, ...]


_NOTHING = Remembered(np.zeros(0, dtype=np.int64), ())


@dataclass(frozen=True, eq=False)
class DescentState:
    """Iterates and state at the begin or the end of a descent."""

    iterates: tuple[Iterate, ...]  # the trajectory of each leg
    trust: TrustRegion  # the next step's trust region
    penalty: float = FIRST_PENALTY  # weight of the elastic constraints
    has_ended: bool = False  # whether the descent converged before the largest number of steps

    @property
    def iterate(self) -> Iterate:
        """The trajectory of a single leg."""
        (iterate,) = self.iterates
        return iterate


class SequentialProgram:
    """The optimisation of splines on a knot grid.

    Attributes:
        constraints: The constraints of the splines.
        grid: The splines' knots.
        variables: The variable control points.
        objective: The gain that steps aim at.
        cost: The quadratic part of a step's cost.
    """

    def __init__(
        self,
        problem: PlanningProblem,
        grid: KnotGrid,
        links: LinkConstraints | None = None,
        radius: FloatArray | None = None,
        objective: StepObjective | None = None,
        slack: FloatArray | None = None,
        *,
        start_moves: bool = False,
        is_cautious: bool = False,
    ) -> None:
        """Set up constraints, variables and cost.

        Args:
            problem: The planning problem.
            grid: The splines' knots.
            links: The constraints on links, with the pairs that are watched already.
            radius: Of the tube's segments, if not their own, shape (m,) [m].
            objective: Gain that steps aim at; None: a shorter duration.
            slack: The fraction of the tube's regions that stays unused, shape (m,); None: none.
            start_moves: Whether the start is tied to the end of another leg.
            is_cautious: Whether links are looked for after every step, not where it ended alone: a
                step on which others than the watched ones collide is not made.
        """
        self._is_cautious = is_cautious
        self.objective = objective or StepObjective()
        radius = problem.tube.effective_radius if radius is None else radius
        links = links or LinkConstraints(problem)
        self.constraints = SplineConstraints(
            problem, grid, links, radius, self.objective.run_in, slack
        )
        self._problem, self.grid = problem, grid
        self.variables = ControlVariables(problem, grid, start_moves=start_moves)
        self.units = problem.robot.joint_units
        self.cost = StepCost(self.variables, grid, self.units)

    def iterate(self, spline: PhasedSpline) -> Iterate:
        """Return the iterate of a spline, its control points clipped to the joints' bounds."""
        points = self.variables.within_bounds(spline.control_points)
        within = PhasedSpline(self.grid, spline.switching_times, points)
        self.constraints.hold_friction(within)
        return self.constraints.at(within)

    def elasticities(self, current: Iterate) -> dict[LimitKey, float]:
        """Return d ln T / d ln p of an optimal spline, for every limit p.

        None is positive but of the masses of held parts.
        Half of the cost of a limit's rows, as their objective is the relative change of T^2. Empty
        if constraints stay violated.
        """
        # The answer's own violation of the margins costs nothing: regions with less margin.
        regions = tuple(
            replace(own, margin=own.margin - np.maximum(own.excess, 0.0)) for own in current.regions
        )
        current = replace(current, regions=regions)
        rows, is_elastic = self.constraints.rows(current, None)
        rows = replace(rows, slack=np.maximum(rows.slack, 0.0))
        # An open goal is fixed, unless it has tolerances, which have a cost too.
        has_tolerances = bool(goal_keys(self._problem))
        bounds = self._bounds(current, _MULTIPLIER_TRUST, goal_moves=has_tolerances)
        size = self._size(_MULTIPLIER_TRUST, bounds)
        # Samples that variables hardly move, such as a start on its tolerance, cost nothing.
        still = tuple(self._hardly_move(own, size) for own in current.convex)
        near = (rows.slack < _NEAR) & (self._reach(rows, size) + abs(rows.duration) > 0)
        linear = Linearization(
            current,
            (rows, is_elastic),
            near,
            _near_planes(current, still),
            still,
            self.variables,
            bounds,
            self.cost.quadratic(current.spline).times(_MULTIPLIER_SMOOTHING),
            MAX_PENALTY,
        )
        keys = self.constraints.keys
        of_speed = {key for limit in current.limits for key in limit.limit.keys}
        is_of_speed = np.array([key in of_speed for key in keys], dtype=bool)
        plausible = np.where(is_of_speed, _PLAUSIBLE_OF_SPEED, _PLAUSIBLE_OF_TUBE)
        rises = self.constraints.shared_rise(current).items()
        shared = {number: partial(linear.gained, *gains) for number, gains in rises}
        costs = limit_costs(linear, plausible, self.constraints.rise(current), shared)
        if costs is None:
            return {}
        # Rows of the tube are in radii, those of the limits in limits: the narrowing scales along.
        fraction = np.where(is_of_speed, 1.0, 1 - INNER_MARGIN)
        return dict(zip(keys, -costs / 2 * fraction, strict=True))

    def _hardly_move(self, regions: EvaluatedRegions | EvaluatedCones, size: StepSize) -> BoolArray:
        """Return True for vectors that a step moves less than the merit function ignores."""
        planes = regions.planes
        reach = np.full(len(regions.vector), np.inf)
        reach[planes.sample] = 0.0
        np.maximum.at(reach, planes.sample, self._reach(regions.rows(planes), size))
        moves = self.variables.move(regions.at)
        return (reach < MERIT_TOLERANCE) | ~np.repeat(moves, len(reach) // len(moves))

    def _reach(self, rows: Rows, size: StepSize) -> FloatArray:
        """Return the largest change of each row by a step of the variables, shape (R,)."""
        is_free = self.variables.column[rows.first[:, None] + np.arange(DEGREE + 1)] != FIXED
        return replace(rows, control=rows.control * is_free[:, :, None]).reach(size)

    def moved(
        self, current: Iterate, step: Step, start: FloatArray | None = None
    ) -> Iterate | None:
        """Return the iterate after a step, its moved start at (n,) if given; None if infeasible."""
        points = self.variables.moved(current.spline.control_points, step.control, start)
        if points is None:
            return None
        switching_times = current.spline.switching_times.copy()
        if self.grid.switch_count:
            switching_times[1:-1] += step.switching
        return self.constraints.at(PhasedSpline(self.grid, switching_times, points))

    def met(self, trial: Iterate) -> Iterate:
        """Return the iterate after a step, of a cautious leg with the links that are near there."""
        if not self._is_cautious:
            return trial
        self.constraints.links.add_samples(trial.spline)
        return self.constraints.at(trial.spline)

    def gains(
        self, current: Iterate, trial: Iterate, step: Step, penalty: float
    ) -> tuple[float, float]:
        """Return the predicted and the actual gain of a step, as fractions of T^2."""
        before, expected, actual = (
            max(excess - self.objective.ignored_excess, 0.0)
            for excess in (current.excess, step.elastic, trial.excess)
        )
        predicted = self.objective.predicted_gain(current, step)
        gain = self.objective.gain(current, trial)
        return predicted + penalty * (before - expected), gain + penalty * (before - actual)

    def radius_of(self, current: Iterate, step: Step, unit: float) -> float:
        """Return the radius of the smallest trust region, in units, that contains a step.

        Relative changes of the widths of phases count too: steps fail by them as by control points.
        """
        farthest = float(abs(step.control / self.units).max(initial=0.0)) / unit
        widths = np.diff(current.spline.switching_times)[: len(step.switching) + 1]
        changes = np.diff(step.switching, prepend=0.0, append=0.0)
        return max(farthest, float(abs(changes / widths).max()) / _WIDTH_FRACTION)

    def linearized(
        self, current: Iterate, trust: TrustRegion, penalty: float, remembered: Remembered
    ) -> Linearization:
        """Return the constraints and the cost of a step to first order."""
        bounds = self._bounds(current, trust)
        size = self._size(trust, bounds)
        rows, is_elastic = self.constraints.rows(current, size)
        near = (rows.slack < _NEAR) | (rows.slack < _NEAR_FRACTION * rows.reach(size))
        none = tuple(np.zeros(len(regions.vector), bool) for regions in current.convex)
        planes = _near_planes(current, none)
        if remembered.planes:
            planes = tuple(starmap(Planes.and_also, zip(planes, remembered.planes, strict=True)))
        regularization = self.cost.quadratic(current.spline, trust.damping)
        return Linearization(
            current,
            (rows, is_elastic),
            near | np.isin(rows.index, remembered.rows),
            planes,
            none,
            self.variables,
            bounds,
            self.objective.cost(current, self.variables, regularization),
            penalty,
        )

    def _size(self, trust: TrustRegion, bounds: Bounds) -> StepSize:
        units = None if (self.units == 1).all() else self.units
        return StepSize(trust.largest_change, bounds.switching, units)

    def _bounds(self, current: Iterate, trust: TrustRegion, *, goal_moves: bool = True) -> Bounds:
        widths = np.diff(current.spline.switching_times)
        widths *= min(_MAX_WIDTH_FRACTION, _WIDTH_FRACTION * trust.radius)
        switching = np.minimum(np.cumsum(widths)[:-1], np.cumsum(widths[::-1])[-2::-1])
        points, most = current.spline.control_points, trust.largest_change * self.units
        now, fixed = self.variables.of(points), self.variables.held(points)
        return Bounds(
            np.clip(self.variables.lower - now, -most, 0.0),
            np.clip(self.variables.upper - now, 0.0, most),
            switching[: self.grid.switch_count],
            widths,
            (self.objective.least_duration_step, _MAX_DURATION_STEP),
            fixed if goal_moves or len(fixed) == 0 else np.eye(points.shape[1]),
        )


def _near_planes(current: Iterate, ignored: tuple[BoolArray, ...]) -> tuple[Planes, ...]:
    """Return the near planes of every kind of regions, except at ignored samples."""
    near = []
    for regions, is_ignored in zip(current.convex, ignored, strict=True):
        planes = regions.planes
        is_near = (regions.slack(planes) < _NEAR) | regions.is_crossed
        is_near &= not regions.is_speed  # limits on the speed have rows along present directions
        near.append(planes.where(is_near & ~is_ignored[planes.sample]))
    return tuple(near)


# ---- Shortening one or more legs by sequential linear programs with a trust region.
#
# Consecutive legs may be tied: one begins where the other ends, wherever that is best for the sum
# of their durations. A leg's gain counts by the leg's fraction of that sum.

# Steps that gain less than this fraction of the prediction get a second-order correction.
_GOOD_RATIO = 0.3
# Corrections at most. Another follows while what is missing to the prediction falls to this
# fraction at most: after a rejected step, to the second.
_MAX_CORRECTIONS, _HALVED, _LESS = 6, 0.5, 0.95
# Steps that gain less than this fraction of the prediction after the correction are rejected.
_WORTH_A_MOVE = 0.02
# A step that should lose this fraction of T^2 obeys planes of two segments that contradict each
# other.
_CONTRADICTION = 5e-4
# Steps that leave less than this fraction of the violation mend it, if not at once.
_MENDED = 0.9


class Descent:
    """The optimisation of splines, each on a knot grid of its own."""

    def __init__(
        self, legs: Sequence[SequentialProgram], is_tied: Sequence[bool] = (False,)
    ) -> None:
        """Take legs, and whether each ends where the next one begins, the last one the first."""
        self._legs, self._is_tied = legs, is_tied

    def improved(
        self,
        begun: DescentState,
        *,
        min_gain: float,
        max_steps: int,
        checkpoint: Callable[[tuple[Iterate, ...]], None] = lambda iterates: None,
    ) -> DescentState:
        """Return trajectories with a smaller sum of durations, or the first iterates.

        Args:
            begun: The first iterates, trust region and penalty; the unit of the trust region is
                that of the trajectories.
            min_gain: The descent ends when a step should gain less than this fraction of T^2, or
                two accepted steps in a row gain less.
            max_steps: Largest number of steps.
            checkpoint: Called with all iterates after each step; it may raise to end the work.
        """
        currents, penalty = begun.iterates, begun.penalty
        each = zip(self._legs, currents, strict=True)
        unit = motion_unit(current.spline.control_points / leg.units for leg, current in each)
        trust = replace(begun.trust, unit=unit)
        small_gains, remembered = 0, (_NOTHING,) * len(self._legs)
        remaining = _HALVED
        for _ in range(max_steps):
            linear = _Linearized(self._legs, self._is_tied, currents, trust, penalty, remembered)
            steps = linear.search.solve()
            remembered = remembered if steps is None else linear.remembered(steps)
            result = None if steps is None else linear.tried(steps, unit, remaining)
            if steps is None or result is None:
                trust = trust.smaller()
                continue
            trials, outcome = result
            # A higher penalty may help a step that leaves nearly all of the violation. A step that
            # mends a part is limited by its trust region: a higher penalty would mend no more, and
            # drown the duration. (After Byrd, Nocedal & Waltz, "Steering exact penalty methods for
            # nonlinear programming", 2008.)
            if any(
                step.elastic > max(BROKEN, _MENDED * current.excess)
                for current, step in zip(currents, steps, strict=True)
            ):
                penalty = min(4 * penalty, MAX_PENALTY)
            remaining = _LESS
            if outcome.ratio > _WORTH_A_MOVE:
                met = tuple(starmap(SequentialProgram.met, zip(self._legs, trials, strict=True)))
                if any(
                    after.excess > max(before.excess, current.excess)
                    for after, before, current in zip(met, trials, currents, strict=True)
                ):
                    # The next step, from the same place, obeys the links that this one met.
                    currents = tuple(
                        leg.constraints.at(current.spline)
                        for leg, current in zip(self._legs, currents, strict=True)
                    )
                    checkpoint(currents)
                    continue
                currents, remaining = met, _HALVED
                small_gains = small_gains + 1 if outcome.gain < min_gain else 0
            checkpoint(currents)
            trust = trust.after(outcome)
            is_small = outcome.predicted < min_gain
            if is_small and trust.may_relax:
                trust, small_gains = trust.relaxed(), 0
            elif is_small or small_gains == 2 or trust.has_collapsed:
                return DescentState(currents, trust, penalty, has_ended=True)
        return DescentState(currents, trust, penalty, has_ended=False)


class _Linearized:
    """All legs at their trajectories to first order: steps, trials and gains."""

    def __init__(
        self,
        legs: Sequence[SequentialProgram],
        is_tied: Sequence[bool],
        currents: Sequence[Iterate],
        trust: TrustRegion,
        penalty: float,
        remembered: Sequence[Remembered],
    ) -> None:
        self._legs, self._is_tied, self._currents = legs, is_tied, currents
        self._penalty = penalty
        durations = np.array([current.duration for current in currents])
        self._weights = (durations / durations.sum()).tolist()
        each = zip(legs, currents, remembered, self._weights, strict=True)
        self._linear = [
            leg.linearized(current, trust, penalty, own).weighted(weight)
            for leg, current, own, weight in each
        ]
        columns = shared_columns([linear.shape for linear in self._linear], is_tied)
        self.search = StepSearch(self._linear, columns)

    def remembered(self, steps: Sequence[Step]) -> tuple[Remembered, ...]:
        each = zip(self._linear, steps, strict=True)
        return tuple(Remembered(linear.added, linear.binding(step)) for linear, step in each)

    def tried(
        self, steps: Sequence[Step], unit: float, remaining: float
    ) -> tuple[tuple[Iterate, ...], Outcome] | None:
        """Return the iterates after steps, corrected if they gain little, and their outcome.

        None if a step is infeasible or its program contradicts itself. Corrections go on while what
        is missing falls to the fraction `remaining` at most.
        """
        trials = self._moved(steps)
        if trials is None:
            return None
        predicted, first_gain = self._gains(trials, steps)
        if predicted < -_CONTRADICTION:
            return None
        gain = first_gain
        if gain < _GOOD_RATIO * predicted:
            trials, gain = self._corrected(steps, trials, predicted, gain, remaining)
        rates, radius = 0.0, 0.0
        each = zip(self._weights, self._legs, self._currents, steps, strict=True)
        for weight, leg, current, step in each:
            leg.objective.after(step)
            squared = leg.cost.squared_rates(current.spline, step.control, step.switching)
            rates += weight * squared
            radius = max(radius, leg.radius_of(current, step, unit))
        return trials, Outcome(predicted, first_gain, gain, radius, rates)

    def _moved(self, steps: Sequence[Step]) -> tuple[Iterate, ...] | None:
        """Return the iterates after steps, tied ends agreeing; None if a leg has none."""
        each = list(zip(self._legs, self._currents, steps, strict=True))
        starts: list[FloatArray | None] = [None] * len(each)
        for k, (leg, current, step) in enumerate(each):
            if self._is_tied[k]:
                goal = leg.variables.goal_after(current.spline.control_points, step.control)
                if goal is None:
                    return None
                starts[(k + 1) % len(each)] = goal
        trials = []
        for (leg, current, step), start in zip(each, starts, strict=True):
            trial = leg.moved(current, step, start)
            if trial is None:
                return None
            trials.append(trial)
        return tuple(trials)

    def _gains(self, trials: Sequence[Iterate], steps: Sequence[Step]) -> tuple[float, float]:
        """Return the predicted and the actual gain of steps: fractions of T^2, weighted."""
        predicted, gain = 0.0, 0.0
        each = zip(self._weights, self._legs, self._currents, trials, steps, strict=True)
        for weight, leg, current, trial, step in each:
            expected, actual = leg.gains(current, trial, step, self._penalty)
            predicted += weight * expected
            gain += weight * actual
        return predicted, gain

    def _corrected(
        self,
        steps: Sequence[Step],
        trials: tuple[Iterate, ...],
        predicted: float,
        gain: float,
        remaining: float,
    ) -> tuple[tuple[Iterate, ...], float]:
        """Return trials and gain, of steps corrected for the constraints' curvature if better.

        (Second-order correction: Nocedal & Wright, "Numerical Optimization", 2006, section 18.3.)
        A correction leaves a tenth to a third of the error of efforts, their rates and jerks: it is
        repeated while it pays.
        """
        best, missing = (trials, gain), predicted - gain
        for further in reversed(range(_MAX_CORRECTIONS)):
            each = zip(self._legs, self._currents, trials, steps, strict=True)
            slack = [
                leg.constraints.slack(current, trial, 1 + step.duration)
                for leg, current, trial, step in each
            ]
            others = self.search.solve_again(steps, trials, slack)
            moved = None if others is None else self._moved(others)
            if others is None or moved is None:
                break
            steps, trials = others, moved
            gain = self._gains(trials, steps)[1]
            if not np.isfinite(gain):  # no speed is slow enough: a shorter step is
                break
            if gain > best[1]:
                best = trials, gain
            left, missing = (predicted - gain) / missing, predicted - gain
            # Not where further corrections like this one would leave too much.
            is_far = missing * left**further > (1 - _WORTH_A_MOVE) * predicted
            if gain >= _GOOD_RATIO * predicted or left > remaining or is_far:
                break
        return best
