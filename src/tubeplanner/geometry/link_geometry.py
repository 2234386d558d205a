"""Collision elements of the links and their convex covers.

yourdfpy reads the elements; it is imported on first use: never for cached elements.
"""

import io
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray, read_only
from tubeplanner.errors import RobotError
from tubeplanner.geometry.convex_shapes import (
    ConvexShape,
    box,
    cylinder,
    extent_of,
    inscribed_cylinder,
    sphere,
)
from tubeplanner.geometry.cover_cache import Arrays, cached, content_hash
from tubeplanner.geometry.distances import MeshSolid
from tubeplanner.geometry.meshes import MeshFile
from tubeplanner.geometry.solids import SolidContents, mesh_contents, simple_contents
from tubeplanner.resources import find_mesh
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.notes import Extent

MESH = "mesh"
_MAX_SIZES = 3


@dataclass(frozen=True, eq=False)
class LinkElement:
    """A <collision> or <visual> of a link.

    Attributes:
        kind: "box", "sphere", "cylinder" or "mesh".
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
    key = content_hash([robot.urdf.xml])
    return _of_arrays(cached("elements", key, lambda: _as_arrays(_read_elements(robot))))


def element_of(element: Any) -> LinkElement | None:
    """Return a <collision> or <visual> read by yourdfpy; None if its geometry is not known."""
    geometry = element.geometry
    placement = read_only(np.eye(4) if element.origin is None else element.origin)
    if geometry.box is not None:
        return LinkElement("box", _numbers(geometry.box.size), placement)
    if geometry.sphere is not None:
        return LinkElement("sphere", _numbers([geometry.sphere.radius]), placement)
    if geometry.cylinder is not None:
        sizes = [geometry.cylinder.radius, geometry.cylinder.length]
        return LinkElement("cylinder", _numbers(sizes), placement)
    if geometry.mesh is None:
        return None
    scale = 1.0 if geometry.mesh.scale is None else geometry.mesh.scale
    return LinkElement(MESH, _numbers(np.broadcast_to(scale, 3)), placement, geometry.mesh.filename)


@lru_cache(maxsize=1)
def read_geometry(robot: RobotModel) -> Any:
    """Return links and materials of a robot's URDF, read by yourdfpy; meshes are not loaded.

    Raises:
        RobotError: The geometry cannot be read.
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


def _read_elements(robot: RobotModel) -> dict[str, list[LinkElement]]:
    result: dict[str, list[LinkElement]] = {}
    for link in read_geometry(robot).links:
        for collision in link.collisions:
            element = element_of(collision)
            if element is None:
                raise RobotError(
                    f"{robot.urdf.path}: link '{link.name}' has a <collision> without a known "
                    "geometry"
                )
            result.setdefault(link.name, []).append(element)
    return result


def _numbers(values: Any) -> tuple[float, ...]:
    return tuple(float(value) for value in values)


def _as_arrays(elements: Mapping[str, list[LinkElement]]) -> Arrays:
    every = [(link, element) for link, own in elements.items() for element in own]
    padding = [0.0] * _MAX_SIZES
    return {
        "links": np.array([link for link, _ in every], dtype=np.str_),
        "kinds": np.array([element.kind for _, element in every], dtype=np.str_),
        "filenames": np.array([element.filename for _, element in every], dtype=np.str_),
        "counts": np.array([len(element.sizes) for _, element in every], dtype=np.int64),
        "sizes": np.array([[*e.sizes, *padding][:_MAX_SIZES] for _, e in every], dtype=float),
        "placements": np.array([element.placement for _, element in every], dtype=float),
    }


def _of_arrays(arrays: Arrays) -> dict[str, list[LinkElement]]:
    result: dict[str, list[LinkElement]] = {}
    for row, link in enumerate(arrays["links"].tolist()):
        kind, filename = str(arrays["kinds"][row]), str(arrays["filenames"][row])
        sizes = tuple(arrays["sizes"][row, : arrays["counts"][row]].tolist())
        element = LinkElement(kind, sizes, read_only(arrays["placements"][row]), filename)
        result.setdefault(link, []).append(element)
    return result


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
                path = _mesh_path(robot, each)
                contents.append(mesh_contents(path, each.sizes, each.placement))
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
    return None


def _mesh_path(robot: RobotModel, element: LinkElement) -> Path:
    return find_mesh(element.filename, robot.urdf.path, robot.package_dirs)
