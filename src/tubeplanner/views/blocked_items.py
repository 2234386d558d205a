"""What is in the way: links, solids and obstacles in another colour, and a mark where it is."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.outcome import Place
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.views.palette import BLOCKED_COLOR, rgb
from tubeplanner.views.scene import Item, Layer
from tubeplanner.views.surface import directions, hull_surface, pipe

_BALL_POINTS = 150
# In radii of drawn lines.
_CORE, _HALO, _LINE = 3.0, 9.0, 1.6
_HALO_OPACITY = 0.35


def with_blocked(
    items: Sequence[Item],
    problem: PlanningProblem,
    place: Place,
    contact: FloatArray | None,
    thickness: float,
) -> tuple[Item, ...]:
    """Return the items of a scene, with what blocks coloured and marks of where.

    Args:
        items: Of the problem's scene.
        problem: The problem.
        place: Where it is blocked.
        contact: Where solids that are in the way are nearest, (3,) [m]; None: not known.
        thickness: Radius of drawn lines [m].
    """
    names = {*(place.links or ()), place.obstacle}
    bodies = _bodies(problem, place)
    color = rgb(BLOCKED_COLOR)
    shown = [
        replace(item, color=color) if _is_in_the_way(item, names, bodies) else item
        for item in items
    ]
    center = _center(problem, place) if contact is None else contact
    return (*shown, *_marks(problem, place, center, thickness))


def _bodies(problem: PlanningProblem, place: Place) -> set[int]:
    """Return the body that the place's joint moves, if it names one."""
    names = problem.robot.joint_names
    return {names.index(place.joint) + 1} if place.joint in names else set()


def _is_in_the_way(item: Item, names: set[str | None], bodies: set[int]) -> bool:
    if item.layer is Layer.ARM:
        return item.body in bodies or item.name.rpartition("/")[0] in names
    return item.layer in (Layer.CARRIED, Layer.OBSTACLES) and item.name in names


def _marks(
    problem: PlanningProblem, place: Place, center: FloatArray | None, thickness: float
) -> list[Item]:
    """Return a ball about a point (3,), and a line along the segment that is named."""
    color, marks = rgb(BLOCKED_COLOR), []
    if center is not None:
        for name, size, opacity in (("core", _CORE, 1.0), ("halo", _HALO, _HALO_OPACITY)):
            ball = hull_surface(center + size * thickness * directions(_BALL_POINTS))
            marks.append(Item(Layer.BLOCKED, 0, name, ball, color, opacity))
    if place.segment is not None:
        ends = problem.tube.points[place.segment : place.segment + 2]
        line, _ = pipe(ends, _LINE * thickness)
        marks.append(Item(Layer.BLOCKED, 0, "segment", line, color))
    return marks


def _center(problem: PlanningProblem, place: Place) -> FloatArray | None:
    """Return where the tool is (3,) [m] by a place; at a reference point if it names only that."""
    if place.position is not None:
        return np.array(place.position)
    return None if place.point is None else problem.tube.points[place.point]
