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

# ---- What was found by planning with a change: a remedy, or how much room there is.


@dataclass(frozen=True)
class Remedy:
    """A single change that makes a problem possible: planning with it was certified.

    Attributes:
        field: Path of what is changed.
        before: Its value as it is.
        after: Its value then.
        unit: Of the value; empty: none.
        duration: Of the certified motion with it [s].
        text: The change in words.
        changes: Values by field path that make it, as `load_problem` takes them.
        cost: The change over its scale: the value itself, 0.1 m or 0.1 rad.
        too_little: The largest value that was tried and not enough; None: none was.
        too_little_text: The same in words; empty: none was.
        is_smallest: Whether that is within 5 % of the change.
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

    def as_dict(self) -> dict[str, Any]:
        """Return the remedy as JSON values; infinity is `.inf`."""
        fields = asdict(self)
        first = {"field": self.field, "from": fields.pop("before"), "to": fields.pop("after")}
        first |= {"unit": self.unit, "certified": True}
        return json_value({**first, **fields})


@dataclass(frozen=True)
class Room:
    """How far one quantity of a problem may change for the worse until nothing is found any more.

    Attributes:
        field: Path of what is changed.
        before: Its value as it is.
        after: The worst value with which a motion was certified; None: none was found.
        unit: Of the value; empty: none.
        duration: Of that motion [s]; None without one.
        text: The room in words.
        too_much: The mildest value with which none was found; None: all that was tried is possible.
        too_much_text: The same in words; empty: all is.
        is_exact: Whether that is within 5 % of the change.
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

    def as_dict(self) -> dict[str, Any]:
        """Return the room as JSON values; infinity is `.inf`."""
        fields = asdict(self)
        first = {"field": self.field, "from": fields.pop("before"), "to": fields.pop("after")}
        return json_value({**first, **fields})


# ---- The smallest single changes that make a problem possible, the likeliest tried first.

_SIDE_BY_SIDE = 4  # brackets narrowed at a time, on however many processors: answers are the same


class RemedySearch:
    """Looks for remedies; may be stopped at any time, and has what was found until then."""

    def __init__(self, trials: Trials, tiers: Sequence[Sequence[Sequence[Change]]]) -> None:
        """Take what plans, and the changes in question, as `in_order` returns them."""
        self._trials = trials
        self._tiers = [
            [[SizeBracket(change, helps=True) for change in group] for group in tier]
            for tier in tiers
        ]
        self._brackets = [one for tier in self._tiers for group in tier for one in group]

    def run(self) -> None:
        """Try changes by their scale, then by as much as makes sense, and narrow what helps.

        The least likely are tried only if nothing else helps. Quickly at first; then what helps is
        looked at where it ends, and if nothing does, all is tried once more.

        Raises:
            TimeLimitReached: There is no time left.
            KeyboardInterrupt: Ctrl-C.
        """
        self._search_all(is_thorough=False)
        self._narrow(is_thorough=True)
        if not self._helpful:
            self._search_all(is_thorough=True)

    @property
    def remedies(self) -> tuple[Remedy, ...]:
        """What was found, the smallest for its scale first."""
        return tuple(map(_remedy, sorted(self._helpful, key=lambda bracket: bracket.cost)))

    @property
    def in_vain(self) -> tuple[str, ...]:
        """Paths of what helps in no direction, by as much as makes sense."""
        tried = [one for one in self._brackets if one.larger is None and one.is_done]
        helpful = {bracket.change.field for bracket in self._helpful}
        fields = dict.fromkeys(bracket.change.field for bracket in tried)
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
        for times, group in product((1.0, float("inf")), tier):
            sizes = [
                (one, rounded(min(times * one.change.scale, one.change.most))) for one in group
            ]
            new = [(one, size) for one, size in sizes if _is_new(one, size, is_thorough)]
            try_sizes(self._trials, new, is_thorough)
            self._narrow(is_thorough)

    def _narrow(self, is_thorough: bool) -> None:
        """Narrow the brackets of what helps until all are done, always the smallest of them."""
        while sizes := open_sizes(self._helpful, is_thorough):
            smallest = sorted(sizes, key=lambda each: each[0].cost)[:_SIDE_BY_SIDE]
            try_sizes(self._trials, smallest, is_thorough)


def _is_new(bracket: SizeBracket, size: float, is_thorough: bool) -> bool:
    """Return whether nothing is known yet of a size, and of none beyond it that helps."""
    if bracket.larger is not None:
        return False
    tried = bracket.smaller
    return tried is None or size > tried.size or (is_thorough and not tried.is_thorough)


def _remedy(bracket: SizeBracket) -> Remedy:
    found, missed, change = bracket.larger, bracket.smaller, bracket.change
    assert found is not None and found.duration is not None
    return Remedy(
        field=change.field,
        before=change.before,
        after=found.proposal.after,
        unit=change.unit,
        duration=found.duration,
        text=found.proposal.text + " would work" * change.is_switch,
        changes=found.proposal.changes,
        cost=bracket.cost,
        too_little=None if missed is None else missed.proposal.after,
        too_little_text="" if missed is None else missed.proposal.brief,
        is_smallest=bracket.is_done,
    )


# ---- How much worse single quantities of a problem may become until nothing is found any more.


def worsening_changes(question: Question) -> Iterator[Change]:
    """Yield narrower radii, larger clearances and payloads, less effort, obstacles elsewhere."""
    yield from radius_changes(question, -1)
    yield from clearance_changes(question, 1)
    yield from payload_changes(question, 1)
    yield from effort_changes(question, -1)
    yield from obstacle_changes(question)


class RoomSearch:
    """Looks for the room; may be stopped at any time, and has what was found until then."""

    def __init__(self, trials: Trials, changes: Iterable[Change]) -> None:
        """Take what plans, and the changes for the worse."""
        self._trials = trials
        self._brackets = [SizeBracket(change, helps=False) for change in changes]

    def run(self) -> None:
        """Narrow the brackets of all changes in turns, quickly, then look where that ends.

        Raises:
            TimeLimitReached: There is no time left.
            KeyboardInterrupt: Ctrl-C.
        """
        for is_thorough in (False, True):
            while sizes := open_sizes(self._brackets, is_thorough):
                try_sizes(self._trials, sizes, is_thorough)

    @property
    def rooms(self) -> tuple[Room, ...]:
        """What was found, the least room for its scale first."""
        known = [bracket for bracket in self._brackets if bracket.smaller or bracket.larger]
        return tuple(map(_room, sorted(known, key=lambda bracket: bracket.cost)))


def _room(bracket: SizeBracket) -> Room:
    good, bad, change = bracket.smaller, bracket.larger, bracket.change
    if good is not None:
        text = good.proposal.text
    else:
        assert bad is not None
        text = f"not even {bad.proposal.text}"
    return Room(
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
