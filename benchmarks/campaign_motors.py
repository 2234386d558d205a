"""Random motors for the campaign: rotors, friction, torque-speed lines, other efforts each way."""

from typing import Any

import numpy as np

from outside.arm import Arm

# Shares of the effort limit that friction takes, viscous at the velocity limit; of the effort limit
# at twenty times the velocity limit per second, what rotors take.
VISCOUS, COULOMB, ARMATURE = 0.3, 0.2, 1.0
SPEED, RATE = 3.0, 20.0  # [rad/s or m/s] where there is no velocity limit; [1/s]
STALL, NO_LOAD = (0.8, 2.0), (1.0, 2.5)  # in effort and velocity limits
LEAST_SIDE = 0.6  # of the effort limit


def vary_motors(rng: np.random.Generator, robot: dict[str, Any], arm: Arm) -> None:
    """Give the section `robot` of a problem motors, and effort limits that differ, in place.

    Joints without a limit on the effort get friction in multiples of 1 N m or N.
    """
    effort, velocity = arm.limits.effort, arm.limits.velocity
    effort = np.where(np.isfinite(effort), effort, 1.0)
    velocity = np.where(np.isfinite(velocity), velocity, SPEED)
    most = {
        "armature": ARMATURE * effort / (RATE * velocity),
        "viscous_friction": VISCOUS * effort / velocity,
        "coulomb_friction": COULOMB * effort,
    }
    motors: dict[str, Any] = {}
    for quantity, largest in most.items():
        if rng.random() < 0.7:
            chosen = [largest * rng.random(len(largest)) for _ in range(2)]
            motors[quantity] = {
                name: _either(rng, quantity == "coulomb_friction", *pair)
                for name, *pair in zip(arm.joint_names, *chosen, strict=True)
                if rng.random() < 0.8
            }
    if rng.random() < 0.4:
        with_line = [k for k in range(len(effort)) if rng.random() < 0.7]
        names = [arm.joint_names[k] for k in with_line]
        stall = effort[with_line] * rng.uniform(*STALL, len(names))
        no_load = velocity[with_line] * rng.uniform(*NO_LOAD, len(names))
        motors["saturation_effort"] = dict(zip(names, stall.tolist(), strict=True))
        motors["no_load_velocity"] = dict(zip(names, no_load.tolist(), strict=True))
    if rng.random() < 0.3:
        motors["friction_uncertainty"] = float(rng.uniform(0.0, 0.4))
    robot["motors"] = motors
    _vary_efforts(rng, robot, arm)


def _either(
    rng: np.random.Generator, may_differ: bool, one: float, other: float
) -> float | list[float]:
    """Return a number, or two for both directions."""
    return [float(one), float(other)] if may_differ and rng.random() < 0.5 else float(one)


def _vary_efforts(rng: np.random.Generator, robot: dict[str, Any], arm: Arm) -> None:
    """Make the efforts of some joints differ by direction, or with the position, in place."""
    scale = robot.get("limits", {}).get("scale", {}).get("effort", 1.0)
    limits = robot.setdefault("limits", {})
    given = limits.setdefault("effort", {})
    for name, most in zip(arm.joint_names, arm.limits.effort, strict=True):
        draw = rng.random()
        if not np.isfinite(most) or draw > 0.4:
            continue
        own = most / scale * rng.uniform(LEAST_SIDE, 1.0, 4)
        if draw < 0.2:
            given[name] = own[:2].tolist()
        else:
            position = np.sort(rng.uniform(-2.0, 2.0, 4)) + 0.01 * np.arange(4)
            given[name] = {"position": position.tolist(), "effort": own.tolist()}
