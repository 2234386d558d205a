"""Links against obstacles and against each other: which pairs, and how far apart they are."""

import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.collision.convex_shape import ConvexShape
from tubeplanner.collision.link_geometry import link_contents, link_shapes
from tubeplanner.collision.obstacle import AttachedSolid, Obstacle
from tubeplanner.collision.separation import PlacedShape, Separation, separation
from tubeplanner.errors import ProblemError, unknown_name
from tubeplanner.robot.robot_model import RobotModel

_BASE = 0
# Link pairs that touch in all of so many random configurations are taken to touch always.
_TOUCH_SAMPLES = 400
_TOUCH_SEED = 0


@dataclass(frozen=True, eq=False)
class BodyShape:
    """One convex shape and its owner.

    Attributes:
        owner: Name of the link or obstacle.
        body: Body of the robot that carries it; 0 stands still.
        shape: In the body's frame.
    """

    owner: str
    body: int
    shape: ConvexShape


@dataclass(frozen=True, eq=False)
class ClosestPoints:
    """Where P pairs of shapes are closest.

    Attributes:
        distance: Lower bounds on the signed distances, exact nearly always, shape (P,) [m].
        direction: Unit vectors from the first towards the second shape, base frame, shape (P, 3).
        first: Points of the first shapes (of the cores, if these are rounded), shape (P, 3) [m].
        second: Likewise, of the second shapes.
    """

    distance: FloatArray
    direction: FloatArray
    first: FloatArray
    second: FloatArray


class _PlacedShapes(threading.local):
    """Shapes that are moved to where they are measured, for every thread its own."""

    def __init__(self, shapes: Sequence[BodyShape]) -> None:
        self.shapes = [PlacedShape(body_shape.shape) for body_shape in shapes]


class CollisionChecker:
    """Which pairs of shapes must stay apart, and how far apart they are.

    Several threads may use one checker; it pickles by content, without any file.

    Left out are links that no joint moves against obstacles and each other, links on the same or
    on neighbouring bodies, link pairs that always touch, and the pairs the problem ignores.

    Attributes:
        robot: The arm.
        shapes: All shapes, links first.
        obstacle_pairs: Link against obstacle, as indices of `shapes`: int, shape (P, 2).
        link_pairs: Link against link, likewise.
        pairs: All of them, those with obstacles first.
        has_link_geometry: Whether the robot itself has any collision geometry.
        link_contents: What the links' collision geometry was made from, by link name.
    """

    def __init__(
        self,
        robot: RobotModel,
        obstacles: Sequence[Obstacle] = (),
        *,
        attached: Sequence[AttachedSolid] = (),
        self_collision: bool = True,
        ignore: Sequence[tuple[str, str]] = (),
    ) -> None:
        """Build the geometry.

        Args:
            robot: The arm.
            obstacles: Solids in the base frame.
            attached: Solids in the tool frame; they count as links.
            self_collision: Whether links are checked against each other.
            ignore: Pairs of names of links or obstacles that may touch.

        Raises:
            ProblemError: Two solids or a solid and a link share a name, or an ignored name does
                not exist.
            RobotError: A link's geometry cannot be read.
        """
        links = link_shapes(robot)
        self.has_link_geometry = bool(links)
        self.link_contents = link_contents(robot)
        touching = [(solid.name, link) for solid in attached for link in solid.touch_links]
        _require_names(robot, obstacles, attached, [*ignore, *touching])
        self.robot = robot
        self.shapes = [
            BodyShape(link, robot.link_body[link], shape)
            for link, shapes in links.items()
            for shape in shapes
        ]
        self.shapes += _carried_shapes(robot, attached)
        link_count = len(self.shapes)
        self._obstacle_names = {obstacle.name for obstacle in obstacles}
        self._attached_names = {solid.name for solid in attached}
        self.shapes += [
            BodyShape(obstacle.name, _BASE, shape)
            for obstacle in obstacles
            for shape in obstacle.shapes
        ]
        self._placed = _PlacedShapes(self.shapes)
        self._ignored = {frozenset(pair) for pair in (*ignore, *touching)}
        carried, standing = range(link_count), range(link_count, len(self.shapes))
        self.obstacle_pairs = self._select((i, j) for i in carried for j in standing)
        self.link_pairs = _as_pairs([])
        if self_collision:
            candidates = self._select((i, j) for i in carried for j in carried if i < j)
            self.link_pairs = self._without_always_touching(candidates)
        self.pairs = np.concatenate([self.obstacle_pairs, self.link_pairs])

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "_placed"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._placed = _PlacedShapes(self.shapes)

    def required(self, clearance: float) -> FloatArray:
        """Return the distance that each of `pairs` must keep, shape (P,) [m].

        Args:
            clearance: From obstacles [m]; links must only not overlap.
        """
        counts = [len(self.obstacle_pairs), len(self.link_pairs)]
        return np.repeat([clearance, 0.0], counts)

    def distances(self, rotation: FloatArray, position: FloatArray, pairs: IntArray) -> FloatArray:
        """Return lower bounds on the signed distances of pairs at one configuration [m].

        Args:
            rotation: Of all bodies, shape (bodies, 3, 3), from `RobotModel.body_poses`.
            position: Of all bodies, shape (bodies, 3) [m].
            pairs: Shape (P, 2).

        Returns:
            Shape (P,); negative where shapes overlap. Never above the true distance, except by
            rounding.

        Raises:
            ValueError: A pose is not finite.
        """
        return self.separations(rotation, position, pairs)[0]

    def separations(
        self, rotation: FloatArray, position: FloatArray, pairs: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return `distances`, and the directions along which the shapes are that far apart.

        Returns:
            Distances (P,) [m] and unit vectors (P, 3) from the first towards the second shape of
            each pair, in the frame of the second shape's body.
        """
        found = self._measured(rotation, position, pairs)
        distance = np.array([each.distance for each in found])
        world = np.array([each.direction for each in found]).reshape(-1, 3)
        frames = rotation[np.array([self.shapes[j].body for j in pairs[:, 1]], dtype=np.int64)]
        return distance, np.einsum("pij,pi->pj", frames, world)

    def closest_points(
        self, rotation: FloatArray, position: FloatArray, pairs: IntArray
    ) -> ClosestPoints:
        """Return where pairs are closest, each in its own configuration.

        Args:
            rotation: Shape (P, bodies, 3, 3).
            position: Shape (P, bodies, 3) [m].
            pairs: Shape (P, 2).
        """
        found = [
            self._measured(turned, placed, pair[None])[0]
            for turned, placed, pair in zip(rotation, position, pairs, strict=True)
        ]
        vectors = (
            np.array([each[column] for each in found]).reshape(-1, 3) for column in range(1, 4)
        )
        return ClosestPoints(np.array([each.distance for each in found]), *vectors)

    def distance_gradient(
        self, rotation: FloatArray, position: FloatArray, pairs: IntArray, closest: ClosestPoints
    ) -> FloatArray:
        """Return the derivative of the distances of pairs, each in its own configuration.

        Args:
            rotation: Shape (P, bodies, 3, 3).
            position: Shape (P, bodies, 3) [m].
            pairs: Shape (P, 2).
            closest: What `closest_points` returns of these.

        Returns:
            By the joints, shape (P, n) [m/rad or 1].
        """
        gradient = np.zeros((len(pairs), self.robot.joint_count))
        for sign, column, point in ((-1, 0, closest.first), (1, 1, closest.second)):
            body = np.array([self.shapes[i].body for i in pairs[:, column]], dtype=np.int64)
            moved = self.robot.point_jacobian(rotation, position, body, point)
            gradient += sign * np.einsum("pi,pij->pj", closest.direction, moved)
        return gradient

    def separations_along(
        self,
        rotation: FloatArray,
        position: FloatArray,
        pairs: IntArray,
        direction: FloatArray,
    ) -> FloatArray:
        """Return how far apart pairs are along given directions, each in its own configuration.

        A direction that separates a pair also separates it in neighbouring configurations, almost
        as far: a quick lower bound on the distance.

        Args:
            rotation: Shape (P, bodies, 3, 3).
            position: Shape (P, bodies, 3) [m].
            pairs: Shape (P, 2).
            direction: Unit vectors as from `separations`, shape (P, 3).

        Returns:
            Shape (P,) [m].
        """
        result = np.empty(len(pairs))
        order = np.lexsort(pairs.T)
        groups = np.flatnonzero(np.any(np.diff(pairs[order], axis=0) != 0, axis=1)) + 1
        for rows in np.split(order, groups) if len(order) else ():
            first, second = (self.shapes[index] for index in pairs[rows[0]])
            world_direction = np.einsum("pij,pj->pi", rotation[rows, second.body], direction[rows])
            local = np.einsum("pij,pi->pj", rotation[rows, first.body], world_direction)
            farthest = (local @ first.shape.vertices.T).max(axis=1) + first.shape.radius
            nearest = (direction[rows] @ second.shape.vertices.T).min(axis=1) - second.shape.radius
            offset = position[rows, second.body] - position[rows, first.body]
            result[rows] = nearest - farthest + np.einsum("pi,pi->p", world_direction, offset)
        return result

    def sphere_distances(
        self, rotation: FloatArray, position: FloatArray, pairs: IntArray
    ) -> FloatArray:
        """Return quick, loose lower bounds from bounding spheres for N configurations [m].

        Args:
            rotation: Shape (N, bodies, 3, 3).
            position: Shape (N, bodies, 3) [m].
            pairs: Shape (P, 2).

        Returns:
            Shape (N, P).
        """
        bodies, centers, radii = self._spheres
        world = np.einsum("nsij,sj->nsi", rotation[:, bodies], centers) + position[:, bodies]
        first, second = pairs.T
        gap = np.linalg.norm(world[:, first] - world[:, second], axis=2)
        return gap - radii[first] - radii[second]

    def motion_weights(self, pairs: IntArray) -> FloatArray:
        """Return how fast joints can bring pairs together: shape (P, n) [m per rad or m].

        When the joints travel by `|dq|`, the distance of a pair changes by at most
        `weights @ |dq|`. A joint that moves both shapes of a pair as one does not count.
        """
        bodies = np.array([shape.body for shape in self.shapes], dtype=np.int64)
        reach = np.array([shape.shape.reach(np.zeros(3)) for shape in self.shapes])
        first, second = pairs.T
        return self.robot.approach_rates(
            (bodies[first], bodies[second]), (reach[first], reach[second])
        )

    def owners(self, pair: IntArray | tuple[int, int]) -> tuple[tuple[str, ...], str | None]:
        """Return the links of a pair, and its obstacle or None."""
        names = [self.shapes[index].owner for index in pair]
        links = tuple(name for name in names if name not in self._obstacle_names)
        obstacles = [name for name in names if name in self._obstacle_names]
        return links, obstacles[0] if obstacles else None

    def _measured(
        self, rotation: FloatArray, position: FloatArray, pairs: IntArray
    ) -> list[Separation]:
        placed = self._placed.shapes
        for index in set(pairs.flat):
            body = self.shapes[index].body
            placed[index].move(rotation[body], position[body])
        return [separation(placed[i], placed[j]) for i, j in pairs]

    @cached_property
    def _spheres(self) -> tuple[IntArray, FloatArray, FloatArray]:
        bodies = np.array([shape.body for shape in self.shapes], dtype=np.int64)
        centers = np.array([shape.shape.center for shape in self.shapes]).reshape(-1, 3)
        return bodies, centers, np.array([shape.shape.bounding_radius for shape in self.shapes])

    def _select(self, pairs: Iterator[tuple[int, int]]) -> IntArray:
        return _as_pairs([pair for pair in pairs if self._must_stay_apart(*pair)])

    def _must_stay_apart(self, i: int, j: int) -> bool:
        first, second = self.shapes[i], self.shapes[j]
        if frozenset((first.owner, second.owner)) in self._ignored:
            return False
        moves = self.robot.carries
        between = moves[first.body] != moves[second.body]
        # Neighbouring links meet at their joint; nothing else may touch.
        solid_names = self._obstacle_names | self._attached_names
        neighbours_may_touch = not {first.owner, second.owner} & solid_names
        return int(between.sum()) > (1 if neighbours_may_touch else 0)

    def _without_always_touching(self, pairs: IntArray) -> IntArray:
        """Return the pairs whose links came apart in at least one random configuration.

        Attached solids stay: only their touch_links may touch them.
        """
        limits = self.robot.limits
        lower, upper = limits.lower_position, limits.upper_position
        low = np.maximum(lower, np.minimum(-np.pi, upper - 2 * np.pi))  # one turn, if there is one
        high = np.minimum(upper, low + 2 * np.pi)
        q = np.random.default_rng(_TOUCH_SEED).uniform(low, high, (_TOUCH_SAMPLES, len(low)))
        rotation, position = self.robot.body_poses(q)
        names = [self._owners(pair) for pair in pairs]
        touching = {name for name in names if not name & self._attached_names}
        for sample in range(_TOUCH_SAMPLES):
            rows = [row for row, name in enumerate(names) if name in touching]
            if not rows:
                break
            distance = self.distances(rotation[sample], position[sample], pairs[rows])
            hit = {names[row] for row, value in zip(rows, distance, strict=True) if value <= 0}
            touching &= hit
        return pairs[[name not in touching for name in names]]

    def _owners(self, pair: IntArray) -> frozenset[str]:
        return frozenset(self.shapes[index].owner for index in pair)


def _as_pairs(pairs: list[tuple[int, int]]) -> IntArray:
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def _carried_shapes(robot: RobotModel, attached: Sequence[AttachedSolid]) -> list[BodyShape]:
    """Return attached solids as shapes of the body that carries the tool."""
    body = robot.link_body[robot.tool_frame]
    placement = robot.link_placement[robot.tool_frame]
    return [
        BodyShape(solid.name, body, shape.transformed(placement))
        for solid in attached
        for shape in solid.shapes
    ]


def _require_names(
    robot: RobotModel,
    obstacles: Sequence[Obstacle],
    attached: Sequence[AttachedSolid],
    ignore: Sequence[tuple[str, str]],
) -> None:
    names = [*(obstacle.name for obstacle in obstacles), *(solid.name for solid in attached)]
    for name in names:
        if names.count(name) > 1:
            raise ProblemError(f"obstacles: the name '{name}' is given {names.count(name)} times")
        if name in robot.link_body:
            raise ProblemError(f"obstacles: '{name}' is also the name of a link; choose another")
    known = [*robot.link_body, *names]
    for pair in ignore:
        for name in pair:
            if name not in known:
                raise ProblemError(
                    f"collision.ignore: {unknown_name('link or obstacle', name, known)}"
                )
