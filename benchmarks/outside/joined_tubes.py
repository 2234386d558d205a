"""The tubes of moves without a stop as one tube's fields."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from outside.files import BadInput
from outside.problem import bounds_of, with_points

SAME = 1e-6  # [m] and of quaternions: tubes meet
SHARED = {"tool_radius": 0.0, "visit": "ordered", "pass_through_points": "corners"}


def joined_tubes(tubes: list[dict[str, Any]], folder: Path) -> dict[str, Any]:
    """Return several tubes' fields as one's.

    Raises:
        BadInput: They do not meet, or differ in what a tube has once.
    """
    tubes = [with_points(tube, folder) for tube in tubes]
    if len(tubes) == 1:
        return tubes[0]
    for tube in tubes[1:]:
        if any(tube.get(k, v) != tubes[0].get(k, v) for k, v in SHARED.items()):
            raise BadInput("tubes without a stop between them differ in what they have once")
    joined = {key: tubes[0].get(key, default) for key, default in SHARED.items()}
    joined["points"] = _chained([tube["points"] for tube in tubes])
    for key, empty in (("radius", None), ("tool_speed", None), ("cross_section", None)):
        rows = [row for tube in tubes for row in _per_segment(tube.get(key), count_of(tube), empty)]
        if any(row is not None for row in rows):
            joined[key] = rows
    signs = [_per_segment(tube.get("joint_signs"), count_of(tube), {}) for tube in tubes]
    joined["joint_signs"] = [row for rows in signs for row in rows]
    return joined | _rotations(tubes)


def count_of(tube: dict[str, Any]) -> int:
    """Return how many segments a tube has in its file."""
    return len(tube["points"]) - 1


def _per_segment(given: Any, count: int, empty: Any) -> list[Any]:
    rows = given if isinstance(given, list) else [given] * count
    return [empty if row is None else row for row in rows]


def _chained(parts: list[list[list[float]]]) -> list[list[float]]:
    chain = list(parts[0])
    for part in parts[1:]:
        if np.abs(np.subtract(chain[-1], part[0])).max() > SAME:
            raise BadInput("tubes without a stop between them do not meet")
        chain += part[1:]
    return chain


def _rotations(tubes: list[dict[str, Any]]) -> dict[str, Any]:
    """Return orientations and bounds of all; where a tube has none, it is free."""
    given = [tube.get("orientations") for tube in tubes]
    known = [k for k, each in enumerate(given) if each is not None]
    if not known:
        return {}
    for k, tube in enumerate(tubes):
        if given[k] is None:
            nearest = min(known, key=lambda other: abs(other - k))
            each = given[nearest][-1 if nearest < k else 0]
            given[k] = [each] * (count_of(tube) + 1)
    turned = list(given[0])
    for part in given[1:]:
        away = [np.abs(np.subtract(turned[-1], np.multiply(s, part[0]))).max() for s in (1, -1)]
        if min(away) > SAME:
            raise BadInput("tubes without a stop between them are turned differently")
        turned += part[1:]
    bounds = [_bounds(tube) for tube in tubes]
    return {"orientations": turned, "rotation_tolerance": [row for rows in bounds for row in rows]}


def _bounds(tube: dict[str, Any]) -> list[Any]:
    tolerance = tube.get("rotation_tolerance")
    if tolerance is None:
        return [[math.inf] * 3] * count_of(tube)
    rows = bounds_of(tolerance, count_of(tube))
    return [float(row[3]) if np.isfinite(row[3]) else row[:3].tolist() for row in rows]
