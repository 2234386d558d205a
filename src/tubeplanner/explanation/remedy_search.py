"""The smallest single changes that make a problem possible, the likeliest tried first."""

from collections.abc import Sequence

from tubeplanner.explanation.change import Change, rounded
from tubeplanner.explanation.remedy import Remedy
from tubeplanner.explanation.size_bracket import SizeBracket, try_sizes
from tubeplanner.explanation.trials import Trials

_SIDE_BY_SIDE = 4  # brackets narrowed at a time, on however many processors: answers are the same


class RemedySearch:
    """Looks for remedies; may be stopped at any time, and has what was found until then."""

    def __init__(self, trials: Trials, groups: Sequence[Sequence[Change]]) -> None:
        """Take what plans, and the changes in question, the group of the likeliest first."""
        self._trials = trials
        self._groups = [[SizeBracket(change, helps=True) for change in group] for group in groups]
        self._brackets = [bracket for group in self._groups for bracket in group]

    def run(self) -> None:
        """Try changes by their scale, then by as much as makes sense, and narrow what helps.

        The least likely are tried only if nothing else helps.

        Raises:
            TimeLimitReached: There is no time left.
            KeyboardInterrupt: Ctrl-C.
        """
        *likely, unlikely = self._groups
        for group in likely:
            self._search(group)
        if not self._helpful:
            self._search(unlikely)

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

    def _search(self, group: Sequence[SizeBracket]) -> None:
        for times in (1.0, float("inf")):
            sizes = [
                (one, rounded(min(times * one.change.scale, one.change.most))) for one in group
            ]
            try_sizes(self._trials, [(one, size) for one, size in sizes if _is_new(one, size)])
            self._narrow()

    def _narrow(self) -> None:
        """Narrow the brackets of what helps until all are done, always the smallest of them."""
        while open_ones := [bracket for bracket in self._helpful if not bracket.is_done]:
            smallest = sorted(open_ones, key=lambda bracket: bracket.cost)[:_SIDE_BY_SIDE]
            try_sizes(self._trials, [(bracket, bracket.next_size) for bracket in smallest])


def _is_new(bracket: SizeBracket, size: float) -> bool:
    """Return whether nothing is known yet of a size, and of none beyond it that helps."""
    return bracket.larger is None and (bracket.smaller is None or size > bracket.smaller.size)


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
        is_smallest=bracket.is_done,
    )
