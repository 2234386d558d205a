"""The second stage of planning: the best motion, as the objective says, in a given duration."""

from dataclasses import replace
from functools import partial

from tubeplanner.outcome import Infeasible
from tubeplanner.planning.certified_motion import certified_motion
from tubeplanner.planning.gain_note import gain_note
from tubeplanner.planning.plan_result import PlanResult
from tubeplanner.planning.timing import lengthened, no_longer
from tubeplanner.problem.objective import SMOOTHNESS, Objective
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.progress import PlanningClock, Progress, StoppedBy, until_stopped
from tubeplanner.refinement.phased_spline import PhasedSpline
from tubeplanner.refinement.second_stage import SecondStage


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
