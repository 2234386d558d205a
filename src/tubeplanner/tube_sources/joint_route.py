"""Collision-free routes in joint space, found by OMPL.

Sucan, Moll & Kavraki, "The Open Motion Planning Library" (IEEE Robotics & Automation Magazine
19(4), 2012); Kuffner & LaValle, "RRT-Connect" (ICRA 2000). Only this module knows OMPL.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import OptionError
from tubeplanner.extras import not_installed
from tubeplanner.tube_sources.free_space import FreeSpace

_STEP = 0.05  # [rad or m] between configurations tested along an edge
# How far beyond start and goals joints may go that have no nearer limit [rad or m].
_BEYOND = np.pi
_MIN_SPAN = 1e-6  # [rad or m]: OMPL wants bounds that differ
_SHORTENINGS = 5


def require_ompl() -> None:
    """Raise unless OMPL is installed, before any work.

    Raises:
        OptionError: It is not installed.
    """
    try:
        import ompl.base
    except ImportError:
        raise OptionError(not_installed("route", "finding a route", "OMPL 2")) from None
    _ = ompl.base


class RouteSearch:
    """A search from one configuration to any of some others; the same for the same seed.

    Attributes:
        checks: How many configurations the last search tested.
        reached: Of the last search that found no route, the configuration (n,) nearest to a goal
            that was reached from the start.
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
            space: Which configurations are free.
            start: Shape (n,) [rad or m].
            goals: Configurations, one of which it must reach, shape (G, n).
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
            budget: Most configurations to look at before there is a route.
            is_over: Whether there is no time left to look for one.
        """
        with _silent_ompl():
            return self._route(seed, budget, is_over)

    def _route(self, seed: int, budget: int, is_over: Callable[[], bool]) -> FloatArray | None:
        from ompl import base, geometric, util

        util.RNG.setSeed(seed)
        self.checks = 0
        setup = self._setup()
        setup.setPlanner(geometric.RRTConnect(setup.getSpaceInformation()))
        setup.solve(base.PlannerTerminationCondition(lambda: self.checks >= budget or is_over()))
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

    def _setup(self) -> Any:
        from ompl import base, geometric

        setup = geometric.SimpleSetup(self._states)
        setup.setStateValidityChecker(self._is_valid)
        information = setup.getSpaceInformation()
        information.setStateValidityCheckingResolution(_STEP / information.getMaximumExtent())
        setup.setStartState(self._state(self._start))
        wanted = base.GoalStates(information)
        for goal in self._goals:
            wanted.addState(self._state(goal))
        setup.setGoal(wanted)
        return setup

    def _is_valid(self, state: Any) -> bool:
        self.checks += 1
        return self._space.is_free(self._values(state))

    def _state(self, q: FloatArray) -> Any:
        state = self._states.allocState()
        for j, value in enumerate(q):
            state[j] = float(value)
        return state

    def _values(self, state: Any) -> FloatArray:
        return np.array([state[j] for j in range(len(self._start))])

    def _corners(self, path: Any) -> FloatArray:
        return np.array([self._values(state) for state in path.getStates()])


@contextmanager
def _silent_ompl() -> Iterator[None]:
    """Keep OMPL from logging to standard output, for as long as it works for us."""
    from ompl import util

    util.noOutputHandler()
    try:
        yield
    finally:
        util.restorePreviousOutputHandler()
