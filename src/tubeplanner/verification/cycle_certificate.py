"""The judgement of a cycle: a certificate of every move, and what must hold where they meet."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from tubeplanner.outcome import Place
from tubeplanner.verification.certificate import Certificate
from tubeplanner.verification.judged_condition import RELATIVE, JudgedCondition, Tolerance


@dataclass(frozen=True)
class CycleCertificate:
    """The judgement of the motion of a cycle.

    Attributes:
        moves: By name; moves that run without a stop have one together, under each name.
        seams: By what happens there and when: conditions by name.
        refused: Moves that begin where their problem has no place, by name, and why.
        tolerance: How far below zero margins may lie.
    """

    moves: Mapping[str, Certificate]
    seams: Mapping[str, Mapping[str, JudgedCondition]]
    refused: Mapping[str, str]
    tolerance: Tolerance

    def __repr__(self) -> str:
        failed = self.failures()
        return (
            f"<CycleCertificate {'fails ' + ', '.join(failed) if failed else 'passed'}: "
            f"{len(self.moves)} moves, {len(self.seams)} seams>"
        )

    @property
    def passed(self) -> bool:
        """Whether every condition of every move and seam holds."""
        return not self.failures()

    def failures(self) -> list[str]:
        """Return what does not hold, as "MOVE: CONDITION" or "SEAM: CONDITION"."""
        found = [f"{move}: start" for move in self.refused]
        found += [f"{move}: {c}" for move, each in self.moves.items() for c in each.failures()]
        for seam, conditions in self.seams.items():
            failed = [n for n, each in conditions.items() if not each.holds(self.tolerance)]
            found += [f"{seam}: {name}" for name in failed]
        return found

    def describe(self, failure: str) -> str:
        """Return one line about something that does not hold, as `failures` calls it."""
        where, name = failure.rsplit(": ", 1)
        if where in self.refused:
            return f"{where}: {self.refused[where]}"
        if where in self.moves:
            return f"{where}: {self.moves[where].describe(name)}"
        condition = self.seams[where][name]
        unit = "" if condition.unit == RELATIVE else f" {condition.unit}"
        return f"{where}: {name}: margin {condition.margin:.3g}{unit} ({condition.coverage})"

    def place(self, failure: str) -> Place:
        """Return where something does not hold, as `failures` calls it; it names the move."""
        where, name = failure.rsplit(": ", 1)
        if where in self.refused:
            return Place(move=where)
        conditions = self.moves[where].conditions if where in self.moves else self.seams[where]
        return conditions[name].where

    def as_dict(self) -> dict[str, Any]:
        """Return the certificate as JSON values."""
        moves = {name: certificate.as_dict() for name, certificate in self.moves.items()}
        tolerance = {"absolute": self.tolerance.absolute, "relative": self.tolerance.relative}
        return {
            "passed": self.passed,
            "tolerance": tolerance,
            "moves": {**moves, **{name: _refusal(why) for name, why in self.refused.items()}},
            "seams": {
                seam: {name: each.as_dict(self.tolerance) for name, each in conditions.items()}
                for seam, conditions in self.seams.items()
            },
        }


def _refusal(why: str) -> dict[str, Any]:
    return {"passed": False, "refused": why, "conditions": {}}
