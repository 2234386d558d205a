"""What every limit on a trajectory's speed tells: phases, time scaling and plots know no other."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.constraints.path_samples import PathSamples
from tubeplanner.constraints.speed_polynomial import SpeedPolynomial
from tubeplanner.outcome import Infeasible


@dataclass(frozen=True)
class LimitKey:
    """What a limit is called.

    Attributes:
        kind: Such as "effort", "velocity", "radius".
        joint: Index of the joint that it limits; None if it is a segment's or the goal's.
        segment: Index of the segment; None if it is a joint's or the goal's.
        link: Name of the link whose point it limits; None: of none.
        point: Index of that point among those that are limited.
    """

    kind: str
    joint: int | None = None
    segment: int | None = None
    link: str | None = None
    point: int | None = None


class SpeedLimit(Protocol):
    """A limit of I quantities that grow with the speed s = dx/dt at which a path q(x) is run.

    Quantities are shares of nominal limits, and sign * quantity <= 1. Where a limit L depends on
    the configuration, what is used is used / nominal + 1 - L / nominal: L may be 0.
    """

    @property
    def kind(self) -> str:
        """What certificate, sensitivities and figures call it."""
        ...

    @property
    def order(self) -> int:
        """The highest derivative of q(x) that the quantities depend on."""
        ...

    @property
    def keys(self) -> tuple[LimitKey, ...]:
        """What can be raised or lowered, each on its own."""
        ...

    @property
    def signs(self) -> tuple[float, ...]:
        """Of the sides that are bounded."""
        ...

    def used(self, at: PathSamples) -> SpeedPolynomial:
        """Return the quantities at any speed, terms of shape (N, I)."""
        ...

    def by_path(self, at: PathSamples, speed: float) -> Mapping[int, FloatArray]:
        """Return how the quantities change with q (0) and its derivatives by x, each (N, I, n)."""
        ...

    def key_of(self, at: PathSamples) -> IntArray:
        """Return which of the keys each quantity belongs to, shape (N, I) or (1, I)."""
        ...

    def refusal(self, at: PathSamples) -> Infeasible:
        """Return why no speed is slow enough at some sample, where that is so."""
        ...
