"""Meshes as they look: with their colours, few triangles, edges sharp.

trimesh reads them; it is imported when first needed.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.collision.mesh_bounds import files_beside
from tubeplanner.collision.mesh_cover import length_unit
from tubeplanner.errors import RobotError, shown
from tubeplanner.views.surface import Surface, joined

if TYPE_CHECKING:
    import trimesh

# Faces that meet at less than this look like one smooth surface [rad].
_CREASE = 0.6
# Vertices nearer than this are the same [m]; coarser, by this factor, until few enough are left.
_MIN_CELL, _COARSER = 2e-4, 1.15

_MAX_REASON = 200  # [characters]

Color = tuple[float, float, float]


def read_visual_mesh(
    path: Path, scale: float | Sequence[float] | None = None
) -> list[tuple[Color | None, Surface]]:
    """Return a mesh file's parts with their colours; None where the file gives none.

    Args:
        path: STL, OBJ, DAE or another format that trimesh reads.
        scale: One factor, or one per axis.

    Raises:
        RobotError: The file is no readable mesh.
    """
    import trimesh

    try:
        with np.errstate(invalid="ignore", over="ignore"):  # of numbers that no picture shows
            scene = trimesh.load_scene(str(path), resolver=files_beside(path))
        parts = [
            (_color(scene.geometry[name]), _placed(scene.geometry[name], placement))
            for placement, name in (scene.graph[node] for node in scene.graph.nodes_geometry)
            if isinstance(scene.geometry[name], trimesh.Trimesh)
        ]
        unit = length_unit(path)
    except Exception as error:  # trimesh's readers raise whatever their formats' libraries raise
        raise RobotError(
            f"mesh {path} cannot be read ({shown(str(error), _MAX_REASON)})"
        ) from error
    if not any(len(surface.faces) for _, surface in parts):
        raise RobotError(f"mesh {path} has no triangles")
    if path.suffix.lower() == ".dae":
        parts = [(_encoded(color), surface) for color, surface in parts]
    factor = unit * np.broadcast_to(1.0 if scale is None else scale, 3)
    return [(color, surface.moved(np.diag([*factor, 1.0]))) for color, surface in parts]


def _placed(mesh: "trimesh.Trimesh", placement: FloatArray) -> Surface:
    return Surface(np.asarray(mesh.vertices), np.asarray(mesh.faces)).moved(placement)


def _color(mesh: "trimesh.Trimesh") -> Color | None:
    if not mesh.visual.defined:
        return None
    source = getattr(mesh.visual, "material", mesh.visual)
    red, green, blue = (float(value) / 255 for value in source.main_color[:3])
    return red, green, blue


def _encoded(color: Color | None) -> Color | None:
    """Return a COLLADA colour, proportional to light, as screens take it (gamma 2.2)."""
    if color is None:
        return None
    red, green, blue = (value ** (1 / 2.2) for value in color)
    return red, green, blue


def simplified(surfaces: Sequence[Surface], max_faces: int) -> list[Surface]:
    """Return surfaces with so few triangles together, and vertices doubled at sharp edges.

    Vertices in the same cell of a grid become one, in the smallest cells that suffice.

    Args:
        surfaces: What belongs together.
        max_faces: How many triangles may be left.
    """
    cell = _MIN_CELL
    while True:
        fewer = [_clustered(surface, cell) for surface in surfaces]
        count = sum(len(surface.faces) for surface in fewer)
        if count <= max_faces:
            return [creased(surface) for surface in fewer]
        cell *= max(_COARSER, float(np.sqrt(count / max_faces)))


def _clustered(surface: Surface, cell: float) -> Surface:
    cells = np.floor(surface.vertices / cell).astype(np.int64)
    cells -= cells.min(axis=0, initial=0)
    _, cluster, count = np.unique(_keys(cells), return_inverse=True, return_counts=True)
    sums = [np.bincount(cluster, surface.vertices[:, axis], len(count)) for axis in range(3)]
    faces = cluster[surface.faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    _, first = np.unique(_keys(np.sort(faces, axis=1)), return_index=True)
    return Surface(np.column_stack(sums) / count[:, None], faces[np.sort(first)])


def _keys(rows: IntArray) -> IntArray:
    """Return one number per row (N, 3) of non-negative integers, different for different rows."""
    if len(rows) == 0:
        return np.zeros(0, dtype=np.int64)
    size = rows.max(axis=0) + 1
    return (rows[:, 0] * size[1] + rows[:, 1]) * size[2] + rows[:, 2]


def creased(surface: Surface) -> Surface:
    """Return a surface whose vertices are doubled at edges, so that these look sharp."""
    import trimesh

    if len(surface.faces) == 0:
        return surface
    mesh = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    flat = mesh.face_adjacency[mesh.face_adjacency_angles < _CREASE]
    nodes = np.arange(len(surface.faces))
    parts = trimesh.graph.connected_components(flat, min_len=1, nodes=nodes)
    return joined(_part(surface, np.asarray(part)) for part in parts)


def _part(surface: Surface, faces: np.ndarray) -> Surface:
    used, corners = np.unique(surface.faces[faces], return_inverse=True)
    return Surface(surface.vertices[used], corners.reshape(-1, 3))
