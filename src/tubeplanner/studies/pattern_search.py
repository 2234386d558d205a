"""Downhill by trying neighbours along the axes, in steps that halve: no derivative is needed.

The compass search of Hooke and Jeeves' family: Kolda, Lewis and Torczon, SIAM Review 45 (2003).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

_P = TypeVar("_P")
_LEAST_GAIN = 1e-3  # of a value: less is no reason to go on with steps of one size


@dataclass
class _Walk(Generic[_P]):
    """One way downhill: where it is, the value there, and how often its steps were halved."""

    point: _P
    value: float
    halved: int = 0


def pattern_search(
    starts: Sequence[tuple[_P, float]],
    neighbours: Callable[[_P, float], Sequence[_P]],
    values: Callable[[Sequence[_P]], Sequence[float]],
    halvings: int,
) -> list[tuple[_P, float]]:
    """Return where ways downhill from some points end, and the values there.

    All ways go on side by side: the neighbours of all are valued together. What is found does not
    depend on the order in which that is done.

    Args:
        starts: Points and their values.
        neighbours: From a point and a share of the first step: the points to try.
        values: Of points, in their order; infinity where there is none.
        halvings: How often steps are halved.
    """
    walks = [_Walk(point, value) for point, value in starts]
    while active := [walk for walk in walks if walk.halved <= halvings]:
        tries = [list(neighbours(walk.point, 0.5**walk.halved)) for walk in active]
        found = iter(values([point for points in tries for point in points]))
        for walk, points in zip(active, tries, strict=True):
            _step(walk, [(point, next(found)) for point in points])
    return [(walk.point, walk.value) for walk in walks]


def _step(walk: _Walk[_P], tried: Sequence[tuple[_P, float]]) -> None:
    """Go to the best of the points that were tried, or halve the steps."""
    point, value = min(tried, key=lambda pair: pair[1], default=(walk.point, walk.value))
    if value < walk.value * (1 - _LEAST_GAIN):
        walk.point, walk.value = point, value
    else:
        walk.halved += 1
