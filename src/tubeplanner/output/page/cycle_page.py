"""Page of a cycle: handed-over parts, scene, panel."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray
from tubeplanner.certificate.verification import CycleCertificate
from tubeplanner.errors import OptionError
from tubeplanner.execution.simulation import Execution
from tubeplanner.geometry.convex_shapes import ConvexShape
from tubeplanner.output.curves import cycle_timeline, limited_sections, tube_name
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
from tubeplanner.output.execution_curves import BESIDE_EXECUTED, cycle_executed_paths
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
    tool_orientation,
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
from tubeplanner.output.page.verdict import with_verdict
from tubeplanner.output.page.viewer import View, require_names
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.motion import CycleMotion
from tubeplanner.task.steps import Attach, Detach, Move
from tubeplanner.text import LimitCost
from tubeplanner.trajectory.parts import Mark


def view_cycle(
    cycle: Cycle,
    motions: Sequence[CycleMotion] = (),
    names: Sequence[str] | None = None,
    notes: Sequence[str] = (),
    execution: Execution | None = None,
    certificates: Sequence[CycleCertificate] = (),
    sensitivities: Sequence[LimitCost] = (),
) -> View:
    """Return a view of a cycle with motions side by side; without any, at its start.

    With an execution, also the paths of the tool, in another colour outside the tube of the move.

    Args:
        cycle: The cycle.
        motions: Of the cycle.
        names: Names of the motions; default: numbers.
        notes: Shown on the page before its own notes.
        execution: Of the one motion.
        certificates: Of the motions; none: the page has no verdict.
        sensitivities: Costs of limits, the largest first.

    Raises:
        ProblemError: `cycle` is no Cycle.
        OptionError: The numbers of names and motions differ, or two names are equal; or there is
            an execution, and not one motion.
        RobotError: The robot's geometry is of a kind no URDF has.
    """
    Cycle.require(cycle)
    if names is None:
        names = [f"motion {i + 1}" for i in range(len(motions))]
    require_names(names, len(motions))
    if execution is not None and len(motions) != 1:
        raise OptionError(f"execution goes with one motion, not {len(motions)}; give one")
    scene = build_cycle_scene(cycle, dict(zip(names, motions, strict=True)), notes, execution)
    trajectories = [motion.trajectory for motion in motions]
    shown = cycle.robot, trajectories, certificates, sensitivities, cycle
    return View(scene, with_verdict(cycle_panel_data(scene), *shown))


# ---- Parts of a cycle over time: at rest, carried by the tool, at rest where it let go.


@dataclass(frozen=True, eq=False)
class MovedPart:
    """A part that the tool takes or lets go, at T times.

    Attributes:
        name: Successive parts may share a name.
        surface: In its own frame.
        poses: Of its frame, base frame, shape (T, 4, 4).
        present: True while it is there, shape (T,).
    """

    name: str
    surface: Surface
    poses: FloatArray
    present: BoolArray

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


def moved_parts(
    cycle: Cycle, marks: Sequence[Mark], time: FloatArray, tool: FloatArray
) -> list[MovedPart]:
    """Return the parts that a cycle's steps hand over.

    Args:
        cycle: The cycle.
        marks: Begins of its steps; none: nothing is handed over yet.
        time: Shape (T,), the times of all marks among them [s].
        tool: Pose of the tool frame at these times, base frame, shape (T, 4, 4).
    """
    handed_over = {step.name for step in cycle.steps if isinstance(step, Attach)}
    parts = [
        _part(obstacle.name, obstacle.shapes, len(time))
        for obstacle in cycle.obstacles
        if obstacle.name in handed_over
    ]
    present = {part.name: part for part in parts}
    for step, mark in zip(cycle.steps, marks, strict=False):
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


# ---- The scene of a cycle and its motions.

_FRAMES_PER_SECOND, _MIN_FRAMES, _MAX_FRAMES = 200, 80, 1200
_SWEEP_STEPS, _MAX_SWEEP_STEPS = 24, 96  # of one move, of all
_TUBE_OPACITY = 0.2


@dataclass(frozen=True, eq=False, kw_only=True)
class CycleScene(Scene):
    """The scene of a cycle.

    Attributes:
        cycle: The cycle.
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

    Without a motion the arm rests at the start. An execution belongs to the one motion. Parts that
    are taken or let go are bodies of their own, after the arm's. Notes of the scene begin with
    `notes`.

    Raises:
        RobotError: The robot's geometry is of a kind no URDF has.
    """
    all_notes, robot = list(notes), cycle.robot
    arms = [_moving_arm(robot, *pair) for pair in named.items()]
    if not arms:
        arms = [poses_at_rest(cycle.problem_from_anywhere(0), all_notes)]
    marks = [motion.marks for motion in named.values()] or [()]
    body, placement = robot.link_body[robot.tool_frame], robot.link_placement[robot.tool_frame]
    parts = []
    for each, own_marks in zip(arms, marks, strict=True):
        poses = np.array([each.placement(step, body) for step in range(len(each.time))])
        parts.append(moved_parts(cycle, own_marks, each.time, np.array(poses @ placement)))
    arms = [with_bodies(*pair) for pair in zip(arms, parts, strict=True)]
    sections = tuple(limited_sections(motion) for motion in named.values())
    links, notes_of_links = link_parts(robot, MAX_FACES // len(arms))
    drawing = _Drawing(cycle, links, arms, parts, is_executed=execution is not None)
    executed = None
    if execution is not None:
        (motion,) = named.values()
        executed = cycle_executed_paths(motion, execution)
    items: list[Item] = []
    for i, each in enumerate(arms):
        items += drawing.items(i)
        own = sections[i] if sections else ()
        arms[i], orientation = tool_orientation(
            i, robot, drawing.tubes, own, each, drawing.thickness
        )
        items += orientation
    return CycleScene(
        name=cycle.name,
        trajectories=tuple(arms),
        items=tuple(items),
        frame=scene_frame(drawing.points, drawing.direction, len(arms)),
        thickness=drawing.thickness,
        sections=sections,
        notes=(*all_notes, *notes_of_links),
        executed=executed,
        cycle=cycle,
        motions=tuple(named.values()),
    )


def _moving_arm(robot: RobotModel, name: str, motion: CycleMotion) -> ShownTrajectory:
    """Return the poses of the arm along a motion, at times that include all marks."""
    duration = motion.trajectory.duration
    instants = sorted({0.0, *(mark.time for mark in motion.marks), duration})
    fewest, most = _MIN_FRAMES / duration, _MAX_FRAMES / duration
    rate = min(max(_FRAMES_PER_SECOND, fewest), most)
    spans = [
        np.linspace(begin, end, int(np.ceil(rate * (end - begin))) + 1)[1:]
        for begin, end in pairwise(instants)
    ]
    return poses_along(robot, name, motion.trajectory, np.concatenate([[0.0], *spans]))


class _Drawing:
    """Converts a cycle and poses of its arm to items.

    Attributes:
        points: Extent of a trajectory, each (N, 3) [m].
        direction: From the scene towards the viewer, unit vector (3,).
        tubes: Of all moves.
        thickness: Radius of drawn lines [m].
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
        at_rest = [part.seen_at(step) for each in parts for part in each for step in (0, -1)]
        self.points = [*(surface.vertices for surface in surfaces), *fixed, *at_rest]
        lines = [move.tube.points for move in self._moves]
        self.direction = direction_of(trajectories[0], lines, self._standing, hulls)
        size = float(np.ptp(np.vstack(self.points), axis=0).max())
        self.tubes = [move.tube for move in self._moves]
        self.thickness = line_thickness(self.tubes, size)
        self._path_width = self.thickness * (BESIDE_EXECUTED if is_executed else 1.0)
        self._fastest = max(float(each.speed.max()) for each in trajectories)

    def items(self, i: int) -> list[Item]:
        """Return the items of a trajectory and of its handed-over parts."""
        trajectory, parts = self._trajectories[i], self._parts[i]
        first = trajectory.rotation.shape[1] - len(parts)
        bodies = [(first + k, f"{part.name}/{k}", part.surface) for k, part in enumerate(parts)]
        # The tubes of moves, in a colour each, their reference paths and goal balls.
        tubes = []
        for k, (move, surface) in enumerate(zip(self._moves, self._tubes, strict=True)):
            color = rgb(segment_color(k))
            tubes.append(Item(Layer.TUBE, i, tube_name(k), surface, color, _TUBE_OPACITY))
            tubes.append(reference_item(i, f"move_{k}", move.tube.points, self.thickness))
            for ball in goal_ball(move.endpoint):
                color = rgb(REFERENCE_COLOR)
                tubes.append(Item(Layer.REFERENCE, i, f"goal_{k}", ball, color, 0.35))
        return [
            *arm_items(i, self._links),
            *carried_items(i, [*self._carried, *bodies]),
            *tubes,
            *obstacle_items(i, self._standing),
            *tool_items(i, trajectory, self._robot, self._path_width, self._fastest),
            *swept_item(i, trajectory, self._swept[i]),
        ]


# ---- The panel of a cycle's page: moves with their colours, parts, the time line.


def cycle_panel_data(scene: CycleScene) -> dict[str, Any]:
    """Return the panel of a cycle's page and the frame of its scene, as JSON values."""
    cycle, moves = scene.cycle, [move for leg in scene.cycle.legs for move in leg.moves]
    handed_over = dict.fromkeys(step.name for step in cycle.steps if isinstance(step, Attach))
    standing = [each.name for each in cycle.obstacles if each.name not in handed_over]
    balls = any(goal_ball(move.endpoint) for move in moves)
    words = {
        Layer.CARRIED: listed("Carried", [*(each.name for each in cycle.attached), *handed_over]),
        Layer.TUBE: "Tubes of the moves (radius): the tool must stay inside",
        Layer.REFERENCE: "Reference paths" + ", goals' balls" * balls,
        Layer.OBSTACLES: listed("Obstacles", standing),
    }
    entries = {Layer.TUBE: _move_entries(scene, moves)}
    layers = [layer_data(layer, scene, words, entries) for layer in scene.layers]
    kind = "closed cycle" if cycle.closed else "cycle"
    about = f"{arm_words(cycle.robot)}; {kind} of {len(moves)} move{'s' * (len(moves) > 1)}"
    timelines = [
        {**cycle_timeline(motion).as_dict(scene.duration), "binds": binding_marks(sections)}
        for motion, sections in zip(scene.motions, scene.sections, strict=True)
    ]
    return {**page_data(scene, about, layers), "timelines": timelines}


def _move_entries(scene: CycleScene, moves: Sequence[Move]) -> list[dict[str, str]]:
    """Return colour, name and tube of every move, and its duration if there is a single motion."""
    times = scene.motions[0].move_times if len(scene.motions) == 1 else {}
    entries = []
    for k, move in enumerate(moves):
        begin, end = times.get(move.name, (0.0, 0.0))
        lasts = f", {end - begin:.3f} s" if move.name in times else ""
        radii = 1000 * move.tube.effective_radius  # of boxes half the smaller side
        low, high = f"{radii.min():.3g}", f"{radii.max():.3g}"
        size = f"{low} mm" if low == high else f"{low} to {high} mm"
        text = f"{move.name}: {size}{lasts}"
        entries.append({"color": segment_color(k), "text": text})
    return entries
