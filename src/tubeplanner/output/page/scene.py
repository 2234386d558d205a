"""Scene: layers, surfaces, placements; shown poses, camera."""

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
from tubeplanner.output.curves import Stretch
from tubeplanner.output.drawing import Surface, best_direction, floor_grid, outline
from tubeplanner.output.execution_curves import ExecutedPaths
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

# ---- Where the things of a scene stand, and from where they are seen.

_GAP = 0.15  # between trajectories side by side, of the width of one


@dataclass(frozen=True, eq=False)
class SceneFrame:
    """Where trajectories stand, the floor under them, and what a picture of all must hold.

    Attributes:
        offset: From each trajectory to the next, shape (3,) [m].
        direction: From the scene towards the viewer, unit vector (3,).
        outline: Points that a picture must hold, offsets included, shape (P, 3) [m].
        floor: Edges of a grid under all, shape (E, 2, 3) [m].
        floor_step: Length of one [m].
        top: Where a trajectory's name goes, its offset left out, shape (3,) [m].
    """

    offset: FloatArray
    direction: FloatArray
    outline: FloatArray
    floor: FloatArray
    floor_step: float
    top: FloatArray


def scene_frame(points: Sequence[FloatArray], direction: FloatArray, count: int) -> SceneFrame:
    """Return the frame of a scene.

    Args:
        points: All that one trajectory takes, each (N, 3) [m].
        direction: From the scene towards the viewer, unit vector (3,).
        count: How many trajectories stand side by side.
    """
    taken = np.vstack(points)
    # Side by side as seen from there: along x or y, whichever lies more across the view.
    across = int(abs(direction[0]) > abs(direction[1]))
    offset = np.eye(3)[across] * np.ptp(taken[:, across]) * (1 + _GAP)
    sides = outline(taken)
    held = np.vstack([sides + i * offset for i in range(count)])
    top = np.append((sides.min(axis=0) + sides.max(axis=0))[:2] / 2, sides[:, 2].max())
    return SceneFrame(offset, direction, held, *floor_grid(held), top)


# ---- What there is to see: surfaces, colours, placements; no viewer.
#
# Everything is in the base frame, in m and s. Several trajectories stand side by side, each with
# its own arm and tube, and start together.


class Layer(StrEnum):
    """What is shown or hidden together."""

    ARM = "arm"
    CARRIED = "carried"
    TUBE = "tube"
    REFERENCE = "reference"
    TOOL = "tool"
    AXES = "axes"
    ROTATION = "rotation"
    EXECUTED = "executed"
    OBSTACLES = "obstacles"
    SWEPT = "swept"
    BLOCKED = "blocked"


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
        present: Of bodies that come and go, when they are there, shape (T,).
    """

    name: str
    time: FloatArray
    rotation: FloatArray
    position: FloatArray
    tool: FloatArray
    speed: FloatArray
    present: Mapping[int, BoolArray] = field(default_factory=dict)

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


@dataclass(frozen=True, eq=False, kw_only=True)
class Scene:
    """All there is to see.

    Attributes:
        name: Of what is shown.
        trajectories: At least one; of no duration if no trajectory was given.
        items: Surfaces.
        frame: Where things stand and from where they are seen.
        thickness: Of drawn lines, their radius [m].
        notes: What else is worth knowing.
        stretches: Of each motion, under the problems that judge them; none of an arm at rest.
        executed: The tool's executed paths, beside the first trajectory; None: none were asked.
    """

    name: str
    trajectories: tuple[ShownTrajectory, ...]
    items: tuple[Item, ...]
    frame: SceneFrame
    thickness: float
    notes: tuple[str, ...]
    stretches: tuple[tuple[Stretch, ...], ...] = ()
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


# ---- Where an arm is seen: along a trajectory, or at rest; and from where it is seen best.

# Of the way through a trajectory: when the arm should not hide the path.
_SAMPLED_SHARES = (0.1, 0.5, 0.9)


class MovingBody(Protocol):
    """A body beside those of the arm: its poses (T, 4, 4), and whether it is there, (T,)."""

    @property
    def poses(self) -> FloatArray:
        """Of its frame, base frame, shape (T, 4, 4)."""

    @property
    def present(self) -> BoolArray:
        """When it is there, shape (T,)."""


def poses_along(
    robot: RobotModel, name: str, trajectory: JointTrajectory, time: FloatArray
) -> ShownTrajectory:
    """Return where an arm is at times (T,) of a trajectory of its joints, in their order."""
    return _posed(robot, name, time, trajectory.position(time), trajectory.velocity(time))


def poses_at_rest(problem: PlanningProblem, notes: list[str]) -> ShownTrajectory:
    """Return the arm at its start; near it, with a note, if seed or pose do not lead there."""
    try:
        q = end_configuration(problem, problem.endpoints[0], 0)
    except Infeasible as error:
        limits, seed = problem.robot.limits, problem.endpoints[0].seed
        where = "near zero" if seed is None else "at the seed"
        notes.append(f"the arm is drawn {where}: {error}")
        q = limits.clip(np.zeros(problem.robot.joint_count)) if seed is None else seed
    return poses_standing(problem.robot, "at its start", q)


def poses_standing(robot: RobotModel, where: str, q: FloatArray) -> ShownTrajectory:
    """Return an arm that stands still in a configuration (n,); `where` that is, in words."""
    return _posed(robot, where, np.zeros(1), q[None], np.zeros((1, len(q))))


def direction_of(
    trajectory: ShownTrajectory,
    points: Sequence[FloatArray],
    obstacles: Sequence[Obstacle],
    hulls: list[tuple[int, FloatArray]],
) -> FloatArray:
    """Return from where path and tube are seen best, as `best_direction` does.

    Args:
        trajectory: Where the arm is.
        points: Of the middle lines of tubes, each (N, 3) [m].
        obstacles: What stands still.
        hulls: Bodies, and points (V, 3) of what they carry.
    """
    solids = [shape for obstacle in obstacles for shape in obstacle.shapes]
    arms = [_moving_shapes(trajectory, share, hulls) for share in _SAMPLED_SHARES]
    return best_direction(np.vstack([trajectory.tool, *points]), solids, arms)


def with_bodies(shown: ShownTrajectory, bodies: Sequence[MovingBody]) -> ShownTrajectory:
    """Return where bodies are, others after those that there were."""
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
