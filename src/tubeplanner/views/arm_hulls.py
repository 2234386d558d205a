"""The solids of an arm as a view has them: hulls of its links and of what it carries."""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.views.link_visuals import LinkPart
from tubeplanner.views.surface import Surface, coarse_hull_points, joined, shape_surface


def arm_hulls(problem: PlanningProblem, parts: list[LinkPart]) -> list[tuple[int, FloatArray]]:
    """Return bodies of links and carried solids, and points (V, 3) whose hulls nearly hold them."""
    points: dict[str, list[FloatArray]] = {}
    bodies = {part.link: part.body for part in parts}
    for part in parts:
        points.setdefault(part.link, []).append(part.surface.vertices)
    for body, name, surface in carried_surfaces(problem):
        bodies[name] = body
        points.setdefault(name, []).append(surface.vertices)
    return [(bodies[name], coarse_hull_points(np.vstack(found))) for name, found in points.items()]


def carried_surfaces(problem: PlanningProblem) -> list[tuple[int, str, Surface]]:
    """Return the body, the name and the surface of each carried solid."""
    robot = problem.robot
    body, placement = robot.link_body[robot.tool_frame], robot.link_placement[robot.tool_frame]
    return [
        (body, solid.name, joined(shape_surface(s) for s in solid.shapes).moved(placement))
        for solid in problem.attached
    ]
