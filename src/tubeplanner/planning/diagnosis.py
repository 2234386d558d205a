"""Diagnosis: the first blocked place of the reference path, and its reason."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.certificate.refusal import clear_by, require_free
from tubeplanner.first_guess.branches import KnownBranches
from tubeplanner.first_guess.inverse_kinematics import (
    PositionSolution,
    solve_position,
    solve_within_tolerance,
)
from tubeplanner.first_guess.pose_configurations import (
    OutsideBounds,
    bounded_by,
    middle_of,
    outside_bounds,
    spread_seeds,
)
from tubeplanner.first_guess.segment_walk import explain_turn
from tubeplanner.limits.joint_efforts import require_held
from tubeplanner.outcome import (
    MARGIN_TOLERANCE,
    Infeasible,
    Place,
    PlanningClock,
    PlanStatus,
    TimeLimitReached,
)
from tubeplanner.planning.necessary_conditions import largest_distances
from tubeplanner.planning.result import PlanResult, refused_result
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.required_distances import RequiredDistances

# ---- Places on the reference path at which one asks what keeps the arm from them.

_MOST_SEGMENTS = 8
# The tool may miss a place by this share of the radius, as a branch may.
_RADIUS_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class Spot:
    """A place of the tool.

    Attributes:
        name: What messages call it.
        segments: The one or two segments of the tube that it belongs to.
        tool: The tool's position, shape (3,) [m].
        allowed: How far the tool may be from there [m].
        place: The same for messages.
        is_goal: Whether it is the open goal.
        rotation_rows: The rows of the rotation tolerance that hold here.
    """

    name: str
    segments: tuple[int, ...]
    tool: FloatArray
    allowed: float
    place: Place
    rotation_rows: tuple[int, ...]
    is_goal: bool = False


def path_spots(problem: PlanningProblem, end: Place, is_wide: bool = False) -> list[Spot]:
    """Return places at which the arm must have a configuration.

    Reference points but the first, the goal if it is open, then places between; of a long path only
    those near where a branch ended, and the last.

    Args:
        problem: The planning problem.
        end: Where the branch ended, if that is known.
        is_wide: Whether the tool may be wherever the tube lets it pass the place, not only near it.
    """
    spots = _path_spots(problem, end)
    if not is_wide:
        return spots
    return [replace(spot, allowed=_widest(problem, spot)) for spot in spots]


def _widest(problem: PlanningProblem, spot: Spot) -> float:
    """Return how far from a place the tool may pass it [m]."""
    if spot.is_goal:
        return spot.allowed
    first, tube = spot.segments[0], problem.tube
    is_corner = len(spot.segments) > 1
    return float(largest_distances(tube)[first] if is_corner else tube.effective_radius[first])


def _path_spots(problem: PlanningProblem, end: Place) -> list[Spot]:
    """Return the places; near them a branch may miss them a little."""
    segments = _segments(problem, end)
    last = problem.tube.segment_count - 1
    points = [_corner(problem, k) for k in segments if k < last]
    if problem.open_goal is not None:
        points.append(_goal_spot(problem))
    return points + [spot for k in segments for spot in _inside(problem, k, end)]


def _segments(problem: PlanningProblem, end: Place) -> list[int]:
    tube = problem.tube
    count = tube.segment_count
    ended = [k for k in range(count) if tube.segment_number(k) == end.segment]
    around = ended[0] if ended else 0
    nearest = sorted(range(count), key=lambda k: abs(k - around))[: _MOST_SEGMENTS - 1]
    return sorted({*nearest, count - 1})


def _inside(problem: PlanningProblem, segment: int, end: Place) -> list[Spot]:
    """Return the middle of a segment, and where the branch ended if it did in this one."""
    tube = problem.tube
    begin = tube.points[segment]
    tools = [(begin + tube.points[segment + 1]) / 2]
    if end.position is not None and end.segment == tube.segment_number(segment):
        tools.append(np.array(end.position))
    tools.sort(key=lambda tool: float(np.linalg.norm(tool - begin)))
    return [_between(problem, segment, tool) for tool in tools]


def _between(problem: PlanningProblem, segment: int, tool: FloatArray) -> Spot:
    number = problem.tube.segment_number(segment, tool)
    allowed = _RADIUS_SHARE * float(problem.tube.effective_radius[segment])
    place = Place(segment=number).at(tool)
    return Spot("reference points", (segment,), tool, allowed, place, (segment,))


def _corner(problem: PlanningProblem, segment: int) -> Spot:
    tube, both = problem.tube, (segment, segment + 1)
    tool, number = tube.points[segment + 1], int(tube.numbers[segment + 1])
    allowed = _RADIUS_SHARE * float(tube.effective_radius[list(both)].min())
    place = Place(segment=tube.segment_number(segment, tool), point=number).at(tool)
    return Spot(f"reference point {number}", both, tool, allowed, place, both)


def _goal_spot(problem: PlanningProblem) -> Spot:
    """Return the open goal of a problem."""
    tube, goal = problem.tube, problem.open_goal
    assert goal is not None
    last = tube.segment_count - 1
    number = tube.segment_number(last, goal.position)
    place = Place(segment=number, point=int(tube.numbers[-1])).at(goal.position)
    rows = (last, tube.segment_count) if goal.bounds_rotation else (last,)
    return Spot("goal", (last,), goal.position, goal.tolerance, place, rows, is_goal=True)


# ---- The first place on the reference path at which the arm has no configuration, and why.
#
# Conditions are asked in the order in which they matter: no motor, obstacle or orientation is in
# the way where the tool cannot be at all. Each is asked at all places before the next one.

_REACHED = 1e-6  # [m]
_MOST_SEEDS = 20
_Bounds: TypeAlias = tuple[FloatArray, FloatArray]
_Accepts: TypeAlias = Callable[[FloatArray], bool]
_Check: TypeAlias = Callable[["_Configurations"], Infeasible | None]


def blocked_spot(
    problem: PlanningProblem,
    start: FloatArray,
    end: Place,
    checkpoint: Callable[[], None] = lambda: None,
) -> Infeasible | None:
    """Return why the arm cannot be where the reference path leads it, or None if it can.

    At each place inverse kinematics begins with the start and with many configurations more: what
    none of them satisfies counts as impossible. Of the places between start and goal some are
    asked. The tool may miss them a little, as the tube allows.

    Args:
        problem: The planning problem.
        start: Its start configuration, shape (n,).
        end: Where a branch ended; the tool's position there is one of the places.
        checkpoint: Called before every place; it may raise to end the work.
    """
    checks = [*_POSITION_CHECKS, _not_free]
    if problem.rotation is not None:
        checks += _TURNED_CHECKS
    return _first_reason(problem, start, path_spots(problem, end), checks, checkpoint)


def surely_blocked_spot(
    problem: PlanningProblem, start: FloatArray, checkpoint: Callable[[], None] = lambda: None
) -> Infeasible | None:
    """Return why the arm cannot pass somewhere, as `blocked_spot`, but quickly and with less doubt.

    However the tool is turned, and wherever it passes in the tube.
    """
    spots = path_spots(problem, Place(), is_wide=True)
    return _first_reason(problem, start, spots, [*_POSITION_CHECKS, _not_free], checkpoint)


def _first_reason(
    problem: PlanningProblem,
    start: FloatArray,
    spots: list[Spot],
    checks: Sequence[_Check],
    checkpoint: Callable[[], None],
) -> Infeasible | None:
    there = [_Configurations(problem, spot, start) for spot in spots]
    for check in checks:
        for at in there:
            checkpoint()
            reason = check(at)
            if reason is not None:
                return reason
    return None


@dataclass(frozen=True, eq=False)
class _Configurations:
    """The arm's configurations at a place.

    Attributes:
        problem: The planning problem.
        spot: The place.
        start: The start configuration, shape (n,).
    """

    problem: PlanningProblem
    spot: Spot
    start: FloatArray

    @property
    def starts(self) -> int:
        """From how many configurations those within bounds are looked for."""
        return 2 * len(self._seeds())

    @property
    def free(self) -> _Bounds:
        """No bounds."""
        none = np.full(self.problem.robot.joint_count, np.inf)
        return -none, none

    @property
    def bounds(self) -> _Bounds:
        """What position limits and joint signs leave."""
        segments = list(self.spot.segments)
        lower, upper = self.problem.joint_lower[segments], self.problem.joint_upper[segments]
        return lower.max(axis=0), upper.min(axis=0)

    def first(
        self, bounds: _Bounds, accepts: _Accepts | None = None, *, turned: bool
    ) -> FloatArray | None:
        """Return a configuration (n,) that has the tool here, within bounds, and is accepted."""
        for solution in self.solutions(bounds, turned=turned):
            if self.is_there(solution, turned=turned) and (accepts is None or accepts(solution.q)):
                return solution.q
        return None

    def solutions(self, bounds: _Bounds, *, turned: bool) -> Iterator[PositionSolution]:
        """Yield the nearest that seeds lead to within bounds, here or not.

        Each seed first by itself, then from where it leads without bounds: joints held at a bound
        on the way may end far from there.
        """
        seeds = self._seeds()
        for seed in seeds:
            yield self._solved(seed, bounds, turned)
        if np.isinf(bounds).all():
            return
        for seed in seeds:
            other = self._solved(seed, self.free, turned)
            yield self._solved(self._turned_back(other.q), bounds, turned)

    def _seeds(self) -> list[FloatArray]:
        return [self.start, *spread_seeds(*self.bounds)[:_MOST_SEEDS]]

    def _solved(self, seed: FloatArray, bounds: _Bounds, turned: bool) -> PositionSolution:
        """Return where a seed leads."""
        robot, spot, tube = self.problem.robot, self.spot, self.problem.rotation
        if tube is None or not turned:
            return solve_position(robot, spot.tool, seed, *bounds)
        rows = spot.rotation_rows
        return solve_within_tolerance(robot, spot.tool, tube, rows, seed, *bounds)

    def unbounded(self, *, turned: bool) -> FloatArray:
        """Return configurations (c, n) that have the tool here, joints without bounds."""
        found = self.solutions(self.free, turned=turned)
        there = [self._turned_back(one.q) for one in found if self.is_there(one, turned=turned)]
        return np.array(there).reshape(-1, self.problem.robot.joint_count)

    def nearest(self, bounds: _Bounds) -> float:
        """Return how near the tool comes, turned anyhow [m]."""
        return min(one.error for one in self.solutions(bounds, turned=False))

    def is_there(self, solution: PositionSolution, *, turned: bool) -> bool:
        """Return whether a solution has the tool here, and turned as the tube asks if it must."""
        if solution.error > self.spot.allowed + _REACHED:
            return False
        return not turned or solution.rotation_error <= MARGIN_TOLERANCE

    def _turned_back(self, q: FloatArray) -> FloatArray:
        """Return a configuration (n,), its joints by whole turns nearest the middle of bounds."""
        turns = np.round((q - middle_of(*self.bounds)) / (2 * np.pi))
        back: FloatArray = q - 2 * np.pi * np.where(self.problem.robot.revolute, turns, 0.0)
        return back

    def tightest(self, row: int) -> float:
        """Return the least bound of a row of the rotation tolerance [rad]."""
        tube = self.problem.rotation
        return np.inf if tube is None else float(tube.bounds[row].min())

    def is_held(self, q: FloatArray) -> bool:
        """Return whether motors hold a configuration (n,)."""
        try:
            require_held(self.problem, q)
        except Infeasible:
            return False
        return True

    def is_free(self, q: FloatArray) -> bool:
        """Return whether a configuration (n,) is free, or nearly so where the tool may miss."""
        depth = -clear_by(self.problem, q, self.required(q)).min(initial=np.inf)
        return bool(depth <= self.spot.allowed + MARGIN_TOLERANCE)

    def required(self, q: FloatArray) -> FloatArray:
        """Return how far apart all pairs must be in a configuration (n,), shape (P,) [m]."""
        asked = RequiredDistances(self.problem, self.start, q if self.spot.is_goal else None)
        tool = self.problem.robot.tool_position(q[None])
        rows = [asked.at(np.array([segment]), tool)[0] for segment in self.spot.segments]
        least: FloatArray = np.min(rows, axis=0)
        return least

    def unreachable(self, reason: str, joint: str | None = None) -> Infeasible:
        """Return that the tool cannot be here, for a reason, because of a joint if it is known."""
        message = f"{self.spot.place}: {reason}"
        place = replace(self.spot.place, joint=joint)
        return Infeasible(PlanStatus.UNREACHABLE, message, place, starts=self.starts)


def _out_of_reach(at: _Configurations) -> Infeasible | None:
    if at.first(at.free, turned=False) is not None:
        return None
    near = at.nearest(at.free)
    return at.unreachable(
        f"the tool was brought no nearer than {near:.4g} m, the joints without limits; move the "
        f"{at.spot.name} nearer"
    )


def _out_of_bounds(at: _Configurations) -> Infeasible | None:
    if at.first(at.bounds, turned=False) is not None:
        return None
    what, outside = _least_outside(at, turned=False)
    return at.unreachable(
        f"the tool was brought no nearer than {at.nearest(at.bounds):.4g} m: {what} are in the "
        f"way, {outside.words}; change them or move the {at.spot.name}",
        at.problem.robot.joint_names[outside.joint],
    )


def _not_held(at: _Configurations) -> Infeasible | None:
    return _without(at, at.is_held, lambda q: require_held(at.problem, q), turned=False)


def _not_free(at: _Configurations) -> Infeasible | None:
    return _without(at, at.is_free, lambda q: _require_free(at, q), turned=False)


def _turned_away(at: _Configurations) -> Infeasible | None:
    if at.first(at.free, turned=True) is not None:
        return None
    solutions = list(at.solutions(at.free, turned=True))
    there = [one for one in solutions if at.is_there(one, turned=False)] or solutions
    outside = min(one.rotation_error for one in there)
    row = min(at.spot.rotation_rows, key=at.tightest)
    off = f"there the tool was brought no nearer to it than {outside:.3g} rad"
    return at.unreachable(explain_turn(at.problem, row, off))


def _turned_out_of_bounds(at: _Configurations) -> Infeasible | None:
    if at.first(at.bounds, turned=True) is not None:
        return None
    what, outside = _least_outside(at, turned=True)
    number = at.problem.tube.segment_number(at.spot.segments[0])
    return at.unreachable(
        f"{what} are in the way of the orientation asked, {outside.words}; change them, widen "
        f"tube.rotation_tolerance[{number}], change tube.orientations or move the {at.spot.name}",
        at.problem.robot.joint_names[outside.joint],
    )


def _turned_not_held(at: _Configurations) -> Infeasible | None:
    return _without(at, at.is_held, lambda q: require_held(at.problem, q), turned=True)


def _turned_not_free(at: _Configurations) -> Infeasible | None:
    return _without(at, at.is_free, lambda q: _require_free(at, q), turned=True)


_POSITION_CHECKS: tuple[_Check, ...] = (_out_of_reach, _out_of_bounds, _not_held)
_TURNED_CHECKS: tuple[_Check, ...] = (
    *(_turned_away, _turned_out_of_bounds),
    *(_turned_not_held, _turned_not_free),
)


def _without(
    at: _Configurations, accepts: _Accepts, require: Callable[[FloatArray], None], *, turned: bool
) -> Infeasible | None:
    """Return what a requirement says of the first configuration here, if none is accepted."""
    known = at.first(at.bounds, turned=turned)
    if known is None or at.first(at.bounds, accepts, turned=turned) is not None:
        return None
    try:
        require(known)
    except Infeasible as reason:
        spot = at.spot.place
        place = replace(reason.place, segment=spot.segment, point=spot.point)
        return reason.replaced(starts=at.starts, place=place)
    return None


def _require_free(at: _Configurations, q: FloatArray) -> None:
    name = at.spot.name if at.spot.is_goal else str(at.spot.place)
    require_free(at.problem, name, q, at.required(q))


def _least_outside(at: _Configurations, *, turned: bool) -> tuple[str, OutsideBounds]:
    """Return what bounds the joint that would leave its bounds the least, and that joint."""
    found = at.unbounded(turned=turned)
    outside = outside_bounds(at.problem.robot, found, *at.bounds)
    return bounded_by(at.problem, at.spot.segments, outside), outside


# ---- Why there is no trajectory: what really blocks, before what a branch ended at.

# A branch, or a certificate, that ends planning so may not have met what really blocks.
_SYMPTOMS = (PlanStatus.UNREACHABLE, PlanStatus.NO_TRAJECTORY, PlanStatus.CERTIFICATE_FAILED)


def right_reason(
    problem: PlanningProblem, branches: KnownBranches, result: PlanResult, clock: PlanningClock
) -> PlanResult:
    """Return a result without a trajectory, its reason replaced if another one comes first.

    A branch that keeps the rotation tolerance ends at it whatever else is in the way. So conditions
    are asked at places along the path, then whether a branch without that tolerance exists.
    """
    is_blocked = result.status is PlanStatus.TUBE_BLOCKED
    if result.stopped_by is not None or not (is_blocked or result.status in _SYMPTOMS):
        return result
    try:
        clock.enter("what is in the way")
        start = branches.require_ends()[0]
        reason = blocked_spot(problem, start, result.place, clock.check)
        if reason is None and not is_blocked and problem.rotation is not None:
            branches.position_only()
    except TimeLimitReached:
        return result
    except Infeasible as found:
        reason = found
    if reason is None:
        return result
    why = refused_result(reason, result.method)
    return replace(
        result,
        status=why.status,
        message=why.message,
        place=why.place,
        proved=why.proved,
        starts_tried=why.starts_tried,
        configuration=why.configuration,
    )
