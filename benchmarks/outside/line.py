"""What of a problem's tube counts: repeated points, straight lines that are divided, turns.

A point that repeats the one before is left out with the segment to it. Segments on one line that
ask the same are one. A point where the tube turns back must be passed.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from outside.files import BadInput

REPEATED = 1e-6  # [m]
ON_LINE = 1e-9  # [m] and [rad]
SAME_ROTATION = 1e-6  # [rad]
BACK = math.cos(math.radians(150.0))
NEAR_SHARE = 0.1  # of the radius: points that near are skipped when a turn is measured
RULES = ("all", "corners", "none")


def distinct(
    points: np.ndarray, same: Callable[[int, int], bool], orientations: np.ndarray | None
) -> list[int]:
    """Return which points are apart from the one before.

    Args:
        points: Shape (m+1, 3) [m].
        same: Whether two segments ask the same.
        orientations: Quaternions at the points, if the rotation is bounded.

    Raises:
        BadInput: A segment of no length asks what none beside it does.
    """
    kept = [0]
    for k in range(1, len(points)):
        if math.dist(points[k], points[kept[-1]]) >= REPEATED:
            kept.append(k)
    if len(kept) < 2:
        raise BadInput("tube.points are all the same")
    for k in set(range(len(points))) - set(kept):
        before = [p - 1 for p in kept[1:] if p < k][-1:]
        after = [p - 1 for p in kept[1:] if p > k][:1]
        if not any(same(k - 1, other) for other in before + after):
            raise BadInput(f"tube.points: segment {k - 1} has no length and asks for more")
        if orientations is not None:
            one, other = Rotation.from_quat(orientations[k - 1 : k + 1])
            if (one.inv() * other).magnitude() > SAME_ROTATION:
                raise BadInput(f"tube.orientations turn in segment {k - 1}, which has no length")
    return kept


def joined(
    points: np.ndarray, same: Callable[[int, int], bool], orientations: np.ndarray | None
) -> list[int]:
    """Return which points are left when segments on one line that ask the same are one."""
    kept = [0]
    for k in range(1, len(points) - 1):
        line = range(kept[-1], k + 2)
        if not same(k - 1, k) or not _is_line(points, line, orientations):
            kept.append(k)
    return [*kept, len(points) - 1]


def passing(points: np.ndarray, radius: np.ndarray, rule: Any) -> list[int]:
    """Return which inner points must be passed within the smaller radius beside them."""
    if rule not in RULES:
        raise BadInput(f"tube.pass_through_points {rule} is not known here")
    inner = range(1, len(points) - 1)
    if rule != "corners":
        return list(inner) if rule == "all" else []
    corners: list[int] = []
    last = 0
    for k in inner:
        near = NEAR_SHARE * min(radius[k - 1 : k + 1])
        if _straightness(points, k, near) >= BACK:
            continue
        if last == k - 1 and corners and math.dist(points[k - 1], points[k]) <= near:
            # A corner that is divided is one, where it is sharpest.
            if _straightness(points, k, 0.0) < _straightness(points, corners[-1], 0.0):
                corners[-1] = k
        else:
            corners.append(k)
        last = k
    return corners


def _straightness(points: np.ndarray, k: int, near: float) -> float:
    """Return the cosine of the turn at a point, measured to points that are not near."""
    before = _towards(points[k] - points[:k][::-1], near)
    after = _towards(points[k + 1 :] - points[k], near)
    return float(before @ after)


def _towards(ways: np.ndarray, near: float) -> np.ndarray:
    """Return the direction of the first way (P, 3) that is longer than a length, or the last."""
    lengths = np.linalg.norm(ways, axis=1)
    far = np.flatnonzero(lengths > near)
    there = np.flatnonzero(lengths > 0)
    one = far[0] if len(far) else there[-1]
    direction: np.ndarray = ways[one] / lengths[one]
    return direction


def _is_line(points: np.ndarray, line: range, orientations: np.ndarray | None) -> bool:
    """Return whether points go straight on, and orientations evenly, from the first to the last."""
    first, last = points[line[0]], points[line[-1]]
    length = math.dist(first, last)
    if length <= ON_LINE:
        return False
    along = (last - first) / length
    ways = points[list(line)] - first
    travel = ways @ along
    if np.linalg.norm(ways - travel[:, None] * along, axis=1).max() > ON_LINE:
        return False
    if (np.diff(travel) <= 0).any():
        return False
    if orientations is None:
        return True
    turned = Rotation.from_quat(orientations[list(line)])
    steps = (turned[:-1].inv() * turned[1:]).magnitude()
    if steps.sum() >= math.pi - SAME_ROTATION:
        return False
    turn = (turned[0].inv() * turned[-1]).as_rotvec()
    even = turned[0] * Rotation.from_rotvec(travel[:, None] / length * turn)
    return bool((even.inv() * turned).magnitude().max() <= ON_LINE)
