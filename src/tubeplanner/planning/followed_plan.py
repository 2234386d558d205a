"""From the shortest motion to one that a machine can follow: in its periods, and smooth."""

from dataclasses import replace

from tubeplanner.planning.periodic_plan import periodic_plan
from tubeplanner.planning.plan_result import PlanResult
from tubeplanner.planning.smoothed_plan import smoothed_plan
from tubeplanner.planning.timing import most_periods
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.progress import PlanningClock, until_stopped
from tubeplanner.refinement.periodic_knots import on_periodic_knots


def followed_plan(
    problem: PlanningProblem, shortest: PlanResult, slack: float, clock: PlanningClock
) -> PlanResult:
    """Return the motion that is written: in whole periods and smooth, as far as that is asked.

    Args:
        problem: The planning problem.
        shortest: Refinement's answer, certified.
        slack: By which share longer than the shortest motion it may be.
        clock: The planning's.
    """
    assert shortest.motion is not None and shortest.duration is not None
    period, spline = problem.period, shortest.motion.spline
    if period is None:
        longest = shortest.duration * (1 + slack)
        return smoothed_plan(problem, shortest, spline, longest, clock) if slack else shortest
    found, stopped_by = until_stopped(lambda: periodic_plan(problem, shortest, period, clock))
    if found is None:
        note = f"no motion with knots at multiples of the period, {period:g} s, was found near it"
        notes = (*shortest.notes, note)
        return replace(shortest, stopped_by=stopped_by, notes=notes)
    periodic, spline = found
    if not slack or periodic.stopped_by is not None or periodic.duration is None:
        return periodic
    count = most_periods(periodic.duration * (1 + slack), period)
    spline = on_periodic_knots(spline, count)
    return smoothed_plan(problem, periodic, spline, count * period, clock)
