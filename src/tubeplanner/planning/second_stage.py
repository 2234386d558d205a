"""From the shortest motion to the written motion: periods, slack, smoothness, energy, deviation."""

from dataclasses import replace
from functools import partial
from math import ceil, floor

import numpy as np

from tubeplanner.certificate.verification import longest_duration
from tubeplanner.limits.peaks import EffortCosts, effort_variation
from tubeplanner.optimizer.phased_spline import DEGREE, PhasedSpline
from tubeplanner.optimizer.stages import Refinement, SecondStage
from tubeplanner.optimizer.starts import on_periodic_knots, slowed_beside_bands
from tubeplanner.outcome import (
    Infeasible,
    Location,
    PlanningClock,
    PlanStatus,
    Progress,
    until_stopped,
)
from tubeplanner.planning.refined_plan import certified_motion, entered
from tubeplanner.planning.result import PlanResult, certified_result
from tubeplanner.planning.steady_plans import steadiness_note
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.demands import DEVIATION, ENERGY, SMOOTHNESS, Objective
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.polynomials import REST_POINTS

# ---- Durations: longer than the shortest, and in a controller's periods.

_ROUNDING = 1e-9  # relative, and of a period


def no_longer(duration: float, longest: float) -> bool:
    """Return True if a duration is no longer than another, but for rounding."""
    return duration <= longest * (1 + _ROUNDING)


def fewest_periods(duration: float, period: float) -> int:
    """Return the least number of periods of at least a duration, and at least 1."""
    return max(ceil(duration / period - _ROUNDING), 1)


def most_periods(duration: float, period: float) -> int:
    """Return the largest number of periods within a duration."""
    return floor(duration / period + _ROUNDING)


def lengthened(
    trajectory: JointTrajectory, duration: float, period: float | None = None
) -> JointTrajectory:
    """Return a trajectory slowed to a duration [s]; a longer trajectory stays.

    Breakpoints are rounded to multiples of a period [s], which they are but for rounding errors.
    """
    if not no_longer(trajectory.duration, duration):
        return trajectory
    slower = trajectory.scaled(duration / trajectory.duration)
    if period is None:
        return slower
    breakpoints = np.round(slower.breakpoints / period) * period
    return JointTrajectory(slower.joint_names, breakpoints, slower.coefficients)


_DURATIONS = 50


def cheapest_duration(problem: PlanningProblem, shortest: JointTrajectory, longest: float) -> float:
    """Return the duration [s] in which the shortest motion, run slower, costs least.

    One of 50 evenly spaced durations up to the longest; the longest for smoothness and
    deviation. Slower motions need less effort for acceleration, but are held against gravity for
    longer.
    """
    objective = problem.objective or Objective()
    if objective.minimise in (SMOOTHNESS, DEVIATION):
        return longest
    costs = EffortCosts(problem.robot, shortest)
    durations = np.linspace(shortest.duration, longest, _DURATIONS).tolist()
    if objective.minimise == ENERGY:
        weights = objective.energy_weights(problem.robot)
        return float(min(reversed(durations), key=lambda each: costs.energy(weights, each)))
    return float(min(reversed(durations), key=costs.work))


# ---- Motions whose duration and breakpoints are multiples of a controller's period.

# Numbers of periods in turn, each with its own knots; of motions with speed bands, whose turns need
# knots that long periods do not have.
_MAX_TRIES, _MAX_STEADY_TRIES = 8, 2
# With fewer, all control points are at rest at an end, and none may move.
_MIN_PERIODS = 2 * REST_POINTS - DEGREE + 1


def periodic_plan(
    problem: PlanningProblem, shortest: PlanResult, period: float, clock: PlanningClock
) -> tuple[PlanResult, PhasedSpline] | None:
    """Return the shortest motion in whole periods, certified, and its spline; None if none is near.

    On knots at multiples of a period, the last motion is refined again: knots are fewer where the
    arm sets off, and switching times stay where they are.

    Raises:
        TimeLimitReached: Before there was a motion; likewise KeyboardInterrupt.
    """
    assert shortest.motion is not None and shortest.duration is not None
    inner, spline = shortest.motion.problem, shortest.motion.spline
    phases = len(spline.grid.fractions)
    count = max(fewest_periods(shortest.duration, period), phases, _MIN_PERIODS)
    for _ in range(_MAX_STEADY_TRIES if inner.tube.stretches else _MAX_TRIES):
        start = on_periodic_knots(spline, count)
        refinement = Refinement(inner, start, None, entered(start.grid.interval_count, clock))
        in_periods = partial(lengthened, duration=count * period, period=period)
        try:
            result = certified_motion(problem, refinement, clock, timed=in_periods)
        except Infeasible:
            result = None
        if result is None or result.duration is None:
            count += 1
            continue
        if no_longer(result.duration, count * period):
            periodic = replace(
                result,
                notes=shortest.notes,
                sensitivities=shortest.sensitivities,
                motion=shortest.motion,
            )
            return periodic, refinement.spline
        count = max(count + 1, fewest_periods(result.duration, period))
    return None


def second_stage_plan(
    problem: PlanningProblem,
    shortest: PlanResult,
    spline: PhasedSpline,
    longest: float,
    clock: PlanningClock,
) -> PlanResult:
    """Return the best motion in a duration [s], by the objective; the shortest where that fails.

    The spline is the start: the shortest motion's, or one near it on other knots.
    """
    work = partial(_certified, problem, shortest, spline, longest, clock)
    result, stopped_by = until_stopped(work)
    stopped_by = stopped_by or (None if result is None else result.stopped_by)
    after = None if result is None else result.trajectory
    if result is None or after is None or not no_longer(after.duration, longest):
        objective = problem.objective or Objective()
        names = {SMOOTHNESS: "smoothed", DEVIATION: "nearer to the reference"}
        done = names.get(objective.minimise, "changed to save anything")
        if stopped_by is not None:
            reason = f"stopped by {stopped_by.replace('_', ' ')}"
        elif result is None:
            reason = f"no better motion was found within {longest:.4f} s"
        elif result.duration is not None:
            reason = f"the better motion takes {result.duration:.4f} s, more than {longest:.4f} s"
        else:
            reason = f"the better motion was not certified: {result.message}"
        note = f"the answer is the shortest motion, not {done}: {reason}"
        return replace(shortest, stopped_by=stopped_by, notes=(*shortest.notes, note))
    assert shortest.trajectory is not None
    note = gain_note(problem, shortest.trajectory, after)
    return replace(
        result,
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
    """Return the certified result of the second stage; None on failure."""
    assert shortest.motion is not None and shortest.certificate is not None
    objective = problem.objective or Objective()
    names = {SMOOTHNESS: "smoothing", DEVIATION: "reducing the deviation"}
    name = names.get(objective.minimise, f"saving {objective.minimise}")
    clock.enter(name)

    def checkpoint(duration: float) -> None:
        clock.announce(Progress(name, best_duration=duration))
        clock.check()

    free = shortest.certificate.conditions["obstacles"].margin or 0.0
    try:
        stage = SecondStage(shortest.motion.problem, spline, longest, free, checkpoint)
        timed = partial(lengthened, duration=longest, period=problem.period)
        return certified_motion(problem, stage, clock, timed=timed)
    except Infeasible:
        return None


def followed_plan(
    problem: PlanningProblem, shortest: PlanResult, slack: float | None, clock: PlanningClock
) -> PlanResult:
    """Return the motion that is written: in time, in whole periods, and best by the objective.

    Without a slack, it is the slack or the duration of the problem's objective. The answer itself
    if it is not refinement's, or planning was stopped early, but for whole periods and a duration
    that is asked for. Status no_trajectory if that is too short.
    """
    problem, objective = problem.joined, problem.objective or Objective()
    duration = objective.duration if slack is None else None
    slack = objective.slack if slack is None else slack
    result = _followed(problem, shortest, slack or 0.0, duration, clock)
    if duration is not None:
        result = _in_duration(problem, result, duration)
    if result.trajectory is None:
        return result
    notes = (*result.notes, *steadiness_note(problem, result.trajectory))
    result = replace(result, notes=notes)
    if result.motion is None or result.shortest is not None:
        return result
    assert result.trajectory is not None
    return replace(result, notes=(*notes, *jerk_note(problem.robot, result.trajectory)))


def _followed(
    problem: PlanningProblem,
    shortest: PlanResult,
    slack: float,
    duration: float | None,
    clock: PlanningClock,
) -> PlanResult:
    """Return the best motion by the objective, in whole periods; segments are joined."""
    period = problem.period
    if shortest.motion is None or shortest.trajectory is None or shortest.stopped_by is not None:
        return shortest if period is None else _in_whole_periods(problem, shortest, period)
    spline = shortest.motion.spline
    if period is None:
        longest = _longest(problem, shortest, slack, duration)
        if longest is None:
            return shortest
        spline = slowed_beside_bands(problem, spline, longest / shortest.trajectory.duration)
        return second_stage_plan(problem, shortest, spline, longest, clock)
    plan, stopped_by = until_stopped(lambda: periodic_plan(problem, shortest, period, clock))
    if plan is None:
        return replace(_in_whole_periods(problem, shortest, period), stopped_by=stopped_by)
    periodic, spline = plan
    longest = _longest(problem, periodic, slack, duration)
    if longest is None or periodic.stopped_by is not None or periodic.duration is None:
        return periodic
    count = max(most_periods(longest, period), fewest_periods(periodic.duration, period))
    spline = slowed_beside_bands(problem, spline, count * period / periodic.duration)
    spline = on_periodic_knots(spline, count)
    return second_stage_plan(problem, periodic, spline, count * period, clock)


def _longest(
    problem: PlanningProblem, shortest: PlanResult, slack: float, duration: float | None
) -> float | None:
    """Return the duration for the second stage [s]; None: there is no time."""
    assert shortest.trajectory is not None
    if duration is not None:
        return duration if no_longer(shortest.trajectory.duration, duration) else None
    if not slack:
        return None
    longest = shortest.trajectory.duration * (1 + slack)
    return cheapest_duration(problem, shortest.trajectory, longest)


def _in_duration(problem: PlanningProblem, answer: PlanResult, duration: float) -> PlanResult:
    """Return an answer in the objective's exact duration [s], or a refusal if too short."""
    if answer.trajectory is None or answer.duration is None:
        return answer
    if not no_longer(answer.duration, duration):
        # Rounded upwards; multiples of a period are as they are.
        least = answer.duration if problem.period else ceil(1e4 * answer.duration) / 1e4
        return replace(
            answer,
            status=PlanStatus.NO_TRAJECTORY,
            message=f"objective.duration is {duration:g} s, but the shortest motion that was found "
            f"takes {answer.duration:.6g} s; give {least:.6g} s or more, or a slack instead",
            location=Location(),
            trajectory=None,
            shortest=answer.trajectory,
            notes=(),
        )
    if no_longer(duration, answer.duration):
        return answer
    longest = longest_duration(problem, answer.trajectory)
    if not no_longer(duration, longest):
        return replace(
            answer,
            status=PlanStatus.NO_TRAJECTORY,
            message=f"objective.duration is {duration:g} s; no motion in it was found that keeps "
            "the bands of tube.tool_speed, and the one that was found keeps them, run slower, up "
            f"to {longest:.6g} s; give {answer.duration:.6g} to {longest:.6g} s, or wider bands",
            location=Location(),
            trajectory=None,
            shortest=answer.trajectory,
            notes=(),
        )
    note = f"the motion is run slower, to last the required {duration:g} s"
    slower = _run_in(problem, answer, duration, note)
    return replace(slower, shortest=answer.shortest or answer.trajectory)


def _in_whole_periods(problem: PlanningProblem, shortest: PlanResult, period: float) -> PlanResult:
    """Return an answer slowed to a whole number of periods; its breakpoints are no multiples.

    Slower motions keep all limits that faster motions keep, unless the arm swings through
    configurations that its motors cannot hold; then the answer stays as it is.
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
    result = certified_result(problem, slower, answer.method, PlanningClock(None, None))
    return replace(
        result,
        search=answer.search,
        phase_two=answer.phase_two,
        stopped_by=answer.stopped_by,
        sensitivities=answer.sensitivities,
        motion=answer.motion,
        shortest=answer.shortest,
        notes=(*answer.notes, note),
    )


# ---- The largest jerk, and the gain of the second stage.


def largest_jerk(
    robot: RobotModel, trajectory: JointTrajectory, *, unlimited: bool = False
) -> tuple[float, str]:
    """Return a cubic's largest jerk [rad/s^3 or m/s^3], and its message with the joint.

    Of all joints, or only of those without limits of jerk and effort rate.
    """
    peak = abs(trajectory.derivative_coefficients(3)).max(axis=(0, 1))
    if unlimited:
        limit = np.minimum(robot.limits.jerk, robot.limits.effort_rate)
        peak = np.where(np.isfinite(limit), 0.0, peak)
    joint = int(peak.argmax())
    unit = "rad/s^3" if robot.revolute[joint] else "m/s^3"
    return float(peak[joint]), f"{peak[joint]:.2g} {unit} ('{robot.joint_names[joint]}')"


def jerk_note(robot: RobotModel, trajectory: JointTrajectory) -> tuple[str, ...]:
    """Return a note on a cubic's jerk, if some joint has no limit of jerk or effort rate."""
    peak, words = largest_jerk(robot, trajectory, unlimited=True)
    if not peak > 0:
        return ()
    return (
        "without a jerk limit, the shortest motion's jerk grows with the square of the number of "
        f"knots ({len(trajectory.widths)}): here up to {words}",
    )


_LOOKS = 2000  # instants of a motion whose deviations count


def _deviations(problem: PlanningProblem, trajectory: JointTrajectory) -> tuple[float, float]:
    """Return the root mean square distance from the nearest segment, in radii and in m."""
    tube = problem.tube
    q = trajectory.position(np.linspace(0.0, trajectory.duration, _LOOKS))
    tool = tube.tool_pose(problem.robot, q)[1]
    distance = tube.distance(tool)
    radii = np.linalg.norm(tube.regions.deviation(tool, distance.argmin(axis=1))[0], axis=1)
    mean_squares = (radii**2).mean(), (distance.min(axis=1) ** 2).mean()
    return float(np.sqrt(mean_squares[0])), float(np.sqrt(mean_squares[1]))


def gain_note(problem: PlanningProblem, before: JointTrajectory, after: JointTrajectory) -> str:
    """Return the note on the second stage's gain by the objective, from the shortest motion."""
    objective, robot = problem.objective or Objective(), problem.robot
    if objective.minimise == SMOOTHNESS:
        done = "smoothed"
        jerks = [largest_jerk(robot, trajectory)[1] for trajectory in (after, before)]
        gain = f"largest jerk {jerks[0]}"
        gain += "" if jerks[0] == jerks[1] else f" instead of {jerks[1]}"
        if effort_variation(robot, before, before).any():  # none: the links have no masses
            swings = []
            for trajectory in (after, before):
                variation = effort_variation(robot, trajectory, before)
                joint = int(variation.argmax())
                is_limited = bool(np.isfinite(robot.limits.effort[joint]))
                unit = "limits" if is_limited else "times the largest effort of the shortest motion"
                swings.append(f"{variation[joint]:.1f} {unit} ('{robot.joint_names[joint]}')")
            gain = f"largest effort swing {swings[0]} instead of {swings[1]}, {gain}"
    elif objective.minimise == DEVIATION:
        (radii, size), (old_radii, old_size) = (
            _deviations(problem, trajectory) for trajectory in (after, before)
        )
        gain = f"rms distance from the reference {radii:.2g} instead of {old_radii:.2g} radii"
        gain += f", {1000 * size:.3g} instead of {1000 * old_size:.3g} mm"
        done = "deviation reduced" if radii < old_radii else "deviation not reduced"
    else:
        costs = [EffortCosts(robot, trajectory) for trajectory in (after, before)]
        if objective.minimise == ENERGY:
            weights = objective.energy_weights(robot)
            values = [cost.energy(weights) for cost in costs]
            unit = "with the given weights" if objective.weights else "limits^2 s"
            what = "integral of the squared efforts"
        else:
            values, unit, what = [cost.work() for cost in costs], "J", "work of the motors"
        is_less = values[0] < values[1]
        gain = f"{what} {values[0]:.4g} instead of {values[1]:.4g} {unit}"
        if not any(values):
            is_less, gain = False, f"{what} zero, as the links have no masses"
        done = f"{objective.minimise} {'saved' if is_less else 'not saved'}"
    takes, least = f"{after.duration:.4f} s", f"{before.duration:.4f} s"
    times = f"{takes}, as long as the shortest"
    if takes != least:
        times = f"{takes}; the shortest is {least} (--slack 0)"
    return f"{done}: {times}; {gain}"
