"""Planning without refinement or search: the arm rests at every reference point."""

from dataclasses import dataclass

from tubeplanner.baselines.stop_at_corners import stop_at_corners
from tubeplanner.branches.known_branches import KnownBranches
from tubeplanner.branches.reference_branch import RedundancyRule, ReferenceBranch, redundancy_rules
from tubeplanner.outcome import Infeasible
from tubeplanner.planning.plan_options import STOP_AT_CORNERS
from tubeplanner.planning.plan_result import (
    PlanResult,
    certified_result,
    refused_result,
    stopped_result,
)
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.progress import PlanningClock, TimeLimitReached
from tubeplanner.trajectory.joint_trajectory import JointTrajectory


@dataclass(frozen=True, eq=False)
class StoppingPlan:
    """The result of stopping at corners, certified or not, with its branch and trajectory."""

    result: PlanResult
    branch: ReferenceBranch | None = None
    trajectory: JointTrajectory | None = None


def stopping_plan(
    problem: PlanningProblem,
    branches: KnownBranches,
    clock: PlanningClock,
    *,
    every_rule: bool = True,
) -> StoppingPlan:
    """Return the first certified trajectory that stops at corners.

    If there is none, the reason is that of the most natural rule for redundant joints; branch and
    trajectory are the first found.

    Args:
        problem: The planning problem.
        branches: Its branches.
        clock: The planning's.
        every_rule: Whether others are tried than the most natural one.
    """
    reasons: dict[RedundancyRule, PlanResult] = {}
    first_branch = first_trajectory = None
    rules = redundancy_rules(problem)
    for rule in rules if every_rule else rules[:1]:
        try:
            branch = branches.by_rule(rule)
            clock.enter("trajectory along it, stopping at corners")
            first_branch = first_branch or branch
            trajectory = stop_at_corners(problem, branch, clock.check)
            first_trajectory = first_trajectory or trajectory
            clock.enter("certificate")
            result = certified_result(problem, trajectory, STOP_AT_CORNERS, clock)
        except TimeLimitReached:
            return StoppingPlan(stopped_result(clock, "time_limit", STOP_AT_CORNERS))
        except Infeasible as reason:
            result = refused_result(reason, STOP_AT_CORNERS)
        if result.succeeded:
            return StoppingPlan(result, branch, trajectory)
        reasons[rule] = result
    most_natural = RedundancyRule.AS_NEEDED if every_rule else rules[0]
    return StoppingPlan(reasons[most_natural], first_branch, first_trajectory)
