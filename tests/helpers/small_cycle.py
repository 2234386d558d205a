"""Cycles of the two-link arm that are planned within a second or two."""

from copy import deepcopy
from functools import cache
from typing import Any

from ruamel.yaml import YAML

from tubeplanner import Cycle, CycleResult, PlanOptions, parse_cycle, plan_cycle

SMALL = """\
format: tubeplanner/cycle
robot:
  urdf: example:two_link
  tool_frame: hand
  gravity: [0, -3, 0]
  limits: {velocity: {joint1: .inf, joint2: .inf}}
start: {seed: [0.0, -1.0]}
closed: true
obstacles:
  - {name: part, box: [0.02, 0.02, 0.02], position: [0.45, 0.1, 0.3]}
moves:
  - name: over
    tube: {points: [[0.45, -0.3, 0], [0.45, 0.1, 0]], radius: 0.05, joint_signs: {joint2: "-"}}
  - {event: gripper, set: close, dwell: 0.05}
  - {attach: part, payload: {mass: 0.5, com: [0, 0, 0], inertia: [0.001, 0.001, 0.001, 0, 0, 0]}}
  - name: down
    tube: {points: [[0.45, 0.1, 0], [0.2, 0.1, 0]], radius: 0.05, joint_signs: {joint2: "-"}}
  - name: beside
    pass_through: true
    tube: {points: [[0.2, 0.1, 0], [0.2, 0.45, 0]], radius: 0.05, joint_signs: {joint2: "-"}}
  - {event: gripper, set: open, dwell: 0.06}
  - {detach: part, leave_as_obstacle: false}
  - name: back
    tube: {points: [[0.2, 0.45, 0], [0.45, -0.3, 0]], radius: 0.15, joint_signs: {joint2: "-"}}
  - {event: pause, dwell: 0.1}
"""


def small_cycle(**changes) -> Cycle:
    """Return the cycle, with other values at field paths whose dots are written as `__`."""
    paths = {name.replace("__", "."): value for name, value in changes.items()}
    return parse_cycle(YAML(typ="safe", pure=True).load(SMALL), name="small", changes=paths)


@cache
def planned_cycle(**changes) -> CycleResult:
    """Return the cycle's plan, made once."""
    result = plan_cycle(small_cycle(**changes), PlanOptions(quality="fast", slack=0.0))
    assert result.succeeded, result.message
    return result


# Between points that the arm reaches with its elbow bent to one side.
_PLACES = {
    "a": [0.45, -0.3, 0.0],
    "b": [0.45, 0.1, 0.0],
    "c": [0.2, 0.25, 0.0],
    "d": [0.2, 0.55, 0.0],
}


def move(name: str, way: str, *, tolerance: float | None = None, **more: Any) -> dict[str, Any]:
    """Return a move between two places, such as "ab"; with a tolerance it ends in a ball."""
    points = [_PLACES[location] for location in way]
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
