"""The worst and the usual of several executed runs."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from tubeplanner.simulation.executed_tube import Extreme
from tubeplanner.simulation.judged_runs import JudgedRun

# Quantities of a run, and whether the least of them is the worst.
_QUANTITIES = {
    "tube": False,
    "rotation": False,
    "points": False,
    "tracking": False,
    "tool_tracking": False,
    "position": False,
    "velocity": False,
    "obstacles": True,
    "self_collision": True,
}


@dataclass(frozen=True)
class RunSummary:
    """One quantity over all runs.

    Attributes:
        worst: The worst value, and when and where.
        run: In which run, from 0.
        median: Of all runs.
    """

    worst: Extreme
    run: int
    median: float

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return asdict(self)


def summaries(runs: Sequence[JudgedRun]) -> dict[str, RunSummary | None]:
    """Return the worst and the median of every quantity of `JudgedRun`, by name.

    None where it is not asked.
    """
    return {name: _summary(runs, name, least) for name, least in _QUANTITIES.items()}


def _summary(runs: Sequence[JudgedRun], name: str, least: bool) -> RunSummary | None:
    found: list[Extreme | None] = [getattr(run, name) for run in runs]
    asked = [extreme for extreme in found if extreme is not None]
    if not asked:
        return None
    values = np.array([extreme.value for extreme in asked])
    run = int(values.argmin() if least else values.argmax())
    return RunSummary(asked[run], run, float(np.median(values)))
