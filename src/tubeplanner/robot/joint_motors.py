"""What the motors of the joints add to the rigid arm: rotors, friction, less effort at speed."""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, read_only


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

    def coulomb_effort(self, direction: FloatArray) -> FloatArray:
        """Return the efforts against Coulomb friction, shape (N, n) [N m or N].

        Args:
            direction: Whose sign tells which way joints move, (N, n); 0: they stand still.
        """
        forwards = np.where(direction > 0, self.forwards_friction, 0.0)
        return np.where(direction < 0, -self.backwards_friction, forwards)
