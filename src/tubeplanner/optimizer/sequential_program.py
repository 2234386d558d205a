"""SequentialProgram: one leg on one knot grid; costs of its limits.

They hold for the least change. Where the steps that a limit bars from all hardly use it, as next to
a start on a tolerance, others bar them at once: where multipliers say much, a rise is tried.
"""

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
from tubeplanner.optimizer.step_block import Bounds, Step
from tubeplanner.optimizer.step_objective import ShortestDuration, StepCost, StepObjective
from tubeplanner.optimizer.step_program import step_program
from tubeplanner.task.problem import PlanningProblem

# ---- What each limit costs, by the multipliers of a leg's linear program.

# Where elastic rows cost more than this share of their penalty, multipliers say little else: then
# so many times what they are violated by is allowed, or this much.
_SHARE_OF_PENALTY, _SPARE_SHARE, _LEAST_SPARE = 0.5, 2.0, 1e-5
# The rise that is tried. (Beside such a start, multipliers of a tolerance said 0.3 to 400 where
# rises of 0.1 % to 10 % gained nothing. Steps of the program have room for this one.)
_RISE = 0.03
_TOLERANCE = 1e-6  # of the solution, absolute and relative


def limit_costs(
    linear: Linearization, plausible: FloatArray, rise: FloatArray
) -> FloatArray | None:
    """Return what each limit costs, shape (L,): d ln T^2 by its relative rise.

    Args:
        linear: The constraints to first order.
        plausible: Up to which cost of each limit multipliers are believed, shape (L,).
        rise: What slack a relative rise of its limit adds to each row, by the rows' numbers; to
            planes it adds all.

    Returns:
        None where multipliers tell the penalty alone: something stays violated.
    """
    step = _exact_step(linear)
    if step is None or step.elastic > BROKEN:
        return None
    limit, index = linear.limits()
    gained = np.where(index >= 0, rise[index], 1.0)
    known = slice(len(step.multipliers))  # what was added since is no part of the program
    costs, named = np.zeros(len(plausible)), limit[known] >= 0
    np.add.at(costs, limit[known][named], np.maximum(step.multipliers * gained[known], 0.0)[named])
    for k in np.flatnonzero(costs > plausible):
        risen = _solved(linear, _TOLERANCE, _RISE * gained * (limit == k))
        if risen is not None:
            costs[k] = max(step.duration - risen.duration, 0.0) / _RISE
    return costs


def _exact_step(linear: Linearization) -> Step | None:
    """Return the step to the finer tolerance, once it is known what counts.

    Where the solver does not get there, as near as steps are elsewhere. If something stays
    violated, by next to nothing, that much is allowed: else multipliers tell the penalty.
    """
    search = StepSearch([linear], shared_columns([linear.shape], [False]))
    steps = search.solve()
    if steps is None:
        return None
    (exact,) = search.solve_closely(_TOLERANCE) or steps
    elastic = linear.elastic_rows
    cost = float(abs(exact.multipliers * elastic[: len(exact.multipliers)]).sum())
    if cost < _SHARE_OF_PENALTY * linear.penalty:
        return exact
    spare = max(_SPARE_SHARE * exact.elastic, _LEAST_SPARE)
    return _solved(linear, _TOLERANCE, spare * elastic) or exact


def _solved(
    linear: Linearization, tolerance: float, extra: FloatArray | float = 0.0
) -> Step | None:
    """Return the step of the program whose rows have some more slack."""
    columns = shared_columns([linear.shape], [False])
    steps = step_program([linear.block(linear.plain, extra)], columns).solve(tolerance)
    return None if steps is None else steps[0]


# ---- Shortening a trajectory on one knot grid: what the descent asks of one leg.
#
# The unknowns are the control points, the switching times and the squared duration. After every
# step the duration is made exact by time scaling, so that each iterate keeps all limits at its
# samples; tube and clearances are elastic.

# Rows are given to the solver if they are this near, or a part of the trust region away.
_NEAR, _NEAR_SHARE = 0.03, 0.03
_LARGEST_DURATION_STEP = 1.0
# Phases change by at most this share of their width, and of the trust region.
_MAX_WIDTH_SHARE, _WIDTH_SHARE = 0.3, 8.0
# For the multipliers: a small trust region, hardly any quadratic part.
_MULTIPLIER_TRUST = TrustRegion(0.02, 0.0)
_MULTIPLIER_SMOOTHING = 1e-3
# Up to these costs they are believed: d ln T^2 by a relative rise is 2 at most for a velocity.
# (Of a tolerance that the start is on, multipliers said 0.15 where a rise gained nothing.)
_PLAUSIBLE_OF_SPEED, _PLAUSIBLE_OF_TUBE = 2.0, 0.1


class SequentialProgram:
    """The optimisation of splines on one knot grid.

    Attributes:
        constraints: The constraints of the splines.
        grid: The splines' knots.
        variables: What may change.
    """

    def __init__(
        self,
        problem: PlanningProblem,
        grid: KnotGrid,
        links: LinkConstraints | None = None,
        radius: FloatArray | None = None,
        objective: StepObjective | None = None,
        room: FloatArray | None = None,
        *,
        start_moves: bool = False,
    ) -> None:
        """Prepare it.

        Args:
            problem: The planning problem.
            grid: The splines' knots.
            links: What is watched of the links already.
            radius: Of the tube's segments, if not their own, shape (m,) [m].
            objective: What steps are to gain; None: a shorter duration.
            room: The share of the tube's regions that stays unused, shape (m,); None: none.
            start_moves: Whether the start is tied to where another leg ends.
        """
        self._objective: StepObjective = objective or ShortestDuration()
        radius = problem.tube.effective_radius if radius is None else radius
        links = links or LinkConstraints(problem)
        self.constraints = SplineConstraints(
            problem, grid, links, radius, self._objective.run_in, room
        )
        self._problem, self.grid = problem, grid
        self.variables = ControlVariables(problem, grid, start_moves=start_moves)
        self._cost = StepCost(self.variables, grid, problem.robot.joint_count)

    def iterate(self, spline: PhasedSpline) -> Iterate:
        """Return a trajectory with its cost, its control points moved into the joints' bounds."""
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
        """Return a shorter trajectory, if there is one.

        Args:
            current: Where to start.
            trust: The first trust region.
            penalty: First weight of the elastic constraints.
            min_gain: A step that should gain less than this share of T^2 ends it, or two that do.
            max_steps: So many steps end it too.
            checkpoint: Called with every iterate; it may raise to end the work.
        """
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
        size = StepSize(_MULTIPLIER_TRUST.largest_change, bounds.switching)
        still = tuple(self._hardly_move(regions, size) for regions in current.regions)
        given = (rows.slack < _NEAR) & (self._reach(rows, size) + abs(rows.duration) > 0)
        linear = Linearization(
            current,
            (rows, is_elastic),
            Given(given, _near_planes(current, still), still),
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
        share = np.where(is_of_speed, 1.0, 1 - INNER_MARGIN)
        return dict(zip(keys, -costs / 2 * share, strict=True))

    def _hardly_move(self, regions: EvaluatedRegions, size: StepSize) -> BoolArray:
        """Return which samples a step moves by less than what the merit function ignores, (N,)."""
        planes = regions.planes
        reach = np.full(len(regions.vector), np.inf)
        reach[planes.sample] = 0.0
        np.maximum.at(reach, planes.sample, self._reach(regions.rows(planes), size))
        return (reach < MERIT_TOLERANCE) | ~self.variables.move(regions.at)

    def _reach(self, rows: Rows, size: StepSize) -> FloatArray:
        """Return how far a step of the variables can move each row, shape (R,)."""
        is_free = self.variables.column[rows.first[:, None] + np.arange(DEGREE + 1)] != FIXED
        return replace(rows, control=rows.control * is_free[:, :, None]).reach(size)

    def goal_after(self, current: Iterate, step: Step) -> FloatArray | None:
        """Return the configuration (n,) at a goal that moves; None if the tool leaves it."""
        return self.variables.goal_after(current.spline.control_points, step.control)

    def moved(
        self, current: Iterate, step: Step, start: FloatArray | None = None
    ) -> Iterate | None:
        """Return where a step leads, a start that moves to a configuration; None if nowhere."""
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
        """Return what a step should have gained, and what it did, in shares of T^2."""
        before, expected, found = (
            max(excess - self._objective.ignored_excess, 0.0)
            for excess in (current.excess, step.elastic, trial.excess)
        )
        predicted = self._objective.predicted_gain(current, step)
        gain = self._objective.gain(current, trial)
        return predicted + penalty * (before - expected), gain + penalty * (before - found)

    def slack(self, current: Iterate, trial: Iterate, step: Step) -> FloatArray:
        """Return the slack of a linearization's rows after a step, by their numbers."""
        return self.constraints.slack(current, trial, 1 + step.duration)

    def squared_rates(self, current: Iterate, step: Step) -> float:
        """Return the squared rates of a step, as `StepCost.squared_rates`."""
        return self._cost.squared_rates(current.spline, step.control, step.switching)

    def radius_of(self, current: Iterate, step: Step, unit: float) -> float:
        """Return the radius of the smallest trust region, in units, that has room for a step.

        Phases that hardly have a width let a step fail as control points do.
        """
        farthest = float(abs(step.control).max(initial=0.0)) / unit
        widths = np.diff(current.spline.switching_times)[: len(step.switching) + 1]
        changes = np.diff(step.switching, prepend=0.0, append=0.0)
        return max(farthest, float(abs(changes / widths).max()) / _WIDTH_SHARE)

    def after(self, step: Step) -> None:
        """Take note of a step that the program found."""
        self._objective.after(step)

    def linearized(
        self, current: Iterate, trust: TrustRegion, penalty: float, remembered: Remembered
    ) -> Linearization:
        """Return the constraints and the cost of a step to first order."""
        bounds = self._bounds(current, trust)
        size = StepSize(trust.largest_change, bounds.switching)
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
            self.variables,
            bounds,
            self._objective.cost(
                current,
                self.variables,
                self._cost.quadratic(current.spline, trust.damping),
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
        now, joints = self.variables.of(points), points.shape[1]
        held = self.variables.held(points)
        return Bounds(
            np.clip(self.variables.lower - now, -trust.largest_change, 0.0),
            np.clip(self.variables.upper - now, 0.0, trust.largest_change),
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
        planes = regions.planes
        is_near = (regions.slack(planes) < _NEAR) | regions.is_crossed
        found.append(planes.where(is_near & ~left_out[planes.sample]))
    return tuple(found)
