"""One condition of a certificate: its margin, its place, what the margin covers."""

from dataclasses import dataclass
from typing import Any

from tubeplanner.errors import OptionError, shown
from tubeplanner.options import NUMBER
from tubeplanner.outcome import MARGIN_TOLERANCE, Place

FOR_ALL_TIMES = "for all t"
RELATIVE = "relative"
# Bounds farther apart than this, absolute [m] and as a share of the margin, are left undecided.
_UNDECIDED_LENGTH, _UNDECIDED_SHARE = 1e-6, 0.05


@dataclass(frozen=True)
class Tolerance:
    """How far below zero a margin may lie.

    Attributes:
        absolute: For margins in m, rad and s, >= 0.
        relative: For relative margins, >= 0.
    """

    absolute: float = MARGIN_TOLERANCE
    relative: float = MARGIN_TOLERANCE

    def __post_init__(self) -> None:
        for name in ("absolute", "relative"):
            value = getattr(self, name)
            if not (isinstance(value, NUMBER) and 0 <= value < 1):
                raise OptionError(f"tolerance: {name} is {shown(value)}, not in [0, 1)")

    def of(self, unit: str) -> float:
        """Return the tolerance that belongs to a unit."""
        return self.relative if unit == RELATIVE else self.absolute


# For trajectories made elsewhere: rounded numbers, samples.
FOREIGN_TOLERANCE = Tolerance(1e-4, 1e-3)


@dataclass(frozen=True)
class JudgedCondition:
    """One condition of a certificate.

    Attributes:
        margin: Distance to a violation: negative where violated, None where the condition does not
            apply.
        unit: "m", "rad" or "relative"; "s" where a cycle rests.
        where: Where the margin is smallest.
        coverage: "for all t", and whether that is undecided because bounds stayed apart; or why
            there is no margin; or what was compared.
    """

    margin: float | None
    unit: str
    where: Place
    coverage: str

    def holds(self, tolerance: Tolerance) -> bool:
        """Return whether the condition holds, or does not apply."""
        return self.margin is None or self.margin >= -tolerance.of(self.unit)

    def as_dict(self, tolerance: Tolerance) -> dict[str, Any]:
        """Return the condition as JSON values, judged with a tolerance."""
        return {
            "margin": self.margin,
            "unit": self.unit,
            "satisfied": self.holds(tolerance),
            "where": self.where.as_dict(),
            "coverage": self.coverage,
        }


def not_required(unit: str, reason: str) -> JudgedCondition:
    """Return a condition that does not apply."""
    return JudgedCondition(None, unit, Place(), reason)


def bracketed(margin: float, attained: float, unit: str, where: Place) -> JudgedCondition:
    """Return a condition that holds for all t, undecided if its bounds are far apart.

    Args:
        margin: Lower bound of the margin.
        attained: A margin that the trajectory has, in the same unit.
        unit: "m" or "rad".
        where: Where the margin is smallest.
    """
    allowed = max(_UNDECIDED_LENGTH, _UNDECIDED_SHARE * abs(attained))
    coverage = FOR_ALL_TIMES if margin >= attained - allowed else undecided(attained, unit)
    return JudgedCondition(margin, unit, where, coverage)


def undecided(attained: float, unit: str) -> str:
    """Return the coverage of a margin whose bounds are far apart."""
    return f"{FOR_ALL_TIMES}, undecided: the margin found is {attained:.3g} {unit}"
