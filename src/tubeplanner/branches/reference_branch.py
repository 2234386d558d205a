"""The arm along the reference path: one continuous branch of the inverse kinematics.

The tool goes from its position in the start configuration through the inner reference points to its
position in the goal configuration; each leg is straight, so it stays in its capsule. Where its
rotation is bounded, it follows the reference orientation as far as the arm can. The joint ranges of
each segment select the branch, and a rule moves redundant joints.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.branches.inverse_kinematics import PositionSolution, solve_position
from tubeplanner.branches.outside_bounds import bounded_by, outside_bounds
from tubeplanner.branches.pose_configurations import pose_configurations
from tubeplanner.branches.reference_turn import wanted_at
from tubeplanner.branches.segment_walk import (
    SegmentWalk,
    explain_error,
    explain_turn,
    turned_off,
)
from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.polyline import arc_lengths
from tubeplanner.problem.problem import PlanningProblem, Seed
from tubeplanner.problem.tool_pose import ToolPose

_SEED_TOLERANCE = 1e-6  # [m] between the tool and the reference point of a seed
# How near the branch must come to a given goal configuration to be on its branch [rad or m].
_GOAL_TOLERANCE = 1e-6
_SAME = 1e-6  # [rad or m]
_STILL = 1e-9  # [rad or m]: joints that move less stand still


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
    def moving_segments(self) -> list[int]:
        """Indices of the segments in which the arm moves."""
        return [k for k, q in enumerate(self.segments) if np.ptp(q, axis=0).max() > _STILL]

    @property
    def goal(self) -> FloatArray:
        """Last configuration, shape (n,)."""
        return self.segments[-1][-1]

    @property
    def length(self) -> float:
        """How far joints go, of every step the one that goes farthest [rad or m]."""
        return sum(float(abs(np.diff(q, axis=0)).max(axis=1).sum()) for q in self.segments)

    def is_as(self, other: "ReferenceBranch") -> bool:
        """Return whether another branch has the same configurations, to 1e-6 rad or m."""
        pairs = list(zip(self.segments, other.segments, strict=True))
        return all(
            one.shape == another.shape and abs(one - another).max() < _SAME
            for one, another in pairs
        )


class RedundancyRule(StrEnum):
    """How redundant joints move."""

    AS_NEEDED = "they move as little as possible, and to the goal at the end"
    PROPORTIONAL = "they go from start to goal in proportion to the arc length"
    HELD = "they are held near the start, and go to the goal at the end"
    CENTRED = "they go to the middle of their ranges, and to the goal at the end"


def redundancy_rules(problem: PlanningProblem) -> tuple[RedundancyRule, ...]:
    """Return the rules worth trying for a problem, the most natural first."""
    if problem.given_goal is None:
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
    """Return the branch that the joint signs, the start and the goal select.

    Args:
        problem: The planning problem.
        rule: How redundant joints move.
        checkpoint: Called before every segment; it may raise to end the work.
        with_rotation: Whether the branch keeps the rotation tolerance, if there is one.

    Raises:
        Infeasible: Status unreachable: the message says where the branch ends and why.
    """
    start = end_configuration(problem, problem.start, 0)
    given = problem.given_goal
    goal = None if given is None else end_configuration(problem, given, -1)
    route = _route(problem, start, goal)
    pulls = _pulls(problem, route, start, goal, rule)
    q, segments = start, []
    for k in range(problem.tube.segment_count):
        checkpoint()
        wanted = None if pulls is None else pulls[k : k + 2]
        is_last = k + 1 == problem.tube.segment_count
        end = goal if is_last else None
        ends = route[k : k + 2]
        walk = SegmentWalk(problem, k, ends, q, wanted, end, with_rotation=with_rotation)
        segments.append(walk.to_the_end())
        q = segments[-1][-1]
    if goal is not None:
        _require_goal(problem, q, goal)
        segments[-1][-1] = goal
    return ReferenceBranch(tuple(segments))


def _pulls(
    problem: PlanningProblem,
    route: FloatArray,
    start: FloatArray,
    goal: FloatArray | None,
    rule: RedundancyRule,
) -> FloatArray | None:
    """Return the values (m+1, n) towards which redundant joints move at each point, if any."""
    if rule is RedundancyRule.HELD:
        return np.tile(start, (len(route), 1))
    if rule is RedundancyRule.CENTRED:
        with np.errstate(invalid="ignore"):
            middle = (problem.joint_lower + problem.joint_upper) / 2
        return np.vstack([start, np.where(np.isfinite(middle), middle, start)])
    if rule is RedundancyRule.AS_NEEDED or goal is None:
        return None
    share = _shares_of_length(route)[:, None]
    return (1 - share) * start + share * goal


def end_configuration(
    problem: PlanningProblem, given: FloatArray | Seed | ToolPose, point: int
) -> FloatArray:
    """Return the start (point 0) or goal (point -1), (n,): as given, or from its seed or pose.

    Raises:
        Infeasible: Status unreachable: the seed does not lead there, or the pose is not reached.
    """
    if isinstance(given, ToolPose):
        first: FloatArray = pose_configurations(problem, given, point)[0]
        return first
    if not isinstance(given, Seed):
        return given
    segment = 0 if point == 0 else problem.tube.segment_count - 1
    lower, upper = problem.joint_lower[segment], problem.joint_upper[segment]
    target, seed = problem.tube.points[point], given.joints
    wanted = wanted_at(problem, target, segment)
    solution = solve_position(problem.robot, target, seed, lower, upper, rotation=wanted)
    reason = None
    if solution.error > _SEED_TOLERANCE:
        reason = explain_error(problem, target, seed, segment, solution)
    elif problem.tube.rotation is not None:
        rotation, tool = problem.robot.tool_pose(solution.q[None])
        if problem.tube.rotation.margin(rotation, tool, segment)[0] < 0:
            reason = _explain_turned_end(problem, target, seed, segment, solution)
    if reason is not None:
        place = Place(segment=problem.tube.segment_number(segment, target)).at(target)
        end = "start" if point == 0 else "goal"
        message = f"{end} from its seed: {reason}"
        raise Infeasible(PlanStatus.UNREACHABLE, message, place, starts=1, configuration=solution.q)
    return solution.q


def _explain_turned_end(
    problem: PlanningProblem,
    target: FloatArray,
    seed: FloatArray,
    segment: int,
    solution: PositionSolution,
) -> str:
    """Return why a seed leads to a point (3,) but not to the orientation asked there."""
    robot, tube = problem.robot, problem.tube.rotation
    free = np.full(robot.joint_count, np.inf)
    wanted = wanted_at(problem, target, segment)
    other = solve_position(robot, target, seed, -free, free, rotation=wanted)
    rotation, tool = robot.tool_pose(other.q[None])
    lower, upper = problem.joint_lower[segment], problem.joint_upper[segment]
    is_outside = ((other.q < lower) | (other.q > upper)).any()
    is_turned = tube is not None and tube.margin(rotation, tool, segment)[0] >= 0
    if other.error > _SEED_TOLERANCE or not is_turned or not is_outside:
        return explain_turn(problem, segment, turned_off(solution))
    outside = outside_bounds(robot, other.q[None], lower, upper)
    return (
        f"{bounded_by(problem, (segment,), outside)} are in the way of the orientation asked, "
        f"{outside.words}; change them, the seed or tube.orientations"
    )


def _route(problem: PlanningProblem, start: FloatArray, goal: FloatArray | None) -> FloatArray:
    """Return the tool's route: reference points, its ends from start and goal."""
    route = problem.tube.points.copy()
    route[0] = problem.robot.tool_position(start[None])[0]
    if goal is not None:
        route[-1] = problem.robot.tool_position(goal[None])[0]
    elif problem.open_goal is not None:
        route[-1] = problem.open_goal.position
    return route


def _shares_of_length(route: FloatArray) -> FloatArray:
    """Return which share of the whole length lies before each point of a route, shape (m+1,)."""
    before = arc_lengths(route)
    return before / before[-1] if before[-1] > 0 else np.linspace(0, 1, len(route))


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
        Place(joint=joint, segment=problem.tube.segment_number(segment, problem.tube.points[-1])),
        configuration=q,
    )
