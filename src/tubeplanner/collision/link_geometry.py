"""Collision shapes of a robot's links: its URDF geometry, covered by convex shapes.

yourdfpy reads the URDF's geometry; it is imported when first needed.
"""

import io
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.collision.convex_shape import (
    ConvexShape,
    box,
    cylinder,
    inscribed_cylinder,
    sphere,
)
from tubeplanner.collision.mesh_file import MeshFile
from tubeplanner.collision.mesh_solid import MeshSolid
from tubeplanner.collision.solid_contents import (
    SolidContents,
    mesh_contents,
    simple_contents,
)
from tubeplanner.errors import RobotError
from tubeplanner.resources import find_mesh
from tubeplanner.robot.robot_model import RobotModel


@dataclass(frozen=True, eq=False)
class LinkPart:
    """One collision element of a link.

    Attributes:
        placement: Of the element in the frame of the link's body, shape (4, 4).
        mesh: The mesh, or None.
        shape: What covers the element if it is no mesh, in its own frame.
        core: What is inside of it, likewise: the same but for cylinders.
    """

    placement: FloatArray
    mesh: MeshFile | None = None
    shape: ConvexShape | None = None
    core: ConvexShape | None = None

    def cover(self) -> list[ConvexShape]:
        """Return shapes that cover the element, in the body's frame."""
        shapes = [self.shape] if self.mesh is None else self.mesh.cover()
        return [shape.transformed(self.placement) for shape in shapes if shape is not None]

    @cached_property
    def solid(self) -> MeshSolid:
        """The element as it is, in the body's frame."""
        if self.mesh is not None:
            return self.mesh.solid.moved(self.placement)
        assert self.core is not None
        return MeshSolid.of_shape(self.core).moved(self.placement)

    def outer_error(self) -> float:
        """Return the largest distance found from the cover's surface to the element [m]."""
        if self.mesh is not None:
            return self.mesh.outer_error()
        assert self.shape is not None and self.core is not None
        if self.core is self.shape:
            return 0.0
        return float(MeshSolid.of_shape(self.core).distance(self.shape.vertices).max())

    def contents(self) -> Iterator[str | FloatArray]:
        """Yield what the element is, to be hashed."""
        yield self.placement
        if self.mesh is not None:
            yield self.mesh.key or ""
        for shape in (self.shape, self.core):
            if shape is not None:
                yield from (shape.vertices, np.array([shape.radius]))


def link_parts(robot: RobotModel) -> dict[str, list[LinkPart]]:
    """Return the collision elements of every link that has any, by link name.

    Raises:
        RobotError: A mesh is missing, or a geometry is of a kind no URDF has.
    """
    parts: dict[str, list[LinkPart]] = {}
    for link in read_geometry(robot).links:
        placement = robot.link_placement[link.name]
        elements = [
            _part(robot, link.name, placement @ placement_in_link(collision), collision.geometry)
            for collision in link.collisions
        ]
        if elements:
            parts[link.name] = elements
    return parts


def link_shapes(robot: RobotModel) -> dict[str, list[ConvexShape]]:
    """Return the convex shapes of every link that has collision geometry.

    Returns:
        By link name: shapes in the frame of the link's body, which together cover the link. A
        mesh whose hull is too fat is cut into slabs along its longest axis, each slab's hull one
        shape.

    Raises:
        RobotError: A mesh is missing or unreadable, or a geometry is of a kind no URDF has.
    """
    parts = link_parts(robot)
    return {link: [shape for part in own for shape in part.cover()] for link, own in parts.items()}


def link_contents(robot: RobotModel) -> dict[str, tuple[SolidContents, ...]]:
    """Return what the collision geometry of every link that has any was made from.

    Returns:
        By link name: one entry per <collision>, placed in the frame of the link.

    Raises:
        RobotError: As `link_shapes`.
    """
    return {
        link.name: tuple(_contents(robot, link.name, element) for element in link.collisions)
        for link in read_geometry(robot).links
        if link.collisions
    }


@lru_cache(maxsize=1)
def read_geometry(robot: RobotModel) -> Any:
    """Return links and materials of a robot's URDF, as yourdfpy has them; meshes are not loaded.

    Raises:
        RobotError: A geometry is of a kind no URDF has.
    """
    import yourdfpy

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
    return parsed.robot


def placement_in_link(element: Any) -> np.ndarray:
    """Return where a collision or visual element is in its link, shape (4, 4)."""
    return np.eye(4) if element.origin is None else element.origin


def _part(robot: RobotModel, link: str, placement: FloatArray, geometry: Any) -> LinkPart:
    simple = simple_shape(geometry)
    if simple is not None:
        core = simple
        if geometry.cylinder is not None:
            core = inscribed_cylinder(geometry.cylinder.radius, geometry.cylinder.length)
        return LinkPart(placement, shape=simple, core=core)
    if geometry.mesh is not None:
        path = find_mesh(geometry.mesh.filename, robot.urdf.path, robot.package_dirs)
        return LinkPart(placement, MeshFile(f"link '{link}'", path, geometry.mesh.scale))
    raise _no_known_geometry(robot, link)


def _contents(robot: RobotModel, link: str, element: Any) -> SolidContents:
    """Return what one <collision> was made from."""
    geometry, placement = element.geometry, placement_in_link(element)
    if geometry.box is not None:
        return simple_contents("box", geometry.box.size, placement)
    if geometry.sphere is not None:
        return simple_contents("sphere", [geometry.sphere.radius], placement)
    if geometry.cylinder is not None:
        sizes = [geometry.cylinder.radius, geometry.cylinder.length]
        return simple_contents("cylinder", sizes, placement)
    if geometry.mesh is None:
        raise _no_known_geometry(robot, link)
    path = find_mesh(geometry.mesh.filename, robot.urdf.path, robot.package_dirs)
    scale = 1.0 if geometry.mesh.scale is None else geometry.mesh.scale
    return mesh_contents(path, np.broadcast_to(scale, 3), placement)


def _no_known_geometry(robot: RobotModel, link: str) -> RobotError:
    return RobotError(
        f"{robot.urdf.path}: link '{link}' has a <collision> without a known geometry"
    )


def simple_shape(geometry: Any) -> ConvexShape | None:
    """Return a URDF geometry that is no mesh as a shape, in its own frame; None if it is one."""
    if geometry.box is not None:
        return box(geometry.box.size)
    if geometry.sphere is not None:
        return sphere(geometry.sphere.radius)
    if geometry.cylinder is not None:
        return cylinder(geometry.cylinder.radius, geometry.cylinder.length)
    return None
