"""Picture of an arm in one configuration, with named frames."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.geometry.solids import AttachedSolid, Obstacle
from tubeplanner.output import drawing
from tubeplanner.output.figures.figure_files import new_figure, saved
from tubeplanner.output.link_visuals import carried_surfaces, link_parts
from tubeplanner.robot.model import RobotModel

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MAX_FACES = 12_000
_AXIS_LENGTH = 0.09  # of the drawn frames, fraction of the picture's size
_SAME_PLACE = 0.01  # frames nearer than this fraction have one label
_AXIS_COLORS = (drawing.LINE_COLORS[1], drawing.LINE_COLORS[2], drawing.LINE_COLORS[0])  # x, y, z
_ARM_ALPHA, _REST_ALPHA = 0.35, 0.1
_ZOOM = 0.93  # leaves space for the axes' labels
_MAX_LABEL = 44  # [characters]
_TOP, _BOTTOM = 0.93, 0.12  # of the columns of labels, fraction of the figure's height
_LEFT, _RIGHT = 0.02, 0.98


@dataclass(frozen=True, eq=False)
class _Frame:
    """Frames at one place: names, rotation (3, 3), and origin (3,) [m]."""

    label: str
    rotation: FloatArray
    origin: FloatArray


def plot_robot(
    robot: RobotModel,
    q: FloatArray,
    path: str | Path | None = None,
    obstacles: Sequence[Obstacle] = (),
    attached: Sequence[AttachedSolid] = (),
) -> "Figure":
    """Draw an arm, its links in their own colours and the frames along its chain with their names.

    Args:
        robot: The arm.
        q: Configuration, shape (n,) [rad or m].
        path: File to save the figure to, as PNG, PDF or SVG by its ending; None: none.
        obstacles: Drawn beside the arm.
        attached: Drawn at the tool.

    Raises:
        RobotError: A geometry cannot be read.
        OptionError: The file has another ending.
        OutputError: The file could not be written.
    """
    rotation, position = robot.body_poses(q)
    figure = new_figure(10, 7.5)
    figure.set_layout_engine("none")  # columns of names stand beside the axes
    figure.suptitle(f"{robot.name}: {robot.joint_count} joints to {robot.tool_frame}", fontsize=13)
    axis = figure.add_axes((0.14, 0.05, 0.72, 0.89), projection="3d")
    carried, gray = drawing.rgb(drawing.CARRIED_COLOR), drawing.rgb(drawing.OBSTACLE_COLOR)
    solids = [(body, surface, carried) for body, _, surface in carried_surfaces(robot, attached)]
    shapes = (drawing.shape_surface(shape) for each in obstacles for shape in each.shapes)
    solids += [(0, surface, gray) for surface in shapes]
    points = [_draw_links(axis, robot, rotation, position, solids)]
    links = _chain_links(robot)
    poses = []
    for link in links:
        body_pose, body = np.eye(4), robot.link_body[link]
        body_pose[:3, :3], body_pose[:3, 3] = rotation[body], position[body]
        poses.append(body_pose @ robot.link_placement[link])
    origins = np.array([pose[:3, 3] for pose in poses])
    points.append(origins)
    low, high = np.vstack(points).min(axis=0), np.vstack(points).max(axis=0)
    size = float((high - low).max())
    frames = _frames(links, poses, _SAME_PLACE * size)
    axis.plot(*origins.T, color=drawing.REFERENCE_COLOR, linewidth=1.2)
    for frame in frames:
        for column, color in enumerate(_AXIS_COLORS):
            end = frame.origin + _AXIS_LENGTH * size * frame.rotation[:, column]
            axis.plot(*np.column_stack([frame.origin, end]), color=color, linewidth=2)
    _frame_picture(axis, low, high, drawing.best_direction(origins, ()))
    figure.canvas.draw()  # places the projection
    _name_frames(figure, axis, frames)
    for number, (name, color) in enumerate(zip("xyz", _AXIS_COLORS, strict=True)):
        figure.text(_LEFT + 0.02 * number, 0.02, name, color=color, fontsize=11)
    return saved(figure, path)


def _draw_links(
    axis: Any,
    robot: RobotModel,
    rotation: FloatArray,
    position: FloatArray,
    solids: Sequence[tuple[int, drawing.Surface, FloatArray]],
) -> FloatArray:
    """Draw all links, and solids by body and colour; return the vertices (N, 3) [m].

    Moving bodies are darker.
    """
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    parts, _ = link_parts(robot, _MAX_FACES)
    drawn = [np.zeros((0, 3))]
    links = [(part.body, part.surface, np.array(part.color)) for part in parts]
    for body, surface, color in [*links, *solids]:
        vertices = surface.vertices @ rotation[body].T + position[body]
        drawn.append(vertices)
        alpha = _ARM_ALPHA if robot.joint_moves_body[body].any() else _REST_ALPHA
        faces = vertices[surface.faces]
        options: dict[str, Any] = {"facecolors": [(*color, alpha)], "shade": True}
        axis.add_collection3d(Poly3DCollection(faces, **options))
    return np.vstack(drawn)


def _chain_links(robot: RobotModel) -> list[str]:
    """Return the links from the root to the tool frame that have a frame of their own.

    Of links that move as one the first is kept, and the tool frame.
    """
    by_child = {joint.child: joint for joint in robot.urdf.joints.values()}
    links = [robot.tool_frame]
    while links[0] in by_child:
        links.insert(0, by_child[links[0]].parent)
    bodies = [robot.link_body[link] for link in links]
    firsts = [link for k, link in enumerate(links) if k == 0 or bodies[k] != bodies[k - 1]]
    return list(dict.fromkeys([*firsts, robot.tool_frame]))


def _frames(links: Sequence[str], poses: Sequence[FloatArray], same: float) -> list[_Frame]:
    """Return frames, with a common label for origins nearer than a distance [m]."""
    groups: list[tuple[list[str], FloatArray]] = []
    for link, pose in zip(links, poses, strict=True):
        near = [g for g in groups if np.linalg.norm(g[1][:3, 3] - pose[:3, 3]) < same]
        if near:
            near[0][0].append(link)
        else:
            groups.append(([link], pose))
    frames = []
    for names, pose in groups:
        label = ", ".join(names)
        if len(label) > _MAX_LABEL:
            label = label[: _MAX_LABEL - 3] + "..."
        frames.append(_Frame(label, pose[:3, :3], pose[:3, 3]))
    return frames


def _frame_picture(axis: Any, low: FloatArray, high: FloatArray, direction: FloatArray) -> None:
    """Show a box in equal scale, from a direction."""
    from matplotlib.ticker import MaxNLocator

    side = np.maximum(high - low, 0.15 * (high - low).max())
    middle = (low + high) / 2
    low, high = middle - side / 2, middle + side / 2
    axis.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axis.set_box_aspect(side, zoom=_ZOOM)
    axis.view_init(
        elev=np.degrees(np.arcsin(direction[2])), azim=np.degrees(np.arctan2(*direction[1::-1]))
    )
    for coordinate, name in zip((axis.xaxis, axis.yaxis, axis.zaxis), "xyz", strict=True):
        coordinate.set_major_locator(MaxNLocator(4))
        coordinate.set_label_text(f"{name} [m]")


def _name_frames(figure: "Figure", axis: Any, frames: Sequence[_Frame]) -> None:
    """Write names into two columns beside the picture, with a line from each name to its frame."""
    from mpl_toolkits.mplot3d.proj3d import proj_transform

    def position_of(frame: _Frame) -> FloatArray:
        x, y, _ = proj_transform(*frame.origin, axis.get_proj())
        pixels = axis.transData.transform((x, y))
        point: FloatArray = figure.transFigure.inverted().transform(pixels)
        return point

    placed = sorted(((position_of(frame), frame) for frame in frames), key=lambda pair: pair[0][0])
    half = len(placed) // 2
    for column, edge, side in ((placed[:half], _LEFT, "left"), (placed[half:], _RIGHT, "right")):
        ordered = sorted(column, key=lambda pair: -pair[0][1])
        heights = _spread_out([float(point[1]) for point, _ in ordered])
        for (point, frame), height in zip(ordered, heights, strict=True):
            axis.annotate(
                frame.label,
                xy=point,
                xytext=(edge, height),
                xycoords="figure fraction",
                textcoords="figure fraction",
                ha=side,
                va="center",
                fontsize=9,
                arrowprops={"arrowstyle": "-", "color": drawing.REFERENCE_COLOR, "linewidth": 0.7},
                bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0},
                annotation_clip=False,
            )


def _spread_out(heights: Sequence[float]) -> list[float]:
    """Return heights near falling heights, but far enough apart for labels."""
    gap = min(0.045, (_TOP - _BOTTOM) / max(1, len(heights)))
    spread: list[float] = []
    for height in heights:
        below = _TOP if not spread else spread[-1] - gap
        spread.append(min(height, below))
    lift = max(0.0, _BOTTOM - spread[-1]) if spread else 0.0
    for k in range(len(spread) - 1, -1, -1):
        target = spread[k] + lift if k == len(spread) - 1 else spread[k + 1] + gap
        spread[k] = max(spread[k], target) if lift else spread[k]
    return spread
