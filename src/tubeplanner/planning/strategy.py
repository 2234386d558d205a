"""Planner and `plan`: configurations of poses, attempts, and the written motion."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from tubeplanner.checks import checked_options
from tubeplanner.errors import OptionError
from tubeplanner.execution.mujoco_model import require_mujoco, require_no_followers
from tubeplanner.first_guess.branches import configured_ends, is_continued, least_time, other_ends
from tubeplanner.optimizer.starts import RefinedMotion
from tubeplanner.outcome import (
    Infeasible,
    PlanningClock,
    PlanStatus,
    ProgressCallback,
    StoppedBy,
    until_stopped,
)
from tubeplanner.planning.attempts import attempted_plan
from tubeplanner.planning.necessary_conditions import require_within_bound
from tubeplanner.planning.options import QUALITIES, REFINEMENT, PlanOptions
from tubeplanner.planning.result import PlanResult, refused_result, stopped_result, with_diagnosis
from tubeplanner.planning.robust_plan import robust_plan
from tubeplanner.planning.second_stage import followed_plan
from tubeplanner.robot.notes import robot_notes
from tubeplanner.task.info import problem_doubts
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
        doubts = problem_doubts(self._problem)
        try:
            problem, result = _fastest(self._problem, options, clock, last)
        except Infeasible as reason:
            refused = with_diagnosis(refused_result(reason, options.method))
            return replace(refused, notes=(*doubts, *robot_notes(self._problem.robot)))
        if result.stopped_by is None:  # else it may have ended on coarse knots
            self._last = result.motion or self._last
        follow = partial(followed_plan, slack=options.slack, clock=clock)
        if options.robust and problem.robustness is not None:
            again = partial(attempted_plan, options=options, clock=clock)
            result = robust_plan(problem.joined, result, again, follow, clock)
        else:
            result = follow(problem, result)
        robot = robot_notes(problem.robot)
        notes = (*robot, *problem.tube.notes, *doubts, *result.notes)
        result = with_diagnosis(_of_poses(self._problem, result))
        return replace(result, planning_time=clock.elapsed, notes=tuple(dict.fromkeys(notes)))


def shortest_plan(
    problem: PlanningProblem, options: PlanOptions, clock: PlanningClock
) -> PlanResult:
    """Return the shortest motion, without period, slack and robustness.

    Of several configurations of a pose, the first one that leads to an answer: a move after it is
    to go on from there.

    Args:
        problem: The planning problem.
        options: Options of planning; the time limit is the clock's.
        clock: The planning's.

    Raises:
        KeyboardInterrupt: Ctrl-C before anything was certified.
    """
    try:
        _, result = _fastest(problem, options, clock, None, takes_first=True)
    except Infeasible as reason:
        return refused_result(reason, options.method)
    return _of_poses(problem, result)


def _fastest(
    problem: PlanningProblem,
    options: PlanOptions,
    clock: PlanningClock,
    last: RefinedMotion | None,
    *,
    takes_first: bool = False,
) -> tuple[PlanningProblem, PlanResult]:
    """Return the problem between the configurations with the fastest motion, and its result.

    Each of the configurations of poses from which a branch leads along the tube is planned, but for
    those whose joints need longer than the fastest motion takes; the others where these have no
    answer. One after the other: the answer does not depend on timing.

    Args:
        problem: The planning problem.
        options: Without `persistent`, the first configuration with an answer is taken.
        clock: The planning's.
        last: The motion to begin with: the first configuration with an answer is taken, from the
            nearest on.
        takes_first: As without `persistent`.

    Raises:
        Infeasible: A point is out of reach, proved, or a pose has no configuration.
        KeyboardInterrupt: Ctrl-C before anything was certified.
    """
    require_within_bound(problem)
    first, notes = configured_ends(problem)
    others, count = other_ends(problem, first)
    if not others:
        result = _shortest(first, options, clock, last)
        return first, replace(result, notes=(*notes, *result.notes))
    takes_first = takes_first or last is not None or not options.persistent
    if last is not None:
        motion = last.spline.control_points[[0, -1]]

        def away(each: PlanningProblem) -> float:
            ends = zip(each.endpoints, motion, strict=True)
            return sum(
                float(abs(end.joints - q).max()) for end, q in ends if end.joints is not None
            )

        first, *others = sorted((first, *others), key=away)
    quick = replace(options, persistent=False)
    results: list[PlanResult] = []
    best: tuple[PlanningProblem, PlanResult] | None = None
    stopped_by: StoppedBy | None = None

    def in_turn() -> Iterator[PlanningProblem]:
        # Configurations from which no branch leads along the tube only where nothing else helps.
        yield first
        rest = []
        for each in others:
            if is_continued(each.joined):
                yield each
            else:
                rest.append(each)
        if best is None:
            yield from rest

    for number, each in enumerate(in_turn(), 1):
        shortest = np.inf if best is None else best[1].duration or np.inf
        if least_time(each) >= shortest:
            continue
        # Of the remaining time twice as much as would remain for each further one.
        open_count = len(others) + 2 - number
        limit = 2 * clock.remaining / (open_count + 1) if np.isfinite(clock.remaining) else None
        try:
            with clock.within(f"configurations {number} of {len(others) + 1}"):
                result = _shortest(each, quick, PlanningClock(limit, clock.announce), last)
        except KeyboardInterrupt:
            if best is None:
                raise
            stopped_by = "interrupt"
            break
        results.append(result)
        stopped_by = result.stopped_by or stopped_by
        if (result.duration or np.inf) < shortest * (1 - _EQUAL):
            best = each, result
        if (best is not None and takes_first) or stopped_by == "interrupt" or clock.remaining <= 0:
            break
    if best is None and stopped_by is not None:
        return first, stopped_result(clock, stopped_by, options.method)
    if best is None:
        best = first, results[0]
        if options.persistent and results[0].status not in _SURE:
            best = first, _shortest(first, options, clock, last)
    result = _of_configurations(problem, best, results, count)
    return best[0], replace(result, stopped_by=result.stopped_by or stopped_by)


_EQUAL = 1e-6  # relative: of durations that differ by rounding alone the first counts
# Refusals of a configuration itself.
_SURE = (PlanStatus.GRAVITY_EXCEEDS_EFFORT,)


def _of_configurations(
    problem: PlanningProblem,
    best: tuple[PlanningProblem, PlanResult],
    results: list[PlanResult],
    count: int,
) -> PlanResult:
    """Return the result of one of several configurations, with what the others led to.

    Args:
        problem: The problem with poses.
        best: The problem and the result of the configurations that are taken.
        results: Of all configurations that were planned.
        count: The number of configurations that were found.
    """
    configured, result = best
    kinds = zip(("start", "goal"), problem.endpoints, strict=True)
    ends = [name for name, end in kinds if end.pose is not None and end.pose.seed is None]
    whose = "its pose" if len(ends) == 1 else "their poses"
    number = f"{len(results)} {'was' if len(results) == 1 else 'were'}"
    of = f"{' and '.join(ends)}: of {count} configurations found for {whose} {number}"
    if not result.succeeded:
        starts = sum(each.starts_tried or 1 for each in results)
        message = (
            f"{result.message} (in the likeliest configuration); {of} tried, none has an answer"
        )
        return replace(result, message=message, proved=False, starts_tried=starts)
    values = " and ".join(
        f"[{', '.join(f'{x:.6g}' for x in np.round(getattr(configured, end), 6) + 0.0)}]"
        for end in ends
    )
    durations = sorted(each.duration for each in results if each.duration is not None)
    note = f"{of} planned: {values}"
    if len(durations) > 1:
        note += f" is the fastest, {durations[0]:.4f} s, {len(durations) - 1} others take up to "
        note += f"{durations[-1]:.4f} s"
    note += "; a seed or joint signs ask for another"
    return replace(result, notes=(note, *result.notes))


def _of_poses(problem: PlanningProblem, result: PlanResult) -> PlanResult:
    """Return a result; a proof for a configuration chosen for a pose is none for the pose."""
    ends = zip(problem.endpoints, problem.end_radii.tolist(), strict=True)
    # A seed too leads to one of several configurations where the arm misses the point.
    has_choice = any(end.pose is not None or (end.kind == "seed" and size) for end, size in ends)
    if not (result.proved and has_choice):
        return result
    return replace(result, proved=False, starts_tried=1)


def _shortest(
    problem: PlanningProblem, options: PlanOptions, clock: PlanningClock, last: RefinedMotion | None
) -> PlanResult:
    """Return the shortest motion between configured ends; if stopped early, the best so far.

    Raises:
        KeyboardInterrupt: Ctrl-C before anything was certified.
    """
    result, stopped_by = until_stopped(
        partial(attempted_plan, problem.joined, last, options, clock)
    )
    if result is None:
        result = stopped_result(clock, stopped_by or "interrupt", options.method)
    if result.status is PlanStatus.INTERRUPTED:
        raise KeyboardInterrupt
    return result


def require_supported(problem: PlanningProblem, options: PlanOptions) -> None:
    """Check that the method honours slack and robustness, and that MuJoCo can simulate the latter.

    Raises:
        OptionError: The method does not honour them, or robustness without MuJoCo.
        RobotError: Robustness is asked for, and joints of the robot follow others.
    """
    is_robust = options.robust and problem.robustness is not None
    if is_robust:
        require_mujoco("the field robustness")
        require_no_followers(problem.robot)
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
