"""Cycles of the two-link arm, quick to plan."""

from copy import deepcopy
from typing import Any

from tubeplanner import Cycle, parse_cycle

# Between points that the arm reaches with its elbow bent to one side.
_PLACES = {
    "a": [0.45, -0.3, 0.0],
    "b": [0.45, 0.1, 0.0],
    "c": [0.2, 0.25, 0.0],
    "d": [0.2, 0.55, 0.0],
}


def move(name: str, way: str, *, tolerance: float | None = None, **more: Any) -> dict[str, Any]:
    """Return a move between two places, such as "ab"; with a tolerance it ends in a ball."""
    points = [_PLACES[place] for place in way]
    fields: dict[str, Any] = {"name": name, "tube": {"points": points, "radius": 0.05}, **more}
    if tolerance is not None:
        fields["goal"] = {"position": points[-1], "tolerance": tolerance}
    return fields


def cycle_of(*steps: dict[str, Any], **more: Any) -> Cycle:
    """Return a cycle of steps that begins at place a."""
    fields = {
        "format": "tubeplanner/cycle",
        "robot": {"urdf": "example:two_link", "tool_frame": "hand"},
        "start": {"seed": [0.0, -1.0]},
        "moves": list(steps),
        **more,
    }
    return parse_cycle(deepcopy(fields))


def three_moves() -> Cycle:
    """Return three moves, of which two end in balls."""
    return cycle_of(
        move("first", "ab", tolerance=0.05),
        move("second", "bc", tolerance=0.05),
        move("third", "cd"),
    )
