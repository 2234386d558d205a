"""Remedies: smallest single change that helps; headroom of each quantity."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from typing import Any

from tubeplanner.studies.change_trials import SizeBracket, Trials, open_sizes, try_sizes
from tubeplanner.studies.changes import Change, Question, rounded
from tubeplanner.studies.geometry_changes import clearance_changes, obstacle_changes, radius_changes
from tubeplanner.studies.joint_changes import effort_changes, payload_changes
from tubeplanner.text import json_value, short_repr

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
        fields = asdict(self)
        first = {"field": self.field, "from": fields.pop("before"), "to": fields.pop("after")}
        first |= {"unit": self.unit, "certified": True}
        return json_value({**first, **fields})


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
        fields = asdict(self)
        first = {"field": self.field, "from": fields.pop("before"), "to": fields.pop("after")}
        return json_value({**first, **fields})


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
    """Yield narrower radii, larger clearances and payloads, less effort, moved obstacles."""
    yield from radius_changes(question, -1)
    yield from clearance_changes(question, 1)
    yield from payload_changes(question, 1)
    yield from effort_changes(question, -1)
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
