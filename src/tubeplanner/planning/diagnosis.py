"""Refusals: necessary conditions before planning, the first blocked sample of the path after it."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
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
    is_held,
    middle_of,
    outside_bounds,
    spread_seeds,
)
from tubeplanner.first_guess.segment_walk import explain_rotation
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.limits.joint_efforts import require_held
from tubeplanner.limits.rates import require_approachable
from tubeplanner.outcome import (
    MARGIN_TOLERANCE,
    Infeasible,
    Location,
    PlanningClock,
    PlanStatus,
    TimeLimitReached,
)
from tubeplanner.planning.result import PlanResult, refused_result
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.required_distances import RequiredDistances

# ---- Necessary conditions before planning: reach, ends that motors hold, free ends.


@dataclass(frozen=True, eq=False)
class ReachBound:
    """A ball that the tool cannot leave, wherever joints are within their limits."""

    center: FloatArray  # the first joint's origin, shape (3,), base frame [m]
    radius: float  # [m]; infinite where a sliding joint has no limits

    def beyond(self, points: FloatArray) -> FloatArray:
        """Return the distances of points (N, 3) outside the ball, negative inside, (N,) [m]."""
        return np.asarray(np.linalg.norm(points - self.center, axis=1) - self.radius)


def reach_bound(robot: RobotModel) -> ReachBound:
    """Return a bound on the tool centre point: the sum of the lengths between joints.

    The distance between the origins of successive joints does not depend on turning joints; with a
    sliding joint, which may follow a turning one, it is largest at an end of the range, as
    distances are convex along a line.
    """
    limits = robot.limits
    tolerance = [[-MARGIN_TOLERANCE], [MARGIN_TOLERANCE]]
    ends = np.stack([limits.lower_position, limits.upper_position]) + tolerance
    tool = robot.link_body[robot.tool_frame]
    chain = [body for body in range(1, robot.body_count) if robot.carries[tool, body - 1]]
    sliding = robot.body_joints[chain][~robot.body_is_revolute[chain]]  # or what these follow
    if not chain or not np.isfinite(ends[:, sliding]).all():
        return ReachBound(np.zeros(3), np.inf)
    ends = np.where(np.isfinite(ends), ends, 0.0)
    origins = robot.body_poses(ends)[1][:, chain]
    points = np.concatenate([origins, robot.tool_position(ends)[:, None]], axis=1)
    lengths = np.linalg.norm(np.diff(points, axis=1), axis=2).max(axis=0)
    center = origins[:, 0].mean(axis=0)
    travel = np.linalg.norm(origins[:, 0] - center, axis=1).max()
    return ReachBound(center, float(lengths.sum() + travel))


# Ends and margins are exact to this [m].
_ROUNDING = 2 * MARGIN_TOLERANCE
_MANY_REACHES = 20  # a point so many reaches too far is rather in another unit


def require_within_bound(problem: PlanningProblem, *, start_is_known: bool = True) -> None:
    """Raise Infeasible, proved, if a point is beyond the bound of the arm's reach.

    The first point counts if the start is known.
    """
    points, allowed = required_points(problem)
    allowed[0] = allowed[0] if start_is_known else np.inf
    bound = reach_bound(problem.robot)
    missing = bound.beyond(points) - allowed
    k = int(missing.argmax())
    if missing[k] <= _ROUNDING:
        return
    location = _point_location(problem.tube, k, points[k])
    x, y, z = (f"{value:.3f}" for value in bound.center)
    tolerance = f" and {allowed[k]:.4g} m of tolerance" if allowed[k] else ""
    unit = " (millimetres?)" if missing[k] > _MANY_REACHES * bound.radius else ""
    raise Infeasible(
        PlanStatus.UNREACHABLE,
        f"{location}: out of reach: the arm reaches {bound.radius:.4g} m from "
        f"[{x}, {y}, {z}] m, the sum of its links{tolerance}; the {_point_name(k, len(points))} is "
        f"{missing[k]:.3g} m too far{unit}: move it nearer",
        location,
        proved=True,
    )


def required_points(problem: PlanningProblem) -> tuple[FloatArray, FloatArray]:
    """Return points (m+1, 3) to pass, and the tool's allowed distances (m+1,) [m].

    The distance is infinite for an end with a given configuration, whose tool is near enough
    already.
    """
    tube = problem.tube
    points, allowed = tube.points.copy(), np.append(0.0, largest_distances(tube))
    if tube.visit != "ordered":  # only the goal must be visited
        allowed[1:-1] = np.inf
    for row, end in zip((0, -1), problem.endpoints, strict=True):
        if end.kind in ("seed", "open"):
            allowed[row] = problem.end_radii[row]
        elif end.position is not None:
            points[row] = end.position
            allowed[row] = 0.0 if end.region is None else end.region.tolerance
        elif end.joints is not None:
            allowed[row] = np.inf
    return points, allowed


def _point_location(tube: Tube, k: int, point: FloatArray) -> Location:
    """Return the location of reference point k, or of a point (3,) [m] in its stead."""
    number = tube.segment_number(max(k - 1, 0), point)
    return Location(segment=number, point=int(tube.numbers[k])).at(point)


def _point_name(k: int, count: int) -> str:
    return "goal" if k == count - 1 else "start" if k == 0 else "reference point"


def largest_distances(tube: Tube) -> FloatArray:
    """Return the tool's largest distances when it passes points, without the first, (m,) [m].

    The tool passes from segment to segment where their regions overlap. Within r of two lines at
    an angle phi, it is at most r / sin(phi / 2) from their corner. At the goal the distance is 0.
    """
    radius = np.where(tube.is_box, np.sqrt(3), 1.0) * tube.reach  # the corners of a box are farther
    axis = np.diff(tube.points, axis=0)
    along = axis / np.linalg.norm(axis, axis=1)[:, None]
    cosine = -np.einsum("mi,mi->m", along[:-1], along[1:])
    sine = np.sqrt(np.clip((1 - cosine) / 2, 0, None))
    with np.errstate(divide="ignore"):
        corner: FloatArray = np.maximum(radius[:-1], radius[1:]) / sine
    return np.append(corner, 0.0)


# A point counts as out of reach if the tool's distance exceeds the allowed one by more [m].
_MAX_SEARCH_ERROR = 1e-4
_OTHER_SEEDS = 4  # of inverse kinematics, besides the start
_SEED_RANGE = np.pi  # [rad or m]


def require_possible(problem: PlanningProblem, branches: KnownBranches) -> None:
    """Raise Infeasible if a necessary condition of every trajectory is broken.

    Start and a given goal must be free, the motors must hold them, the joints may move to that
    goal, and the arm must reach the farthest point at which the tool passes from segment to segment
    or ends.
    """
    ends = branches.require_ends()
    are_given = [end.joints is not None for end in problem.endpoints]
    differ = all(are_given) and bool(abs(ends[1] - ends[0]).max() > _ROUNDING)
    for q, is_given in zip(ends, are_given, strict=False):
        require_held(problem, q, is_given=is_given, must_leave=differ)
    if len(ends) > 1:
        require_approachable(problem, *ends)
    # The farthest point, the joints without limits.
    robot, (points, allowed) = problem.robot, required_points(problem)
    base = robot.body_poses(ends[0][None])[1][0, 1]
    k = 1 + int((np.linalg.norm(points[1:] - base, axis=1) - allowed[1:]).argmax())
    if np.isinf(allowed[k]):
        return
    point, free = points[k], np.full(robot.joint_count, np.inf)
    draw = np.random.default_rng(0).uniform
    seeds = [ends[0], *draw(-_SEED_RANGE, _SEED_RANGE, (_OTHER_SEEDS, robot.joint_count))]
    nearest = np.inf
    for seed in seeds:
        nearest = min(nearest, solve_position(robot, point, seed, -free, free).error)
        if nearest <= allowed[k] + _MAX_SEARCH_ERROR:
            return
    location = _point_location(problem.tube, k, point)
    may = f" ({allowed[k]:.4g} m is allowed)" if allowed[k] else ""
    name = _point_name(k, len(points))
    message = (
        f"{location}: the tool stops {nearest:.4g} m short even without joint limits{may}; move "
        f"the {name} at least {nearest - allowed[k]:.3g} m nearer"
    )
    goal = problem.open_goal
    if name == "goal" and goal is not None and nearest < problem.tube.effective_radius[-1]:
        message += f", or give goal: {{position: {point.tolist()}, tolerance: {1.1 * nearest:.2g}}}"
    raise Infeasible(PlanStatus.UNREACHABLE, message, location, starts=len(seeds))


# ---- Samples of the reference path at which the arm must have a configuration.

_MAX_SEGMENTS = 8
# The tool may miss a sample by this fraction of the radius, as a branch may.
_RADIUS_FRACTION = 0.5


@dataclass(frozen=True, eq=False)
class BlockingSample:
    """A sample of the tool's path, in one or two segments of the tube, or the open goal."""

    name: str  # in messages
    segments: tuple[int, ...]
    tool: FloatArray  # position of the tool, shape (3,) [m]
    allowed: float  # largest distance of the tool from that position [m]
    location: Location  # for messages
    rotation_rows: tuple[int, ...]  # the rows of the rotation tolerance that hold here
    is_goal: bool = False  # True for the open goal


def path_samples(
    problem: PlanningProblem, end: Location, is_wide: bool = False
) -> list[BlockingSample]:
    """Return the samples at which the arm must have a configuration.

    Inner reference points, the goal if it is open, then samples between; of a long path only
    samples near the end of a branch, if known, and in the last segment. `is_wide`: the tool may
    pass a sample anywhere in the tube, not only near it.
    """
    tube = problem.tube
    last = tube.segment_count - 1
    # The segments nearest to the end of the branch, and the last one.
    around = next((k for k in range(last + 1) if tube.segment_number(k) == end.segment), 0)
    nearest = sorted(range(last + 1), key=lambda k: abs(k - around))[: _MAX_SEGMENTS - 1]
    segments = sorted({*nearest, last})
    samples = []
    for k in segments:
        if k < last:
            tool, number, both = tube.points[k + 1], int(tube.numbers[k + 1]), (k, k + 1)
            allowed = _RADIUS_FRACTION * float(tube.effective_radius[list(both)].min())
            location = Location(segment=tube.segment_number(k, tool), point=number).at(tool)
            samples.append(
                BlockingSample(f"reference point {number}", both, tool, allowed, location, both)
            )
    goal = problem.open_goal
    if goal is not None:
        number = tube.segment_number(last, goal.position)
        location = Location(segment=number, point=int(tube.numbers[-1])).at(goal.position)
        rows = (last, tube.segment_count) if goal.bounds_rotation else (last,)
        sample = BlockingSample(
            "goal", (last,), goal.position, goal.tolerance, location, rows, is_goal=True
        )
        samples.append(sample)
    # The middle of each segment, and a branch's end inside a segment.
    for k in segments:
        begin = tube.points[k]
        tools = [(begin + tube.points[k + 1]) / 2]
        if end.position is not None and end.segment == tube.segment_number(k):
            tools.append(np.array(end.position))
        allowed = _RADIUS_FRACTION * float(tube.effective_radius[k])
        for tool in sorted(tools, key=lambda tool: float(np.linalg.norm(tool - begin))):
            location = Location(segment=tube.segment_number(k, tool)).at(tool)
            samples.append(BlockingSample("reference points", (k,), tool, allowed, location, (k,)))
    if not is_wide:
        return samples
    corners = largest_distances(tube)
    for i, sample in enumerate(samples):
        if not sample.is_goal:
            widest = corners if len(sample.segments) > 1 else tube.effective_radius
            samples[i] = replace(sample, allowed=float(widest[sample.segments[0]]))
    return samples


# ---- The first sample of the reference path at which the arm has no configuration, and the reason.
#
# Conditions are checked in the order in which they matter: no motor, obstacle or orientation is in
# the way where the tool cannot be at all. Each is checked at all samples before the next one.

_REACHED = 1e-6  # [m]
_MAX_SEEDS = 20
_Bounds: TypeAlias = tuple[FloatArray, FloatArray]
_Accepts: TypeAlias = Callable[[FloatArray], bool]
_Check: TypeAlias = Callable[["_Configurations"], Infeasible | None]


def blocking_sample(
    problem: PlanningProblem,
    start: FloatArray,
    end: Location,
    checkpoint: Callable[[], None] = lambda: None,
    *,
    is_certain: bool = False,
) -> Infeasible | None:
    """Return the reason why the arm cannot follow the reference path, or None.

    At each sample inverse kinematics begins with the start and with many more configurations: a
    condition that no solution satisfies counts as impossible. The tool may miss a sample by half of
    the radius, or by the open goal's tolerance. One of the samples is the end of a branch.
    `is_certain`: for any orientation and anywhere in the tube, quicker and less doubtful. The
    checkpoint is called before every sample.
    """
    checks = _POSITION_CHECKS
    if problem.rotation is not None and not is_certain:
        checks += _ROTATION_CHECKS
    samples = path_samples(problem, end, is_certain)
    configurations = [_Configurations(problem, sample, start) for sample in samples]
    for check in checks:
        for at in configurations:
            checkpoint()
            reason = check(at)
            if reason is not None:
                return reason
    return None


@dataclass(frozen=True, eq=False)
class _Configurations:
    """The arm's configurations at a sample; `start` (n,) is the start configuration."""

    problem: PlanningProblem
    sample: BlockingSample
    start: FloatArray

    @property
    def starts(self) -> int:  # of the search within bounds
        return 2 * len(self._seeds())

    @property
    def free(self) -> _Bounds:
        infinite = np.full(self.problem.robot.joint_count, np.inf)
        return -infinite, infinite

    @property
    def bounds(self) -> _Bounds:
        segments = list(self.sample.segments)
        lower, upper = self.problem.joint_lower[segments], self.problem.joint_upper[segments]
        return lower.max(axis=0), upper.min(axis=0)

    def first(
        self, bounds: _Bounds, accepts: _Accepts = lambda q: True, *, oriented: bool
    ) -> FloatArray | None:
        solutions = self.solutions(bounds, oriented=oriented)
        there = (each.q for each in solutions if self.is_there(each, oriented=oriented))
        return next(filter(accepts, there), None)

    def solutions(self, bounds: _Bounds, *, oriented: bool) -> Iterator[PositionSolution]:
        """Yield the nearest solutions within bounds from all seeds, here or not.

        Then those from the seeds' solutions without bounds: joints that a bound stops on the way
        may end far from there.
        """
        seeds = self._seeds()
        for seed in seeds:
            yield self._solved(seed, bounds, oriented)
        if np.isinf(bounds).all():
            return
        for seed in seeds:
            other = self._solved(seed, self.free, oriented)
            yield self._solved(self._unwound(other.q), bounds, oriented)

    def _seeds(self) -> list[FloatArray]:
        return [self.start, *spread_seeds(*self.bounds)[:_MAX_SEEDS]]

    def _solved(self, seed: FloatArray, bounds: _Bounds, oriented: bool) -> PositionSolution:
        robot, sample, tube = self.problem.robot, self.sample, self.problem.rotation
        if tube is None or not oriented:
            return solve_position(robot, sample.tool, seed, *bounds)
        rows = sample.rotation_rows
        return solve_within_tolerance(robot, sample.tool, tube, rows, seed, *bounds)

    def unbounded(self, *, oriented: bool) -> FloatArray:
        """Return configurations (c, n) with the tool here, joints without bounds."""
        solutions = self.solutions(self.free, oriented=oriented)
        q = [self._unwound(each.q) for each in solutions if self.is_there(each, oriented=oriented)]
        return np.array(q).reshape(-1, self.problem.robot.joint_count)

    def nearest(self, bounds: _Bounds) -> float:
        return min(each.error for each in self.solutions(bounds, oriented=False))

    def is_there(self, solution: PositionSolution, *, oriented: bool) -> bool:
        if solution.error > self.sample.allowed + _REACHED:
            return False
        return not oriented or solution.rotation_error <= MARGIN_TOLERANCE

    def _unwound(self, q: FloatArray) -> FloatArray:
        """Return a configuration (n,) moved by whole turns nearest to the middle of bounds."""
        turns = np.round((q - middle_of(*self.bounds)) / (2 * np.pi))
        return np.asarray(q - 2 * np.pi * np.where(self.problem.robot.revolute, turns, 0.0))

    def is_free(self, q: FloatArray) -> bool:
        """Return True if a configuration (n,) is free, or nearly so by the tool's allowance."""
        depth = -clear_by(self.problem, q, self.required(q)).min(initial=np.inf)
        return bool(depth <= self.sample.allowed + MARGIN_TOLERANCE)

    def required(self, q: FloatArray) -> FloatArray:
        """Return the required distances of all pairs in a configuration (n,), shape (P,) [m]."""
        required = RequiredDistances(self.problem, self.start, q if self.sample.is_goal else None)
        tool = self.problem.robot.tool_position(q[None])
        rows = [required.at(np.array([segment]), tool)[0] for segment in self.sample.segments]
        return np.asarray(np.min(rows, axis=0))

    def unreachable(self, reason: str, joint: str | None = None) -> Infeasible:
        message = f"{self.sample.location}: {reason}"
        location = replace(self.sample.location, joint=joint)
        return Infeasible(PlanStatus.UNREACHABLE, message, location, starts=self.starts)


def _out_of_reach(at: _Configurations) -> Infeasible | None:
    if at.first(at.free, oriented=False) is not None:
        return None
    near = at.nearest(at.free)
    return at.unreachable(
        f"the tool stops {near:.4g} m short even without joint limits; move the {at.sample.name} "
        f"at least {near - at.sample.allowed:.3g} m nearer"
    )


def _out_of_bounds(at: _Configurations) -> Infeasible | None:
    if at.first(at.bounds, oriented=False) is not None:
        return None
    what, outside = _least_outside(at, oriented=False)
    return at.unreachable(
        f"the tool stops {at.nearest(at.bounds):.4g} m short: {what} are in the way, "
        f"{outside.words}; change them or move the {at.sample.name}",
        at.problem.robot.joint_names[outside.joint],
    )


def _not_held(at: _Configurations, *, oriented: bool = False) -> Infeasible | None:
    holds, require = partial(is_held, at.problem), partial(require_held, at.problem)
    return _without(at, holds, require, oriented=oriented)


def _not_free(at: _Configurations, *, oriented: bool = False) -> Infeasible | None:
    name = at.sample.name if at.sample.is_goal else str(at.sample.location)

    def require(q: FloatArray) -> None:
        require_free(at.problem, name, q, at.required(q))

    return _without(at, at.is_free, require, oriented=oriented)


def _rotated_away(at: _Configurations) -> Infeasible | None:
    if at.first(at.free, oriented=True) is not None:
        return None
    solutions = list(at.solutions(at.free, oriented=True))
    near = [each for each in solutions if at.is_there(each, oriented=False)] or solutions
    outside = min(each.rotation_error for each in near)
    tube = at.problem.rotation
    assert tube is not None
    row = min(at.sample.rotation_rows, key=lambda row: float(tube.bounds[row].min()))
    off = f"there the tool is turned {outside:.3g} rad too far"
    return at.unreachable(explain_rotation(at.problem, row, off))


def _rotated_out_of_bounds(at: _Configurations) -> Infeasible | None:
    if at.first(at.bounds, oriented=True) is not None:
        return None
    what, outside = _least_outside(at, oriented=True)
    number = at.problem.tube.segment_number(at.sample.segments[0])
    return at.unreachable(
        f"{what} are in the way of the orientation asked, {outside.words}; change them, widen "
        f"tube.rotation_tolerance[{number}], change tube.orientations or move the {at.sample.name}",
        at.problem.robot.joint_names[outside.joint],
    )


_POSITION_CHECKS: tuple[_Check, ...] = (_out_of_reach, _out_of_bounds, _not_held, _not_free)
_ROTATION_CHECKS: tuple[_Check, ...] = (
    *(_rotated_away, _rotated_out_of_bounds),
    *(partial(_not_held, oriented=True), partial(_not_free, oriented=True)),
)


def _without(
    at: _Configurations, accepts: _Accepts, require: Callable[[FloatArray], None], *, oriented: bool
) -> Infeasible | None:
    """Return the refusal of the first configuration here, or None if another is accepted."""
    first = at.first(at.bounds, oriented=oriented)
    if first is None or at.first(at.bounds, accepts, oriented=oriented) is not None:
        return None
    try:
        require(first)
    except Infeasible as reason:
        sample = at.sample.location
        location = replace(reason.location, segment=sample.segment, point=sample.point)
        return reason.replaced(starts=at.starts, location=location)
    return None


def _least_outside(at: _Configurations, *, oriented: bool) -> tuple[str, OutsideBounds]:
    """Return the joint outside its bounds by the least, after the name of the bounds."""
    outside = outside_bounds(at.problem.robot, at.unbounded(oriented=oriented), *at.bounds)
    return bounded_by(at.problem, at.sample.segments, outside), outside


# Of a branch or certificate with these, the end may not be the obstruction itself.
_SYMPTOMS = (PlanStatus.UNREACHABLE, PlanStatus.NO_TRAJECTORY, PlanStatus.CERTIFICATE_FAILED)


def refined_diagnosis(
    problem: PlanningProblem, branches: KnownBranches, result: PlanResult, clock: PlanningClock
) -> PlanResult:
    """Return a result without a trajectory, with the reason that comes first.

    A branch that keeps the rotation tolerance ends at it whatever else is in the way. So conditions
    are checked at samples of the path, then the existence of a branch without that tolerance.
    """
    is_blocked = result.status is PlanStatus.TUBE_BLOCKED
    if result.stopped_by is not None or not (is_blocked or result.status in _SYMPTOMS):
        return result
    try:
        clock.enter("what is in the way")
        start = branches.require_ends()[0]
        reason = blocking_sample(problem, start, result.location, clock.check)
        if reason is None and not is_blocked and problem.rotation is not None:
            branches.position_only()
    except TimeLimitReached:
        return result
    except Infeasible as refusal:
        reason = refusal
    if reason is None:
        return result
    why = refused_result(reason, result.method)
    return replace(
        result,
        status=why.status,
        message=why.message,
        location=why.location,
        proved=why.proved,
        starts_tried=why.starts_tried,
        configuration=why.configuration,
    )
