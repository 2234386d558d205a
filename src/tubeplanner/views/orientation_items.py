"""How the tool is turned: its axes, and the cones in which the tube wants one of them.

A rotation tolerance bounds the components of the rotation vector from the reference to the tool,
and its length. Tilts of one axis of the tool then lie in a cone about that axis of the reference.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.tube.rotations import rotation_matrix
from tubeplanner.tube.tube import Tube
from tubeplanner.views.palette import AXIS_COLORS, CONE_COLOR, rgb
from tubeplanner.views.scene import Item, Layer, ShownTrajectory
from tubeplanner.views.shown_poses import with_bodies
from tubeplanner.views.stretch import Stretch
from tubeplanner.views.surface import Surface, pipe

AXIS_NAMES, POINTER = "xyz", "pointer_"
_POINTER_COLOR = "#111111"
_CONE_OPACITY = 0.4
_RIM_POINTS, _TRIED_WAYS, _TRIED_TURNS = 48, 480, 41
_AXIS_LENGTH, _CONE_LENGTH, _POINTER_LENGTH = 30.0, 60.0, 66.0  # in radii of drawn lines


@dataclass(frozen=True, eq=False)
class RotationCone:  # a `MovingBody`
    """The cone of a rotation tolerance, where it holds.

    Attributes:
        bounds: On |x|, |y|, |z| of the rotation vector and on its length, shape (4,) [rad].
        poses: Of the reference, at the tool, at T times, base frame, shape (T, 4, 4).
        present: Whether it holds then, shape (T,).
    """

    bounds: FloatArray
    poses: FloatArray
    present: BoolArray


def turned_tool(
    i: int,
    robot: RobotModel,
    tubes: Sequence[Tube],
    stretches: Sequence[Stretch],
    shown: ShownTrajectory,
    thickness: float,
) -> tuple[ShownTrajectory, list[Item]]:
    """Return a motion with its cones as bodies, and all that shows how the tool is turned.

    Args:
        i: Index of the motion.
        robot: The arm.
        tubes: What the motion runs through.
        stretches: Of the motion; none: the arm rests, and cones stand at the reference points.
        shown: Where the arm is.
        thickness: Radius of drawn lines [m].
    """
    cones = rotation_cones(stretches, shown)
    bounds = [row for tube in tubes if tube.rotation for row in tube.rotation.bounds]
    items = [*axes_items(i, robot, thickness), *pointer_items(i, robot, bounds, thickness)]
    items += cone_items(i, shown.rotation.shape[1], cones, thickness)
    if not stretches:
        for k, tube in enumerate(tubes):
            items += standing_cones(i, f"tube_{k}", tube, thickness)
    return with_bodies(shown, cones), items


def axes_items(i: int, robot: RobotModel, thickness: float) -> list[Item]:
    """Return the axes of the tool centre point of an arm, for lines of a radius [m]."""
    body, placement = robot.link_body[robot.tool_frame], _tool_placement(robot)
    return [
        Item(
            Layer.AXES,
            i,
            name,
            _stick(axis, thickness, _AXIS_LENGTH * thickness).moved(placement),
            rgb(color),
            body=body,
        )
        for axis, (name, color) in enumerate(zip(AXIS_NAMES, AXIS_COLORS, strict=True))
    ]


def rotation_cones(stretches: Sequence[Stretch], shown: ShownTrajectory) -> list[RotationCone]:
    """Return the cones of a motion's rotation tolerances, those that differ, as they move."""
    found: dict[tuple[float, ...], RotationCone] = {}
    for stretch in stretches:
        rotation = stretch.problem.tube.rotation
        if rotation is None:
            continue
        rows = stretch.inside(shown.time)
        segment = stretch.uses.segment[stretch.nearest(shown.time[rows] - stretch.begin)]
        tool = shown.tool[rows]
        reference = rotation.reference(tool, segment)
        for bounds in np.unique(rotation.bounds[segment], axis=0):
            if cone_axis(bounds) is None:
                continue
            cone = found.setdefault(tuple(bounds.tolist()), _absent(bounds, len(shown.time)))
            holds = (rotation.bounds[segment] == bounds).all(axis=1)
            cone.poses[rows[holds], :3, :3] = reference[holds]
            cone.poses[rows[holds], :3, 3] = tool[holds]
            cone.present[rows[holds]] = True
    return list(found.values())


def cone_items(i: int, first: int, cones: Sequence[RotationCone], thickness: float) -> list[Item]:
    """Return cones as bodies that move, numbered from the first on."""
    color = rgb(CONE_COLOR)
    return [
        Item(
            Layer.ROTATION,
            i,
            f"cone_{k}",
            _cone(each.bounds, thickness),
            color,
            _CONE_OPACITY,
            first + k,
            is_smooth=False,
        )
        for k, each in enumerate(cones)
    ]


def standing_cones(i: int, name: str, tube: Tube, thickness: float) -> Iterator[Item]:
    """Yield the cones at the reference points of a tube, each with the tolerance after it."""
    rotation = tube.rotation
    if rotation is None:
        return
    last = tube.segment_count - 1
    for k in range(len(tube.points)):
        segment = min(k, last)
        if cone_axis(rotation.bounds[segment]) is None:
            continue
        placement = np.eye(4)
        share = np.array([float(k > last)])
        placement[:3, :3] = rotation.reference_at(share, np.array([segment]))[0]
        placement[:3, 3] = tube.points[k]
        cone = _cone(rotation.bounds[segment], thickness).moved(placement)
        color = rgb(CONE_COLOR)
        yield Item(Layer.ROTATION, i, f"{name}_{k}", cone, color, _CONE_OPACITY, is_smooth=False)


def pointer_items(
    i: int, robot: RobotModel, bounds: Sequence[FloatArray], thickness: float
) -> list[Item]:
    """Return the axes of the tool that cones bound, as dark lines that move with it."""
    axes = sorted({axis for each in bounds if (axis := cone_axis(each)) is not None})
    body, placement = robot.link_body[robot.tool_frame], _tool_placement(robot)
    color = rgb(_POINTER_COLOR)
    return [
        Item(
            Layer.ROTATION,
            i,
            f"{POINTER}{AXIS_NAMES[axis]}",
            _stick(axis, 0.6 * thickness, _POINTER_LENGTH * thickness).moved(placement),
            color,
            body=body,
        )
        for axis in axes
    ]


def cone_axis(bounds: FloatArray) -> int | None:
    """Return the axis of the tool whose tilts bounds (4,) [rad] confine to a cone; None: none.

    The one about which it may turn the farthest; where several may as far, z.
    """
    largest = np.flatnonzero(bounds[:3] == bounds[:3].max())
    axis = int(largest[0]) if len(largest) == 1 else 2
    across = np.delete(bounds[:3], axis).max()
    return axis if min(across, bounds[3]) < np.pi else None


def cone_rim(bounds: FloatArray, axis: int) -> FloatArray:
    """Return how far an axis may tilt each way: unit vectors in the reference, (M + 1, 3).

    A rotation vector whose component along the axis is large turns the way of the tilt by half of
    it. So all of these are tried, and of each way the farthest tilt counts.
    """
    turn = np.linspace(0, 2 * np.pi, _TRIED_WAYS, endpoint=False)
    along = min(bounds[axis], bounds[3], np.pi) * np.linspace(-1, 1, _TRIED_TURNS)
    ways = np.column_stack([np.cos(turn), np.sin(turn)])
    across = bounds[:3][[axis - 2, axis - 1]]
    with np.errstate(divide="ignore"):
        farthest = (across / abs(ways)).min(axis=1)[:, None]
    round_ = np.sqrt(np.maximum(min(bounds[3], np.pi) ** 2 - along**2, 0.0))
    tilt = np.minimum(farthest, round_)[..., None] * ways[:, None]
    vectors = np.zeros((*tilt.shape[:2], 3))
    vectors[..., axis - 2], vectors[..., axis - 1] = tilt[..., 0], tilt[..., 1]
    vectors[..., axis] = along
    tips = rotation_matrix(vectors.reshape(-1, 3))[..., axis]
    way = np.arctan2(tips[:, axis - 1], tips[:, axis - 2])
    rim = np.round(way / (2 * np.pi) * _RIM_POINTS).astype(int) % _RIM_POINTS
    angle = np.zeros(_RIM_POINTS)
    np.maximum.at(angle, rim, np.arccos(np.clip(tips[:, axis], -1, 1)))
    angle = np.append(angle, angle[0])
    around = np.linspace(0, 2 * np.pi, _RIM_POINTS + 1)
    points = np.zeros((_RIM_POINTS + 1, 3))
    points[:, axis] = np.cos(angle)
    points[:, axis - 2] = np.sin(angle) * np.cos(around)
    points[:, axis - 1] = np.sin(angle) * np.sin(around)
    return points


def _cone(bounds: FloatArray, thickness: float) -> Surface:
    """Return the cone of bounds (4,) [rad], its tip at the origin of the reference."""
    axis = cone_axis(bounds)
    assert axis is not None
    points = np.vstack([np.zeros(3), _CONE_LENGTH * thickness * cone_rim(bounds, axis)])
    around = np.arange(1, _RIM_POINTS + 1)
    outside = np.column_stack([np.zeros_like(around), around, around + 1])
    return Surface(points, np.vstack([outside, outside[:, ::-1]]))


def _stick(axis: int, thickness: float, length: float) -> Surface:
    """Return a line from the origin along an axis, of a radius and length [m]."""
    return pipe(np.array([np.zeros(3), length * np.eye(3)[axis]]), thickness)[0]


def _absent(bounds: FloatArray, count: int) -> RotationCone:
    return RotationCone(bounds, np.tile(np.eye(4), (count, 1, 1)), np.zeros(count, dtype=bool))


def _tool_placement(robot: RobotModel) -> FloatArray:
    """Return the pose of the tool centre point in the frame of the body that carries it, (4, 4)."""
    q, body = np.zeros(robot.joint_count), robot.link_body[robot.tool_frame]
    (rotation, position), (turned, tool) = robot.body_poses(q), robot.tool_pose(q)
    placement = np.eye(4)
    placement[:3, :3] = rotation[body].T @ turned
    placement[:3, 3] = rotation[body].T @ (tool - position[body])
    return placement
