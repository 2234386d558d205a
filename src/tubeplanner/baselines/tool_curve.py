"""Curves that the tool follows along a polyline: its lines, and arcs in place of its corners."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.optimize import brentq

from tubeplanner.arrays import FloatArray
from tubeplanner.polyline import arc_lengths

_STRAIGHT, _BACK = 1e-6, 1e-3  # [rad]: smaller turns need no arc, turns nearer to pi allow none
_MIN_LENGTH = 1e-9  # [m]
# Arcs stay away from the wall by this share of the radius: the arm follows them only closely.
_KEPT_SHARE = 1e-3


@dataclass(frozen=True, eq=False)
class ToolCurve:
    """Lines and arcs one after the other, with the same direction where they meet: P pieces.

    Attributes:
        start: Where each piece starts, shape (P, 3) [m].
        direction: Of the tool there, unit vectors, shape (P, 3).
        normal: Towards the centre of an arc, unit vectors, shape (P, 3); anything for a line.
        curvature: Shape (P,) [1/m], 0 for a line.
        arc_lengths: Length of the curve up to the ends of its pieces, shape (P+1,), from 0 [m].
        polyline_arc_lengths: Length of the polyline up to the same places, shape (P+1,) [m].
    """

    start: FloatArray
    direction: FloatArray
    normal: FloatArray
    curvature: FloatArray
    arc_lengths: FloatArray
    polyline_arc_lengths: FloatArray

    @property
    def length(self) -> float:
        """Length [m]."""
        return float(self.arc_lengths[-1])

    def point(self, arc_length: FloatArray) -> FloatArray:
        """Return the points (N, 3) [m] at arc lengths (N,) from 0 to the length."""
        piece = np.clip(
            np.searchsorted(self.arc_lengths, arc_length, "right") - 1, 0, len(self.start) - 1
        )
        local = (arc_length - self.arc_lengths[piece])[:, None]
        half = self.curvature[piece, None] * local / (2 * np.pi)
        forward = local * np.sinc(2 * half)  # sin(c s) / c
        sideways = np.pi * half * local * np.sinc(half) ** 2  # (1 - cos(c s)) / c
        return self.start[piece] + forward * self.direction[piece] + sideways * self.normal[piece]


def rounded_polyline(points: FloatArray, radius: FloatArray | None) -> list[ToolCurve]:
    """Return a polyline whose corners are cut by arcs, as curves between stops.

    Args:
        points: Shape (m+1, 3) [m], neighbours apart.
        radius: How far an arc may be from the lines it joins, shape (m,) [m]; None: no arcs, the
            tool stops at every point.

    Returns:
        One curve from stop to stop. It stops where no arc is possible: where a line doubles back.
    """
    lines = np.diff(points, axis=0)
    length = np.linalg.norm(lines, axis=1)
    direction = lines / length[:, None]
    count = len(lines)
    turn = np.array([_angle(a, b) for a, b in pairwise(direction)])
    cut = np.zeros(count + 1)  # how much of both lines each corner's arc takes
    if radius is not None:
        for k in range(1, count):
            if _STRAIGHT < turn[k - 1] < np.pi - _BACK:
                available = min(length[k - 1] / (1 + (k > 1)), length[k] / (1 + (k + 1 < count)))
                bends = _arc_radius((1 - _KEPT_SHARE) * radius[k - 1 : k + 1], turn[k - 1])
                cut[k] = min(bends * np.tan(turn[k - 1] / 2), available)
    passed = (cut[1:-1] > 0) | (turn <= _STRAIGHT) & (radius is not None)
    stops = [0, *(np.flatnonzero(~passed) + 1).tolist(), count]
    before = arc_lengths(points)
    return [_between_stops(points, before, cut, a, b) for a, b in pairwise(stops)]


def _angle(a: FloatArray, b: FloatArray) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


def _arc_radius(allowed: FloatArray, turn: float) -> float:
    """Return the largest radius of an arc that stays near its two lines.

    Where an arc has turned by p, it is some multiple of its radius away from the line that it
    leaves, and the same multiple at turn - p from the line that it joins. At the best place to
    count it to the other line, both are at their bounds.
    """
    corner = 1 / np.cos(turn / 2)  # radii from the centre to where the lines meet

    def away(p: float) -> float:
        if np.sin(p) <= np.tan(turn / 2):
            return float(1 - np.cos(p))
        return float(np.sqrt(1 + corner**2 - 2 * corner * np.cos(p - turn / 2)))  # past its end

    change = brentq(lambda p: allowed[0] * away(turn - p) - allowed[1] * away(p), 0.0, turn)
    return float(allowed[0] / away(change))


def _between_stops(
    points: FloatArray, before: FloatArray, cut: FloatArray, first: int, last: int
) -> ToolCurve:
    """Return the curve from one point of a polyline to another."""
    rows: list[tuple[FloatArray, FloatArray, FloatArray, float, float, float]] = []
    for k in range(first, last):
        line = points[k + 1] - points[k]
        length = float(np.linalg.norm(line))
        direction = line / length
        taken, left = (cut[k] if k > first else 0.0), (cut[k + 1] if k + 1 < last else 0.0)
        straight = length - taken - left
        if straight > _MIN_LENGTH:
            rows.append(
                (points[k] + taken * direction, direction, direction, 0.0, straight, straight)
            )
        if left > 0:
            rows.append(
                _arc(points[k + 1] - left * direction, direction, points[k + 1 : k + 3], left)
            )
    starts, directions, normals, curvatures, lengths, shares = zip(*rows, strict=True)
    return ToolCurve(
        np.array(starts),
        np.array(directions),
        np.array(normals),
        np.array(curvatures),
        np.concatenate([[0.0], np.cumsum(lengths)]),
        before[first] + np.concatenate([[0.0], np.cumsum(shares)]),
    )


def _arc(
    start: FloatArray, direction: FloatArray, following: FloatArray, cut: float
) -> tuple[FloatArray, FloatArray, FloatArray, float, float, float]:
    """Return start, direction, normal, curvature, length and what it takes of the polyline."""
    line = following[1] - following[0]
    after = line / np.linalg.norm(line)
    turn = _angle(direction, after)
    sideways = after - (after @ direction) * direction
    curvature = np.tan(turn / 2) / cut
    normal = sideways / np.linalg.norm(sideways)
    return start, direction, normal, float(curvature), float(turn / curvature), 2 * cut
