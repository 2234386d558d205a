"""Meshes covered by convex shapes. trimesh reads them; it is imported when first needed."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tubeplanner.collision.convex_shape import ConvexShape, convex_hull
from tubeplanner.collision.hulls import hull
from tubeplanner.collision.mesh_bounds import files_beside
from tubeplanner.documents import DocumentError
from tubeplanner.errors import RobotError, shown

if TYPE_CHECKING:
    import trimesh

# A mesh is cut into twice as many slabs as long as that makes its cover this much smaller.
_WORTHWHILE_VOLUME_RATIO = 0.95
_MAX_SLABS = 8
_MAX_REASON = 200  # [characters]
_MAX_LENGTH = 1e4  # [m]: no arm and no cell is larger


def load_mesh(
    owner: str, path: Path, scale: float | Sequence[float] | None = None
) -> "trimesh.Trimesh":
    """Return a mesh file's triangles.

    Args:
        owner: What messages call whom the mesh belongs to.
        path: STL, OBJ, DAE or another format that trimesh reads.
        scale: One factor, or one per axis.

    Raises:
        RobotError: The file is no readable mesh.
    """
    import trimesh

    try:
        # Unprocessed: processing drops what is not finite, and the solid has a hole.
        with np.errstate(invalid="ignore", over="ignore"):  # such numbers are refused below
            files = files_beside(path)
            loaded = trimesh.load(str(path), force="mesh", process=False, resolver=files)
        unit = length_unit(path)
    except DocumentError as error:
        raise RobotError(f"{owner}: mesh {path} cannot be read: {error}") from None
    except Exception as error:  # trimesh's readers raise whatever their formats' libraries raise
        raise RobotError(
            f"{owner}: mesh {path} is no readable {path.suffix[1:].upper()} file; export it "
            f"again ({shown(str(error), _MAX_REASON)})"
        ) from error
    fault = _fault(loaded, unit * np.asarray(1.0 if scale is None else scale, dtype=float))
    if fault is not None:
        raise RobotError(f"{owner}: mesh {path} {fault}; export it again")
    loaded.process()
    loaded.update_faces(_first_of_equal(np.asarray(loaded.faces)))
    loaded.apply_scale(unit)
    if scale is not None:
        loaded.apply_scale(scale)
    return loaded


def _fault(mesh: "trimesh.Trimesh", scale: np.ndarray) -> str | None:
    """Return what keeps a mesh, as it was read, from being a solid [m] when it is scaled."""
    vertices = np.asarray(getattr(mesh, "vertices", ()), dtype=float)
    faces = np.asarray(getattr(mesh, "faces", ()))
    if len(vertices) == 0 or len(faces) == 0 or not np.isfinite(vertices).all():
        return "has no vertices or triangles, or some that are not finite"
    if vertices.shape[1] != 3:
        return f"has points of {vertices.shape[1]} coordinates; a solid has 3"
    if faces.min() < 0 or faces.max() >= len(vertices):
        return f"has a triangle of vertex {faces.max()}; it has {len(vertices)} vertices"
    with np.errstate(over="ignore"):
        largest = float(abs(vertices * scale).max())
    if not largest <= _MAX_LENGTH:
        return (
            f"reaches {largest:.3g} m from its origin, where at most {_MAX_LENGTH:g} m make sense"
        )
    return None


def _first_of_equal(faces: np.ndarray) -> np.ndarray:
    """Return whether each triangle (F, 3) is none of those before it: bool, shape (F,).

    Equal ones, whose corners go round in the same order, are in the way of whoever searches for the
    nearest, and counted twice by whoever asks what is inside.
    """
    rows = np.arange(len(faces))[:, None]
    turned = faces[rows, (faces.argmin(axis=1)[:, None] + np.arange(3)) % 3]
    first = np.zeros(len(faces), dtype=bool)
    first[np.unique(turned, axis=0, return_index=True)[1]] = True
    return first


def length_unit(path: Path) -> float:
    """Return the length [m] of a mesh file's unit: COLLADA states it, and trimesh leaves it out.

    Raises:
        ValueError: It is no number.
        ElementTree.ParseError: The file is not well-formed.
    """
    if path.suffix.lower() != ".dae":
        return 1.0
    for element in ElementTree.parse(path).iter():
        if element.tag.endswith("}unit") or element.tag == "unit":
            return float(element.get("meter", "1"))
    return 1.0


def cover_mesh(mesh: "trimesh.Trimesh") -> list[ConvexShape]:
    """Return as few slab hulls as cover a mesh closely.

    The solid inside a slab lies in the hull of the surface inside that slab, because every
    cross-section is bounded by surface.
    """
    return _cover_and_slabs(mesh)[0]


def slab_cuts(mesh: "trimesh.Trimesh") -> list[tuple[int, float]]:
    """Return where `cover_mesh` cuts a mesh: axis and coordinate [m]."""
    slabs = _cover_and_slabs(mesh)[1]
    axis, bounds = _slab_bounds(mesh, slabs)
    return [(axis, float(height)) for height in bounds[1:-1]]


def _cover_and_slabs(mesh: "trimesh.Trimesh") -> tuple[list[ConvexShape], int]:
    cover = [convex_hull(mesh.vertices)]
    slabs = 2
    while slabs <= _MAX_SLABS:
        finer = _slab_hulls(mesh, slabs)
        if _volume(finer) > _WORTHWHILE_VOLUME_RATIO * _volume(cover):
            break
        cover, slabs = finer, 2 * slabs
    return cover, slabs // 2


def _slab_hulls(mesh: "trimesh.Trimesh", count: int) -> list[ConvexShape]:
    axis, bounds = _slab_bounds(mesh, count)
    return [
        convex_hull(points)
        for points in (_slab_points(mesh, axis, low, high) for low, high in pairwise(bounds))
        if len(points)
    ]


def _slab_bounds(mesh: "trimesh.Trimesh", count: int) -> tuple[int, np.ndarray]:
    axis = int(np.argmax(mesh.extents))
    return axis, np.linspace(mesh.bounds[0, axis], mesh.bounds[1, axis], count + 1)


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
    return sum(float(hull(shape.vertices).volume) for shape in shapes)
