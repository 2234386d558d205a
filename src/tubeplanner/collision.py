"""Signed distances between links, and between links and obstacles. All of FCL lives here.

FCL's distances can be too long by millimetres; what is returned here is a rigorous lower bound,
the separation of the two shapes along the direction that FCL finds, and exact nearly always.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import fcl
import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.convex_shape import ConvexShape
from tubeplanner.errors import ProblemError, unknown_name
from tubeplanner.link_geometry import link_shapes
from tubeplanner.obstacle import AttachedSolid, Obstacle
from tubeplanner.robot import RobotModel

_BASE = 0
# FCL needs a solid where a shape is a grown point or edge: a core this thin [m].
_CORE_THICKNESS = 1e-9
_NO_LENGTH = 1e-12  # [m]
# A bound this far below FCL's distance [m] is improved, in at most so many steps.
_LOOSE = 1e-5
_MOST_IMPROVEMENTS = 40
# Link pairs that touch in all of so many random configurations are taken to touch always.
_TOUCH_SAMPLES = 400
_TOUCH_SEED = 0


@dataclass(frozen=True, eq=False)
class BodyShape:
    """One convex shape and what it belongs to.

    Attributes:
        owner: Name of the link or obstacle.
        body: Body of the robot that carries it; 0 stands still.
        shape: In the body's frame.
    """

    owner: str
    body: int
    shape: ConvexShape


class CollisionChecker:
    """Which pairs of shapes must stay apart, and how far apart they are.

    Left out are links that no joint moves against obstacles and each other, links on the same or
    on neighbouring bodies, link pairs that always touch, and the pairs the problem ignores.

    Attributes:
        robot: The arm.
        shapes: All shapes, links first.
        obstacle_pairs: Link against obstacle, as indices of `shapes`: int, shape (P, 2).
        link_pairs: Link against link, likewise.
        has_link_geometry: Whether the robot itself has any collision geometry.
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
        self._objects = [_fcl_object(body_shape.shape) for body_shape in self.shapes]
        self._ignored = {frozenset(pair) for pair in (*ignore, *touching)}
        carried, standing = range(link_count), range(link_count, len(self.shapes))
        self.obstacle_pairs = self._select((i, j) for i in carried for j in standing)
        self.link_pairs = _as_pairs([])
        if self_collision:
            candidates = self._select((i, j) for i in carried for j in carried if i < j)
            self.link_pairs = self._without_always_touching(candidates)

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
        for index in np.unique(pairs):
            self._objects[index].move(rotation, position, self.shapes[index].body)
        return np.array([_separation(self._objects[i], self._objects[j]) for i, j in pairs])

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
        `weights @ |dq|`. A joint that moves both shapes of a pair does not count.
        """
        robot = self.robot
        bodies = np.array([shape.body for shape in self.shapes])
        reach = np.array([shape.shape.reach(np.zeros(3)) for shape in self.shapes])
        weights = np.where(robot.revolute, robot.lever_arm[bodies] + reach[:, None], 1.0)
        moves = robot.joint_moves_body[bodies]
        first, second = pairs.T
        relative = moves[first] != moves[second]
        return np.where(relative, np.where(moves[first], weights[first], weights[second]), 0.0)

    def owners(self, pair: IntArray | tuple[int, int]) -> tuple[tuple[str, ...], str | None]:
        """Return the links of a pair, and its obstacle or None."""
        names = [self.shapes[index].owner for index in pair]
        links = tuple(name for name in names if name not in self._obstacle_names)
        obstacles = [name for name in names if name in self._obstacle_names]
        return links, obstacles[0] if obstacles else None

    @cached_property
    def _spheres(self) -> tuple[IntArray, FloatArray, FloatArray]:
        bodies = np.array([shape.body for shape in self.shapes])
        centers = np.array([shape.shape.center for shape in self.shapes])
        return bodies, centers, np.array([shape.shape.bounding_radius for shape in self.shapes])

    def _select(self, pairs: Iterator[tuple[int, int]]) -> IntArray:
        return _as_pairs([pair for pair in pairs if self._must_stay_apart(*pair)])

    def _must_stay_apart(self, i: int, j: int) -> bool:
        first, second = self.shapes[i], self.shapes[j]
        if frozenset((first.owner, second.owner)) in self._ignored:
            return False
        moves = self.robot.joint_moves_body
        between = moves[first.body] != moves[second.body]
        # Neighbouring links meet at their joint; nothing else has a right to touch.
        solid_names = self._obstacle_names | self._attached_names
        neighbours_may_touch = not {first.owner, second.owner} & solid_names
        return int(between.sum()) > (1 if neighbours_may_touch else 0)

    def _without_always_touching(self, pairs: IntArray) -> IntArray:
        """Return the pairs whose links came apart in at least one random configuration.

        Attached solids stay: only their touch_links excuse them.
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


class _FclObject:
    """A shape as FCL sees it, and its vertices for the separation along a direction."""

    def __init__(self, geometry: object, core: FloatArray, shape: ConvexShape) -> None:
        self._object = fcl.CollisionObject(geometry)
        self._core = core  # pose of the FCL geometry in the body's frame, shape (4, 4)
        self._vertices = shape.vertices
        self._center = shape.center
        self.radius = shape.radius

    def move(self, rotation: FloatArray, position: FloatArray, body: int) -> None:
        """Place the shape: poses of all bodies, and the body that carries it.

        FCL ends the process on a pose that is not finite.
        """
        if not (np.isfinite(rotation[body]).all() and np.isfinite(position[body]).all()):
            raise ValueError("poses must be finite")
        self._rotation, self._position = rotation[body], position[body]
        core_rotation = self._rotation @ self._core[:3, :3]
        core_position = self._rotation @ self._core[:3, 3] + self._position
        self._object.setTransform(fcl.Transform(core_rotation, core_position))

    def extremes(self, direction: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the core's vertices farthest back and farthest ahead along a direction, (3,)."""
        along = self._vertices @ (self._rotation.T @ direction)
        ends = self._vertices[[along.argmin(), along.argmax()]]
        back, ahead = ends @ self._rotation.T + self._position
        return back, ahead

    def gap_to(self, other: "_FclObject") -> tuple[FloatArray, bool]:
        """Return the vector between FCL's nearest points, and whether the cores overlap."""
        request = fcl.DistanceRequest(enable_nearest_points=True, enable_signed_distance=True)
        result = fcl.DistanceResult()
        distance = fcl.distance(self._object, other._object, request, result)
        near, far = result.nearest_points
        for gap in (far - near, other._world_center() - self._world_center(), np.eye(3)[0]):
            if np.linalg.norm(gap) > _NO_LENGTH:
                return gap, distance <= 0
        raise AssertionError("the last candidate has length 1")

    def _world_center(self) -> FloatArray:
        return self._rotation @ self._center + self._position


def _separation(first: _FclObject, second: _FclObject) -> float:
    """Return a lower bound on the signed distance of two placed shapes [m].

    Any direction gives a bound: how far the second begins beyond the end of the first. FCL's
    nearest points give the best direction nearly always. Where they do not, it is improved by
    Gilbert's iteration ("An iterative procedure for computing the minimum of a quadratic form on
    a convex set", 1966): the shortest vector to the set of differences of both cores' points.
    """
    gap, overlap = first.gap_to(second)
    best = -np.inf
    for _ in range(_MOST_IMPROVEMENTS):
        length = float(np.linalg.norm(gap))
        direction = gap / length
        back_1, ahead_1 = first.extremes(direction)
        back_2, ahead_2 = second.extremes(direction)
        difference = back_2 - ahead_1
        best = max(best, float(direction @ difference), float(direction @ (back_1 - ahead_2)))
        if overlap or best > length - _LOOSE:
            break
        gap = _nearest_to_origin(gap, difference)
        if np.linalg.norm(gap) < _LOOSE:
            break
    return best - first.radius - second.radius


def _nearest_to_origin(start: FloatArray, end: FloatArray) -> FloatArray:
    """Return the point of a straight line between two points that is nearest to the origin."""
    along = end - start
    share = -float(start @ along) / max(float(along @ along), _NO_LENGTH**2)
    return start + min(max(share, 0.0), 1.0) * along


def _fcl_object(shape: ConvexShape) -> _FclObject:
    core = np.eye(4)
    if len(shape.vertices) > 2:
        triangles = shape.faces
        faces = np.hstack([np.full((len(triangles), 1), 3), triangles]).ravel()
        return _FclObject(fcl.Convex(shape.vertices, len(triangles), faces), core, shape)
    core[:3, 3] = shape.center
    if len(shape.vertices) == 1:
        return _FclObject(fcl.Sphere(_CORE_THICKNESS), core, shape)
    edge = shape.vertices[1] - shape.vertices[0]
    length = float(np.linalg.norm(edge))
    core[:3, :3] = _frame_along(edge / length)
    geometry = fcl.Box(_CORE_THICKNESS, _CORE_THICKNESS, length)
    return _FclObject(geometry, core, shape)


def _frame_along(z: FloatArray) -> FloatArray:
    """Return a rotation whose third column is the unit vector z."""
    x = np.cross(np.eye(3)[int(np.argmin(abs(z)))], z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


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
