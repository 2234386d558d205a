"""Motions whose duration and breakpoints are multiples of a controller's period."""

from dataclasses import replace
from functools import partial

from tubeplanner.outcome import Infeasible
from tubeplanner.planning.certified_motion import certified_motion
from tubeplanner.planning.plan_result import PlanResult
from tubeplanner.planning.refined_plan import entered
from tubeplanner.planning.timing import fewest_periods, lengthened, no_longer
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.progress import PlanningClock
from tubeplanner.refinement.periodic_knots import on_periodic_knots
from tubeplanner.refinement.phased_spline import DEGREE, PhasedSpline
from tubeplanner.refinement.refinement import Refinement
from tubeplanner.trajectory.fitted_spline import REST_POINTS

# So many numbers of periods are tried, each with its own knots.
_MAX_TRIES = 8
# With fewer, the control points at rest at both ends leave none that may move.
_FEWEST_PERIODS = 2 * REST_POINTS - DEGREE + 1


def periodic_plan(
    problem: PlanningProblem, shortest: PlanResult, period: float, clock: PlanningClock
) -> tuple[PlanResult, PhasedSpline] | None:
    """Return the shortest motion in whole periods, certified, and its spline.

    On knots at multiples of a period, the last motion is refined again: they are fewer where the
    arm sets off, and switching times stay where they are.

    Args:
        problem: The planning problem.
        shortest: Refinement's answer, certified.
        period: [s].
        clock: The planning's.

    Returns:
        None if none is found near the shortest motion.

    Raises:
        TimeLimitReached: Before there was one; likewise KeyboardInterrupt.
    """
    assert shortest.motion is not None and shortest.duration is not None
    inner, spline = shortest.motion.problem, shortest.motion.spline
    phases = len(spline.grid.shares)
    count = max(fewest_periods(shortest.duration, period), phases, _FEWEST_PERIODS)
    for _ in range(_MAX_TRIES):
        start = on_periodic_knots(spline, count)
        refinement = Refinement(inner, start, (), entered(start.grid.interval_count, clock))
        in_periods = partial(lengthened, duration=count * period, period=period)
        try:
            found = certified_motion(
                problem, refinement, refinement.run_on, clock, timed=in_periods
            )
        except Infeasible:
            found = None
        if found is None or found.duration is None:
            count += 1
            continue
        if no_longer(found.duration, count * period):
            periodic = replace(
                found,
                notes=shortest.notes,
                sensitivities=shortest.sensitivities,
                motion=shortest.motion,
            )
            return periodic, refinement.spline
        count = max(count + 1, fewest_periods(found.duration, period))
    return None
