"""View_cycle: moved parts, scene, panel."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray
from tubeplanner.errors import OptionError
from tubeplanner.execution.simulation import Execution
from tubeplanner.geometry.convex_shapes import ConvexShape
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.output.curves import cycle_stretches, cycle_timeline, tube_name
from tubeplanner.output.drawing import (
    REFERENCE_COLOR,
    Surface,
    goal_ball,
    joined,
    rgb,
    segment_color,
    shape_surface,
    tube_surfaces,
)
from tubeplanner.output.execution_curves import BESIDE_EXECUTED, ExecutedPaths, cycle_executed_paths
from tubeplanner.output.link_visuals import (
    MAX_FACES,
    LinkPart,
    arm_hulls,
    carried_surfaces,
    link_parts,
)
from tubeplanner.output.page.panel import arm_words, binding_marks, layer_data, listed, page_data
from tubeplanner.output.page.problem_scene import (
    arm_items,
    carried_items,
    line_thickness,
    obstacle_items,
    reference_item,
    swept_item,
    swept_surface,
    tool_items,
    turned_tool,
)
from tubeplanner.output.page.scene import (
    Item,
    Layer,
    Scene,
    ShownTrajectory,
    direction_of,
    poses_along,
    poses_at_rest,
    scene_frame,
    with_bodies,
)
from tubeplanner.output.page.viewer import View, require_names
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.cycle_motion import CycleMotion
from tubeplanner.task.steps import Attach, Detach, Move
from tubeplanner.trajectory.parts import Mark

# ---- Parts of a cycle over time: they stand, move with the tool, and stand where it put them.


@dataclass(frozen=True, eq=False)
class MovedPart:
    """Something that the tool takes or lets go, at T times.

    Attributes:
        name: What it is called; parts that follow each other may share a name.
        surface: In its own frame.
        poses: Of its frame, base frame, shape (T, 4, 4).
        present: Whether it is there, shape (T,).
    """

    name: str
    surface: Surface
    poses: FloatArray
    present: BoolArray

    def carry(self, first: int, tool: FloatArray) -> None:
        """Let it move with the tool frame, shape (T, 4, 4), from a time's index on."""
        grip = np.linalg.solve(tool[first], self.poses[first])
        self.poses[first:] = tool[first:] @ grip

    def seen_at(self, step: int) -> FloatArray:
        """Return its points at one of the times, base frame, shape (V, 3) [m]; none if absent."""
        return self.surface.moved(self.poses[step]).vertices[: None if self.present[step] else 0]

    def put_down(self, first: int, *, stays: bool) -> None:
        """Let it stand where it is from a time's index on, or be gone."""
        self.poses[first:] = self.poses[first]
        self.present[first:] = stays


def moved_parts(
    cycle: Cycle, marks: Sequence[Mark], time: FloatArray, tool: FloatArray
) -> list[MovedPart]:
    """Return the parts that a cycle's steps hand over.

    Args:
        cycle: The cycle.
        marks: When its steps begin; none: nothing is handed over yet.
        time: Shape (T,), the times of all marks among them [s].
        tool: Pose of the tool frame at these times, base frame, shape (T, 4, 4).
    """
    handed_over = {step.name for step in cycle.steps if isinstance(step, Attach)}
    found = [
        _part(obstacle.name, obstacle.shapes, len(time))
        for obstacle in cycle.obstacles
        if obstacle.name in handed_over
    ]
    present = {part.name: part for part in found}
    for step, mark in zip(cycle.steps, marks, strict=False):
        first = int(np.searchsorted(time, mark.time))
        if isinstance(step, Attach):
            if step.name not in present and step.solid is not None:
                present[step.name] = _new_part(step.name, step.solid.shapes, first, tool)
                found.append(present[step.name])
            if step.name in present:
                present[step.name].carry(first, tool)
        elif isinstance(step, Detach) and step.name in present:
            present[step.name].put_down(first, stays=step.leaves_obstacle)
            if not step.leaves_obstacle:
                del present[step.name]
    return found


def _part(name: str, shapes: Sequence[ConvexShape], count: int) -> MovedPart:
    """Return a part that stands still at so many times."""
    surface = joined(shape_surface(shape) for shape in shapes)
    return MovedPart(name, surface, np.tile(np.eye(4), (count, 1, 1)), np.ones(count, bool))


def _new_part(name: str, shapes: Sequence[ConvexShape], first: int, tool: FloatArray) -> MovedPart:
    """Return a part in the tool frame that was not there before."""
    part = _part(name, shapes, len(tool))
    part.poses[:] = tool[first]
    part.present[:first] = False
    return part


# ---- The scene of a cycle and its motions.

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
            for ball in goal_ball(move.endpoint):
                color = rgb(REFERENCE_COLOR)
                yield Item(Layer.REFERENCE, i, f"goal_{k}", ball, color, 0.35)


# ---- What the panel of a cycle's page says: its moves with their colours, parts, the time line.


def cycle_panel_data(scene: CycleScene) -> dict[str, Any]:
    """Return the text of a cycle's page and how it frames the scene, as JSON values."""
    cycle, moves = scene.cycle, _moves(scene)
    handed_over = dict.fromkeys(step.name for step in cycle.steps if isinstance(step, Attach))
    standing = [each.name for each in cycle.obstacles if each.name not in handed_over]
    balls = any(goal_ball(move.endpoint) for move in moves)
    words = {
        Layer.CARRIED: listed("Carried", [*(each.name for each in cycle.attached), *handed_over]),
        Layer.TUBE: "Tubes of the moves (radius): the tool must stay inside",
        Layer.REFERENCE: "Reference paths" + ", goals' balls" * balls,
        Layer.OBSTACLES: listed("Obstacles", standing),
    }
    entries = {Layer.TUBE: _move_entries(scene)}
    layers = [layer_data(layer, scene, words, entries) for layer in scene.layers]
    kind = "closed cycle" if cycle.closed else "cycle"
    about = f"{arm_words(cycle.robot)}; {kind} of {len(moves)} move{'s' * (len(moves) > 1)}"
    timelines = [
        {**cycle_timeline(motion).as_dict(scene.duration), "binds": binding_marks(stretches)}
        for motion, stretches in zip(scene.motions, scene.stretches, strict=True)
    ]
    return {**page_data(scene, about, layers), "timelines": timelines}


def _moves(scene: CycleScene) -> list[Move]:
    return [move for leg in scene.cycle.legs for move in leg.moves]


def _move_entries(scene: CycleScene) -> list[dict[str, str]]:
    """Return colour, name and tube of every move, and how long it takes in the only motion."""
    times = scene.motions[0].move_times if len(scene.motions) == 1 else {}
    entries = []
    for k, move in enumerate(_moves(scene)):
        begin, end = times.get(move.name, (0.0, 0.0))
        lasts = f", {1000 * (end - begin):.0f} ms" if move.name in times else ""
        text = f"{move.name}: {_sizes(move.tube)}{lasts}"
        entries.append({"color": segment_color(k), "text": text})
    return entries


def _sizes(tube: Tube) -> str:
    """Return the radii of a tube's segments, of boxes half the smaller side."""
    radii = 1000 * tube.effective_radius
    low, high = f"{radii.min():.3g}", f"{radii.max():.3g}"
    return f"{low} mm" if low == high else f"{low} to {high} mm"


# ---- A cycle as one HTML page: all moves on one time line, with what happens between them.


def view_cycle(
    cycle: Cycle,
    motions: Sequence[CycleMotion] = (),
    names: Sequence[str] | None = None,
    notes: Sequence[str] = (),
    execution: Execution | None = None,
) -> View:
    """Return a view of a cycle with motions side by side; without any, at its start.

    With an execution, also the paths that the tool took, in another colour outside the tube of the
    move that runs.

    Args:
        cycle: The cycle.
        motions: Of the cycle.
        names: Names of the motions; default: numbers.
        notes: Shown on the page before its own.
        execution: Of the one motion.

    Raises:
        ProblemError: The cycle is none.
        OptionError: There are not as many names as motions, or two are the same; or an execution,
            and not one motion.
        RobotError: The robot's geometry is of a kind no URDF has.
    """
    Cycle.require(cycle)
    if names is None:
        names = [f"motion {i + 1}" for i in range(len(motions))]
    require_names(names, len(motions))
    if execution is not None and len(motions) != 1:
        raise OptionError(f"execution goes with one motion, not {len(motions)}; give one")
    scene = build_cycle_scene(cycle, dict(zip(names, motions, strict=True)), notes, execution)
    return View(scene, cycle_panel_data(scene))
