"""Convex regions about segments, capsules and boxes, and their planes, native and NumPy."""

from collections.abc import Mapping, Sequence
from ctypes import c_double, c_int64
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray, read_only
from tubeplanner.checks import in_figures, is_number
from tubeplanner.errors import ProblemError, shown
from tubeplanner.geometry.tube.points import MIN_LENGTH
from tubeplanner.native.library import Doubles, Integers, native_function

# ---- Points about the axes of convex regions, compiled; None without native library.

_away = native_function(
    *("away_from_axes", c_int64, Doubles, Doubles, Doubles, c_int64, Integers, c_double),
    *(Doubles, Doubles),
)


def away_from_axes(
    p: FloatArray, axes: tuple[FloatArray, FloatArray], segment: IntArray, no_length: float
) -> tuple[FloatArray, FloatArray] | None:
    """Return vectors from the nearest points of axes to points, (..., R, 3), and their lengths.

    Args:
        p: The points, shape (..., R, 3) or, for all R, (..., 1, 3) [m].
        axes: Begins and ends of the axes, both of shape (m, 3) [m].
        segment: Index of the axis, shape (R,).
        no_length: Shorter axes count as points [m].
    """
    if _away is None:
        return None
    rows = len(segment)
    if rows not in (1, p.shape[-2]):  # one point for all of them
        p = np.broadcast_to(p, (*p.shape[:-2], rows, 3))
    points = np.ascontiguousarray(p, dtype=np.float64)
    away, distance = np.empty(p.shape), np.empty(p.shape[:-1])
    ends = (np.ascontiguousarray(end) for end in axes)
    of_rows = (rows, np.ascontiguousarray(segment), no_length**2)
    _away(distance.size, points, *ends, *of_rows, away, distance)
    return away, distance


# ---- The convex regions about a tube's segments, and the planes about them.
#
# A region reaches beyond the axis of its segment, from A to B, by some extent e along every unit
# normal n: it lies behind the plane n.p = max(n.A, n.B) + e(n).

_NO_LENGTH = 1e-9  # [m or rad]


class SegmentRegions(Protocol):
    """The regions of m segments."""

    @property
    def begin(self) -> FloatArray:
        """Begins of the axes, shape (m, 3) [m or rad]."""

    @property
    def end(self) -> FloatArray:
        """Ends of the axes, shape (m, 3)."""

    @property
    def radius(self) -> FloatArray:
        """Of the largest capsules about the axes that are inside, shape (m,) [m or rad]."""

    def margin(self, p: FloatArray, segment: IntArray) -> FloatArray:
        """Return the margins of points inside regions [m or rad], a concave function of the point.

        Args:
            p: Shape (..., R, 3).
            segment: Index of the region, shape (R,).

        Returns:
            Shape (..., R); negative outside. The margin changes by no more than the point moves.
        """

    def fraction(self, p: FloatArray, segment: IntArray) -> FloatArray:
        """Return the used fraction of points (R, 3): 0 on the axis, 1 on the wall, shape (R,)."""

    def outward(self, p: FloatArray, segment: IntArray) -> FloatArray:
        """Return unit normals where the fraction grows fastest, (R, 3); zero on the axis."""

    def deviation(self, p: FloatArray, segment: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return vectors from the nearest points of axes to points, and their derivatives.

        In tolerances: lengths are 1 on the walls. Derivatives by the points are one-sided at the
        ends of axes.

        Args:
            p: Shape (R, 3).
            segment: Index of the region, shape (R,).

        Returns:
            Shapes (R, 3) and (R, 3, 3).
        """

    def nearest(self, p: FloatArray, segment: IntArray) -> FloatArray:
        """Return the points of regions nearest to points (R, 3), shape (R, 3)."""

    def faces(self, segment: IntArray) -> Sequence[FloatArray]:
        """Return normals of faces that do not depend on the point, each (R, 3); zero: none."""

    def extent(self, normal: FloatArray, segment: IntArray) -> FloatArray:
        """Return the extent of regions beyond their axes along unit normals (R, 3), shape (R,)."""

    def kinds(self, segment: int) -> tuple[str, ...]:
        """Return the names of the tolerances that a region has."""

    def kind(self, normal: FloatArray, segment: IntArray) -> IntArray:
        """Return the index in `kinds` of the tolerance along normals (R, 3), shape (R,)."""


@dataclass(frozen=True, eq=False)
class Capsules:
    """Capsules, the points within a radius of the axis; `SegmentRegions`."""

    begin: FloatArray  # begins of the axes, shape (m, 3) [m or rad]
    end: FloatArray  # ends of the axes, shape (m, 3)
    radius: FloatArray  # shape (m,) [m or rad]; may be infinite

    def margin(self, p: FloatArray, segment: IntArray) -> FloatArray:
        """Return the margins of points inside the capsules."""
        margin: FloatArray = self.radius[segment] - self._away(p, segment)[1]
        return margin

    def fraction(self, p: FloatArray, segment: IntArray) -> FloatArray:
        """Return distances from the axes in radii."""
        fraction: FloatArray = self._away(p, segment)[1] / self.radius[segment]
        return fraction

    def outward(self, p: FloatArray, segment: IntArray) -> FloatArray:
        """Return the directions away from the axes."""
        away, distance = self._away(p, segment)
        distance = distance[..., None]
        return np.divide(away, distance, out=np.zeros_like(away), where=distance > _NO_LENGTH)

    def deviation(self, p: FloatArray, segment: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return vectors from the axes in radii."""
        away, _ = self._away(p, segment)
        direction = self._direction[segment]
        # Beside an axis, no part of the vector is along it.
        is_beside = abs(np.einsum("ri,ri->r", away, direction)) <= _NO_LENGTH
        along = np.where(is_beside[:, None], direction, 0.0)
        across = np.eye(3) - along[:, :, None] * along[:, None, :]
        radius = self.radius[segment, None]
        return away / radius, across / radius[..., None]

    def nearest(self, p: FloatArray, segment: IntArray) -> FloatArray:
        """Return the nearest points of the capsules."""
        outside = np.maximum(-self.margin(p, segment), 0.0)[:, None]
        nearest: FloatArray = p - outside * self.outward(p, segment)
        return nearest

    def faces(self, segment: IntArray) -> Sequence[FloatArray]:
        """Return the normals at both caps: the axes' directions; zero for balls."""
        return self._direction[segment], -self._direction[segment]

    def extent(self, normal: FloatArray, segment: IntArray) -> FloatArray:
        """Return the radii."""
        return self.radius[segment]

    def kinds(self, segment: int) -> tuple[str, ...]:
        """Return the radius as the only tolerance."""
        return ("radius",)

    def kind(self, normal: FloatArray, segment: IntArray) -> IntArray:
        """Return the radius' index, 0."""
        return np.zeros(len(segment), dtype=np.int64)

    @cached_property
    def _direction(self) -> FloatArray:
        axis = self.end - self.begin
        length = np.linalg.norm(axis, axis=1, keepdims=True)
        return np.divide(axis, length, out=np.zeros_like(axis), where=length > _NO_LENGTH)

    def _away(self, p: FloatArray, segment: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return vectors from the nearest points of axes to points (..., R, 3), and lengths."""
        native = away_from_axes(p, (self.begin, self.end), segment, _NO_LENGTH)
        if native is not None:
            return native
        begin = self.begin[segment]
        axis = self.end[segment] - begin
        square = np.maximum(np.einsum("ri,ri->r", axis, axis), _NO_LENGTH**2)
        fraction = np.clip(np.einsum("...ri,ri->...r", p - begin, axis) / square, 0.0, 1.0)
        away = p - (begin + fraction[..., None] * axis)
        return away, np.linalg.norm(away, axis=-1)


# ---- Segments with a rectangle for a cross-section: their sizes, and the boxes about them.
#
# A box is the rectangle swept along its segment and, beyond both ends, as far as the smaller half
# of its sides. It has six faces: across, along the user's upward direction, and at both ends.

_PARALLEL = 1e-6  # sine of the least angle between a segment and its upward direction
_SMALLEST, _LARGEST = 2 * MIN_LENGTH, 1e4  # sides [m]
_SAME = 1e-12  # accepted difference of a radius from half the smaller side [m], of a length from 1
_KINDS = ("width", "height")
_KEYS = {"box", "up"}


def box_sections(value: Any, axis: FloatArray) -> FloatArray | None:
    """Return the sizes of boxes, by segment: width and height [m], and the upward unit vector.

    Args:
        value: {"box": [w, h], "up": [x, y, z]} for all segments, or one each, None for a disc.
        axis: From the begin of every segment to its end, shape (m, 3) [m].

    Returns:
        Shape (m, 5), zero where a segment has a disc; None if all have.

    Raises:
        ProblemError: A count, a key or a number is wrong, or up is parallel to the segment.
    """
    if value is None or (isinstance(value, np.ndarray) and not value.any()):
        return None
    is_one = isinstance(value, Mapping)
    entries = [value] * len(axis) if is_one else value
    if not isinstance(entries, Sequence | np.ndarray) or len(entries) != len(axis):
        raise ProblemError(
            f"tube.cross_section is {shown(value)}; give one map with box and up, or {len(axis)}, "
            "one for each segment, null for a disc"
        )
    rows = np.zeros((len(axis), 5))
    for k, entry in enumerate(entries):
        is_disc = entry is None or (isinstance(entry, np.ndarray) and not entry.any())
        if not is_disc:
            rows[k] = _section(f"tube.cross_section[{k}]", entry, axis[k])
    return read_only(rows) if rows.any() else None


def radii_of_boxes(radius: Any, sections: FloatArray | None) -> Any:
    """Return radii completed by the halves of the boxes' smaller sides.

    Args:
        radius: A number for the discs, or m, None or the right number where there is a box; None if
            there are boxes alone.
        sections: From `box_sections`.

    Raises:
        ProblemError: A segment has both a box and another radius, or neither.
    """
    if sections is None:
        return radius
    halves = sections[:, :2].min(axis=1) / 2
    if radius is None or is_number(radius):
        if radius is not None and (halves > 0).all():
            raise ProblemError(
                f"tube.radius is {radius:g} m, but every segment has a box (tube.cross_section); "
                "leave the radius out"
            )
        radius = np.where(halves > 0, None, radius)
    is_list = isinstance(radius, list | tuple) or (
        isinstance(radius, np.ndarray) and radius.ndim == 1
    )
    if not is_list or len(radius) != len(halves):
        return radius  # refused by `given_radii`
    return [_radius(k, radius[k], sections[k]) for k in range(len(halves))]


def _radius(k: int, radius: Any, section: FloatArray) -> Any:
    """Return the radius of a segment: half of the smaller side of its box, if any."""
    width, height = section[:2]
    half = min(width, height) / 2
    if half == 0 and radius is None:
        raise ProblemError(
            f"tube.radius[{k}] is missing: segment {k} has no box (tube.cross_section); give one"
        )
    if radius is None:
        return half
    if half == 0:
        return radius
    if not is_number(radius) or not abs(radius - half) <= _SAME:
        raise ProblemError(
            f"tube.radius[{k}] is {in_figures(radius)} m, but segment {k} has a box of "
            f"{width:g} by {height:g} m (tube.cross_section): its radius is half of its smaller "
            "side; leave the radius null, or remove the box"
        )
    return half


def _section(where: str, entry: Any, axis: FloatArray) -> list[float]:
    """Return width, height and upward unit vector of a segment."""
    if isinstance(entry, np.ndarray) and entry.shape == (5,):  # as `box_sections` returns it
        box, up = entry[:2], entry[2:]
    else:
        if not isinstance(entry, Mapping) or set(entry) != _KEYS:
            raise ProblemError(f"{where} is {shown(entry)}; give box: [w, h] and up: [x, y, z]")
        box, up = entry["box"], entry["up"]
    sides = _numbers(f"{where}.box", box, 2, "[w, h] [m]")
    if not ((sides >= _SMALLEST) & (sides <= _LARGEST)).all():
        raise ProblemError(
            f"{where}.box is {sides.tolist()}; sides are from {_SMALLEST:g} to {_LARGEST:g} m"
        )
    upward = _numbers(f"{where}.up", up, 3, "[x, y, z]")
    length, distance = float(np.linalg.norm(upward)), float(np.linalg.norm(axis))
    # A segment of no length, which is left out later, has no direction.
    along = axis / distance if distance >= MIN_LENGTH else np.zeros(3)
    beside = upward - (upward @ along) * along
    if not np.linalg.norm(beside) > _PARALLEL * length:
        raise ProblemError(
            f"{where}.up is {upward.tolist()}, parallel to its segment; give a direction across it"
        )
    if abs(length - 1) > _SAME:  # what is a unit vector stays the same, to the last digit
        upward = upward / length
    return [*sides.tolist(), *upward.tolist()]


def _numbers(where: str, values: Any, count: int, shape: str) -> FloatArray:
    is_list = isinstance(values, Sequence | np.ndarray) and len(values) == count
    if not is_list or not all(is_number(value) and abs(value) < np.inf for value in values):
        raise ProblemError(f"{where} is {shown(values)}; give {shape}, finite numbers")
    return np.array(values, dtype=float)


@dataclass(frozen=True, eq=False)
class BoxRegions(Capsules):
    """Boxes about some segments, capsules about the others; `SegmentRegions`."""

    sections: FloatArray  # from `box_sections`, shape (m, 5)
    tool_radius: float  # subtracted from every half side [m]

    @cached_property
    def is_box(self) -> BoolArray:
        """True for segments with a box, shape (m,)."""
        is_box: BoolArray = self.sections[:, 0] > 0
        return is_box

    @cached_property
    def frame(self) -> FloatArray:
        """Unit vectors across, upward and along each segment, shape (m, 3, 3), row by row."""
        along = self._direction
        up = (
            self.sections[:, 2:]
            - np.einsum("mi,mi->m", self.sections[:, 2:], along)[:, None] * along
        )
        up /= np.maximum(np.linalg.norm(up, axis=1, keepdims=True), np.finfo(float).tiny)
        return np.stack([np.cross(up, along), up, along], axis=1)

    @cached_property
    def half(self) -> FloatArray:
        """Half sides across and upward, and the reach beyond the ends, shape (m, 3) [m]."""
        sides = self.sections[:, :2] / 2 - self.tool_radius
        own = np.where(self.is_box, sides.min(axis=1), 1.0)
        half = np.column_stack([sides, own]) * (self.radius / own)[:, None]
        return np.where(self.is_box[:, None], half, 1.0)

    def margin(self, p: FloatArray, segment: IntArray) -> FloatArray:
        """Return the margins of points inside the nearest face, or else the capsule."""
        inside = (self.half[segment] - self._beyond(p, segment)).min(axis=-1)
        return np.where(self.is_box[segment], inside, super().margin(p, segment))

    def fraction(self, p: FloatArray, segment: IntArray) -> FloatArray:
        """Return the largest used fraction of a half side, or else of the radius."""
        fraction = (self._beyond(p, segment) / self.half[segment]).max(axis=-1)
        return np.where(self.is_box[segment], fraction, super().fraction(p, segment))

    def outward(self, p: FloatArray, segment: IntArray) -> FloatArray:
        """Return the normal of the face that a point is nearest to, or else away from the axis."""
        fraction = self._beyond(p, segment) / self.half[segment]
        face = fraction.argmax(axis=-1)
        normal = self.frame[segment, face]
        # A point whose largest fraction is an end's is beyond that end, on its own side.
        side = np.sign(np.einsum("ri,ri->r", normal, p - self.begin[segment]))
        normal = np.where((fraction.max(axis=-1) > 0)[:, None], side[:, None] * normal, 0.0)
        return np.where(self.is_box[segment, None], normal, super().outward(p, segment))

    def deviation(self, p: FloatArray, segment: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return vectors from the axes in half sides, in the boxes' frames, or else in radii."""
        begin, frame = self.begin[segment], self.frame[segment]
        local = np.einsum("rai,ri->ra", frame, p - begin)
        length = np.linalg.norm(self.end[segment] - begin, axis=1)
        local[:, 2] -= np.clip(local[:, 2], 0.0, length)
        by_p = frame / self.half[segment][..., None]
        by_p[local[:, 2] == 0, 2] = 0.0
        vector, derivative = super().deviation(p, segment)
        is_box = self.is_box[segment, None]
        own = np.where(is_box, local / self.half[segment], vector)
        return own, np.where(is_box[..., None], by_p, derivative)

    def nearest(self, p: FloatArray, segment: IntArray) -> FloatArray:
        """Return the nearest points of the boxes, or else of the capsules."""
        begin, frame = self.begin[segment], self.frame[segment]
        local = np.einsum("rai,ri->ra", frame, p - begin)
        low, high = -self.half[segment], self.half[segment].copy()
        high[:, 2] += np.linalg.norm(self.end[segment] - begin, axis=1)
        inside = begin + np.einsum("rai,ra->ri", frame, np.clip(local, low, high))
        return np.where(self.is_box[segment, None], inside, super().nearest(p, segment))

    def faces(self, segment: IntArray) -> Sequence[FloatArray]:
        """Return the normals at both ends and of the other four faces."""
        sides = np.where(self.is_box[segment, None, None], self.frame[segment, :2], 0.0)
        across, up = sides[:, 0], sides[:, 1]
        return (*super().faces(segment), across, -across, up, -up)

    def extent(self, normal: FloatArray, segment: IntArray) -> FloatArray:
        """Return the extents of boxes along normals, or else the radii."""
        extent = self._parts(normal, segment).sum(axis=1)
        return np.where(self.is_box[segment], extent, super().extent(normal, segment))

    def kinds(self, segment: int) -> tuple[str, ...]:
        """Return width and height, or else the radius."""
        return _KINDS if self.is_box[segment] else super().kinds(segment)

    def kind(self, normal: FloatArray, segment: IntArray) -> IntArray:
        """Return the index of the width (0) or the height (1); 0 for a radius."""
        parts = self._parts(normal, segment)
        # The reach beyond the ends follows the smaller side.
        parts[np.arange(len(parts)), self.half[segment, :2].argmin(axis=1)] += parts[:, 2]
        is_height: IntArray = (self.is_box[segment] & (parts[:, 1] > parts[:, 0])).astype(np.int64)
        return is_height

    def _parts(self, normal: FloatArray, segment: IntArray) -> FloatArray:
        """Return the part of each half side in the extent along normals (R, 3), shape (R, 3)."""
        return abs(np.einsum("rai,ri->ra", self.frame[segment], normal)) * self.half[segment]

    def _beyond(self, p: FloatArray, segment: IntArray) -> FloatArray:
        """Return the distances of points from the axis across and upward, and beyond its ends."""
        begin, axis = self.begin[segment], self.end[segment] - self.begin[segment]
        local = np.einsum("rai,...ri->...ra", self.frame[segment], p - begin)
        length = np.linalg.norm(axis, axis=-1)
        ahead = np.maximum(-local[..., 2], local[..., 2] - length)
        return np.concatenate([abs(local[..., :2]), ahead[..., None]], axis=-1)
