"""Visual meshes of links, or their collision hulls.

trimesh reads them; it is imported when first needed.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.errors import RobotError, shown
from tubeplanner.geometry.link_geometry import element_of, link_shapes, read_geometry, simple_shape
from tubeplanner.geometry.meshes import files_beside, length_unit
from tubeplanner.geometry.solids import AttachedSolid
from tubeplanner.output.drawing import Surface, coarse_hull_points, joined, shape_surface
from tubeplanner.resources import find_mesh
from tubeplanner.robot.model import RobotModel

if TYPE_CHECKING:
    import trimesh

# ---- Meshes as they look: with their colours, few triangles, edges sharp.

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


# ---- What a robot's links look like: visual geometry of the URDF, or collision geometry instead.

# Triangles of all arms of a page together: what makes a file that can be mailed.
MAX_FACES = 60_000
_PLAIN: Color = (0.72, 0.74, 0.77)


@dataclass(frozen=True, eq=False)
class LinkPart:
    """What of a link has one colour.

    Attributes:
        link: Its name.
        body: The body that carries it.
        color: Red, green, blue from 0 to 1.
        surface: In the frame of the body.
    """

    link: str
    body: int
    color: Color
    surface: Surface


def link_parts(robot: RobotModel, max_faces: int) -> tuple[list[LinkPart], list[str]]:
    """Return the parts of all links, and what is to be said about them.

    A link whose visual geometry cannot be read is shown by its collision geometry, and so is a
    robot without any visual geometry.

    Args:
        robot: The arm.
        max_faces: How many triangles they may have together.

    Raises:
        RobotError: A geometry is of a kind no URDF has.
    """
    description = read_geometry(robot)
    named = {material.name: material for material in description.materials}
    found: dict[tuple[str, Color], list[Surface]] = defaultdict(list)
    notes, unseen = [], []
    for link in description.links:
        try:
            pieces = [piece for visual in link.visuals for piece in _pieces(robot, visual, named)]
        except RobotError as error:
            notes.append(f"link '{link.name}' is drawn by its collision geometry: {error}")
            unseen.append(link.name)
            continue
        for color, surface in pieces:
            found[link.name, color].append(surface.moved(robot.link_placement[link.name]))
    if not found:
        notes.append("the URDF has no visual geometry: collision geometry is drawn")
        unseen = [link.name for link in description.links]
    if unseen:
        shapes = link_shapes(robot)
        for name in unseen:
            found[name, _PLAIN] += [shape_surface(shape) for shape in shapes.get(name, ())]
    parts = {key: joined(surfaces) for key, surfaces in found.items() if surfaces}
    surfaces = simplified(list(parts.values()), max_faces)
    return [
        LinkPart(link, robot.link_body[link], color, surface)
        for (link, color), surface in zip(parts, surfaces, strict=True)
    ], notes


def _pieces(robot: RobotModel, visual: Any, named: dict[str, Any]) -> list[tuple[Color, Surface]]:
    """Return colours and surfaces of one <visual>, in the frame of its link."""
    color, element = _urdf_color(visual.material, named), element_of(visual)
    if element is None:
        raise RobotError("a <visual> has no known geometry")
    simple = simple_shape(element)
    if simple is not None:
        pieces: list[tuple[Color | None, Surface]] = [(None, shape_surface(simple))]
    else:
        path = find_mesh(element.filename, robot.urdf.path, robot.package_dirs)
        pieces = read_visual_mesh(path, element.sizes)
    return [(own or color, surface.moved(element.placement)) for own, surface in pieces]


def _urdf_color(material: Any, named: dict[str, Any]) -> Color:
    """Return the colour of a <material>, which may only name one of the robot's."""
    if material is not None and material.color is None:
        material = named.get(material.name)
    if material is None or material.color is None:
        return _PLAIN
    red, green, blue = (float(value) for value in material.color.rgba[:3])
    return red, green, blue


# ---- The solids of an arm as a view has them: hulls of its links and of what it carries.


def arm_hulls(
    parts: list[LinkPart], carried: list[tuple[int, str, Surface]]
) -> list[tuple[int, FloatArray]]:
    """Return bodies of links and carried solids, and points (V, 3) whose hulls nearly hold them."""
    points: dict[str, list[FloatArray]] = {}
    bodies = {part.link: part.body for part in parts}
    for part in parts:
        points.setdefault(part.link, []).append(part.surface.vertices)
    for body, name, surface in carried:
        bodies[name] = body
        points.setdefault(name, []).append(surface.vertices)
    return [(bodies[name], coarse_hull_points(np.vstack(found))) for name, found in points.items()]


def carried_surfaces(
    robot: RobotModel, attached: Sequence[AttachedSolid]
) -> list[tuple[int, str, Surface]]:
    """Return the body, the name and the surface of each carried solid."""
    body, placement = robot.link_body[robot.tool_frame], robot.link_placement[robot.tool_frame]
    return [
        (body, solid.name, joined(shape_surface(s) for s in solid.shapes).moved(placement))
        for solid in attached
    ]
