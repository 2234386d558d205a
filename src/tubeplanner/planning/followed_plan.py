"""From the shortest motion to one that a machine can follow: in its periods, smooth or thrifty."""

from dataclasses import replace
from math import ceil

from tubeplanner.outcome import Place, PlanStatus
from tubeplanner.planning.cheapest_duration import cheapest_duration
from tubeplanner.planning.jerk_note import jerk_note
from tubeplanner.planning.periodic_plan import periodic_plan
from tubeplanner.planning.plan_result import PlanResult, certified_result
from tubeplanner.planning.second_stage_plan import second_stage_plan
from tubeplanner.planning.timing import fewest_periods, most_periods, no_longer
from tubeplanner.problem.objective import Objective
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.progress import PlanningClock, until_stopped
from tubeplanner.refinement.periodic_knots import on_periodic_knots


def followed_plan(
    problem: PlanningProblem, shortest: PlanResult, slack: float | None, clock: PlanningClock
) -> PlanResult:
    """Return the motion that is written: in time, in whole periods and as good as that allows.

    Args:
        problem: The planning problem.
        shortest: The answer of planning.
        slack: By which share longer than the shortest motion it may be; None: as the problem says,
            which may say how long it is to take instead.
        clock: The planning's.

    Returns:
        The answer itself if it is not refinement's, or planning was stopped early, but for whole
        periods and a duration that is asked for. Status no_trajectory if that is too short.
    """
    problem, objective = problem.joined, problem.objective or Objective()
    duration = objective.duration if slack is None else None
    slack = objective.slack if slack is None else slack
    found = _followed(problem, shortest, slack or 0.0, duration, clock)
    if duration is not None:
        found = _in_duration(problem, found, duration)
    if found.trajectory is None or found.motion is None or found.shortest is not None:
        return found
    return replace(found, notes=(*found.notes, *jerk_note(problem.robot, found.trajectory)))


def _followed(
    problem: PlanningProblem,
    shortest: PlanResult,
    slack: float,
    duration: float | None,
    clock: PlanningClock,
) -> PlanResult:
    """Return the best motion that is found, of joined segments, in whole periods."""
    period = problem.period
    if shortest.motion is None or shortest.trajectory is None or shortest.stopped_by is not None:
        return shortest if period is None else _in_whole_periods(problem, shortest, period)
    spline = shortest.motion.spline
    if period is None:
        longest = _longest(problem, shortest, slack, duration)
        if longest is None:
            return shortest
        return second_stage_plan(problem, shortest, spline, longest, clock)
    found, stopped_by = until_stopped(lambda: periodic_plan(problem, shortest, period, clock))
    if found is None:
        longer = _in_whole_periods(problem, shortest, period)
        return replace(longer, stopped_by=stopped_by)
    periodic, spline = found
    longest = _longest(problem, periodic, slack, duration)
    if longest is None or periodic.stopped_by is not None or periodic.duration is None:
        return periodic
    count = max(most_periods(longest, period), fewest_periods(periodic.duration, period))
    spline = on_periodic_knots(spline, count)
    return second_stage_plan(problem, periodic, spline, count * period, clock)


def _longest(
    problem: PlanningProblem, shortest: PlanResult, slack: float, duration: float | None
) -> float | None:
    """Return how long the motion is to take [s]; None: there is nothing to be done in that time."""
    assert shortest.trajectory is not None
    if duration is not None:
        return duration if no_longer(shortest.trajectory.duration, duration) else None
    if not slack:
        return None
    longest = shortest.trajectory.duration * (1 + slack)
    return cheapest_duration(problem, shortest.trajectory, longest)


def _in_duration(problem: PlanningProblem, found: PlanResult, duration: float) -> PlanResult:
    """Return an answer that takes exactly as long as is asked for, or that there is none."""
    if found.trajectory is None or found.duration is None:
        return found
    if not no_longer(found.duration, duration):
        # Rounded upwards; multiples of a period are as they are.
        least = found.duration if problem.period else ceil(1e4 * found.duration) / 1e4
        return replace(
            found,
            status=PlanStatus.NO_TRAJECTORY,
            message=f"objective.duration is {duration:g} s, but the shortest motion that was found "
            f"takes {found.duration:.6g} s; give {least:.6g} s or more, or a slack instead",
            place=Place(),
            trajectory=None,
            shortest=found.trajectory,
            notes=(),
        )
    if no_longer(duration, found.duration):
        return found
    note = f"that motion is run slower, in the duration that is asked for, {duration:g} s"
    slower = _run_in(problem, found, duration, note)
    return replace(slower, shortest=found.shortest or found.trajectory)


def _in_whole_periods(problem: PlanningProblem, shortest: PlanResult, period: float) -> PlanResult:
    """Return an answer whose duration is a multiple of a period, its breakpoints where they were.

    Slower motions keep all limits that faster ones keep, but where the arm swings through what
    its motors cannot hold; then the answer stays as it is.
    """
    if shortest.trajectory is None or shortest.duration is None:
        return shortest
    note = (
        f"the duration is a multiple of the period, {period:g} s; the breakpoints are not, so that "
        "its samples are not the motion itself"
    )
    duration = fewest_periods(shortest.duration, period) * period
    longer = _run_in(problem, shortest, duration, note)
    if longer.succeeded:
        return longer
    note = (
        f"the duration is no multiple of the period, {period:g} s: the slower motion is not "
        f"certified: {longer.message}"
    )
    return replace(shortest, notes=(*shortest.notes, note))


def _run_in(problem: PlanningProblem, answer: PlanResult, duration: float, note: str) -> PlanResult:
    """Return an answer run slower, certified, with a note."""
    assert answer.trajectory is not None
    slower = answer.trajectory.scaled(duration / answer.trajectory.duration)
    found = certified_result(problem, slower, answer.method, PlanningClock(None, None))
    return replace(
        found,
        search=answer.search,
        phase_two=answer.phase_two,
        stopped_by=answer.stopped_by,
        sensitivities=answer.sensitivities,
        motion=answer.motion,
        shortest=answer.shortest,
        notes=(*answer.notes, note),
    )
