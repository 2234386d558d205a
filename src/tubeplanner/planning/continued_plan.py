"""Planning by refinement from the last motion, after a problem has changed a little."""

from collections.abc import Callable
from itertools import count

from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.planning.plan_options import REFINEMENT
from tubeplanner.planning.plan_result import PlanResult, stopped_result
from tubeplanner.planning.refined_plan import certified_refinement, entered
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.progress import PlanningClock
from tubeplanner.refinement.refined_motion import RefinedMotion
from tubeplanner.refinement.refinement import Refinement

# A motion that changes for more steps than this is no longer near the last: another may be better.
# (Of 104 small changes and 60 large ones, those that took no more ended at most 0.1 % above a fresh
# plan, and 0.4 % once after several large ones at a time; with more, up to 0.5 % and far slower.)
_MAX_STEPS = 25


def continued_plan(
    problem: PlanningProblem, last: RefinedMotion, clock: PlanningClock
) -> PlanResult | None:
    """Return a certified trajectory that refinement makes of the last motion.

    Returns:
        None if there is none, and the problem is to be planned afresh. After Ctrl-C or the time
        limit, the best so far, or that nothing is certified.

    Raises:
        TimeLimitReached: Before it began; likewise KeyboardInterrupt.
    """
    inner = last.suited(problem)
    if inner is None:
        return None
    try:
        start = last.shifted(inner)
        checkpoint = _counting(entered(start.grid.interval_count, clock))
        refinement = Refinement(inner, start, (), checkpoint)
        result = certified_refinement(problem, refinement, refinement.run_on, clock)
    except Infeasible:
        return None
    if result is not None and result.succeeded:
        return result
    if result is None or result.stopped_by is None:
        return None
    return stopped_result(clock, result.stopped_by, REFINEMENT)


def _counting(checkpoint: Callable[[float], None]) -> Callable[[float], None]:
    """Return a checkpoint that ends the work when there were too many steps.

    It raises Infeasible then, status no_trajectory.
    """
    steps = count(1)

    def counted(duration: float) -> None:
        checkpoint(duration)
        if next(steps) > _MAX_STEPS:
            message = f"the last motion still changed after {_MAX_STEPS} steps"
            raise Infeasible(PlanStatus.NO_TRAJECTORY, message, Place())

    return counted
