"""What problems of the campaign have now and then: limits, loads, boxes, speeds, concave solids."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from campaign_witness import MAX_RADIUS, RADIUS_FACTOR, ROWS, Witness
from outside.arm import Arm

JERK, ACCELERATION = (20.0, 2000.0), (2.0, 30.0)  # [rad/s^3 or m/s^3], [rad/s^2 or m/s^2]
FASTER = (1.3, 30.0)  # limits on the tool's speed, in the witness's
_U = np.array([[0, 0], [3, 0], [3, 3], [2, 3], [2, 1], [1, 1], [1, 3], [0, 3]], dtype=float)
_CAP = np.array([[0, 1, 4], [0, 4, 5], [1, 2, 3], [1, 3, 4], [0, 5, 6], [0, 6, 7]])


def vary_limits(rng: np.random.Generator, robot: dict[str, Any], arm: Arm) -> None:
    """Limit jerks, and accelerations where nothing limits them, in place."""
    limits = robot.setdefault("limits", {})
    for quantity, bounds in (("jerk", JERK), ("acceleration", ACCELERATION)):
        if quantity not in limits and rng.random() < 0.25:
            drawn = np.exp(rng.uniform(*np.log(bounds), len(arm.joint_names)))
            limits[quantity] = dict(zip(arm.joint_names, drawn.tolist(), strict=True))


def attach_solid(rng: np.random.Generator, robot: dict[str, Any]) -> None:
    """Let the tool carry a solid that may touch the link that it is fixed to, in place."""
    size = float(rng.uniform(0.02, 0.12))
    shapes: list[dict[str, Any]] = [{"box": [size, size, 2 * size]}, {"sphere": size}]
    shape = shapes[int(rng.integers(len(shapes)))]
    away = rng.normal(size=3)
    position = (1.5 * size * away / np.linalg.norm(away)).tolist()
    solid = {"name": "carried", **shape, "position": position}
    robot["attached"] = [solid | {"touch_links": [robot["tool_frame"]]}]


def with_boxes(rng: np.random.Generator, tube: dict[str, Any], witness: Witness) -> dict[str, Any]:
    """Return a tube some of whose segments have a box, as wide and high as drawn."""
    sections: list[Any] = []
    radii: list[float | None] = []
    spans = np.diff(witness.points, axis=0)
    for k, (radius, span) in enumerate(zip(tube["radius"], spans, strict=True)):
        if rng.random() < 0.5:
            sections.append(None)
            radii.append(radius)
            continue
        least = RADIUS_FACTOR * witness.needed[k]
        sides = np.maximum(least, witness.scale * rng.uniform(0.3, 1.5, 2))
        up = np.cross(span / np.linalg.norm(span), rng.normal(size=3))
        box = (2 * np.minimum(sides, MAX_RADIUS)).tolist()
        sections.append({"box": box, "up": (up / np.linalg.norm(up)).tolist()})
        radii.append(None)
    return tube | {"radius": radii, "cross_section": sections}


def tool_speeds(rng: np.random.Generator, arm: Arm, witness: Witness) -> list[float | None]:
    """Return limits on the tool's speed in some segments, above those of the witness [m/s]."""
    position = arm.tool(witness.q)[1]
    step = witness.trajectory.duration / (ROWS - 1)
    speed = np.linalg.norm(np.diff(position, axis=0), axis=1) / step
    limits: list[float | None] = []
    for a, b in pairwise(witness.gates):
        # Where parts of the tube overlap, the witness may be in either.
        fastest = speed[max(a - 20, 0) : b + 20].max()
        factor = float(np.exp(rng.uniform(*np.log(FASTER))))
        limits.append(float(factor * fastest) if rng.random() < 0.6 else None)
    return limits


def write_concave_mesh(path: Path) -> None:
    """Write a block with a groove, as binary STL: 3 m wide and high, 2 m deep about its middle."""
    flat = _U - 1.5
    corners = np.vstack([np.column_stack([flat, np.full(8, z)]) for z in (-1.0, 1.0)])
    walls = [(k, (k + 1) % 8) for k in range(8)]
    sides = [face for a, b in walls for face in ((a, b, b + 8), (a, b + 8, a + 8))]
    triangles = corners[np.vstack([_CAP[:, ::-1], _CAP + 8, np.array(sides)])]
    record = np.zeros(len(triangles), dtype=[("normal", "<3f4"), ("at", "<9f4"), ("end", "<u2")])
    record["at"] = triangles.reshape(-1, 9)
    path.write_bytes(bytes(80) + np.uint32(len(triangles)).tobytes() + record.tobytes())


def there_and_back(fields: dict[str, Any], backwards: dict[str, Any]) -> dict[str, Any]:
    """Return a cycle of two moves: a problem with a given goal, and the same the other way round.

    Args:
        fields: The problem.
        backwards: The problem the other way round.
    """
    shared = ("robot", "start", "obstacles", "clearance")
    header = {key: fields[key] for key in shared if key in fields}
    moves = [
        {"name": "there", "tube": fields["tube"], "goal": fields["goal"]},
        {"name": "back", "tube": backwards["tube"], "goal": backwards["goal"]},
    ]
    return {"format": "tubeplanner/cycle", **header, "moves": moves}
