"""The scene of a cycle and its motions."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.cycle.cycle import Cycle
from tubeplanner.cycle.cycle_motion import CycleMotion
from tubeplanner.cycle.steps import Attach
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.simulation.execution import Execution
from tubeplanner.views.arm_hulls import arm_hulls, carried_surfaces
from tubeplanner.views.cycle_curves import cycle_stretches
from tubeplanner.views.cycle_executed_paths import cycle_executed_paths
from tubeplanner.views.cycle_timeline import tube_name
from tubeplanner.views.executed_paths import BESIDE_EXECUTED, ExecutedPaths
from tubeplanner.views.goal_ball import goal_ball
from tubeplanner.views.link_visuals import MAX_FACES, LinkPart, link_parts
from tubeplanner.views.moved_parts import MovedPart, moved_parts
from tubeplanner.views.orientation_items import turned_tool
from tubeplanner.views.palette import REFERENCE_COLOR, rgb, segment_color
from tubeplanner.views.scene import Item, Layer, Scene, ShownTrajectory
from tubeplanner.views.scene_frame import scene_frame
from tubeplanner.views.scene_items import (
    arm_items,
    carried_items,
    line_thickness,
    obstacle_items,
    reference_item,
    swept_item,
    swept_surface,
    tool_items,
)
from tubeplanner.views.shown_poses import (
    direction_of,
    poses_along,
    poses_at_rest,
    with_bodies,
)
from tubeplanner.views.surface import joined, tube_surfaces

_FRAMES_PER_SECOND, _MIN_FRAMES, _MAX_FRAMES = 200, 80, 1200
_SWEEP_STEPS, _MAX_SWEEP_STEPS = 24, 96  # of one move, of all
_TUBE_OPACITY = 0.2


@dataclass(frozen=True, eq=False, kw_only=True)
class CycleScene(Scene):
    """The scene of a cycle.

    Attributes:
        cycle: What is shown.
        motions: Of the trajectories; none if the arm is at its start.
    """

    cycle: Cycle
    motions: tuple[CycleMotion, ...]


def build_cycle_scene(
    cycle: Cycle,
    named: Mapping[str, CycleMotion],
    notes: Sequence[str] = (),
    execution: Execution | None = None,
) -> CycleScene:
    """Return the scene of a cycle and some of its motions, by name.

    Without a motion the arm rests at the start. The execution is that of the one motion. Parts that
    are taken or let go are bodies of their own, after the arm's. Notes of the scene begin with
    those that are given.

    Raises:
        RobotError: The robot's geometry is of a kind no URDF has.
    """
    said, robot = list(notes), cycle.robot
    shown = [_shown(robot, *pair) for pair in named.items()]
    if not shown:
        shown = [poses_at_rest(cycle.problem_from_anywhere(0), said)]
    marks = [motion.marks for motion in named.values()] or [()]
    parts = [
        moved_parts(cycle, when, each.time, _tool_frame(robot, each))
        for each, when in zip(shown, marks, strict=True)
    ]
    shown = [with_bodies(*pair) for pair in zip(shown, parts, strict=True)]
    stretches = tuple(cycle_stretches(cycle, motion) for motion in named.values())
    links, notes_of_links = link_parts(robot, MAX_FACES // len(shown))
    drawing = _Drawing(cycle, links, shown, parts, is_executed=execution is not None)
    items: list[Item] = []
    for i, each in enumerate(shown):
        items += drawing.items(i)
        own = stretches[i] if stretches else ()
        shown[i], turned = turned_tool(i, robot, drawing.tubes, own, each, drawing.thickness)
        items += turned
    return CycleScene(
        name=cycle.name,
        trajectories=tuple(shown),
        items=tuple(items),
        frame=scene_frame(drawing.points, drawing.direction, len(shown)),
        thickness=drawing.thickness,
        stretches=stretches,
        notes=(*said, *notes_of_links),
        executed=_executed(named, execution),
        cycle=cycle,
        motions=tuple(named.values()),
    )


def _executed(
    named: Mapping[str, CycleMotion], execution: Execution | None
) -> ExecutedPaths | None:
    if execution is None:
        return None
    (motion,) = named.values()
    return cycle_executed_paths(motion, execution)


def _shown(robot: RobotModel, name: str, motion: CycleMotion) -> ShownTrajectory:
    """Return where the arm is at times that have those of all marks among them."""
    duration = motion.trajectory.duration
    instants = sorted({0.0, *(mark.time for mark in motion.marks), duration})
    fewest, most = _MIN_FRAMES / duration, _MAX_FRAMES / duration
    rate = min(max(_FRAMES_PER_SECOND, fewest), most)
    spans = [
        np.linspace(begin, end, int(np.ceil(rate * (end - begin))) + 1)[1:]
        for begin, end in pairwise(instants)
    ]
    return poses_along(robot, name, motion.trajectory, np.concatenate([[0.0], *spans]))


def _tool_frame(robot: RobotModel, shown: ShownTrajectory) -> FloatArray:
    """Return the poses of the tool frame, base frame, shape (T, 4, 4)."""
    body = robot.link_body[robot.tool_frame]
    poses = np.array([shown.placement(step, body) for step in range(len(shown.time))])
    return np.array(poses @ robot.link_placement[robot.tool_frame])


class _Drawing:
    """Turns a cycle and poses of its arm into items.

    Attributes:
        points: All that a trajectory takes, each (N, 3) [m].
        direction: From the scene towards the viewer, unit vector (3,).
        tubes: Of all moves.
        thickness: Of drawn lines, their radius [m].
    """

    def __init__(
        self,
        cycle: Cycle,
        links: list[LinkPart],
        trajectories: Sequence[ShownTrajectory],
        parts: Sequence[Sequence[MovedPart]],
        *,
        is_executed: bool,
    ) -> None:
        self._robot, self._links, self._trajectories = cycle.robot, links, trajectories
        self._parts = parts
        self._moves = [move for leg in cycle.legs for move in leg.moves]
        self._carried = carried_surfaces(cycle.robot, cycle.attached)
        handed_over = {step.name for step in cycle.steps if isinstance(step, Attach)}
        self._standing = [each for each in cycle.obstacles if each.name not in handed_over]
        hulls = arm_hulls(links, self._carried)
        steps = min(_SWEEP_STEPS * len(self._moves), _MAX_SWEEP_STEPS)
        self._swept = [swept_surface(each, hulls, steps) for each in trajectories]
        self._tubes = [joined(tube_surfaces(move.tube)) for move in self._moves]
        fixed = [points for body, points in hulls if body == 0]
        surfaces = [*self._swept, *self._tubes]
        stands = [part.seen_at(step) for each in parts for part in each for step in (0, -1)]
        self.points = [*(surface.vertices for surface in surfaces), *fixed, *stands]
        lines = [move.tube.points for move in self._moves]
        self.direction = direction_of(trajectories[0], lines, self._standing, hulls)
        size = float(np.ptp(np.vstack(self.points), axis=0).max())
        self.tubes = [move.tube for move in self._moves]
        self.thickness = line_thickness(self.tubes, size)
        self._path_width = self.thickness * (BESIDE_EXECUTED if is_executed else 1.0)
        self._fastest = max(float(each.speed.max()) for each in trajectories)

    def items(self, i: int) -> list[Item]:
        """Return the items of a trajectory and of the parts that are handed over along it."""
        trajectory, parts = self._trajectories[i], self._parts[i]
        first = trajectory.rotation.shape[1] - len(parts)
        bodies = [(first + k, f"{part.name}/{k}", part.surface) for k, part in enumerate(parts)]
        return [
            *arm_items(i, self._links),
            *carried_items(i, [*self._carried, *bodies]),
            *self._tube_items(i),
            *obstacle_items(i, self._standing),
            *tool_items(i, trajectory, self._robot, self._path_width, self._fastest),
            *swept_item(i, trajectory, self._swept[i]),
        ]

    def _tube_items(self, i: int) -> Iterator[Item]:
        """Yield the tubes of moves, one colour each, their middle lines and their goals' balls."""
        for k, (move, surface) in enumerate(zip(self._moves, self._tubes, strict=True)):
            color = rgb(segment_color(k))
            yield Item(Layer.TUBE, i, tube_name(k), surface, color, _TUBE_OPACITY)
            yield reference_item(i, f"move_{k}", move.tube.points, self.thickness)
            for ball in goal_ball(move.goal):
                color = rgb(REFERENCE_COLOR)
                yield Item(Layer.REFERENCE, i, f"goal_{k}", ball, color, 0.35)
