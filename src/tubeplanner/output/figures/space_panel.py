"""The panel in space: floor, coordinates, arm, solids, tubes, path."""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.geometry.convex_shapes import convex_hull
from tubeplanner.geometry.solids import AttachedSolid, Obstacle
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.output import drawing
from tubeplanner.output.curves import segments_per_group
from tubeplanner.output.figures.rendering import RenderedSolid, SpaceView, rendered
from tubeplanner.output.link_visuals import carried_surfaces, link_parts
from tubeplanner.robot.model import RobotModel

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_TOOL_COLOR = "#D55E00"
_PANEL_AROUND = 0.25  # of the size of arm and tube: how far around them obstacles are drawn
_FLAT = 0.25  # of an arm's size: planar arms are not higher
_FROM_ABOVE = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class SpaceContent:
    """Content of the panel."""

    robot: RobotModel  # the arm
    q: FloatArray  # configurations in which it is drawn, shape (N, n)
    carried: Sequence[Sequence[AttachedSolid]]  # parts that it carries in each
    strong: int  # index of the configuration that is drawn in full colour
    path: FloatArray  # of the tool, shape (M, 3) [m]
    # tubes, and the colour of each; None: the colours of its segments
    tubes: Sequence[tuple[Tube, str | None]]
    obstacles: Sequence[Obstacle]  # all obstacles
    handed_over: Collection[str] = ()  # names of obstacles that the arm takes


def draw_space(axis: "Axes", content: SpaceContent) -> None:
    """Draw the content from a direction that shows the path well; planar motions from above."""
    arm = arm_solids(content.robot, content.q, content.carried, content.strong)
    tubes: list[RenderedSolid] = []
    for tube, color in content.tubes:
        colors = None if color is None else [color] * len(tube_solids(tube))
        tubes += tube_solids(tube, colors)
    low, high = _extent([*arm, *tubes])
    around = _PANEL_AROUND * float((high - low).max())
    view = SpaceView(_direction(content, arm, low, high))
    # Nothing is drawn below the floor under the arm.
    below = np.array([around, around, 0.02 * around])
    standing = obstacle_solids(content.obstacles, content.handed_over, low - below, high + around)
    solids = [*arm, *tubes, *standing]
    picture = rendered(solids, view)
    (left, bottom), (right, top) = picture.low, picture.high
    # Filtered after colours are mapped, so that pixels do not mix with empty ones.
    options: dict[str, Any] = {"interpolation": "antialiased", "interpolation_stage": "rgba"}
    extent = (left, right, bottom, top)
    axis.imshow(picture.pixels, origin="lower", extent=extent, zorder=2, **options)
    draw_frame(axis, view, *_extent(solids))
    _draw_lines(axis, view, content)
    _draw_legend(axis, content, solids)


def _extent(solids: Sequence[RenderedSolid]) -> tuple[FloatArray, FloatArray]:
    """Return opposite corners of a box about solids, each (3,) [m]."""
    points = np.vstack([solid.surface.vertices for solid in solids if len(solid.surface.vertices)])
    return points.min(axis=0), points.max(axis=0)


def _direction(
    content: SpaceContent, arm: Sequence[RenderedSolid], low: FloatArray, high: FloatArray
) -> FloatArray:
    """Return the direction from the scene to the viewer, unit vector (3,)."""
    heights = np.concatenate([tube.points[:, 2] for tube, _ in content.tubes])
    size = high - low
    if np.ptp(heights) < 1e-9 and size[2] < _FLAT * size.max():
        return _FROM_ABOVE
    points = np.vstack([content.path, *(tube.points for tube, _ in content.tubes)])
    shapes = [shape for obstacle in content.obstacles for shape in obstacle.shapes]
    hulls = [convex_hull(drawing.coarse_hull_points(solid.surface.vertices)) for solid in arm]
    return drawing.best_direction(points, shapes, [hulls])


def _draw_lines(axis: "Axes", view: SpaceView, content: SpaceContent) -> None:
    """Draw the path of the tool, with its ends marked, and the lines of the tubes."""
    for tube, color in content.tubes:
        if tube.is_anywhere:
            continue
        style: dict[str, Any] = {"color": color or drawing.REFERENCE_COLOR, "linewidth": 1.0}
        axis.plot(*view.on_page(tube.points).T, linestyle="--", zorder=3, **style)
    page = view.on_page(content.path)
    axis.plot(*page.T, color="white", linewidth=4.0, alpha=0.8, zorder=3)
    axis.plot(*page.T, color=_TOOL_COLOR, linewidth=2.2, zorder=4, label="path of the tool")
    ends: dict[str, Any] = {"color": _TOOL_COLOR, "zorder": 5, "markersize": 7}
    axis.plot(*page[0], "o", markerfacecolor="white", markeredgewidth=1.8, label="start", **ends)
    axis.plot(*page[-1], "o", markeredgecolor="white", label="goal", **ends)


def _draw_legend(axis: "Axes", content: SpaceContent, solids: Sequence[RenderedSolid]) -> None:
    """Name the content, below the panel."""
    from matplotlib.patches import Patch

    handles, _ = axis.get_legend_handles_labels()
    names = {
        drawing.ARM_COLOR: f"arm, strong {'at the goal' if content.strong else 'at the start'}",
        drawing.GRIPPER_COLOR: "gripper",
        drawing.CARRIED_COLOR: "carried",
        drawing.OBSTACLE_COLOR: "obstacles",
    }
    drawn = {tuple(solid.color) for solid in solids}
    if any(content.carried):
        drawn.add(tuple(drawing.rgb(drawing.CARRIED_COLOR)))
    handles += [
        Patch(color=color, label=name)
        for color, name in names.items()
        if tuple(drawing.rgb(color)) in drawn
    ]
    below = -0.16 if axis.axison else 0.0  # the numbers of its axes
    options: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, below), "ncols": 4}
    axis.legend(handles=handles, fontsize=8, frameon=False, **options)


# ---- The solids of the panel in space: arm, gripper, carried parts, obstacles, tubes.

_MAX_FACES = 9000  # of all arms that are drawn
_OBSTACLE_ALPHA, _TUBE_ALPHA = 0.38, 0.24
_PALE = 0.62  # of white in the colours of a pale arm
_BESIDE = 0.3  # of the longest side of a box: obstacles this near are drawn
_FIRST_LINK = 1e-9  # a link this near to its body's frame is the one that the joint carries


def arm_solids(
    robot: RobotModel, q: FloatArray, carried: Sequence[Sequence[AttachedSolid]], strong: int
) -> list[RenderedSolid]:
    """Return the arm in configurations (N, n) with the parts that it carries in each.

    The strong one has full colours, the others are pale; static links are there once, with it.
    """
    parts, _ = link_parts(robot, _MAX_FACES // len(q))
    tool_body, links = robot.link_body[robot.tool_frame], []
    for part in parts:
        # The gripper is fixed to the link that the last joint before the tool moves.
        offset = abs(robot.link_placement[part.link] - np.eye(4)).max()
        is_gripper = robot.link_body[part.link] == tool_body and offset > _FIRST_LINK
        links.append(
            (part.body, part.surface, drawing.GRIPPER_COLOR if is_gripper else drawing.ARM_COLOR)
        )
    rotation, position = robot.body_poses(q)
    solids = []
    for k in [*(k for k in range(len(q)) if k != strong), strong]:
        pale = 0.0 if k == strong else _PALE
        parts_carried = [
            (body, surface, drawing.CARRIED_COLOR)
            for body, _, surface in carried_surfaces(robot, carried[k])
        ]
        for body, surface, color in [*links, *parts_carried]:
            if body == 0 and k != strong:
                continue
            placement = np.eye(4)
            placement[:3, :3], placement[:3, 3] = rotation[k, body], position[k, body]
            mixed = (1 - pale) * drawing.rgb(color) + pale
            solids.append(RenderedSolid(surface.moved(placement), mixed))
    return solids


def obstacle_solids(
    obstacles: Iterable[Obstacle], handed_over: Collection[str], low: FloatArray, high: FloatArray
) -> list[RenderedSolid]:
    """Return the obstacles in or beside a box; parts that are handed over in their own colour.

    Obstacles larger than the box, with corners (3,) [m], are cut, at its sides or at the end of
    the outermost other.
    """
    surfaces = [
        (each.name, drawing.joined(map(drawing.shape_surface, each.shapes))) for each in obstacles
    ]
    size = float((high - low).max())
    beside = _BESIDE * size
    near = [
        (name, surface)
        for name, surface in surfaces
        if (surface.vertices.min(axis=0) < high + beside).all()
        and (surface.vertices.max(axis=0) > low - beside).all()
    ]
    for _, surface in near:
        if np.ptp(surface.vertices, axis=0).max() <= size:
            low = np.minimum(low, surface.vertices.min(axis=0))
            high = np.maximum(high, surface.vertices.max(axis=0))
    solids = []
    for name, surface in near:
        is_part = name in handed_over
        color = drawing.rgb(drawing.CARRIED_COLOR if is_part else drawing.OBSTACLE_COLOR)
        alpha = 1.0 if is_part else _OBSTACLE_ALPHA
        for k in range(3):
            for sign, end in ((1.0, low[k]), (-1.0, high[k])):
                inside = sign * (surface.vertices[:, k] - end)
                if (inside < 0).any():
                    surface = drawing.clipped(surface, inside)
        part = drawing.joined([surface])
        if len(part.faces):
            solids.append(RenderedSolid(part, color, alpha, has_edges=True))
    return solids


def tube_solids(tube: Tube, colors: Sequence[str] | None = None) -> list[RenderedSolid]:
    """Return the skin of a tube, by groups of segments as in other panels.

    Without colours of the groups they have the colours of segments in turn. Where the tool may be
    anywhere there is none.
    """
    if tube.is_anywhere:
        return []
    step = segments_per_group(tube.segment_count)
    groups = range(0, tube.segment_count, step)
    if colors is None:
        colors = [drawing.segment_color(k) for k in range(len(groups))]
    if step == 1:
        surfaces = drawing.tube_surfaces(tube)
    else:
        # Hundreds of translucent capsules in one another would be an opaque lump.
        ends = [(first, min(first + step, tube.segment_count)) for first in groups]
        surfaces = [
            drawing.pipe(tube.points[a : b + 1], float(tube.effective_radius[a:b].min()))[0]
            for a, b in ends
        ]
    return [
        RenderedSolid(surface, drawing.rgb(color), _TUBE_ALPHA)
        for surface, color in zip(surfaces, colors, strict=len(surfaces) > 0)
    ]


# ---- The surroundings of the panel in space: a floor with a grid, and coordinates along its sides.

_AROUND = 0.04  # margin about the box in a view from above, of its size
_LINES = 6  # of the grid along the longest side, at most
_GRID: dict[str, Any] = {"color": "#D5D5D5", "linewidth": 0.7, "zorder": 1}
_AXIS: dict[str, Any] = {"color": "#777777", "linewidth": 1.0, "zorder": 1}
_UP = 2
_NAMES = ("x [m]", "y [m]", "z [m]")


def draw_frame(axis: "Axes", view: SpaceView, low: FloatArray, high: FloatArray) -> None:
    """Draw the floor of a box with corners (3,) [m], and its coordinates, on the page."""
    axis.set_aspect("equal")
    if view.is_from_above:
        around = _AROUND * (high - low).max()
        axis.set(xlim=(low[0] - around, high[0] + around), ylim=(low[1] - around, high[1] + around))
        axis.set_xlabel(_NAMES[0])
        axis.set_ylabel(_NAMES[1])
        axis.grid(color=_GRID["color"], linewidth=_GRID["linewidth"])
        axis.set_axisbelow(True)
        return
    axis.set_axis_off()
    # Lines of the grid are 1, 2 or 5 times a power of ten apart [m].
    rough = float((high - low).max()) / _LINES
    power = 10.0 ** np.floor(np.log10(rough))
    step = float(power * next(digit for digit in (1, 2, 5, 10) if digit * power >= rough))
    near = np.where(view.direction > 0, high, low)
    far = np.where(view.direction > 0, low, high)
    stops = [
        np.arange(np.ceil(a / step), np.floor(b / step) + 1) * step
        for a, b in zip(low, high, strict=True)
    ]
    for k in (0, 1):
        for stop in stops[k]:
            line = np.array([low, high])
            line[:, k], line[:, 2] = stop, low[2]
            axis.plot(*view.on_page(line).T, **_GRID)
        ends = np.array([near, near])
        ends[:, k], ends[:, 2] = (low[k], high[k]), low[2]
        _draw_scale(axis, view, ends, k, stops[k])
    # The upright scale is at the left end of the floor, where nothing hides it.
    sides = np.array([[near[0], far[1]], [far[0], near[1]]])
    left = sides[view.on_page(np.column_stack([sides, low[[2, 2]]]))[:, 0].argmin()]
    ends = np.array([[*left, low[2]], [*left, high[2]]])
    _draw_scale(axis, view, ends, _UP, stops[_UP])


def _draw_scale(axis: "Axes", view: SpaceView, ends: FloatArray, k: int, stops: FloatArray) -> None:
    """Draw a scale from end to end (2, 3), with numbers at the stops and its name."""
    axis.plot(*view.on_page(ends).T, **_AXIS)
    positions = np.tile(ends[0], (len(stops), 1))
    positions[:, k] = stops
    align: dict[str, Any]
    if k == _UP:
        shift, align = (-6.0, 0.0), {"ha": "right", "va": "center"}
    else:
        along = np.diff(view.on_page(ends), axis=0)[0]
        falls = along[0] * along[1] < 0
        shift = (-4.0 if falls else 4.0, -6.0)
        align = {"ha": "right" if falls else "left", "va": "top"}
    for position, stop in zip(view.on_page(positions), stops, strict=True):
        axis.annotate(
            f"{stop + 0.0:.4g}", position, shift, textcoords="offset points", fontsize=7, **align
        )
    position, far = ends.mean(axis=0), (3.0 * shift[0], 3.0 * shift[1])
    if k == _UP:
        position, far, align = ends[1], (0.0, 6.0), {"ha": "center"}
    x, y = view.on_page(position).tolist()
    axis.annotate(_NAMES[k], (x, y), far, textcoords="offset points", fontsize=8, **align)
