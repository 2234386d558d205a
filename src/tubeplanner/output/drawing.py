"""Colours for colour-blind readers; triangles of shapes, tubes and thick lines; viewpoints."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.geometry.convex_shapes import ConvexShape, convex_hull
from tubeplanner.geometry.tube.regions import BoxRegions
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.task.endpoints import Endpoint

# ---- Colours for colour-blind readers, the same in figures and in the viewer.


class BindingStyle(NamedTuple):
    """Look of a span of time in which a kind of limit binds."""

    color: str  # of the bar
    hatch: str  # pattern of the bar, for grey print
    text: str  # colour of text on the bar


# Okabe & Ito's palette, told apart by colour-blind readers and in print; more lines repeat.
LINE_COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
SEGMENT_COLORS = ("#56B4E9", "#E69F00", "#009E73", "#CC79A7")
OBSTACLE_COLOR = "#777777"
CARRIED_COLOR = "#B58863"
HOLDING_COLOR = "#7A4FA3"
ARM_COLOR, GRIPPER_COLOR = "#AEB8C2", "#6D7C8C"
SWEPT_COLOR = "#7A6FAF"
REFERENCE_COLOR = "#444444"
PROCESS_COLOR, MARK_COLOR = "#8E44AD", "#333333"
EXECUTED_COLOR, WARNING_COLOR = "#0072B2", "#D55E00"
# Motors dark, speeds lighter, position and path in yellow and greys; told apart by hatches too.
BINDING_STYLES = {
    "effort": BindingStyle("#D55E00", "", "white"),
    "motor_curve": BindingStyle("#8C3A00", "....", "white"),
    "effort_rate": BindingStyle("#E69F00", "----", "black"),
    "velocity": BindingStyle("#0072B2", "////", "white"),
    "velocity_by_position": BindingStyle("#56B4E9", "////", "black"),
    "acceleration": BindingStyle("#009E73", "\\\\\\\\", "white"),
    "jerk": BindingStyle("#CC79A7", "xxxx", "black"),
    "tool_speed": BindingStyle("#003F66", "oooo", "white"),
    "least_tool_speed": BindingStyle("#5B3A8C", "oooo", "white"),
    "tool_acceleration": BindingStyle("#00694F", "oooo", "white"),
    "point_speed": BindingStyle("#8FC7EE", "oooo", "black"),
    "holding": BindingStyle(HOLDING_COLOR, "----", "white"),
    "position": BindingStyle("#F0E442", "||||", "black"),
    "tube": BindingStyle("#555555", "", "white"),
    "rotation": BindingStyle("#999999", "....", "black"),
    "obstacles": BindingStyle("#222222", "", "white"),
    "self_collision": BindingStyle("#777777", "xxxx", "white"),
}
OTHER_BINDING = BindingStyle("#BBBBBB", "++++", "black")
CLOSEST_COLOR = "#C1121F"
BLOCKED_COLOR = "#C1121F"
AXIS_COLORS = ("#D1242F", "#2DA44E", "#0969DA")  # x red, y green, z blue, as everywhere
CONE_COLOR = "#E69F00"
START_COLOR, END_COLOR = "#009E73", "#D55E00"  # of the arm at start and at end
# From slow to fast, dark to light, so that grey print keeps the order (viridis).
SPEED_COLORS = (
    *("#440154", "#472D7B", "#3B528B", "#2C728E", "#21918C"),
    *("#28AE80", "#5EC962", "#ADDC30", "#FDE725"),
)


def segment_color(segment: int) -> str:
    """Return the colour of a tube segment."""
    return SEGMENT_COLORS[segment % len(SEGMENT_COLORS)]


def rgb(color: str) -> FloatArray:
    """Return "#RRGGBB" as red, green and blue from 0 to 1, shape (3,)."""
    return np.array([int(color[i : i + 2], 16) for i in (1, 3, 5)]) / 255


def speed_colors(fraction: FloatArray) -> FloatArray:
    """Return colours of fractions (N,) of the highest speed, from 0 to 1: shape (N, 3)."""
    table = np.array([rgb(color) for color in SPEED_COLORS])
    stops = np.linspace(0.0, 1.0, len(table))
    return np.column_stack([np.interp(fraction, stops, table[:, i]) for i in range(3)])


# ---- Surfaces for display: triangles of convex shapes, of the tube, of lines with a thickness.
#
# Nothing is judged by these surfaces: round shapes become polyhedra inside them.

_ROUND_POINTS = 320  # on a whole sphere
_COARSE_POINTS = 48  # at most, of a coarse hull
_PIPE_SIDES = 10
_MAX_TUBE_SIDES, _MIN_TUBE_SIDES = 48, 16
_CAP_RINGS, _STRAIGHT_RINGS = 13, 24


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles."""

    vertices: FloatArray  # shape (V, 3) [m]
    faces: IntArray  # vertex indices, outward, shape (F, 3)

    def moved(self, placement: FloatArray) -> "Surface":
        """Return the surface moved by a homogeneous transform, shape (4, 4)."""
        return Surface(self.vertices @ placement[:3, :3].T + placement[:3, 3], self.faces)


def joined(surfaces: Iterable[Surface]) -> Surface:
    """Return several surfaces joined into a single surface."""
    vertices, faces, count = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.int64)], 0
    for surface in surfaces:
        vertices.append(surface.vertices)
        faces.append(surface.faces + count)
        count += len(surface.vertices)
    return Surface(np.vstack(vertices), np.vstack(faces))


def shape_surface(shape: ConvexShape) -> Surface:
    """Return the surface of a convex shape, its radius included."""
    if shape.radius == 0:
        return Surface(shape.vertices, shape.faces)
    return hull_surface(shape_points(shape))


def shape_points(shape: ConvexShape) -> FloatArray:
    """Return points (N, 3) [m] whose hull is the shape."""
    if shape.radius == 0:
        return shape.vertices
    sphere = shape.radius * directions(_ROUND_POINTS)
    return (shape.vertices[:, None] + sphere).reshape(-1, 3)


def hull_surface(points: FloatArray) -> Surface:
    """Return the hull of points (N, 3)."""
    hull = convex_hull(points)
    return Surface(hull.vertices, hull.faces)


def coarse_hull_points(points: FloatArray) -> FloatArray:
    """Return the points of (N, 3) that are extreme in any of a few directions."""
    if len(points) <= _COARSE_POINTS:
        return points
    return points[np.unique((points @ directions(_COARSE_POINTS).T).argmax(axis=0))]


def directions(count: int) -> FloatArray:
    """Return unit vectors spread evenly over the sphere, shape (count, 3)."""
    z = 1 - (2 * np.arange(count) + 1) / count
    azimuth = np.arange(count) * np.pi * (3 - np.sqrt(5))  # the golden angle
    ring = np.sqrt(1 - z**2)
    return np.column_stack([ring * np.cos(azimuth), ring * np.sin(azimuth), z])


def tube_surfaces(tube: Tube) -> list[Surface]:
    """Return the outside of a tube, a part per segment.

    Of every capsule only the part outside all others is kept, so that the parts make one skin:
    inner walls would show through a translucent skin. None where the tool may be anywhere.
    """
    if tube.is_anywhere:
        return []
    sides = int(np.clip(240 // tube.segment_count, _MIN_TUBE_SIDES, _MAX_TUBE_SIDES))
    parts = []
    for k in range(tube.segment_count):
        radius = tube.effective_radius[k]
        capsule = grid_surface(np.stack(region_grid(tube, k, sides=sides), axis=-1))
        others = np.delete(np.arange(tube.segment_count), k)
        if len(others) == 0:
            return [capsule]
        # Where segments of equal radius meet, both have the same sphere: the first keeps it.
        tie = 1e-6 * radius * np.sign(others - k)
        outside = (tie - tube.margin(capsule.vertices)[:, others]).min(axis=1)
        parts.append(clipped(capsule, outside))
    return parts


def region_grid(
    tube: Tube, k: int, *, sides: int = 24
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return x, y, z grids of the surface of the region about a segment [m]."""
    start, end, regions = tube.points[k], tube.points[k + 1], tube.regions
    if not isinstance(regions, BoxRegions) or not regions.is_box[k]:
        return capsule_grid(start, end, tube.effective_radius[k], sides=sides)
    (across, up, along), (width, height, beyond) = regions.frame[k], regions.half[k]
    corners = [(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)]
    ring = np.array([u * width * across + v * height * up for u, v in corners])
    ends = [start - beyond * along, end + beyond * along]
    rows = [ends[0] + 0 * ring, ends[0] + ring, ends[1] + ring, ends[1] + 0 * ring]
    x, y, z = np.moveaxis(np.stack(rows, axis=1), -1, 0)
    return x, y, z


def capsule_grid(
    start: FloatArray, end: FloatArray, radius: float, *, sides: int = 24
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return x, y, z grids of a capsule's surface [m], each (sides+1, rings)."""
    axis = end - start
    length = float(np.linalg.norm(axis))
    z, x = _axes(axis)
    cap = np.linspace(0, np.pi / 2, _CAP_RINGS)
    straight = np.linspace(0, length, _STRAIGHT_RINGS + 2)[1:-1]
    height = np.concatenate([-radius * np.cos(cap), straight, length + radius * np.cos(cap[::-1])])
    ring = radius * np.concatenate([np.sin(cap), np.ones(len(straight)), np.sin(cap[::-1])])
    azimuth = np.linspace(0, 2 * np.pi, sides + 1)[:, None, None]
    radial = np.cos(azimuth) * x + np.sin(azimuth) * np.cross(z, x)
    points = start + height[:, None] * z + ring[:, None] * radial
    return points[..., 0], points[..., 1], points[..., 2]


def grid_surface(grid: FloatArray) -> Surface:
    """Return the surface through a grid of points, shape (A, B, 3)."""
    index = np.arange(grid.shape[0] * grid.shape[1]).reshape(grid.shape[:2])
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = [np.stack(corners, axis=-1).reshape(-1, 3) for corners in ((a, b, c), (a, c, d))]
    return Surface(grid.reshape(-1, 3), np.vstack(faces))


def clipped(surface: Surface, value: FloatArray) -> Surface:
    """Return the part of a surface where a function with vertex values (V,) is >= 0."""
    inside = value[surface.faces] >= 0
    faces, vertices, count = [surface.faces[inside.all(axis=1)]], [surface.vertices], len(value)
    for corners in (1, 2):
        cut = inside.sum(axis=1) == corners
        lone = (inside[cut] == (corners == 1)).argmax(axis=1)  # the corner alone on its side
        rotation = (lone[:, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(surface.faces[cut], rotation, axis=1).T
        for end in (b, c):
            fraction = value[a] / (value[a] - value[end])
            edge = surface.vertices[end] - surface.vertices[a]
            vertices.append(surface.vertices[a] + fraction[:, None] * edge)
        ab, ac = count + np.arange(len(a)), count + len(a) + np.arange(len(a))
        count += 2 * len(a)
        triangles = [(a, ab, ac)] if corners == 1 else [(ab, b, c), (ab, c, ac)]
        faces += [np.column_stack(triangle) for triangle in triangles]
    used, corners_used = np.unique(np.vstack(faces), return_inverse=True)
    return Surface(np.vstack(vertices)[used], corners_used.reshape(-1, 3))


def pipe(points: FloatArray, radius: float) -> tuple[Surface, IntArray]:
    """Return a line through points (N, 3) as a pipe of a radius [m], since viewers draw lines thin.

    Returns:
        The surface and, of each of its vertices, the index of its point. Points equal to the
        previous point are left out; a line without length has no surface.
    """
    moves = np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-3 * radius
    rows = np.flatnonzero(np.concatenate([[True], moves]))
    if len(rows) < 2:
        return Surface(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)), rows[:0]
    line = points[rows]
    tangent = np.gradient(line, axis=0)
    azimuth = np.linspace(0, 2 * np.pi, _PIPE_SIDES + 1)[:, None]
    side = _axes(tangent[0])[1]
    rings = []
    for point, axis in zip(line, tangent, strict=True):
        z, fallback = _axes(axis)
        side = side - (side @ z) * z  # carried along, so that the rings are not twisted
        norm = float(np.linalg.norm(side))
        side = side / norm if norm > 1e-6 else fallback
        rings.append(
            point + radius * (np.cos(azimuth) * side + np.sin(azimuth) * np.cross(z, side))
        )
    # The ends are closed by rings without width.
    ends = np.tile(line[[0, -1]][:, None], (1, _PIPE_SIDES + 1, 1))
    grid = np.concatenate([ends[:1], np.array(rings), ends[1:]])
    owner = np.concatenate([rows[:1], rows, rows[-1:]])
    return grid_surface(grid[:, ::-1]), np.repeat(owner, _PIPE_SIDES + 1)


def dashes(points: FloatArray, radius: float, period: float) -> Surface:
    """Return a polyline through points (N, 3) as dashes of a radius and period [m]."""
    parts = []
    for start, end in pairwise(points):
        count = max(1, round(float(np.linalg.norm(end - start)) / period))
        for first in (np.arange(count) + 0.2) / count:
            ends = np.array([first, first + 0.6 / count])[:, None]
            parts.append(pipe(start + ends * (end - start), radius)[0])
    return joined(parts)


def _axes(axis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a vector's direction (upwards if zero) and a perpendicular direction, each (3,)."""
    length = float(np.linalg.norm(axis))
    z = axis / length if length > 0 else np.array([0.0, 0.0, 1.0])
    x = np.cross(z, np.eye(3)[int(np.argmin(abs(z)))])
    return z, x / np.linalg.norm(x)


_POINTS = 400  # on the ball of a goal


def goal_ball(end: Endpoint) -> list[Surface]:
    """Return the ball of a goal region, base frame; none without a tolerance."""
    ball = end.region
    if ball is None or ball.tolerance == 0:
        return []
    return [hull_surface(ball.position + ball.tolerance * directions(_POINTS))]


# ---- Directions of sight in which the tool's path is spread out and not hidden; the floor.

_CELLS = 8  # at most, along the longer side of the points above the grid
# Never along an axis of the base: walls and shelves seen edge on are not recognised.
_AZIMUTHS = np.radians([25.0, -25.0, 65.0, -65.0, 115.0, -115.0, 155.0, -155.0])
# Elevation and weight: from higher up an arm's motion is seen less, unless it is planar.
_ELEVATIONS = ((0.35, 1.0), (0.6, 0.95), (1.1, 0.92))
_FLAT = 0.02  # of the longest side


def best_direction(
    path: FloatArray, solids: Sequence[ConvexShape], arms: Sequence[Sequence[ConvexShape]] = ()
) -> FloatArray:
    """Return the unit vector (3,) from a path (N, 3) towards the viewer, never from below.

    Solids in the base frame hide the path half, as they are drawn translucent; hulls of arms at
    successive times hide the path whole.
    """
    standing = _hulls(solids)
    moving = [_hulls(arm) for arm in arms]
    scored, offset = [], path - path.mean(axis=0)
    for elevation, weight in _ELEVATIONS:
        for azimuth in _AZIMUTHS:
            flat = np.cos(elevation)
            direction = np.array(
                [flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)]
            )
            visible = 0.5 + 0.5 * _visible_fraction(path, direction, standing)
            if moving:
                fractions = [_visible_fraction(path, direction, hulls) for hulls in moving]
                visible *= sum(fractions) / len(fractions)
            # The extent of the path as seen: along its main direction plus twice across [m].
            seen = offset - np.outer(offset @ direction, direction)
            major, minor = np.sqrt(abs(np.linalg.eigvalsh(seen.T @ seen))[:0:-1])
            scored.append((weight * visible * float(major + 2 * minor), direction))
    return max(scored, key=lambda pair: pair[0])[1]


def _hulls(shapes: Sequence[ConvexShape]) -> list[ConvexHull]:
    return [ConvexHull(shape_points(shape)) for shape in shapes]


def _visible_fraction(
    path: FloatArray, direction: FloatArray, hulls: Sequence[ConvexHull]
) -> float:
    """Return the fraction of a path's points not behind a hull, in parallel projection."""
    hidden = np.zeros(len(path), dtype=bool)
    for hull in hulls:
        normal, offset = hull.equations[:, :3], hull.equations[:, 3]
        # Along the line of sight p + s direction every face bounds s from one side.
        height, slope = path @ normal.T + offset, normal @ direction
        with np.errstate(divide="ignore", invalid="ignore"):
            s = -height / slope
        first = np.where(slope < 0, s, -np.inf).max(axis=1)
        last = np.where(slope > 0, s, np.inf).min(axis=1)
        beside = ((slope == 0) & (height > 0)).any(axis=1)
        hidden |= (np.maximum(first, 0.0) < last) & ~beside
    return float(1 - hidden.mean())


def outline(points: FloatArray) -> FloatArray:
    """Return the few of points (N, 3) that a picture must contain to contain all."""
    low, high = points.min(axis=0), points.max(axis=0)
    if (high - low).min() < _FLAT * (high - low).max():
        corners = np.meshgrid(*np.column_stack([low, high]))
        return np.stack(corners, axis=-1).reshape(-1, 3)
    return points[ConvexHull(points).vertices]


def floor_grid(points: FloatArray) -> tuple[FloatArray, float]:
    """Return edges (E, 2, 3) [m] of a grid under points (N, 3), at height 0 or lower.

    Also their length: 0.1, 0.5, 1, 5, ... [m].
    """
    size = float(np.ptp(points[:, :2], axis=0).max())
    step = next(s for k in range(-1, 9) for s in (10.0**k, 5 * 10.0**k) if size <= _CELLS * s)
    low = np.floor(points[:, :2].min(axis=0) / step) - 1
    high = np.ceil(points[:, :2].max(axis=0) / step) + 1
    x, y = (np.arange(a, b + 1) for a, b in zip(low, high, strict=True))
    height = np.full((len(y), len(x)), min(0.0, float(points[:, 2].min())))
    nodes = np.stack([*(step * line for line in np.meshgrid(x, y)), height], axis=-1)
    # Edge by edge: lines that pass behind the eye are dropped whole by some renderers.
    rows = np.stack([nodes[:, :-1], nodes[:, 1:]], axis=2).reshape(-1, 2, 3)
    columns = np.stack([nodes[:-1], nodes[1:]], axis=2).reshape(-1, 2, 3)
    return np.vstack([rows, columns]), step
