"""The solids of an arm as a view has them: hulls of its links and of what it carries."""

from collections.abc import Sequence

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.collision.obstacle import AttachedSolid
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.views.link_visuals import LinkPart
from tubeplanner.views.surface import Surface, coarse_hull_points, joined, shape_surface


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
