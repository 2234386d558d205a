"""Planning with changes, to see which help, for as long as there is time."""

import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

from tubeplanner.errors import TubePlannerError
from tubeplanner.explanation.change import Change, Proposal
from tubeplanner.explanation.question import Question
from tubeplanner.many.plan_either import plan_either
from tubeplanner.many.posed_problem import PosedProblem
from tubeplanner.many.run_many import run_many
from tubeplanner.planning.plan_options import PlanOptions
from tubeplanner.progress import PlanningClock, Progress, TimeLimitReached

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
