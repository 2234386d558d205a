"""What a robot's links look like: visual geometry of the URDF, or collision geometry instead."""

from collections import defaultdict
from dataclasses import dataclass
from typing import Any

from tubeplanner.collision.link_elements import element_of, read_geometry
from tubeplanner.collision.link_geometry import link_shapes, simple_shape
from tubeplanner.errors import RobotError
from tubeplanner.resources import find_mesh
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.views.surface import Surface, joined, shape_surface
from tubeplanner.views.visual_mesh import Color, read_visual_mesh, simplified

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
