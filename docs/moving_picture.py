"""The moving picture of the README: python docs/moving_picture.py FILE.webp.

The cycle of `make demo` in real time: the arm in the tube of each move, and beside it velocities
and accelerations against their limits, and how much is used of what holds the carried part.
"""

import sys
from functools import cached_property
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from tubeplanner import Cycle, CycleMotion, load_cycle, plan_cycle
from tubeplanner.output.curves import TrajectoryCurves, cycle_timeline, motion_curves
from tubeplanner.output.drawing import (
    CARRIED_COLOR,
    LINE_COLORS,
    OBSTACLE_COLOR,
    Surface,
    joined,
    rgb,
    segment_color,
    shape_surface,
)
from tubeplanner.output.figures.rendering import RenderedSolid, SpaceView, rendered
from tubeplanner.output.figures.space_panel import tube_solids
from tubeplanner.output.link_visuals import carried_surfaces, link_parts
from tubeplanner.task.cycle import Cell
from tubeplanner.task.steps import Attach

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.lines import Line2D

PROBLEM = "example:panda/tray_to_the_next_shelf"
SIZE, DPI = (900, 560), 100  # pixels
RATE, LOOP = 20.0, 5.0  # frames per second; the last frame stays until the loop ends [s]
DIRECTION = np.array([-1.0, -1.0, 0.75])  # towards the viewer: into both shelves
MAX_FACES = 40_000  # of the arm: fewer than its meshes have would show
OBSTACLE_ALPHA, TUBE_ALPHA, OTHER_TUBE_ALPHA = 0.22, 0.42, 0.09
PATH_COLOR, CURSOR_COLOR = "#D55E00", "#C1121F"
LETTER = 0.04  # width of a letter on the time line [s]
ZOOM = 0.95  # of the scene's width that is shown: a corner of the floor may be missing
QUALITY = 80  # of WebP


class Scene:
    """The cell of a cycle at any time, from one direction and on one scale.

    Attributes:
        cycle: The cycle.
        motion: Its motion.
        view: The direction.
    """

    def __init__(self, cycle: Cycle, motion: CycleMotion) -> None:
        """Prepare what all frames have in common."""
        self.cycle, self.motion = cycle, motion
        self.view = SpaceView(DIRECTION / np.linalg.norm(DIRECTION))
        self._links, _ = link_parts(cycle.robot, MAX_FACES)
        self._cells = cycle.cells(motion.junctions)
        self._taken = {step.name for step in cycle.steps if isinstance(step, Attach)}

    def pixels(self, time: float) -> tuple[np.ndarray, tuple[float, float, float, float]]:
        """Return the picture at a time [s], (H, W, 4), and its extent on the page [m]."""
        picture = rendered([*self._arm(time), *self._cell(time), *self._tubes(time)], self.view)
        (left, bottom), (right, top) = picture.low, picture.high
        return picture.pixels, (left, right, bottom, top)

    def _cell_at(self, time: float) -> Cell:
        """Return what stands in the cell, and what the arm carries, at a time [s]."""
        begun = [k for k, (begin, _) in enumerate(self.motion.leg_times) if begin <= time]
        return self._cells[begun[-1] if begun else 0]

    def _arm(self, time: float) -> list[RenderedSolid]:
        """Return the links and the carried parts at a time [s]."""
        rotation, position = self.cycle.robot.body_poses(self.motion.trajectory.position([time]))
        attached = self._cell_at(time).attached
        parts = [(each.body, each.surface, np.array(each.color)) for each in self._links]
        for body, _, surface in carried_surfaces(self.cycle.robot, attached):
            parts.append((body, surface, rgb(CARRIED_COLOR)))
        solids = []
        for body, surface, color in parts:
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = rotation[0, body], position[0, body]
            solids.append(RenderedSolid(surface.moved(pose), color))
        return solids

    def _cell(self, time: float) -> list[RenderedSolid]:
        """Return the obstacles at a time [s]: parts opaque, all others translucent."""
        solids = []
        for obstacle in self._cell_at(time).obstacles:
            surface = joined(map(shape_surface, obstacle.shapes))
            if obstacle.name in self._taken:
                solids.append(RenderedSolid(surface, rgb(CARRIED_COLOR)))
            else:
                look = (rgb(OBSTACLE_COLOR), OBSTACLE_ALPHA)
                solids.append(RenderedSolid(surface, *look, has_edges=True))
        return [*solids, RenderedSolid(self._frame, np.zeros(3))]

    def _tubes(self, time: float) -> list[RenderedSolid]:
        """Return the tubes of all moves, that of the move at a time [s] in full colour."""
        solids = []
        spans = self.motion.move_times
        moves = [move for leg in self.cycle.legs for move in leg.moves]
        for k, move in enumerate(moves):
            begin, end = spans[move.name]
            alpha = TUBE_ALPHA if begin <= time <= end else OTHER_TUBE_ALPHA
            for solid in tube_solids(move.tube, [segment_color(k)] * move.tube.segment_count):
                solids.append(RenderedSolid(solid.surface, solid.color, alpha))
        return solids

    @cached_property
    def _frame(self) -> Surface:
        """Corners without faces about all that is ever drawn: every frame has the same scale."""
        shapes = [shape for each in self.cycle.obstacles for shape in each.shapes]
        points = np.vstack([shape_surface(shape).vertices for shape in shapes])
        return Surface(points, np.zeros((0, 3), dtype=int))


class Frames:
    """Pictures of a motion at any time: the scene, and curves with a cursor."""

    def __init__(self, scene: Scene) -> None:
        """Draw what all frames have in common."""
        self._scene, self._timeline = scene, cycle_timeline(scene.motion)
        self._cursors: list[Line2D] = []
        self._curves = motion_curves(scene.motion)
        self._duration = scene.motion.trajectory.duration
        width, height = SIZE
        self._figure = Figure(figsize=(width / DPI, height / DPI), dpi=DPI, facecolor="white")
        self._canvas = FigureCanvasAgg(self._figure)
        self._draw_panels()
        self._draw_moves(self._figure.add_axes((0.012, 0.03, 0.976, 0.075)))
        self._space = self._figure.add_axes((0.0, 0.115, 0.6, 0.885))
        self._space.set_axis_off()
        self._space.set_anchor("S")
        pixels, extent = scene.pixels(0.0)
        look: dict[str, Any] = {"interpolation": "antialiased", "interpolation_stage": "rgba"}
        self._image = self._space.imshow(pixels, origin="lower", extent=extent, zorder=2, **look)
        left, right, _, _ = extent
        margin = (1 - ZOOM) / 2 * (right - left)
        self._space.set_xlim(left + margin, right - margin)
        tool = np.vstack([run.tool for run in self._curves])
        self._page, self._time = scene.view.on_page(tool), self._joined("time")
        self._space.plot(*self._page.T, color="#444444", linewidth=0.8, zorder=3)
        self._trail = self._space.plot([], [], color=PATH_COLOR, linewidth=2.4, zorder=4)[0]
        self._tool = self._space.plot([], [], "o", color=PATH_COLOR, markersize=6, zorder=5)[0]
        self._clock = self._figure.text(0.014, 0.972, "", fontsize=13, va="top")
        self._figure.text(0.014, 0.163, "path of the tool", fontsize=10, color=PATH_COLOR)
        self._figure.text(0.014, 0.128, "tube: the tool stays inside", fontsize=10)

    def picture(self, time: float, remark: str = "") -> Image.Image:
        """Return the frame at a time [s], with a remark in place of the step's name."""
        self._image.set_data(self._scene.pixels(time)[0])
        done = self._time <= time
        self._trail.set_data(*self._page[done].T)
        self._tool.set_data(*self._page[done][-1:].T)
        self._clock.set_text(f"{time:.2f} s, {remark or self._step(time)}")
        for cursor in self._cursors:
            cursor.set_xdata([time, time])
        self._canvas.draw()
        return Image.fromarray(np.asarray(self._canvas.buffer_rgba())[:, :, :3])

    def _step(self, time: float) -> str:
        """Return the name of the move at a time [s], or of the steps at rest."""
        for stop in self._timeline.stops:
            if stop.begin <= time < stop.end:
                return stop.text.partition(",")[0]
        name = [band for band in self._timeline.bands if band.begin <= time][-1].name
        return name.replace("_", " ")

    def _joined(self, name: str) -> np.ndarray:
        """Return a field of the samples of all curves."""
        return np.concatenate([getattr(run.samples, name) for run in self._curves])

    def _draw_panels(self) -> None:
        """Draw the curves over time, each with its limit."""
        titles = ("joint velocity, % of limit", "joint acceleration, % of limit")
        for row, title in enumerate((*titles, "hold of the beaker on the tray, % used")):
            axis = self._figure.add_axes((0.655, 0.735 - 0.285 * row, 0.333, 0.205))
            axis.set_title(title, fontsize=10.5, loc="left", pad=4)
            axis.tick_params(labelsize=9, length=2)
            axis.set_xlim(0, self._duration)
            axis.grid(alpha=0.25)
            for run in self._curves:
                self._draw_curve(axis, row, run)
            if row < 2:
                axis.set(ylim=(-115, 115), yticks=(-100, 0, 100))
                for limit in (-100, 100):
                    axis.axhline(limit, color="#333333", linewidth=1.0, linestyle="--")
            else:
                axis.set(ylim=(0, 115), yticks=(0, 50, 100))
                axis.axhline(100, color="#333333", linewidth=1.0, linestyle="--")
            if row < 2:
                axis.set_xticklabels([])
            self._add_cursor(axis)

    def _draw_curve(self, axis: "Axes", row: int, run: TrajectoryCurves) -> None:
        """Draw the curves of a leg or of a rest into a panel."""
        limits, samples = run.problem.robot.limits, run.samples
        if row == 2:
            for use in run.holding:
                axis.plot(samples.time, 100 * use.share, color=PATH_COLOR, linewidth=1.6)
            return
        values = samples.acceleration if row else samples.velocity
        bound = limits.acceleration if row else limits.velocity
        for joint, curve in enumerate((100 * values / bound).T):
            color = LINE_COLORS[joint % len(LINE_COLORS)]
            axis.plot(samples.time, curve, color=color, linewidth=1.1)

    def _draw_moves(self, axis: "Axes") -> None:
        """Draw the time line of moves and rests."""
        for band in self._timeline.bands:
            width, middle = band.end - band.begin, (band.begin + band.end) / 2
            axis.barh(0, width, 1.0, band.begin, color=band.color, alpha=0.55, edgecolor="white")
            name = fill(band.name.replace("_", " "), max(int(width / LETTER), 4))
            if name.count("\n") < 2:
                axis.text(middle, 0, name, ha="center", va="center", fontsize=9, linespacing=0.95)
        axis.set(xlim=(0, self._duration), ylim=(-0.5, 0.5), yticks=[])
        axis.set_axis_off()
        self._add_cursor(axis)

    def _add_cursor(self, axis: "Axes") -> None:
        """Add a line at the time of the frame."""
        self._cursors.append(axis.axvline(0.0, color=CURSOR_COLOR, linewidth=1.5))


def main(path: Path) -> None:
    """Plan the cycle, and write its picture.

    Args:
        path: The file, .webp.
    """
    cycle = load_cycle(PROBLEM)
    result = plan_cycle(cycle)
    assert result.motion is not None
    frames, duration = Frames(Scene(cycle, result.motion)), result.motion.trajectory.duration
    times = [*np.arange(0.0, duration, 1 / RATE).tolist(), duration]
    remarks = ["" for _ in times[:-1]] + ["every limit proved"]
    pictures = [frames.picture(*each) for each in zip(times, remarks, strict=True)]
    wait = [round(1000 / RATE)] * (len(times) - 1)
    pictures[0].save(
        path,
        save_all=True,
        append_images=pictures[1:],
        duration=[*wait, round(1000 * LOOP) - sum(wait)],
        loop=0,
        quality=QUALITY,
        method=6,
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
