"""Attempts by refinement: from branches, from the last motion, through narrower tubes."""

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias

import numpy as np

from tubeplanner.errors import ProblemError
from tubeplanner.first_guess.branches import KnownBranches, ReferenceBranch, redundancy_rules
from tubeplanner.limits.speed_limits import scaled_to_limits
from tubeplanner.optimizer.phased_spline import PhasedSpline
from tubeplanner.optimizer.stages import Refinement, Stage, has_enough_knots, limit_sensitivities
from tubeplanner.optimizer.starts import (
    RefinedMotion,
    spline_along,
    starting_spline,
    sufficient_start,
    visited_phases,
)
from tubeplanner.optimizer.tube_phases import (
    sharpest_bend,
    smoother_problem,
    tube_chains,
    widened_radius,
)
from tubeplanner.outcome import Infeasible, PlanningClock, PlanStatus, Progress, until_stopped
from tubeplanner.planning.options import QUALITIES, REFINEMENT, PlanOptions, Quality
from tubeplanner.planning.result import PlanResult, certified_result, stopped_result
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

# ---- A motion of the optimiser, certified: samples are added where its certificate fails.


def certified_motion(
    problem: PlanningProblem,
    stage: Stage,
    clock: PlanningClock,
    *,
    timed: Callable[[JointTrajectory], JointTrajectory] = lambda shortest: shortest,
    needs_reason: bool = True,
) -> PlanResult | None:
    """Run a stage and return its result, with samples added where its certificate fails.

    After Ctrl-C or the time limit, certifies the best motion so far. The stage is one of the
    problem, or of a problem whose tube lies inside its tube. `timed` retimes the trajectory at its
    limits before it is certified. None if the stage gave up and no reason was needed, or nothing
    was to be certified.

    Raises:
        Infeasible: Nothing to start from.
    """
    result, work = None, stage.run
    for _ in range(stage.max_objections):
        has_more, stopped_by = until_stopped(work)
        if stopped_by is not None and not stage.has_spline:
            return stopped_result(clock, stopped_by, REFINEMENT)
        if has_more is False:
            break
        if stage.gave_up and not needs_reason:
            return None
        trajectory = timed(scaled_to_limits(problem, stage.trajectory, segments=stage.segments))
        result = certified_result(problem, trajectory, REFINEMENT, clock)
        result = replace(result, stopped_by=stopped_by)
        if result.succeeded or result.certificate is None:
            break
        if stage.gave_up or stopped_by is not None:
            break
        work = partial(stage.answer, result.certificate, trajectory.duration)
    return result


# ---- Planning by refinement: the second phase of the paper, from the reference branch.

# Where the segments need more knots than the quality has, at most this many times as many.
_MAX_KNOTS_RATIO = 1.5
# A path that turns more than this over the length of a radius is smoothed before it is tried [rad].
_SHARP_BEND = 1.5
# Then a narrower tube is of no use: nothing is faster, or links are in the way.
_ENDS_THE_SEARCH = (PlanStatus.SUCCESS, PlanStatus.TUBE_BLOCKED)
# The knots that chains need to begin with are divided by at least this.
_MIN_DIVISION = 2

# Choices of knots: the first number of intervals, about, and the numbers of parts of divisions.
_Knots: TypeAlias = tuple[tuple[int, tuple[int, ...]], ...]


class RefinedPlans:
    """Refinement from starts in turn, and the best result so far."""

    def __init__(
        self,
        problem: PlanningProblem,
        branches: KnownBranches,
        options: PlanOptions,
        clock: PlanningClock,
        after_step: Callable[[], None] = lambda: None,
    ) -> None:
        """Prepare the attempts; nothing is planned yet.

        `after_step` is called after every step of refinement, before the clock's check.
        """
        self._problem, self._branches, self._clock = problem, branches, clock
        self._quality, self._after_step = QUALITIES[options.quality], after_step
        self._best: PlanResult | None = None
        self._results = self._attempts()

    def after_one(self) -> PlanResult | None:
        """Return the result of the first start with a result; None: no start has a result."""
        return self._until(lambda best: not (best.succeeded and self._quality.every_start))

    def after_all(self) -> PlanResult | None:
        """Return the best result of all starts; None: no start has a result.

        Unless the quality asks for every start, the first certified trajectory is the last attempt.
        """
        return self._until(lambda best: best.succeeded and not self._quality.every_start)

    def in_visited_segments(self, known: PlanResult) -> PlanResult | None:
        """Return the result in the segments alone that a motion visits, in its order.

        None: no result, or the motion was refined in these segments, or another in all of them.
        """
        trajectory, refined = known.trajectory, known.motion
        if refined is None and self._best is not None:
            refined = self._best.motion
        assert trajectory is not None
        runs, ends = visited_phases(self._problem, trajectory)
        if refined is not None and refined.spline.grid.runs == runs:
            return None
        start_of = partial(spline_along, trajectory, runs, ends)
        knots = _suitable_knots(self._problem, start_of, self._quality)[:1]
        ((spline, divisions),) = _begun(self._problem, start_of, knots)
        with suppress(Infeasible):
            return self._refined(self._problem, spline, divisions, widens=False)[1]
        return None

    def _refined(
        self,
        inner: PlanningProblem,
        spline: PhasedSpline,
        divisions: tuple[int, ...],
        *,
        widens: bool,
    ) -> tuple[bool, PlanResult | None]:
        """Return whether refinement of a spline gave up, and its result; None: it has none.

        Only the first refusal is reported: where refinement gave up later, no reason is needed.
        """
        knots = spline.grid.interval_count * int(np.prod(divisions))
        checkpoint = entered(knots, self._clock, self._after_step)
        refinement = Refinement(inner, spline, divisions, checkpoint, widens=widens)
        result = certified_refinement(
            self._problem, refinement, self._clock, needs_reason=self._best is None
        )
        return refinement.gave_up, result

    def _until(self, is_enough: Callable[[PlanResult], bool]) -> PlanResult | None:
        def work() -> None:
            for best in self._results:
                if best.stopped_by is not None or is_enough(best):
                    return

        _, stopped_by = until_stopped(work)
        if stopped_by is None:
            return self._best
        best = self._best or stopped_result(self._clock, stopped_by, REFINEMENT)
        return replace(best, stopped_by=stopped_by)

    def _attempts(self) -> Iterator[PlanResult]:
        """Yield the best result so far after every start that has a result.

        Where that may be faster, after the next start, once. (Of 8 such answers, other knots on the
        same branch made 6 faster, by 0.6 % to 45 %, in as much time again; the next branch made 4.)
        """
        is_second = self._quality.every_start
        for inner, branches in _inner_problems(self._problem, self._branches, self._clock):
            first_gave_up: bool | None = None
            nearly: list[ReferenceBranch] = []
            slow: list[ReferenceBranch] = []
            for start in _starts(inner, branches, self._quality, nearly, slow):
                if not start.widens:  # a last attempt, if it may differ from the first
                    is_coarse = len(start.divisions) > 1 or not has_enough_knots(start.spline.grid)
                    if not (_is_widened(inner, start.spline) or (first_gave_up and is_coarse)):
                        continue
                try:
                    gave_up, result = self._refined(
                        inner, start.spline, start.divisions, widens=start.widens
                    )
                except Infeasible:  # nothing from this start
                    continue
                first_gave_up = gave_up if first_gave_up is None else first_gave_up
                if result is None:
                    continue
                if not gave_up and not result.succeeded:
                    nearly.append(start.branch)
                best, duration = self._best or result, result.duration
                if duration is not None and (best.duration is None or duration < best.duration):
                    best = result
                self._best = replace(best, stopped_by=result.stopped_by)
                if best.may_be_faster and result.stopped_by is None and not is_second:
                    is_second = True
                    slow.append(start.branch)
                    continue
                yield self._best
            if self._best is not None and self._best.status in _ENDS_THE_SEARCH:
                return


def _inner_problems(
    problem: PlanningProblem, branches: KnownBranches, clock: PlanningClock
) -> Iterator[tuple[PlanningProblem, KnownBranches]]:
    """Yield the problem and a smoother problem inside its tube, with branches, likelier first.

    The smoother problem only where segments form chains: a phase for every segment follows any
    bend.
    """
    runs = tube_chains(problem)
    if all(len(run) == 1 for run in runs):
        yield problem, branches
        return
    bends_sharply = sharpest_bend(problem.tube, runs) > _SHARP_BEND
    if not bends_sharply:
        yield problem, branches
    smoother = smoother_problem(problem)
    if smoother is not None:
        with suppress(Infeasible):  # a branch of its own, so that Ctrl-C has an answer
            branches.by_rule(redundancy_rules(problem)[0])
        yield smoother, KnownBranches(smoother, clock)
    if bends_sharply:
        yield problem, branches


@dataclass(frozen=True, eq=False)
class _Start:
    """A start of refinement along a branch; divisions and widening are as in `Refinement`."""

    branch: ReferenceBranch
    spline: PhasedSpline
    divisions: tuple[int, ...]
    widens: bool = True


def _starts(
    problem: PlanningProblem,
    branches: KnownBranches,
    quality: Quality,
    nearly: list[ReferenceBranch],
    slow: list[ReferenceBranch],
) -> Iterator[_Start]:
    """Yield the starts of refinement.

    At last the first start again, without widening the tube, and other knots on branches that led
    nearly to an answer: `nearly`, which grows while starts are tried. So does `slow`, of branches
    that led to an answer that may be faster: other knots come next.
    """
    distinct: list[ReferenceBranch] = []
    first: _Start | None = None
    for search in _branch_searches(problem, branches):
        try:
            branch = search()
        except Infeasible:
            continue
        if not branch.moving_segments:
            return
        if any(branch.is_as(other) for other in distinct):
            continue
        start_of = partial(starting_spline, problem, branch)
        knots = _suitable_knots(problem, start_of, quality)[: 1 if distinct else None]
        for spline, divisions in _begun(problem, start_of, knots):
            start = _Start(branch, spline, divisions)
            first = first or start
            yield start
        if branch in slow:
            for spline, divisions in _begun(problem, start_of, quality.other_knots):
                yield _Start(branch, spline, divisions)
        distinct.append(branch)
    if first is not None:
        yield replace(first, widens=False)
    for branch in dict.fromkeys(nearly):
        start_of = partial(starting_spline, problem, branch)
        for spline, divisions in _begun(problem, start_of, quality.other_knots):
            yield _Start(branch, spline, divisions)


def _suitable_knots(
    problem: PlanningProblem, start_of: Callable[[int], PhasedSpline], quality: Quality
) -> _Knots:
    """Return a quality's choices of knots for splines of a number of knot intervals."""
    wide = sufficient_start(problem, start_of, quality.knots[0][0])
    has_runs = any(len(run) > 1 for run in wide.grid.runs)
    return quality.narrow_knots if has_runs or _is_widened(problem, wide) else quality.knots


def _begun(
    problem: PlanningProblem, start_of: Callable[[int], PhasedSpline], knots: _Knots
) -> Iterator[tuple[PhasedSpline, tuple[int, ...]]]:
    """Yield the first spline and the divisions for each choice of knots."""
    for intervals, divisions in knots:
        spline = sufficient_start(problem, start_of, intervals)
        # Every phase has intervals, and chains as many as they need: then fewer divisions lead to
        # the finest knots.
        count = spline.grid.interval_count
        has_runs = any(len(run) > 1 for run in spline.grid.runs)
        most = _MAX_KNOTS_RATIO * intervals * float(np.prod(divisions))
        most = max(most, _MIN_DIVISION * count) if has_runs else most
        parts = list(divisions)
        while parts and count * np.prod(parts) > most:
            parts[0] -= 1
            if parts[0] == 1:
                parts.pop(0)
        yield spline, tuple(parts)


def _is_widened(problem: PlanningProblem, spline: PhasedSpline) -> bool:
    widened = widened_radius(problem.tube, spline.grid)
    return bool((widened > problem.tube.effective_radius).any())


def _branch_searches(
    problem: PlanningProblem, branches: KnownBranches
) -> Iterator[Callable[[], ReferenceBranch]]:
    """Yield searches for branches: the most natural, branches outside the tube, other rules.

    Of branches outside the tube the shortest first: a branch may turn a wrist to and fro that
    another hardly moves.
    """
    first, *others = redundancy_rules(problem)
    yield partial(branches.by_rule, first)
    outside = [branches.joint_lines]
    if problem.rotation is not None:
        outside.append(branches.position_only)
    lengths = []
    for search in outside:
        try:
            lengths.append(search().length)
        except Infeasible:
            lengths.append(np.inf)
    yield from (outside[k] for k in np.argsort(lengths, kind="stable"))
    for rule in others:
        yield partial(branches.by_rule, rule)


def entered(
    knots: int, clock: PlanningClock, after_step: Callable[[], None] = lambda: None
) -> Callable[[float], None]:
    """Enter the stage of refinement to a number of knots; return the checkpoint of its steps.

    `after_step` is called after every step; stages that it announces end with it.
    """
    stage = f"refinement to {knots} knots"
    clock.enter(stage)

    def checkpoint(duration: float) -> None:
        after_step()
        clock.announce(Progress(stage, best_duration=duration))
        clock.check()

    return checkpoint


def certified_refinement(
    problem: PlanningProblem,
    refinement: Refinement,
    clock: PlanningClock,
    *,
    needs_reason: bool = True,
) -> PlanResult | None:
    """Return the result of `certified_motion`, with sensitivities and refinement's last motion."""
    result = certified_motion(problem, refinement, clock, needs_reason=needs_reason)
    if result is None or result.trajectory is None:
        return result
    sensitivities = limit_sensitivities(problem, refinement, result.trajectory.duration)
    motion = RefinedMotion(refinement.problem, refinement.problem is not problem, refinement.spline)
    return replace(result, sensitivities=sensitivities, motion=motion)


# A motion that changes for more steps before it is judged is no longer near the last: another may
# be better. (Of 110 small and 88 large changes, all with no more steps ended at most 0.17 % above a
# fresh plan. In tubes up to 3 times as wide, motions with more steps ended up to 3.8 % above.)
_MAX_STEPS = 25


def continued_plan(
    problem: PlanningProblem, last: RefinedMotion, clock: PlanningClock
) -> PlanResult | None:
    """Return a certified trajectory by refinement of the last motion; None: to be planned afresh.

    After Ctrl-C or the time limit, the best so far, or the result that nothing is certified.
    """
    inner = last.suited(problem)
    if inner is None:
        return None
    try:
        start = last.shifted(inner)
        checkpoint = entered(start.grid.interval_count, clock)
        refinement = Refinement(inner, start, None, checkpoint, max_steps=_MAX_STEPS)
        result = certified_refinement(problem, refinement, clock)
    except Infeasible:
        return None
    if result is not None and result.succeeded:
        return result
    if result is None or result.stopped_by is None:
        return None
    return stopped_result(clock, result.stopped_by, REFINEMENT)


# ---- Planning through narrower tubes, where links get stuck on the way to a fast motion in a wide
# tube.
#
# Refinement is a local method: in a wide tube its first steps may lead links into an obstacle that
# they do not get out of. Around a reference path that is free, a tube that is narrow enough has no
# such path; and the motion in it is a start for the wide tube.

# Fractions of the tube's radii, in turn.
_NARROWER = (0.5, 0.25)


def narrowed_plan(
    problem: PlanningProblem, options: PlanOptions, clock: PlanningClock
) -> PlanResult | None:
    """Return the certified motion by refinement of a motion in a narrower tube.

    None if there is no motion, or start or goal lie outside of narrower tubes.
    """
    for ratio in _NARROWER:
        with suppress(ProblemError, Infeasible):  # start or goal outside, or no motion
            narrower = problem.with_tube(problem.tube.scaled(ratio))
            branches = KnownBranches(narrower, clock)
            result = RefinedPlans(narrower, branches, options, clock).after_all()
            if result is None or result.motion is None or result.trajectory is None:
                continue
            if result.stopped_by is None:
                widened = _widened(problem, result.motion.spline, clock)
                if widened is not None and widened.succeeded:
                    return widened
            answer = certified_result(problem, result.trajectory, REFINEMENT, clock)
            return replace(answer, motion=result.motion, stopped_by=result.stopped_by)
    return None


def _widened(
    problem: PlanningProblem, start: PhasedSpline, clock: PlanningClock
) -> PlanResult | None:
    refinement = Refinement(problem, start, None, entered(start.grid.interval_count, clock))
    return certified_refinement(problem, refinement, clock)
