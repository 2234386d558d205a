"""Visual meshes of links, or their collision geometry; hulls of links, carried solids and parts.

trimesh reads meshes; it is imported when first needed.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree.ElementTree import Element, fromstring

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.errors import RobotError, shown
from tubeplanner.geometry.convex_shapes import ConvexShape, box, inscribed_cylinder, simple_shape
from tubeplanner.geometry.link_geometry import MESH, element_of, link_shapes
from tubeplanner.geometry.meshes import files_beside, length_unit
from tubeplanner.geometry.solids import AttachedSolid
from tubeplanner.output.drawing import (
    Surface,
    coarse_hull_points,
    joined,
    shape_points,
    shape_surface,
)
from tubeplanner.resources import find_mesh
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.urdf_elements import read_numbers
from tubeplanner.task.holding import Cup, Gripper, Holding, Liquid
from tubeplanner.task.problem import PlanningProblem

if TYPE_CHECKING:
    import trimesh

# ---- Visual meshes: with their colours, few triangles, edges sharp.

# Faces that meet at a smaller angle look like one smooth surface [rad].
_CREASE = 0.6
# Vertices in one cell are merged [m]; cells grow by at least this factor until few are left.
_MIN_CELL, _COARSER = 2e-4, 1.15
_MAX_REASON = 200  # [characters]

Color = tuple[float, float, float]


def read_visual_mesh(
    path: Path, scale: float | Sequence[float] | None = None
) -> list[tuple[Color | None, Surface]]:
    """Return a mesh file's parts with their colours; None where the file has no colour.

    Raises:
        RobotError: The file is no readable mesh.
    """
    import trimesh

    try:
        with np.errstate(invalid="ignore", over="ignore"):  # of values that no picture shows
            scene = trimesh.load_scene(str(path), resolver=files_beside(path))
        parts = []
        for placement, name in (scene.graph[node] for node in scene.graph.nodes_geometry):
            mesh = scene.geometry[name]
            if isinstance(mesh, trimesh.Trimesh):
                surface = Surface(np.asarray(mesh.vertices), np.asarray(mesh.faces))
                parts.append((_color(mesh), surface.moved(placement)))
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


def _color(mesh: "trimesh.Trimesh") -> Color | None:
    if not mesh.visual.defined:
        return None
    source = getattr(mesh.visual, "material", mesh.visual)
    red, green, blue = (float(value) / 255 for value in source.main_color[:3])
    return red, green, blue


def _encoded(color: Color | None) -> Color | None:
    """Return a COLLADA colour, proportional to light, encoded for screens (gamma 2.2)."""
    if color is None:
        return None
    red, green, blue = (value ** (1 / 2.2) for value in color)
    return red, green, blue


def simplified(surfaces: Sequence[Surface], max_faces: int) -> list[Surface]:
    """Return surfaces with few triangles in total, and vertices doubled at sharp edges.

    Vertices in the same cell of a grid become one vertex, in the smallest cells that suffice.
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
    """Return a number per row (N, 3) of non-negative integers, different for different rows."""
    if len(rows) == 0:
        return np.zeros(0, dtype=np.int64)
    size = rows.max(axis=0) + 1
    return (rows[:, 0] * size[1] + rows[:, 1]) * size[2] + rows[:, 2]


def creased(surface: Surface) -> Surface:
    """Return a surface with vertices doubled at sharp edges, so that shading shows the edges."""
    import trimesh

    if len(surface.faces) == 0:
        return surface
    mesh = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    flat = mesh.face_adjacency[mesh.face_adjacency_angles < _CREASE]
    nodes = np.arange(len(surface.faces))
    parts = trimesh.graph.connected_components(flat, min_len=1, nodes=nodes)
    pieces = []
    for part in parts:
        used, corners = np.unique(surface.faces[np.asarray(part)], return_inverse=True)
        pieces.append(Surface(surface.vertices[used], corners.reshape(-1, 3)))
    return joined(pieces)


# ---- Surfaces of a robot's links: visual geometry of the URDF, or collision geometry instead.

# Triangles of all arms of a page together, for a file small enough for mail.
MAX_FACES = 60_000
_PLAIN: Color = (0.72, 0.74, 0.77)


@dataclass(frozen=True, eq=False)
class LinkPart:
    """The part of a link in one colour."""

    link: str  # name of the link
    body: int  # the body that carries the link
    color: Color  # red, green, blue from 0 to 1
    surface: Surface  # in the frame of the body


def link_parts(robot: RobotModel, max_faces: int) -> tuple[list[LinkPart], list[str]]:
    """Return the parts of all links, and notes about parts.

    A link whose visual geometry cannot be read is shown by its collision geometry, and so is a
    robot without any visual geometry.

    Args:
        robot: The arm.
        max_faces: Largest number of triangles of all parts.

    Raises:
        RobotError: A geometry is of a kind no URDF has.
    """
    root = fromstring(robot.urdf.xml)
    materials = {str(each.get("name")): each for each in root.findall("material")}
    surfaces_by_part: dict[tuple[str, Color], list[Surface]] = defaultdict(list)
    notes, unseen = [], []
    for link in robot.urdf.links:
        visuals = robot.urdf.link_element(link).findall("visual")
        try:
            pieces = [each for visual in visuals for each in _pieces(robot, visual, materials)]
        except RobotError as error:
            notes.append(f"link '{link}' is drawn by its collision geometry: {error}")
            unseen.append(link)
            continue
        for color, surface in pieces:
            placed = surface.moved(robot.link_placement[link])
            surfaces_by_part[link, color].append(placed)
    if not surfaces_by_part:
        notes.append("the URDF has no visual geometry: collision geometry is drawn")
        unseen = list(robot.urdf.links)
    if unseen:
        shapes = link_shapes(robot)
        for name in unseen:
            solids = map(shape_surface, shapes.get(name, ()))
            surfaces_by_part[name, _PLAIN] += solids
    parts = {key: joined(surfaces) for key, surfaces in surfaces_by_part.items() if surfaces}
    surfaces = simplified(list(parts.values()), max_faces)
    return [
        LinkPart(link, robot.link_body[link], color, surface)
        for (link, color), surface in zip(parts, surfaces, strict=True)
    ], notes


def _pieces(
    robot: RobotModel, visual: Element, materials: dict[str, Element]
) -> list[tuple[Color, Surface]]:
    """Return colours and surfaces of a <visual>, in the frame of its link."""
    material = visual.find("material")
    # A <material> may be a mere reference by name.
    if material is not None and material.find("color") is None:
        material = materials.get(str(material.get("name")))
    rgba, color = None if material is None else material.find("color"), _PLAIN
    if rgba is not None:
        red, green, blue = read_numbers("<material>", rgba, "rgba", 4)[:3].tolist()
        color = red, green, blue
    element = element_of("<visual>", visual)
    if element.kind != MESH:
        simple = simple_shape(element.kind, element.sizes)
        pieces: list[tuple[Color | None, Surface]] = [(None, shape_surface(simple))]
    else:
        path = find_mesh(element.filename, robot.urdf.path, robot.package_dirs)
        pieces = read_visual_mesh(path, element.sizes)
    return [(own or color, surface.moved(element.placement)) for own, surface in pieces]


# ---- Solids of an arm for views: hulls of its links, surfaces of its carried solids.


def arm_hulls(
    parts: list[LinkPart], carried: list[tuple[int, str, Surface]]
) -> list[tuple[int, FloatArray]]:
    """Return bodies of links and carried solids, with points (V, 3) of their coarse hulls."""
    points: dict[str, list[FloatArray]] = {}
    bodies = {part.link: part.body for part in parts}
    for part in parts:
        points.setdefault(part.link, []).append(part.surface.vertices)
    for body, name, surface in carried:
        bodies[name] = body
        points.setdefault(name, []).append(surface.vertices)
    return [(bodies[name], coarse_hull_points(np.vstack(rows))) for name, rows in points.items()]


def carried_surfaces(
    robot: RobotModel, attached: Sequence[AttachedSolid]
) -> list[tuple[int, str, Surface]]:
    """Return the body, the name and the surface of each carried solid."""
    body, placement = robot.link_body[robot.tool_frame], robot.link_placement[robot.tool_frame]
    return [
        (body, solid.name, joined(shape_surface(s) for s in solid.shapes).moved(placement))
        for solid in attached
    ]


# ---- Held parts: simple shapes, where no attached solid is.

_NEAR, _MIN_HEIGHT = 1e-3, 5e-3  # [m]
_SURFACE_RADIUS = 0.03  # of a liquid [m]: its vessel is not known


def solids_at_tool(problem: PlanningProblem) -> list[AttachedSolid]:
    """Return the attached solids, and a simple shape of each held part that is in none of them."""
    corners = [shape_points(shape) for each in problem.attached for shape in each.shapes]
    parts = []
    for holding in problem.holding:
        com = np.array(holding.mass_properties.com)
        inside = [
            (com > points.min(axis=0) - _NEAR) & (com < points.max(axis=0) + _NEAR)
            for points in corners
        ]
        if not any(each.all() for each in inside):
            parts.append(AttachedSolid(f"part ({holding.kind})", (_part_shape(holding),)))
    return [*problem.attached, *parts]


def _part_shape(holding: Holding) -> ConvexShape:
    """Return a shape of a held part in the tool frame, from what its contact tells of its size.

    On a foot or under a cup twice as high as its centre of mass; between pads a block about both.
    """
    contact, placement, middle = holding.contact, np.eye(4), np.eye(4)
    placement[:3, :3], placement[:3, 3] = holding.axes, contact.position
    away = (np.array(holding.mass_properties.com) - contact.position) @ holding.axes
    height = max(2 * float(away[2]), _MIN_HEIGHT)
    middle[2, 3] = height / 2
    if isinstance(contact, Gripper):
        width, length = contact.pad
        middle[:3, 3] = away / 2
        shape = box(np.array([width, length, min(width, length)]) + abs(away))
    elif isinstance(contact, Cup):
        shape = box((4 * contact.radius, 4 * contact.radius, height))
    elif isinstance(contact, Liquid):
        shape = inscribed_cylinder(_SURFACE_RADIUS, height)
    elif isinstance(contact.foot, (int, float)):
        shape = inscribed_cylinder(contact.foot, height)
    else:
        shape = box((*contact.foot, height))
    return shape.transformed(placement @ middle)
