"""In how many executed runs something was not kept, and in what share of all it may be."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from tubeplanner.simulation.judged_runs import KEPT, JudgedRun

CONFIDENCE = 0.95
_WORDS = {
    "tube": "left the tube",
    "rotation": "turned too far",
    "points": "missed a compulsory point",
    "position": "passed a position limit",
    "obstacles": "came too near to an obstacle",
    "self_collision": "ran into themselves",
}


@dataclass(frozen=True)
class RunVerdict:
    """What was seen in some runs; nothing is proved of others.

    Attributes:
        runs: How many there were.
        failed: How many of them did not keep all of `KEPT`.
        broken: How many did not keep each.
    """

    runs: int
    failed: int
    broken: Mapping[str, int]

    @property
    def share(self) -> tuple[float, float]:
        """Between which shares of all such arms fail, with 95 % confidence.

        (Clopper and Pearson, "The use of confidence or fiducial limits illustrated in the case of
        the binomial", Biometrika 26, 1934.)
        """
        from scipy.special import betaincinv  # slow to load, and few plans are simulated

        k, n, tail = self.failed, self.runs, (1 - CONFIDENCE) / 2
        least = float(betaincinv(k, n - k + 1, tail)) if k > 0 else 0.0
        most = float(betaincinv(k + 1, n - k, 1 - tail)) if k < n else 1.0
        return least, most

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return {
            "runs": self.runs,
            "failed": self.failed,
            "share": list(self.share),
            "confidence": CONFIDENCE,
            "broken": dict(self.broken),
        }

    def __str__(self) -> str:
        least, most = self.share
        said = "; ".join(f"{count} {_WORDS[name]}" for name, count in self.broken.items() if count)
        between = f"between {100 * least:.1f} and" if self.failed else "at most"
        return (
            f"{self.failed} of {self.runs} runs failed{': ' * bool(said)}{said} ({between} "
            f"{100 * most:.1f} % of all, with {100 * CONFIDENCE:g} % confidence)"
        )


def run_verdict(runs: Sequence[JudgedRun]) -> RunVerdict:
    """Return in how many runs something was not kept."""
    counts = Counter(name for run in runs for name in run.broken)
    failed = sum(not run.survives for run in runs)
    return RunVerdict(len(runs), failed, {name: counts[name] for name in KEPT})
