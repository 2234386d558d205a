"""A certificate: every condition a trajectory must meet, with margin, place and coverage."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from tubeplanner.collision.collision_checker import LeftOutPair
from tubeplanner.verification.conditions import CONDITION_NAMES
from tubeplanner.verification.judged_condition import RELATIVE, JudgedCondition, Tolerance


@dataclass(frozen=True)
class Certificate:
    """The judgement of one trajectory.

    Attributes:
        conditions: By name, in the order of `CONDITION_NAMES`.
        tolerance: How far below zero margins may lie.
        left_out: Pairs of solids that were not checked against each other, and why.
    """

    conditions: Mapping[str, JudgedCondition]
    tolerance: Tolerance
    left_out: tuple[LeftOutPair, ...] = ()

    def __post_init__(self) -> None:
        ordered = {name: self.conditions[name] for name in CONDITION_NAMES}
        object.__setattr__(self, "conditions", MappingProxyType(ordered))

    def __reduce__(self) -> tuple[Any, ...]:
        return Certificate, (dict(self.conditions), self.tolerance, self.left_out)

    @property
    def passed(self) -> bool:
        """Whether every condition holds."""
        return not self.failures()

    def failures(self) -> list[str]:
        """Return the names of the conditions that do not hold."""
        return [
            name
            for name, condition in self.conditions.items()
            if not condition.holds(self.tolerance)
        ]

    def describe(self, name: str) -> str:
        """Return one line about a condition: margin, unit, place."""
        condition = self.conditions[name]
        if condition.margin is None:
            return f"{name}: not required ({condition.coverage})"
        unit = "" if condition.unit == RELATIVE else f" {condition.unit}"
        place = str(condition.where)
        return f"{name}: margin {condition.margin:.3g}{unit}" + (f" ({place})" if place else "")

    def as_dict(self) -> dict[str, Any]:
        """Return the certificate as JSON values."""
        return {
            "passed": self.passed,
            "tolerance": {
                "absolute": self.tolerance.absolute,
                "relative": self.tolerance.relative,
            },
            "conditions": {
                name: {
                    "margin": condition.margin,
                    "unit": condition.unit,
                    "satisfied": condition.holds(self.tolerance),
                    "where": condition.where.as_dict(),
                    "coverage": condition.coverage,
                }
                for name, condition in self.conditions.items()
            },
            "left_out": [
                {"links": list(pair.links), "reason": pair.reason} for pair in self.left_out
            ],
        }
