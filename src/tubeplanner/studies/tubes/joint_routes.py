"""Free configurations; collision-free joint routes by OMPL."""

from collections.abc import Callable
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import OptionError, not_installed
from tubeplanner.outcome import Location
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.required_distances import RequiredDistances

# ---- Free configurations: links clear of obstacles and of each other, by a margin.

# Where an end of the trajectory has less clearance than the margin, this fraction of that clearance
# is kept everywhere.
_FRACTION_AT_ENDS = 0.9


class FreeSpace:
    """The configurations in which links are farther apart than a problem requires."""

    def __init__(self, problem: PlanningProblem, margin: float, ends: FloatArray) -> None:
        """Take the pairs of a problem.

        Args:
            problem: Its arm, obstacles and clearance count; its tube does not.
            margin: Required distance beyond the clearance [m].
            ends: Configurations (E, n), at least one, from start to goal: pairs of shapes that are
                nearer there need not be farther apart elsewhere.
        """
        checker = problem.collision
        self._robot, self._checker = problem.robot, checker
        self._pairs = checker.pairs
        self._requirement = RequiredDistances(problem, ends[0], ends[-1])
        self._margin = np.zeros(len(self._pairs))
        if margin > 0:
            least = np.min([self._clearances(q) for q in ends], axis=0, initial=margin)
            self._margin = np.clip(_FRACTION_AT_ENDS * least, 0.0, margin)

    def is_free(self, q: FloatArray) -> bool:
        """Return True if a configuration (n,) has the margin."""
        return self.shortfall(q) is None

    def shortfall(self, q: FloatArray) -> Location | None:
        """Return the closest links and the tool's position where the margin is missing, or None."""
        rotation, position = self._robot.body_poses(q[None])
        required = self._required(q) + self._margin
        quick = self._checker.sphere_distances(rotation, position, self._pairs)[0] - required
        near = np.flatnonzero(quick < 0)
        alone = np.zeros(len(near), dtype=np.int64)
        boxes = self._checker.box_distances(rotation, position, alone, self._pairs[near])
        near = near[boxes < required[near]]
        distance = self._checker.distances(rotation[0], position[0], self._pairs[near])
        short = distance - required[near]
        if short.min(initial=0.0) >= 0:
            return None
        links, obstacle = self._checker.owners(self._pairs[near[short.argmin()]])
        return Location(links=links, obstacle=obstacle).at(self._robot.tool_position(q[None])[0])

    def clearance(self, q: FloatArray) -> float:
        """Return the least distance beyond the clearance at a configuration (n,) [m]."""
        return float(self._clearances(q).min(initial=np.inf))

    def _clearances(self, q: FloatArray) -> FloatArray:
        rotation, position = self._robot.body_poses(q[None])
        return self._checker.distances(rotation[0], position[0], self._pairs) - self._required(q)

    def _required(self, q: FloatArray) -> FloatArray:
        return self._requirement.anywhere(self._robot.tool_position(q[None]))[0]


# ---- Collision-free routes in joint space, found by OMPL.
#
# Sucan, Moll & Kavraki, "The Open Motion Planning Library" (IEEE Robotics & Automation Magazine
# 19(4), 2012); Kuffner & LaValle, "RRT-Connect" (ICRA 2000). Only this module knows OMPL.

_STEP = 0.05  # [rad or m] between configurations tested along an edge
# Joint ranges of the search beyond start and goals, unless limits are nearer [rad or m].
_BEYOND = np.pi
_MIN_SPAN = 1e-6  # [rad or m]: OMPL wants bounds that differ
_SHORTENINGS = 5


def require_ompl() -> None:
    """Check that OMPL is installed, before any work.

    Raises:
        OptionError: It is not installed.
    """
    try:
        import ompl.base
    except ImportError:
        raise OptionError(not_installed("route", "finding a route", "OMPL 2")) from None
    _ = ompl.base


class RouteSearch:
    """A search from a configuration to any of several goals; the same for the same seed.

    Attributes:
        checks: Number of configurations tested by the last search.
        reached: Configuration (n,) nearest to a goal that the last search without a route reached
            from the start.
    """

    def __init__(
        self,
        space: FreeSpace,
        start: FloatArray,
        goals: FloatArray,
        lower: FloatArray,
        upper: FloatArray,
    ) -> None:
        """Prepare a search.

        Args:
            space: The free configurations.
            start: Shape (n,) [rad or m].
            goals: Configurations, any of which ends the search, shape (G, n).
            lower: Lower position limits, shape (n,).
            upper: Upper position limits, shape (n,).

        Raises:
            OptionError: OMPL is not installed.
        """
        require_ompl()
        from ompl import base

        self._space, self._start, self._goals = space, start, goals
        ends = np.vstack([start, *goals])
        least, most = ends.min(axis=0), ends.max(axis=0)
        low = np.minimum(np.maximum(lower, least - _BEYOND), least)
        high = np.maximum(np.minimum(upper, most + _BEYOND), most)
        self._states = base.RealVectorStateSpace(0)
        for bounds in zip(low, np.maximum(high, low + _MIN_SPAN), strict=True):
            self._states.addDimension(*(float(bound) for bound in bounds))
        self.checks = 0
        self.reached = start

    def route(
        self, seed: int, budget: int, is_over: Callable[[], bool] = lambda: False
    ) -> FloatArray | None:
        """Return the corners (P, n) of a free route, shortened; None if none was found.

        Args:
            seed: Of OMPL's random numbers, > 0; they are one stream for the whole process.
            budget: Largest number of configurations to test before there is a route.
            is_over: True if the time for the search is over.
        """
        from ompl import base, geometric, util

        def is_valid(state: Any) -> bool:
            self.checks += 1
            return self._space.is_free(self._values(state))

        util.noOutputHandler()  # OMPL logs to standard output
        try:
            util.RNG.setSeed(seed)
            self.checks = 0
            setup = geometric.SimpleSetup(self._states)
            setup.setStateValidityChecker(is_valid)
            information = setup.getSpaceInformation()
            information.setStateValidityCheckingResolution(_STEP / information.getMaximumExtent())
            setup.setStartState(self._state(self._start))
            goals = base.GoalStates(information)
            for goal in self._goals:
                goals.addState(self._state(goal))
            setup.setGoal(goals)
            setup.setPlanner(geometric.RRTConnect(information))
            is_done = base.PlannerTerminationCondition(lambda: self.checks >= budget or is_over())
            setup.solve(is_done)
            if not setup.haveSolutionPath():
                return None
            path = setup.getSolutionPath()
            if not setup.haveExactSolutionPath():
                self.reached = self._corners(path)[-1]
                return None
            simplifier = setup.getPathSimplifier()
            for _ in range(_SHORTENINGS):
                simplifier.reduceVertices(path)
                simplifier.partialShortcutPath(path)
                simplifier.collapseCloseVertices(path)
            return self._corners(path)
        finally:
            util.restorePreviousOutputHandler()

    def _state(self, q: FloatArray) -> Any:
        state = self._states.allocState()
        for j, value in enumerate(q):
            state[j] = float(value)
        return state

    def _values(self, state: Any) -> FloatArray:
        return np.array([state[j] for j in range(len(self._start))])

    def _corners(self, path: Any) -> FloatArray:
        return np.array([self._values(state) for state in path.getStates()])
