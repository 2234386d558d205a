"""Trials of changes within a time budget; bracket of the decisive size."""

import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

from tubeplanner.errors import TubePlannerError
from tubeplanner.outcome import PlanningClock, Progress, TimeLimitReached
from tubeplanner.planning.options import PlanOptions
from tubeplanner.studies.changes import Change, Proposal, Question, rounded
from tubeplanner.studies.plan_many import plan_either, run_many
from tubeplanner.studies.problem_spec import ProblemSpec

# ---- Trials: plans with one change each, within a time budget.

# No trial may take a larger fraction of the whole time, so that others have their turn.
_MAX_FRACTION = 0.1
_MIN_TIME = 2.0  # [s]


@dataclass(frozen=True)
class Trial:
    """The result of planning with a change.

    Attributes:
        size: Size of the change.
        proposal: The change by that size.
        duration: Duration of the certified motion [s]; None if there is none.
        is_thorough: True if planning went on where its first start led nowhere.
    """

    size: float
    proposal: Proposal
    duration: float | None
    is_thorough: bool = True

    @property
    def succeeded(self) -> bool:
        """True if a motion was certified."""
        return self.duration is not None


class Trials:
    """Plans of a problem with one change each, side by side if an executor is given.

    Plans raise TimeLimitReached after the time limit, and KeyboardInterrupt after Ctrl-C.

    Attributes:
        count: Number of plans so far.
    """

    def __init__(
        self,
        question: Question,
        options: PlanOptions,
        clock: PlanningClock,
        executor: Executor | None = None,
    ) -> None:
        """Set the options of all plans.

        Args:
            question: The explained problem.
            options: Planning options; quality becomes "fast" but for a longer duration, which the
                quality decides, and the motion the shortest unless a duration is required.
                Robustness does not count: `plan` names the error that no motion survives.
            clock: Clock with the time limit of all trials.
            executor: Processes of this machine; None: this one.
        """
        self._question, self._clock, self._executor = question, clock, executor
        longest = max(_MIN_TIME, _MAX_FRACTION * clock.remaining)
        objective = question.fields.objective
        is_timed = objective is not None and objective.duration is not None
        options = options if is_timed else options.shortest
        self._quality = options.quality
        self._options = replace(options, quality="fast", time_limit=longest, robust=False)
        self.count = 0

    def of(
        self, sizes: Sequence[tuple[Change, float]], is_thorough: bool
    ) -> Iterator[tuple[int, Trial]]:
        """Yield index and trial of each change, in the order of completion.

        A change that makes the problem invalid counts as failed.

        Args:
            sizes: Changes and sizes.
            is_thorough: True if planning goes on where its first start leads nowhere.
        """
        self._clock.check()
        proposals = [change.propose(size) for change, size in sizes]
        spec = (self._question.spec.changed(each.changes) for each in proposals)
        until = time.monotonic() + self._clock.remaining
        quick = replace(self._options, persistent=is_thorough)
        full = replace(quick, quality=self._quality)
        options = (full if change.kind == "duration" else quick for change, _ in sizes)
        calls = (Asked(*each, until) for each in zip(spec, options, strict=True))
        for done in run_many(planned, calls, self._executor, until):
            proposal = proposals[done.index]
            self._clock.announce(Progress(f"tried: {proposal.text}"))
            answer = done.value or Answer()  # a process that died has none
            if answer.is_cut_short:
                raise TimeLimitReached
            self.count += 1
            yield done.index, Trial(sizes[done.index][1], proposal, answer.duration, is_thorough)


@dataclass(frozen=True)
class Asked:
    """A problem to be planned in any process.

    Attributes:
        problem: The problem with its change.
        options: Planning options; the time limit is that of this plan.
        until: End of the time for all plans, by `time.monotonic`.
    """

    problem: ProblemSpec
    options: PlanOptions
    until: float


@dataclass(frozen=True)
class Answer:
    """The result of a plan.

    Attributes:
        duration: Duration of the certified motion [s]; None if there is none.
        is_cut_short: True if the time for all plans passed before an answer.
    """

    duration: float | None = None
    is_cut_short: bool = False


def planned(request: Asked) -> Answer:
    """Plan a problem with its change."""
    remaining = request.until - time.monotonic()
    if remaining <= 0:
        return Answer(is_cut_short=True)
    longest = request.options.time_limit or remaining
    try:
        problem = request.problem.load()
        result = plan_either(problem, replace(request.options, time_limit=min(longest, remaining)))
    except TubePlannerError:
        return Answer()
    if result.stopped_by == "interrupt":
        raise KeyboardInterrupt
    is_late = time.monotonic() >= request.until
    return Answer(result.duration, is_cut_short=is_late and not result.succeeded)


# ---- Brackets of the decisive size: between a size that is enough and one that is not.
#
# What is possible is assumed to stay possible as a remedy grows, and what is impossible to stay
# impossible as a change for the worse grows.
#
# Most of the time goes into plans that fail. So sizes are tried quickly at first, and only the
# failed size at the end of a bracket once more, thoroughly.

CLOSE = 1.05  # the ratio of sizes, and of the remaining quantities, at which the search ends
# While one of the sizes is unknown. Successful plans are quick: so steps down are smaller.
_STEP_UP, _STEP_DOWN = 10.0, 10.0**0.5
_BELOW = 1.04  # an estimate: close
_SMALLEST = 1e-3  # of the scale: smaller sizes do not matter
_MIN_REMAINDER = 2e-3  # of a reduced quantity: smaller differences do not matter


@dataclass
class SizeBracket:
    """Two sizes of a change on either side of the decisive size.

    Attributes:
        change: The change.
        helps: True if it makes an impossible problem possible, False if a possible one impossible.
        smaller: Trial of the largest size below the decisive one; None: none is known.
        larger: Trial of the smallest size above the decisive one; None: none is known.
    """

    change: Change
    helps: bool
    smaller: Trial | None = None
    larger: Trial | None = None

    @property
    def impossible(self) -> Trial | None:
        """The failed trial nearest to the decisive size; None if all were certified."""
        return self.smaller if self.helps else self.larger

    @property
    def is_close(self) -> bool:
        """True if the decisive size is known to 5 %."""
        if self.smaller is None or self.larger is None:
            return False
        smaller, larger = self.smaller.size, self.larger.size
        if larger > CLOSE * smaller:
            return False
        if not self.change.is_loss or _middle(smaller, larger) in (smaller, larger):
            return True
        remainder = self.change.scale - larger
        return larger - smaller <= max((CLOSE - 1) * remainder, _MIN_REMAINDER * self.change.scale)

    @property
    def is_done(self) -> bool:
        """True if the bracket is close, or has no sizes left to try."""
        if self.is_close or (self.change.is_switch and (self.smaller or self.larger)):
            return True
        if self.smaller is None:
            least = _SMALLEST * self.change.scale
            return self.larger is not None and self.larger.size <= least
        return self.larger is None and self.smaller.size >= rounded(self.change.most)

    @property
    def cost(self) -> float:
        """The decisive size over the scale; inf while unknown."""
        return float("inf") if self.larger is None else self.larger.size / self.change.scale

    def keep(self, trial: Trial) -> None:
        """Add the result of a trial, which overrules earlier results for its size."""
        if trial.succeeded == self.helps:
            self.larger = trial
            if self.smaller is not None and self.smaller.size >= trial.size:
                self.smaller = None
            return
        if self.smaller is None or self.smaller.size <= trial.size:
            self.smaller = trial
        if self.larger is not None and self.larger.size <= trial.size:
            self.larger = None

    def open_size(self, is_thorough: bool) -> float | None:
        """Return the size to try next; None if the bracket is done.

        Args:
            is_thorough: True if the failed size at the end of a done bracket is tried once more.
        """
        if not self.is_done:
            return self.next_size
        failed = self.impossible
        is_open = is_thorough and failed is not None and not failed.is_thorough
        return failed.size if failed is not None and is_open else None

    @property
    def next_size(self) -> float:
        """The size to try next: the geometric mean, or beyond the known size."""
        most = self.change.most
        if self.smaller is None and self.larger is None:
            return rounded(min(self.change.scale / 3, most))
        if self.smaller is None:
            assert self.larger is not None
            is_estimate = self.larger.size == rounded(self.change.estimate or 0.0)
            return rounded(self.larger.size / (_BELOW if is_estimate else _STEP_DOWN))
        if self.larger is None:
            return rounded(min(self.smaller.size * _STEP_UP, most))
        return _middle(self.smaller.size, self.larger.size)


def _middle(smaller: float, larger: float) -> float:
    return rounded((smaller * larger) ** 0.5)


def open_sizes(
    brackets: Iterable[SizeBracket], is_thorough: bool
) -> list[tuple[SizeBracket, float]]:
    """Return the brackets that are not done, each with the size to try next."""
    sizes = [(bracket, bracket.open_size(is_thorough)) for bracket in brackets]
    return [(bracket, size) for bracket, size in sizes if size is not None]


def try_sizes(
    trials: Trials, requests: Sequence[tuple[SizeBracket, float]], is_thorough: bool
) -> None:
    """Plan with the changes of brackets by sizes, and add the results to the brackets.

    Args:
        trials: The plans.
        requests: Brackets, and a size for each.
        is_thorough: True if planning goes on where its first start leads nowhere.
    """
    sizes = [(bracket.change, size) for bracket, size in requests]
    for index, trial in trials.of(sizes, is_thorough):
        requests[index][0].keep(trial)
