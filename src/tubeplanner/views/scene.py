"""The scene of a problem and its trajectories: surfaces, colours, placements; no viewer.

Everything is in the base frame, in m and s. Several trajectories stand side by side, each with its
own arm and tube, and start together.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.branches.reference_branch import end_configuration
from tubeplanner.collision.convex_shape import ConvexShape, convex_hull
from tubeplanner.errors import TrajectoryError
from tubeplanner.outcome import Infeasible
from tubeplanner.problem.problem import PlanningProblem, Seed
from tubeplanner.simulation.execution import Execution
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.views.arm_hulls import arm_hulls, carried_surfaces
from tubeplanner.views.executed_paths import ExecutedPaths, executed_paths
from tubeplanner.views.execution_curves import tool_runs
from tubeplanner.views.goal_ball import goal_ball
from tubeplanner.views.link_visuals import LinkPart, link_parts
from tubeplanner.views.palette import (
    OBSTACLE_COLOR,
    REFERENCE_COLOR,
    rgb,
    segment_color,
    speed_colors,
)
from tubeplanner.views.surface import (
    Surface,
    dashes,
    directions,
    hull_surface,
    joined,
    pipe,
    shape_surface,
    tube_surfaces,
)
from tubeplanner.views.viewpoint import best_direction, floor_grid, outline

# Triangles of all arms together: what makes a file that can be mailed.
_MAX_FACES = 60_000
_FRAMES_PER_SECOND, _MIN_FRAMES, _MAX_FRAMES = 200, 80, 240
_SWEEP_STEPS = 24
_EXECUTED_STEPS = 240  # lines of an executed path
_BESIDE_EXECUTED = 0.3  # of its usual thickness: the planned path among executed ones
_BALL_POINTS = 150
# Of the way through a trajectory: when the arm should not hide the path.
_SAMPLED_SHARES = (0.1, 0.5, 0.9)
_GAP = 0.15  # between trajectories side by side, of the width of one
CARRIED_COLOR = "#B58863"
SWEPT_COLOR = "#7A6FAF"
_POINT_COLOR = "#111111"


class Layer(StrEnum):
    """What is shown or hidden together."""

    ARM = "arm"
    CARRIED = "carried"
    TUBE = "tube"
    REFERENCE = "reference"
    TOOL = "tool"
    EXECUTED = "executed"
    OBSTACLES = "obstacles"
    SWEPT = "swept"


@dataclass(frozen=True, eq=False)
class Item:
    """A surface of one material.

    Attributes:
        layer: What it belongs to.
        trajectory: Index of the trajectory that it stands with.
        name: Unique among the items of a layer and trajectory.
        surface: In the frame of the body that carries it, else in the base frame.
        color: Red, green, blue from 0 to 1, shape (3,), or of every vertex, (V, 3).
        opacity: 1 is solid.
        body: The body that carries it; 0 stands still.
        is_smooth: Whether it is shaded as round where its triangles share vertices.
    """

    layer: Layer
    trajectory: int
    name: str
    surface: Surface
    color: FloatArray
    opacity: float = 1.0
    body: int = 0
    is_smooth: bool = True


@dataclass(frozen=True, eq=False)
class ShownTrajectory:
    """Where the bodies are at T times; one time stands for an arm at rest.

    Attributes:
        name: Its name.
        time: Shape (T,), from 0 to the duration [s].
        rotation: Of all bodies, shape (T, bodies, 3, 3).
        position: Of all bodies, shape (T, bodies, 3) [m].
        tool: Tool centre point, shape (T, 3) [m].
        speed: Of the tool, shape (T,) [m/s].
    """

    name: str
    time: FloatArray
    rotation: FloatArray
    position: FloatArray
    tool: FloatArray
    speed: FloatArray

    @property
    def duration(self) -> float:
        """Duration [s]; 0 at rest."""
        return float(self.time[-1])

    def placement(self, step: int, body: int) -> FloatArray:
        """Return where a body is at one of the times, shape (4, 4)."""
        placement = np.eye(4)
        placement[:3, :3] = self.rotation[step, body]
        placement[:3, 3] = self.position[step, body]
        return placement


@dataclass(frozen=True, eq=False)
class Scene:
    """All there is to see.

    Attributes:
        problem: What is shown.
        trajectories: At least one; of no duration if no trajectory was given.
        items: Surfaces.
        offset: From each trajectory to the next, shape (3,) [m].
        direction: From the scene towards the viewer, unit vector (3,).
        outline: Points that a picture must hold, offsets included, shape (P, 3) [m].
        floor: Edges of a grid under all, shape (E, 2, 3) [m].
        floor_step: Length of one [m].
        top: Where a trajectory's name goes, its offset left out, shape (3,) [m].
        notes: What else is worth knowing.
        executed: The tool's executed paths, beside the first trajectory; None: none were asked.
    """

    problem: PlanningProblem
    trajectories: tuple[ShownTrajectory, ...]
    items: tuple[Item, ...]
    offset: FloatArray
    direction: FloatArray
    outline: FloatArray
    floor: FloatArray
    floor_step: float
    top: FloatArray
    notes: tuple[str, ...]
    executed: ExecutedPaths | None = None

    @property
    def layers(self) -> list[Layer]:
        """The layers in which there is something, in the order of `Layer`."""
        found = {item.layer for item in self.items}
        if self.executed is not None:
            found.add(Layer.EXECUTED)
        return [layer for layer in Layer if layer in found]

    @property
    def peak_speed(self) -> float:
        """Highest speed of any tool [m/s]."""
        return max(float(trajectory.speed.max()) for trajectory in self.trajectories)

    @property
    def duration(self) -> float:
        """Of the longest trajectory [s]."""
        return max(trajectory.duration for trajectory in self.trajectories)


def build_scene(
    problem: PlanningProblem,
    named: Mapping[str, JointTrajectory],
    execution: Execution | None = None,
    *,
    notes: Sequence[str] = (),
    empty_handed: Collection[str] = (),
) -> Scene:
    """Return the scene of a problem and some trajectories, by name.

    Without a trajectory the arm rests at the start. The execution is that of the one trajectory.
    Trajectories that are empty-handed are drawn without the problem's carried solids. Notes of the
    scene begin with those that are given.

    Raises:
        TrajectoryError: A trajectory moves other joints than the problem's; it is named.
        RobotError: The robot's geometry is of a kind no URDF has.
    """
    said = list(notes)
    trajectories = tuple(_shown(problem, *pair) for pair in named.items())
    if not trajectories:
        trajectories = (_at_rest(problem, said),)
    parts, notes_of_parts = link_parts(problem.robot, _MAX_FACES // len(trajectories))
    hulls = arm_hulls(problem, parts)
    tube = tube_surfaces(problem.tube)
    swept = [_swept(trajectory, hulls) for trajectory in trajectories]
    standing = [points for body, points in hulls if body == 0]
    points = np.vstack([*(s.vertices for s in [*swept, *tube]), *standing])
    size = float(np.ptp(points, axis=0).max())
    direction = _direction(problem, trajectories[0], hulls)
    # Side by side as seen from there: along x or y, whichever lies more across the view.
    across = int(abs(direction[0]) > abs(direction[1]))
    offset = np.eye(3)[across] * np.ptp(points[:, across]) * (1 + _GAP)
    fastest = max(float(trajectory.speed.max()) for trajectory in trajectories)
    items: list[Item] = []
    for i, trajectory in enumerate(trajectories):
        items += _arm(i, parts)
        items += [] if trajectory.name in empty_handed else _carried(i, problem)
        items += _surroundings(i, problem, tube, size)
        width = 1.0 if execution is None else _BESIDE_EXECUTED
        items += _tool(i, trajectory, problem, width * _thickness(problem, size), fastest)
        if trajectory.duration > 0:
            items.append(Item(Layer.SWEPT, i, "links", swept[i], rgb(SWEPT_COLOR), 0.22))
    sides = outline(points)
    held = np.vstack([sides + i * offset for i in range(len(trajectories))])
    top = np.append((sides.min(axis=0) + sides.max(axis=0))[:2] / 2, sides[:, 2].max())
    return Scene(
        problem,
        trajectories,
        tuple(items),
        offset,
        direction,
        held,
        *floor_grid(held),
        top,
        tuple([*said, *notes_of_parts]),
        _executed(problem, named, execution),
    )


def _shown(problem: PlanningProblem, name: str, trajectory: JointTrajectory) -> ShownTrajectory:
    try:
        ordered = trajectory.reordered(problem.robot.joint_names)
    except TrajectoryError as error:
        raise TrajectoryError(f"{name}: {error}") from error
    wanted = int(np.ceil(_FRAMES_PER_SECOND * trajectory.duration))
    frames = min(max(wanted, _MIN_FRAMES), _MAX_FRAMES)
    time = np.linspace(0.0, trajectory.duration, frames)
    q, velocity = ordered.position(time), ordered.velocity(time)
    return _posed(problem, name, time, q, velocity)


def _at_rest(problem: PlanningProblem, notes: list[str]) -> ShownTrajectory:
    """Return the arm at its start; near it, with a note, if seed or pose do not lead there."""
    try:
        q = end_configuration(problem, problem.start, 0)
    except Infeasible as error:
        limits, given = problem.robot.limits, problem.start
        seed = given.joints if isinstance(given, Seed) else getattr(given, "seed", None)
        where = "near zero" if seed is None else "at the seed"
        notes.append(f"the arm is drawn {where}: {error}")
        q = limits.clip(np.zeros(problem.robot.joint_count)) if seed is None else seed
    return _posed(problem, "start", np.zeros(1), q[None], np.zeros((1, len(q))))


def _posed(
    problem: PlanningProblem, name: str, time: FloatArray, q: FloatArray, velocity: FloatArray
) -> ShownTrajectory:
    rotation, position = problem.robot.body_poses(q)
    tool, jacobian = problem.robot.tool_jacobian(q)
    speed = np.linalg.norm(np.einsum("tij,tj->ti", jacobian[:, :3], velocity), axis=1)
    return ShownTrajectory(name, time, rotation, position, tool, speed)


def _swept(trajectory: ShownTrajectory, hulls: list[tuple[int, FloatArray]]) -> Surface:
    """Return the space that moving links take: hulls of each in one pose and the next."""
    steps = np.unique(np.linspace(0, len(trajectory.time) - 1, _SWEEP_STEPS).round().astype(int))
    pieces = []
    for body, points in hulls:
        if body == 0:
            continue
        placements = [trajectory.placement(step, body) for step in steps]
        poses = [points @ placement[:3, :3].T + placement[:3, 3] for placement in placements]
        pairs = pairwise(poses) if len(poses) > 1 else [(poses[0],)]
        pieces += [hull_surface(np.vstack(pair)) for pair in pairs]
    return joined(pieces)


def _direction(
    problem: PlanningProblem, trajectory: ShownTrajectory, hulls: list[tuple[int, FloatArray]]
) -> FloatArray:
    """Return from where path and tube are seen best, as `best_direction` does."""
    solids = [shape for obstacle in problem.obstacles for shape in obstacle.shapes]
    path = np.vstack([trajectory.tool, problem.tube.points])
    arms = [_moving_shapes(trajectory, share, hulls) for share in _SAMPLED_SHARES]
    return best_direction(path, solids, arms)


def _moving_shapes(
    trajectory: ShownTrajectory, share: float, hulls: list[tuple[int, FloatArray]]
) -> list[ConvexShape]:
    """Return hulls of the moving links after a share of a trajectory, in the base frame."""
    step = round(share * (len(trajectory.time) - 1))
    return [
        convex_hull(points).transformed(trajectory.placement(step, body))
        for body, points in hulls
        if body > 0
    ]


def _arm(trajectory: int, parts: list[LinkPart]) -> list[Item]:
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


def _carried(trajectory: int, problem: PlanningProblem) -> list[Item]:
    color = rgb(CARRIED_COLOR)
    return [
        Item(Layer.CARRIED, trajectory, name, surface, color, 0.85, body, is_smooth=False)
        for body, name, surface in carried_surfaces(problem)
    ]


def _surroundings(
    trajectory: int, problem: PlanningProblem, tube: list[Surface], size: float
) -> list[Item]:
    """Return tube, reference path and obstacles; `size` is that of the scene [m]."""
    items = [
        Item(Layer.TUBE, trajectory, f"segment_{k}", surface, rgb(segment_color(k)), 0.3)
        for k, surface in enumerate(tube)
    ]
    thickness = _thickness(problem, size)
    line = dashes(problem.tube.points, 0.45 * thickness, 10 * thickness)
    items.append(Item(Layer.REFERENCE, trajectory, "path", line, rgb(REFERENCE_COLOR)))
    for ball in goal_ball(problem):
        items.append(Item(Layer.REFERENCE, trajectory, "goal", ball, rgb(REFERENCE_COLOR), 0.35))
    for obstacle in problem.obstacles:
        surface = joined(shape_surface(shape) for shape in obstacle.shapes)
        color = rgb(OBSTACLE_COLOR)
        items.append(
            Item(Layer.OBSTACLES, trajectory, obstacle.name, surface, color, 0.55, is_smooth=False)
        )
    return items


def _tool(
    i: int, trajectory: ShownTrajectory, problem: PlanningProblem, thickness: float, fastest: float
) -> list[Item]:
    """Return the tool's path, coloured by its speed, and a point where the tool is."""
    robot = problem.robot
    body = robot.link_body[robot.tool_frame]
    center = (trajectory.tool[0] - trajectory.position[0, body]) @ trajectory.rotation[0, body]
    point = hull_surface(center + 1.8 * thickness * directions(_BALL_POINTS))
    items = [Item(Layer.TOOL, i, "point", point, rgb(_POINT_COLOR), 1.0, body)]
    surface, owner = pipe(trajectory.tool, thickness)
    if len(owner):
        share = trajectory.speed[owner] / (fastest or 1.0)
        items.append(Item(Layer.TOOL, i, "path", surface, speed_colors(share)))
    return items


def _executed(
    problem: PlanningProblem, named: Mapping[str, JointTrajectory], execution: Execution | None
) -> ExecutedPaths | None:
    if execution is None:
        return None
    (trajectory,) = named.values()
    return executed_paths(tool_runs(problem, trajectory, execution), _EXECUTED_STEPS)


def _thickness(problem: PlanningProblem, size: float) -> float:
    """Return the radius of drawn lines [m]: thin in the tube, thick enough to be seen."""
    return float(np.clip(0.12 * problem.tube.effective_radius.min(), 0.002 * size, 0.004 * size))
