"""What a plan that is to survive errors keeps back, what that costs, and what was seen of it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tubeplanner.problem.tightening import Tightening
from tubeplanner.short_repr import short_repr
from tubeplanner.simulation.blamed_errors import Blame
from tubeplanner.simulation.run_verdict import RunVerdict

_UNITS = {"rotation": "rad", "position": "rad or mm"}


@dataclass(frozen=True, eq=False)
class Survival:
    """What became of a plan under errors. Seen in simulated runs; nothing of it is proved.

    Attributes:
        verdict: Of runs that were used for nothing else; None if planning was stopped before.
        reached: Whether all runs that it was planned with survive, errors 1.3 times as large.
        kept_back: What the plan leaves of the limits.
        duration_without: Of the plan that would be written without robustness [s].
        verdict_without: Of that plan, of the same runs; None if it is the answer, or likewise.
        costs: What keeping back each part costs, by name [s]; they sum up to what all costs.
        blame: Which errors do the most; None where the plan survives at little cost.
    """

    verdict: RunVerdict | None
    reached: bool
    kept_back: Tightening
    duration_without: float
    verdict_without: RunVerdict | None
    costs: Mapping[str, float]
    blame: Blame | None = None

    __repr__ = short_repr

    @property
    def added(self) -> float:
        """What surviving costs [s]."""
        return sum(self.costs.values())

    @property
    def seen(self) -> str:
        """What was seen of the plan, in words."""
        if self.verdict is None:
            return "its runs were not simulated to the end"
        return f"seen in simulation: {self.verdict}"

    @property
    def notes(self) -> tuple[str, ...]:
        """What surviving costs and by what, and what is to blame, in words."""
        if not self.costs:
            return self._blamed
        parts = "; ".join(
            f"{_kept(self.kept_back, part)} ({1000 * cost:.1f} ms)"
            for part, cost in self.costs.items()
        )
        share = 100 * self.added / self.duration_without
        without = f"without robustness the plan takes {self.duration_without:.4f} s"
        if self.verdict_without is not None:
            without += f", and {self.verdict_without}"
        costs = (
            f"surviving takes {1000 * self.added:.1f} ms more, {share:.2g} %: {parts}; {without}"
        )
        return (costs, *self._blamed)

    @property
    def _blamed(self) -> tuple[str, ...]:
        if self.blame is None:
            return ()
        is_short = self.blame.short > 0
        if self.reached:
            return (f"the plan without robustness: {self.blame}",) if is_short else ()
        none = "no plan was found of which all runs survive, their errors enlarged"
        return (f"{none}: {self.blame}" if is_short else none,)

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return {
            "reached": self.reached,
            "verdict": None if self.verdict is None else self.verdict.as_dict(),
            "verdict_without": None
            if self.verdict_without is None
            else self.verdict_without.as_dict(),
            "duration_without": self.duration_without,
            "kept_back": self.kept_back.as_dict(),
            "costs": dict(self.costs),
            "blame": None if self.blame is None else self.blame.as_dict(),
        }


def _kept(kept_back: Tightening, part: str) -> str:
    """Return how much of one part is kept back, in words."""
    value = getattr(kept_back, part)
    if part in ("effort", "velocity"):
        return f"{100 * value:.3g} % of the {part} limits"
    most = f"{1000 * float(np.max(value)):.2g} m{_UNITS.get(part, 'm')}"
    if part == "clearance":
        return f"{most} more clearance"
    return f"up to {most} less {part.replace('position', 'joint range')}"
