"""Pruning rules of phase 1: limits, tube, clearance, duration.

Distances are measured at the waypoints. Elsewhere, two lower bounds come first: by the joints'
travel from a waypoint, and along the direction that separates a pair there. Only pairs for which
neither is enough are measured.
"""

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, fields, replace

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.first_guess.waypoints import power_basis
from tubeplanner.limits.path_samples import PathSamples
from tubeplanner.limits.speed_limits import largest_speeds, rates_and_others, speed_limits
from tubeplanner.limits.tube_membership import (
    membership_margin,
    passable_segments,
    segments_reached,
)
from tubeplanner.outcome import MARGIN_TOLERANCE
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.required_distances import RequiredDistances

_MAX_DISTANCE = 0.3  # [m]: pairs that are never nearer at a waypoint are left out


class LinkClearance:
    """Distances of links from obstacles and links, around M configurations.

    Pairs more than 0.3 m apart at all of them are assumed to stay apart. The least distance that
    any segment or contact requires counts, since the tool's segment is not known.

    Attributes:
        free_waypoints: True for configurations that keep the distances, shape (M,).
    """

    def __init__(
        self,
        problem: PlanningProblem,
        waypoints: FloatArray,
        checkpoint: Callable[[], None] = lambda: None,
    ) -> None:
        """Measure all distances at waypoints (M, n), from the start to the goal.

        The checkpoint may raise to end that.
        """
        self._problem, self._checker = problem, problem.collision
        checker = problem.collision
        self._pairs, self._columns = checker.pairs, np.arange(len(checker.pairs))
        self._requirement = RequiredDistances(problem, waypoints[0], waypoints[-1])
        self._waypoints = waypoints
        separations = []
        for rotation, position in zip(*problem.robot.body_poses(waypoints), strict=True):
            checkpoint()
            separations.append(checker.separations(rotation, position, self._pairs))
        distance = np.array([distance for distance, _ in separations])
        direction = np.array([direction for _, direction in separations])
        self.free_waypoints = np.all(distance >= self._required(waypoints), axis=1)
        near = distance.min(axis=0, initial=np.inf) < _MAX_DISTANCE
        self._pairs, self._columns = self._pairs[near], self._columns[near]
        self._weights = checker.motion_weights(self._pairs)
        self._distance, self._direction = distance[:, near], direction[:, near]

    def around(self, q: FloatArray, nearest: IntArray) -> "LinkClearance":
        """Return the clearance around other configurations, without measuring everything again.

        The configurations (P, n) are each near a measured one, of index `nearest` (P,).
        """
        other = copy(self)
        travel = abs(q - self._waypoints[nearest])
        other._distance = self._distance[nearest] - travel @ self._weights.T
        other._direction = self._direction[nearest]
        other._waypoints = q
        other.free_waypoints = self.is_free(q, nearest)
        return other

    def is_free(self, q: FloatArray, waypoint: IntArray) -> BoolArray:
        """Return a mask of the configurations that keep their distances, shape (N,).

        The configurations are of shape (N, n), the index of a waypoint near each is of shape (N,).
        """
        if len(self._pairs) == 0:
            return np.ones(len(q), dtype=bool)
        travel = abs(q - self._waypoints[waypoint])
        lower = self._distance[waypoint] - travel @ self._weights.T
        free, required = np.ones(len(q), dtype=bool), self._required(q)
        doubtful = np.flatnonzero((lower < required).any(axis=1))
        required = required[doubtful]
        rotation, position = self._problem.robot.body_poses(q[doubtful])
        spheres = self._checker.sphere_distances(rotation, position, self._pairs)
        row, pair = np.nonzero(np.maximum(lower[doubtful], spheres) < required)
        direction = self._direction[waypoint[doubtful[row]], pair]
        bound = self._checker.separations_along(
            rotation[row], position[row], self._pairs[pair], direction
        )
        undecided = bound < required[row, pair]
        row, pair = row[undecided], pair[undecided]
        for i in np.unique(row):
            pairs = pair[row == i]
            distance = self._checker.distances(rotation[i], position[i], self._pairs[pairs])
            free[doubtful[i]] = (distance >= required[i, pairs]).all()
        return free

    def _required(self, q: FloatArray) -> FloatArray:
        """Return the required distances of the pairs in configurations (N, n), (N, P) [m]."""
        tool = self._problem.robot.tool_position(q)
        return self._requirement.anywhere(tool)[:, self._columns] - MARGIN_TOLERANCE


# ---- The rules by which phase 1 cuts segments, for many segments at once (Suh & Bishop 1988).
#
# - joint_limits (FR-1): a joint leaves its position limits;
# - duration (FR-3): the lower bound on the whole duration is no better than the known best;
# - tube (FR-2): the tool leaves the tube, rotates too far there, or a joint leaves its range;
# - collision (FR-2): a link comes too near to an obstacle or another link.
#
# Segments are tested at a few samples, which can only be too lenient.

# Local times of the tests, in stages: the first cuts most.
_STAGES = (np.array([4, 8]) / 8, np.array([2, 6]) / 8, np.array([1, 3, 5, 7]) / 8)
_IN_ORDER = np.argsort(np.concatenate(_STAGES))
# Polynomials are cheap to look at: finely enough to miss their peaks by 0.1 %.
_RATE_TIMES = np.linspace(0, 1, 33)
_COLLISION_TIMES = np.arange(1, 8) / 8


@dataclass(frozen=True, eq=False)
class SegmentBatch:
    """C continuations of trajectories, each by L new segments: 1, or the last 2 to the goal."""

    parent: IntArray  # index of the trajectory that is continued, shape (C,)
    # begin and end of the first new segment, and the waypoint after it, shape (C, 3)
    waypoints: IntArray
    built: IntArray  # number of segments, new segments included, shape (C,)
    remaining: IntArray  # least number of further segments, shape (C,): the paper's nu
    coefficients: FloatArray  # of the new segments, shape (C, 5, L, n), highest power first
    factor: FloatArray  # speed factor that the limits allow so far, shape (C,)
    tube_segments: BoolArray  # True for tube segments the tool may be in at the start, shape (C, m)
    # True for tube segments that hold the S samples tested so far, shape (C, S, L, m)
    inside: BoolArray

    def __len__(self) -> int:
        return len(self.parent)

    @property
    def complete(self) -> bool:
        """True if the trajectories end at the goal."""
        return self.coefficients.shape[2] == 2

    def where(self, keep: BoolArray) -> "SegmentBatch":
        """Return the continuations for which a mask (C,) holds."""
        return SegmentBatch(*(getattr(self, field.name)[keep] for field in fields(self)))

    def at(self, times: FloatArray, order: int) -> FloatArray:
        """Return a derivative of all new segments at local times (S,), shape (C, S, L, n)."""
        values = np.tensordot(self.coefficients, power_basis(times, order), axes=(1, 1))
        return np.ascontiguousarray(values.transpose(0, 3, 1, 2))


class SegmentRules:
    """Tests continuations between M waypoints, and counts what each rule cuts.

    Attributes:
        cuts: Number of continuations cut, by rule.
        free_waypoints: True for waypoints clear of collisions, shape (M,).
    """

    def __init__(
        self,
        problem: PlanningProblem,
        waypoints: FloatArray,
        checkpoint: Callable[[], None] = lambda: None,
        clearance: LinkClearance | None = None,
    ) -> None:
        """Prepare the tests.

        The clearance is around the waypoints (M, n); None: it is measured, and the checkpoint
        called meanwhile.
        """
        self._problem = problem
        self._clearance = clearance or LinkClearance(problem, waypoints, checkpoint)
        self._rates, others = rates_and_others(speed_limits(problem))
        # The tool's segment is not known: limits that depend on it could be too strict here.
        self._sampled = tuple(
            limit for limit in others if all(key.segment is None for key in limit.keys)
        )
        self._orders = max((limit.order for limit in self._sampled), default=0) + 1
        # Least times between waypoints under the velocity limits, (M, M) [s].
        travel = abs(waypoints[:, None] - waypoints)
        self._least_times = (travel / problem.robot.limits.velocity).max(axis=2)
        self._passable = passable_segments(problem.tube)
        self.cuts = {"joint_limits": 0, "duration": 0, "tube": 0, "collision": 0}
        self.free_waypoints = self._clearance.free_waypoints

    def surviving(self, batch: SegmentBatch, upper_bound: float) -> SegmentBatch:
        """Return the continuations that no rule but `clear` cuts, which takes longest.

        No samples of the batch are tested yet. Only trajectories faster than the upper bound are of
        interest [s].
        """
        batch = self._cut("collision", batch, self.free_waypoints[batch.waypoints[:, 2]])
        rate_factor = np.full(len(batch), np.inf)
        for limit in self._rates:
            rate = batch.at(_RATE_TIMES, limit.order)[..., limit.joints]
            used = (abs(rate) / limit.limit).max(axis=(1, 2, 3))
            with np.errstate(divide="ignore"):
                rate_factor = np.minimum(rate_factor, (1 / used) ** (1 / limit.order))
        batch = replace(batch, factor=np.minimum(batch.factor, rate_factor))
        batch = self._cut("duration", batch, self.lower_bound(batch) < upper_bound)
        limits = self._problem.robot.limits
        for times in _STAGES:
            q = batch.at(times, 0)
            outside = np.maximum(limits.lower_position - q, q - limits.upper_position)
            within = np.all(outside <= MARGIN_TOLERANCE, axis=(1, 2, 3))
            batch = self._cut("joint_limits", batch, within)
            by_path = np.stack([batch.at(times, order) for order in range(self._orders)])
            at = PathSamples(self._problem, by_path.reshape(self._orders, -1, by_path.shape[4]))
            factor = largest_speeds(at, self._sampled).reshape(by_path.shape[1:4])
            batch = replace(batch, factor=np.minimum(batch.factor, factor.min(axis=(1, 2))))
            batch = self._cut("duration", batch, self.lower_bound(batch) < upper_bound)
            q = batch.at(times, 0)
            margin = membership_margin(self._problem, q.reshape(-1, q.shape[-1]))
            inside = (margin >= -MARGIN_TOLERANCE).reshape(*q.shape[:3], margin.shape[1])
            inside = np.concatenate([batch.inside, inside], axis=1)
            batch = replace(batch, inside=inside)
            batch = self._cut("tube", batch, np.all(np.any(inside, axis=3), axis=(1, 2)))
        inside = batch.inside[:, _IN_ORDER].transpose(0, 2, 1, 3)
        inside = inside.reshape(len(batch), inside.shape[1] * inside.shape[2], inside.shape[-1])
        ordered = self._problem.tube.visit == "ordered"
        reached = segments_reached(inside, batch.tube_segments, self._passable, ordered=ordered)
        batch = replace(batch, tube_segments=reached[:, -1])
        # A complete trajectory must have arrived in the last segment, another one somewhere.
        segments = slice(-1, None) if batch.complete else slice(None)
        return self._cut("tube", batch, np.any(batch.tube_segments[:, segments], axis=1))

    def clear(self, batch: SegmentBatch) -> SegmentBatch:
        """Return the continuations whose links are clear at samples between the waypoints too."""
        q = batch.at(_COLLISION_TIMES, 0)
        ends = batch.waypoints[:, None, 1 : 1 + q.shape[2]]
        near = np.broadcast_to(ends, q.shape[:3]).ravel()
        free = self._clearance.is_free(q.reshape(-1, q.shape[3]), near)
        return self._cut("collision", batch, np.all(free.reshape(q.shape[:3]), axis=(1, 2)))

    def lower_bound(self, batch: SegmentBatch) -> FloatArray:
        """Return lower bounds on the durations of the whole trajectories, shape (C,) [s].

        The segments built take `built / B`, B being the trajectory's factor. A trajectory that is
        not complete has at least two more, to the next waypoint and on to the goal; each takes at
        least 1 / B and the least time of its velocity limits. (Suh & Bishop 1988, FR-3: LB =
        eta1 + eta2 + eta3, with B taken over the whole new segment, where eta2 cannot exceed its
        part of 1 / B.)
        """
        with np.errstate(divide="ignore"):
            interval = 1 / batch.factor
        bound = batch.built * interval
        if batch.complete:
            return bound
        _, following, after = batch.waypoints.T
        bound += np.maximum(self._least_times[following, after], interval)
        return bound + np.maximum(self._least_times[after, -1], (batch.remaining - 1) * interval)

    def _cut(self, rule: str, batch: SegmentBatch, keep: BoolArray) -> SegmentBatch:
        self.cuts[rule] += int(len(keep) - keep.sum())
        return batch if keep.all() else batch.where(keep)
