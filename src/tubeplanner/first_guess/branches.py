"""Branches of the arm along the reference path, joint lines, configurations of start and goal.

The tool goes from its position in the start configuration through the inner reference points to its
position in the goal configuration; each leg is straight, so it stays in its capsule. Where its
rotation is bounded, it follows the reference orientation as far as the arm can. The joint ranges of
each segment select the branch, and a rule moves redundant joints.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.certificate.refusal import require_free
from tubeplanner.first_guess.inverse_kinematics import (
    PositionSolution,
    solve_position,
    solve_positions,
)
from tubeplanner.first_guess.pose_configurations import (
    bounded_by,
    is_free,
    outside_bounds,
    pose_configurations,
    reaching,
    spread_seeds,
)
from tubeplanner.first_guess.segment_walk import (
    SegmentWalk,
    explain_error,
    explain_rotation,
    rotation_text,
    wanted_at,
)
from tubeplanner.first_guess.upright import holds, kept_upright
from tubeplanner.geometry.tube.points import arc_lengths
from tubeplanner.outcome import MARGIN_TOLERANCE, Infeasible, Location, PlanningClock, PlanStatus
from tubeplanner.task.endpoints import Endpoint, GoalRegion, ToolPose
from tubeplanner.task.problem import PlanningProblem

# ---- The arm along the reference path: one continuous branch of the inverse kinematics.

_SEED_TOLERANCE = 1e-6  # [m] between the tool and the reference point of a seed
# How near the branch must come to a given goal configuration to be on its branch [rad or m].
_GOAL_TOLERANCE = 1e-6
_SAME = 1e-6  # [rad or m]
_STILL = 1e-9  # [rad or m]: joints that move less stand still


@dataclass(frozen=True, eq=False)
class ReferenceBranch:
    """Configurations along the reference path."""

    # per segment, configurations from its start to its end, shape (P_k, n), neighbours at most 0.1
    # rad apart; the last of one segment is the first of the next
    segments: tuple[FloatArray, ...]

    @property
    def start(self) -> FloatArray:
        """First configuration, shape (n,)."""
        return self.segments[0][0]

    @property
    def moving_segments(self) -> list[int]:
        """Indices of the segments in which the arm moves."""
        return [k for k, q in enumerate(self.segments) if np.ptp(q, axis=0).max() > _STILL]

    @property
    def goal(self) -> FloatArray:
        """Last configuration, shape (n,)."""
        return self.segments[-1][-1]

    @property
    def length(self) -> float:
        """Sum over the steps of the farthest joint's travel [rad or m]."""
        return sum(float(abs(np.diff(q, axis=0)).max(axis=1).sum()) for q in self.segments)

    def is_as(self, other: "ReferenceBranch") -> bool:
        """Return True if another branch has the same configurations, to 1e-6 rad or m."""
        return all(
            a.shape == b.shape and abs(a - b).max() < _SAME
            for a, b in zip(self.segments, other.segments, strict=True)
        )


class RedundancyRule(StrEnum):
    """How redundant joints move."""

    AS_NEEDED = "they move as little as possible, and to the goal at the end"
    PROPORTIONAL = "they go from start to goal in proportion to the arc length"
    HELD = "they are held near the start, and go to the goal at the end"
    CENTRED = "they go to the middle of their ranges, and to the goal at the end"


def redundancy_rules(problem: PlanningProblem) -> tuple[RedundancyRule, ...]:
    """Return the rules to try for a problem, the most natural first."""
    if problem.endpoints[1].is_open:
        return RedundancyRule.AS_NEEDED, RedundancyRule.HELD, RedundancyRule.CENTRED
    return (
        RedundancyRule.PROPORTIONAL,
        RedundancyRule.AS_NEEDED,
        RedundancyRule.HELD,
        RedundancyRule.CENTRED,
    )


def reference_branch(
    problem: PlanningProblem,
    rule: RedundancyRule,
    checkpoint: Callable[[], None] = lambda: None,
    *,
    with_rotation: bool = True,
) -> ReferenceBranch:
    """Return the branch selected by joint signs, start and goal.

    The checkpoint is called before every segment. `with_rotation`: whether the branch keeps the
    rotation tolerance, if there is one.

    Raises:
        Infeasible: Status unreachable: the message says where the branch ends and why.
    """
    start, goal = end_configurations(problem)
    route = problem.tube.points.copy()  # the tool's, with the ends of start and goal
    route[0] = problem.robot.tool_position(start[None])[0]
    if goal is not None:
        route[-1] = problem.robot.tool_position(goal[None])[0]
    elif problem.open_goal is not None:
        route[-1] = problem.open_goal.position
    # Configurations (m+1, n) that pull redundant joints at the points, or None.
    pulls: FloatArray | None = None
    if rule is RedundancyRule.HELD:
        pulls = np.tile(start, (len(route), 1))
    elif rule is RedundancyRule.CENTRED:
        with np.errstate(invalid="ignore"):
            middle = (problem.joint_lower + problem.joint_upper) / 2
        pulls = np.vstack([start, np.where(np.isfinite(middle), middle, start)])
    elif rule is not RedundancyRule.AS_NEEDED and goal is not None:
        before = arc_lengths(route)
        fraction = before / before[-1] if before[-1] > 0 else np.linspace(0, 1, len(route))
        pulls = (1 - fraction[:, None]) * start + fraction[:, None] * goal
    q, segments = start, []
    for k in range(problem.tube.segment_count):
        checkpoint()
        pull = None if pulls is None else pulls[k : k + 2]
        end = goal if k + 1 == problem.tube.segment_count else None
        walk = SegmentWalk(problem, k, route[k : k + 2], q, pull, end, with_rotation=with_rotation)
        segments.append(walk.to_the_end())
        q = segments[-1][-1]
    if goal is not None:
        difference = goal - q
        worst = int(np.argmax(abs(difference)))
        if not abs(difference[worst]) <= _GOAL_TOLERANCE:
            segment = problem.tube.segment_count - 1
            joint = problem.robot.joint_names[worst]
            raise Infeasible(
                PlanStatus.UNREACHABLE,
                f"the branch that continues the start configuration ends with '{joint}' at "
                f"{q[worst]:.4f} rad, the goal has it at {goal[worst]:.4f} rad: the goal lies on "
                "another branch; leave the goal out, or change the start or the joint signs",
                Location(
                    joint=joint,
                    segment=problem.tube.segment_number(segment, problem.tube.points[-1]),
                ),
                configuration=q,
            )
        segments[-1][-1] = goal
    return ReferenceBranch(tuple(segments))


def end_configurations(problem: PlanningProblem) -> tuple[FloatArray, FloatArray | None]:
    """Return the configurations (n,) of start and goal; None for an open goal."""
    start, goal = problem.endpoints
    first = end_configuration(problem, start, 0)
    return first, None if goal.is_open else end_configuration(problem, goal, -1)


def end_configuration(problem: PlanningProblem, end: Endpoint, point: int) -> FloatArray:
    """Return the configuration (n,) of the start (point 0) or goal (point -1).

    Raises:
        Infeasible: Status unreachable: a seed does not lead to its point, or a pose is not reached.
    """
    if end.pose is not None:
        first: FloatArray = pose_configurations(problem, end.pose, point)[0]
        return first
    if end.joints is not None:
        return end.joints
    assert end.seed is not None  # open ends have no configuration
    segment = 0 if point == 0 else problem.tube.segment_count - 1
    lower, upper = problem.joint_lower[segment], problem.joint_upper[segment]
    target, seed = problem.tube.points[point], end.seed
    rotation_target = wanted_at(problem, target, segment)
    solution = solve_position(problem.robot, target, seed, lower, upper, rotation=rotation_target)
    reason = None
    if solution.error > max(_SEED_TOLERANCE, problem.end_radii[point]):
        reason = explain_error(problem, target, seed, segment, solution)
    elif problem.tube.rotation is not None:
        rotation, tool = problem.robot.tool_pose(solution.q[None])
        if problem.tube.rotation.margin(rotation, tool, segment)[0] < 0:
            reason = _explain_rotated_end(problem, target, seed, segment, solution)
    if reason is not None:
        location = Location(segment=problem.tube.segment_number(segment, target)).at(target)
        name = "start" if point == 0 else "goal"
        message = f"{name} from its seed: {reason}"
        if solution.error < problem.tube.effective_radius[segment]:  # in the tube's end
            joints = ", ".join(f"{value:.6g}" for value in solution.q)
            message += f", or give {name}: {{joints: [{joints}]}}"
        raise Infeasible(
            PlanStatus.UNREACHABLE, message, location, starts=1, configuration=solution.q
        )
    return solution.q


def _explain_rotated_end(
    problem: PlanningProblem,
    target: FloatArray,
    seed: FloatArray,
    segment: int,
    solution: PositionSolution,
) -> str:
    """Return the reason why a seed leads to a point (3,) but not to its orientation."""
    robot, tube = problem.robot, problem.tube.rotation
    free = np.full(robot.joint_count, np.inf)
    rotation_target = wanted_at(problem, target, segment)
    other = solve_position(robot, target, seed, -free, free, rotation=rotation_target)
    rotation, tool = robot.tool_pose(other.q[None])
    lower, upper = problem.joint_lower[segment], problem.joint_upper[segment]
    is_outside = ((other.q < lower) | (other.q > upper)).any()
    keeps_rotation = tube is not None and tube.margin(rotation, tool, segment)[0] >= 0
    if other.error > _SEED_TOLERANCE or not keeps_rotation or not is_outside:
        return explain_rotation(problem, segment, rotation_text(solution))
    outside = outside_bounds(robot, other.q[None], lower, upper)
    return (
        f"{bounded_by(problem, (segment,), outside)} are in the way of the orientation asked, "
        f"{outside.words}; change them, the seed or tube.orientations"
    )


# ---- Straight lines in joint space between configurations at the reference points.
#
# Refinement may start from them where no continuous branch follows the reference path, or where a
# branch leads it to a trajectory that is not the fastest. The tool may still be outside the tube.

_POINTS_PER_SEGMENT = 21
_ROTATION_ERROR = 1e-6  # [rad]
_MAX_PARTS = 8  # of a line on which held parts would be lost at rest
_AROUND = 0.5  # [rad or m]: how far joints are moved to find another configuration
_OPEN_GOAL_TOLERANCE = 1e-7  # [m] of the tool from an open goal


def joint_lines(problem: PlanningProblem) -> ReferenceBranch:
    """Return joint lines from the start over the reference points to the goal.

    Raises:
        Infeasible: Status unreachable: start or goal has no configuration.
    """
    start, goal = end_configurations(problem)
    count = problem.tube.segment_count
    corners = [start]
    for k in range(1, count + (goal is None)):
        near = corners[-1]
        if goal is not None:
            near = near + (goal - near) / (count + 1 - k)
        corners.append(_corner(problem, k, near))
    if goal is not None:
        corners.append(goal)
    return ReferenceBranch(
        tuple(_line(problem, k, *each) for k, each in enumerate(pairwise(corners)))
    )


def _line(
    problem: PlanningProblem, segment: int, a: FloatArray, b: FloatArray, parts: int = _MAX_PARTS
) -> FloatArray:
    """Return configurations (P, n) on a line from a to b (n,), in parts that hold what is held."""
    fraction = np.linspace(0, 1, _POINTS_PER_SEGMENT)[:, None]
    line: FloatArray = (1 - fraction) * a + fraction * b
    if parts == 1 or holds(problem, line):
        return line
    tool, near = problem.robot.tool_position(np.array([a, b])).mean(axis=0), (a + b) / 2
    bounds = problem.joint_lower[segment], problem.joint_upper[segment]
    rotation = wanted_at(problem, tool, segment)
    middle = solve_position(problem.robot, tool, near, *bounds, rotation=rotation).q
    halves = (_line(problem, segment, *each, parts // 2) for each in ((a, middle), (middle, b)))
    first, second = halves
    return np.vstack([first, second[1:]])


def _corner(problem: PlanningProblem, k: int, near: FloatArray) -> FloatArray:
    """Return a configuration (n,) at reference point k or an open goal, near another.

    Where it violates the rotation tolerance, further seeds nearby are tried.
    """
    segments = [k - 1, min(k, problem.tube.segment_count - 1)]
    lower = problem.joint_lower[segments].max(axis=0)
    upper = problem.joint_upper[segments].min(axis=0)
    goal = problem.open_goal if k == problem.tube.segment_count else None
    point = problem.tube.points[k] if goal is None else goal.position
    if goal is not None and goal.bounds_rotation:
        rotation = wanted_at(problem, point, k)
    else:
        rotation = wanted_at(problem, point, k - 1, near)

    def solution(seed: FloatArray) -> PositionSolution:
        return solve_position(problem.robot, point, seed, lower, upper, rotation=rotation)

    best = solution(near)
    if best.rotation_error > _ROTATION_ERROR:
        steps = _AROUND * np.vstack([np.eye(len(near)), -np.eye(len(near))])
        solutions = [best, *(solution(near + step) for step in steps)]
        least = min(each.rotation_error for each in solutions) + _ROTATION_ERROR
        closest = [each for each in solutions if each.rotation_error <= least]
        best = min(closest, key=lambda each: float(abs(each.q - near).max()))
    if goal is not None and best.error > max(goal.tolerance, _OPEN_GOAL_TOLERANCE):
        message = f"no goal: the tool stops {best.error:.4g} m short"
        location = Location(segment=problem.tube.segment_number(k - 1, point)).at(point)
        raise Infeasible(PlanStatus.UNREACHABLE, message, location)
    return best.q


class KnownBranches:
    """Branches of the arm along a problem's tube, each computed once, on first use."""

    def __init__(self, problem: PlanningProblem, clock: PlanningClock) -> None:
        self._problem, self._clock = problem, clock
        self._narrower: tuple[PlanningProblem, ...] | None = None
        self._cached: dict[str, ReferenceBranch | Infeasible] = {}
        self._ends: FloatArray | Infeasible | None = None

    @property
    def has_any(self) -> bool:
        """True if a search has ended with a branch."""
        return any(isinstance(result, ReferenceBranch) for result in self._cached.values())

    @property
    def tried(self) -> int:
        """Number of branches searched."""
        return len(self._cached)

    def under(self, clock: PlanningClock) -> "KnownBranches":
        """Return the same branches for work under another clock."""
        same = KnownBranches(self._problem, clock)
        same._cached, same._ends = self._cached, self._ends
        same._narrower = self._narrower
        return same

    def require_ends(self) -> FloatArray:
        """Return the configurations of the start and of a given goal, shape (1 or 2, n).

        Raises:
            Infeasible: A seed does not lead to its point, or start or goal is in collision or too
                near to an obstacle.
            TimeLimitReached: Before that was known.
        """
        if self._ends is None:
            self._clock.enter("start and goal")
            problem, ends = self._problem, []
            names = zip(("start", "goal"), (0, -1), problem.endpoints, strict=True)
            try:
                for name, point, end in names:
                    if not end.is_open:  # open goals may move
                        ends.append(end_configuration(problem, end, point))
                        require_free(problem, name, ends[-1], is_given=end.joints is not None)
                self._ends = np.array(ends)
            except Infeasible as reason:
                self._ends = reason
        if isinstance(self._ends, Infeasible):
            raise self._ends
        return self._ends

    def by_rule(self, rule: RedundancyRule) -> ReferenceBranch:
        """Return the branch of a rule, its start and given goal clear of everything.

        Raises:
            Infeasible: The branch ends before the goal, its start or given goal is in collision,
                or the time limit has passed.
        """
        search = partial(reference_branch, rule=rule, checkpoint=self._clock.check)
        return self._once(rule, "inverse kinematics along the reference path", search)

    def position_only(self) -> ReferenceBranch:
        """Return a branch whose tool need not keep the rotation tolerance."""
        rule = redundancy_rules(self._problem)[0]
        search = partial(
            reference_branch, rule=rule, checkpoint=self._clock.check, with_rotation=False
        )
        return self._once(
            "position only", "inverse kinematics of the tool's position alone", search
        )

    def joint_lines(self) -> ReferenceBranch:
        """Return joint lines between the reference points; the tool may leave the tube."""
        return self._once("joint lines", "inverse kinematics at the reference points", joint_lines)

    def _once(
        self, name: str, stage: str, search: Callable[[PlanningProblem], ReferenceBranch]
    ) -> ReferenceBranch:
        """Return the branch of a search, of a tool that holds its parts at rest if there is one."""
        ends = self.require_ends()
        if name not in self._cached:
            self._clock.enter(stage)
            if self._narrower is None:
                narrower = kept_upright(self._problem, ends[0], *ends[1:])
                self._narrower = () if narrower is None else (narrower,)
            for problem in (*self._narrower, self._problem):
                try:
                    self._cached[name] = search(problem)
                    break
                except Infeasible as reason:
                    self._cached[name] = reason
        result = self._cached[name]
        if isinstance(result, Infeasible):
            raise result
        return result


# ---- Start and goal as configurations, where a problem gives poses of the tool.

_MAX_CANDIDATES = 8  # configurations of the goal
_OTHER = 0.1  # [rad or m]: a joint that is farther away makes another configuration


def configured_ends(problem: PlanningProblem) -> tuple[PlanningProblem, tuple[str, ...]]:
    """Return a problem with configurations in place of poses of start and goal, and notes.

    Of several configurations for the goal, the first that continues the branch from the start is
    taken. The notes name the choice among several.

    Raises:
        Infeasible: Status unreachable: a pose has no configuration.
    """
    problem, notes = _with_missed_ends(problem)
    start, goal_pose = (end.pose for end in problem.endpoints)
    if start is not None:
        candidates = pose_configurations(problem, start, 0)
        notes += _choice(problem, "start", candidates, candidates[0], "")
        problem = replace(problem, start=candidates[0])
    if goal_pose is not None:
        candidates = pose_configurations(problem, goal_pose, -1)
        goal = _continuing(problem, goal_pose, candidates)
        why = "" if goal is None else "it continues the branch from the start and is "
        goal = candidates[0] if goal is None else goal
        notes += _choice(problem, "goal", candidates, goal, why)
        problem = replace(problem, goal=goal)
    return problem, tuple(notes)


_MAX_PAIRS = 32  # of configurations of start and goal, where both are poses


def other_ends(
    problem: PlanningProblem, configured: PlanningProblem
) -> tuple[list[PlanningProblem], int]:
    """Return further problems with configurations in place of poses, and the number of all.

    Only configurations free of collision, if any is free. The least times between start and goal
    come first; where both are poses, only so many. The problem `configured` is the one of
    `configured_ends`.
    """
    by_end, count = [], 1
    for name, point, end in zip(("start", "goal"), (0, -1), problem.endpoints, strict=True):
        own = getattr(configured, name)
        if end.pose is None or end.pose.seed is not None:
            by_end.append([own])
            continue
        candidates = pose_configurations(problem, end.pose, point)
        others = [q for q in candidates if abs(q - own).max() > _OTHER]
        free = [q for q in others if is_free(problem, name, q)]
        count *= len(others) + 1
        by_end.append([own, *(free or others)])
    pairs = [(start, goal) for start in by_end[0] for goal in by_end[1]][1:]
    problems = [replace(configured, start=start, goal=goal) for start, goal in pairs]
    problems.sort(key=least_time)
    has_both = len(by_end[0]) > 1 and len(by_end[1]) > 1
    return problems[: _MAX_PAIRS if has_both else None], count


def least_time(problem: PlanningProblem) -> float:
    """Return a lower bound on the duration between two configurations [s]; 0 if one is open.

    Every joint travels from rest to rest under its limits of velocity and acceleration alone.
    """
    start, goal = (end.joints for end in problem.endpoints)
    if start is None or goal is None:
        return 0.0
    limits, travel = problem.robot.limits, abs(goal - start)
    reached = np.minimum(limits.velocity, np.sqrt(limits.acceleration * travel))
    is_bound = (travel > 0) & np.isfinite(reached)
    times = travel[is_bound] / reached[is_bound] + reached[is_bound] / limits.acceleration[is_bound]
    return float(times.max(initial=0.0))


def _with_missed_ends(problem: PlanningProblem) -> tuple[PlanningProblem, list[str]]:
    """Return a problem with its ends in the tube where the arm misses a reference point, and notes.

    A seed's configuration is the one nearest the point; an open goal is the ball about the point.
    """
    notes: list[str] = []
    for name, point, end in zip(("start", "goal"), (0, -1), problem.endpoints, strict=True):
        radius, target = float(problem.end_radii[point]), problem.tube.points[point]
        if not radius or end.kind not in ("seed", "open"):
            continue
        if end.seed is not None:
            q = end_configuration(problem, end, point)
            away = float(np.linalg.norm(problem.robot.tool_position(q[None])[0] - target))
            value: Any = q
        else:
            lower, upper = problem.joint_lower[-1], problem.joint_upper[-1]
            seeds = spread_seeds(lower, upper)
            if problem.endpoints[0].pose is None:
                near = end_configuration(problem, problem.endpoints[0], 0)
                seeds = np.vstack([near, seeds])
            away = float(solve_positions(problem.robot, target, seeds, lower, upper)[1][:, 0].min())
            value = GoalRegion(target, radius)
        if away <= (_SEED_TOLERANCE if end.seed is not None else MARGIN_TOLERANCE / 2):
            continue
        ends: dict[str, Any] = {name: value}
        problem = replace(problem, **ends)
        notes.append(
            f"{name}: the joints move the tool in {problem.robot.tool_directions} of 3 directions "
            f"and stop it {away:.3g} m short of the reference point; it may be anywhere "
            f"within {radius:g} m of the point, inside the tube"
        )
    return problem, notes


def _continuing(
    problem: PlanningProblem, pose: ToolPose, candidates: FloatArray
) -> FloatArray | None:
    """Return a configuration (n,) for the goal to which a branch from the start leads, or None.

    Only free configurations count, if any is free. Those near the end of a branch with an open goal
    come first.
    """
    if pose.seed is not None:
        return None
    open_problem = replace(problem, goal=None)
    last = problem.tube.segment_count - 1
    bounds = problem.joint_lower[last], problem.joint_upper[last]
    near = np.empty((0, problem.robot.joint_count))
    for rule in redundancy_rules(open_problem):
        try:
            end = reference_branch(open_problem, rule).goal
        except Infeasible:
            continue
        near = reaching(problem.robot, pose, end[None], *bounds)
        break
    candidates = np.vstack([near, candidates])
    free = [q for q in candidates if is_free(problem, "goal", q)]
    for q in (free or list(candidates))[:_MAX_CANDIDATES]:
        if is_continued(replace(problem, goal=q)):
            return q
    return None


def is_continued(problem: PlanningProblem) -> bool:
    """Return True if a branch leads from a problem's start along its tube to its goal.

    Where the tool may be anywhere no branch is asked for.
    """
    if problem.has_free_tool:
        return True
    for rule in redundancy_rules(problem):
        try:
            reference_branch(problem, rule)
        except Infeasible:
            continue
        return True
    return False


def _choice(
    problem: PlanningProblem, end: str, candidates: FloatArray, choice: FloatArray, why: str
) -> list[str]:
    """Return the note on the choice among several configurations, if there are several."""
    if len(candidates) < 2:
        return []
    joints = ", ".join(f"{value:.6g}" for value in np.round(choice, 6) + 0.0)  # no minus zero
    free = "free of collision" if is_free(problem, end, choice) else "not free of collision"
    near = "" if why else " and, of such, nearest the middle of its joint ranges"
    return [
        f"{end}: of {len(candidates)} configurations found for its pose [{joints}] is taken: {why}"
        f"{free}{near}; a seed or joint signs ask for another"
    ]
