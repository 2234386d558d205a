"""Planning without refinement or search: the arm rests at every reference point."""

from dataclasses import dataclass

from tubeplanner.branches.known_branches import KnownBranches
from tubeplanner.branches.reference_branch import ReferenceBranch, SpareJoints, spare_joint_rules
from tubeplanner.motion.trajectory import JointTrajectory
from tubeplanner.outcome import Infeasible, PlanStatus
from tubeplanner.planning.plan_options import STOP_AT_CORNERS
from tubeplanner.planning.plan_result import PlanResult, certified_result
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.progress import PlanningClock
from tubeplanner.waypoint_search.stop_at_corners import stop_at_corners


@dataclass(frozen=True, eq=False)
class StoppingPlan:
    """What stopping at corners gave: its result, certified or not, and what that was made from."""

    result: PlanResult
    branch: ReferenceBranch | None = None
    motion: JointTrajectory | None = None


def stopping_plan(
    problem: PlanningProblem, branches: KnownBranches, clock: PlanningClock
) -> StoppingPlan:
    """Return the first certified motion that stops at corners.

    If there is none, the most natural rule for the spare joints says why; branch and motion are the
    first there are.
    """
    reasons: dict[SpareJoints, PlanResult] = {}
    first_branch = first_motion = None
    for rule in spare_joint_rules(problem):
        try:
            branch = branches.along(rule)
            clock.enter("motion along it, stopping at corners")
            first_branch = first_branch or branch
            motion = stop_at_corners(problem, branch, clock.check)
            first_motion = first_motion or motion
            clock.enter("certificate")
            result = certified_result(problem, motion, STOP_AT_CORNERS, clock)
        except Infeasible as reason:
            result = PlanResult(reason.status, str(reason), reason.place, STOP_AT_CORNERS)
        if result.succeeded:
            return StoppingPlan(result, branch, motion)
        if result.status is PlanStatus.TIME_LIMIT:
            return StoppingPlan(result)
        reasons[rule] = result
    return StoppingPlan(reasons[SpareJoints.AS_NEEDED], first_branch, first_motion)
