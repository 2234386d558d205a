"""The items of a scene: arm, solids, tube, paths, and the space that links sweep."""

from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.collision.obstacle import Obstacle
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.tube.tube import Tube
from tubeplanner.views.link_visuals import LinkPart
from tubeplanner.views.palette import (
    CARRIED_COLOR,
    OBSTACLE_COLOR,
    REFERENCE_COLOR,
    SWEPT_COLOR,
    rgb,
    speed_colors,
)
from tubeplanner.views.scene import Item, Layer, ShownTrajectory
from tubeplanner.views.surface import (
    Surface,
    dashes,
    directions,
    hull_surface,
    joined,
    pipe,
    shape_surface,
)

_SWEEP_STEPS = 24
_BALL_POINTS = 150
_POINT_COLOR = "#111111"


def arm_items(trajectory: int, parts: list[LinkPart]) -> list[Item]:
    """Return the links of an arm."""
    return [
        Item(
            Layer.ARM,
            trajectory,
            f"{part.link}/{i}",
            part.surface,
            np.array(part.color),
            1,
            part.body,
        )
        for i, part in enumerate(parts)
    ]


def carried_items(trajectory: int, surfaces: Iterable[tuple[int, str, Surface]]) -> list[Item]:
    """Return what is carried, of bodies, names and surfaces."""
    color = rgb(CARRIED_COLOR)
    return [
        Item(Layer.CARRIED, trajectory, name, surface, color, 0.85, body, is_smooth=False)
        for body, name, surface in surfaces
    ]


def obstacle_items(trajectory: int, obstacles: Iterable[Obstacle]) -> list[Item]:
    """Return what stands still."""
    color = rgb(OBSTACLE_COLOR)
    return [
        Item(Layer.OBSTACLES, trajectory, each.name, surface, color, 0.55, is_smooth=False)
        for each in obstacles
        for surface in [joined(shape_surface(shape) for shape in each.shapes)]
    ]


def reference_item(trajectory: int, name: str, points: FloatArray, thickness: float) -> Item:
    """Return a dashed line through points (N, 3) of a thickness [m]."""
    line = dashes(points, 0.45 * thickness, 10 * thickness)
    return Item(Layer.REFERENCE, trajectory, name, line, rgb(REFERENCE_COLOR))


def tool_items(
    i: int, trajectory: ShownTrajectory, robot: RobotModel, thickness: float, fastest: float
) -> list[Item]:
    """Return the tool's path, coloured by its speed, and a point where the tool is.

    Args:
        i: Index of the trajectory.
        trajectory: Where the tool is when.
        robot: The arm.
        thickness: Of the path [m].
        fastest: The speed of the brightest colour [m/s].
    """
    body = robot.link_body[robot.tool_frame]
    center = (trajectory.tool[0] - trajectory.position[0, body]) @ trajectory.rotation[0, body]
    point = hull_surface(center + 1.8 * thickness * directions(_BALL_POINTS))
    items = [Item(Layer.TOOL, i, "point", point, rgb(_POINT_COLOR), 1.0, body)]
    surface, owner = pipe(trajectory.tool, thickness)
    if len(owner):
        share = trajectory.speed[owner] / (fastest or 1.0)
        items.append(Item(Layer.TOOL, i, "path", surface, speed_colors(share)))
    return items


def swept_item(i: int, trajectory: ShownTrajectory, swept: Surface) -> list[Item]:
    """Return the space that links sweep, if they move."""
    if trajectory.duration == 0:
        return []
    return [Item(Layer.SWEPT, i, "links", swept, rgb(SWEPT_COLOR), 0.22)]


def swept_surface(
    trajectory: ShownTrajectory, hulls: list[tuple[int, FloatArray]], steps: int = _SWEEP_STEPS
) -> Surface:
    """Return the space that moving links take: hulls of each in one pose and the next.

    Args:
        trajectory: The poses.
        hulls: Bodies, and points (V, 3) of what they carry.
        steps: In how many poses.
    """
    chosen = np.unique(np.linspace(0, len(trajectory.time) - 1, steps).round().astype(int))
    pieces = []
    for body, points in hulls:
        if body == 0:
            continue
        placements = [trajectory.placement(step, body) for step in chosen]
        poses = [points @ placement[:3, :3].T + placement[:3, 3] for placement in placements]
        pairs = pairwise(poses) if len(poses) > 1 else [(poses[0],)]
        pieces += [hull_surface(np.vstack(pair)) for pair in pairs]
    return joined(pieces)


def line_thickness(tubes: Iterable[Tube], size: float) -> float:
    """Return the radius of drawn lines [m]: thin in all tubes, seen in a scene of a size [m]."""
    radius = min(float(tube.effective_radius.min()) for tube in tubes)
    return float(np.clip(0.12 * radius, 0.002 * size, 0.004 * size))
