"""Numbers that each segment may have of its own, such as the tool's speed there."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from tubeplanner.arrays import FloatArray, read_only
from tubeplanner.errors import ProblemError, shown
from tubeplanner.options import is_number


class SegmentNumber(NamedTuple):
    """What a number of each segment is.

    Attributes:
        field: What messages call it.
        least: The least that is accepted.
        most: The largest.
        unit: Of both.
        without: What it means that a segment has none.
    """

    field: str
    least: float
    most: float
    unit: str
    without: str


TOOL_SPEED = SegmentNumber("tube.tool_speed", 1e-6, 1e4, "m/s", "where the tool's speed is free")
CLEARANCE = SegmentNumber("clearance.segments", 0.0, 1e4, "m", "for the clearance of all others")


def segment_values(given: Any, segments: int, what: SegmentNumber) -> FloatArray | None:
    """Return a number of every segment, shape (m,), infinite for none; None if all have none.

    Args:
        given: One number for all segments, or one each; None or infinite for none.
        segments: Number m of segments.
        what: What they are.

    Raises:
        ProblemError: A count or a number is wrong.
    """
    if given is None:
        return None
    given = given.tolist() if isinstance(given, np.ndarray) else given
    is_list = isinstance(given, Sequence) and not isinstance(given, str)
    entries: list[Any] = list(given) if is_list else [given] * segments
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
