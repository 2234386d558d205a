"""The modification process: knots are moved until no direction makes the trajectory faster.

Find the discretised gradient, search along it, repeat (Suh & Bishop 1988, phase 2). The paper does
not give the increment: here it is halved whenever no direction helps, from coarse to fine.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.options import require_between, require_count
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.suh_bishop.knot_direction import best_direction
from tubeplanner.suh_bishop.knot_trajectory import KnotTrajectory, feasible_trajectory
from tubeplanner.waypoint_search.link_clearance import LinkClearance


@dataclass(frozen=True)
class ModificationOptions:
    """How knots are moved; the paper gives none of these numbers.

    Attributes:
        increment: By how much a knot moves along a revolute joint's axis at first [rad].
        linear_increment: Likewise along a prismatic joint's [m].
        halvings: How often the increments are halved, each time after no direction helped.
        growth: The factor from each step of the line search to the next.
        min_gain: The least gain that counts as an improvement, as a share of the duration.
        direction_nodes: After how many nodes the search for a direction ends with the best it has.
    """

    increment: float = 0.1
    linear_increment: float = 0.03
    halvings: int = 5
    growth: float = 1.6
    min_gain: float = 2e-4
    direction_nodes: int = 200

    def __post_init__(self) -> None:
        require_between(self, 0, np.inf, "increment", "linear_increment")
        require_count(self, 0, "halvings")
        require_between(self, 1, np.inf, "growth")
        require_between(self, 0, 1, "min_gain")
        require_count(self, 1, "direction_nodes")


class KnotModification:
    """A gradient search over the knots' places.

    Attributes:
        candidates: The first trajectory and every better one, the last one the fastest.
        nodes: Nodes expanded by all searches for a direction.
        directions: How many directions it searched for.
        proved: In how many of these searches every other direction was ruled out.
    """

    def __init__(
        self,
        problem: PlanningProblem,
        candidate: KnotTrajectory,
        options: ModificationOptions,
        scale: float = 1.0,
    ) -> None:
        """Begin with a trajectory; the increments are those of the options times a scale."""
        self.candidates = [candidate]
        self.nodes = self.directions = self.proved = 0
        self._problem, self._options = problem, options
        revolute = np.asarray(problem.robot.revolute)
        self._increments = scale * np.where(revolute, options.increment, options.linear_increment)

    def run(
        self, node_budget: float, checkpoint: Callable[[], None] = lambda: None
    ) -> KnotTrajectory:
        """Move the knots until no direction helps; return the fastest trajectory.

        Args:
            node_budget: End after about so many nodes.
            checkpoint: Called before every search for a direction; it may raise to end the work.
        """
        for halving in range(self._options.halvings + 1):
            increments = self._increments / 2**halving
            while self.nodes < node_budget and len(self.candidates[-1].knots) > 2:
                checkpoint()
                if not self._step(increments):
                    break
        return self.candidates[-1]

    def _step(self, increments: FloatArray) -> bool:
        """Move the knots along the best direction; return whether it helped."""
        candidate, options = self.candidates[-1], self._options
        wanted = candidate.duration * (1 - options.min_gain)
        clearance = LinkClearance(self._problem, candidate.knots)
        direction = best_direction(
            self._problem,
            candidate,
            increments,
            clearance,
            upper_bound=wanted,
            node_budget=options.direction_nodes,
        )
        self.nodes += direction.nodes
        self.directions += 1
        self.proved += direction.proved
        if direction.candidate is None:
            return False
        self.candidates.append(self._farther(candidate, direction.candidate, clearance))
        return True

    def _farther(
        self, candidate: KnotTrajectory, best: KnotTrajectory, clearance: LinkClearance
    ) -> KnotTrajectory:
        """Return the fastest trajectory along a direction, in steps that grow while they help."""
        direction, length = best.knots - candidate.knots, 1.0
        while True:
            length *= self._options.growth
            farther = feasible_trajectory(
                self._problem,
                candidate.knots + length * direction,
                candidate.construction,
                clearance,
                best.duration,
            )
            if farther is None:
                return best
            best = farther
