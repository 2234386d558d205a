"""Attempts by refinement, with samples at counterexamples: branch, last motion, narrower tubes."""

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import count
from typing import Protocol, TypeAlias

import numpy as np

from tubeplanner.arrays import IntArray
from tubeplanner.certificate.verification import Certificate
from tubeplanner.errors import ProblemError
from tubeplanner.first_guess.branches import KnownBranches, ReferenceBranch, redundancy_rules
from tubeplanner.limits.time_scaling import scaled_to_limits
from tubeplanner.optimizer.auxiliary_tubes import smoother_problem, widened_radius
from tubeplanner.optimizer.phased_spline import KnotGrid, PhasedSpline
from tubeplanner.optimizer.segment_chains import sharpest_bend, tube_chains
from tubeplanner.optimizer.stages import Refinement, has_enough_knots, limit_sensitivities
from tubeplanner.optimizer.starts import RefinedMotion, sufficient_start
from tubeplanner.outcome import (
    Infeasible,
    Place,
    PlanningClock,
    PlanStatus,
    Progress,
    until_stopped,
)
from tubeplanner.planning.options import QUALITIES, REFINEMENT, PlanOptions, Quality
from tubeplanner.planning.result import PlanResult, certified_result, stopped_result
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

# ---- A motion of the optimiser, certified: samples are added where its certificate fails.

# How often the optimiser gets the times of failed conditions from a certificate.
_MAX_OBJECTIONS = 5


class OptimisedMotion(Protocol):
    """What the optimiser works on."""

    @property
    def has_spline(self) -> bool:
        """Whether there is a trajectory yet."""
        ...

    @property
    def gave_up(self) -> bool:
        """Whether it ended early, without hope."""
        ...

    @property
    def trajectory(self) -> JointTrajectory:
        """The best so far, as a trajectory that takes one second."""
        ...

    @property
    def segments(self) -> IntArray:
        """The tube segment of each of its polynomial pieces, shape (pieces,)."""
        ...

    def answer(self, certificate: Certificate, duration: float) -> bool:
        """Continue with samples where a certificate fails; return whether there was work to do."""
        ...


def certified_motion(
    problem: PlanningProblem,
    motion: OptimisedMotion,
    work: Callable[[], bool],
    clock: PlanningClock,
    *,
    timed: Callable[[JointTrajectory], JointTrajectory] = lambda shortest: shortest,
    needs_reason: bool = True,
) -> PlanResult | None:
    """Return the result of an optimised motion, with samples added where its certificate fails.

    After Ctrl-C or the time limit, certifies the best so far.

    Args:
        problem: The problem that is certified.
        motion: Of it, or of one whose tube lies inside of its.
        work: Its first part; returns whether there is anything to certify.
        clock: The planning's.
        timed: Makes what is certified of the motion as fast as its limits allow.
        needs_reason: Whether a certificate is to say why, even where the optimiser gave up.

    Returns:
        None if it gave up and no reason was needed, or there was nothing to certify.

    Raises:
        Infeasible: Nothing to start from.
    """
    result: PlanResult | None = None
    for _ in range(_MAX_OBJECTIONS):
        has_more, stopped_by = until_stopped(work)
        if stopped_by is not None and not motion.has_spline:
            return stopped_result(clock, stopped_by, REFINEMENT)
        if has_more is False:
            break
        if motion.gave_up and not needs_reason:
            return None
        trajectory = scaled_to_limits(problem, motion.trajectory, segments=motion.segments)
        trajectory = timed(trajectory)
        result = certified_result(problem, trajectory, REFINEMENT, clock)
        result = replace(result, stopped_by=stopped_by)
        if result.succeeded or result.certificate is None:
            break
        if motion.gave_up or stopped_by is not None:
            break
        work = partial(motion.answer, result.certificate, trajectory.duration)
    return result


# ---- Planning by refinement: the second phase of the paper, from the reference branch.

# Where the segments need more knots than the quality has, there are at most this many times more.
_MAX_KNOTS_SHARE = 1.5
# A path that turns more than this over the length of a radius is smoothed before it is tried [rad].
_SHARP_BEND = 1.5
# A narrower tube is of no use then: nothing is faster, or links are in the way.
_ENDS_THE_SEARCH = (PlanStatus.SUCCESS, PlanStatus.TUBE_BLOCKED)
# What chains need to begin with is divided by this all the same.
_LEAST_DIVISION = 2

# Choices of knots: about how many intervals first, and into how many parts they are divided.
_Knots: TypeAlias = tuple[tuple[int, tuple[int, ...]], ...]


def refined_plan(
    problem: PlanningProblem, branches: KnownBranches, options: PlanOptions, clock: PlanningClock
) -> PlanResult | None:
    """Return the fastest certified trajectory of all starts, or the first one's refusal.

    Returns:
        None if there was nothing to start from.
    """
    return RefinedPlans(problem, branches, options, clock).after_all()


class RefinedPlans:
    """Refinement from one start after the other; its best result so far."""

    def __init__(
        self,
        problem: PlanningProblem,
        branches: KnownBranches,
        options: PlanOptions,
        clock: PlanningClock,
        after_step: Callable[[], None] = lambda: None,
    ) -> None:
        """Set it up; nothing is planned yet.

        Args:
            problem: The planning problem.
            branches: Its branches, and where further ones are searched.
            options: The quality decides on starts and knots.
            clock: The planning's.
            after_step: Called after every step of refinement, before the clock's check.
        """
        self._problem, self._branches, self._clock = problem, branches, clock
        self._quality, self._after_step = QUALITIES[options.quality], after_step
        self._best: PlanResult | None = None
        self._results = self._attempts()

    def after_one(self) -> PlanResult | None:
        """Return the result of the first start that has one; None: no start has one."""
        return self._until(lambda best: not (best.succeeded and self._quality.every_start))

    def after_all(self) -> PlanResult | None:
        """Return the best result of all starts, or of those up to the first certified trajectory.

        The quality decides which. None: no start has a result.
        """
        return self._until(lambda best: best.succeeded and not self._quality.every_start)

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
        """Yield the best result so far after every start that has a result."""
        problem, clock = self._problem, self._clock
        for inner, known in _inner_problems(problem, self._branches, clock):
            first: _Found | None = None
            nearly: list[ReferenceBranch] = []
            for start in _starts(inner, known, self._quality, nearly):
                gave_up = first is not None and first.gave_up
                if not start.widens and not _is_other(inner, start, gave_up):
                    continue
                try:
                    found = self._from_start(inner, start)
                except Infeasible:  # nothing from this start
                    continue
                first = first or found
                if found.result is None:
                    continue
                if not found.gave_up and not found.result.succeeded:
                    nearly.append(start.branch)
                best = _better(self._best or found.result, found.result)
                self._best = replace(best, stopped_by=found.result.stopped_by)
                yield self._best
            if self._best is not None and self._best.status in _ENDS_THE_SEARCH:
                return

    def _from_start(self, inner: PlanningProblem, start: "_Start") -> "_Found":
        """Return what refinement makes of one start.

        Args:
            inner: What is refined: the problem, or one with a tube inside its tube.
            start: Where to start.

        Raises:
            Infeasible: Nothing to start from.
            TimeLimitReached: Before it began.
        """
        knots = start.spline.grid.interval_count * int(np.prod(start.divisions))
        checkpoint = entered(knots, self._clock, self._after_step)
        refinement = Refinement(
            inner, start.spline, start.divisions, checkpoint, widens=start.widens
        )
        # Only the first refusal is told: where refinement gave up, the judge need not say why.
        result = certified_refinement(
            self._problem,
            refinement,
            refinement.run,
            self._clock,
            needs_reason=self._best is None,
        )
        return _Found(result, refinement.gave_up)


def _inner_problems(
    problem: PlanningProblem, branches: KnownBranches, clock: PlanningClock
) -> Iterator[tuple[PlanningProblem, KnownBranches]]:
    """Yield the problem, and one whose tube lies inside, with branches; the likelier one first.

    Only where segments form chains: a phase for every segment follows any bend.
    """
    chains = tube_chains(problem)
    if all(len(chain) == 1 for chain in chains):
        yield problem, branches
        return
    bends_sharply = sharpest_bend(problem.tube, chains) > _SHARP_BEND
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
    """Where refinement may start.

    Attributes:
        branch: Along which the spline begins.
        spline: The spline.
        divisions: How often its knot intervals are divided, and into how many parts.
        widens: As in `Refinement`.
    """

    branch: ReferenceBranch
    spline: PhasedSpline
    divisions: tuple[int, ...]
    widens: bool = True


@dataclass(frozen=True, eq=False)
class _Found:
    """What came of a start.

    Attributes:
        result: The result; None if refinement gave up and no reason was needed.
        gave_up: As in `Refinement`.
    """

    result: PlanResult | None
    gave_up: bool = False


def _starts(
    problem: PlanningProblem,
    branches: KnownBranches,
    quality: Quality,
    nearly: list[ReferenceBranch],
) -> Iterator[_Start]:
    """Yield where to start.

    At last the first once more, without widening the tube, and other knots on those branches that
    have turned out to lead nearly to an answer, not clear of something by a little.
    """
    known: list[ReferenceBranch] = []
    first: _Start | None = None
    for search in _branch_searches(problem, branches):
        try:
            branch = search()
        except Infeasible:
            continue
        if not branch.moving_segments:
            return
        if any(branch.is_as(other) for other in known):
            continue
        knots = _knots(problem, branch, quality)[: 1 if known else None]
        for start in _starts_from(problem, branch, knots):
            first = first or start
            yield start
        known.append(branch)
    if first is not None:
        yield replace(first, widens=False)
    for branch in dict.fromkeys(nearly):
        yield from _starts_from(problem, branch, quality.other_knots)


def _starts_from(
    problem: PlanningProblem, branch: ReferenceBranch, knots: _Knots
) -> Iterator[_Start]:
    """Yield a start from a branch for each choice of knots."""
    for intervals, divisions in knots:
        spline = sufficient_start(problem, branch, intervals)
        yield _Start(branch, spline, _divisions(spline.grid, intervals, divisions))


def _knots(problem: PlanningProblem, branch: ReferenceBranch, quality: Quality) -> _Knots:
    """Return the quality's choices of knots for a branch."""
    wide = sufficient_start(problem, branch, quality.knots[0][0])
    has_chains = any(len(chain) > 1 for chain in wide.grid.chains)
    is_narrow = has_chains or _is_widened(problem, wide)
    return quality.narrow_knots if is_narrow else quality.knots


def _is_other(problem: PlanningProblem, last: _Start, gave_up: bool) -> bool:
    """Return whether a last try without widening is not only the first one again.

    Args:
        problem: What is planned.
        last: The last start.
        gave_up: Whether the first one did.
    """
    few_at_first = len(last.divisions) > 1 or not has_enough_knots(last.spline.grid)
    return _is_widened(problem, last.spline) or (gave_up and few_at_first)


def _is_widened(problem: PlanningProblem, spline: PhasedSpline) -> bool:
    """Return whether a start's coarse knots get another tube than the problem's."""
    widened = widened_radius(problem.tube, spline.grid)
    return bool((widened > problem.tube.effective_radius).any())


def _branch_searches(
    problem: PlanningProblem, branches: KnownBranches
) -> Iterator[Callable[[], ReferenceBranch]]:
    """Yield searches for branches, the most natural first, then those that may be impossible.

    Of these the shortest first: one may turn a wrist to and fro that another hardly moves.
    """
    first, *others = redundancy_rules(problem)
    yield partial(branches.by_rule, first)
    impossible = [branches.joint_lines]
    if problem.rotation is not None:
        impossible.append(branches.position_only)
    yield from sorted(impossible, key=_length)
    for rule in others:
        yield partial(branches.by_rule, rule)


def _length(search: Callable[[], ReferenceBranch]) -> float:
    """Return the length of the branch that a search finds; infinite if it finds none."""
    try:
        return search().length
    except Infeasible:
        return np.inf


def _divisions(grid: KnotGrid, wanted: int, divisions: tuple[int, ...]) -> tuple[int, ...]:
    """Return the divisions for knots that begin with more intervals than the quality's.

    Every phase has some, and chains as many as they need: then the finest knots are reached by
    fewer divisions.
    """
    count, has_chains = grid.interval_count, any(len(chain) > 1 for chain in grid.chains)
    most = _MAX_KNOTS_SHARE * wanted * float(np.prod(divisions))
    most = max(most, _LEAST_DIVISION * count) if has_chains else most
    parts = list(divisions)
    while parts and count * np.prod(parts) > most:
        parts[0] -= 1
        if parts[0] == 1:
            parts.pop(0)
    return tuple(parts)


def entered(
    knots: int, clock: PlanningClock, after_step: Callable[[], None] = lambda: None
) -> Callable[[float], None]:
    """Enter the stage of refinement to so many knots; return what it calls after every step.

    Args:
        knots: How many.
        clock: The planning's.
        after_step: Called after every step; stages that it announces end with it.

    Raises:
        TimeLimitReached: Before it began.
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
    work: Callable[[], bool],
    clock: PlanningClock,
    *,
    needs_reason: bool = True,
) -> PlanResult | None:
    """Return refinement's result, as `certified_motion`, with what limits cost and how it ended.

    Args:
        problem: The problem that is certified.
        refinement: Of it, or of one whose tube lies inside of its.
        work: Its first part.
        clock: The planning's.
        needs_reason: Whether a certificate is to say why, even where refinement gave up.

    Returns:
        None if refinement gave up and no reason was needed.

    Raises:
        Infeasible: Nothing to start from.
    """
    result = certified_motion(problem, refinement, work, clock, needs_reason=needs_reason)
    if result is None or result.trajectory is None:
        return result
    trajectory = result.trajectory
    sensitivities = limit_sensitivities(problem, refinement, trajectory.duration)
    motion = RefinedMotion(refinement.problem, refinement.problem is not problem, refinement.spline)
    return replace(result, sensitivities=sensitivities, motion=motion)


def _better(known: PlanResult, found: PlanResult) -> PlanResult:
    """Return the faster of two results that are certified, the one that is, or the first."""
    if found.duration is None:
        return known
    return found if known.duration is None or found.duration < known.duration else known


# ---- Planning by refinement from the last motion, after a problem has changed a little.

# A motion that changes for more steps before it is judged is no longer near the last: another may
# be better. (Of 110 small changes and 88 large ones, those that took no more ended at most 0.17 %
# above a fresh plan. In tubes up to 3 times as wide, those that took more ended up to 3.8 % above.)
_MAX_STEPS = 25


def continued_plan(
    problem: PlanningProblem, last: RefinedMotion, clock: PlanningClock
) -> PlanResult | None:
    """Return a certified trajectory that refinement makes of the last motion.

    Returns:
        None if there is none, and the problem is to be planned afresh. After Ctrl-C or the time
        limit, the best so far, or that nothing is certified.

    Raises:
        TimeLimitReached: Before it began; likewise KeyboardInterrupt.
    """
    inner = last.suited(problem)
    if inner is None:
        return None
    try:
        start = last.shifted(inner)
        steps = _FirstSteps(entered(start.grid.interval_count, clock))
        refinement = Refinement(inner, start, (), steps)
        work = partial(steps.until_answered, refinement.run_on)
        result = certified_refinement(problem, refinement, work, clock)
    except Infeasible:
        return None
    if result is not None and result.succeeded:
        return result
    if result is None or result.stopped_by is None:
        return None
    return stopped_result(clock, result.stopped_by, REFINEMENT)


class _FirstSteps:
    """A checkpoint that ends the work if there are too many steps before its first answer.

    Where a certificate objects to that one, the steps that mend it say nothing of how far it is
    from the last motion.
    """

    def __init__(self, checkpoint: Callable[[float], None]) -> None:
        """Count calls of a checkpoint."""
        self._checkpoint = checkpoint
        self._steps = count(1)
        self._has_answer = False

    def __call__(self, duration: float) -> None:
        """Take note of a step.

        Raises:
            Infeasible: Status no_trajectory: there were too many.
        """
        self._checkpoint(duration)
        if not self._has_answer and next(self._steps) > _MAX_STEPS:
            message = f"the last motion still changed after {_MAX_STEPS} steps"
            raise Infeasible(PlanStatus.NO_TRAJECTORY, message, Place())

    def until_answered(self, work: Callable[[], bool]) -> bool:
        """Return what work returns, whose steps are those up to the first answer."""
        has_answer = work()
        self._has_answer = True
        return has_answer


# ---- Planning through narrower tubes, where links get stuck on the way to a fast motion in a wide
# one.
#
# Refinement is a local method: in a wide tube its first steps may lead links into an obstacle that
# they do not get out of. Around a reference path that is free, a tube that is narrow enough has no
# such way; and the motion in it is a start for the wide one.

# Shares of the tube's radii that are tried.
_NARROWER = (0.5, 0.25)


def narrowed_plan(
    problem: PlanningProblem, options: PlanOptions, clock: PlanningClock
) -> PlanResult | None:
    """Return the certified motion that refinement makes of one in a narrower tube.

    Returns:
        None if there is none, or start or goal lie outside of narrower tubes.

    Raises:
        TimeLimitReached: Before there was one; likewise KeyboardInterrupt.
    """
    for share in _NARROWER:
        with suppress(ProblemError, Infeasible):  # start or goal outside, or nothing found
            narrower = problem.with_tube(problem.tube.scaled(share))
            found = refined_plan(narrower, KnownBranches(narrower, clock), options, clock)
            if found is None or found.motion is None or found.trajectory is None:
                continue
            if found.stopped_by is None:
                widened = _widened(problem, found.motion.spline, clock)
                if widened is not None and widened.succeeded:
                    return widened
            answer = certified_result(problem, found.trajectory, REFINEMENT, clock)
            return replace(answer, motion=found.motion, stopped_by=found.stopped_by)
    return None


def _widened(
    problem: PlanningProblem, start: PhasedSpline, clock: PlanningClock
) -> PlanResult | None:
    """Return what refinement in the whole tube makes of a motion in a narrower one."""
    refinement = Refinement(problem, start, (), entered(start.grid.interval_count, clock))
    return certified_refinement(problem, refinement, refinement.run_on, clock)
