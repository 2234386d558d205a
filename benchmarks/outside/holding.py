"""Is what an arm holds by contact kept? Forces on masses at points, by differences of positions.

A contact's axes are z, from the tool into the part, x, the tool frame's x made perpendicular to z,
or its y where they are parallel, and y. In these axes, about the contact's middle, the tool's force
f and moment t on the part must be in the contact's cones. d is the moment about a height: that of
the centre of mass on the axis of a cup or a gripper, the centre of mass itself on a tray.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from outside.arm import Arm
from outside.conditions import RELATIVE, Condition, margin_of
from outside.files import BadInput, require_known
from outside.trajectory import Samples, Trajectory

G = 9.81  # [m/s^2]: cones have their size on earth
STEP = 3e-4  # [rad, m]: how far joints move between the positions of a difference, or less
STENCIL = np.array([-1.0, 16.0, -30.0, 16.0, -1.0]) / 12  # second derivative, to the fourth order
FAR = 0.1  # [m]: how far from the centre of mass the masses are that turn
NEAR_FRACTION = 0.01  # relative: where steps are divided
MOST_NEAR = 100  # samples beside which they are
PARTS = 20  # into so many
FLAT = 0.6127  # radii over the friction: below, the twist counts without direction
KINDS = {
    "cup": {"force", "radius", "diameter", "vacuum", "friction", "safety", "position", "normal"},
    "tray": {"friction", "foot", "safety", "position", "normal"},
    "gripper": {"force", "friction", "pad", "torsion", "safety", "position", "closing"},
    "liquid": {"tilt", "position", "normal"},
}
SAFETY = {"cup": 1.5, "tray": 1.2, "gripper": 2.0}


@dataclass(frozen=True, eq=False)
class Held:
    """A part and its contact, in the tool frame.

    Attributes:
        kind: "cup", "tray", "gripper" or "liquid".
        fields: Of the contact, safety filled in.
        mass: Of the part [kg].
        points: Masses at points that move as the part does, shape (7, 3) [m].
        masses: Of these, shape (7,) [kg]; some may be negative.
        frame: The contact's middle and the ends of its axes, shape (4, 3) [m].
        com: The centre of mass in the contact's axes, shape (3,) [m].
    """

    kind: str
    fields: dict[str, Any]
    mass: float
    points: np.ndarray
    masses: np.ndarray
    frame: np.ndarray
    com: np.ndarray


def read_holding(given: Any) -> list[Held]:
    """Return what the field `holding` of a problem asks.

    Raises:
        BadInput: It has no contact, several, or a field that is not known here.
    """
    return [_held(each) for each in (given if isinstance(given, list) else [given] * bool(given))]


def judge_holding(
    holding: list[Held], arm: Arm, trajectory: Trajectory, samples: Samples
) -> Condition:
    """Return how far inside their cones all wrenches are, at speed and at rest.

    Steps beside the samples that are within 1 % of the worst margin are divided, at most so many.
    """
    if not holding:
        return Condition(None, RELATIVE)
    found = []
    for held in holding:
        margins = _margins(held, arm, trajectory, samples)
        least = np.min([each for _, each in margins], axis=0)
        near = least < least.min() + NEAR_FRACTION * max(1.0, abs(least.min()))
        rows = np.argsort(least)[: min(MOST_NEAR, int(near.sum()))]
        finer = samples.between(np.concatenate([rows - 1, rows]), PARTS)
        parts = [(samples, margins)]
        if len(finer):
            parts.append((finer, _margins(held, arm, trajectory, finer)))
        for where, each in parts:
            for what, margin in each:
                worst = int(margin.argmin())
                time = float(where.time[worst])
                found.append(Condition(float(margin[worst]), RELATIVE, time, f"{held.kind} {what}"))
    return min(found, key=margin_of)


def _held(given: Any) -> Held:
    require_known(given, {"part", *KINDS}, "holding.")
    kinds = [kind for kind in KINDS if given.get(kind) is not None]
    if len(kinds) != 1:
        raise BadInput(f"holding: one of {', '.join(KINDS)} is needed")
    kind, fields = kinds[0], given[kinds[0]]
    require_known(fields, KINDS[kind], f"holding.{kind}.")
    middle = np.array(fields.get("position", [0.0] * 3), dtype=float)
    part = given.get("part") or {"mass": 1.0, "com": middle.tolist()}
    if kind == "liquid":
        part = {"mass": 1.0, "com": middle.tolist()}
    require_known(part, {"mass", "com", "inertia"}, "holding.part.")
    normal = fields.get("closing", [1.0, 0, 0]) if kind == "gripper" else fields.get("normal")
    axes = _axes(np.array(normal or [0.0, 0.0, 1.0], dtype=float))
    mass, com = float(part["mass"]), np.array(part.get("com", [0.0] * 3), dtype=float)
    xx, yy, zz, xy, xz, yz = part.get("inertia", [0.0] * 6)
    principal, own = np.linalg.eigh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    pairs = (principal.sum() / 2 - principal) / (2 * FAR**2)
    points = com + np.vstack([np.zeros(3), FAR * own.T, -FAR * own.T])
    masses = np.concatenate([[mass - 2 * pairs.sum()], pairs, pairs])
    frame = np.vstack([middle, middle + axes])
    filled = {"safety": SAFETY.get(kind, 1.0)} | fields
    if "diameter" in fields:
        filled["radius"] = fields["diameter"] / 2
    if "vacuum" in fields:
        filled["force"] = fields["vacuum"] * np.pi * filled["radius"] ** 2
    return Held(kind, filled, mass, points, masses, frame, axes @ (com - middle))


def _axes(normal: np.ndarray) -> np.ndarray:
    """Return the axes of a contact as rows, shape (3, 3)."""
    z = normal / np.linalg.norm(normal)
    x = np.array([1.0, 0.0, 0.0])
    if np.linalg.norm(np.cross(x, z)) < 1e-6:
        x = np.array([0.0, 1.0, 0.0])
    y = np.cross(z, x)
    y /= np.linalg.norm(y)
    return np.array([np.cross(y, z), y, z])


def _margins(
    held: Held, arm: Arm, trajectory: Trajectory, samples: Samples
) -> list[tuple[str, np.ndarray]]:
    """Return what happens beyond each cone and the margins (N,) there, at speed and at rest."""
    # Of the joints' parabola at each sample, whose pieces may be shorter than any step.
    q, v, a = (trajectory.at(samples, order) for order in range(3))
    pace = np.maximum(abs(v).max(axis=1), np.sqrt(abs(a).max(axis=1)))
    step = (STEP / np.maximum(pace, 1.0))[:, None]
    shifted = [q + (v + a * h / 2) * h for h in (k * step for k in range(-2, 3))]
    places = np.array([arm.points(each, held.points) for each in shifted])
    acceleration = np.tensordot(STENCIL, places, axes=1) / step[:, None] ** 2
    origin, *ends = arm.points(q, held.frame).swapaxes(0, 1)
    axes = np.stack([end - origin for end in ends], axis=1)
    arms = places[2] - origin[:, None]
    found = []
    for ending, rate in (("", acceleration), (", at rest", 0 * acceleration)):
        each = held.masses[:, None] * (rate - arm.gravity)
        both = each.sum(axis=1), np.cross(arms, each).sum(axis=1)
        force, moment = (np.einsum("nij,nj->ni", axes, vector) for vector in both)
        cones = _cones(held, force, moment)
        found += [(what + ending, margin) for what, margin in cones]
    return found


def _cones(held: Held, f: np.ndarray, t: np.ndarray) -> list[tuple[str, np.ndarray]]:
    """Return what happens beyond each cone and the margins (N,), as shares of its size."""
    fields, weight, safety = held.fields, held.mass * G, float(held.fields["safety"])
    across, pressed = np.hypot(f[:, 0], f[:, 1]), f[:, 2]
    if held.kind == "liquid":
        slope = np.tan(fields["tilt"])
        return [("spills", (slope * pressed - across) / (slope * weight))]
    mu = float(fields["friction"]) / (safety if held.kind == "tray" else 1.0)
    height = held.com if held.kind == "tray" else held.com * [0, 0, 1]
    d = t - np.cross(height, f)
    h = abs(d[:, 2]) + mu * (abs(d[:, 0]) + abs(d[:, 1]))
    tipping = np.hypot(t[:, 0], t[:, 1])

    def sliding(rho: float) -> np.ndarray:
        """Return the force across with what the twist takes of the friction."""
        return _twisted(f[:, :2], mu * d[:, :2] / (2 * rho), d[:, 2] / (2 * rho))

    def tipped(r: float, away: float, z: float) -> np.ndarray:
        """Return the moment with what is pressed below the centre of mass for the twist."""
        share = 1.25 * (r + away) / (mu * (r - away))
        if away > 1e-9 or mu * z <= FLAT * r:
            return tipping + share * h
        lean = share * r / z * np.column_stack([-d[:, 1], d[:, 0]])
        return _twisted(t[:, :2], lean, share * d[:, 2])

    if held.kind == "cup":
        pull, r = fields["force"] / safety, fields["radius"]
        slides = mu * (pressed + pull) - sliding(r)
        tips = r * (pressed + pull) - tipped(r, 0.0, held.com[2])
        return [("slides", slides / (mu * pull)), ("tips", tips / (r * pull))]
    if held.kind == "gripper":
        press, sides = fields["force"] / safety, np.array(fields["pad"]) / 2
        rho = min(fields.get("torsion", 0.01), 0.75 * sides.min())
        slides = 2 * mu * press - mu * abs(pressed) - np.hypot(across, h / rho)
        bent = np.hypot(t[:, 0] / sides[1], t[:, 1] / sides[0])
        tips = press - abs(pressed) / 2 - bent
        return [("slides", slides / (2 * mu * press)), ("tips", tips / press)]
    pressed = pressed - (1 - 1 / safety) * weight
    if isinstance(fields["foot"], int | float):
        r, away = fields["foot"] / safety, float(np.hypot(*held.com[:2]))
        slides = mu * pressed - sliding(r - away)
        kept = away * (1 - 1 / safety) * weight
        tips = r * pressed - kept - tipped(r, away, held.com[2])
        return [("slides", slides / (mu * weight)), ("tips", tips / (r * weight))]
    half = np.array(fields["foot"]) / 2 / safety
    rho = float((half - abs(held.com[:2])).min())
    found = [("slides", (mu * pressed - sliding(rho)) / (mu * weight))]
    twist = np.sqrt(2) * 1.25 / (mu * rho) * np.linalg.norm(d * [mu, mu, 1], axis=1)
    # The weight that is kept presses below the centre of mass: the rest, where its moment is.
    kept = (1 - 1 / safety) * weight
    for axis, moment in ((0, -t[:, 1]), (1, t[:, 0])):
        rest = moment - kept * held.com[axis]
        for side in (1.0, -1.0):
            reach = half[axis] - side * held.com[axis]
            margin = half[axis] * pressed - side * rest - reach * twist
            found.append(("tips", margin / (half[axis] * weight)))
    return found


def _twisted(across: np.ndarray, change: np.ndarray, twist: np.ndarray) -> np.ndarray:
    """Return the largest |across + p change| + twist and |across - p change| - twist, p 0 or 1."""
    pairs = ((sign, sign * part) for sign in (1.0, -1.0) for part in (0.0, 1.0))
    each = [np.linalg.norm(across + k * change, axis=1) + sign * twist for sign, k in pairs]
    return np.max(each, axis=0)
