"""From the shortest motion to a followable one: periods, slack, smoothness, energy."""

from dataclasses import replace
from functools import partial
from math import ceil, floor

import numpy as np

from tubeplanner.limits.motor_costs import EffortCosts
from tubeplanner.optimizer.phased_spline import DEGREE, PhasedSpline
from tubeplanner.optimizer.stages import Refinement, SecondStage
from tubeplanner.optimizer.starts import on_periodic_knots
from tubeplanner.outcome import (
    Infeasible,
    Place,
    PlanningClock,
    PlanStatus,
    Progress,
    StoppedBy,
    until_stopped,
)
from tubeplanner.planning.notes import gain_note, jerk_note
from tubeplanner.planning.refined_plan import certified_motion, entered
from tubeplanner.planning.result import PlanResult, certified_result
from tubeplanner.task.demands import ENERGY, SMOOTHNESS, Objective
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.polynomials import REST_POINTS

# ---- How long a motion takes: longer than it must, and in a controller's periods.

_ROUNDING = 1e-9  # relative, and of a period


def no_longer(duration: float, longest: float) -> bool:
    """Return whether a duration is no longer than another, but for rounding."""
    return duration <= longest * (1 + _ROUNDING)


def fewest_periods(duration: float, period: float) -> int:
    """Return the number of periods that a motion needs."""
    return max(ceil(duration / period - _ROUNDING), 1)


def most_periods(duration: float, period: float) -> int:
    """Return the number of periods that fit into a duration."""
    return floor(duration / period + _ROUNDING)


def lengthened(
    trajectory: JointTrajectory, duration: float, period: float | None = None
) -> JointTrajectory:
    """Return a trajectory run in a duration [s], unless it takes longer.

    Args:
        trajectory: The trajectory.
        duration: What it is to take.
        period: Its breakpoints are multiples of this, but for rounding, which is taken away; None:
            they are not.
    """
    if not no_longer(trajectory.duration, duration):
        return trajectory
    slower = trajectory.scaled(duration / trajectory.duration)
    if period is None:
        return slower
    breakpoints = np.round(slower.breakpoints / period) * period
    return JointTrajectory(slower.joint_names, breakpoints, slower.coefficients)


# ---- How much of the time that a motion may take is of use to its objective.

_TRIED = 50


def cheapest_duration(problem: PlanningProblem, shortest: JointTrajectory, longest: float) -> float:
    """Return in which duration the shortest motion, run slower, costs least [s].

    Slower motions take less to be accelerated, but are held against gravity for longer.

    Args:
        problem: The planning problem, whose objective says what counts.
        shortest: Its shortest motion.
        longest: How long it may take [s].

    Returns:
        One of 50 evenly spaced durations; the longest for smoothness.
    """
    objective = problem.objective or Objective()
    if objective.minimise == SMOOTHNESS:
        return longest
    costs = EffortCosts(problem.robot, shortest)
    tried = np.linspace(shortest.duration, longest, _TRIED).tolist()
    if objective.minimise == ENERGY:
        weights = objective.energy_weights(problem.robot)
        return float(min(reversed(tried), key=lambda duration: costs.energy(weights, duration)))
    return float(min(reversed(tried), key=costs.work))


# ---- Motions whose duration and breakpoints are multiples of a controller's period.

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


# ---- The second stage of planning: the best motion, as the objective says, in a given duration.


def second_stage_plan(
    problem: PlanningProblem,
    shortest: PlanResult,
    spline: PhasedSpline,
    longest: float,
    clock: PlanningClock,
) -> PlanResult:
    """Return the best motion in a duration; the shortest one where that fails.

    Args:
        problem: The planning problem.
        shortest: Refinement's answer, certified.
        spline: Where to start: that motion, or one near it on the knots that are wanted.
        longest: How long it is to take [s].
        clock: The planning's.
    """
    found: PlanResult | None = None

    def work() -> None:
        nonlocal found
        found = _certified(problem, shortest, spline, longest, clock)

    _, stopped_by = until_stopped(work)
    stopped_by = stopped_by or (None if found is None else found.stopped_by)
    after = None if found is None else found.trajectory
    if found is None or after is None or not no_longer(after.duration, longest):
        done = "smoothed" if _is_smoothing(problem) else "changed to save anything"
        note = f"the answer is the shortest motion, not {done}: {_reason(found, stopped_by)}"
        return replace(shortest, stopped_by=stopped_by, notes=(*shortest.notes, note))
    assert shortest.trajectory is not None
    note = gain_note(problem, shortest.trajectory, after)
    return replace(
        found,
        stopped_by=stopped_by,
        notes=(*shortest.notes, note),
        sensitivities=shortest.sensitivities,
        motion=shortest.motion,
        shortest=shortest.trajectory,
    )


def _certified(
    problem: PlanningProblem,
    shortest: PlanResult,
    spline: PhasedSpline,
    longest: float,
    clock: PlanningClock,
) -> PlanResult | None:
    """Return the certified result of the second stage; None if it fails."""
    assert shortest.motion is not None
    assert shortest.certificate is not None
    name = _stage_name(problem)
    clock.enter(name)

    def checkpoint(duration: float) -> None:
        clock.announce(Progress(name, best_duration=duration))
        clock.check()

    free = shortest.certificate.conditions["obstacles"].margin or 0.0
    try:
        stage = SecondStage(shortest.motion.problem, spline, longest, free, checkpoint)
        timed = partial(lengthened, duration=longest, period=problem.period)
        return certified_motion(problem, stage, stage.run, clock, timed=timed)
    except Infeasible:
        return None


def _reason(found: PlanResult | None, stopped_by: StoppedBy | None) -> str:
    if stopped_by is not None:
        return f"stopped by {stopped_by.replace('_', ' ')}"
    if found is None:
        return "no better one was found in the time that it may take"
    if found.duration is not None:
        return f"the better one takes {found.duration:.4f} s, more than it may"
    return f"the better one was not certified: {found.message}"


def _is_smoothing(problem: PlanningProblem) -> bool:
    return (problem.objective or Objective()).minimise == SMOOTHNESS


def _stage_name(problem: PlanningProblem) -> str:
    objective = problem.objective or Objective()
    return "smoothing" if _is_smoothing(problem) else f"saving {objective.minimise}"


# ---- From the shortest motion to one that a machine can follow: in its periods, smooth or thrifty.


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
