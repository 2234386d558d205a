"""Branches of the arm along a problem's tube, each computed once, on first use."""

from collections.abc import Callable
from functools import partial

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.branches.joint_lines import joint_lines
from tubeplanner.branches.reference_branch import (
    RedundancyRule,
    ReferenceBranch,
    end_configuration,
    redundancy_rules,
    reference_branch,
)
from tubeplanner.outcome import Infeasible
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.progress import PlanningClock
from tubeplanner.verification.refusal import require_free

_JOINT_LINES, _POSITION_ONLY = "joint lines", "position only"


class KnownBranches:
    """Branches by the rule for redundant joints, and joint lines."""

    def __init__(self, problem: PlanningProblem, clock: PlanningClock) -> None:
        self._problem, self._clock = problem, clock
        self._found: dict[str, ReferenceBranch | Infeasible] = {}
        self._ends: FloatArray | Infeasible | None = None

    @property
    def has_any(self) -> bool:
        """Whether there is a branch already."""
        return any(isinstance(found, ReferenceBranch) for found in self._found.values())

    @property
    def tried(self) -> int:
        """How many were looked for."""
        return len(self._found)

    def under(self, clock: PlanningClock) -> "KnownBranches":
        """Return the same branches for work under another clock."""
        same = KnownBranches(self._problem, clock)
        same._found, same._ends = self._found, self._ends
        return same

    def require_ends(self) -> FloatArray:
        """Return the start and, unless it is open, the goal: shape (1 or 2, n).

        Raises:
            Infeasible: A seed does not lead there, one of them is in collision or too near to an
                obstacle.
            TimeLimitReached: Before that was known.
        """
        if self._ends is None:
            self._clock.enter("start and goal")
            try:
                self._ends = self._free_ends()
            except Infeasible as reason:
                self._ends = reason
        if isinstance(self._ends, Infeasible):
            raise self._ends
        return self._ends

    def by_rule(self, rule: RedundancyRule) -> ReferenceBranch:
        """Return the branch of a rule, its ends clear of everything.

        Raises:
            Infeasible: The branch ends somewhere, its start or given goal is in collision, or the
                time limit has passed.
        """
        search = partial(reference_branch, self._problem, rule, self._clock.check)
        return self._once(rule, "inverse kinematics along the reference path", search)

    def position_only(self) -> ReferenceBranch:
        """Return a branch whose tool need not keep the rotation tolerance.

        Raises:
            Infeasible: As for branches.
        """
        rule = redundancy_rules(self._problem)[0]
        search = partial(
            reference_branch, self._problem, rule, self._clock.check, with_rotation=False
        )
        return self._once(_POSITION_ONLY, "inverse kinematics of the tool's position alone", search)

    def joint_lines(self) -> ReferenceBranch:
        """Return joint lines between the reference points, the tool not in the tube.

        Raises:
            Infeasible: As for branches.
        """
        search = partial(joint_lines, self._problem)
        return self._once(_JOINT_LINES, "inverse kinematics at the reference points", search)

    def _once(
        self, name: str, stage: str, search: Callable[[], ReferenceBranch]
    ) -> ReferenceBranch:
        self.require_ends()
        if name not in self._found:
            self._clock.enter(stage)
            try:
                self._found[name] = search()
            except Infeasible as reason:
                self._found[name] = reason
        found = self._found[name]
        if isinstance(found, Infeasible):
            raise found
        return found

    def _free_ends(self) -> FloatArray:
        problem = self._problem
        ends = [end_configuration(problem, problem.start, 0)]
        is_given = isinstance(problem.start, np.ndarray)
        require_free(problem, "start", ends[0], is_given=is_given)
        if problem.given_goal is not None:  # an open one may move
            ends.append(end_configuration(problem, problem.given_goal, -1))
            is_given = isinstance(problem.given_goal, np.ndarray)
            require_free(problem, "goal", ends[1], is_given=is_given)
        return np.array(ends)
