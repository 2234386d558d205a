"""From the shortest motion to one that a machine can follow: in its periods, and smooth."""

from dataclasses import replace

from tubeplanner.planning.jerk_note import jerk_note
from tubeplanner.planning.periodic_plan import periodic_plan
from tubeplanner.planning.plan_result import PlanResult, certified_result
from tubeplanner.planning.smoothed_plan import smoothed_plan
from tubeplanner.planning.timing import fewest_periods, most_periods
from tubeplanner.problem.objective import Objective
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.progress import PlanningClock, until_stopped
from tubeplanner.refinement.periodic_knots import on_periodic_knots


def followed_plan(
    problem: PlanningProblem, shortest: PlanResult, slack: float | None, clock: PlanningClock
) -> PlanResult:
    """Return the motion that is written: in whole periods and smooth, as far as that is asked.

    Args:
        problem: The planning problem.
        shortest: The answer of planning.
        slack: By which share longer than the shortest motion it may be; None: as the problem says.
        clock: The planning's.

    Returns:
        The answer itself if it is not refinement's, or planning was stopped early.
    """
    found = _followed(problem.joined, shortest, slack, clock)
    if found.trajectory is None or found.motion is None or found.shortest is not None:
        return found
    return replace(found, notes=(*found.notes, *jerk_note(problem.robot, found.trajectory)))


def _followed(
    problem: PlanningProblem, shortest: PlanResult, slack: float | None, clock: PlanningClock
) -> PlanResult:
    """Return what `followed_plan` does, of joined segments, without a note on jerk."""
    period = problem.period
    if slack is None:
        slack = (problem.objective or Objective()).slack
    if shortest.motion is None or shortest.duration is None or shortest.stopped_by is not None:
        return shortest if period is None else _in_whole_periods(problem, shortest, period)
    spline = shortest.motion.spline
    if period is None:
        longest = shortest.duration * (1 + slack)
        return smoothed_plan(problem, shortest, spline, longest, clock) if slack else shortest
    found, stopped_by = until_stopped(lambda: periodic_plan(problem, shortest, period, clock))
    if found is None:
        longer = _in_whole_periods(problem, shortest, period)
        return replace(longer, stopped_by=stopped_by)
    periodic, spline = found
    if not slack or periodic.stopped_by is not None or periodic.duration is None:
        return periodic
    count = most_periods(periodic.duration * (1 + slack), period)
    spline = on_periodic_knots(spline, count)
    return smoothed_plan(problem, periodic, spline, count * period, clock)


def _in_whole_periods(problem: PlanningProblem, shortest: PlanResult, period: float) -> PlanResult:
    """Return an answer whose duration is a multiple of a period, its breakpoints where they were.

    Slower motions keep all limits that faster ones keep, but where the arm swings through what
    its motors cannot hold; then the answer stays as it is.
    """
    if shortest.trajectory is None or shortest.duration is None:
        return shortest
    duration = fewest_periods(shortest.duration, period) * period
    slower = shortest.trajectory.scaled(duration / shortest.duration)
    clock = PlanningClock(None, None)
    found = certified_result(problem, slower, shortest.method, clock)
    if not found.succeeded:
        note = (
            f"the duration is no multiple of the period, {period:g} s: the slower motion is not "
            f"certified: {found.message}"
        )
        return replace(shortest, notes=(*shortest.notes, note))
    note = (
        f"the duration is a multiple of the period, {period:g} s; the breakpoints are not, so that "
        "its samples are not the motion itself"
    )
    return replace(
        found,
        search=shortest.search,
        phase_two=shortest.phase_two,
        stopped_by=shortest.stopped_by,
        sensitivities=shortest.sensitivities,
        motion=shortest.motion,
        notes=(*shortest.notes, note),
    )
