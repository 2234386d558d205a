"""Limits that depend on where a joint is, or hold for a point of the arm."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from outside.files import BadInput

LAW = {"deceleration", "offset", "lower", "upper"}
POINT = {"link", "position", "speed"}


@dataclass(frozen=True)
class Law:
    """A velocity limit that falls towards both ends of a joint's range.

    Attributes:
        joint: Index of the joint.
        deceleration: [rad/s^2 or m/s^2].
        offset: [rad/s or m/s].
        lower: [rad or m].
        upper: [rad or m].
    """

    joint: int
    deceleration: float
    offset: float
    lower: float
    upper: float

    def margin(self, q: np.ndarray, v: np.ndarray, most: float) -> np.ndarray:
        """Return what is left at positions and velocities (N,), as a share, shape (N,).

        Args:
            q: The joint's [rad or m].
            v: Likewise [rad/s or m/s].
            most: Its velocity limit, infinite if there is none.
        """
        gap = np.where(v > 0, self.upper - q, q - self.lower)
        allowed = -self.offset + np.sqrt(2 * self.deceleration * np.clip(gap, 0, None))
        left = np.clip(allowed, 0, None) - abs(v)
        whole = math.sqrt(2 * self.deceleration * (self.upper - self.lower))
        return left / (most if math.isfinite(most) else whole)


@dataclass(frozen=True)
class Point:
    """A point that moves with a link, and how fast it may move.

    Attributes:
        link: Which.
        position: In the link's frame [m].
        speed: [m/s].
    """

    link: str
    position: tuple[float, float, float]
    speed: float


def read_laws(given: Any, names: Sequence[str], lower: np.ndarray, upper: np.ndarray) -> list[Law]:
    """Return the laws of joints whose position limits are (n,) each.

    Raises:
        BadInput: One is of no joint, or is not complete.
    """
    rows = given or {}
    by_name = rows if isinstance(rows, dict) else dict(zip(names, rows, strict=True))
    if unknown := set(by_name) - set(names):
        raise BadInput(f"robot.limits.velocity_by_position: {unknown.pop()} is no joint")
    laws = []
    for joint, name in enumerate(names):
        if (fields := by_name.get(name)) is None:
            continue
        if unknown := set(fields) - LAW:
            raise BadInput(f"robot.limits.velocity_by_position: {unknown.pop()} is not known")
        ends = {"lower": lower[joint], "upper": upper[joint]}
        ends |= {key: fields[key] for key in ends if fields.get(key) is not None}
        both = (float(ends["lower"]), float(ends["upper"]))
        numbers = (float(fields["deceleration"]), float(fields["offset"]), *both)
        if not np.isfinite(numbers).all() or not numbers[0] > 0 or not both[0] < both[1]:
            raise BadInput(f"robot.limits.velocity_by_position: {name} has {fields}")
        laws.append(Law(joint, *numbers))
    return laws


def read_points(given: Any, links: set[str]) -> list[Point]:
    """Return the points whose speed is limited.

    Raises:
        BadInput: One is of no link, or is not complete.
    """
    points = []
    for fields in given or []:
        if set(fields) != POINT or fields["link"] not in links:
            raise BadInput(f"robot.limits.point_speed: {fields} is not known")
        x, y, z = map(float, fields["position"])
        if not float(fields["speed"]) > 0:
            raise BadInput(f"robot.limits.point_speed: {fields}")
        points.append(Point(fields["link"], (x, y, z), float(fields["speed"])))
    return points
