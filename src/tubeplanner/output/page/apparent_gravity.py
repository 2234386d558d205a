"""Apparent gravity of held parts on a page: an arrow at each contact, and where its tip may be.

The apparent gravity of a part is gravity less the acceleration of its centre of mass. While the
tool does not turn, the contact holds the part if it is in a convex region: of a tray the cone of
friction and foot, of a cup one whose tip the vacuum lifts, of a gripper one about the pads.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray
from tubeplanner.geometry.convex_shapes import frame_along
from tubeplanner.output import drawing
from tubeplanner.output.curves import LimitedSection, held_contacts
from tubeplanner.output.page.scene import Item, Layer, ShownTrajectory, with_bodies
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.holding import GRAVITY, Holding

_LENGTH = 20.0  # of an arrow of the earth's gravity, in radii of drawn lines
_LARGEST = 3.0 * GRAVITY  # regions are drawn to here [m/s^2]; few motions press more, and briefly
_LEAST = 1e-3 * GRAVITY  # shorter arrows have no direction
_HEIGHTS, _DRAWN_HEIGHTS, _AZIMUTHS, _HALVINGS = 401, 17, 48, 30
_ALMOST = 0.99  # of the largest size: what reaches it everywhere is no limit
_REGION_OPACITY = 0.3
_HEAD, _SHAFT_RADIUS, _HEAD_RADIUS = 0.25, 0.8, 2.6  # of the arrow's length; in radii of lines
_SIDES = 24


@dataclass(frozen=True, eq=False)
class ContactBody:  # a `MovingBody`
    """A frame at a contact, while it holds a part."""

    poses: FloatArray  # base frame, shape (T, 4, 4); their axes may be stretched
    present: BoolArray  # shape (T,)


def apparent_gravity(
    i: int,
    robot: RobotModel,
    sections: Sequence[LimitedSection],
    shown: ShownTrajectory,
    thickness: float,
) -> tuple[ShownTrajectory, list[Item]]:
    """Return a motion with the frames of its contacts as bodies, and their arrows and regions.

    The thickness is the radius of drawn lines [m].
    """
    body, steps = robot.link_body[robot.tool_frame], range(len(shown.time))
    tool = np.array([shown.placement(step, body) for step in steps])
    scale = _LENGTH * thickness / GRAVITY  # [m per m/s^2]
    color, bodies, items = drawing.rgb(drawing.HOLDING_COLOR), list[ContactBody](), list[Item]()
    for k, use in enumerate(held_contacts(sections, shown.time)):
        contact, present = np.eye(4), ~np.isnan(use.share)
        contact[:3, :3], contact[:3, 3] = use.holding.axes, use.holding.contact.position
        contact = robot.link_placement[robot.tool_frame] @ contact
        arrow = np.tile(np.eye(4), (len(steps), 1, 1))
        length = np.linalg.norm(use.apparent_gravity, axis=1)
        for step in np.flatnonzero(length > _LEAST).tolist():
            direction = use.apparent_gravity[step] / length[step]
            arrow[step, :3, :3] = frame_along(direction) * [1.0, 1.0, scale * length[step]]
        number = shown.rotation.shape[1] + len(bodies)
        bodies += [ContactBody(tool @ contact @ each, present) for each in (arrow, np.eye(4))]
        name, line = f"{use.holding.kind}_{k}", _arrow(thickness)
        items.append(Item(Layer.HOLDING, i, name, line, color, 1.0, number, is_smooth=False))
        if (region := held_region(use.holding)) is not None:
            name, surface = f"region_{k}", drawing.hull_surface(scale * region)
            held = Item(Layer.HOLDING, i, name, surface, color, _REGION_OPACITY, number + 1)
            items.append(held)
    return with_bodies(shown, bodies), items


def held_region(holding: Holding) -> FloatArray | None:
    """Return points (N, 3) whose hull is the apparent gravities that a contact holds [m/s^2].

    They are in the contact's axes, of 3 times the earth's gravity at most, while the tool does not
    turn. None if the contact holds under all of them, or under none along its normal.
    """
    part = holding.mass_properties
    lever = (np.array(part.com) - holding.contact.position) @ holding.axes

    def holds(gravity: FloatArray) -> BoolArray:
        force = -part.mass * gravity.reshape(-1, 3)
        wrench = np.hstack([force, np.cross(lever, force)])
        margins = [cone.margin(wrench) for cone in holding.cones]
        return np.min(margins, axis=0).reshape(gravity.shape[:-1]) >= 0

    normal = np.array([0.0, 0.0, 1.0])
    heights = np.linspace(-_LARGEST, _LARGEST, _HEIGHTS)
    heights = heights[holds(heights[:, None] * normal)]
    if len(heights) < 2:
        return None
    heights = np.linspace(heights[0], heights[-1], _DRAWN_HEIGHTS)[:, None, None]
    azimuth = np.linspace(0, 2 * np.pi, _AZIMUTHS, endpoint=False)
    around = np.column_stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth])
    low = np.zeros((_DRAWN_HEIGHTS, _AZIMUTHS, 1))
    high = low + np.sqrt(_LARGEST**2 - heights**2)
    for _ in range(_HALVINGS):
        radius = (low + high) / 2
        is_held = holds(heights * normal + radius * around)[..., None]
        low, high = np.where(is_held, radius, low), np.where(is_held, high, radius)
    region: FloatArray = (heights * normal + low * around).reshape(-1, 3)
    is_limited = np.linalg.norm(region, axis=1).min() < _ALMOST * _LARGEST
    return region if is_limited else None


def _arrow(thickness: float) -> drawing.Surface:
    """Return an arrow along z of unit length, as thick as lines of a radius [m]."""
    azimuth = np.linspace(0, 2 * np.pi, _SIDES, endpoint=False)
    ring = thickness * np.column_stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth])
    begin, neck, tip = (np.array([0.0, 0.0, z]) for z in (0.0, 1 - _HEAD, 1.0))
    shaft = np.vstack([begin + _SHAFT_RADIUS * ring, neck + _SHAFT_RADIUS * ring])
    head = np.vstack([neck + _HEAD_RADIUS * ring, tip])
    return drawing.joined([drawing.hull_surface(shaft), drawing.hull_surface(head)])
