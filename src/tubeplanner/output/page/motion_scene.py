"""Scene of a problem or a cycle with motions: arm, solids, tubes, paths, tool axes, cones."""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray
from tubeplanner.execution.simulation import Execution
from tubeplanner.geometry.solids import Obstacle
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.limits.process_stretches import stretch_runs
from tubeplanner.orientation import rotation_matrix
from tubeplanner.output import drawing
from tubeplanner.output.curves import LimitedSection, limited_sections, tube_name
from tubeplanner.output.execution_curves import BESIDE_EXECUTED, motion_paths
from tubeplanner.output.link_visuals import (
    MAX_FACES,
    LinkPart,
    arm_hulls,
    carried_surfaces,
    link_parts,
    solids_at_tool,
)
from tubeplanner.output.page.apparent_gravity import apparent_gravity
from tubeplanner.output.page.scene import (
    Item,
    Layer,
    Scene,
    ShownTrajectory,
    direction_of,
    handed_over,
    moved_parts,
    poses_along,
    poses_at_rest,
    scene_frame,
    with_bodies,
)
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.motion import CycleMotion, Motion, Task
from tubeplanner.task.problem import PlanningProblem

# ---- The scene of a problem or a cycle and its motions.

_FRAMES_PER_SECOND, _MIN_FRAMES, _MAX_FRAMES, _MAX_CYCLE_FRAMES = 200, 80, 240, 1200
_SWEEP_STEPS, _MAX_SWEEP_STEPS = 24, 96  # of a tube, of all
_PROCESS_WIDTH, _PROCESS_OPACITY = 1.8, 0.5  # of the path along stretches of a process


def build_scene(
    task: Task,
    motions: Mapping[str, Motion],
    execution: Execution | None = None,
    *,
    at_rest: ShownTrajectory | None = None,
    notes: Sequence[str] = (),
    empty_handed: Collection[str] = (),
) -> Scene:
    """Return the scene of a problem or a cycle and some motions, by name.

    Without a motion the arm rests as in `at_rest`, else at the start. An execution belongs to the
    one motion. Motions in `empty_handed` are drawn without the carried solids. Parts that are taken
    or let go are bodies of their own, after the arm's. Notes of the scene begin with `notes`.

    Raises:
        RobotError: The robot's geometry is of a kind no URDF has.
    """
    all_notes, robot, is_cycle = list(notes), task.robot, isinstance(task, Cycle)
    arms = [
        poses_along(robot, name, motion.trajectory, _frame_times(motion))
        for name, motion in motions.items()
    ]
    if not arms:
        first = task.problem_from_anywhere(0) if isinstance(task, Cycle) else task
        arms = [at_rest or poses_at_rest(first, all_notes)]
    marks = [motion.marks for motion in motions.values()] or [()]
    body, placement = robot.link_body[robot.tool_frame], robot.link_placement[robot.tool_frame]
    parts = []
    for own_marks, each in zip(marks, arms, strict=True):
        poses = np.array([each.placement(step, body) for step in range(len(each.time))])
        parts.append(moved_parts(task, own_marks, each.time, poses @ placement))
    arms = [with_bodies(*each) for each in zip(arms, parts, strict=True)]
    sections = tuple(limited_sections(motion) for motion in motions.values())
    links, notes_of_links = link_parts(robot, MAX_FACES // len(arms))
    at_tool = task.attached if isinstance(task, Cycle) else solids_at_tool(task)
    carried = carried_surfaces(robot, at_tool)
    hulls = arm_hulls(links, carried)
    cell = _cycle_cell(task) if isinstance(task, Cycle) else _problem_cell(task)
    steps = min(_SWEEP_STEPS * len(cell.tubes), _MAX_SWEEP_STEPS)
    swept = [swept_surface(each, hulls, steps) for each in arms]
    fixed = [points for body, points in hulls if body == 0]
    points = [*(surface.vertices for surface in [*swept, *cell.surfaces]), *fixed]
    lines = [tube.points for tube in cell.tubes]
    points += [part.seen_at(step) for each in parts for part in each for step in (0, -1)]
    points += [] if is_cycle else lines
    direction = direction_of(arms[0], lines, cell.obstacles, hulls)
    # The radius of drawn lines [m]: thin in all tubes, visible in a scene of a size [m].
    size = float(np.ptp(np.vstack(points), axis=0).max())
    radius = min(float(tube.effective_radius.min()) for tube in cell.tubes)
    thickness = float(np.clip(0.12 * radius, 0.002 * size, 0.004 * size))
    fastest = max(float(each.speed.max()) for each in arms)
    width, executed = thickness, None
    if execution is not None:
        (motion,) = motions.values()
        width, executed = BESIDE_EXECUTED * thickness, motion_paths(motion, execution)
    items: list[Item] = []
    for i, (each, own_parts) in enumerate(zip(arms, parts, strict=True)):
        first_body = each.rotation.shape[1] - len(own_parts)
        bodies = [
            (first_body + k, f"{part.name}/{k}", part.surface) for k, part in enumerate(own_parts)
        ]
        own = sections[i] if sections else ()
        arms[i], orientation = tool_orientation(i, robot, cell.tubes, own, each, thickness)
        arms[i], gravity = apparent_gravity(i, robot, own, arms[i], thickness)
        orientation += gravity
        in_hand = () if each.name in empty_handed else carried
        items += solid_items(i, links, [*in_hand, *bodies])
        items += [*cell.items(i, thickness), *obstacle_items(i, cell.obstacles)]
        items += tool_items(i, each, robot, width, fastest)
        for run in stretch_runs(own):
            inside = (each.time >= run.on) & (each.time <= run.off)
            surface, _ = drawing.pipe(each.tool[inside], _PROCESS_WIDTH * width)
            color = drawing.rgb(drawing.PROCESS_COLOR)
            items.append(Item(Layer.TOOL, i, run.name, surface, color, _PROCESS_OPACITY))
        space = Item(Layer.SWEPT, i, "links", swept[i], drawing.rgb(drawing.SWEPT_COLOR), 0.22)
        last = [orientation, [space] * (each.duration > 0)]
        items += [item for group in (last[::-1] if is_cycle else last) for item in group]
    return Scene(
        name=task.name,
        task=task,
        motions=tuple(motions.values()),
        trajectories=tuple(arms),
        items=tuple(items),
        frame=scene_frame(points, direction, len(arms)),
        thickness=thickness,
        notes=(*all_notes, *notes_of_links),
        sections=sections,
        executed=executed,
    )


def _frame_times(motion: Motion) -> FloatArray:
    """Return the times of a motion's frames (T,) [s], among them those of all marks."""
    duration = motion.trajectory.duration
    if not isinstance(motion, CycleMotion):
        count = int(np.ceil(_FRAMES_PER_SECOND * duration))
        return np.linspace(0.0, duration, min(max(count, _MIN_FRAMES), _MAX_FRAMES))
    instants = sorted({0.0, *(mark.time for mark in motion.marks), duration})
    rate = min(max(_FRAMES_PER_SECOND, _MIN_FRAMES / duration), _MAX_CYCLE_FRAMES / duration)
    spans = [
        np.linspace(begin, end, int(np.ceil(rate * (end - begin))) + 1)[1:]
        for begin, end in pairwise(instants)
    ]
    return np.concatenate([[0.0], *spans])


@dataclass(frozen=True, eq=False)
class _Cell:
    """What stands about an arm."""

    tubes: Sequence[Tube]  # all tubes
    surfaces: Sequence[drawing.Surface]  # of the tubes
    obstacles: Sequence[Obstacle]  # obstacles that nobody moves
    # function from a motion's index and the radius of lines [m] to items of tubes, paths, goals
    items: Callable[[int, float], list[Item]]


def _problem_cell(problem: PlanningProblem) -> _Cell:
    surfaces = drawing.tube_surfaces(problem.tube)
    items = partial(_problem_items, problem, surfaces)
    return _Cell([problem.tube], surfaces, problem.obstacles, items)


def _problem_items(
    problem: PlanningProblem, tube: list[drawing.Surface], i: int, thickness: float
) -> list[Item]:
    """Return the tube in the colours of its segments, its reference path and its goal.

    Without a tube there is no path: its two points are the tool's at start and goal.
    """
    items = []
    for k, surface in enumerate(tube):
        color, is_smooth = drawing.rgb(drawing.segment_color(k)), not problem.tube.is_box[k]
        items.append(Item(Layer.TUBE, i, f"segment_{k}", surface, color, 0.3, is_smooth=is_smooth))
    goal = [(ball, _BALL_OPACITY) for ball in drawing.goal_ball(problem.endpoints[1])]
    if tube:
        items.append(reference_item(i, "path", problem.tube.points, thickness))
    elif problem.goal is not None:
        point = problem.tube.points[-1] + 1.8 * thickness * drawing.directions(_BALL_POINTS)
        goal.append((drawing.hull_surface(point), 1.0))
    for k, (ball, opacity) in enumerate(goal):
        name = "goal" + f"_{k}" * (k > 0)
        items.append(
            Item(Layer.REFERENCE, i, name, ball, drawing.rgb(drawing.REFERENCE_COLOR), opacity)
        )
    return items


def _cycle_cell(cycle: Cycle) -> _Cell:
    tubes = [move.tube for leg in cycle.legs for move in leg.moves]
    surfaces = [drawing.joined(drawing.tube_surfaces(tube)) for tube in tubes]
    moved = handed_over(cycle)
    standing = [each for each in cycle.obstacles if each.name not in moved]
    return _Cell(tubes, surfaces, standing, partial(_cycle_items, cycle, surfaces))


def _cycle_items(
    cycle: Cycle, tubes: list[drawing.Surface], i: int, thickness: float
) -> list[Item]:
    """Return the tubes of moves, in a colour each, their reference paths and goal balls.

    A move without a tube has no path either.
    """
    items, moves = [], [move for leg in cycle.legs for move in leg.moves]
    for k, (move, surface) in enumerate(zip(moves, tubes, strict=True)):
        if len(surface.faces):
            color = drawing.rgb(drawing.segment_color(k))
            items.append(Item(Layer.TUBE, i, tube_name(k), surface, color, 0.2))
            items.append(reference_item(i, f"move_{k}", move.tube.points, thickness))
        for ball in drawing.goal_ball(move.endpoint):
            color = drawing.rgb(drawing.REFERENCE_COLOR)
            items.append(Item(Layer.REFERENCE, i, f"goal_{k}", ball, color, _BALL_OPACITY))
    return items


# ---- The items of a scene: arm, solids, tube, paths, and the space swept by links.

_BALL_POINTS, _BALL_OPACITY = 150, 0.35
_POINT_COLOR = "#111111"


def solid_items(
    i: int,
    links: Iterable[LinkPart],
    carried: Iterable[tuple[int, str, drawing.Surface]],
) -> Iterator[Item]:
    """Yield the links of an arm and the carried solids: bodies, names and surfaces."""
    for k, part in enumerate(links):
        color = np.array(part.color)
        yield Item(Layer.ARM, i, f"{part.link}/{k}", part.surface, color, 1, part.body)
    for body, name, surface in carried:
        color = drawing.rgb(drawing.CARRIED_COLOR)
        yield Item(Layer.CARRIED, i, name, surface, color, 0.85, body, is_smooth=False)


def obstacle_items(i: int, obstacles: Iterable[Obstacle]) -> Iterator[Item]:
    """Yield the obstacles."""
    for each in obstacles:
        surface = drawing.joined(map(drawing.shape_surface, each.shapes))
        color = drawing.rgb(drawing.OBSTACLE_COLOR)
        yield Item(Layer.OBSTACLES, i, each.name, surface, color, 0.55, is_smooth=False)


def reference_item(trajectory: int, name: str, points: FloatArray, thickness: float) -> Item:
    """Return a dashed line through points (N, 3), for lines of a radius [m]."""
    line = drawing.dashes(points, 0.45 * thickness, 10 * thickness)
    return Item(Layer.REFERENCE, trajectory, name, line, drawing.rgb(drawing.REFERENCE_COLOR))


def tool_items(
    i: int, trajectory: ShownTrajectory, robot: RobotModel, thickness: float, fastest: float
) -> list[Item]:
    """Return the tool's path, coloured by its speed, and a point at the tool.

    The radius of the path is in m; the fastest speed [m/s] has the brightest colour.
    """
    body = robot.link_body[robot.tool_frame]
    center = (trajectory.tool[0] - trajectory.position[0, body]) @ trajectory.rotation[0, body]
    point = drawing.hull_surface(center + 1.8 * thickness * drawing.directions(_BALL_POINTS))
    items = [Item(Layer.TOOL, i, "point", point, drawing.rgb(_POINT_COLOR), 1.0, body)]
    surface, owner = drawing.pipe(trajectory.tool, thickness)
    if len(owner):
        fraction = trajectory.speed[owner] / (fastest or 1.0)
        items.append(Item(Layer.TOOL, i, "path", surface, drawing.speed_colors(fraction)))
    return items


def swept_surface(
    trajectory: ShownTrajectory, hulls: list[tuple[int, FloatArray]], steps: int
) -> drawing.Surface:
    """Return the space swept by moving links: hulls of each in successive pairs of poses.

    The hulls are bodies with points (V, 3) of each.
    """
    rows = np.linspace(0, len(trajectory.time) - 1, steps).round().astype(int)
    pieces = []
    for body, points in hulls:
        if body == 0:
            continue
        placements = [trajectory.placement(step, body) for step in np.unique(rows)]
        poses = [points @ placement[:3, :3].T + placement[:3, 3] for placement in placements]
        pairs = pairwise(poses) if len(poses) > 1 else [(poses[0],)]
        pieces += [drawing.hull_surface(np.vstack(pair)) for pair in pairs]
    return drawing.joined(pieces)


# ---- Orientation of the tool: its axes, and the cones that the tube allows for one of the axes.
#
# A rotation tolerance bounds the components of the rotation vector from the reference to the tool,
# and its length. Tilts of one axis of the tool then lie in a cone about that axis of the reference.

AXIS_NAMES, POINTER = "xyz", "pointer_"
_POINTER_COLOR = "#111111"
_CONE_OPACITY = 0.4
_RIM_POINTS, _TRIED_WAYS, _TRIED_TURNS = 48, 480, 41
_AXIS_LENGTH, _CONE_LENGTH, _POINTER_LENGTH = 30.0, 60.0, 66.0  # in radii of drawn lines


@dataclass(frozen=True, eq=False)
class RotationCone:  # a `MovingBody`
    """The cone of a rotation tolerance, while it holds."""

    bounds: FloatArray  # of |x|, |y|, |z| of the rotation vector, of its length, shape (4,) [rad]
    poses: FloatArray  # of the reference, at the tool, at T times, base frame, shape (T, 4, 4)
    present: BoolArray  # True while the tolerance holds, shape (T,)


def tool_orientation(
    i: int,
    robot: RobotModel,
    tubes: Sequence[Tube],
    sections: Sequence[LimitedSection],
    shown: ShownTrajectory,
    thickness: float,
) -> tuple[ShownTrajectory, list[Item]]:
    """Return a motion with its cones as bodies, and the items of the tool's orientation.

    Without sections the arm rests, and cones are at the reference points of the tubes. The
    thickness is the radius of drawn lines [m].
    """
    cones = rotation_cones(sections, shown)
    bounds = [row for tube in tubes if tube.rotation for row in tube.rotation.bounds]
    body, placement = robot.link_body[robot.tool_frame], _tool_placement(robot)
    items = []
    for axis, (name, color) in enumerate(zip(AXIS_NAMES, drawing.AXIS_COLORS, strict=True)):
        line = _stick(axis, thickness, _AXIS_LENGTH * thickness).moved(placement)
        items.append(Item(Layer.AXES, i, name, line, drawing.rgb(color), body=body))
    for axis in sorted({each for row in bounds if (each := cone_axis(row)) is not None}):
        line = _stick(axis, 0.6 * thickness, _POINTER_LENGTH * thickness).moved(placement)
        name = f"{POINTER}{AXIS_NAMES[axis]}"
        items.append(Item(Layer.ROTATION, i, name, line, drawing.rgb(_POINTER_COLOR), body=body))
    for k, cone in enumerate(cones):
        surface, carrier = _cone(cone.bounds, thickness), shown.rotation.shape[1] + k
        items.append(_cone_item(i, f"cone_{k}", surface, carrier))
    for k, tube in enumerate(() if sections else tubes):
        items += standing_cones(i, f"tube_{k}", tube, thickness)
    return with_bodies(shown, cones), items


def _cone_item(i: int, name: str, cone: drawing.Surface, body: int = 0) -> Item:
    color = drawing.rgb(drawing.CONE_COLOR)
    return Item(Layer.ROTATION, i, name, cone, color, _CONE_OPACITY, body, is_smooth=False)


def rotation_cones(
    sections: Sequence[LimitedSection], shown: ShownTrajectory
) -> list[RotationCone]:
    """Return the moving cones of a motion's rotation tolerances, a cone per set of bounds."""
    result: dict[tuple[float, ...], RotationCone] = {}
    count = len(shown.time)
    for section in sections:
        rotation = section.problem.tube.rotation
        if rotation is None:
            continue
        rows = section.inside(shown.time)
        segment = section.uses.segment[section.nearest(shown.time[rows] - section.begin)]
        tool = shown.tool[rows]
        reference = rotation.reference(tool, segment)
        for bounds in np.unique(rotation.bounds[segment], axis=0):
            if cone_axis(bounds) is None:
                continue
            poses, present = np.tile(np.eye(4), (count, 1, 1)), np.zeros(count, dtype=bool)
            absent = RotationCone(bounds, poses, present)
            cone = result.setdefault(tuple(bounds.tolist()), absent)
            holds = (rotation.bounds[segment] == bounds).all(axis=1)
            cone.poses[rows[holds], :3, :3] = reference[holds]
            cone.poses[rows[holds], :3, 3] = tool[holds]
            cone.present[rows[holds]] = True
    return list(result.values())


def standing_cones(i: int, name: str, tube: Tube, thickness: float) -> Iterator[Item]:
    """Yield the cones at the reference points of a tube, each of the tolerance after the point."""
    rotation = tube.rotation
    if rotation is None:
        return
    last = tube.segment_count - 1
    for k in range(len(tube.points)):
        segment = min(k, last)
        if cone_axis(rotation.bounds[segment]) is None:
            continue
        placement = np.eye(4)
        fraction = np.array([float(k > last)])
        placement[:3, :3] = rotation.reference_at(fraction, np.array([segment]))[0]
        placement[:3, 3] = tube.points[k]
        cone = _cone(rotation.bounds[segment], thickness).moved(placement)
        yield _cone_item(i, f"{name}_{k}", cone)


def cone_axis(bounds: FloatArray) -> int | None:
    """Return the axis of the tool whose tilts bounds (4,) [rad] confine to a cone; None: none.

    The axis about which the tool may rotate the farthest; z if several are equal.
    """
    largest = np.flatnonzero(bounds[:3] == bounds[:3].max())
    axis = int(largest[0]) if len(largest) == 1 else 2
    across = np.delete(bounds[:3], axis).max()
    return axis if min(across, bounds[3]) < np.pi else None


def cone_rim(bounds: FloatArray, axis: int) -> FloatArray:
    """Return the largest tilts of an axis in all directions, as unit vectors (M + 1, 3).

    They are in the reference frame. A rotation vector with a large component along the axis
    turns the direction of the tilt by half that component. So rotation vectors with many
    components along the axis are tried, and in each direction the farthest tilt counts.
    """
    azimuth = np.linspace(0, 2 * np.pi, _TRIED_WAYS, endpoint=False)
    along = min(bounds[axis], bounds[3], np.pi) * np.linspace(-1, 1, _TRIED_TURNS)
    tilt_directions = np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    across = bounds[:3][[axis - 2, axis - 1]]
    with np.errstate(divide="ignore"):
        farthest = (across / abs(tilt_directions)).min(axis=1)[:, None]
    round_ = np.sqrt(np.maximum(min(bounds[3], np.pi) ** 2 - along**2, 0.0))
    tilt = np.minimum(farthest, round_)[..., None] * tilt_directions[:, None]
    vectors = np.zeros((*tilt.shape[:2], 3))
    vectors[..., axis - 2], vectors[..., axis - 1] = tilt[..., 0], tilt[..., 1]
    vectors[..., axis] = along
    tips = rotation_matrix(vectors.reshape(-1, 3))[..., axis]
    direction = np.arctan2(tips[:, axis - 1], tips[:, axis - 2])
    rim = np.round(direction / (2 * np.pi) * _RIM_POINTS).astype(int) % _RIM_POINTS
    angle = np.zeros(_RIM_POINTS)
    np.maximum.at(angle, rim, np.arccos(np.clip(tips[:, axis], -1, 1)))
    angle = np.append(angle, angle[0])
    around = np.linspace(0, 2 * np.pi, _RIM_POINTS + 1)
    points = np.zeros((_RIM_POINTS + 1, 3))
    points[:, axis] = np.cos(angle)
    points[:, axis - 2] = np.sin(angle) * np.cos(around)
    points[:, axis - 1] = np.sin(angle) * np.sin(around)
    return points


def _cone(bounds: FloatArray, thickness: float) -> drawing.Surface:
    """Return the cone of bounds (4,) [rad], its tip at the origin of the reference."""
    axis = cone_axis(bounds)
    assert axis is not None
    points = np.vstack([np.zeros(3), _CONE_LENGTH * thickness * cone_rim(bounds, axis)])
    around = np.arange(1, _RIM_POINTS + 1)
    outside = np.column_stack([np.zeros_like(around), around, around + 1])
    return drawing.Surface(points, np.vstack([outside, outside[:, ::-1]]))


def _stick(axis: int, thickness: float, length: float) -> drawing.Surface:
    """Return a line from the origin along an axis, of a radius and a length [m]."""
    return drawing.pipe(np.array([np.zeros(3), length * np.eye(3)[axis]]), thickness)[0]


def _tool_placement(robot: RobotModel) -> FloatArray:
    """Return the pose of the tool centre point in the frame of its body, shape (4, 4)."""
    q, body = np.zeros(robot.joint_count), robot.link_body[robot.tool_frame]
    (rotation, position), (tool_rotation, tool) = robot.body_poses(q), robot.tool_pose(q)
    placement = np.eye(4)
    placement[:3, :3] = rotation[body].T @ tool_rotation
    placement[:3, 3] = rotation[body].T @ (tool - position[body])
    return placement
