"""A random contact whose part the witness holds at rest everywhere, with something more.

Trays and liquids stand upright on the way as well as the witness's turns let them; cups and
grippers hold in any orientation, with a force drawn in multiples of the least.
"""

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from campaign_witness import Witness
from outside.arm import Arm

MASS, HEIGHT = (0.05, 2.0), (0.01, 0.1)  # [kg], [m] of the part's centre above its contact
TIMES = (1.5, 6.0)  # of what the witness needs at rest
MAX_LEAN = np.radians(40)  # of a tray or an open vessel
GRAVITY = 9.81  # [m/s^2]
RADIUS = (0.005, 0.03)  # [m] of cups and pads
FRICTION = (0.2, 0.9)


def random_holding(
    rng: np.random.Generator, robot: dict[str, Any], arm: Arm, witness: Witness
) -> dict[str, Any] | None:
    """Return the section `holding` of a problem file; None where nothing can be held.

    Args:
        rng: Random numbers.
        robot: The section `robot`; it gets a payload of the part's mass if it has none.
        arm: The arm.
        witness: What solves the problem.
    """
    gravity = np.array(robot.get("gravity", [0, 0, -GRAVITY]), dtype=float)
    if not gravity.any():
        return None
    turned = Rotation.from_euler("xyz", robot.get("tool_offset", {}).get("rpy", [0, 0, 0]))
    frame = arm.tool(witness.q)[0] @ turned.as_matrix().T
    up = -gravity @ frame / np.linalg.norm(gravity)  # in the tool frame, by row
    mass, height = (float(np.exp(rng.uniform(*np.log(bounds)))) for bounds in (MASS, HEIGHT))
    mass = min(mass, robot.setdefault("payload", {"mass": mass})["mass"])
    kind = str(rng.choice(["cup", "gripper", "tray", "liquid"]))
    if kind in ("tray", "liquid"):
        return _upright(rng, kind, up, mass, height)
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    position = rng.uniform(-0.05, 0.05, 3)
    com = position + height * (normal if kind == "cup" else rng.normal(size=3) / 3)
    friction, radius = float(rng.uniform(*FRICTION)), float(rng.uniform(*RADIUS))
    weight = mass * np.linalg.norm(gravity)
    # Slides and tips, in any orientation: the sum of both is enough.
    arms = np.linalg.norm(com - position) / radius
    least = weight * (1 + 1 / friction + 2 * arms / friction + arms)
    contact = {
        "force": float(least * np.exp(rng.uniform(*np.log(TIMES)))),
        "friction": friction,
        "safety": float(rng.choice([1.0, 1.5])),
        "position": position.tolist(),
    }
    if kind == "cup":
        contact |= {"radius": radius, "normal": normal.tolist()}
    else:
        contact |= {"pad": [2 * radius, 2 * radius], "closing": normal.tolist()}
        contact["torsion"] = radius
    return {"part": _part(rng, mass, com, height), kind: contact}


def _upright(
    rng: np.random.Generator, kind: str, up: np.ndarray, mass: float, height: float
) -> dict[str, Any] | None:
    """Return a tray or a liquid, given the upward directions (N, 3) in the tool frame."""
    normal = up.mean(axis=0)
    if np.linalg.norm(normal) < 0.1:
        return None
    normal /= np.linalg.norm(normal)
    lean = float(np.arccos(np.clip(up @ normal, -1, 1)).max())
    if lean > MAX_LEAN:
        return None
    # Of the slope at which it would slide, tip or spill.
    slope = max(np.tan(lean), 0.02) * float(np.exp(rng.uniform(*np.log(TIMES))))
    if kind == "liquid":
        return {"liquid": {"tilt": float(min(np.arctan(slope), 1.2)), "normal": normal.tolist()}}
    safety = float(rng.choice([1.0, 1.2]))
    position = rng.uniform(-0.05, 0.05, 3)
    sides = 4 * height * slope * safety * np.exp(rng.uniform(0, 1, 2))
    tray = {
        "friction": float(2 * slope * safety),
        "foot": sides.tolist() if rng.random() < 0.7 else float(sides[0] / 2),
        "safety": safety,
        "position": position.tolist(),
        "normal": normal.tolist(),
    }
    return {"part": _part(rng, mass, position + height * normal, height), "tray": tray}


def _part(rng: np.random.Generator, mass: float, com: np.ndarray, size: float) -> dict[str, Any]:
    """Return the section `part` of a body about as large as a size [m]."""
    moments = mass * size**2 * rng.uniform(0.3, 0.5, 3)
    return {"mass": mass, "com": com.tolist(), "inertia": [*moments.tolist(), 0.0, 0.0, 0.0]}
