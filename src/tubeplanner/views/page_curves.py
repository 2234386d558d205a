"""The curves of a page: use of the limits and clearance over time, as JSON values.

A motion is made of stretches, each judged under a problem of its own: one, or the legs of a cycle.
What is known only of stretches is missing (null) between them. Shares are whole percent, distances
tenths of a millimetre: what a curve shows.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.constraints.binding_limits import LINKS, TOOL
from tubeplanner.constraints.closest_pairs import ClosestPairs, closest_pairs
from tubeplanner.constraints.limit_use import POSITION, LimitUse
from tubeplanner.constraints.tool_speed import ToolSpeed
from tubeplanner.views.palette import LINE_COLORS
from tubeplanner.views.stretch import Stretch

_TOOL_COLOR, _LINKS_COLOR = "#8C510A", "#7A6FAF"
# A joint near an end of its range may be as fast as elsewhere: only at the end it counts.
_AT_END = 0.998
_WORDS = {"obstacles": "to obstacles", "self_collision": "between links"}


def page_curves(stretches: Sequence[Stretch], time: FloatArray) -> dict[str, Any]:
    """Return limit on the tool's speed, use of limits and clearance, those that there are.

    Args:
        stretches: Of one motion.
        time: At even steps from its begin to its end, shape (K,) [s].
    """
    found = {
        "speedLimit": _speed_limit(stretches, time),
        "limits": _limits(stretches, time),
        "clearance": _clearances(stretches, time),
    }
    return {name: value for name, value in found.items() if value}


def row_color(name: str, joint_names: Sequence[str]) -> str:
    """Return the colour of what limits a joint, the tool or the links."""
    if name in joint_names:
        return LINE_COLORS[joint_names.index(name) % len(LINE_COLORS)]
    return _TOOL_COLOR if name == TOOL else _LINKS_COLOR


def _speed_limit(stretches: Sequence[Stretch], time: FloatArray) -> list[float | None]:
    """Return the limit of the segment of then [m/s]; nothing where there never is one."""
    limit = np.full(len(time), np.inf)
    for stretch in stretches:
        rows = stretch.inside(time)
        segment = stretch.uses.segment[stretch.nearest(time[rows] - stretch.begin)]
        limit[rows] = ToolSpeed(stretch.problem).limit[segment]
    return _rounded(limit, 4) if np.isfinite(limit).any() else []


def _limits(stretches: Sequence[Stretch], time: FloatArray) -> dict[str, Any]:
    """Return of each joint, the tool and the links how much of which limit is used most."""
    shares: dict[str, dict[str, FloatArray]] = {}
    for stretch in stretches:
        rows = stretch.inside(time)
        if len(rows) == 0:
            continue
        joints = stretch.problem.robot.joint_names
        for use in stretch.uses.uses:
            owner = TOOL if use.name == TOOL else LINKS if use.joint is None else joints[use.joint]
            whole = shares.setdefault(owner, {}).setdefault(use.kind, np.full(len(time), -np.inf))
            share = _counted(use)
            whole[rows] = np.maximum(whole[rows], _largest_near(stretch, share, time[rows]))
    joints = stretches[0].problem.robot.joint_names
    owners = [name for name in (*joints, TOOL, LINKS) if name in shares]
    kinds = list(dict.fromkeys(kind for name in owners for kind in shares[name]))
    lines = [_line(name, shares[name], kinds, joints) for name in owners]
    return {"kinds": [kind.replace("_", " ") for kind in kinds], "lines": lines}


def _line(
    name: str, shares: dict[str, FloatArray], kinds: list[str], joints: Sequence[str]
) -> dict[str, Any]:
    table = np.array(list(shares.values()))
    numbers = np.array([kinds.index(kind) for kind in shares])
    return {
        "name": name,
        "color": row_color(name, joints),
        "dashed": name not in joints,
        "share": _rounded(100 * table.max(axis=0), 0),
        "kind": numbers[table.argmax(axis=0)].tolist(),
    }


def _counted(use: LimitUse) -> FloatArray:
    """Return what counts of the use of a limit: of a range only its very ends."""
    if use.kind != POSITION:
        return use.share
    return np.where(use.share >= _AT_END, use.share, 0.0)


def _largest_near(stretch: Stretch, share: FloatArray, time: FloatArray) -> FloatArray:
    """Return shares at times (K,) [s] of the whole motion: the largest of the samples nearest."""
    own = stretch.uses.samples.time + stretch.begin
    found: FloatArray = np.interp(time, own, share)
    step = time[1] - time[0] if len(time) > 1 else np.inf
    rows = np.clip(np.round((own - time[0]) / step), 0, len(time) - 1).astype(int)
    np.maximum.at(found, rows, share)
    return found


def _clearances(stretches: Sequence[Stretch], time: FloatArray) -> list[dict[str, Any]]:
    """Return the closest pairs of each kind over time; points of the first kind alone."""
    found: dict[str, _Closest] = {}
    for stretch in stretches:
        rows = stretch.inside(time)
        if len(rows) == 0:
            continue
        local = np.minimum(time[rows] - stretch.begin, stretch.trajectory.duration)
        for closest in closest_pairs(stretch.problem, stretch.trajectory, local):
            whole = found.setdefault(closest.kind, _Closest(len(time)))
            whole.keep(rows, closest)
    ordered = [kind for kind in _WORDS if kind in found]
    return [found[kind].as_dict(_WORDS[kind], kind == ordered[0]) for kind in ordered]


class _Closest:
    """The closest pairs of a kind over a whole motion."""

    def __init__(self, count: int) -> None:
        self._distance, self._margin = np.full(count, np.inf), np.full(count, np.inf)
        self._points = np.zeros((count, 6))
        self._pairs: dict[tuple[str, str], int] = {}
        self._pair = np.zeros(count, dtype=int)

    def keep(self, rows: IntArray, closest: ClosestPairs) -> None:
        """Keep those of some of the times."""
        self._distance[rows], self._margin[rows] = closest.distance, closest.margin
        self._points[rows] = closest.points.reshape(-1, 6)
        self._pair[rows] = [self._pairs.setdefault(k, len(self._pairs)) for k in closest.names]

    def as_dict(self, name: str, with_points: bool) -> dict[str, Any]:
        """Return them as JSON values, distances in mm, points in m."""
        apart = np.isfinite(self._distance)
        required = np.full(len(apart), np.inf)
        required[apart] = self._distance[apart] - self._margin[apart]
        fields = {
            "name": name,
            "distance": _rounded(1000 * self._distance, 1),
            "required": _rounded(1000 * required, 1),
            "pair": self._pair.tolist(),
            "pairs": [list(pair) for pair in self._pairs],
        }
        return {**fields, "points": self._points.round(4).tolist()} if with_points else fields


def _rounded(values: FloatArray, digits: int) -> list[float | None]:
    """Return rounded values, None for what is not finite."""
    rounded = [round(value, digits or None) for value in np.where(np.isfinite(values), values, 0)]
    return [
        value if is_finite else None
        for value, is_finite in zip(rounded, np.isfinite(values).tolist(), strict=True)
    ]
