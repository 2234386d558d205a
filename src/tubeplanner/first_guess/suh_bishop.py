"""Phase 2 of 1988: rounds of modification with doubled knots.

The modification process (MP) moves the knots of the trajectory that phase 1 found. The doubling
process (DP) inserts a knot at the middle of every segment, and MP follows, until the gain is small
(Suh & Bishop 1988, section on the phase 2 algorithm).

Two things differ, as sequential quartics magnify a change at a knot by 1.6 from knot to knot, so
that with many knots "almost the same trajectory" is a quite different one. New knots are joined by
the 4-3-...-3-4 spline, with equal intervals and the same start and end conditions; and MP also
begins with a few knots more or less, at equal times of the first modified trajectory, as the best
number of knots is part of the question.
"""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.certificate.verification import Certificate
from tubeplanner.certificate.verification import quick_certificate as verify
from tubeplanner.checks import require_between, require_count, require_kind
from tubeplanner.first_guess.knot_modification import (
    KnotModification,
    KnotTrajectory,
    ModificationOptions,
    feasible_trajectory,
)
from tubeplanner.first_guess.segment_rules import LinkClearance
from tubeplanner.first_guess.waypoints import quartic_spline
from tubeplanner.task.problem import PlanningProblem

_MIN_KNOTS = 4
# Fractions of the node budget for all work up to: other numbers of knots, first doubling.
_BUDGET_FRACTIONS = (0.5, 0.85)


@dataclass(frozen=True)
class SuhBishopOptions:
    """Options of phase 2; the paper gives none of these numbers."""

    # of the modification process (MP)
    modification: ModificationOptions = field(default_factory=ModificationOptions)
    fewer_knots: int = 1  # MP also begins with up to this many knots less than phase 1's trajectory
    more_knots: int = 4  # MP also begins with up to this many knots more
    doubled: int = 3  # number of the fastest trajectories doubled first; from then on, one
    min_gain: float = 3e-3  # doubling ends when it gains less than this fraction of the duration
    max_knots: int = 34  # trajectories are not doubled to more knots
    node_budget: int = 40_000  # phase 2 ends after about this number of nodes of its searches

    def __post_init__(self) -> None:
        require_kind(self, "modification", ModificationOptions)
        require_count(self, 0, "fewer_knots", "more_knots")
        require_count(self, 1, "doubled", "node_budget")
        require_count(self, 2, "max_knots")
        require_between(self, 0, 1, "min_gain")


@dataclass(frozen=True)
class KnotStep:
    """One modification process, from its beginning to its end."""

    # "MP" of phase 1's trajectory, "other knots" or "DP", the latter two followed by MP
    process: str
    knots: int  # number of knots
    begin: float  # duration before any knot is moved [s]
    duration: float  # duration in the end [s]


@dataclass(frozen=True)
class PhaseTwoStatistics:
    """Statistics of phase 2."""

    steps: tuple[KnotStep, ...]  # in order
    knots: int  # number of knots of the best trajectory
    nodes: int = 0  # nodes expanded by all searches for a direction
    directions: int = 0  # number of searches for a direction
    proved: int = 0  # number of searches that ruled out every other direction
    # True if the node budget ended a step: there may be better trajectories
    budget_reached: bool = False

    def as_dict(self) -> dict[str, Any]:
        """Return the statistics as JSON values."""
        return asdict(self)

    def __str__(self) -> str:
        if not self.steps:
            return "no knot was moved"
        best, parts = np.inf, []
        for step in self.steps:
            if step.duration < best:
                best = step.duration
                parts.append(f"{step.process} to {best:.3f} s with {step.knots} knots")
        text = (
            f"{', '.join(parts)}; {len(self.steps)} times modified, {self.nodes} nodes for "
            f"{self.directions} directions, {self.proved} of them proved the best"
        )
        if self.budget_reached:
            text += "; some ended at their fraction of the node budget"
        return text


class SuhBishop:
    """Phase 2, which may be stopped at any time.

    Attributes:
        best: The fastest certified trajectory so far.
        certificate: The certificate of that trajectory.
        certificate_time: Time that the certificate took [s]; 0 while it is phase 1's.
        statistics: Statistics so far.
    """

    def __init__(
        self,
        problem: PlanningProblem,
        candidate: KnotTrajectory,
        certificate: Certificate,
        options: SuhBishopOptions,
        checkpoint: Callable[[], None] = lambda: None,
    ) -> None:
        """Begin with the trajectory that phase 1 found.

        The certificate is of that trajectory; the checkpoint is called before every search for a
        direction and may raise to end the work.
        """
        self.best, self.certificate, self.certificate_time = candidate, certificate, 0.0
        self._problem, self._first, self._options = problem, candidate, options
        self._checkpoint = checkpoint
        self.statistics = PhaseTwoStatistics((), len(candidate.knots))

    def run(self) -> None:
        """Move and double knots until doubling gains little, or the budget is used up."""
        options = self._options
        half, most = (round(ratio * options.node_budget) for ratio in _BUDGET_FRACTIONS)
        candidates = self._modified("MP", [self._first], 1.0, half)
        # Through other numbers of knots; phase 1's trajectory where that is infeasible.
        candidate, others = candidates[0], []
        count = len(candidate.knots)
        min_count = max(count - options.fewer_knots, _MIN_KNOTS)
        max_count = min(count + options.more_knots, options.max_knots)
        for count in range(min_count, max_count + 1):
            shapes = (source.at_equal_times(count) for source in (candidate, self._first))
            spline = next(filter(None, map(self._spline, shapes)), None)
            if spline is not None:
                others.append(spline)
        candidates += self._modified("other knots", others, 1.0, half)
        scale, width = 1.0, options.doubled
        while True:
            scale, before = scale / 2, self.best.duration
            fastest = sorted(candidates, key=lambda candidate: candidate.duration)[:width]
            # A knot more at the middle of every segment. Infeasible trajectories are doubled again:
            # the more knots, the smaller the change.
            finer = []
            for candidate in fastest:
                count = 2 * len(candidate.knots) - 1
                doubled = None
                while doubled is None and count <= options.max_knots:
                    doubled = self._spline(candidate.at_equal_times(count))
                    count = 2 * count - 1
                if doubled is not None:
                    finer.append(doubled)
            candidates = self._modified("DP", finer, scale, most)
            if not candidates or self.best.duration > before * (1 - options.min_gain):
                return
            width, most = 1, options.node_budget

    def _modified(
        self, process: str, candidates: list[KnotTrajectory], scale: float, budget: int
    ) -> list[KnotTrajectory]:
        """Return trajectories with knots moved, each by its fraction of a budget of nodes."""
        modified = []
        for i, candidate in enumerate(candidates):
            fraction = (budget - self.statistics.nodes) / (len(candidates) - i)
            work = KnotModification(self._problem, candidate, self._options.modification, scale)
            try:
                work.run(fraction, self._checkpoint)
            finally:  # keep the result even if the checkpoint ends the work
                now = self.statistics
                self.statistics = replace(
                    now,
                    nodes=now.nodes + work.nodes,
                    directions=now.directions + work.directions,
                    proved=now.proved + work.proved,
                    budget_reached=now.budget_reached or work.nodes >= fraction,
                )
                modified.append(self._best_certified(work.candidates))
                begin, duration = candidate.duration, modified[-1].duration
                step = KnotStep(process, len(candidate.knots), begin, duration)
                steps, knots = (*self.statistics.steps, step), len(self.best.knots)
                self.statistics = replace(self.statistics, steps=steps, knots=knots)
        return modified

    def _best_certified(self, candidates: list[KnotTrajectory]) -> KnotTrajectory:
        """Keep the fastest certified trajectory of a sequence, if it is the best so far.

        Samples may miss faults that the certificate finds: then slower trajectories are judged, by
        bisection.

        Returns:
            The trajectory to continue from: the certified one; the fastest if none is faster than
            the best so far; the first if none is certified.
        """
        better = [candidate for candidate in candidates if candidate.duration < self.best.duration]
        if not better:
            return candidates[-1]
        passed, failed, k = -1, len(better), len(better) - 1
        while failed - passed > 1:
            begin = time.perf_counter()
            certificate = verify(self._problem, better[k].trajectory)
            if certificate.passed:
                passed, self.best, self.certificate = k, better[k], certificate
                self.certificate_time = time.perf_counter() - begin
            else:
                failed = k
            k = (passed + failed) // 2
        return better[passed] if passed >= 0 else candidates[0]

    def _spline(self, knots: FloatArray) -> KnotTrajectory | None:
        """Return the 4-3-...-3-4 spline through knots (K, n); None if infeasible."""
        clearance = LinkClearance(self._problem, knots)
        return feasible_trajectory(self._problem, knots, quartic_spline, clearance, np.inf)
