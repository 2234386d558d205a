"""Scene of a page: layers, surfaces, placements, poses of the arm; no viewer.

All of it is in the base frame, in m and s. Several trajectories are side by side, each with its
own arm and tube, and start together.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Protocol

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray
from tubeplanner.first_guess.branches import end_configuration
from tubeplanner.geometry.convex_shapes import ConvexShape, convex_hull
from tubeplanner.geometry.solids import Obstacle
from tubeplanner.outcome import Infeasible
from tubeplanner.output.curves import LimitedSection
from tubeplanner.output.drawing import (
    Surface,
    best_direction,
    floor_grid,
    joined,
    outline,
    shape_surface,
)
from tubeplanner.output.execution_curves import ExecutedPaths
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.motion import Motion, Task
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.steps import Attach, Detach
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.parts import Mark

# ---- The frame of a scene: offsets between trajectories, direction of sight, floor.

_GAP = 0.15  # between trajectories side by side, of the width of one


@dataclass(frozen=True, eq=False)
class SceneFrame:
    """Offsets of trajectories, the floor below, and the extent of a picture of the scene."""

    offset: FloatArray  # from each trajectory to the next, shape (3,) [m]
    direction: FloatArray  # from the scene towards the viewer, unit vector (3,)
    outline: FloatArray  # points that a picture must contain, offsets included, shape (P, 3) [m]
    floor: FloatArray  # edges of a grid below the scene, shape (E, 2, 3) [m]
    floor_step: float  # length of an edge [m]
    top: FloatArray  # point of the first trajectory's name, shape (3,) [m]


def scene_frame(points: Sequence[FloatArray], direction: FloatArray, count: int) -> SceneFrame:
    """Return the frame of a scene with a number of trajectories side by side.

    Points, each (N, 3) [m], are the extent of one; the direction is towards the viewer.
    """
    extent = np.vstack(points)
    # Side by side in this view: along x or y, whichever lies more across the line of sight.
    across = int(abs(direction[0]) > abs(direction[1]))
    offset = np.eye(3)[across] * np.ptp(extent[:, across]) * (1 + _GAP)
    sides = outline(extent)
    all_sides = np.vstack([sides + i * offset for i in range(count)])
    top = np.append((sides.min(axis=0) + sides.max(axis=0))[:2] / 2, sides[:, 2].max())
    return SceneFrame(offset, direction, all_sides, *floor_grid(all_sides), top)


# ---- The content of a scene: items in layers, trajectories, notes.


class Layer(StrEnum):
    """Part of a scene that is shown or hidden as a whole."""

    ARM = "arm"
    CARRIED = "carried"
    TUBE = "tube"
    REFERENCE = "reference"
    TOOL = "tool"
    AXES = "axes"
    ROTATION = "rotation"
    HOLDING = "holding"
    EXECUTED = "executed"
    OBSTACLES = "obstacles"
    SWEPT = "swept"
    BLOCKED = "blocked"


@dataclass(frozen=True, eq=False)
class Item:
    """A surface of one material."""

    layer: Layer  # its layer
    trajectory: int  # index of its trajectory
    name: str  # unique among the items of a layer and trajectory
    surface: Surface  # in the frame of the body that carries it, else in the base frame
    color: FloatArray  # red, green, blue from 0 to 1, shape (3,), or of every vertex, (V, 3)
    opacity: float = 1.0  # 1 is solid
    body: int = 0  # the body that carries it; 0 is static
    is_smooth: bool = True  # True to shade it as round where triangles share vertices


@dataclass(frozen=True, eq=False)
class ShownTrajectory:
    """Poses of all bodies at T times; a single time for an arm at rest."""

    name: str  # its name
    time: FloatArray  # shape (T,), from 0 to the duration [s]
    rotation: FloatArray  # of all bodies, shape (T, bodies, 3, 3)
    position: FloatArray  # of all bodies, shape (T, bodies, 3) [m]
    tool: FloatArray  # tool centre point, shape (T, 3) [m]
    speed: FloatArray  # of the tool, shape (T,) [m/s]
    # presence over time of bodies that come and go, shape (T,)
    present: Mapping[int, BoolArray] = field(default_factory=dict)

    @property
    def duration(self) -> float:
        """Duration [s]; 0 at rest."""
        return float(self.time[-1])

    def placement(self, step: int, body: int) -> FloatArray:
        """Return the pose of a body at a time, by its index, shape (4, 4)."""
        placement = np.eye(4)
        placement[:3, :3] = self.rotation[step, body]
        placement[:3, 3] = self.position[step, body]
        return placement


@dataclass(frozen=True, eq=False, kw_only=True)
class Scene:
    """Content of a page."""

    name: str  # of the problem or cycle
    task: Task  # the problem or cycle
    motions: tuple[Motion, ...]  # of the trajectories; none if the arm is at rest
    trajectories: tuple[ShownTrajectory, ...]  # at least one; of no duration without a motion
    items: tuple[Item, ...]  # surfaces
    frame: SceneFrame  # offsets, direction of sight and floor
    thickness: float  # radius of drawn lines [m]
    notes: tuple[str, ...]  # further remarks
    # of each motion, under the problems that judge it; none of an arm at rest
    sections: tuple[tuple[LimitedSection, ...], ...] = ()
    # the tool's executed paths, beside the first trajectory; None: none
    executed: ExecutedPaths | None = None

    @property
    def layers(self) -> list[Layer]:
        """Layers with any content, in the order of `Layer`."""
        used = {item.layer for item in self.items}
        if self.executed is not None:
            used.add(Layer.EXECUTED)
        return [layer for layer in Layer if layer in used]

    @property
    def peak_speed(self) -> float:
        """Highest speed of any tool [m/s]."""
        return max(float(trajectory.speed.max()) for trajectory in self.trajectories)

    @property
    def duration(self) -> float:
        """Duration of the longest trajectory [s]."""
        return max(trajectory.duration for trajectory in self.trajectories)


# ---- Poses of an arm, along a trajectory or at rest; the best direction of sight.

# Fractions of a trajectory's samples at which the arm should not hide the path.
_SAMPLED_FRACTIONS = (0.1, 0.5, 0.9)


class MovingBody(Protocol):
    """A body beside the bodies of the arm: its poses (T, 4, 4), and its presence, (T,)."""

    @property
    def poses(self) -> FloatArray:
        """Poses of its frame in the base frame, shape (T, 4, 4)."""

    @property
    def present(self) -> BoolArray:
        """True while the body is there, shape (T,)."""


def poses_along(
    robot: RobotModel, name: str, trajectory: JointTrajectory, time: FloatArray
) -> ShownTrajectory:
    """Return the poses of an arm at times (T,) of a trajectory of its joints, in their order."""
    return _posed(robot, name, time, trajectory.position(time), trajectory.velocity(time))


def poses_at_rest(problem: PlanningProblem, notes: list[str]) -> ShownTrajectory:
    """Return the arm at its start; nearby, with a note, if seed or pose fail to lead there."""
    try:
        q = end_configuration(problem, problem.endpoints[0], 0)
    except Infeasible as error:
        limits, seed = problem.robot.limits, problem.endpoints[0].seed
        where = "near zero" if seed is None else "at the seed"
        notes.append(f"the arm is drawn {where}: {error}")
        q = limits.clip(np.zeros(problem.robot.joint_count)) if seed is None else seed
    return poses_standing(problem.robot, "at its start", q)


def poses_standing(robot: RobotModel, where: str, q: FloatArray) -> ShownTrajectory:
    """Return an arm at rest in a configuration (n,); `where` describes its location in words."""
    return _posed(robot, where, np.zeros(1), q[None], np.zeros((1, len(q))))


def direction_of(
    trajectory: ShownTrajectory,
    points: Sequence[FloatArray],
    obstacles: Sequence[Obstacle],
    hulls: list[tuple[int, FloatArray]],
) -> FloatArray:
    """Return the direction from which path and tube are seen best, as `best_direction`.

    Points, each (N, 3) [m], are of the middle lines of tubes; hulls are bodies with points (V, 3).
    """
    solids = [shape for obstacle in obstacles for shape in obstacle.shapes]
    arms = []
    for fraction in _SAMPLED_FRACTIONS:
        step = round(fraction * (len(trajectory.time) - 1))
        arms.append(
            [
                convex_hull(vertices).transformed(trajectory.placement(step, body))
                for body, vertices in hulls
                if body > 0
            ]
        )
    return best_direction(np.vstack([trajectory.tool, *points]), solids, arms)


def with_bodies(shown: ShownTrajectory, bodies: Sequence[MovingBody]) -> ShownTrajectory:
    """Return a trajectory with further bodies, numbered after its own."""
    count = shown.rotation.shape[1]
    rotation = [shown.rotation, *(body.poses[:, None, :3, :3] for body in bodies)]
    position = [shown.position, *(body.poses[:, None, :3, 3] for body in bodies)]
    present = {count + k: body.present for k, body in enumerate(bodies)}
    return replace(
        shown,
        rotation=np.concatenate(rotation, axis=1),
        position=np.concatenate(position, axis=1),
        present={**shown.present, **present},
    )


def _posed(
    robot: RobotModel, name: str, time: FloatArray, q: FloatArray, velocity: FloatArray
) -> ShownTrajectory:
    rotation, position = robot.body_poses(q)
    tool, jacobian = robot.tool_jacobian(q)
    speed = np.linalg.norm(np.einsum("tij,tj->ti", jacobian[:, :3], velocity), axis=1)
    return ShownTrajectory(name, time, rotation, position, tool, speed)


# ---- Parts of a cycle over time: at rest, carried by the tool, at rest where it let go.


@dataclass(frozen=True, eq=False)
class MovedPart:
    """A part that the tool takes or lets go, at T times."""

    name: str  # successive parts may share a name
    surface: Surface  # in its own frame
    poses: FloatArray  # of its frame, base frame, shape (T, 4, 4)
    present: BoolArray  # True while it is there, shape (T,)

    def carry(self, first: int, tool: FloatArray) -> None:
        """Move the part with the tool frame, shape (T, 4, 4), from a time's index on."""
        grip = np.linalg.solve(tool[first], self.poses[first])
        self.poses[first:] = tool[first:] @ grip

    def seen_at(self, step: int) -> FloatArray:
        """Return the vertices at a time, base frame, shape (V, 3) [m]; none if absent."""
        return self.surface.moved(self.poses[step]).vertices[: None if self.present[step] else 0]

    def put_down(self, first: int, *, stays: bool) -> None:
        """Leave the part at rest from a time's index on, or remove the part."""
        self.poses[first:] = self.poses[first]
        self.present[first:] = stays


def handed_over(task: Task) -> tuple[str, ...]:
    """Return the names of the parts that a cycle's steps hand over; none of a problem."""
    steps = task.steps if isinstance(task, Cycle) else ()
    return tuple(dict.fromkeys(step.name for step in steps if isinstance(step, Attach)))


def moved_parts(
    task: Task, marks: Sequence[Mark], time: FloatArray, tool: FloatArray
) -> list[MovedPart]:
    """Return the parts that a cycle's steps hand over; none of a problem.

    Marks are the begins of its steps; without any nothing is handed over yet. Times (T,) [s] have
    those of all marks among them; the tool frame has poses (T, 4, 4) in the base frame.
    """
    if not isinstance(task, Cycle):
        return []
    parts = [
        _part(obstacle.name, obstacle.shapes, len(time))
        for obstacle in task.obstacles
        if obstacle.name in handed_over(task)
    ]
    present = {part.name: part for part in parts}
    for step, mark in zip(task.steps, marks, strict=False):
        first = int(np.searchsorted(time, mark.time))
        if isinstance(step, Attach):
            if step.name not in present and step.solid is not None:
                part = _part(step.name, step.solid.shapes, len(time))
                part.poses[:] = tool[first]
                part.present[:first] = False
                present[step.name] = part
                parts.append(part)
            if step.name in present:
                present[step.name].carry(first, tool)
        elif isinstance(step, Detach) and step.name in present:
            present[step.name].put_down(first, stays=step.leaves_obstacle)
            if not step.leaves_obstacle:
                del present[step.name]
    return parts


def _part(name: str, shapes: Sequence[ConvexShape], count: int) -> MovedPart:
    """Return a part at rest at a number of times."""
    surface = joined(shape_surface(shape) for shape in shapes)
    return MovedPart(name, surface, np.tile(np.eye(4), (count, 1, 1)), np.ones(count, bool))
