"""Lower bounds on clearances of many pairs at many configurations, native and NumPy.

A table of shapes (S, 23) says where each is: its body, the first of its vertices and their number,
by how much they are grown, the radius of the bounding sphere and its centre, and the bounding box:
axes as rows, centre along these and half lengths; all in the frame of the body.
"""

from ctypes import c_double, c_int, c_int64
from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.geometry.body_shapes import BodyShape, BodyShapes
from tubeplanner.geometry.convex_shapes import bounding_boxes
from tubeplanner.geometry.penetration import separating_directions
from tubeplanner.native.library import LIBRARY, Doubles, Integers, native_function
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.required_distances import in_contact, required_everywhere

# ---- Clearances of links beyond the required distances, and their derivatives.


@dataclass(frozen=True, eq=False)
class LeastClearance:
    """The pair of shapes with the least clearance, in N configurations.

    Attributes:
        clearance: Distance of the pair less the required one, negative where too close, shape (N,)
            [m]; infinite where no pair is near.
        pair: Index of the pair, shape (N,).
    """

    clearance: FloatArray
    pair: IntArray


class PairClearance:
    """The pairs of shapes that must stay apart, and their clearances.

    Attributes:
        pairs: Indices of the checker's shapes, shape (P, 2).
        required: Least distance of each pair, shape (P,) [m]: the largest that a segment requires.
            Pairs in contact at start or goal may be at any distance: -inf.
    """

    def __init__(self, problem: PlanningProblem, extra: float) -> None:
        """Take the pairs of a problem; `extra` [m] is required beyond the problem's clearance."""
        checker = problem.collision
        self._checker, self._robot = checker, problem.robot
        self.pairs = checker.pairs
        required = required_everywhere(problem) + extra
        self.required = np.where(in_contact(problem), -np.inf, required)
        self._bounds = ClearanceBounds(checker, self.pairs, self.required)

    def least(self, q: FloatArray, near: float) -> LeastClearance:
        """Return the least clearances below `near` [m] in configurations (N, n).

        A positive value may be lower than the clearance. A negative value is the clearance of the
        pair that is named; other pairs may have less.
        """
        if len(self.pairs) == 0:
            return LeastClearance(np.full(len(q), np.inf), np.zeros(len(q), dtype=np.int64))
        rotation, position = self._robot.body_poses(q)
        bound, least = self._bounds.at(rotation, position, near)
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
        """Return the clearances of pairs, each in its configuration, and their derivatives.

        Args:
            q: Configurations, shape (N, n).
            pair: Index of each pair, shape (N,).

        Returns:
            Clearances (N,) [m] and their derivatives by the joints (N, n) [m/rad or 1].
        """
        rotation, position = self._robot.body_poses(q)
        pairs = self.pairs[pair]
        closest = self._checker.closest_points(rotation, position, pairs)
        gradient = self._checker.distance_gradient(rotation, position, pairs, closest)
        return closest.distance - self.required[pair], gradient


# ---- Lower bounds on the clearances of pairs of convex shapes in many configurations at once.
# Steps towards the shortest vector between the shapes; two of them separate most pairs.
_MAX_STEPS = 12
_LOOSE = 2e-3  # [m]: largest shortfall of a bound from the distance
_NO_LENGTH = 1e-9  # [m]


class ClearanceBounds:
    """Lower bounds on the clearances of pairs of shapes: distances less the required ones."""

    def __init__(self, shapes: BodyShapes, pairs: IntArray, required: FloatArray) -> None:
        """Take P pairs of shapes (P, 2), and the least distance of each pair, (P,) [m]."""
        self._shapes, self._pairs, self._required = shapes, pairs, required
        self._table = None if LIBRARY.functions is None else _table(shapes.shapes)

    def at(
        self, rotation: FloatArray, position: FloatArray, near: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return lower bounds on clearances [m] in N configurations.

        Where bounding spheres and boxes do not decide, a separating direction is searched for.

        Args:
            rotation: Of all bodies, shape (N, bodies, 3, 3), from `RobotModel.body_poses`.
            position: Likewise, shape (N, bodies, 3) [m].
            near: Clearance from which on values do not matter [m].

        Returns:
            Bounds (N, P), infinite from `near` on, and the least of each configuration, (N,). Never
            above the clearance, except by rounding. Where shapes overlap, bounds are negative, and
            say nothing about the depth.
        """
        if self._table is None:
            bound = self._bounds(rotation, position, near)
            return bound, bound.min(axis=1, initial=np.inf)
        settings = np.array([_MAX_STEPS, _LOOSE, _NO_LENGTH])
        pairs = np.ascontiguousarray(self._pairs)
        poses = rotation, position
        return native_clearance_bounds(self._table, pairs, self._required, settings, poses, near)

    def _bounds(self, rotation: FloatArray, position: FloatArray, near: float) -> FloatArray:
        shapes, pairs, required = self._shapes, self._pairs, self._required
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
    """Return table and vertices of shapes, as `native_clearance_bounds` takes both."""
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


# ---- Lower bounds on the distances of pairs of convex shapes, compiled.
_BOUNDS = native_function(
    "tubeplanner_clearance_bounds",
    *(Doubles, c_int64, Doubles, c_int64, Integers, Doubles, c_int64, Doubles),
    *(Doubles, Doubles, c_int64, c_int64, c_double, Doubles, Doubles),
    returns=c_int,
)


def native_clearance_bounds(
    shapes: tuple[FloatArray, FloatArray],
    pairs: IntArray,
    required: FloatArray,
    settings: FloatArray,
    poses: tuple[FloatArray, FloatArray],
    near: float,
) -> tuple[FloatArray, FloatArray]:
    """Return bounds (N, P) on clearances [m], infinite from `near` on, and each row's least (N,).

    Args:
        shapes: Table (S, 23), and the vertices of all shapes by coordinate, shape (3, V) [m].
        pairs: Rows of the table, shape (P, 2).
        required: Least distance of each pair, shape (P,) [m].
        settings: Of `measurement.clearance_bounds`, in the order in which the sources have them.
        poses: Rotations (N, B, 3, 3) and origins (N, B, 3) [m] of B bodies.
        near: Clearance from which on values do not matter [m].
    """
    assert _BOUNDS is not None
    table, vertices = shapes
    rotation, position = (np.ascontiguousarray(values) for values in poses)
    samples, bodies = position.shape[:2]
    bound, least = np.empty((samples, len(pairs))), np.empty(samples)
    if _BOUNDS(
        *(table, len(table), vertices, vertices.shape[1], pairs, required, len(pairs), settings),
        *(rotation, position, bodies, samples, near, bound, least),
    ):
        raise MemoryError
    return bound, least
