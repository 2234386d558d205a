"""Clearances of many pairs at many configurations; searches for collisions in a set of these."""

from ctypes import c_double, c_int, c_int64
from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.geometry.body_shapes import BodyShape
from tubeplanner.geometry.convex_shapes import bounding_boxes
from tubeplanner.geometry.distances import separating_directions
from tubeplanner.native.library import Doubles, Integers, native_function
from tubeplanner.studies.tubes.configuration_sets import ConfigurationSet
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.required_distances import in_contact, required_everywhere

# ---- Clearances of links beyond the required distances, and their derivatives.

# Steps towards the shortest vector between two shapes; two of them separate most pairs.
_MAX_STEPS = 12
_LOOSE = 2e-3  # [m]: largest shortfall of a bound from the distance
_NO_LENGTH = 1e-9  # [m]
_bounds = native_function(
    "tubeplanner_clearance_bounds",
    *(Doubles, c_int64, Doubles, c_int64, Integers, Doubles, c_int64, Doubles),
    *(Doubles, Doubles, c_int64, c_int64, c_double, Doubles, Doubles),
    returns=c_int,
)


@dataclass(frozen=True, eq=False)
class LeastClearance:
    """The pair of shapes with the least clearance, in N configurations."""

    # distance of the pair beyond the required one, shape (N,) [m]; infinite where no pair is near
    clearance: FloatArray
    pair: IntArray  # index of the pair, shape (N,)


class PairClearance:
    """The pairs of shapes that must stay apart, and their clearances.

    Attributes:
        pairs: Indices of the checker's shapes, shape (P, 2).
        required: Least distance of each pair, shape (P,) [m]: the largest that a segment requires.
            Pairs in contact at start or goal may be at any distance: -inf.
    """

    def __init__(self, problem: PlanningProblem, extra: float) -> None:
        """Take the pairs of a problem; `extra` [m] is required beyond the problem's clearance."""
        self._checker, self._robot = problem.collision, problem.robot
        self.pairs = np.ascontiguousarray(self._checker.pairs)
        required = required_everywhere(problem) + extra
        self.required = np.where(in_contact(problem), -np.inf, required)
        self._table = None if _bounds is None else _table(self._checker.shapes)

    def least(self, q: FloatArray, near: float) -> LeastClearance:
        """Return the least clearances below `near` [m] in configurations (N, n).

        A positive value may be lower than the clearance. A negative value is the clearance of the
        pair that is named; other pairs may have less.
        """
        if len(self.pairs) == 0:
            return LeastClearance(np.full(len(q), np.inf), np.zeros(len(q), dtype=np.int64))
        rotation, position = self._robot.body_poses(q)
        bound, least = self.bounds(rotation, position, near)
        # A negative bound says nothing of the depth. It is replaced by the clearance, until a
        # clearance of the row is negative: the other entries of that row become infinite.
        live = np.flatnonzero(least < 0)
        while len(live):
            nearest = bound[live].argmin(axis=1)
            pairs = self.pairs[nearest]
            closest = self._checker.closest_points(rotation[live], position[live], pairs)
            clearance = closest.distance - self.required[nearest]
            bound[live[clearance < 0]] = np.inf
            bound[live, nearest] = clearance
            live = live[(clearance >= 0) & (bound[live] < 0).any(axis=1)]
        pair = bound.argmin(axis=1)
        return LeastClearance(bound[np.arange(len(q)), pair], pair)

    def of_pairs(self, q: FloatArray, pair: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return the clearances of pairs, each in its own configuration, and their derivatives.

        Configurations (N, n) and indices of pairs (N,) give clearances (N,) [m] and their
        derivatives by the joints (N, n) [m/rad or 1].
        """
        rotation, position = self._robot.body_poses(q)
        pairs = self.pairs[pair]
        closest = self._checker.closest_points(rotation, position, pairs)
        gradient = self._checker.distance_gradient(rotation, position, pairs, closest)
        return closest.distance - self.required[pair], gradient

    def bounds(
        self, rotation: FloatArray, position: FloatArray, near: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return lower bounds on clearances (N, P) [m], and the least of each configuration, (N,).

        Where bounding spheres and boxes do not decide, a separating direction is searched for.
        Never above the clearance, except by rounding; infinite from `near` [m] on. Where shapes
        overlap, bounds are negative, and say nothing about the depth. Poses are as of `BodyShapes`.
        """
        if self._table is None:
            bound = self._bounds(rotation, position, near)
            return bound, bound.min(axis=1, initial=np.inf)
        assert _bounds is not None
        (table, vertices), pairs = self._table, self.pairs
        settings = np.array([_MAX_STEPS, _LOOSE, _NO_LENGTH])
        poses = np.ascontiguousarray(rotation), np.ascontiguousarray(position)
        samples, bodies = position.shape[:2]
        bound, least = np.empty((samples, len(pairs))), np.empty(samples)
        shapes = table, len(table), vertices, vertices.shape[1]
        at = pairs, self.required, len(pairs), settings, *poses, bodies, samples, near
        if _bounds(*shapes, *at, bound, least):
            raise MemoryError
        return bound, least

    def _bounds(self, rotation: FloatArray, position: FloatArray, near: float) -> FloatArray:
        shapes, pairs, required = self._checker, self.pairs, self.required
        bound = shapes.sphere_distances(rotation, position, pairs) - required
        row, pair = np.nonzero(bound < near)
        boxes = shapes.box_distances(rotation, position, row, pairs[pair])
        bound[row, pair] = np.maximum(bound[row, pair], boxes - required[pair])
        for k in np.flatnonzero((bound < near).any(axis=0)):
            rows = np.flatnonzero(bound[:, k] < near)
            first, second = (shapes.shapes[index] for index in pairs[k])
            # Points of the first shape in the frame of the second one's body:
            # relative @ x + offset.
            axes, origins = rotation[rows], position[rows]
            back = axes[:, second.body].transpose(0, 2, 1)
            relative = back @ axes[:, first.body]
            gap = origins[:, first.body] - origins[:, second.body]
            offset = np.einsum("nij,nj->ni", back, gap)
            grown = first.shape.radius + second.shape.radius
            apart, _ = separating_directions(
                first.shape.vertices,
                second.shape.vertices,
                relative,
                offset,
                second.shape.center - offset - relative @ first.shape.center,
                max_steps=_MAX_STEPS,
                enough=near + required[k] + grown,
                loose=_LOOSE,
            )
            bound[rows, k] = apart - grown - required[k]
        bound[bound >= near] = np.inf
        return bound


def _table(shapes: list[BodyShape]) -> tuple[FloatArray, FloatArray]:
    """Return shapes for the native bounds: a table (S, 23), and all vertices by coordinate.

    Columns: body, first vertex, number of vertices, growth, radius and centre of the bounding
    sphere; axes as rows, centre along these and half lengths of the box; in the body's frame.
    """
    vertices = np.concatenate([np.zeros((0, 3)), *(each.shape.vertices for each in shapes)])
    count = np.array([len(each.shape.vertices) for each in shapes])
    boxes = bounding_boxes([each.shape for each in shapes])
    columns = (
        np.array([each.body for each in shapes]),
        np.cumsum(count) - count,
        count,
        np.array([each.shape.radius for each in shapes]),
        np.array([each.shape.bounding_radius for each in shapes]),
        np.array([each.shape.center for each in shapes]),
        boxes.axes.reshape(-1, 9),
        boxes.center,
        boxes.half,
    )
    table = np.hstack([column.reshape(len(shapes), -1 if shapes else 0) for column in columns])
    return np.ascontiguousarray(table, dtype=float), np.ascontiguousarray(vertices.T)


# ---- The search for collisions in a set of configurations: random ones, and downhill from those.

# Descents begin at samples with less clearance than this [m].
_NEAR = 0.03
_STARTS_PER_PAIR = 4
_DESCENT_STEPS = 12
_MAX_STEP, _MIN_STEP = 0.15, 1e-3  # [rad or m] of all joints together
_FLAT = 1e-6  # [m/rad or 1]: a clearance that changes less does not change
_AIM = 2e-3  # [m]: overlap that a step of the descent aims at
_MIN_SAMPLES, _MAX_SAMPLES = 1024, 4096  # samples at once
_LOOKED_BESIDE, _NEIGHBOURS = 8, 24  # collisions, and configurations tested beside each
_ENOUGH = 48  # collisions that end a search


@dataclass(frozen=True, eq=False)
class CounterexampleSearch:
    """The result of a counterexample search in a set."""

    q: FloatArray  # configurations in which links are too close, shape (C, n); empty if none
    pair: IntArray  # the pair of shapes that is too close in each, shape (C,)
    least_clearance: float  # the least clearance of all samples [m]; infinite if no pair came near
    samples: int  # number of configurations tested
    tried: int  # number of configurations drawn; some do not reach their tool pose

    @property
    def failed(self) -> bool:
        """True if no collision was found."""
        return len(self.q) == 0

    def then(self, later: "CounterexampleSearch") -> "CounterexampleSearch":
        """Return the joint result of this search and a later search in the same set."""
        return CounterexampleSearch(
            np.concatenate([self.q, later.q]),
            np.concatenate([self.pair, later.pair]),
            min(self.least_clearance, later.least_clearance),
            self.samples + later.samples,
            self.tried + later.tried,
        )


def search_counterexamples(
    allowed: ConfigurationSet, clearance: PairClearance, samples: int, rng: np.random.Generator
) -> CounterexampleSearch:
    """Search a set for configurations in which links are too close, among at most `samples` draws.

    Draws more samples at a time until there are enough collisions or the budget is spent.
    """
    hits: list[tuple[FloatArray, IntArray]] = []
    least, tested, drawn, count = np.inf, 0, 0, _MIN_SAMPLES
    while drawn < samples and sum(len(q) for q, _ in hits) < _ENOUGH:
        count = min(count, samples - drawn)
        drawn += count
        q = allowed.sample(count, rng)
        nearest = clearance.least(q, _NEAR)
        tested += len(q)
        hits.append((q[nearest.clearance < 0], nearest.pair[nearest.clearance < 0]))
        least = min(least, nearest.clearance.min(initial=np.inf))
        if least >= 0:
            # Per pair, from the samples of least clearance.
            order = np.argsort(nearest.clearance)
            apart = nearest.clearance[order]
            order = order[(apart >= 0) & np.isfinite(apart)]
            pairs = nearest.pair[order]
            of_pairs = [order[pairs == k][:_STARTS_PER_PAIR] for k in np.unique(pairs)]
            starts = np.concatenate([np.zeros(0, dtype=np.int64), *of_pairs])
            q, pair, lowest = _descended(allowed, clearance, q[starts], nearest.pair[starts])
            hits.append((q[lowest < 0], pair[lowest < 0]))
            least = min(least, lowest.min(initial=np.inf))
        count = min(2 * count, _MAX_SAMPLES)
    # Chance alone finds the rest of a colliding region only in many more searches.
    beside = np.concatenate([q for q, _ in hits])[:_LOOKED_BESIDE]
    beside = np.repeat(beside, _NEIGHBOURS, axis=0)
    away = rng.uniform(0.0, _MAX_STEP, (len(beside), 1)) * rng.normal(size=beside.shape)
    beside = allowed.back_inside(beside + away)
    beside = beside[allowed.contains(beside)]
    nearest = clearance.least(beside, 0.0)
    hits.append((beside[nearest.clearance < 0], nearest.pair[nearest.clearance < 0]))
    q_hit, pair_hit = (np.concatenate(parts) for parts in zip(*hits, strict=True))
    return CounterexampleSearch(q_hit, pair_hit, float(least), tested, drawn)


def _descended(
    allowed: ConfigurationSet, clearance: PairClearance, q: FloatArray, pair: IntArray
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Return configurations of least clearance near (N, n), the pairs (N,), the clearances [m]."""
    best, lowest = q.copy(), np.full(len(q), np.inf)
    slope, reach = np.zeros_like(q), np.full(len(q), _MAX_STEP)
    live = np.arange(len(q))
    for _ in range(_DESCENT_STEPS):
        value, gradient = clearance.of_pairs(q, pair[live])
        better = allowed.contains(q) & (value < lowest[live])
        down = live[better]
        best[down], lowest[down], slope[down] = q[better], value[better], gradient[better]
        reach[live[~better]] /= 2
        live = live[(lowest[live] >= 0) & (reach[live] >= _MIN_STEP)]
        if len(live) == 0:
            break
        size = np.maximum(np.linalg.norm(slope[live], axis=1), _FLAT)
        length = np.minimum((lowest[live] + _AIM) / size, reach[live])
        q = allowed.back_inside(best[live] - (length / size)[:, None] * slope[live])
    return best, pair, lowest
