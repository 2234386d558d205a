"""Collision shapes of a robot's links: its URDF geometry, covered by convex shapes."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.collision.convex_shape import (
    ConvexShape,
    box,
    cylinder,
    inscribed_cylinder,
    sphere,
)
from tubeplanner.collision.link_elements import MESH, LinkElement, link_elements
from tubeplanner.collision.mesh_file import MeshFile
from tubeplanner.collision.mesh_solid import MeshSolid
from tubeplanner.collision.solid_contents import (
    SolidContents,
    mesh_contents,
    simple_contents,
)
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
    return {
        link: [_part(robot, link, element) for element in own]
        for link, own in link_elements(robot).items()
    }


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
        link: tuple(_contents(robot, element) for element in own)
        for link, own in link_elements(robot).items()
    }


def simple_shape(element: LinkElement) -> ConvexShape | None:
    """Return an element that is no mesh as a shape, in its own frame; None if it is one."""
    if element.kind == "box":
        return box(element.sizes)
    if element.kind == "sphere":
        return sphere(*element.sizes)
    if element.kind == "cylinder":
        return cylinder(*element.sizes)
    return None


def _part(robot: RobotModel, link: str, element: LinkElement) -> LinkPart:
    placement = robot.link_placement[link] @ element.placement
    if element.kind == MESH:
        path = _mesh_path(robot, element)
        return LinkPart(placement, MeshFile(f"link '{link}'", path, element.sizes))
    simple = core = simple_shape(element)
    if element.kind == "cylinder":
        core = inscribed_cylinder(*element.sizes)
    return LinkPart(placement, shape=simple, core=core)


def _contents(robot: RobotModel, element: LinkElement) -> SolidContents:
    """Return what one <collision> was made from."""
    if element.kind == MESH:
        return mesh_contents(_mesh_path(robot, element), element.sizes, element.placement)
    return simple_contents(element.kind, element.sizes, element.placement)


def _mesh_path(robot: RobotModel, element: LinkElement) -> Path:
    return find_mesh(element.filename, robot.urdf.path, robot.package_dirs)
