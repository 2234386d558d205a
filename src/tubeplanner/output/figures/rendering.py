"""Depth-buffered picture of solids in parallel projection."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.output.drawing import Surface

_UPRIGHT = 0.999  # of a direction's height: from above, x points right and y up


@dataclass(frozen=True, eq=False)
class SpaceView:
    """A view along a direction, in parallel projection."""

    direction: FloatArray  # from the scene towards the viewer, unit vector (3,)

    @property
    def is_from_above(self) -> bool:
        """True if the page is the plane of x and y."""
        return bool(self.direction[2] > _UPRIGHT)

    @property
    def axes(self) -> FloatArray:
        """Unit vectors to the right and upwards on the page, shape (2, 3)."""
        if self.is_from_above:
            return np.eye(3)[:2]
        right = np.cross([0.0, 0.0, 1.0], self.direction)
        right /= np.linalg.norm(right)
        return np.array([right, np.cross(self.direction, right)])

    def on_page(self, points: FloatArray) -> FloatArray:
        """Return the positions of points (..., 3) on the page, shape (..., 2) [m]."""
        page: FloatArray = points @ self.axes.T
        return page

    def nearness(self, points: FloatArray) -> FloatArray:
        """Return the coordinates of points (..., 3) towards the viewer, shape (...) [m]."""
        near: FloatArray = points @ self.direction
        return near


# ---- Solids rendered to a picture, pixel by pixel, so that nearer solids hide farther ones.
#
# Of opaque solids every pixel shows the nearest. Of translucent solids it shows the sides towards
# the viewer, each laid over the pixel by its alpha.

_PIXELS = 1100  # of the longer side
_LIGHT = np.array([0.35, -0.25, 0.9]) / np.linalg.norm([0.35, -0.25, 0.9])
_SHADE = 0.45  # darkening of faces parallel to the light
_SHARP = 0.9  # cosine of the angle between faces from which on they meet in an edge
_EDGE_WIDTH, _EDGE_LIFT = 2.4, 5.0  # of edges, and how much nearer than their faces [pixels]
_EDGE_SHADE, _EDGE_ALPHA = 0.55, 0.75
_NO_AREA = 1e-9  # [pixels^2]
_TIE = 1e-3  # [pixels]
_DIGITS = 9  # of a corner's coordinates [m]
_AT_ONCE = 2_000_000  # pixels of triangles, so that memory suffices

# Pixels of triangles: indices (P,), nearness (P,), and colours (P, 4).
_Fragments: TypeAlias = tuple[IntArray, FloatArray, FloatArray]


@dataclass(frozen=True, eq=False)
class RenderedSolid:
    """A surface and its look."""

    surface: Surface  # base frame
    color: FloatArray  # red, green, blue from 0 to 1, shape (3,)
    alpha: float = 1.0  # 1 if opaque; below that, faces must be outward
    has_edges: bool = False  # True to draw its edges


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture of solids."""

    # red, green, blue and alpha from 0 to 1, from the bottom up, shape (H, W, 4)
    pixels: FloatArray
    low: FloatArray  # lower left corner on the page, shape (2,) [m]
    high: FloatArray  # upper right corner on the page, shape (2,) [m]


@dataclass(frozen=True, eq=False)
class _Triangles:
    """Triangles in pixels."""

    corners: FloatArray  # the third coordinate towards the viewer, shape (F, 3, 3)
    colors: FloatArray  # red, green, blue and alpha, shape (F, 4)


def rendered(solids: Sequence[RenderedSolid], view: SpaceView) -> Picture:
    """Return the picture of solids from far away."""
    page = view.on_page(np.vstack([solid.surface.vertices for solid in solids]))
    low, high = page.min(axis=0), page.max(axis=0)
    pixel = float((high - low).max()) / (_PIXELS - 2 * _EDGE_WIDTH)
    low, high = low - _EDGE_WIDTH * pixel, high + _EDGE_WIDTH * pixel
    width, height = np.ceil((high - low) / pixel).astype(int).tolist()
    opaque: list[_Triangles] = []
    through: list[_Triangles] = []
    for solid in solids:
        (opaque if solid.alpha == 1 else through).append(_faces(solid, view, low, pixel))
        if solid.has_edges:
            through.append(_edges(solid, view, low, pixel))
    nearest = np.full(width * height, -np.inf)
    pixels = np.zeros((width * height, 4))
    for number, part in enumerate(opaque):
        for index, near, color in _fragments(part, width, height):
            # Of faces in one plane the last wins throughout, instead of a mixture by rounding.
            near = near + _TIE * number
            np.maximum.at(nearest, index, near)
            is_seen = near >= nearest[index]
            pixels[index[is_seen]] = color[is_seen]
    visible = []
    for part in through:
        # The nearest fragment of every pixel: pixels where triangles meet are in both.
        fragments = _fragments(part, width, height)
        index = np.concatenate([np.zeros(0, dtype=np.int64), *(each[0] for each in fragments)])
        near = np.concatenate([np.zeros(0), *(each[1] for each in fragments)])
        color = np.vstack([np.zeros((0, 4)), *(each[2] for each in fragments)])
        order = np.lexsort([near, index])
        last = order[np.flatnonzero(np.diff(index[order], append=-1))]
        index, near, color = index[last], near[last], color[last]
        is_seen = near > nearest[index]
        visible.append((index[is_seen], near[is_seen], color[is_seen]))
    if visible:
        index, near, color = (np.concatenate(rows) for rows in zip(*visible, strict=True))
        _lay_over(pixels, index, near, color)
    return Picture(pixels.reshape(height, width, 4), low, low + pixel * np.array([width, height]))


def _faces(solid: RenderedSolid, view: SpaceView, low: FloatArray, pixel: float) -> _Triangles:
    """Return the lit faces of a solid; of a translucent solid the faces towards the viewer."""
    corners = solid.surface.vertices[solid.surface.faces]
    normal = _normals(corners)
    if solid.alpha < 1:
        towards = normal @ view.direction > 0
        corners, normal = corners[towards], normal[towards]
    shade = (1 - _SHADE) + _SHADE * abs(normal @ _LIGHT)
    colors = np.column_stack([shade[:, None] * solid.color, np.full(len(shade), solid.alpha)])
    return _Triangles(_in_pixels(corners, view, low, pixel), colors)


def _edges(solid: RenderedSolid, view: SpaceView, low: FloatArray, pixel: float) -> _Triangles:
    """Return the visible sharp edges of a solid, as thin triangles."""
    # A cut surface has a corner per triangle instead of one corner in common.
    points, own = np.unique(solid.surface.vertices.round(_DIGITS), axis=0, return_inverse=True)
    faces = own.reshape(-1)[solid.surface.faces]
    normal = _normals(points[faces])
    sides = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
    unique, side, count = np.unique(np.sort(sides), axis=0, return_inverse=True, return_counts=True)
    face = np.repeat(np.arange(len(faces)), 3)[np.argsort(side.ravel(), kind="stable")]
    first = np.cumsum(count) - count
    both = count == 2
    one, other = face[first[both]], face[first[both] + 1]
    facing = normal @ view.direction > 0
    is_seen = facing[one] | facing[other]
    sharp = np.einsum("ei,ei->e", normal[one], normal[other]) < _SHARP
    ends = points[unique[both][sharp & is_seen]]
    corners = _strips(_in_pixels(ends, view, low, pixel))
    color = np.append(_EDGE_SHADE * solid.color, _EDGE_ALPHA)
    return _Triangles(corners, np.tile(color, (len(corners), 1)))


def _strips(ends: FloatArray) -> FloatArray:
    """Return lines from end to end, (E, 2, 3) in pixels, as triangles (2 E, 3, 3)."""
    along = (ends[:, 1] - ends[:, 0])[:, :2]
    length = np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    side = np.zeros((len(ends), 3))
    side[:, :2] = _EDGE_WIDTH / 2 * np.column_stack([-along[:, 1], along[:, 0]]) / length
    start, end = ends.transpose(1, 0, 2) + np.array([0.0, 0.0, _EDGE_LIFT])
    quads = [start - side, end - side, end + side, start + side]
    return np.vstack(
        [np.stack([quads[k] for k in turn], axis=1) for turn in ((0, 1, 2), (0, 2, 3))]
    )


def _in_pixels(points: FloatArray, view: SpaceView, low: FloatArray, pixel: float) -> FloatArray:
    """Return positions in the picture and nearness of points (..., 3), shape (..., 3) [pixels]."""
    page, near = (view.on_page(points) - low) / pixel, view.nearness(points) / pixel
    result: FloatArray = np.concatenate([page, near[..., None]], axis=-1)
    return result


def _fragments(triangles: _Triangles, width: int, height: int) -> list[_Fragments]:
    """Return the pixels inside triangles: indices, nearness and colours, part by part."""
    corners = triangles.corners
    if len(corners) == 0:
        return []
    # Pixel centres are at half-integers.
    first = np.ceil(corners[:, :, :2].min(axis=1) - 0.5).astype(int)
    last = np.floor(corners[:, :, :2].max(axis=1) - 0.5).astype(int)
    first, last = np.maximum(first, 0), np.minimum(last, [width - 1, height - 1])
    size = np.maximum(last - first + 1, 0)
    count = size.prod(axis=1)
    part, planes = np.cumsum(count) // _AT_ONCE, _planes(corners)
    fragments = []
    for rows in np.split(np.arange(len(corners)), np.flatnonzero(np.diff(part)) + 1):
        owner = np.repeat(rows, count[rows])
        begin = np.cumsum(count[rows]) - count[rows]
        within = np.arange(len(owner)) - np.repeat(begin, count[rows])
        y, x = np.divmod(within, size[owner, 0])
        x, y = x + first[owner, 0], y + first[owner, 1]
        slopes = planes[owner]
        value = slopes[:, :, 0] * x[:, None] + slopes[:, :, 1] * y[:, None] + slopes[:, :, 2]
        inside = (value[:, :2] >= 0).all(axis=1) & (value[:, 0] + value[:, 1] <= 1)
        index = (y * width + x)[inside]
        fragments.append((index, value[inside, 2], triangles.colors[owner[inside]]))
    return fragments


def _planes(corners: FloatArray) -> FloatArray:
    """Return linear functions over triangles (F, 3, 3): slopes by x and by y, and offset.

    Two barycentric coordinates, then the nearness: shape (F, 3, 3). The offset is the value at the
    centre of the first pixel. Triangles seen edge on have the constant -1 throughout.
    """
    a, b, c = corners.transpose(1, 0, 2)
    u, v = b - a, c - a
    area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    sound = abs(area) > _NO_AREA
    by = np.zeros((len(corners), 3, 3))
    by[:, 0, :2] = np.column_stack([v[:, 1], -v[:, 0]])
    by[:, 1, :2] = np.column_stack([-u[:, 1], u[:, 0]])
    by[sound, :2] /= area[sound, None, None]
    by[:, 2] = by[:, 0] * u[:, 2:] + by[:, 1] * v[:, 2:]
    by[:, :, 2] = -np.einsum("fki,fi->fk", by[:, :, :2], a[:, :2] - 0.5)
    by[:, 2, 2] += a[:, 2]
    by[~sound] = np.array([0.0, 0.0, -1.0])
    return by


def _lay_over(pixels: FloatArray, index: IntArray, near: FloatArray, color: FloatArray) -> None:
    """Lay translucent fragments (P,) over pixels, from far to near."""
    order = np.lexsort([near, index])
    index, color = index[order], color[order]
    begin = np.flatnonzero(np.diff(index, prepend=-1))
    rank = np.arange(len(index)) - np.repeat(begin, np.diff(np.append(begin, len(index))))
    for layer in range(int(rank.max(initial=-1)) + 1):
        now = rank == layer
        own, over = pixels[index[now]], color[now]
        alpha = over[:, 3:] + own[:, 3:] * (1 - over[:, 3:])
        mixed = over[:, :3] * over[:, 3:] + own[:, :3] * own[:, 3:] * (1 - over[:, 3:])
        pixels[index[now]] = np.hstack([mixed / alpha, alpha])


def _normals(corners: FloatArray) -> FloatArray:
    """Return the unit normals of triangles (F, 3, 3), shape (F, 3); zero without area."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    return normal / np.maximum(length, np.finfo(float).tiny)
