"""How far inside the rotation tolerances a trajectory stays, for all t.

On an interval of width w, a curve lies within w^2 / 8 max |x''| of the chord between its ends. The
curve here is the rotation vector v of the tool against its reference, with dv/dt = J(v) s and
s = w_tool - E^T turn du/dt (see `RotationalTube.error_jacobian`), so that

    |v''| <= g (|w_tool'| + |turn| (|u''| + |s| |u'|)) + g g' |s|^2

with the norms g of J and g' of its change, which grow with the angle only. Where the nearest point
of the segment passes an end of it, u' jumps: that term is bounded by its size alone, to first
order. Halving brings the bounds together.

An angle that goes on beyond pi is the rotation vector's other branch, of which every component and
the length are smaller: following the curve beyond pi can only overestimate them.
"""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.trajectory.bernstein import halves
from tubeplanner.tube.rotational_tube import RotationalTube
from tubeplanner.tube.rotations import (
    MATRIX_ERROR_GAIN,
    nearest_branch,
    rotation_vector,
    turning_gain,
    turning_gain_rate,
)
from tubeplanner.verification.enclosed_pose import EnclosedPose
from tubeplanner.verification.tube_visits import LeastMargin, Visit, visited_parts

# The least margin is bracketed to this share of itself, or to this angle [rad] near zero.
_RELATIVE_RESOLUTION = 0.02
_RESOLUTION = 2e-7
_ALL = np.ones(3, dtype=bool)
_MIN_WIDTH = 2.0**-40  # of an interval
_MAX_ROWS = 1_000_000
# A part in which the rotation vector could move farther than this is halved unseen [rad].
_MAX_MOVE = 0.3
_MAX_GAIN = float(turning_gain(np.array(np.pi + _MAX_MOVE)))


@dataclass(frozen=True, eq=False)
class _Parts:
    """R parts of intervals, each in one segment.

    Attributes:
        interval: Index of the interval, shape (R,).
        start: In the interval's local time, shape (R,).
        width: The same.
        segment: Index of the tube's segment, shape (R,).
        vector: Rotation vectors at both ends, shape (2, R, 3) [rad].
        share: Of the segment, not clipped, at both ends, shape (2, R).
    """

    interval: IntArray
    start: FloatArray
    width: FloatArray
    segment: IntArray
    vector: FloatArray
    share: FloatArray


def least_rotation_margin(
    tube: RotationalTube, pose: EnclosedPose, visits: list[Visit]
) -> LeastMargin | None:
    """Return how far inside the rotation bounds the tool stays during its visits, for all t.

    None if no segment visited bounds the rotation.
    """
    bounded = [visit for visit in visits if np.isfinite(tube.bounds[visit.segment]).any()]
    if not bounded:
        return None
    parts = _first_parts(tube, pose, bounded)
    attained, time, worst_segment = np.inf, 0.0, 0
    lower_bound, count = np.inf, 0
    while len(parts.interval):
        count += len(parts.interval)
        ends = np.array([tube.margin_of(v, parts.segment) for v in parts.vector])
        lower, error = _bounded(tube, pose, parts)
        end, row = np.unravel_index(int(ends.argmin()), ends.shape)
        if ends[end, row] < attained:
            attained, worst_segment = float(ends[end, row]), int(parts.segment[row])
            local = parts.start[row] + (parts.width[row] if end else 0.0)
            interval = parts.interval[row]
            time = float(pose.tool.start[interval] + local * pose.tool.width[interval])
        resolution = max(_RESOLUTION, _RELATIVE_RESOLUTION * abs(attained))
        split = (lower < attained - resolution - error) & (parts.width > _MIN_WIDTH)
        split &= count < _MAX_ROWS
        lower_bound = min(lower_bound, float(lower[~split].min(initial=np.inf)))
        parts = _halves(tube, pose, parts, split)
    return LeastMargin(lower_bound, attained, time, worst_segment, count)


def _first_parts(tube: RotationalTube, pose: EnclosedPose, visits: list[Visit]) -> _Parts:
    """Return every part of an interval that a visit covers."""
    interval, start, width, segment = visited_parts(pose.tool, visits)
    ends = [_vector_at(tube, pose, interval, segment, t) for t in (start, start + width)]
    vector, share = (np.array(values) for values in zip(*ends, strict=True))
    return _Parts(interval, start, width, segment, vector, share)


def _halves(tube: RotationalTube, pose: EnclosedPose, parts: _Parts, rows: BoolArray) -> _Parts:
    """Return the two halves of some of the parts, one after the other."""
    interval, segment = parts.interval[rows], parts.segment[rows]
    start, width = halves(parts.start[rows], parts.width[rows])
    middle = _vector_at(tube, pose, interval, segment, start[1::2])
    both = []
    for ends, between in zip((parts.vector[:, rows], parts.share[:, rows]), middle, strict=True):
        pairs = np.repeat(ends, 2, axis=1)
        pairs[1, 0::2] = pairs[0, 1::2] = between
        both.append(pairs)
    return _Parts(np.repeat(interval, 2), start, width, np.repeat(segment, 2), *both)


def _bounded(
    tube: RotationalTube, pose: EnclosedPose, parts: _Parts
) -> tuple[FloatArray, FloatArray]:
    """Return lower bounds on the margins between the ends and errors, each shape (R,) [rad]."""
    first, last = parts.vector
    largest = np.maximum(_measures(first), _measures(nearest_branch(last, first, _ALL)))
    off, error = _chord_distance(tube, pose, parts, largest[:, 3])
    bounds = tube.bounds[parts.segment]
    lower = (bounds - largest).min(axis=1) - off - error
    # No component and no angle is larger than pi.
    return np.maximum(lower, bounds.min(axis=1) - np.pi), error


def _vector_at(
    tube: RotationalTube,
    pose: EnclosedPose,
    interval: IntArray,
    segment: IntArray,
    local: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return rotation vectors (R, 3) [rad] and shares of segments (R,) at times in intervals."""
    tool = pose.tool.within(interval, local)
    rotation = pose.rotation.within(interval, local).reshape(-1, 3, 3)
    u = tube.projection(tool, segment)
    relative = tube.reference_at(np.clip(u, 0.0, 1.0), segment).transpose(0, 2, 1) @ rotation
    return rotation_vector(relative), u


def _measures(v: FloatArray) -> FloatArray:
    """Return |x|, |y|, |z| and the length of rotation vectors (R, 3): shape (R, 4)."""
    return np.hstack([abs(v), np.linalg.norm(v, axis=1, keepdims=True)])


def _chord_distance(
    tube: RotationalTube,
    pose: EnclosedPose,
    parts: _Parts,
    angle: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return how far from its chord the rotation vector may be, and its error, each (R,) [rad].

    Args:
        tube: Reference orientations and bounds.
        pose: The trajectory.
        parts: Where.
        angle: The larger of the angles at the two ends, shape (R,) [rad].
    """
    width = parts.width * pose.tool.width[parts.interval]
    axis = np.diff(tube.points, axis=0)[parts.segment]
    length = np.linalg.norm(axis, axis=1)
    rate, bend, off = (
        bound[parts.interval] / length
        for bound in (pose.speed, pose.acceleration, pose.tool.error[:, 0])
    )
    low, high = parts.share.min(axis=0), parts.share.max(axis=0)
    slack = bend * width**2 / 8 + 2 * off
    beyond = (high + slack <= 0) | (low - slack >= 1)
    passes_end = ~beyond & ((low - slack < 0) | (high + slack > 1))
    turn = np.where(beyond, 0.0, np.linalg.norm(tube.turn, axis=1)[parts.segment])
    spin, spin_rate = pose.spin[parts.interval], pose.spin_rate[parts.interval]
    relative = spin + turn * rate
    move = _MAX_GAIN * relative * width
    farthest = np.minimum(angle + move / 2, np.pi + _MAX_MOVE)
    gain, gain_rate = turning_gain(farthest), turning_gain_rate(farthest)
    smooth = spin_rate + turn * (bend + relative * rate) + gain_rate * relative**2
    broken = spin_rate + gain_rate * relative * spin
    jump = turn * (high - low + bend * width**2 + 4 * off) / 2
    distance = gain * np.where(passes_end, broken * width**2 / 8 + jump, smooth * width**2 / 8)
    error = gain * (MATRIX_ERROR_GAIN * pose.rotation.error[parts.interval, 0] + turn * off)
    return np.where(move <= _MAX_MOVE, distance, np.inf), error
