"""The first place on the reference path at which the arm has no configuration, and why.

Conditions are asked in the order in which they matter: no motor, obstacle or orientation is in the
way where the tool cannot be at all. Each is asked at all places before the next one.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.branches.inverse_kinematics import PositionSolution, solve_position
from tubeplanner.branches.joint_middle import middle_of
from tubeplanner.branches.outside_bounds import OutsideBounds, bounded_by, outside_bounds
from tubeplanner.branches.pose_configurations import spread_seeds
from tubeplanner.branches.pose_within_tolerance import solve_within_tolerance
from tubeplanner.branches.segment_walk import explain_turn
from tubeplanner.constraints.held_configuration import require_held
from tubeplanner.outcome import MARGIN_TOLERANCE, Infeasible, Place, PlanStatus
from tubeplanner.planning.path_spots import Spot, path_spots
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.problem.required_distances import RequiredDistances
from tubeplanner.verification.refusal import clear_by, require_free

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
