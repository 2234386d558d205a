"""The hash of problems before it came from contents alone: only to recognise files that have it.

It was taken from the convex shapes that covered links and solids, and from the pairs that were
checked. Both are made here as they were then, whatever makes them elsewhere: slabs across the
longest axis of a mesh, and every pair that came apart in a random configuration. To be removed in
version 1.0.
"""

from collections.abc import Iterable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.collision import convex_shape
from tubeplanner.collision.collision_checker import BodyShape
from tubeplanner.collision.convex_shape import ConvexShape, convex_hull
from tubeplanner.collision.hulls import hull
from tubeplanner.collision.link_geometry import link_contents
from tubeplanner.collision.mesh_cover import load_mesh
from tubeplanner.collision.obstacle import AttachedSolid, Obstacle
from tubeplanner.collision.separation import PlacedShapes
from tubeplanner.collision.solid_contents import SolidContents
from tubeplanner.errors import RobotError
from tubeplanner.files.fingerprint import (
    ROBOT_DIGITS,
    hash_of,
    question_parts,
    robot_parts,
    shape_parts,
)
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.robot.robot_model import RobotModel

_DIGITS = 16  # of the former hash
_WORTHWHILE_VOLUME_RATIO, _MAX_SLABS = 0.95, 8
_TOUCH_SAMPLES, _TOUCH_SEED = 400, 0

_Pair = tuple[int, int]


def is_former_hash(text: str) -> bool:
    """Return whether a file's problem hash was made before it came from contents alone."""
    return len(text) == _DIGITS


def former_problem_hash(problem: PlanningProblem) -> str:
    """Return the hash that a problem had before it came from contents alone.

    Raises:
        RobotError: A mesh file is missing: former hashes cannot be made without.
    """
    shapes = _shapes(problem)
    obstacles = {obstacle.name for obstacle in problem.obstacles}
    carried = [i for i, shape in enumerate(shapes) if shape.owner not in obstacles]
    standing = [i for i, shape in enumerate(shapes) if shape.owner in obstacles]
    parts = [*robot_parts(problem.robot), *question_parts(problem), problem.clearance]
    with_obstacles = ((i, j) for i in carried for j in standing)
    pairs = list(_selected(problem, shapes, with_obstacles))
    if problem.self_collision:
        links = _selected(problem, shapes, ((i, j) for i in carried for j in carried if i < j))
        pairs += _coming_apart(problem, shapes, list(links))
    parts += [shapes[i].owner for pair in pairs for i in pair]
    for shape in shapes:
        parts += [shape.owner, *shape_parts(shape.shape)]
    return hash_of(parts, ROBOT_DIGITS)


def _shapes(problem: PlanningProblem) -> list[BodyShape]:
    """Return all shapes as they were: links, attached solids, obstacles."""
    robot = problem.robot
    found = [
        BodyShape(link, robot.link_body[link], shape)
        for link, contents in link_contents(robot).items()
        for one in contents
        for shape in _cover(f"link '{link}'", one, robot.link_placement[link] @ one.placement)
    ]
    body, placement = robot.link_body[robot.tool_frame], robot.link_placement[robot.tool_frame]
    found += [
        BodyShape(solid.name, body, shape.transformed(placement))
        for solid in problem.attached
        for shape in _solid_shapes(solid)
    ]
    return found + [
        BodyShape(obstacle.name, 0, shape)
        for obstacle in problem.obstacles
        for shape in _solid_shapes(obstacle)
    ]


def _solid_shapes(solid: Obstacle | AttachedSolid) -> Iterable[ConvexShape]:
    contents = solid.contents
    if contents is None:
        return solid.shapes
    return _cover(solid.name, contents, contents.placement)


def _cover(owner: str, contents: SolidContents, placement: FloatArray) -> list[ConvexShape]:
    """Return the convex shapes that covered a solid, in a placement (4, 4)."""
    sizes = contents.sizes
    if contents.path is not None:
        if not contents.path.is_file():
            raise RobotError(f"{owner}: mesh {contents.path} does not exist")
        shapes = _slab_cover(load_mesh(owner, Path(contents.path), sizes))
    elif contents.kind == "box":
        shapes = [convex_shape.box(sizes)]
    else:
        shapes = [getattr(convex_shape, contents.kind)(*sizes)]
    return [shape.transformed(placement) for shape in shapes]


def _selected(
    problem: PlanningProblem, shapes: list[BodyShape], pairs: Iterable[_Pair]
) -> Iterator[_Pair]:
    """Yield the pairs that had to stay apart, as far as names and joints said."""
    ignored = {frozenset(pair) for pair in problem.ignore_collisions}
    ignored |= {frozenset((s.name, link)) for s in problem.attached for link in s.touch_links}
    solids = {obstacle.name for obstacle in problem.obstacles}
    solids |= {solid.name for solid in problem.attached}
    moves = problem.robot.joint_moves_body
    for i, j in pairs:
        owners = frozenset((shapes[i].owner, shapes[j].owner))
        between = int((moves[shapes[i].body] != moves[shapes[j].body]).sum())
        if owners not in ignored and between > (0 if owners & solids else 1):
            yield i, j


def _coming_apart(
    problem: PlanningProblem, shapes: list[BodyShape], pairs: list[_Pair]
) -> list[_Pair]:
    """Return the pairs whose links did not touch in one of some configurations."""
    attached = {solid.name for solid in problem.attached}
    names = [frozenset((shapes[i].owner, shapes[j].owner)) for i, j in pairs]
    touching = {name for name in names if not name & attached}
    placed = PlacedShapes([shape.shape for shape in shapes])
    bodies = np.array([shape.body for shape in shapes], dtype=np.int64)
    for rotation, position in zip(*_touch_poses(problem.robot), strict=True):
        rows = [row for row, name in enumerate(names) if name in touching]
        if not rows:
            break
        asked = np.array([pairs[row] for row in rows])
        on = bodies[asked]
        distance = placed.separations(asked, rotation[on], position[on]).distance
        touching &= {names[row] for row, apart in zip(rows, distance, strict=True) if apart <= 0}
    return [pair for pair, name in zip(pairs, names, strict=True) if name not in touching]


def _touch_poses(robot: RobotModel) -> tuple[FloatArray, FloatArray]:
    """Return the poses of all bodies in the random configurations."""
    lower, upper = robot.limits.lower_position, robot.limits.upper_position
    low = np.maximum(lower, np.minimum(-np.pi, upper - 2 * np.pi))
    high = np.minimum(upper, low + 2 * np.pi)
    q = np.random.default_rng(_TOUCH_SEED).uniform(low, high, (_TOUCH_SAMPLES, len(low)))
    return robot.body_poses(q)


def _slab_cover(mesh: Any) -> list[ConvexShape]:
    """Return the slab hulls that covered a mesh of trimesh."""
    cover = [convex_hull(mesh.vertices)]
    slabs = 2
    while slabs <= _MAX_SLABS:
        axis = int(np.argmax(mesh.extents))
        bounds = np.linspace(mesh.bounds[0, axis], mesh.bounds[1, axis], slabs + 1)
        finer = [
            convex_hull(points)
            for points in (_slab_points(mesh, axis, low, high) for low, high in pairwise(bounds))
            if len(points)
        ]
        if _volume(finer) > _WORTHWHILE_VOLUME_RATIO * _volume(cover):
            break
        cover, slabs = finer, 2 * slabs
    return cover


def _slab_points(mesh: Any, axis: int, low: float, high: float) -> np.ndarray:
    """Return the mesh's vertices in a slab and where its edges enter and leave the slab."""
    heights = mesh.vertices[:, axis]
    points = [mesh.vertices[(low <= heights) & (heights <= high)]]
    start, end = mesh.vertices[mesh.edges_unique].transpose(1, 0, 2)
    for height in (low, high):
        crossing = (start[:, axis] - height) * (end[:, axis] - height) < 0
        a, b = start[crossing], end[crossing]
        share = (height - a[:, axis]) / (b[:, axis] - a[:, axis])
        points.append(a + share[:, None] * (b - a))
    return np.vstack(points)


def _volume(shapes: list[ConvexShape]) -> float:
    return sum(float(hull(shape.vertices).volume) for shape in shapes)
