"""Collision elements of the links and their convex covers."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from xml.etree.ElementTree import Element

import numpy as np

from tubeplanner.arrays import FloatArray, read_only
from tubeplanner.geometry.convex_shapes import (
    ConvexShape,
    box,
    extent_of,
    inscribed_cylinder,
    simple_shape,
)
from tubeplanner.geometry.mesh_solids import MeshSolid
from tubeplanner.geometry.meshes import MeshFile
from tubeplanner.geometry.solids import SolidContents, mesh_contents, simple_contents
from tubeplanner.resources import find_mesh
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.notes import Extent
from tubeplanner.robot.urdf_elements import read_placement, read_shape

MESH = "mesh"


@dataclass(frozen=True, eq=False)
class LinkElement:
    """A <collision> or <visual> of a link."""

    kind: str  # "box", "sphere", "cylinder", "capsule" or "mesh"
    # side lengths, radius, or radius and length [m]; of a mesh its scale along each axis
    sizes: tuple[float, ...]
    placement: FloatArray  # pose in the link, shape (4, 4)
    filename: str = ""  # of the mesh, as in the URDF; empty for other kinds


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
    """A collision element of a link with its shapes."""

    element: LinkElement  # in the frame of the link
    placement: FloatArray  # of the element in the frame of the link's body, shape (4, 4)
    mesh: MeshFile | None  # None for other kinds

    @cached_property
    def _shape(self) -> ConvexShape:
        """Cover of an element that is no mesh, in its own frame."""
        return simple_shape(self.element.kind, self.element.sizes)

    @cached_property
    def _core(self) -> ConvexShape:
        """Solid inside an element that is no mesh: its shape but for cylinders."""
        is_round = self.element.kind == "cylinder"
        return inscribed_cylinder(*self.element.sizes) if is_round else self._shape

    def cover(self) -> list[ConvexShape]:
        """Return shapes that cover the element, in the body's frame."""
        shapes = [self._shape] if self.mesh is None else self.mesh.cover()
        return [shape.transformed(self.placement) for shape in shapes]

    @cached_property
    def solid(self) -> MeshSolid:
        """The element without a cover, in the body's frame."""
        solid = MeshSolid.of_shape(self._core) if self.mesh is None else self.mesh.solid
        return solid.moved(self.placement)

    def extent(self) -> FloatArray:
        """Return the least and the largest coordinates, shape (2, 3) [m], in the body's frame."""
        if self.mesh is None:
            return extent_of([self._shape.transformed(self.placement)])
        low, high = self.mesh.extent()
        around = ConvexShape((low + high) / 2 + box(high - low).vertices)
        return extent_of([around.transformed(self.placement)])

    def outer_error(self) -> float:
        """Return the largest distance found from the cover's surface to the element [m]."""
        if self.mesh is not None:
            return self.mesh.outer_error()
        if self._core is self._shape:
            return 0.0
        return float(MeshSolid.of_shape(self._core).distance(self._shape.vertices).max())

    def source(self) -> SolidContents:
        """Return the source of the element, placed in the frame of the link."""
        element = self.element
        if self.mesh is not None:
            return mesh_contents(self.mesh, element.sizes, element.placement)
        return simple_contents(element.kind, element.sizes, element.placement)

    def contents(self) -> Iterator[str | FloatArray]:
        """Yield the content of the element, for hashes."""
        yield self.placement
        if self.mesh is not None:
            yield self.mesh.key or ""
            return
        for shape in (self._shape, self._core):
            yield from (shape.vertices, np.array([shape.radius]))


def link_parts(robot: RobotModel) -> dict[str, list[LinkPart]]:
    """Return the collision elements of every link that has any, by link name.

    Raises:
        RobotError: A mesh is missing, or a geometry is of a kind no URDF has.
    """
    result: dict[str, list[LinkPart]] = {}
    for link, elements in link_elements(robot).items():
        for element in elements:
            mesh = None
            if element.kind == MESH:
                path = find_mesh(element.filename, robot.urdf.path, robot.package_dirs)
                mesh = MeshFile(f"link '{link}'", path, element.sizes)
            part = LinkPart(element, robot.link_placement[link] @ element.placement, mesh)
            result.setdefault(link, []).append(part)
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
    """Return the sources of all links' elements, in the links' frames, by link name.

    Raises:
        RobotError: As `link_shapes`.
    """
    parts = link_parts(robot)
    return {link: tuple(part.source() for part in own) for link, own in parts.items()}
