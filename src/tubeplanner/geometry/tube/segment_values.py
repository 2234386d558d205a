"""Values per segment: tool speed, clearance, joint signs and ranges."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray, read_only
from tubeplanner.checks import is_number
from tubeplanner.errors import ProblemError, shown
from tubeplanner.outcome import MARGIN_TOLERANCE, ContradictionError, Location


class SegmentNumber(NamedTuple):
    """A kind of number that each segment may have, such as the tool's speed there.

    Attributes:
        field: Its name in messages.
        least: Lower bound.
        most: Upper bound.
        unit: Of both.
        without: Meaning of a segment without the number.
    """

    field: str
    least: float
    most: float
    unit: str
    without: str


# By the attribute of `Tube`, whose array (m,) is infinite where a segment has no number. Joined and
# reduced tubes, hashes, files and `info` follow from this table.
SEGMENT_NUMBERS = {
    "tool_speed": SegmentNumber(
        "tube.tool_speed", 1e-6, 1e4, "m/s", "where the tool's speed is free"
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
