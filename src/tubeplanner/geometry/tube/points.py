"""Points of a tube, and the values of its segments: radii, speeds, clearances, joint signs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray, read_only
from tubeplanner.checks import is_number
from tubeplanner.errors import ProblemError, shown
from tubeplanner.outcome import MARGIN_TOLERANCE, ContradictionError, Location


def arc_lengths(points: FloatArray) -> FloatArray:
    """Return arc lengths along straight lines up to each of P points (P, d), from 0: shape (P,)."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def densified(points: FloatArray, max_step: float) -> FloatArray:
    """Return points (P, d) with evenly spaced points inserted, so that no coordinate steps too far.

    Args:
        points: Shape (P, d).
        max_step: In any coordinate, in the unit of the points.
    """
    parts = [points[:1]]
    for begin, end in pairwise(points):
        steps = max(1, int(np.ceil(abs(end - begin).max() / max_step)))
        fraction = np.linspace(0, 1, steps + 1)[1:, None]
        parts.append((1 - fraction) * begin + fraction * end)
    return np.concatenate(parts)


def simplified(points: FloatArray, deviation: float) -> list[int]:
    """Return the points to keep so that all lie within a deviation of the lines between.

    Ramer 1972; Douglas & Peucker 1973.

    Args:
        points: Shape (N, 3), N >= 2 [m].
        deviation: [m].
    """
    corners, waiting = [0], [len(points) - 1]
    while waiting:
        middle, distance = farthest_from_line(points, corners[-1], waiting[-1])
        if distance > deviation:
            waiting.append(middle)
        else:
            corners.append(waiting.pop())
    return corners


def farthest_from_line(points: FloatArray, i: int, j: int) -> tuple[int, float]:
    """Return the point between two others that is farthest from their line, and its distance [m].

    Without points between, the first of the two, at distance 0.
    """
    if j - i < 2:
        return i, 0.0
    between, axis = points[i + 1 : j] - points[i], points[j] - points[i]
    fraction = np.clip(between @ axis / max(float(axis @ axis), 1e-300), 0.0, 1.0)
    distance = np.linalg.norm(between - fraction[:, None] * axis, axis=1)
    worst = int(distance.argmax())
    return i + 1 + worst, float(distance[worst])


# ---- Reference points that repeat their predecessor: left out, with the segment to them.

MIN_LENGTH = 1e-6  # [m]: reference points nearer to each other are the same; no radius is less
_SAME_ORIENTATION = 1e-6  # [rad]


@dataclass(frozen=True, eq=False)
class DistinctPoints:
    """The remaining points and segments."""

    points: IntArray  # indices of the points, shape (m+1,)
    segments: IntArray  # indices of the segments that end at them, shape (m,)
    dropped: IntArray  # indices of the points left out


def distinct_points(
    points: FloatArray, values: Sequence[object], angles: FloatArray | None
) -> DistinctPoints:
    """Return the points that are apart from their predecessors.

    Args:
        points: Reference points, shape (m+1, 3) [m].
        values: Conditions of each of m segments, to be compared.
        angles: Rotation of the reference orientation in each segment, shape (m,) [rad]; None: it is
            free.

    Raises:
        ProblemError: All points are the same, or a segment of no length has conditions that neither
            of its neighbours has, so that they would be lost.
    """
    rows = [0]
    for k in range(1, len(points)):
        if np.linalg.norm(points[k] - points[rows[-1]]) >= MIN_LENGTH:
            rows.append(k)
    if len(rows) < 2:
        raise ProblemError(
            f"tube.points: points 0 and {len(points) - 1} are the same within {MIN_LENGTH:g} m, "
            "and so are all between; at least two points that are apart are needed"
        )
    remaining = np.array(rows)
    dropped = np.setdiff1d(np.arange(len(points)), remaining)
    for k in dropped.tolist():
        lost, segments = k - 1, remaining[1:] - 1
        after = int(np.searchsorted(segments, lost))
        beside = [int(segments[i]) for i in (after - 1, after) if 0 <= i < len(segments)]
        same = f"tube.points: points {lost} and {k} are the same within {MIN_LENGTH:g} m"
        if all(values[lost] != values[i] for i in beside):
            neighbours = " and ".join(str(i) for i in beside)
            raise ProblemError(
                f"{same}; segment {lost} between them would be left out, but its radius, joint "
                "signs, tolerances or speed are those of neither segment beside it "
                f"({neighbours}): remove one of the points, or give them what a neighbour has"
            )
        if angles is not None and angles[lost] > _SAME_ORIENTATION:
            raise ProblemError(
                f"{same}, but tube.orientations turn by {angles[lost]:.3g} rad between them: a "
                "tool cannot turn on the spot here; move one of the points, or give "
                "both one orientation"
            )
    return DistinctPoints(remaining, remaining[1:] - 1, dropped)


# ---- Reference points and radii of a tube, checked.

MAX_EXTENT = 1e4  # [m]


def given_points(points: Sequence[Sequence[float]] | FloatArray) -> FloatArray:
    """Return reference points (m+1, 3) [m].

    Raises:
        ProblemError: The points are no points, fewer than two, or too far away.
    """
    try:
        corners = read_only(points)
    except (TypeError, ValueError):
        raise ProblemError(f"tube.points: {shown(points)} is no list of points [x, y, z]") from None
    if corners.ndim != 2 or corners.shape[0] < 2 or corners.shape[1] != 3:
        raise ProblemError(
            f"tube.points has shape {corners.shape}; at least two points [x, y, z] are needed"
        )
    if not (abs(corners) <= MAX_EXTENT).all():
        raise ProblemError(f"tube.points must be finite numbers within {MAX_EXTENT:g} m")
    return corners


def given_radii(radius: float | Sequence[float] | FloatArray, segments: int) -> FloatArray:
    """Return the radius of each segment, (m,) [m].

    Args:
        radius: A radius for all segments, or a radius each.
        segments: Number m of segments.

    Raises:
        ProblemError: A count or a number is wrong.
    """
    try:
        radii = read_only(radius)
    except (TypeError, ValueError):
        raise ProblemError(f"tube.radius {shown(radius)} is no number or list of numbers") from None
    if radii.ndim == 0:
        radii = np.full(segments, float(radii))
    if radii.shape != (segments,):
        raise ProblemError(
            f"tube.radius has {radii.size} values for {segments} segments; give one, or one each"
        )
    for k, value in enumerate(radii):
        if not MIN_LENGTH <= value <= MAX_EXTENT:
            raise ProblemError(
                f"tube.radius[{k}] is {value:g} m; it must be from {MIN_LENGTH:g} to "
                f"{MAX_EXTENT:g} m"
            )
    return read_only(radii)


def given_route(route: Sequence[Sequence[float]] | FloatArray) -> FloatArray:
    """Return the configurations (P, n) of a route [rad or m].

    Raises:
        ProblemError: They are no configurations, of different lengths, or fewer than two.
    """
    try:
        corners = read_only(route)
    except (TypeError, ValueError):
        corners = read_only([])
    if corners.ndim != 2 or len(corners) < 2 or not np.isfinite(corners).all():
        raise ProblemError(
            f"tube.route is {shown(route)}; give at least two configurations, a number for each "
            "joint, from the start to the goal"
        )
    return corners


# ---- Compulsory reference points: those at which the tube turns back.
#
# Where a tube turns back on itself, the capsules before and after the point overlap: a tool could
# turn round long before the point and still be in both.

PASS_THROUGH = ("all", "corners", "none")
_TURNS_BACK = np.radians(150)
# Points nearer than this fraction of the radius are skipped when a turn is measured: a finely
# divided corner is a corner.
_CLOSE = 0.1


def compulsory_points(points: FloatArray, radius: FloatArray, rule: str) -> IntArray:
    """Return the indices of the inner points that must be passed.

    Args:
        points: Reference points, shape (m+1, 3) [m].
        radius: Of the segments, shape (m,) [m].
        rule: One of `PASS_THROUGH`.
    """
    inner = np.arange(1, len(points) - 1)
    if rule == "all":
        return inner
    if rule == "none":
        return inner[:0]
    close = np.append(0.0, _CLOSE * passing_radius(radius))
    back = [k for k in inner.tolist() if angle_at(points, k, close[k]) > _TURNS_BACK]
    # Close points one after the other are a single corner: its sharpest point counts.
    steps = np.append(0.0, np.linalg.norm(np.diff(points, axis=0), axis=1))
    starts = [k for k in back if k - 1 not in back or steps[k] > close[k]]
    corners = [
        [k for k in back if begin <= k < end] for begin, end in pairwise([*starts, len(points)])
    ]
    sharpest = [max(corner, key=lambda k: angle_at(points, k, 0.0)) for corner in corners]
    return np.array(sharpest, dtype=np.int64)


def passing_radius(radius: FloatArray) -> FloatArray:
    """Return the passing distance of inner points, the smaller radius beside them, (m-1,) [m]."""
    return np.minimum(radius[:-1], radius[1:])


def angle_at(points: FloatArray, k: int, close: float) -> float:
    """Return the turn of a path at inner point k [rad], from 0 to pi.

    Args:
        points: Shape (m+1, 3) [m].
        k: Index of the point.
        close: Nearer points than this [m] are skipped, unless there are no others.
    """
    before = _direction(points[k], points[k - 1 :: -1], close)
    after = _direction(points[k], points[k + 1 :], close)
    return float(np.arctan2(np.linalg.norm(np.cross(before, after)), -before @ after))


def _direction(point: FloatArray, others: FloatArray, close: float) -> FloatArray:
    """Return the unit vector to the first of other points that is not close, or to the last."""
    for other in others:
        away = other - point
        if np.linalg.norm(away) > close:
            break
    away = away if np.any(away) else others[0] - point
    direction: FloatArray = away / np.linalg.norm(away)
    return direction


# ---- Values per segment: tool speed, clearance.


class SegmentNumber(NamedTuple):
    """A kind of number that each segment may have, such as the tool's speed there."""

    field: str  # its name in messages
    least: float  # lower bound
    most: float  # upper bound
    unit: str  # of both
    without: str  # meaning of a segment without the number


# By the attribute of `Tube`, whose array (m,) is infinite where a segment has no number. Joined and
# reduced tubes, hashes, files and `info` follow from this table.
SEGMENT_NUMBERS = {
    "tool_speed": SegmentNumber(
        "tube.tool_speed", 1e-6, 1e4, "m/s", "where the tool's speed is free"
    ),
    "least_tool_speed": SegmentNumber(
        "tube.least_tool_speed", 1e-7, 1e4, "m/s", "where the tool may be as slow as it likes"
    ),
    "tool_acceleration": SegmentNumber(
        "tube.tool_acceleration", 1e-6, 1e4, "m/s^2", "where the tool's acceleration is free"
    ),
    "clearance": SegmentNumber(
        "clearance.segments", 0.0, 1e4, "m", "for the clearance of all others"
    ),
}


def segment_values(user_value: Any, segments: int, name: str) -> FloatArray | None:
    """Return a number of every segment, shape (m,), infinite for none; None if all have none.

    Args:
        user_value: A number for all segments, or a number each; None or infinite for none.
        segments: Number m of segments.
        name: The kind of number, of `SEGMENT_NUMBERS`.

    Raises:
        ProblemError: A count or a number is wrong.
    """
    if user_value is None:
        return None
    what = SEGMENT_NUMBERS[name]
    values = user_value.tolist() if isinstance(user_value, np.ndarray) else user_value
    is_list = isinstance(values, Sequence) and not isinstance(values, str)
    entries: list[Any] = list(values) if is_list else [values] * segments
    if len(entries) != segments:
        raise ProblemError(
            f"{what.field} has {len(entries)} values for {segments} segments; give one, or one "
            f"each, null {what.without}"
        )
    for k, value in enumerate(entries):
        if value is None or value == np.inf:
            continue
        if not is_number(value) or not what.least <= value <= what.most:
            raise ProblemError(
                f"{what.field}[{k}] is {shown(value)}; it must be from {what.least:g} to "
                f"{what.most:g} {what.unit}, or null {what.without}"
            )
    values = np.array([np.inf if value is None else float(value) for value in entries])
    return read_only(values) if np.isfinite(values).any() else None


# ---- Signs of a tube's joints: the range of every joint in every segment.

JointRange: TypeAlias = tuple[float, float]
# "+", "-", "0", 1, -1, 0 or a range of two numbers
JointSign: TypeAlias = Any

_LARGEST = 1e300  # a bound that is finite [rad or m]
_SIGNS: dict[str | int, JointRange] = {
    "+": (0.0, np.inf),
    "-": (-np.inf, 0.0),
    "0": (-np.inf, np.inf),
    1: (0.0, np.inf),
    -1: (-np.inf, 0.0),
    0: (-np.inf, np.inf),
}


def sign_maps(
    joint_signs: Mapping[str, JointSign] | Sequence[Mapping[str, JointSign]], segments: int
) -> tuple[Mapping[str, JointSign], ...]:
    """Return a map of joint signs for every segment.

    Raises:
        ProblemError: The signs are no maps, or their count is wrong.
    """
    maps = [joint_signs] * segments if isinstance(joint_signs, Mapping) else joint_signs
    try:
        signs = tuple(dict(row) for row in maps)
    except (TypeError, ValueError):
        raise ProblemError(
            f"tube.joint_signs: {shown(joint_signs)} is no map from joint names to signs, nor a "
            "list of such maps"
        ) from None
    if len(signs) != segments:
        raise ProblemError(
            f"tube.joint_signs has {len(signs)} maps for {segments} segments; give one, or one each"
        )
    return signs


def joint_ranges(
    signs: tuple[Mapping[str, JointSign], ...], visit: str
) -> tuple[Mapping[str, JointRange], ...]:
    """Return the range of each sign.

    Raises:
        ProblemError: A sign is neither a sign nor a range.
        ContradictionError: Ranges of neighbouring segments, visited in order, do not meet.
    """
    ranges = tuple(
        {name: _range(f"tube.joint_signs: joint {shown(name)}", sign) for name, sign in row.items()}
        for row in signs
    )
    for k, (before, after) in enumerate(pairwise(ranges) if visit == "ordered" else ()):
        for name in before.keys() & after.keys():
            lower = max(before[name][0], after[name][0])
            upper = min(before[name][1], after[name][1])
            if lower > upper:
                raise ContradictionError(
                    f"tube.joint_signs: joint '{name}' has the range {list(before[name])} in "
                    f"segment {k} and {list(after[name])} in segment {k + 1}, which do not meet; "
                    "give ranges that share a value",
                    Location(joint=name, segment=k),
                    proved=lower - upper > 2 * MARGIN_TOLERANCE or None,
                )
    return ranges


def sign_of(bounds: JointRange) -> str | None:
    """Return the sign that is equivalent to a range: "+", "-" or "0"; None if none is."""
    return next((str(sign) for sign, same in _SIGNS.items() if same == bounds), None)


def _range(where: str, sign: JointSign) -> JointRange:
    if (is_number(sign) or isinstance(sign, str)) and sign in _SIGNS:
        return _SIGNS[sign]
    is_array = isinstance(sign, np.ndarray) and sign.ndim == 1
    if (is_array or isinstance(sign, list | tuple)) and len(sign) == 2:
        for value in sign:
            if not is_number(value) or _LARGEST < abs(value) < np.inf:
                raise ProblemError(f"{where}: {shown(value)} is no end of a range [lower, upper]")
        lower, upper = (float(value) for value in sign)
        if lower <= upper:
            return lower, upper
        raise ProblemError(f"{where}: the range [{lower:g}, {upper:g}] is reversed or no number")
    raise ProblemError(f"{where}: {shown(sign)} is none of '+', '-', '0', 1, -1, 0, [lower, upper]")
