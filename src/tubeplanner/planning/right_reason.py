"""Why there is no trajectory: what really blocks, before what a branch ended at."""

from dataclasses import replace

from tubeplanner.branches.known_branches import KnownBranches
from tubeplanner.outcome import Infeasible, PlanStatus
from tubeplanner.planning.blocked_spot import blocked_spot
from tubeplanner.planning.plan_result import PlanResult, refused_result
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.progress import PlanningClock, TimeLimitReached

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
