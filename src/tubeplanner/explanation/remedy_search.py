"""The smallest single changes that make a problem possible, the likeliest tried first."""

from collections.abc import Sequence
from itertools import product

from tubeplanner.explanation.change import Change, rounded
from tubeplanner.explanation.remedy import Remedy
from tubeplanner.explanation.size_bracket import SizeBracket, open_sizes, try_sizes
from tubeplanner.explanation.trials import Trials

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
