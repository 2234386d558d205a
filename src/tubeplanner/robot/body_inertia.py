"""Mass properties of a rigid body."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tubeplanner.arrays import FloatArray, read_only


@dataclass(frozen=True, eq=False)
class BodyInertia:
    """Mass properties of a body, in its frame.

    Attributes:
        mass: [kg].
        com: Centre of mass, shape (3,) [m].
        inertia: About the centre of mass, shape (3, 3) [kg m^2].
    """

    mass: float
    com: FloatArray
    inertia: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "mass", float(self.mass))
        object.__setattr__(self, "com", read_only(self.com))
        object.__setattr__(self, "inertia", read_only(self.inertia))

    @cached_property
    def com_distance(self) -> float:
        """Distance of the centre of mass from the body's origin [m]."""
        return float(np.linalg.norm(self.com))

    @cached_property
    def moment(self) -> float:
        """Largest principal moment about the centre of mass [kg m^2]."""
        return float(np.linalg.eigvalsh(self.inertia).max())

    def scaled(self, factor: float) -> "BodyInertia":
        """Return a body of the same shape that is denser by a factor."""
        return BodyInertia(factor * self.mass, self.com, factor * self.inertia)

    def shifted(self, by: FloatArray) -> "BodyInertia":
        """Return the body with its mass moved by a vector (3,) [m]."""
        return BodyInertia(self.mass, self.com + by, self.inertia)

    def placed(self, placement: FloatArray) -> "BodyInertia":
        """Return the body's properties in another frame, in which its own has a pose (4, 4)."""
        rotation, origin = placement[:3, :3], placement[:3, 3]
        turned = rotation @ self.inertia @ rotation.T
        return BodyInertia(self.mass, origin + rotation @ self.com, turned)

    def plus(self, other: "BodyInertia") -> "BodyInertia":
        """Return both bodies as one (parallel axis theorem); a negative mass takes one away."""
        mass = self.mass + other.mass
        if mass == 0.0:
            return BodyInertia(0.0, self.com, self.inertia + other.inertia)
        com = (self.mass * self.com + other.mass * other.com) / mass
        inertia = sum(
            part.inertia + part.mass * (away @ away * np.eye(3) - np.outer(away, away))
            for part in (self, other)
            for away in [part.com - com]
        )
        return BodyInertia(mass, com, np.asarray(inertia))
