"""JointMotors, resolved: rotor inertia, friction, torque-speed lines."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, read_only
from tubeplanner.errors import RobotError
from tubeplanner.robot.limit_layers import GivenLimits, layers_of, merged_motors, merged_scale
from tubeplanner.robot.overrides import CURVE
from tubeplanner.robot.urdf import UrdfDescription, UrdfJoint, followers_of
from tubeplanner.text import short_repr

# ---- The friction that a URDF states: <dynamics damping friction>.

# What the file calls them, as `unused_values` does, and the field of `robot.motors` that serves.
URDF_FRICTION = {
    "dynamics damping": "viscous_friction",
    "dynamics friction": "coulomb_friction",
}


def urdf_friction(
    description: UrdfDescription, joint_names: Sequence[str]
) -> tuple[FloatArray, FloatArray]:
    """Return the friction of joints and of what follows them, as felt at these joints.

    Args:
        description: The robot.
        joint_names: Its planning group.

    Returns:
        Viscous friction [N m s/rad or N s/m] and Coulomb friction [N m or N], shape (n,) each.

    Raises:
        RobotError: The file states what is no number, infinite or negative.
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
        viscous[column] += ratio**2 * _stated(description, joint, "dynamics damping")
        coulomb[column] += ratio * _stated(description, joint, "dynamics friction")
    return viscous, coulomb


def _stated(description: UrdfDescription, joint: UrdfJoint, what: str) -> float:
    text = joint.unused.get(what, "0")
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not 0 <= value < np.inf:
        raise RobotError(
            f"{description.path}: joint '{joint.name}' has <{what}> {text}; it must be a number "
            f">= 0: mend it, or leave robot.motors.friction_from_urdf out and give "
            f"robot.motors.{URDF_FRICTION[what]}"
        )
    return value


# ---- What the motors of the joints add to the rigid arm: rotors, friction, less effort at speed.


@dataclass(frozen=True, eq=False)
class JointMotors:
    """The motors of n joints, in group order, as felt at the joints.

    The effort that a motor gives is what the rigid arm needs, armature times acceleration, viscous
    friction times velocity, and Coulomb friction against the direction of motion. At a velocity v
    it has no more than saturation_effort (1 - v / no_load_velocity) forwards, and backwards
    saturation_effort (1 + v / no_load_velocity).

    Attributes:
        armature: Inertia of the rotors at the joints, shape (n,) [kg m^2 or kg].
        viscous_friction: Shape (n,) [N m s/rad or N s/m].
        backwards_friction: Coulomb friction where the velocity is negative, >= 0, shape (n,)
            [N m or N].
        forwards_friction: Likewise where it is positive.
        saturation_effort: Effort at which the motor stalls, shape (n,) [N m or N]; inf where no
            torque-speed line is known.
        no_load_velocity: Velocity at which that line has no effort left, shape (n,) [rad/s or m/s];
            inf likewise.
        friction_uncertainty: By which share friction may be more or less than that.
    """

    armature: FloatArray
    viscous_friction: FloatArray
    backwards_friction: FloatArray
    forwards_friction: FloatArray
    saturation_effort: FloatArray
    no_load_velocity: FloatArray
    friction_uncertainty: float = 0.0

    __repr__ = short_repr

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            if name != "friction_uncertainty":
                object.__setattr__(self, name, read_only(getattr(self, name)))

    @classmethod
    def ideal(cls, count: int) -> "JointMotors":
        """Return motors without inertia and friction, which have their effort at any speed."""
        none, endless = np.zeros(count), np.full(count, np.inf)
        return cls(none, none, none, none, endless, endless)

    @property
    def has_coulomb_friction(self) -> bool:
        """Whether any joint has some."""
        return bool(self.backwards_friction.any() or self.forwards_friction.any())

    @property
    def has_viscous_friction(self) -> bool:
        """Whether any joint has some."""
        return bool(self.viscous_friction.any())

    @property
    def has_friction(self) -> bool:
        """Whether any joint has some, of either kind."""
        return self.has_coulomb_friction or self.has_viscous_friction

    @property
    def has_curve(self) -> BoolArray:
        """Which joints have a torque-speed line, shape (n,)."""
        return np.isfinite(self.saturation_effort)

    @property
    def has_less_at_speed(self) -> bool:
        """Whether viscous friction or a torque-speed line takes effort from a joint that turns."""
        return self.has_viscous_friction or bool(self.has_curve.any())

    def coulomb_effort(self, direction: FloatArray) -> FloatArray:
        """Return the efforts against Coulomb friction, shape (N, n) [N m or N].

        Args:
            direction: Whose sign tells which way joints move, (N, n); 0: they stand still.
        """
        forwards = np.where(direction > 0, self.forwards_friction, 0.0)
        return np.where(direction < 0, -self.backwards_friction, forwards)


def resolve_motors(
    description: UrdfDescription, joint_names: Sequence[str], limits: GivenLimits
) -> JointMotors:
    """Return the motors of the joints of a planning group, ideal where nothing is given.

    Args:
        description: The robot.
        joint_names: Its planning group.
        limits: Limits and motors, the later ones above; their factor on the effort scales the
            stall effort too.

    Raises:
        RobotError: A joint has one end of a torque-speed line without the other, is unknown or has
            no motor, there is not one value per joint, or the URDF's friction is taken and absurd.
    """
    layers = layers_of(limits)
    followers = followers_of(description, joint_names)
    merged = merged_motors(description, joint_names, followers, layers)
    below = np.zeros((2, len(joint_names)))  # viscous and Coulomb friction where none is given
    if merged.friction_from_urdf:
        below[:] = urdf_friction(description, joint_names)
    names, given = list(joint_names), merged.by_joint
    backwards, forwards = _replaced(
        np.array([below[1], below[1]]), names, given["coulomb_friction"]
    )
    no_line = np.full(len(names), np.inf)
    stall, no_load = (_replaced(no_line, names, given[end]) for end in CURVE)
    _require_whole_lines(names, stall, no_load)
    return JointMotors(
        _replaced(np.zeros(len(names)), names, given["armature"]),
        _replaced(below[0], names, given["viscous_friction"]),
        backwards,
        forwards,
        stall * merged_scale(layers).get("effort", 1.0),
        no_load,
        merged.friction_uncertainty,
    )


def _replaced(
    values: FloatArray, joint_names: Sequence[str], given: Mapping[str, Any]
) -> FloatArray:
    """Return values (..., n) of joints, those of some replaced by what is given of them."""
    replaced = values.copy()
    for column, name in enumerate(joint_names):
        if name in given:
            replaced[..., column] = given[name]
    return replaced


def _require_whole_lines(
    joint_names: Sequence[str], stall: FloatArray, no_load: FloatArray
) -> None:
    for name, *ends in zip(joint_names, stall, no_load, strict=True):
        known = np.isfinite(ends)
        if known.any() and not known.all():
            has, lacks = np.array(CURVE)[np.argsort(~known)]
            raise RobotError(
                f"robot.motors: joint '{name}' has {has} {min(ends):g} and no {lacks}; a "
                f"torque-speed line needs both: give robot.motors.{lacks}, or .inf as {has}"
            )
