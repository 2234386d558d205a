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
from tubeplanner.studies.problem_spec import PosedProblem

# ---- Planning with changes, to see which help, for as long as there is time.

# No trial may take a larger share of the whole time: others are to have their turn.
_LARGEST_SHARE = 0.1
_LEAST_TIME = 2.0  # [s]


@dataclass(frozen=True)
class Trial:
    """What came of planning with a change.

    Attributes:
        size: Of the change.
        proposal: The change by that size.
        duration: Of the certified motion [s]; None if none was found.
        is_thorough: Whether all was done to find one.
    """

    size: float
    proposal: Proposal
    duration: float | None
    is_thorough: bool = True

    @property
    def succeeded(self) -> bool:
        """Whether a motion was found and certified."""
        return self.duration is not None


class Trials:
    """Plans a problem with one change each, several side by side if an executor is given.

    Attributes:
        count: How many were planned.
    """

    def __init__(
        self,
        question: Question,
        options: PlanOptions,
        clock: PlanningClock,
        executor: Executor | None = None,
    ) -> None:
        """Take what plans.

        Args:
            question: What is asked about.
            options: How to plan; here with quality "fast", and for the shortest motion unless
                a duration is asked.
            clock: Its time limit is that of all trials.
            executor: Processes of this machine; None: this one.
        """
        self._question, self._clock, self._executor = question, clock, executor
        longest = max(_LEAST_TIME, _LARGEST_SHARE * clock.remaining)
        objective = question.fields.objective
        is_timed = objective is not None and objective.duration is not None
        options = options if is_timed else options.shortest
        self._options = replace(options, quality="fast", time_limit=longest)
        self.count = 0

    def of(
        self, asked: Sequence[tuple[Change, float]], is_thorough: bool
    ) -> Iterator[tuple[int, Trial]]:
        """Yield what comes of changes by sizes, as it comes, with the place among those asked.

        What cannot be posed with a change is no success.

        Args:
            asked: Changes and sizes.
            is_thorough: Whether planning goes on where its first start leads nowhere.

        Raises:
            TimeLimitReached: There is no time left.
            KeyboardInterrupt: Ctrl-C.
        """
        self._clock.check()
        proposals = [change.propose(size) for change, size in asked]
        posed = (self._question.posed.changed(each.changes) for each in proposals)
        until = time.monotonic() + self._clock.remaining
        options = replace(self._options, persistent=is_thorough)
        calls = (Asked(problem, options, until) for problem in posed)
        for done in run_many(planned, calls, self._executor):
            proposal = proposals[done.index]
            self._clock.announce(Progress(f"tried: {proposal.text}"))
            answer = done.value or Answer()  # a process that died has none
            if answer.is_cut_short:
                raise TimeLimitReached
            self.count += 1
            yield done.index, Trial(asked[done.index][1], proposal, answer.duration, is_thorough)


@dataclass(frozen=True)
class Asked:
    """What is to be planned, ready to travel.

    Attributes:
        problem: The problem with its change.
        options: How to plan it; the time limit is the longest that it may take.
        until: When there is no time left, by `time.monotonic`.
    """

    problem: PosedProblem
    options: PlanOptions
    until: float


@dataclass(frozen=True)
class Answer:
    """What came of it.

    Attributes:
        duration: Of the certified motion [s]; None if none was found.
        is_cut_short: Whether there was no time left.
    """

    duration: float | None = None
    is_cut_short: bool = False


def planned(asked: Asked) -> Answer:
    """Plan a problem with its change.

    Raises:
        KeyboardInterrupt: Ctrl-C.
    """
    left = asked.until - time.monotonic()
    if left <= 0:
        return Answer(is_cut_short=True)
    longest = asked.options.time_limit or left
    try:
        problem = asked.problem.load()
        result = plan_either(problem, replace(asked.options, time_limit=min(longest, left)))
    except TubePlannerError:
        return Answer()
    if result.stopped_by == "interrupt":
        raise KeyboardInterrupt
    is_late = time.monotonic() >= asked.until
    return Answer(result.duration, is_cut_short=is_late and not result.succeeded)


# ---- Where a change begins to matter: between a size that was seen to be enough and one that was
# not.
#
# What is possible is taken to stay possible as a remedy grows, and the impossible to stay
# impossible as a change for the worse does.
#
# Most of the time goes into plans that find nothing. So sizes are tried quickly at first, and only
# those in vain that a bracket ends at once more, thoroughly.

CLOSE = 1.05  # the ratio at which the search ends, of sizes and of what they leave
# Where one of the sizes is not known. What is found is found quickly: so steps down are smaller.
_STEP_UP, _STEP_DOWN = 10.0, 10.0**0.5
_SMALLEST = 1e-3  # of the scale: below that nobody asks
_LEAST_LEFT = 2e-3  # of a quantity that sizes are taken off: likewise


@dataclass
class SizeBracket:
    """Two sizes of one change on either side of where it begins to matter.

    Attributes:
        change: The change.
        helps: Whether it makes possible what is not; else it makes impossible what is.
        smaller: The largest size that does not do so; None: none is known.
        larger: The smallest size that does; None: none is known.
    """

    change: Change
    helps: bool
    smaller: Trial | None = None
    larger: Trial | None = None

    @property
    def impossible(self) -> Trial | None:
        """The refused trial nearest to the decisive size; None if all were certified."""
        return self.smaller if self.helps else self.larger

    @property
    def is_close(self) -> bool:
        """Whether nothing is left to be found out."""
        if self.smaller is None or self.larger is None:
            return False
        smaller, larger = self.smaller.size, self.larger.size
        if larger > CLOSE * smaller:
            return False
        if not self.change.is_loss or _middle(smaller, larger) in (smaller, larger):
            return True
        left = self.change.scale - larger
        return larger - smaller <= max((CLOSE - 1) * left, _LEAST_LEFT * self.change.scale)

    @property
    def is_done(self) -> bool:
        """Whether it is close, or there are no sizes left to try."""
        if self.is_close or (self.change.is_switch and (self.smaller or self.larger)):
            return True
        if self.smaller is None:
            least = _SMALLEST * self.change.scale
            return self.larger is not None and self.larger.size <= least
        return self.larger is None and self.smaller.size >= rounded(self.change.most)

    @property
    def cost(self) -> float:
        """The smallest size that matters over its scale; infinite while none is known."""
        return float("inf") if self.larger is None else self.larger.size / self.change.scale

    def keep(self, trial: Trial) -> None:
        """Keep what a trial shows: it counts more than what was seen of its size before."""
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
        """Return the size to try next; None: there is none.

        Args:
            is_thorough: Whether what was tried in vain quickly is tried once more.
        """
        if not self.is_done:
            return self.next_size
        vain = self.impossible
        return vain.size if is_thorough and vain is not None and not vain.is_thorough else None

    @property
    def next_size(self) -> float:
        """The size to try next: the geometric mean, or beyond the one that is known."""
        most = self.change.most
        if self.smaller is None and self.larger is None:
            return rounded(min(self.change.scale / 3, most))
        if self.smaller is None:
            assert self.larger is not None
            return rounded(self.larger.size / _STEP_DOWN)
        if self.larger is None:
            return rounded(min(self.smaller.size * _STEP_UP, most))
        return _middle(self.smaller.size, self.larger.size)


def _middle(smaller: float, larger: float) -> float:
    return rounded((smaller * larger) ** 0.5)


def open_sizes(
    brackets: Iterable[SizeBracket], is_thorough: bool
) -> list[tuple[SizeBracket, float]]:
    """Return the brackets of which something is to be tried next, and by which size."""
    sizes = [(bracket, bracket.open_size(is_thorough)) for bracket in brackets]
    return [(bracket, size) for bracket, size in sizes if size is not None]


def try_sizes(
    trials: Trials, asked: Sequence[tuple[SizeBracket, float]], is_thorough: bool
) -> None:
    """Try the changes of brackets by sizes; each bracket keeps what that shows, once it is known.

    Args:
        trials: What plans.
        asked: The brackets, and a size for each.
        is_thorough: Whether planning goes on where its first start leads nowhere.

    Raises:
        TimeLimitReached: There is no time left.
        KeyboardInterrupt: Ctrl-C.
    """
    sizes = [(bracket.change, size) for bracket, size in asked]
    for place, trial in trials.of(sizes, is_thorough):
        asked[place][0].keep(trial)
