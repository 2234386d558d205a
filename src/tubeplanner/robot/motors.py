"""JointMotors, resolved: rotor inertia, friction, torque-speed lines."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, read_only
from tubeplanner.errors import RobotError
from tubeplanner.robot.joint_limits import (
    GivenLimits,
    LimitLayer,
    MergedValues,
    chain_order,
    layers_of,
    merged_scale,
    require_known,
    uppermost,
)
from tubeplanner.robot.overrides import CURVE, MOTOR_QUANTITIES
from tubeplanner.robot.urdf import UrdfDescription, UrdfJoint, followers_of
from tubeplanner.text import short_repr

# ---- The friction of a URDF: <dynamics damping friction>.

# Fields of `robot.motors` by the URDF's names of the values, as in `unused_values`.
URDF_FRICTION = {"dynamics damping": "viscous_friction", "dynamics friction": "coulomb_friction"}


def urdf_friction(
    description: UrdfDescription, joint_names: Sequence[str]
) -> tuple[FloatArray, FloatArray]:
    """Return the friction of joints and of their followers, as felt at the joints.

    Returns:
        Viscous friction [N m s/rad or N s/m] and Coulomb friction [N m or N], shape (n,) each.
    """
    ratios = [(name, column, 1.0) for column, name in enumerate(joint_names)]
    ratios += [
        (name, list(joint_names).index(rule.master), abs(rule.multiplier))
        for name, rule in followers_of(description, joint_names).items()
    ]
    viscous, coulomb = np.zeros((2, len(joint_names)))
    for name, column, ratio in ratios:
        joint = description.joints[name]
        # A follower turns `ratio` times as fast, and its friction has that lever on its master.
        viscous[column] += ratio**2 * _friction_value(description, joint, "dynamics damping")
        coulomb[column] += ratio * _friction_value(description, joint, "dynamics friction")
    return viscous, coulomb


def _friction_value(description: UrdfDescription, joint: UrdfJoint, key: str) -> float:
    text = joint.unused.get(key, "0")
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not 0 <= value < np.inf:
        raise RobotError(
            f"{description.path}: joint '{joint.name}' has <{key}> {text}; it must be a number "
            f">= 0: mend it, or leave robot.motors.friction_from_urdf out and give "
            f"robot.motors.{URDF_FRICTION[key]}"
        )
    return value


# ---- Motors, beside the rigid arm: rotor inertia, friction, less effort at speed.


@dataclass(frozen=True, eq=False)
class JointMotors:
    """The motors of n joints, in group order, as felt at the joints.

    The effort of a motor is the sum of the rigid arm's effort, armature times acceleration, viscous
    friction times velocity, and Coulomb friction against the direction of motion. At a velocity v
    it is at most saturation_effort (1 - v / no_load_velocity) forwards, and backwards
    saturation_effort (1 + v / no_load_velocity).
    """

    armature: FloatArray  # inertia of the rotors at the joints, shape (n,) [kg m^2 or kg]
    viscous_friction: FloatArray  # shape (n,) [N m s/rad or N s/m]
    # Coulomb friction where the velocity is negative, and where it is positive, >= 0, shape (n,)
    backwards_friction: FloatArray  # [N m or N]
    forwards_friction: FloatArray  # [N m or N]
    # effort at which the motor stalls, shape (n,) [N m or N]; inf without a torque-speed line
    saturation_effort: FloatArray
    # velocity at which the torque-speed line is zero, shape (n,) [rad/s or m/s]; inf without one
    no_load_velocity: FloatArray
    friction_uncertainty: float = 0.0  # fraction by which friction may be more or less

    __repr__ = short_repr

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            if name != "friction_uncertainty":
                object.__setattr__(self, name, read_only(getattr(self, name)))

    @classmethod
    def ideal(cls, count: int) -> "JointMotors":
        """Return motors without inertia and friction, of the same effort at any speed."""
        none, endless = np.zeros(count), np.full(count, np.inf)
        return cls(none, none, none, none, endless, endless)

    @property
    def has_coulomb_friction(self) -> bool:
        """True if any joint has Coulomb friction."""
        return bool(self.backwards_friction.any() or self.forwards_friction.any())

    @property
    def has_viscous_friction(self) -> bool:
        """True if any joint has viscous friction."""
        return bool(self.viscous_friction.any())

    @property
    def has_friction(self) -> bool:
        """True if any joint has friction of either kind."""
        return self.has_coulomb_friction or self.has_viscous_friction

    @property
    def has_curve(self) -> BoolArray:
        """True if a joint has a torque-speed line, shape (n,)."""
        return np.isfinite(self.saturation_effort)

    @property
    def has_less_at_speed(self) -> bool:
        """True if viscous friction or a torque-speed line takes effort from any moving joint."""
        return self.has_viscous_friction or bool(self.has_curve.any())

    def coulomb_effort(self, direction: FloatArray) -> FloatArray:
        """Return the efforts against Coulomb friction, shape (N, n) [N m or N].

        Args:
            direction: Its sign is the direction of motion, shape (N, n); 0: at rest.
        """
        forwards = np.where(direction > 0, self.forwards_friction, 0.0)
        return np.where(direction < 0, -self.backwards_friction, forwards)


def merged_motors(
    description: UrdfDescription, joint_names: Sequence[str], layers: Sequence[LimitLayer]
) -> MergedValues:
    """Merge the motors of layers for the joints of a planning group."""
    chain = chain_order(description, joint_names)
    followers = followers_of(description, joint_names)
    names = MOTOR_QUANTITIES
    merged = MergedValues({name: {} for name in names}, {name: {} for name in names})
    for layer in layers:
        for quantity in names:
            where = f"{layer.label}motors.{quantity}"
            values = layer.motors.by_name(quantity, chain, where)
            for name in values:
                if name in followers:
                    master = followers[name].master
                    raise RobotError(
                        f"{where}: joint '{name}' follows '{master}' and has no motor of its own; "
                        f"give what '{master}' feels of it, or leave it out"
                    )
            require_known(where, values, joint_names)
            merged.by_joint[quantity] |= values
            merged.sources[quantity] |= dict.fromkeys(values, layer.source)
    return merged


def resolve_motors(
    description: UrdfDescription, joint_names: Sequence[str], limits: GivenLimits
) -> JointMotors:
    """Return the motors of the joints of a planning group, ideal without values."""
    layers, names = layers_of(limits), list(joint_names)
    values = merged_motors(description, names, layers).by_joint
    motors = [layer.motors for layer in layers]
    viscous, coulomb = np.zeros((2, len(names)))
    if uppermost((each.friction_from_urdf for each in motors), False):
        viscous, coulomb = urdf_friction(description, names)
    both_ways = np.array([coulomb, coulomb])
    backwards, forwards = _replaced(both_ways, names, values["coulomb_friction"])
    no_line = np.full(len(names), np.inf)
    stall, no_load = (_replaced(no_line, names, values[end]) for end in CURVE)
    for name, *ends in zip(names, stall, no_load, strict=True):
        is_finite = np.isfinite(ends)
        if is_finite.any() and not is_finite.all():
            has, lacks = np.array(CURVE)[np.argsort(~is_finite)]
            raise RobotError(
                f"robot.motors: joint '{name}' has {has} {min(ends):g} and no {lacks}; a "
                f"torque-speed line needs both: give robot.motors.{lacks}, or .inf as {has}"
            )
    return JointMotors(
        _replaced(np.zeros(len(names)), names, values["armature"]),
        _replaced(viscous, names, values["viscous_friction"]),
        backwards,
        forwards,
        stall * merged_scale(layers).get("effort", 1.0),
        no_load,
        float(uppermost((each.friction_uncertainty for each in motors), 0.0)),
    )


def _replaced(
    defaults: FloatArray, joint_names: Sequence[str], values: Mapping[str, Any]
) -> FloatArray:
    """Return defaults (..., n) of joints, replaced by values by name."""
    result = defaults.copy()
    for column, name in enumerate(joint_names):
        if name in values:
            result[..., column] = values[name]
    return result
