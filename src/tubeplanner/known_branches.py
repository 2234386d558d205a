"""The branches along the reference path of one problem, each found once, when asked for."""

from tubeplanner.outcome import Infeasible
from tubeplanner.problem import PlanningProblem
from tubeplanner.progress import PlanningClock
from tubeplanner.reference_branch import ReferenceBranch, SpareJoints, reference_branch
from tubeplanner.refusal import require_free


class KnownBranches:
    """Branches by the rule that moves the joints which the hand leaves free."""

    def __init__(self, problem: PlanningProblem, clock: PlanningClock) -> None:
        self._problem, self._clock = problem, clock
        self._found: dict[SpareJoints, ReferenceBranch | Infeasible] = {}

    def along(self, rule: SpareJoints) -> ReferenceBranch:
        """Return the branch of a rule, its ends clear of everything.

        Raises:
            Infeasible: The branch ends somewhere, or its start or goal is in collision; or the
                time limit has passed.
        """
        self._clock.enter("inverse kinematics along the reference path")
        if rule not in self._found:
            try:
                self._found[rule] = self._search(rule)
            except Infeasible as reason:
                self._found[rule] = reason
        found = self._found[rule]
        if isinstance(found, Infeasible):
            raise found
        return found

    def _search(self, rule: SpareJoints) -> ReferenceBranch:
        branch = reference_branch(self._problem, rule, self._clock.check)
        for name, q in (("start", branch.start), ("goal", branch.goal)):
            require_free(self._problem, name, q)
        return branch
