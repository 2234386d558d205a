"""SequentialProgram: one leg on one knot grid; costs of its limits."""

from collections.abc import Callable
from dataclasses import replace
from itertools import starmap

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray
from tubeplanner.limits.path_samples import LimitKey
from tubeplanner.optimizer.control_variables import FIXED, ControlVariables, shared_columns
from tubeplanner.optimizer.descent import (
    MAX_PENALTY,
    Descent,
    Improved,
    Remembered,
    StepSearch,
    TrustRegion,
)
from tubeplanner.optimizer.linearization import BROKEN, Given, Linearization
from tubeplanner.optimizer.link_constraints import LinkConstraints
from tubeplanner.optimizer.phased_spline import DEGREE, KnotGrid, PhasedSpline
from tubeplanner.optimizer.region_constraints import EvaluatedRegions, Planes, goal_keys
from tubeplanner.optimizer.rows import INNER_MARGIN, MERIT_TOLERANCE, Rows, StepSize
from tubeplanner.optimizer.spline_constraints import Iterate, SplineConstraints
from tubeplanner.optimizer.step_objective import StepCost, StepObjective
from tubeplanner.optimizer.step_program import Bounds, Step, step_program
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


class SequentialProgram:
    """The optimisation of splines on a knot grid.

    Attributes:
        constraints: The constraints of the splines.
        grid: The splines' knots.
        variables: The variable control points.
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
        """
        self._objective = objective or StepObjective()
        radius = problem.tube.effective_radius if radius is None else radius
        links = links or LinkConstraints(problem)
        self.constraints = SplineConstraints(
            problem, grid, links, radius, self._objective.run_in, slack
        )
        self._problem, self.grid = problem, grid
        self.variables = ControlVariables(problem, grid, start_moves=start_moves)
        self._cost = StepCost(self.variables, grid, problem.robot.joint_count)

    def iterate(self, spline: PhasedSpline) -> Iterate:
        """Return the iterate of a spline, its control points clipped to the joints' bounds."""
        points = self.variables.within_bounds(spline.control_points)
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
        """Return a shorter trajectory, or the first iterate; see `Descent.improved`."""
        descent = Descent((self,), (False,))
        return descent.improved(
            (current,),
            trust,
            penalty,
            min_gain=min_gain,
            max_steps=max_steps,
            checkpoint=lambda iterates: checkpoint(*iterates),
        )

    def elasticities(self, current: Iterate) -> dict[LimitKey, float]:
        """Return d ln T / d ln p of an optimal spline, for every limit p: none is positive.

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
        size = StepSize(_MULTIPLIER_TRUST.largest_change, bounds.switching)
        # Samples that variables hardly move, such as a start on its tolerance, cost nothing.
        still = tuple(self._hardly_move(own, size) for own in current.regions)
        near = (rows.slack < _NEAR) & (self._reach(rows, size) + abs(rows.duration) > 0)
        linear = Linearization(
            current,
            (rows, is_elastic),
            Given(near, _near_planes(current, still), still),
            self.variables,
            bounds,
            self._cost.quadratic(current.spline).times(_MULTIPLIER_SMOOTHING),
            MAX_PENALTY,
        )
        keys = self.constraints.keys
        of_speed = {key for limit in current.limits for key in limit.limit.keys}
        is_of_speed = np.array([key in of_speed for key in keys], dtype=bool)
        plausible = np.where(is_of_speed, _PLAUSIBLE_OF_SPEED, _PLAUSIBLE_OF_TUBE)
        costs = limit_costs(linear, plausible, self.constraints.rise(current))
        if costs is None:
            return {}
        # Rows of the tube are in radii, those of the limits in limits: the narrowing scales along.
        fraction = np.where(is_of_speed, 1.0, 1 - INNER_MARGIN)
        return dict(zip(keys, -costs / 2 * fraction, strict=True))

    def _hardly_move(self, regions: EvaluatedRegions, size: StepSize) -> BoolArray:
        """Return True for samples that a step moves less than the merit function ignores, (N,)."""
        planes = regions.planes
        reach = np.full(len(regions.vector), np.inf)
        reach[planes.sample] = 0.0
        np.maximum.at(reach, planes.sample, self._reach(regions.rows(planes), size))
        return (reach < MERIT_TOLERANCE) | ~self.variables.move(regions.at)

    def _reach(self, rows: Rows, size: StepSize) -> FloatArray:
        """Return the largest change of each row by a step of the variables, shape (R,)."""
        is_free = self.variables.column[rows.first[:, None] + np.arange(DEGREE + 1)] != FIXED
        return replace(rows, control=rows.control * is_free[:, :, None]).reach(size)

    def goal_after(self, current: Iterate, step: Step) -> FloatArray | None:
        """Return the configuration (n,) at a goal that moves; None if the tool leaves the goal."""
        return self.variables.goal_after(current.spline.control_points, step.control)

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

    def gains(
        self, current: Iterate, trial: Iterate, step: Step, penalty: float
    ) -> tuple[float, float]:
        """Return the predicted and the actual gain of a step, as fractions of T^2."""
        before, expected, actual = (
            max(excess - self._objective.ignored_excess, 0.0)
            for excess in (current.excess, step.elastic, trial.excess)
        )
        predicted = self._objective.predicted_gain(current, step)
        gain = self._objective.gain(current, trial)
        return predicted + penalty * (before - expected), gain + penalty * (before - actual)

    def slack(self, current: Iterate, trial: Iterate, step: Step) -> FloatArray:
        """Return the slack of a linearization's rows after a step, by their numbers."""
        return self.constraints.slack(current, trial, 1 + step.duration)

    def squared_rates(self, current: Iterate, step: Step) -> float:
        """Return the squared rates of a step, as `StepCost.squared_rates`."""
        return self._cost.squared_rates(current.spline, step.control, step.switching)

    def radius_of(self, current: Iterate, step: Step, unit: float) -> float:
        """Return the radius of the smallest trust region, in units, that contains a step.

        Relative changes of the widths of phases count too: steps fail by them as by control points.
        """
        farthest = float(abs(step.control).max(initial=0.0)) / unit
        widths = np.diff(current.spline.switching_times)[: len(step.switching) + 1]
        changes = np.diff(step.switching, prepend=0.0, append=0.0)
        return max(farthest, float(abs(changes / widths).max()) / _WIDTH_FRACTION)

    def after(self, step: Step) -> None:
        """Record a solution of the step's program."""
        self._objective.after(step)

    def linearized(
        self, current: Iterate, trust: TrustRegion, penalty: float, remembered: Remembered
    ) -> Linearization:
        """Return the constraints and the cost of a step to first order."""
        bounds = self._bounds(current, trust)
        size = StepSize(trust.largest_change, bounds.switching)
        rows, is_elastic = self.constraints.rows(current, size)
        near = (rows.slack < _NEAR) | (rows.slack < _NEAR_FRACTION * rows.reach(size))
        none = tuple(np.zeros(len(regions.vector), bool) for regions in current.regions)
        planes = _near_planes(current, none)
        if remembered.planes:
            planes = tuple(starmap(Planes.and_also, zip(planes, remembered.planes, strict=True)))
        regularization = self._cost.quadratic(current.spline, trust.damping)
        return Linearization(
            current,
            (rows, is_elastic),
            Given(near | np.isin(rows.index, remembered.rows), planes, none),
            self.variables,
            bounds,
            self._objective.cost(current, self.variables, regularization),
            penalty,
        )

    def _bounds(self, current: Iterate, trust: TrustRegion, *, goal_moves: bool = True) -> Bounds:
        widths = np.diff(current.spline.switching_times)
        widths *= min(_MAX_WIDTH_FRACTION, _WIDTH_FRACTION * trust.radius)
        switching = np.minimum(np.cumsum(widths)[:-1], np.cumsum(widths[::-1])[-2::-1])
        points = current.spline.control_points
        now, fixed = self.variables.of(points), self.variables.held(points)
        return Bounds(
            np.clip(self.variables.lower - now, -trust.largest_change, 0.0),
            np.clip(self.variables.upper - now, 0.0, trust.largest_change),
            switching[: self.grid.switch_count],
            widths,
            (self._objective.least_duration_step, _MAX_DURATION_STEP),
            fixed if goal_moves or len(fixed) == 0 else np.eye(points.shape[1]),
        )


def _near_planes(current: Iterate, ignored: tuple[BoolArray, ...]) -> tuple[Planes, ...]:
    """Return the near planes of every kind of regions, except at ignored samples."""
    near = []
    for regions, is_ignored in zip(current.regions, ignored, strict=True):
        planes = regions.planes
        is_near = (regions.slack(planes) < _NEAR) | regions.is_crossed
        near.append(planes.where(is_near & ~is_ignored[planes.sample]))
    return tuple(near)


# ---- Cost of each limit, by the multipliers of a leg's linear program.
#
# Multipliers hold for infinitesimal changes. Where the steps that a limit bars hardly use it, as
# next to a start on a tolerance, other limits bar them at once: where a multiplier is large, the
# program is solved with a rise of the limit.

# Where elastic rows cost more than this fraction of their penalty, multipliers tell the penalty:
# then this multiple of their violation is allowed, or this much.
_FRACTION_OF_PENALTY, _SPARE_FRACTION, _MIN_SPARE = 0.5, 2.0, 1e-5
# The rise. (Beside such a start, multipliers of a tolerance said 0.3 to 400 where rises of 0.1 % to
# 10 % gained nothing. Steps of the program have room for this one.)
_RISE = 0.03
_TOLERANCE = 1e-6  # of the solution, absolute and relative


def limit_costs(
    linear: Linearization, plausible: FloatArray, rise: FloatArray
) -> FloatArray | None:
    """Return the cost of each limit, shape (L,): d ln T^2 by its relative rise.

    Args:
        linear: The constraints to first order.
        plausible: Largest cost of each limit at which multipliers are believed, shape (L,).
        rise: Slack of each row per relative rise of its limit, by the rows' numbers; of planes, 1.

    Returns:
        None if constraints stay violated: multipliers tell the penalty alone.
    """
    step = _exact_step(linear)
    if step is None or step.elastic > BROKEN:
        return None
    limit, index = linear.limits()
    gained = np.where(index >= 0, rise[index], 1.0)
    count = len(step.multipliers)  # rows that were added later are not in the program
    costs, has_limit = np.zeros(len(plausible)), limit[:count] >= 0
    by_row = np.maximum(step.multipliers * gained[:count], 0.0)
    np.add.at(costs, limit[:count][has_limit], by_row[has_limit])
    for k in np.flatnonzero(costs > plausible):
        risen = _solved(linear, _TOLERANCE, _RISE * gained * (limit == k))
        if risen is not None:
            costs[k] = max(step.duration - risen.duration, 0.0) / _RISE
    return costs


def _exact_step(linear: Linearization) -> Step | None:
    """Return the step to the finer tolerance, or to the usual tolerance if the solver fails.

    If elastic rows stay slightly violated, that much is allowed: else multipliers tell the penalty.
    """
    search = StepSearch([linear], shared_columns([linear.shape], [False]))
    steps = search.solve()
    if steps is None:
        return None
    (exact,) = search.solve_closely(_TOLERANCE) or steps
    elastic = linear.elastic_rows
    cost = float(abs(exact.multipliers * elastic[: len(exact.multipliers)]).sum())
    if cost < _FRACTION_OF_PENALTY * linear.penalty:
        return exact
    spare = max(_SPARE_FRACTION * exact.elastic, _MIN_SPARE)
    return _solved(linear, _TOLERANCE, spare * elastic) or exact


def _solved(
    linear: Linearization, tolerance: float, extra: FloatArray | float = 0.0
) -> Step | None:
    """Return the step of the program whose rows have some more slack."""
    columns = shared_columns([linear.shape], [False])
    steps = step_program([linear.block(linear.plain, extra)], columns).solve(tolerance)
    return None if steps is None else steps[0]
