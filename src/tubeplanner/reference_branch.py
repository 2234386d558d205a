"""The arm along the reference path: one continuous branch of the inverse kinematics.

The hand goes from where the start configuration has it, through the inner reference points, to
where the goal configuration has it; each leg is straight, so it stays in its capsule. The joint
ranges of each segment choose the branch. Spare joints go from start to goal in proportion to the
way.
"""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.inverse_kinematics import PositionSolution, solve_position
from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.problem import PlanningProblem, Seed

_LONGEST_STEP = 1 / 40  # of a segment
_SHORTEST_STEP = 1e-6  # of a segment
_LARGEST_JOINT_STEP = 0.1  # [rad or m] between neighbouring configurations
# Where the centre line cannot be reached, the hand may leave it by this share of the radius.
_ALLOWED_RADIUS_SHARE = 0.5
# How near the branch must come to a given goal configuration to be on its branch [rad or m].
_GOAL_TOLERANCE = 1e-3


@dataclass(frozen=True, eq=False)
class ReferenceBranch:
    """Configurations along the reference path.

    Attributes:
        segments: Per segment, configurations from its start to its end, shape (P_k, n), neighbours
            at most 0.1 rad apart; the last of one segment is the first of the next.
    """

    segments: tuple[FloatArray, ...]

    @property
    def start(self) -> FloatArray:
        """First configuration, shape (n,)."""
        return self.segments[0][0]

    @property
    def goal(self) -> FloatArray:
        """Last configuration, shape (n,)."""
        return self.segments[-1][-1]


def reference_branch(problem: PlanningProblem) -> ReferenceBranch:
    """Return the branch that the joint signs, the start and the goal ask for.

    Raises:
        Infeasible: Status unreachable: the message says where the branch ends and why.
    """
    start = _endpoint(problem, problem.start, 0)
    goal = None if problem.goal is None else _endpoint(problem, problem.goal, -1)
    route = _route(problem, start, goal)
    lengths = np.linalg.norm(np.diff(route, axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(lengths)]) / lengths.sum()
    q, segments = start, []
    for k in range(problem.tube.segment_count):
        walk = _SegmentWalk(problem, k, route[k : k + 2], q)
        if goal is not None:
            walk.blend_spare_joints(start, goal, way[k], way[k + 1])
        segments.append(walk.to_the_end())
        q = segments[-1][-1]
    if goal is not None:
        _require_goal(problem, q, goal)
        segments[-1][-1] = goal
    return ReferenceBranch(tuple(segments))


class _SegmentWalk:
    """Follows the branch through one segment, in steps that keep the joints close."""

    def __init__(
        self, problem: PlanningProblem, segment: int, ends: FloatArray, begin: FloatArray
    ) -> None:
        """Walk from the configuration `begin`, the hand going from ends[0] to ends[1]."""
        self._problem, self._segment = problem, segment
        self._ends, self._begin = ends, begin
        self._bounds = problem.joint_lower[segment], problem.joint_upper[segment]
        self._end_bounds = _bounds_at_end(problem, segment)
        self._wanted_ends: tuple[FloatArray, FloatArray] | None = None

    def blend_spare_joints(
        self, start: FloatArray, goal: FloatArray, way_begin: float, way_end: float
    ) -> None:
        """Pull spare joints from start to goal, in proportion to the way of the whole route."""
        self._wanted_ends = (
            (1 - way_begin) * start + way_begin * goal,
            (1 - way_end) * start + way_end * goal,
        )

    def to_the_end(self) -> FloatArray:
        """Return the configurations (P, n) from the segment's start to its end."""
        found, share, step = [self._begin], 0.0, _LONGEST_STEP
        while share < 1.0:
            following = min(1.0, share + step)
            solution = self._solve(following, found[-1])
            joint_step = float(abs(solution.q - found[-1]).max())
            if self._is_off(solution, following) or joint_step > _LARGEST_JOINT_STEP:
                step /= 2
                if step < _SHORTEST_STEP:
                    self._give_up(following, found[-1], solution)
                continue
            found.append(solution.q)
            share = following
            if joint_step < _LARGEST_JOINT_STEP / 3:
                step = min(2 * step, _LONGEST_STEP)
        return np.array(found)

    def _solve(self, share: float, seed: FloatArray) -> PositionSolution:
        """Solve at a share of the segment; at its end the next segment's bounds hold as well."""
        lower, upper = self._end_bounds if share == 1.0 else self._bounds
        preferred = self._preferred(share, seed)
        return solve_position(
            self._problem.robot, self._point(share), seed, lower, upper, preferred
        )

    def _point(self, share: float) -> FloatArray:
        return (1 - share) * self._ends[0] + share * self._ends[1]

    def _preferred(self, share: float, seed: FloatArray) -> FloatArray:
        """Return where spare joints go: towards the goal, or nowhere; in time for the hand-over.

        What the hand-over asks of a joint narrows in on it linearly, so that it need not jump.
        """
        wanted = seed
        if self._wanted_ends is not None:
            wanted = (1 - share) * self._wanted_ends[0] + share * self._wanted_ends[1]
        lower, upper = self._end_bounds
        below = np.maximum(lower - self._begin, 0.0)
        above = np.maximum(self._begin - upper, 0.0)
        return np.clip(wanted, lower - (1 - share) * below, upper + (1 - share) * above)

    def _is_off(self, solution: PositionSolution, share: float) -> bool:
        radius = self._problem.tube.effective_radius
        last = share == 1.0 and self._segment + 1 < len(radius)
        allowed = radius[self._segment : self._segment + 1 + last].min()
        return solution.error > _ALLOWED_RADIUS_SHARE * allowed

    def _give_up(self, share: float, q: FloatArray, solution: PositionSolution) -> None:
        point = self._point(share)
        place = Place(segment=self._segment, position=_as_position(point))
        where = f"{100 * share:.1f} % along {place}"
        if self._is_off(solution, share):
            reason = _explain(self._problem, point, q, self._segment, solution)
            raise Infeasible(PlanStatus.UNREACHABLE, f"{where}: {reason}", place)
        joint = self._problem.robot.joint_names[int(np.argmax(abs(solution.q - q)))]
        raise Infeasible(
            PlanStatus.UNREACHABLE,
            f"{where}: no continuous branch: '{joint}' would have to jump by "
            f"{abs(solution.q - q).max():.3f} rad; move the reference points or free the signs",
            place,
        )


def _bounds_at_end(problem: PlanningProblem, segment: int) -> tuple[FloatArray, FloatArray]:
    """Return the joint bounds where a segment ends: its own, cut with the next one's."""
    following = min(segment + 1, problem.tube.segment_count - 1)
    lower = np.maximum(problem.joint_lower[segment], problem.joint_lower[following])
    upper = np.minimum(problem.joint_upper[segment], problem.joint_upper[following])
    return lower, upper


def _endpoint(problem: PlanningProblem, given: FloatArray | Seed, point: int) -> FloatArray:
    """Return the start (point 0) or goal (point -1): as given, or solved from its seed."""
    if not isinstance(given, Seed):
        return given
    segment = 0 if point == 0 else problem.tube.segment_count - 1
    lower, upper = problem.joint_lower[segment], problem.joint_upper[segment]
    target = problem.tube.points[point]
    solution = solve_position(problem.robot, target, given.joints, lower, upper)
    if solution.error > 1e-6:
        place = Place(segment=segment, position=_as_position(target))
        reason = _explain(problem, target, given.joints, segment, solution)
        end = "start" if point == 0 else "goal"
        raise Infeasible(PlanStatus.UNREACHABLE, f"{end} from its seed: {reason}", place)
    return solution.q


def _route(problem: PlanningProblem, start: FloatArray, goal: FloatArray | None) -> FloatArray:
    """Return where the hand goes: the reference points, its ends where start and goal have it."""
    route = problem.tube.points.copy()
    route[0] = problem.robot.tool_position(start[None])[0]
    if goal is not None:
        route[-1] = problem.robot.tool_position(goal[None])[0]
    return route


def _require_goal(problem: PlanningProblem, q: FloatArray, goal: FloatArray) -> None:
    difference = goal - q
    worst = int(np.argmax(abs(difference)))
    if abs(difference[worst]) <= _GOAL_TOLERANCE:
        return
    segment = problem.tube.segment_count - 1
    joint = problem.robot.joint_names[worst]
    raise Infeasible(
        PlanStatus.UNREACHABLE,
        f"the branch that continues the start configuration ends with '{joint}' at {q[worst]:.4f} "
        f"rad, the goal has it at {goal[worst]:.4f} rad: the goal lies on another branch; leave "
        "the goal out, or change the start or the joint signs",
        Place(joint=joint, segment=segment),
    )


def _explain(
    problem: PlanningProblem,
    point: FloatArray,
    seed: FloatArray,
    segment: int,
    solution: PositionSolution,
) -> str:
    """Say which condition keeps the hand from a point, by dropping one after the other."""
    robot, limits = problem.robot, problem.robot.limits
    short = f"the hand gets no nearer than {solution.error:.4f} m"
    free = np.full(robot.joint_count, np.inf)
    without_signs = solve_position(robot, point, seed, limits.lower_position, limits.upper_position)
    without_limits = solve_position(robot, point, seed, -free, free)
    if without_limits.error > 1e-6:
        return f"{short}: out of the arm's reach ({without_limits.error:.4f} m short)"
    lower, upper = problem.joint_lower[segment], problem.joint_upper[segment]
    at_bound = (solution.q <= lower) | (solution.q >= upper)
    names = [name for name, held in zip(robot.joint_names, at_bound, strict=True) if held]
    held = ", ".join(names) or "no joint"
    if without_signs.error > 1e-6:
        return f"{short}: position limits are in the way (at their bounds: {held})"
    return f"{short} with the joint signs of segment {segment} (at their bounds: {held})"


def _as_position(point: FloatArray) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in point)
    return x, y, z
