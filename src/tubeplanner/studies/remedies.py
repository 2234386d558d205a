"""Remedies: smallest single change that helps; headroom of each quantity; trials and brackets."""

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, replace
from itertools import product
from typing import Any

from tubeplanner.outcome import PlanningClock, Progress, TimeLimitReached
from tubeplanner.planning.options import PlanOptions
from tubeplanner.studies.change_kinds import (
    clearance_changes,
    effort_changes,
    holding_changes,
    obstacle_changes,
    payload_changes,
    radius_changes,
    tool_limit_changes,
)
from tubeplanner.studies.changes import Change, Proposal, Question, rounded
from tubeplanner.studies.problem_spec import ProblemSpec
from tubeplanner.studies.rows import PlannedRow, run_many
from tubeplanner.text import json_value, short_repr

# ---- Trials: plans with one change each, within a time budget.

# No trial may take a larger fraction of the whole time, so that others have their turn.
_MAX_FRACTION = 0.1
_MIN_TIME = 2.0  # [s]


@dataclass(frozen=True)
class Trial:
    """The result of planning with a change."""

    size: float  # size of the change
    proposal: Proposal  # the change by that size
    duration: float | None  # duration of the certified motion [s]; None if there is none
    is_thorough: bool = True  # True if planning went on where its first start led nowhere

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
        specs = (self._question.spec.changed(each.changes) for each in proposals)
        until = time.monotonic() + self._clock.remaining
        quick = replace(self._options, persistent=is_thorough)
        full = replace(quick, quality=self._quality)
        options = (full if change.kind == "duration" else quick for change, _ in sizes)
        calls = ((*each, until) for each in zip(specs, options, strict=True))
        for done in run_many(planned_duration, calls, self._executor, until):
            proposal = proposals[done.index]
            self._clock.announce(Progress(f"tried: {proposal.text}"))
            if isinstance(done.error, TimeLimitReached):
                raise done.error
            self.count += 1  # a process that died has no motion
            yield done.index, Trial(sizes[done.index][1], proposal, done.value, is_thorough)


def planned_duration(call: tuple[ProblemSpec, PlanOptions, float]) -> float | None:
    """Return the duration of the certified motion of a problem [s]; None if there is none.

    Args:
        call: The problem, planning options with the time limit of this plan, and the end of the
            time for all plans, by `time.monotonic`.

    Raises:
        TimeLimitReached: The time for all plans passed before an answer.
        KeyboardInterrupt: Ctrl-C.
    """
    spec, options, until = call
    remaining = until - time.monotonic()
    if remaining <= 0:
        raise TimeLimitReached
    longest = options.time_limit or remaining
    row = PlannedRow.of(spec, replace(options, time_limit=min(longest, remaining)))
    is_late = time.monotonic() >= until
    if is_late and row.result is not None and not row.result.succeeded:
        raise TimeLimitReached
    return row.duration


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
    """Two sizes of a change on either side of the decisive size."""

    change: Change  # the change
    # True if it makes an impossible problem possible, False if a possible one impossible
    helps: bool
    smaller: Trial | None = None  # of the largest size below the decisive one; None: not known
    larger: Trial | None = None  # of the smallest size above the decisive one; None: not known

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


# ---- Results: remedies and headrooms.


@dataclass(frozen=True)
class Remedy:
    """A single change with which an impossible problem was planned and certified.

    Attributes:
        field: Path of the changed field.
        before: Value before the change.
        after: Value after the change.
        unit: Unit of the value; empty: none.
        duration: Duration of the certified motion with the change [s].
        text: The change in words.
        changes: Values of the change by field path, as `load_problem` takes them.
        cost: Size of the change over its scale: the value itself, 0.1 m or 0.1 rad.
        too_little: The nearest value that was tried and not enough; None: none was.
        too_little_text: `too_little` in words; empty: none was.
        is_smallest: True if `too_little` is within 5 % of the change.
    """

    field: str
    before: Any
    after: Any
    unit: str
    duration: float
    text: str
    changes: Mapping[str, Any]
    cost: float
    too_little: Any
    too_little_text: str
    is_smallest: bool

    __repr__ = short_repr

    @classmethod
    def of(cls, bracket: SizeBracket) -> "Remedy":
        """Return the remedy of a bracket that has a certified motion."""
        enough, too_small, change = bracket.larger, bracket.smaller, bracket.change
        assert enough is not None and enough.duration is not None
        return cls(
            field=change.field,
            before=change.before,
            after=enough.proposal.after,
            unit=change.unit,
            duration=enough.duration,
            text=enough.proposal.text + " would work" * change.is_switch,
            changes=enough.proposal.changes,
            cost=bracket.cost,
            too_little=None if too_small is None else too_small.proposal.after,
            too_little_text="" if too_small is None else too_small.proposal.brief,
            is_smallest=bracket.is_done,
        )

    def as_dict(self) -> dict[str, Any]:
        """Return the remedy as JSON values; infinity is `.inf`."""
        return _as_dict(self, certified=True)


@dataclass(frozen=True)
class Headroom:
    """The headroom of one quantity: its largest change for the worse that leaves a motion.

    Attributes:
        field: Path of the changed field.
        before: Value before the change.
        after: The worst value with a certified motion; None: there is none.
        unit: Unit of the value; empty: none.
        duration: Duration of that motion [s]; None without a motion.
        text: The headroom in words.
        too_much: The mildest value without a motion; None: all values that were tried have a
            motion.
        too_much_text: `too_much` in words; empty if it is None.
        is_exact: True if `too_much` is within 5 % of the change.
    """

    field: str
    before: Any
    after: Any
    unit: str
    duration: float | None
    text: str
    too_much: Any
    too_much_text: str
    is_exact: bool

    __repr__ = short_repr

    @classmethod
    def of(cls, bracket: SizeBracket) -> "Headroom":
        """Return the headroom of a bracket that was tried."""
        good, bad, change = bracket.smaller, bracket.larger, bracket.change
        if good is not None:
            text = good.proposal.text
        else:
            assert bad is not None
            text = f"not even {bad.proposal.text}"
        return cls(
            field=change.field,
            before=change.before,
            after=None if good is None else good.proposal.after,
            unit=change.unit,
            duration=None if good is None else good.duration,
            text=text,
            too_much=None if bad is None else bad.proposal.after,
            too_much_text="" if bad is None else bad.proposal.brief,
            is_exact=bracket.is_done,
        )

    def as_dict(self) -> dict[str, Any]:
        """Return the headroom as JSON values; infinity is `.inf`."""
        return _as_dict(self)


def _as_dict(change: Remedy | Headroom, **more: Any) -> dict[str, Any]:
    fields = asdict(change)
    names = {"field": "field", "from": "before", "to": "after", "unit": "unit"}
    first = {name: fields.pop(attribute) for name, attribute in names.items()}
    return json_value({**first, **more, **fields})


# ---- Search for remedies: the smallest single changes, the likeliest tried first.

_SIDE_BY_SIDE = 4  # brackets narrowed at a time; fixed, so that answers do not depend on processors


class RemedySearch:
    """A search for remedies; it may be stopped at any time and keeps its results so far."""

    def __init__(self, trials: Trials, tiers: Sequence[Sequence[Sequence[Change]]]) -> None:
        """Set the trials, and the changes in tiers of groups, as `in_order` returns."""
        self._trials = trials
        self._tiers = [
            [[SizeBracket(change, helps=True) for change in group] for group in tier]
            for tier in tiers
        ]
        self._brackets = [each for tier in self._tiers for group in tier for each in group]

    def run(self) -> None:
        """Try changes by their scale, then by their largest size, and narrow the helpful changes.

        The least likely kinds are tried only if no other change helps. Trials are quick at first;
        then the ends of brackets are tried thoroughly, and if no change helps, all changes.
        """
        self._search_all(is_thorough=False)
        self._narrow(is_thorough=True)
        if not self._helpful:
            self._search_all(is_thorough=True)

    @property
    def remedies(self) -> tuple[Remedy, ...]:
        """The remedies so far, the smallest for its scale first.

        After the others: those that need another robot, then those not narrowed, of which a field
        has one at most, and only without a narrowed one.
        """
        result: dict[Any, SizeBracket] = {}
        fields = set()
        for bracket in sorted(
            self._helpful,
            key=lambda bracket: (not bracket.is_done, bracket.change.is_of_robot, bracket.cost),
        ):
            assert bracket.larger is not None
            if bracket.is_done or bracket.change.field not in fields:
                result.setdefault(str(bracket.larger.proposal.changes), bracket)
                fields.add(bracket.change.field)
        return tuple(map(Remedy.of, result.values()))

    @property
    def ineffective(self) -> tuple[str, ...]:
        """Paths of fields that help in no direction, up to the largest sensible size."""
        failed = [
            bracket for bracket in self._brackets if bracket.larger is None and bracket.is_done
        ]
        helpful = {bracket.change.field for bracket in self._helpful}
        fields = dict.fromkeys(bracket.change.field for bracket in failed)
        return tuple(field for field in fields if field not in helpful)

    @property
    def _helpful(self) -> list[SizeBracket]:
        return [bracket for bracket in self._brackets if bracket.larger is not None]

    def _search_all(self, is_thorough: bool) -> None:
        *likely, unlikely = self._tiers
        for tier in likely:
            self._search(tier, is_thorough)
        if not self._helpful:
            self._search(unlikely, is_thorough)

    def _search(self, tier: Sequence[Sequence[SizeBracket]], is_thorough: bool) -> None:
        for k, group in product(range(3), tier):
            new = []
            for bracket in group:
                sizes = bracket.change.first_sizes
                size = rounded(sizes[min(k, len(sizes) - 1)])
                failed = bracket.smaller
                if bracket.larger is None and (
                    failed is None or size > failed.size or (is_thorough and not failed.is_thorough)
                ):
                    new.append((bracket, size))
            try_sizes(self._trials, new, is_thorough)
            self._narrow(is_thorough)

    def _narrow(self, is_thorough: bool) -> None:
        """Narrow the brackets of helpful changes until all are done, the smallest first."""
        while sizes := open_sizes(self._helpful, is_thorough):
            smallest = sorted(sizes, key=lambda each: each[0].cost)[:_SIDE_BY_SIDE]
            try_sizes(self._trials, smallest, is_thorough)


# ---- Search for headroom: single quantities made worse until no motion results.


def worsening_changes(question: Question) -> Iterator[Change]:
    """Yield worse values of single quantities: narrower radii, less effort, moved obstacles, ..."""
    yield from radius_changes(question, -1)
    yield from clearance_changes(question, 1)
    yield from payload_changes(question, 1)
    yield from effort_changes(question, -1)
    yield from holding_changes(question, -1)
    yield from tool_limit_changes(question, -1)
    yield from obstacle_changes(question)


class HeadroomSearch:
    """A search for headrooms; it may be stopped at any time and keeps its results so far."""

    def __init__(self, trials: Trials, changes: Iterable[Change]) -> None:
        """Set the trials, and the changes for the worse."""
        self._trials = trials
        self._brackets = [SizeBracket(change, helps=False) for change in changes]

    def run(self) -> None:
        """Narrow the brackets of all changes in turns, quickly, then thoroughly at their ends."""
        for is_thorough in (False, True):
            while sizes := open_sizes(self._brackets, is_thorough):
                try_sizes(self._trials, sizes, is_thorough)

    @property
    def headrooms(self) -> tuple[Headroom, ...]:
        """The headrooms so far, the least for its scale first."""
        brackets = [bracket for bracket in self._brackets if bracket.smaller or bracket.larger]
        return tuple(map(Headroom.of, sorted(brackets, key=lambda bracket: bracket.cost)))
