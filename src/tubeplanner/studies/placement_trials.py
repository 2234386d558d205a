"""Places of a robot tried side by side, each once: those of former runs are in a journal."""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor

from tubeplanner.many.run_many import Done, run_many
from tubeplanner.outcome import PlanStatus
from tubeplanner.planning.plan_options import PlanOptions
from tubeplanner.studies.journal import Journal
from tubeplanner.studies.movable_problem import MovableProblem
from tubeplanner.studies.placement_region import Stand
from tubeplanner.studies.placement_row import PlacementRow, tried

# Shortest motions: what is searched for is where they are short. Errors to survive come at the end.
SEARCH_OPTIONS = PlanOptions(quality="fast", slack=0.0, robust=False)


class PlacementTrials:
    """What is known of the places of one problem's robot.

    Attributes:
        restored: How many were found in the journal.
    """

    def __init__(
        self,
        problem: MovableProblem,
        stands_on: Sequence[str],
        journal: Journal | None,
    ) -> None:
        """Know nothing yet.

        Args:
            problem: The problem.
            stands_on: Names of obstacles that links which no joint moves may touch.
            journal: Where answers are kept, and looked for first; None: nowhere.
        """
        self._problem, self._stands_on = problem, tuple(sorted(stands_on))
        self._journal = journal
        self._found: dict[Stand, PlacementRow] = {}
        self._order: dict[Stand, int] = {}  # in which they were asked for
        self.restored = 0

    @property
    def rows(self) -> tuple[PlacementRow, ...]:
        """All that is known, in the order in which it was asked for."""
        return tuple(sorted(self._found.values(), key=lambda row: self._order[row.stand]))

    def of(
        self, stands: Sequence[Stand], executor: Executor, report: Callable[[int, int], None]
    ) -> list[PlacementRow]:
        """Return what comes of some stands, in their order; what is not known is tried.

        Args:
            stands: Where the robot is to stand.
            executor: What tries them.
            report: Called with how many of those that are new are done, and how many there are.
        """
        asked = [stand for stand in dict.fromkeys(stands) if stand not in self._found]
        self._order.update({stand: len(self._order) + k for k, stand in enumerate(asked)})
        missing = [stand for stand in asked if not self._restored(stand)]
        calls = [(self._problem, stand, self._stands_on, SEARCH_OPTIONS) for stand in missing]
        report(0, len(missing))
        for count, done in enumerate(run_many(tried, calls, executor), start=1):
            self._keep(missing[done.index], done)
            report(count, len(missing))
        return [self._found[stand] for stand in stands]

    def _restored(self, stand: Stand) -> bool:
        """Return whether the journal knows a stand, and take what it says."""
        if self._journal is None:
            return False
        key = self._key(stand)
        if key not in self._journal:
            return False
        self._found[stand] = self._journal.made(key, PlacementRow.of_dict)
        self.restored += 1
        return True

    def _keep(self, stand: Stand, done: Done[PlacementRow]) -> None:
        row = done.value
        if row is None:
            message = f"{type(done.error).__name__}: {done.error}"
            row = PlacementRow(stand, str(PlanStatus.CRASHED), message)
        self._found[stand] = row
        if self._journal is not None:
            base = self._problem.changes(stand)["robot.base"]
            values = {f"robot.base.{key}": value for key, value in base.items()}
            self._journal.add(self._key(stand), values, row.as_dict())

    def _key(self, stand: Stand) -> str:
        """Return a hash of all that a row depends on: not that of the plan alone."""
        planned = self._problem.at(stand).content_hash(SEARCH_OPTIONS)
        return f"{planned} standing on {', '.join(self._stands_on) or 'nothing'}"
