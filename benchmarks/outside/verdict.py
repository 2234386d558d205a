"""What the outside judge says of one condition."""

import math
from dataclasses import dataclass

RELATIVE = "relative"


@dataclass(frozen=True)
class Condition:
    """One condition's least margin.

    Attributes:
        margin: How far it is kept; None where it is not asked.
        unit: "m", "rad" or "relative".
        time: When it is least [s].
        where: Which joint, segment, links or obstacle.
    """

    margin: float | None
    unit: str
    time: float | None = None
    where: str = ""

    def holds(self, tolerance: float) -> bool:
        """Return whether it is kept, or broken by no more than a tolerance."""
        return self.margin is None or self.margin >= -tolerance


def margin_of(condition: Condition) -> float:
    """Return a condition's margin, infinite where it is not asked."""
    return math.inf if condition.margin is None else condition.margin
