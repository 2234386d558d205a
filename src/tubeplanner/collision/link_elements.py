"""The collision elements of a robot's links, as its URDF gives them.

yourdfpy reads them; it is imported when first needed, which elements from the cache never do.
"""

import io
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray, read_only
from tubeplanner.collision.cover_cache import Arrays, cached, content_hash
from tubeplanner.errors import RobotError
from tubeplanner.resources import find_mesh
from tubeplanner.robot.robot_model import RobotModel

MESH = "mesh"
_MAX_SIZES = 3


@dataclass(frozen=True, eq=False)
class LinkElement:
    """One <collision> or <visual> of a link.

    Attributes:
        kind: "box", "sphere", "cylinder" or "mesh".
        sizes: Side lengths, radius, or radius and length [m]; of a mesh its scale along each axis.
        placement: Where it is in the link, shape (4, 4).
        filename: Of the mesh, as the URDF has it; empty for other kinds.
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
    """Return a <collision> or <visual>, as yourdfpy has it; None if its geometry is of no kind."""
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
    """Return links and materials of a robot's URDF, as yourdfpy has them; meshes are not loaded.

    Raises:
        RobotError: They cannot be read.
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
    found: dict[str, list[LinkElement]] = {}
    for link in read_geometry(robot).links:
        for collision in link.collisions:
            element = element_of(collision)
            if element is None:
                raise RobotError(
                    f"{robot.urdf.path}: link '{link.name}' has a <collision> without a known "
                    "geometry"
                )
            found.setdefault(link.name, []).append(element)
    return found


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
    found: dict[str, list[LinkElement]] = {}
    for row, link in enumerate(arrays["links"].tolist()):
        kind, filename = str(arrays["kinds"][row]), str(arrays["filenames"][row])
        sizes = tuple(arrays["sizes"][row, : arrays["counts"][row]].tolist())
        element = LinkElement(kind, sizes, read_only(arrays["placements"][row]), filename)
        found.setdefault(link, []).append(element)
    return found
