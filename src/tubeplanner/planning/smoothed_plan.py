"""The second stage of planning: the smoothest motion that takes hardly longer than the shortest."""

from dataclasses import replace
from functools import partial

from tubeplanner.constraints.effort_variation import effort_variation
from tubeplanner.outcome import Infeasible
from tubeplanner.planning.certified_motion import certified_motion
from tubeplanner.planning.jerk_note import largest_jerk
from tubeplanner.planning.plan_result import PlanResult
from tubeplanner.planning.timing import lengthened, no_longer
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.progress import PlanningClock, Progress, StoppedBy, until_stopped
from tubeplanner.refinement.phased_spline import PhasedSpline
from tubeplanner.refinement.smoothing import Smoothing
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

_STAGE = "smoothing"


def smoothed_plan(
    problem: PlanningProblem,
    shortest: PlanResult,
    spline: PhasedSpline,
    longest: float,
    clock: PlanningClock,
) -> PlanResult:
    """Return the smoothest motion within a duration; the shortest one where that fails.

    Args:
        problem: The planning problem.
        shortest: Refinement's answer, certified.
        spline: Where to start: that motion, or one near it on the knots that are wanted.
        longest: How long it may take [s].
        clock: The planning's.
    """
    found: PlanResult | None = None

    def work() -> None:
        nonlocal found
        found = _smoothed(problem, shortest, spline, longest, clock)

    _, stopped_by = until_stopped(work)
    stopped_by = stopped_by or (None if found is None else found.stopped_by)
    after = None if found is None else found.trajectory
    if found is None or after is None or not no_longer(after.duration, longest):
        note = f"the answer is the shortest motion, not smoothed: {_reason(found, stopped_by)}"
        return replace(shortest, stopped_by=stopped_by, notes=(*shortest.notes, note))
    assert shortest.trajectory is not None
    note = _note(problem, shortest.trajectory, after)
    return replace(
        found,
        stopped_by=stopped_by,
        notes=(*shortest.notes, note),
        sensitivities=shortest.sensitivities,
        motion=shortest.motion,
        shortest=shortest.trajectory,
    )


def _smoothed(
    problem: PlanningProblem,
    shortest: PlanResult,
    spline: PhasedSpline,
    longest: float,
    clock: PlanningClock,
) -> PlanResult | None:
    """Return the certified result of smoothing; None if it fails."""
    assert shortest.motion is not None
    assert shortest.certificate is not None
    clock.enter(_STAGE)

    def checkpoint(duration: float) -> None:
        clock.announce(Progress(_STAGE, best_duration=duration))
        clock.check()

    free = shortest.certificate.conditions["obstacles"].margin or 0.0
    try:
        smoothing = Smoothing(shortest.motion.problem, spline, longest, free, checkpoint)
        timed = partial(lengthened, duration=longest, period=problem.period)
        return certified_motion(problem, smoothing, smoothing.run, clock, timed=timed)
    except Infeasible:
        return None


def _reason(found: PlanResult | None, stopped_by: StoppedBy | None) -> str:
    if stopped_by is not None:
        return f"stopped by {stopped_by.replace('_', ' ')}"
    if found is None:
        return "no smoother one was found in the time that it may take"
    if found.duration is not None:
        return f"the smoother one takes {found.duration:.4f} s, more than it may"
    return f"the smoother one was not certified: {found.message}"


def _note(problem: PlanningProblem, before: JointTrajectory, after: JointTrajectory) -> str:
    """Return what smoothing has done, with the joints whose efforts swing most."""
    robot, longer = problem.robot, after.duration / before.duration - 1
    swings = [_largest_swing(robot, trajectory) for trajectory in (after, before)]
    jerks = [largest_jerk(robot, trajectory)[1] for trajectory in (after, before)]
    return (
        f"smoothed: the shortest motion takes {before.duration:.4f} s; in {100 * longer:.2f} % "
        f"more time, the effort that swings most moves through {swings[0]} instead of {swings[1]}, "
        f"and the largest jerk is {jerks[0]} instead of {jerks[1]}"
    )


def _largest_swing(robot: RobotModel, trajectory: JointTrajectory) -> str:
    variation = effort_variation(robot, trajectory)
    joint = int(variation.argmax())
    return f"{variation[joint]:.1f} limits ('{robot.joint_names[joint]}')"
