"""The solids of the panel in space: arm, gripper and carried parts, what stands still, tubes."""

from collections.abc import Collection, Iterable, Sequence

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.collision.obstacle import AttachedSolid, Obstacle
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.tube.tube import Tube
from tubeplanner.views.arm_hulls import carried_surfaces
from tubeplanner.views.link_visuals import link_parts
from tubeplanner.views.palette import (
    ARM_COLOR,
    CARRIED_COLOR,
    GRIPPER_COLOR,
    OBSTACLE_COLOR,
    rgb,
    segment_color,
)
from tubeplanner.views.rendered_solids import RenderedSolid
from tubeplanner.views.stretch import segments_per_group
from tubeplanner.views.surface import (
    Surface,
    clipped,
    joined,
    pipe,
    shape_surface,
    tube_surfaces,
)

_MAX_FACES = 9000  # of all arms that are drawn
_OBSTACLE_ALPHA, _TUBE_ALPHA = 0.38, 0.24
_PALE = 0.62  # how much of a pale arm is white
_BESIDE = 0.3  # of the longest side of a box: what is as near to it belongs to the picture
_FIRST_LINK = 1e-9  # how far a link is from its body's frame that the joint itself carries


def arm_solids(
    robot: RobotModel, q: FloatArray, carried: Sequence[Sequence[AttachedSolid]], strong: int
) -> list[RenderedSolid]:
    """Return the arm in some configurations, all but one of them pale.

    Args:
        robot: The arm.
        q: The configurations, shape (N, n).
        carried: What it carries in each.
        strong: Which of them is not pale; what does not move is there once, with that.
    """
    parts, _ = link_parts(robot, _MAX_FACES // len(q))
    links = [
        (part.body, part.surface, GRIPPER_COLOR if _is_gripper(robot, part.link) else ARM_COLOR)
        for part in parts
    ]
    rotation, position = robot.body_poses(q)
    found = []
    for k in [*(k for k in range(len(q)) if k != strong), strong]:
        pale = 0.0 if k == strong else _PALE
        held = [
            (body, surface, CARRIED_COLOR)
            for body, _, surface in carried_surfaces(robot, carried[k])
        ]
        for body, surface, color in [*links, *held]:
            if body == 0 and k != strong:
                continue
            placement = np.eye(4)
            placement[:3, :3], placement[:3, 3] = rotation[k, body], position[k, body]
            shown = (1 - pale) * rgb(color) + pale
            found.append(RenderedSolid(surface.moved(placement), shown))
    return found


def obstacle_solids(
    obstacles: Iterable[Obstacle], handed_over: Collection[str], low: FloatArray, high: FloatArray
) -> list[RenderedSolid]:
    """Return what stands still in a box or beside it; what is handed over in its own colour.

    What is larger than the box is cut, at its sides or where the last of the others ends.

    Args:
        obstacles: What stands still.
        handed_over: Names of those that the arm takes.
        low: Least corner of the box, shape (3,) [m].
        high: The opposite one.
    """
    surfaces = [(each.name, joined(map(shape_surface, each.shapes))) for each in obstacles]
    size = float((high - low).max())
    beside = _BESIDE * size
    near = [
        (name, surface)
        for name, surface in surfaces
        if (surface.vertices.min(axis=0) < high + beside).all()
        and (surface.vertices.max(axis=0) > low - beside).all()
    ]
    for _, surface in near:
        if np.ptp(surface.vertices, axis=0).max() <= size:
            low = np.minimum(low, surface.vertices.min(axis=0))
            high = np.maximum(high, surface.vertices.max(axis=0))
    found = []
    for name, surface in near:
        is_part = name in handed_over
        color = rgb(CARRIED_COLOR if is_part else OBSTACLE_COLOR)
        alpha = 1.0 if is_part else _OBSTACLE_ALPHA
        shown = _within(surface, low, high)
        if len(shown.faces):
            found.append(RenderedSolid(shown, color, alpha, has_edges=True))
    return found


def tube_solids(tube: Tube, colors: Sequence[str] | None = None) -> list[RenderedSolid]:
    """Return the skin of a tube, by groups of segments as they are marked in other panels.

    Args:
        tube: The tube.
        colors: Of the groups; None: as segments have them, one after the other.
    """
    step = segments_per_group(tube.segment_count)
    groups = range(0, tube.segment_count, step)
    if colors is None:
        colors = [segment_color(k) for k in range(len(groups))]
    if step == 1:
        surfaces = tube_surfaces(tube)
    else:
        # Hundreds of translucent capsules in one another would be an opaque lump.
        ends = [(first, min(first + step, tube.segment_count)) for first in groups]
        surfaces = [
            pipe(tube.points[a : b + 1], float(tube.effective_radius[a:b].min()))[0]
            for a, b in ends
        ]
    return [
        RenderedSolid(surface, rgb(color), _TUBE_ALPHA)
        for surface, color in zip(surfaces, colors, strict=True)
    ]


def _is_gripper(robot: RobotModel, link: str) -> bool:
    """Return whether a link is fixed to the one that the last joint before the tool moves."""
    on_tool = robot.link_body[link] == robot.link_body[robot.tool_frame]
    return on_tool and abs(robot.link_placement[link] - np.eye(4)).max() > _FIRST_LINK


def _within(surface: Surface, low: FloatArray, high: FloatArray) -> Surface:
    """Return the part of a surface that is in a box."""
    for k in range(3):
        for way, end in ((1.0, low[k]), (-1.0, high[k])):
            inside = way * (surface.vertices[:, k] - end)
            if (inside < 0).any():
                surface = clipped(surface, inside)
    return joined([surface])
