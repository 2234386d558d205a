"""How much worse single quantities of a problem may become until nothing is found any more."""

from collections.abc import Iterable, Iterator

from tubeplanner.explanation.cell_changes import clearance_changes, obstacle_changes
from tubeplanner.explanation.change import Change
from tubeplanner.explanation.limit_changes import effort_changes, payload_changes
from tubeplanner.explanation.question import Question
from tubeplanner.explanation.remedy import Room
from tubeplanner.explanation.size_bracket import SizeBracket, open_sizes, try_sizes
from tubeplanner.explanation.trials import Trials
from tubeplanner.explanation.tube_changes import radius_changes


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
