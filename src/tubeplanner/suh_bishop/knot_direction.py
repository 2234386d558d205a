"""The discretised gradient, by branch and bound: the direction in which to move all knots.

Each interior knot moves by an increment along one joint axis, forwards or backwards, or stays:
2n+1 choices, (2n+1)^(K-2) directions for K knots. A node of the search has chosen for the first
knots. Each further choice settles one segment more, which is tested by the rules of phase 1, the
number of segments being known (Suh & Bishop 1988, phase 2: nu = M-1-k).

Nodes are kept by depth. Each sweep goes through the depths and expands the most promising nodes of
each (cyclic best-first search: Morrison, Sauppe, Zhang, Jacobson and Sewell, "Cyclic best first
search", 2017), so that the first sweep already ends with complete directions.

Sequential quartics depend on no later knot than the one they aim at: cutting loses nothing that the
samples do not miss. A spline's segments depend on all knots, on each about a quarter as much as on
the one before; those not yet chosen are taken to stay, so a good direction may be lost, but none is
taken that does not help.
"""

from dataclasses import dataclass, fields
from functools import lru_cache

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.suh_bishop.knot_trajectory import Construction, KnotTrajectory, feasible_trajectory
from tubeplanner.waypoint_search.link_clearance import LinkClearance
from tubeplanner.waypoint_search.segment_rules import SegmentBatch, SegmentRules

# How many segments are tested at a depth, and how many complete directions judged, in a sweep.
_SEGMENTS_PER_DEPTH, _TRAJECTORIES_PER_SWEEP = 300, 8


@dataclass(frozen=True, eq=False)
class Direction:
    """The result of a search for the best direction.

    Attributes:
        candidate: The trajectory whose knots are moved along it; None if no direction is faster.
        nodes: Nodes expanded.
        proved: Whether every other direction was ruled out, not only the node budget reached.
    """

    candidate: KnotTrajectory | None
    nodes: int
    proved: bool


@dataclass(frozen=True, eq=False)
class _Open:
    """P open nodes of one depth, the most promising first.

    Attributes:
        bound: No completion is faster [s], shape (P,).
        choices: Of the knots 1, 2, ...: shape (P, depth).
        factor: How much faster the segments settled can be run, shape (P,).
        tube_segments: In which tube segments the tool may be at their end: bool, shape (P, m).
    """

    bound: FloatArray
    choices: IntArray
    factor: FloatArray
    tube_segments: BoolArray

    def __len__(self) -> int:
        return len(self.bound)

    def where(self, chosen: IntArray | BoolArray | slice) -> "_Open":
        return _Open(*(getattr(self, field.name)[chosen] for field in fields(self)))

    def merged(self, other: "_Open") -> "_Open":
        pairs = [(getattr(self, field.name), getattr(other, field.name)) for field in fields(self)]
        both = _Open(*(np.concatenate(pair) for pair in pairs))
        return both.where(np.argsort(both.bound, kind="stable"))


def best_direction(
    problem: PlanningProblem,
    candidate: KnotTrajectory,
    increments: FloatArray,
    clearance: LinkClearance,
    *,
    upper_bound: float,
    node_budget: int,
) -> Direction:
    """Return the direction that makes a trajectory fastest.

    Args:
        problem: The planning problem.
        candidate: Through K >= 3 knots.
        increments: By how much a knot moves along each axis, shape (n,) [rad or m].
        clearance: Around the trajectory's knots.
        upper_bound: Only directions that make it faster than this are of interest [s].
        node_budget: The search ends after about so many nodes.
    """
    search = _Search(problem, candidate, increments, clearance, upper_bound)
    while not search.finished and search.nodes < node_budget:
        search.sweep()
    return Direction(search.best, search.nodes, search.finished)


class _Search:
    """A search for the best direction."""

    def __init__(
        self,
        problem: PlanningProblem,
        candidate: KnotTrajectory,
        increments: FloatArray,
        clearance: LinkClearance,
        upper_bound: float,
    ) -> None:
        count, n = candidate.knots.shape
        self.best: KnotTrajectory | None = None
        self.nodes = 0
        self._problem, self._trajectory, self._clearance = problem, candidate, clearance
        self._upper_bound = upper_bound
        self._last = count - 1
        step = np.diag(increments)
        self._moves = np.concatenate([np.zeros((1, n)), step, -step])
        # Of each knot, all places it may move to; start and goal stay.
        places = candidate.knots[:, None] + self._moves
        places[[0, -1]] = candidate.knots[[0, -1], None]
        places, nearest = places.reshape(-1, n), np.repeat(np.arange(count), len(self._moves))
        around = clearance.around(places, nearest)
        self._rules = SegmentRules(problem, places, clearance=around)
        self._response = unit_response(candidate.construction, count)
        shape = candidate.construction(problem.robot.joint_names, candidate.knots)
        self._coefficients = shape.coefficients
        self._open = [self._none(depth) for depth in range(self._last)]
        self._open[1] = self._root()

    @property
    def finished(self) -> bool:
        """Whether no open node can lead to a better direction."""
        return not any(self._is_open(depth) for depth in range(1, self._last))

    def sweep(self) -> None:
        """Expand the most promising nodes of every depth, judge the best complete directions."""
        for depth in range(1, self._last - 1):
            nodes = self._taken(depth, _SEGMENTS_PER_DEPTH // len(self._moves))
            self.nodes += len(nodes)
            if depth > 1:
                nodes = nodes.where(self._rules.clear(self._batch(nodes, depth, 1)).parent)
            if len(nodes):
                self._expand(nodes)
        for choices in self._taken(self._last - 1, _TRAJECTORIES_PER_SWEEP).choices:
            self._try(choices)

    def _is_open(self, depth: int) -> bool:
        nodes = self._open[depth]
        return len(nodes) > 0 and nodes.bound[0] < self._upper_bound

    def _taken(self, depth: int, most: int) -> _Open:
        """Take the most promising nodes of a depth out of the open ones."""
        nodes = self._open[depth]
        taken = min(most, int(np.searchsorted(nodes.bound, self._upper_bound)))
        self._open[depth] = nodes.where(slice(taken, None))
        return nodes.where(slice(taken))

    def _none(self, depth: int) -> _Open:
        segments = self._problem.tube.segment_count
        return _Open(
            np.zeros(0),
            np.zeros((0, depth), dtype=np.int64),
            np.zeros(0),
            np.zeros((0, segments), dtype=bool),
        )

    def _root(self) -> _Open:
        """Return the choices for the first knot that moves: no segment is settled yet."""
        count = len(self._moves)
        tube_segments = np.zeros((count, self._problem.tube.segment_count), dtype=bool)
        tube_segments[:, 0 if self._problem.tube.visit == "ordered" else slice(None)] = True
        nodes = _Open(
            np.zeros(count), np.arange(count)[:, None], np.full(count, np.inf), tube_segments
        )
        nodes = nodes.where(self._rules.free_waypoints[count : 2 * count])
        return self._completed(nodes) if self._last == 2 else nodes

    def _expand(self, nodes: _Open) -> None:
        """Expand nodes by every choice for one more knot; keep those that pass the rules."""
        count, depth = len(self._moves), nodes.choices.shape[1] + 1
        parent = np.repeat(np.arange(len(nodes)), count)
        chosen = np.tile(np.arange(count), len(nodes))
        nodes = nodes.where(parent)
        nodes = _Open(
            nodes.bound,
            np.column_stack([nodes.choices, chosen]),
            nodes.factor,
            nodes.tube_segments,
        )
        nodes = self._tested(nodes, depth, 1)
        if depth == self._last - 1:
            nodes = self._completed(nodes)
        self._open[depth] = self._open[depth].merged(nodes)

    def _completed(self, nodes: _Open) -> _Open:
        """Return the nodes whose last two segments, to the goal, pass the rules too."""
        return self._tested(nodes, self._last, 2)

    def _tested(self, nodes: _Open, aim: int, new: int) -> _Open:
        """Return the nodes whose new segments pass the rules."""
        batch = self._rules.surviving(self._batch(nodes, aim, new), self._upper_bound)
        bound = self._rules.lower_bound(batch)
        return _Open(bound, nodes.choices[batch.parent], batch.factor, batch.tube_segments)

    def _batch(self, nodes: _Open, aim: int, new: int) -> SegmentBatch:
        """Return the segments that are settled by a choice for the knot they aim at.

        Args:
            nodes: P of them.
            aim: The knot after the one where the first new segment ends.
            new: How many segments are new: one, or the last two to the goal.
        """
        count, begin = len(nodes), aim - 2
        built = begin + new
        still = np.zeros((count, 1), dtype=np.int64)
        choices = np.column_stack([still, nodes.choices, still])
        moved = self._moves[choices[:, :-1]]
        response = self._response[:, begin:built, : moved.shape[1]]
        coefficients = self._coefficients[:, begin:built]
        ends = np.arange(begin, aim + 1)
        segments = nodes.tube_segments.shape[1]
        return SegmentBatch(
            parent=np.arange(count),
            waypoints=ends * len(self._moves) + choices[:, ends],
            built=np.full(count, built),
            remaining=np.full(count, self._last - built),
            coefficients=coefficients + np.einsum("csk,pkn->pcsn", response, moved),
            factor=nodes.factor,
            tube_segments=nodes.tube_segments,
            inside=np.zeros((count, 0, new, segments), dtype=bool),
        )

    def _try(self, choices: IntArray) -> None:
        """Keep a direction if it is the best yet, judged as a whole."""
        knots = self._trajectory.knots.copy()
        knots[1:-1] += self._moves[choices]
        candidate = feasible_trajectory(
            self._problem, knots, self._trajectory.construction, self._clearance, self._upper_bound
        )
        if candidate is not None:
            self.best, self._upper_bound = candidate, candidate.duration


@lru_cache(maxsize=64)
def unit_response(construction: Construction, count: int) -> FloatArray:
    """Return how polynomials change as each of K knots moves by one: (degree+1, K-1, K)."""
    names = [f"knot{k}" for k in range(count)]
    return construction(names, np.eye(count)).coefficients
