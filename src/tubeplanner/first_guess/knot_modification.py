"""Phase 2 of 1988, one round: discretised gradient, modified knots.

Knots are the paper's word for the waypoints that phase 2 moves.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import TypeAlias

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.checks import require_between, require_count
from tubeplanner.first_guess.segment_rules import LinkClearance, SegmentBatch, SegmentRules
from tubeplanner.limits.speed_limits import scaled_to_limits, scaling_factor
from tubeplanner.limits.tube_membership import worst_membership
from tubeplanner.outcome import MARGIN_TOLERANCE, Infeasible
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.polynomials import maxima

# ---- A trajectory through knots at equal times, at the limits (Suh & Bishop 1988).

# The polynomials through knots (K, n), linear in them: sequential quartics or the quartic spline.
Construction: TypeAlias = Callable[[Sequence[str], FloatArray], JointTrajectory]

# Half of what the certificate allows: valleys between samples are estimated [m or rad].
_TOLERANCE = MARGIN_TOLERANCE / 2
_COLLISION_SAMPLES = 9  # per piece
_LIMIT_SAMPLES = 13  # per piece, before the search for peaks


@dataclass(frozen=True, eq=False)
class KnotTrajectory:
    """A trajectory through knots."""

    knots: FloatArray  # shape (K, n) [rad or m]; the first is the start, the last the goal
    construction: Construction  # builds the polynomials from the knots
    trajectory: JointTrajectory  # at the limits

    @property
    def duration(self) -> float:
        """Duration [s]."""
        return self.trajectory.duration

    def at_equal_times(self, count: int) -> FloatArray:
        """Return K configurations at equal times from start to goal, shape (K, n)."""
        return self.trajectory.position(np.linspace(0.0, self.duration, count))


def feasible_trajectory(
    problem: PlanningProblem,
    knots: FloatArray,
    construction: Construction,
    clearance: LinkClearance,
    upper_bound: float = np.inf,
) -> KnotTrajectory | None:
    """Return the trajectory through knots, or None if a test fails.

    Position limits are judged for all t, the tube at 65 samples per piece with the valleys between
    them, collisions at 9. The certificate judges more strictly. The clearance is around
    configurations near the knots (K, n); only a trajectory faster than the upper bound is of
    interest [s].
    """
    shape = construction(problem.robot.joint_names, knots)
    samples = shape.per_piece(_LIMIT_SAMPLES)
    factor = scaling_factor(problem, samples.position, samples.velocity, samples.acceleration).min()
    least = shape.duration / float(factor) if 0 < factor < np.inf else np.inf
    if least >= upper_bound:
        return None
    try:
        trajectory = scaled_to_limits(problem, shape)
    except Infeasible:  # gravity is too strong somewhere
        return None
    if trajectory.duration >= upper_bound:
        return None
    limits = problem.robot.limits
    both = np.concatenate([shape.coefficients, -shape.coefficients], axis=2)
    highest = maxima(both, shape.widths).value
    limit = np.append(limits.upper_position, -limits.lower_position)
    if not (highest <= limit + _TOLERANCE).all() or worst_membership(problem, shape) < -_TOLERANCE:
        return None
    samples = shape.per_piece(_COLLISION_SAMPLES)
    nearest = np.rint(samples.time).astype(np.int64)  # a piece lasts one second
    if not clearance.is_free(samples.position, nearest).all():
        return None
    return KnotTrajectory(knots, construction, trajectory)


# ---- The discretised gradient, by branch and bound: the direction in which to move all knots.
#
# Each interior knot moves by an increment along one joint axis, forwards or backwards, or stays:
# 2n+1 choices, (2n+1)^(K-2) directions for K knots. A node of the search has chosen for the first
# knots. Each further choice settles one segment more, which is tested by the rules of phase 1, the
# number of segments being known (Suh & Bishop 1988, phase 2: nu = M-1-k).
#
# Nodes are kept by depth. Each sweep goes through the depths and expands the most promising nodes
# of each (cyclic best-first search: Morrison, Sauppe, Zhang, Jacobson and Sewell, "Cyclic best
# first search", 2017), so that the first sweep already ends with complete directions.
#
# Sequential quartics depend on no later knot than the one they aim at: cutting loses nothing that
# the samples do not miss. A spline's segments depend on all knots, on each about a quarter as much
# as on the one before; those not yet chosen are taken to stay, so a good direction may be lost, but
# none is taken that does not help.

# In a sweep: segments tested at each depth, and complete directions judged.
_SEGMENTS_PER_DEPTH, _TRAJECTORIES_PER_SWEEP = 300, 8


@dataclass(frozen=True, eq=False)
class _Open:
    """P open nodes of one depth, the most promising first."""

    bound: FloatArray  # lower bound on the duration of completions, shape (P,) [s]
    choices: IntArray  # moves of the knots 1, 2, ..., shape (P, depth)
    factor: FloatArray  # speed factor that the settled segments allow, shape (P,)
    tube_segments: BoolArray  # True for tube segments the tool may be in at their end, shape (P, m)

    def __len__(self) -> int:
        return len(self.bound)

    def where(self, rows: IntArray | BoolArray | slice) -> "_Open":
        return _Open(*(getattr(self, field.name)[rows] for field in fields(self)))

    def merged(self, other: "_Open") -> "_Open":
        pairs = [(getattr(self, field.name), getattr(other, field.name)) for field in fields(self)]
        both = _Open(*(np.concatenate(pair) for pair in pairs))
        return both.where(np.argsort(both.bound, kind="stable"))


class DirectionSearch:
    """The search for the direction of all knots that makes a trajectory fastest.

    Attributes:
        best: The trajectory with knots moved along it; None if no direction is faster so far.
        nodes: Nodes expanded.
    """

    def __init__(
        self,
        problem: PlanningProblem,
        candidate: KnotTrajectory,
        increments: FloatArray,
        clearance: LinkClearance,
        upper_bound: float,
    ) -> None:
        """Prepare a search from a trajectory through K >= 3 knots.

        A knot moves by an increment along an axis, (n,) [rad or m]. The clearance is around the
        knots; only directions to a duration below the upper bound are of interest [s].
        """
        count, n = candidate.knots.shape
        self.best: KnotTrajectory | None = None
        self.nodes = 0
        self._problem, self._trajectory, self._clearance = problem, candidate, clearance
        self._upper_bound = upper_bound
        self._last = count - 1
        step = np.diag(increments)
        self._moves = np.concatenate([np.zeros((1, n)), step, -step])
        # All configurations of each knot; start and goal stay.
        q = candidate.knots[:, None] + self._moves
        q[[0, -1]] = candidate.knots[[0, -1], None]
        q, nearest = q.reshape(-1, n), np.repeat(np.arange(count), len(self._moves))
        self._rules = SegmentRules(problem, q, clearance=clearance.around(q, nearest))
        self._response = unit_response(candidate.construction, count)
        shape = candidate.construction(problem.robot.joint_names, candidate.knots)
        self._coefficients = shape.coefficients
        none, nowhere = np.zeros(0), np.zeros((0, problem.tube.segment_count), dtype=bool)
        choices = [np.zeros((0, depth), dtype=np.int64) for depth in range(self._last)]
        self._open = [_Open(none, own, none, nowhere) for own in choices]
        # The choices for the first knot that moves; no segment is settled yet.
        count = len(self._moves)
        tube_segments = np.zeros((count, problem.tube.segment_count), dtype=bool)
        tube_segments[:, 0 if problem.tube.visit == "ordered" else slice(None)] = True
        nodes = _Open(
            np.zeros(count), np.arange(count)[:, None], np.full(count, np.inf), tube_segments
        )
        nodes = nodes.where(self._rules.free_waypoints[count : 2 * count])
        self._open[1] = self._completed(nodes) if self._last == 2 else nodes

    def run(self, node_budget: int) -> None:
        """Search until every other direction is ruled out, or the budget is used, about."""
        while not self.proved and self.nodes < node_budget:
            self._sweep()

    @property
    def proved(self) -> bool:
        """True if no open node can lead to a better direction."""
        return not any(
            len(nodes) > 0 and nodes.bound[0] < self._upper_bound for nodes in self._open[1:]
        )

    def _sweep(self) -> None:
        """Expand the most promising nodes of every depth and judge the best complete directions."""
        for depth in range(1, self._last - 1):
            nodes = self._popped(depth, _SEGMENTS_PER_DEPTH // len(self._moves))
            self.nodes += len(nodes)
            if depth > 1:
                nodes = nodes.where(self._rules.clear(self._batch(nodes, depth, 1)).parent)
            if len(nodes):
                # Every choice for the next knot; children that pass the rules stay.
                count = len(self._moves)
                parent = np.repeat(np.arange(len(nodes)), count)
                choice = np.tile(np.arange(count), len(nodes))
                nodes = nodes.where(parent)
                nodes = replace(nodes, choices=np.column_stack([nodes.choices, choice]))
                nodes = self._tested(nodes, depth + 1, 1)
                if depth + 1 == self._last - 1:
                    nodes = self._completed(nodes)
                self._open[depth + 1] = self._open[depth + 1].merged(nodes)
        for choices in self._popped(self._last - 1, _TRAJECTORIES_PER_SWEEP).choices:
            knots = self._trajectory.knots.copy()
            knots[1:-1] += self._moves[choices]
            construction, clearance = self._trajectory.construction, self._clearance
            candidate = feasible_trajectory(
                self._problem, knots, construction, clearance, self._upper_bound
            )
            if candidate is not None:
                self.best, self._upper_bound = candidate, candidate.duration

    def _popped(self, depth: int, most: int) -> _Open:
        """Remove and return the most promising open nodes of a depth."""
        nodes = self._open[depth]
        count = min(most, int(np.searchsorted(nodes.bound, self._upper_bound)))
        self._open[depth] = nodes.where(slice(count, None))
        return nodes.where(slice(count))

    def _completed(self, nodes: _Open) -> _Open:
        # The last two segments, to the goal, pass the rules too.
        return self._tested(nodes, self._last, 2)

    def _tested(self, nodes: _Open, aim: int, new: int) -> _Open:
        """Return the nodes whose new segments pass the rules."""
        batch = self._rules.surviving(self._batch(nodes, aim, new), self._upper_bound)
        bound = self._rules.lower_bound(batch)
        return _Open(bound, nodes.choices[batch.parent], batch.factor, batch.tube_segments)

    def _batch(self, nodes: _Open, aim: int, new: int) -> SegmentBatch:
        """Return the segments settled by a choice for the knot that they aim at.

        The knot after the end of the first new segment is `aim`; `new` is 1, or 2 for the last to
        the goal.
        """
        count, begin = len(nodes), aim - 2
        built = begin + new
        still = np.zeros((count, 1), dtype=np.int64)
        choices = np.column_stack([still, nodes.choices, still])
        moves = self._moves[choices[:, :-1]]
        response = self._response[:, begin:built, : moves.shape[1]]
        coefficients = self._coefficients[:, begin:built]
        ends = np.arange(begin, aim + 1)
        segments = nodes.tube_segments.shape[1]
        return SegmentBatch(
            parent=np.arange(count),
            waypoints=ends * len(self._moves) + choices[:, ends],
            built=np.full(count, built),
            remaining=np.full(count, self._last - built),
            coefficients=coefficients + np.einsum("csk,pkn->pcsn", response, moves),
            factor=nodes.factor,
            tube_segments=nodes.tube_segments,
            inside=np.zeros((count, 0, new, segments), dtype=bool),
        )


@lru_cache(maxsize=64)
def unit_response(construction: Construction, count: int) -> FloatArray:
    """Return the change of coefficients per unit move of K knots, shape (degree+1, K-1, K)."""
    names = [f"knot{k}" for k in range(count)]
    return construction(names, np.eye(count)).coefficients


# ---- The modification process: knots are moved until no direction makes the trajectory faster.
#
# Find the discretised gradient, search along it, repeat (Suh & Bishop 1988, phase 2). The paper
# does not give the increment: here it is halved whenever no direction helps, from coarse to fine.


@dataclass(frozen=True)
class ModificationOptions:
    """Options of the modification process; the paper gives none of these numbers."""

    increment: float = 0.1  # first step of a knot along a revolute joint's axis [rad]
    linear_increment: float = 0.03  # first step of a knot along a prismatic joint's axis [m]
    halvings: int = 5  # of the increments, each after no direction helped
    growth: float = 1.6  # factor from each step of the line search to the next
    min_gain: float = 2e-4  # least gain that counts, as a fraction of the duration
    direction_nodes: int = 200  # the search for a direction ends after this number of nodes

    def __post_init__(self) -> None:
        require_between(self, 0, np.inf, "increment", "linear_increment")
        require_count(self, 0, "halvings")
        require_between(self, 1, np.inf, "growth")
        require_between(self, 0, 1, "min_gain")
        require_count(self, 1, "direction_nodes")


class KnotModification:
    """A gradient search over the knots' places.

    Attributes:
        candidates: The first trajectory and every better one; the last is the fastest.
        nodes: Nodes expanded by all searches for a direction.
        directions: Number of searches for a direction.
        proved: Number of searches that ruled out every other direction.
    """

    def __init__(
        self,
        problem: PlanningProblem,
        candidate: KnotTrajectory,
        options: ModificationOptions,
        scale: float = 1.0,
    ) -> None:
        """Begin with a trajectory; a scale multiplies the increments of the options."""
        self.candidates = [candidate]
        self.nodes = self.directions = self.proved = 0
        self._problem, self._options = problem, options
        revolute = np.asarray(problem.robot.revolute)
        self._increments = scale * np.where(revolute, options.increment, options.linear_increment)

    def run(
        self, node_budget: float, checkpoint: Callable[[], None] = lambda: None
    ) -> KnotTrajectory:
        """Move the knots until no direction helps; return the fastest trajectory.

        It ends at about the node budget; the checkpoint is called before every search for a
        direction.
        """
        for halving in range(self._options.halvings + 1):
            increments = self._increments / 2**halving
            while self.nodes < node_budget and len(self.candidates[-1].knots) > 2:
                checkpoint()
                candidate, options = self.candidates[-1], self._options
                clearance = LinkClearance(self._problem, candidate.knots)
                least = candidate.duration * (1 - options.min_gain)
                search = DirectionSearch(self._problem, candidate, increments, clearance, least)
                search.run(options.direction_nodes)
                self.nodes += search.nodes
                self.directions += 1
                self.proved += search.proved
                if search.best is None:
                    break
                # Steps along the direction grow while they help.
                best, length = search.best, 1.0
                change = best.knots - candidate.knots
                while True:
                    length *= options.growth
                    farther = feasible_trajectory(
                        self._problem,
                        candidate.knots + length * change,
                        candidate.construction,
                        clearance,
                        best.duration,
                    )
                    if farther is None:
                        break
                    best = farther
                self.candidates.append(best)
        return self.candidates[-1]
