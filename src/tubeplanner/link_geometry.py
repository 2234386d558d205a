"""Collision shapes of a robot's links: its URDF geometry, covered by convex shapes.

yourdfpy reads the URDF's geometry, trimesh the meshes; both are imported when first needed.
"""

import io
import logging
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from tubeplanner.convex_shape import ConvexShape, box, convex_hull, cylinder, sphere
from tubeplanner.errors import RobotError
from tubeplanner.resources import find_mesh
from tubeplanner.robot import RobotModel

if TYPE_CHECKING:
    import trimesh

# A mesh is cut into twice as many slabs as long as that makes its cover this much smaller.
_WORTHWHILE_VOLUME_RATIO = 0.95
_MOST_SLABS = 8


def link_shapes(robot: RobotModel) -> dict[str, list[ConvexShape]]:
    """Return the convex shapes of every link that has collision geometry.

    Returns:
        By link name: shapes in the frame of the link's body, which together cover the link. A
        mesh whose hull is too fat is cut into slabs along its longest axis, each slab's hull one
        shape.

    Raises:
        RobotError: A mesh is missing or unreadable, or a geometry is of a kind no URDF has.
    """
    shapes: dict[str, list[ConvexShape]] = {}
    for link in _read_links(robot):
        placement = robot.link_placement[link.name]
        covers = [
            shape.transformed(placement @ _origin(collision))
            for collision in link.collisions
            for shape in _cover(robot, link.name, collision.geometry)
        ]
        if covers:
            shapes[link.name] = covers
    return shapes


def _read_links(robot: RobotModel) -> list[Any]:
    import yourdfpy

    logging.getLogger("yourdfpy").setLevel(logging.ERROR)
    source = robot.urdf
    try:
        parsed = yourdfpy.URDF.load(
            io.BytesIO(source.xml),
            build_scene_graph=False,
            load_meshes=False,
            build_collision_scene_graph=False,
            load_collision_meshes=False,
            filename_handler=partial(find_mesh, urdf=source.path, package_dirs=robot.package_dirs),
        )
    except (ValueError, IndexError, TypeError, KeyError, AttributeError) as error:
        raise RobotError(f"{source.path}: link geometry cannot be read: {error}") from error
    return parsed.robot.links


def _origin(collision: Any) -> np.ndarray:
    return np.eye(4) if collision.origin is None else collision.origin


def _cover(robot: RobotModel, link: str, geometry: Any) -> list[ConvexShape]:
    """Return convex shapes that cover one URDF geometry, in its own frame."""
    if geometry.box is not None:
        return [box(geometry.box.size)]
    if geometry.sphere is not None:
        return [sphere(geometry.sphere.radius)]
    if geometry.cylinder is not None:
        return [cylinder(geometry.cylinder.radius, geometry.cylinder.length)]
    if geometry.mesh is not None:
        return cover_mesh(_load_mesh(robot, link, geometry.mesh))
    raise RobotError(f"{robot.urdf.path}: link '{link}' has a <collision> without a known geometry")


def _load_mesh(robot: RobotModel, link: str, mesh: Any) -> "trimesh.Trimesh":
    import trimesh

    path = find_mesh(mesh.filename, robot.urdf.path, robot.package_dirs)
    try:
        loaded = trimesh.load(str(path), force="mesh")
    except Exception as error:  # trimesh's readers raise whatever their formats' libraries raise
        raise RobotError(
            f"link '{link}': mesh {path} is no readable {path.suffix[1:].upper()} file; export it "
            f"again ({error})"
        ) from error
    if len(loaded.vertices) == 0 or not np.isfinite(loaded.vertices).all():
        raise RobotError(
            f"link '{link}': mesh {path} has no vertices, or some that are not finite; export it "
            "again"
        )
    if mesh.scale is not None:
        loaded.apply_scale(mesh.scale)
    return loaded


def cover_mesh(mesh: "trimesh.Trimesh") -> list[ConvexShape]:
    """Return as few slab hulls as cover a mesh closely.

    The solid inside a slab lies in the hull of the surface inside that slab, because every
    cross-section is bounded by surface.
    """
    cover = [convex_hull(mesh.vertices)]
    slabs = 2
    while slabs <= _MOST_SLABS:
        finer = _slab_hulls(mesh, slabs)
        if _volume(finer) > _WORTHWHILE_VOLUME_RATIO * _volume(cover):
            break
        cover, slabs = finer, 2 * slabs
    return cover


def _slab_hulls(mesh: "trimesh.Trimesh", count: int) -> list[ConvexShape]:
    axis = int(np.argmax(mesh.extents))
    bounds = np.linspace(mesh.bounds[0, axis], mesh.bounds[1, axis], count + 1)
    return [
        convex_hull(points)
        for points in (_slab_points(mesh, axis, low, high) for low, high in pairwise(bounds))
        if len(points)
    ]


def _slab_points(mesh: "trimesh.Trimesh", axis: int, low: float, high: float) -> np.ndarray:
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
    from scipy.spatial import ConvexHull

    return sum(float(ConvexHull(shape.vertices).volume) for shape in shapes)
