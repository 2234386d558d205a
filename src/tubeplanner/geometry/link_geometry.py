"""Collision elements of the links and their convex covers."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from tubeplanner.arrays import FloatArray, read_only
from tubeplanner.geometry.convex_shapes import (
    ConvexShape,
    box,
    capsule,
    cylinder,
    extent_of,
    inscribed_cylinder,
    sphere,
)
from tubeplanner.geometry.distances import MeshSolid
from tubeplanner.geometry.meshes import MeshFile
from tubeplanner.geometry.solids import SolidContents, mesh_contents, simple_contents
from tubeplanner.resources import find_mesh
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.notes import Extent
from tubeplanner.robot.urdf_elements import read_placement, read_shape

MESH = "mesh"


@dataclass(frozen=True, eq=False)
class LinkElement:
    """A <collision> or <visual> of a link.

    Attributes:
        kind: "box", "sphere", "cylinder", "capsule" or "mesh".
        sizes: Side lengths, radius, or radius and length [m]; of a mesh its scale along each axis.
        placement: Pose in the link, shape (4, 4).
        filename: Of the mesh, as in the URDF; empty for other kinds.
    """

    kind: str
    sizes: tuple[float, ...]
    placement: FloatArray
    filename: str = ""


def link_elements(robot: RobotModel) -> dict[str, list[LinkElement]]:
    """Return the collision elements of every link that has any, by link name.

    Raises:
        RobotError: The geometry cannot be read, or is of a kind no URDF has.
    """
    result: dict[str, list[LinkElement]] = {}
    for link in robot.urdf.links:
        where = f"{robot.urdf.path}: link '{link}'"
        for collision in robot.urdf.link_element(link).findall("collision"):
            result.setdefault(link, []).append(element_of(where, collision))
    return result


def element_of(where: str, element: Element) -> LinkElement:
    """Return a <collision> or <visual> of a URDF; messages begin with its label.

    Raises:
        RobotError: Its geometry is of an unknown kind, or a number cannot be read.
    """
    kind, sizes, filename = read_shape(where, element)
    return LinkElement(kind, sizes, read_only(read_placement(where, element)), filename)


# ---- Collision shapes of a robot's links: its URDF geometry, covered by convex shapes.


@dataclass(frozen=True, eq=False)
class LinkPart:
    """A collision element of a link with its shapes.

    Attributes:
        placement: Of the element in the frame of the link's body, shape (4, 4).
        mesh: The mesh, or None.
        shape: Cover of an element that is no mesh, in its own frame.
        core: Solid inside the element, likewise: the same but for cylinders.
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
        """The element without a cover, in the body's frame."""
        if self.mesh is not None:
            return self.mesh.solid.moved(self.placement)
        assert self.core is not None
        return MeshSolid.of_shape(self.core).moved(self.placement)

    def extent(self) -> FloatArray:
        """Return the least and the largest coordinates, shape (2, 3) [m], in the body's frame."""
        shape = self.shape
        if self.mesh is not None:
            low, high = self.mesh.extent()
            shape = ConvexShape((low + high) / 2 + box(high - low).vertices)
        assert shape is not None
        return extent_of([shape.transformed(self.placement)])

    def outer_error(self) -> float:
        """Return the largest distance found from the cover's surface to the element [m]."""
        if self.mesh is not None:
            return self.mesh.outer_error()
        assert self.shape is not None and self.core is not None
        if self.core is self.shape:
            return 0.0
        return float(MeshSolid.of_shape(self.core).distance(self.shape.vertices).max())

    def contents(self) -> Iterator[str | FloatArray]:
        """Yield the content of the element, for hashes."""
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
    result: dict[str, list[LinkPart]] = {}
    for link, elements in link_elements(robot).items():
        result[link] = []
        for element in elements:
            placement = robot.link_placement[link] @ element.placement
            if element.kind == MESH:
                mesh = MeshFile(f"link '{link}'", _mesh_path(robot, element), element.sizes)
                part = LinkPart(placement, mesh)
            else:
                simple = core = simple_shape(element)
                if element.kind == "cylinder":
                    core = inscribed_cylinder(*element.sizes)
                part = LinkPart(placement, shape=simple, core=core)
            result[link].append(part)
    return result


def link_extents(robot: RobotModel) -> dict[str, Extent]:
    """Return the extents of the links that have collision geometry, by label.

    Raises:
        RobotError: As `link_shapes`.
    """
    extents = {}
    for link, parts in link_parts(robot).items():
        lows, highs = zip(*(part.extent() for part in parts), strict=True)
        extent = np.array([np.min(lows, axis=0), np.max(highs, axis=0)])
        extents[f"link '{link}'"] = Extent(robot.link_body[link], extent)
    return extents


def link_shapes(robot: RobotModel) -> dict[str, list[ConvexShape]]:
    """Return the convex shapes of all links that have collision geometry, by link name.

    The shapes, in the frame of the link's body, together cover the link. A mesh whose hull is too
    fat is cut into slabs along its longest axis, each slab's hull a shape.

    Raises:
        RobotError: A mesh is missing or unreadable, or a geometry is of a kind no URDF has.
    """
    parts = link_parts(robot)
    return {link: [shape for part in own for shape in part.cover()] for link, own in parts.items()}


def link_contents(robot: RobotModel) -> dict[str, tuple[SolidContents, ...]]:
    """Return the source of the collision geometry of all links that have any, by link name.

    Of each <collision> an entry, placed in the frame of the link.

    Raises:
        RobotError: As `link_shapes`.
    """
    result = {}
    for link, elements in link_elements(robot).items():
        contents = []
        for each in elements:
            if each.kind == MESH:
                mesh = MeshFile(f"link '{link}'", _mesh_path(robot, each), each.sizes)
                contents.append(mesh_contents(mesh, each.sizes, each.placement))
            else:
                contents.append(simple_contents(each.kind, each.sizes, each.placement))
        result[link] = tuple(contents)
    return result


def simple_shape(element: LinkElement) -> ConvexShape | None:
    """Return the shape of an element in its own frame; None for a mesh."""
    if element.kind == "box":
        return box(element.sizes)
    if element.kind == "sphere":
        return sphere(*element.sizes)
    if element.kind == "cylinder":
        return cylinder(*element.sizes)
    if element.kind == "capsule":
        return capsule(*element.sizes)
    return None


def _mesh_path(robot: RobotModel, element: LinkElement) -> Path:
    return find_mesh(element.filename, robot.urdf.path, robot.package_dirs)
