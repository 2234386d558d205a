"""Plan and plan_cycle: the shortest motion of every leg, then the written and certified one."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from tubeplanner.certificate.verification import judged_visits, verify_cycle
from tubeplanner.checks import checked_options
from tubeplanner.errors import OptionError
from tubeplanner.limits.lower_bound import lower_bound
from tubeplanner.optimizer.starts import RefinedMotion
from tubeplanner.outcome import (
    Location,
    PlanningClock,
    PlanStatus,
    ProgressCallback,
    StoppedBy,
    until_stopped,
)
from tubeplanner.planning.attempts import attempted_plan
from tubeplanner.planning.legs import of_poses, shared_plan, shortest_legs
from tubeplanner.planning.options import (
    BRANCH_AND_BOUND,
    QUALITIES,
    REFINEMENT,
    STOP_AT_CORNERS,
    SUH_BISHOP,
    PlanOptions,
)
from tubeplanner.planning.result import (
    BlockedLeg,
    CycleResult,
    LegPlan,
    PlanResult,
    cycle_sensitivities,
    with_diagnosis,
)
from tubeplanner.planning.second_stage import followed_plan
from tubeplanner.robot.notes import robot_notes
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.demands import SMOOTHNESS, Objective
from tubeplanner.task.info import cycle_doubts, problem_doubts
from tubeplanner.task.legs import Leg
from tubeplanner.task.motion import LegMotion, cycle_motion
from tubeplanner.task.problem import PlanningProblem


class Planner:
    """Plans a problem, and plans changed problems from the last motion.

    The last certified motion of refinement is remembered. A changed problem with the same joints
    and segments begins with it, on the finest knots: that takes about half the processor time.
    After small changes durations were within 0.3 % of a fresh plan's wherever that was tried; like
    refinement itself, replanning finds the best motion near its start.
    """

    def __init__(self, problem: PlanningProblem, options: PlanOptions | None = None) -> None:
        """Keep a problem and options.

        Args:
            problem: The planning problem.
            options: Options of all plans.

        Raises:
            ProblemError: The problem is no `PlanningProblem`.
            OptionError: A slack or robustness is asked for that the method does not honour, or
                robustness without MuJoCo.
            RobotError: Robustness is asked for, and joints of the robot follow others.
        """
        PlanningProblem.require(problem)
        self._problem, self._options = problem, checked_options(options, PlanOptions)
        require_supported(problem, self._options)
        self._last: RefinedMotion | None = None

    def __repr__(self) -> str:
        state = "nothing planned yet" if self._last is None else "a motion remembered"
        return f"<Planner of {self._problem.name}: {self._options.method}, {state}>"

    def plan(self, progress: ProgressCallback | None = None) -> PlanResult:
        """Plan and certify a trajectory afresh, as `tubeplanner.plan` does.

        Args:
            progress: As of `tubeplanner.plan`.

        Raises:
            KeyboardInterrupt: Ctrl-C before anything was certified.
        """
        return self._answer(None, progress)

    def replan(
        self, problem: PlanningProblem, progress: ProgressCallback | None = None
    ) -> PlanResult:
        """Plan a changed problem from the last motion, or afresh where that leads to no answer.

        Afresh too: before the first motion, with other joints or segments, with quality "best" or
        other methods than refinement.

        Args:
            problem: The changed problem: another radius, start, goal, obstacle, payload or limit.
                Made from the former problem by `dataclasses.replace` or `with_tube`, it shares
                unchanged parts.
            progress: As of `plan`.

        Returns:
            As `plan`; with a note if it was planned from the last motion.

        Raises:
            ProblemError: The problem is no `PlanningProblem`.
            KeyboardInterrupt: Ctrl-C before anything was certified.
        """
        PlanningProblem.require(problem)
        require_supported(problem, self._options)
        self._problem = problem
        every_start = QUALITIES[self._options.quality].every_start
        return self._answer(None if every_start else self._last, progress)

    def _answer(self, last: RefinedMotion | None, progress: ProgressCallback | None) -> PlanResult:
        """Return the answer, from the last motion if given, and remember the answer's motion."""
        options = self._options
        clock = PlanningClock(options.time_limit, progress)
        task, doubts = self._problem, problem_doubts(self._problem)
        try:
            (shortest,) = shortest_legs(task, options, clock, last)
        except BlockedLeg as blocked:
            refused = with_diagnosis(blocked.result)
            return replace(refused, notes=(*doubts, *robot_notes(task.robot)))
        if shortest.result.stopped_by is None:  # else it may have ended on coarse knots
            self._last = shortest.result.motion or self._last
        result, problem = _written(shortest, options, clock), shortest.problem
        notes = (*robot_notes(problem.robot), *problem.tube.notes, *doubts, *result.notes)
        result = with_diagnosis(of_poses(task, result))
        bound = lower_bound(task) if result.succeeded else None
        notes = tuple(dict.fromkeys(notes))
        return replace(result, bound=bound, planning_time=clock.elapsed, notes=notes)


def _written(shortest: LegPlan, options: PlanOptions, clock: PlanningClock) -> PlanResult:
    """Return the written motion of a leg: robust, in whole periods, best by the objective."""
    problem, follow = shortest.problem, partial(followed_plan, slack=options.slack, clock=clock)
    if options.robust and problem.robustness is not None:
        from tubeplanner.planning.robust_plan import robust_plan

        again = partial(attempted_plan, options=options, clock=clock)
        return robust_plan(problem.joined, shortest.result, again, follow, clock)
    return follow(problem, shortest.result)


def require_supported(problem: PlanningProblem, options: PlanOptions) -> None:
    """Check that the method honours slack and robustness, and that MuJoCo can simulate the latter.

    Raises:
        OptionError: The method does not honour them, or a route; or robustness without MuJoCo.
        RobotError: Robustness is asked for, and joints of the robot follow others.
    """
    is_robust = options.robust and problem.robustness is not None
    if is_robust:
        from tubeplanner.execution.mujoco_model import require_mujoco, require_no_followers

        require_mujoco("the field robustness")
        require_no_followers(problem.robot)
    if problem.tube.stretches and options.method != REFINEMENT:
        raise OptionError(
            f"method '{options.method}' keeps no bands of tube.tool_speed: it plans rests or slow "
            f"ways; give method '{REFINEMENT}', or tool_speed without bands"
        )
    has_points = problem.tube.route is None and not problem.has_free_tool
    if not has_points and options.method in (BRANCH_AND_BOUND, SUH_BISHOP):
        why = "the tool may be anywhere" if problem.tube.route is None else "tube.route is given"
        raise OptionError(
            f"method '{options.method}' follows reference points, and there are none: {why}; "
            f"give method '{REFINEMENT}' or '{STOP_AT_CORNERS}'"
        )
    if options.method == REFINEMENT:
        return
    if is_robust:
        raise OptionError(
            f"the problem has a field robustness, which method '{options.method}' does not "
            f"support; leave it out (--set robustness=null), or give method '{REFINEMENT}'"
        )
    slack, duration = options.slack, None
    if slack is None and problem.objective is not None:
        slack, duration = problem.objective.slack, problem.objective.duration
    if slack or duration is not None:
        request = f"slack is {slack:g}" if slack else f"objective.duration is {duration:g} s"
        raise OptionError(
            f"{request}, but method '{options.method}' makes nothing smoother and saves nothing; "
            f"give slack 0, or method '{REFINEMENT}'"
        )


def plan(
    problem: PlanningProblem,
    options: PlanOptions | None = None,
    progress: ProgressCallback | None = None,
) -> PlanResult:
    """Plan and certify a trajectory.

    Args:
        problem: The planning problem.
        options: Options of planning.
        progress: Called as each stage begins, and many times during the search.

    Returns:
        A result whose status is success only if the certificate passed; else its message and place
        give the obstruction. Ctrl-C ends the search with the best so far.

    Raises:
        ProblemError: The problem is no `PlanningProblem`.
        OptionError: A slack or robustness is asked for that the method does not honour, or
            robustness without MuJoCo.
        RobotError: Robustness is asked for, and joints of the robot follow others.
        KeyboardInterrupt: Ctrl-C before anything was certified.
    """
    return Planner(problem, options).plan(progress)


# ---- Cycles: the legs by the same driver, then one motion of all.

_SAMPLES = 200


def plan_cycle(
    cycle: Cycle,
    options: PlanOptions | None = None,
    progress: ProgressCallback | None = None,
    *,
    shares_configurations: bool = True,
) -> CycleResult:
    """Plan and certify the motion of a whole cycle.

    Moves are planned alone, in order, each from the end of the last one. Then the configurations
    between moves, where a move ends openly, are chosen for the least sum of durations.

    Args:
        cycle: The cycle.
        options: Options of planning for every move; the time limit is that of the whole.
        progress: As of `plan`.
        shares_configurations: False: moves stay as they were planned alone.

    Returns:
        A result whose status is success only if the certificate passed; else its message and place
        name the move and the obstruction.

    Raises:
        OptionError: A slack is asked for that the method does not honour.
        ProblemError: The cycle is no `Cycle`, or a move cannot begin at the end of the last one.
        KeyboardInterrupt: Ctrl-C before all moves were certified.
    """
    Cycle.require(cycle)
    options = checked_options(options, PlanOptions)
    for k in range(len(cycle.legs)):
        require_supported(cycle.problem_from_anywhere(k), options)
    clock, doubts = PlanningClock(options.time_limit, progress), cycle_doubts(cycle)
    try:
        greedy = shortest_legs(cycle, options, clock)
        shared, stopped_by = None, _stop_of(greedy)
        if shares_configurations and stopped_by is None:
            shared, stopped_by = until_stopped(partial(shared_plan, cycle, greedy, options, clock))
        for plans in [shared, greedy] if shared else [greedy]:
            result = _cycle_result(cycle, plans, greedy, options, clock, stopped_by)
            if result.succeeded:
                break
    except BlockedLeg as blocked:
        result = _blocked(cycle, blocked, options, clock)
    bound = lower_bound(cycle) if result.succeeded else None
    return replace(result, bound=bound, notes=(*doubts, *result.notes))


def _cycle_result(
    cycle: Cycle,
    shortest: Sequence[LegPlan],
    greedy: Sequence[LegPlan],
    options: PlanOptions,
    clock: PlanningClock,
    stopped_by: StoppedBy | None,
) -> CycleResult:
    """Return the result of all legs from their shortest motions, judged as a single motion."""
    if stopped_by is not None:  # then motions stay as they are, but for whole periods
        shortest = [
            replace(plan, result=replace(plan.result, stopped_by=stopped_by)) for plan in shortest
        ]
    plans: list[LegPlan] = []
    for k, plan in enumerate(shortest):
        problem = replace(plan.problem, start=plan.begin, goal=plan.end)
        with clock.within(cycle.label(k)):
            written = LegPlan(problem, _written(plan.between(problem), options, clock))
        if not written.result.succeeded:
            return _blocked(cycle, BlockedLeg(k, written.result), options, clock)
        plans.append(written)
    legs = zip(cycle.legs, plans, strict=True)
    motion = cycle_motion(cycle, [leg_motion(leg, plan) for leg, plan in legs])
    moves = sum(len(leg.moves) for leg in cycle.legs)
    moving = sum(end - begin for begin, end in motion.leg_times)
    begin = clock.elapsed
    certificate = verify_cycle(cycle, motion)
    dwells = motion.trajectory.duration - sum(plan.duration for plan in plans)
    result = CycleResult(
        PlanStatus.SUCCESS,
        f"certified cycle of {motion.trajectory.duration:.4f} s: {moves} move{'s' * (moves > 1)} "
        f"in {moving:.4f} s, {motion.trajectory.duration - moving:.4g} s at rest",
        Location(),
        options.method,
        motion,
        certificate,
        tuple(plans),
        greedy_duration=dwells + sum(plan.duration for plan in greedy),
        planning_time=clock.elapsed,
        certificate_time=clock.elapsed - begin,
        stopped_by=stopped_by or _stop_of(plans),
        sensitivities=cycle_sensitivities(cycle, plans),
        notes=_notes(cycle, shortest, plans),
    )
    if certificate.passed:
        return result
    worst = certificate.failures()[0]
    return replace(
        result,
        status=PlanStatus.CERTIFICATE_FAILED,
        message=f"the certificate of the whole fails: {certificate.describe(worst)}",
        motion=None,
    )


def leg_motion(leg: Leg, plan: LegPlan) -> LegMotion:
    """Return the motion of a leg's successful plan, with the times at which its moves begin."""
    trajectory = plan.result.trajectory
    assert trajectory is not None
    problem, numbers = plan.problem, plan.problem.joined.tube.numbers
    begins: list[float] = []
    for first in leg.first_segments[1:]:
        visits = judged_visits(problem, trajectory)
        k = int(np.searchsorted(numbers, first))
        if numbers[k] == first:
            begins.append(next(visit.begin for visit in visits if visit.segment >= k))
            continue
        # Segments on one line are joined: the sample nearest to the segment's first point counts.
        inside = [visit for visit in visits if visit.segment == k - 1]
        times = np.linspace(inside[0].begin, inside[-1].end, _SAMPLES)
        tool = problem.robot.tool_position(trajectory.position(times))
        point = problem.tube.points[np.searchsorted(problem.tube.numbers, first)]
        begins.append(float(times[np.linalg.norm(tool - point, axis=1).argmin()]))
    return LegMotion(trajectory, tuple(begins))


def _blocked(
    cycle: Cycle, blocked: BlockedLeg, options: PlanOptions, clock: PlanningClock
) -> CycleResult:
    """Return the result that a leg has no answer.

    Raises:
        KeyboardInterrupt: Ctrl-C stopped the leg's planning.
    """
    result, leg = with_diagnosis(blocked.result), cycle.legs[blocked.leg]
    if result.status is PlanStatus.INTERRUPTED:
        raise KeyboardInterrupt
    where = cycle.label(blocked.leg)
    if len(leg.moves) > 1:
        where += " (segments are counted over all of them)"
    return CycleResult(
        result.status,
        f"{where}: {result.message}",
        leg.in_cycle(result.location, 0.0),
        options.method,
        planning_time=clock.elapsed,
        stopped_by=result.stopped_by,
        notes=result.notes,
        proved=result.proved,
        starts_tried=result.starts_tried,
    )


def _stop_of(plans: Sequence[LegPlan]) -> StoppedBy | None:
    """Return the cause of the first early stop of the legs' planning, or None."""
    return next((each for plan in plans if (each := plan.result.stopped_by) is not None), None)


def _notes(cycle: Cycle, shortest: Sequence[LegPlan], plans: Sequence[LegPlan]) -> tuple[str, ...]:
    """Return the notes on the written legs; a note of several legs once."""
    names_by_note: dict[str, list[str]] = {}
    for leg, plan, written in zip(cycle.legs, shortest, plans, strict=True):
        problem = plan.problem
        own = (*robot_notes(problem.robot), *problem.tube.notes, *plan.result.notes)
        if (survival := written.result.survival) is not None:
            own = (*own, survival.seen, *survival.notes)
        for note in dict.fromkeys(own):
            names_by_note.setdefault(note, []).append(leg.name)
    notes = [
        note if len(names) == len(cycle.legs) else f"move {', '.join(names)}: {note}"
        for note, names in names_by_note.items()
    ]
    if any(p.duration > s.duration for s, p in zip(shortest, plans, strict=True)):
        objectives = {(each.problem.objective or Objective()).minimise for each in plans}
        done, how = "better by the objective", " (--slack 0)"
        if any(each.result.survival for each in plans):
            done, how = "robust", ""
        elif objectives == {SMOOTHNESS}:
            done = "smoothed"
        least, total = sum(p.duration for p in shortest), sum(p.duration for p in plans)
        notes.append(f"{done}: moves of {total:.4f} s; the shortest are {least:.4f} s{how}")
    return tuple(notes)
