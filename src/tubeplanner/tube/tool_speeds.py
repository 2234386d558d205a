"""How fast the tool may move in each segment."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray, read_only
from tubeplanner.errors import ProblemError, shown
from tubeplanner.options import is_number

_SLOWEST, _FASTEST = 1e-6, 1e4  # [m/s]


def tool_speeds(given: Any, segments: int) -> FloatArray | None:
    """Return limits on the tool's speed by segment, shape (m,) [m/s]; None where all are free.

    Args:
        given: One limit for all segments, or one each; None or infinite where it is free.
        segments: Number m of segments.

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
            f"tube.tool_speed has {len(entries)} values for {segments} segments; give one, or one "
            "each, null where it is free"
        )
    for k, value in enumerate(entries):
        if value is None or value == np.inf:
            continue
        if not is_number(value) or not _SLOWEST <= value <= _FASTEST:
            raise ProblemError(
                f"tube.tool_speed[{k}] is {shown(value)}; it must be from {_SLOWEST:g} to "
                f"{_FASTEST:g} m/s, or null where the tool's speed is free"
            )
    speeds = np.array([np.inf if value is None else float(value) for value in entries])
    return read_only(speeds) if np.isfinite(speeds).any() else None
