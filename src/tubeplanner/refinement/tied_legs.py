"""Motions that follow each other, improved together where one ends as the next begins.

Planned one after the other, each ends where that is best for itself. Here the configurations
between them are chosen for the least sum of durations: all legs are one program, whose legs share
them.
"""

from collections.abc import Callable, Sequence

from tubeplanner.refinement.descent import FIRST_PENALTY, Descent, Improved
from tubeplanner.refinement.linear_rows import MERIT_TOLERANCE
from tubeplanner.refinement.phased_spline import PhasedSpline
from tubeplanner.refinement.refined_motion import RefinedMotion
from tubeplanner.refinement.sequential_program import SequentialProgram
from tubeplanner.refinement.spline_constraints import BLENDED, Iterate
from tubeplanner.refinement.trust_region import TrustRegion

_FIRST_TRUST, _LEAST_TRUST, _MOST_TRUST = 0.1, 0.005, 0.05  # [rad or m]
_GAIN = 5e-4
_FIRST_STEPS, _STEPS_PER_ROUND, _MAX_ROUNDS = 30, 4, 6


class TiedLegs:
    """Legs whose common ends are open."""

    def __init__(
        self,
        motions: Sequence[RefinedMotion],
        is_tied: Sequence[bool],
        *,
        is_closed: bool = False,
        checkpoint: Callable[[float], None] = lambda duration: None,
    ) -> None:
        """Prepare them.

        Args:
            motions: The legs, each beginning where the one before ends.
            is_tied: Whether that is open between each leg and the next, one less than legs. Where
                a leg's goal leaves nothing to choose, it stays.
            is_closed: Whether it is open too where the first leg begins and the last one ends.
            checkpoint: Called with the sum of durations [s] after every step; it may raise to end
                the work.
        """
        self._splines = tuple(motion.spline for motion in motions)
        self._checkpoint = checkpoint
        self._is_tied, self._programs = _tied_programs(motions, (*is_tied, is_closed))
        self._descent = Descent(self._programs, self._is_tied)
        self._best: tuple[Iterate, ...] | None = None

    @property
    def durations(self) -> tuple[float, ...]:
        """The duration of every leg [s], by limits at and between the samples.

        Raises:
            RuntimeError: The legs have not been run.
        """
        if self._best is None:
            raise RuntimeError("the legs have not been run")
        return tuple(iterate.duration for iterate in self._best)

    def run(self) -> tuple[PhasedSpline, ...]:
        """Return the legs' splines with the least sum of durations; tied ends agree exactly."""
        for program, spline in zip(self._programs, self._splines, strict=True):
            program.constraints.blend(BLENDED)
            program.constraints.look_for_links(spline)
        trust, penalty, steps = TrustRegion(_FIRST_TRUST), FIRST_PENALTY, _FIRST_STEPS
        splines = self._splines
        self._look_between([p.iterate(s) for p, s in zip(self._programs, splines, strict=True)])
        for _ in range(_MAX_ROUNDS):
            found = self._improved(splines, trust, penalty, steps)
            has_more = self._look_between(found.iterates)
            if found.has_ended and not has_more:
                break
            splines = tuple(iterate.spline for iterate in found.iterates)
            radius = min(max(2 * found.trust.radius, _LEAST_TRUST), _MOST_TRUST)
            trust = TrustRegion(radius, found.trust.damping)
            penalty, steps = found.penalty, _STEPS_PER_ROUND
        return tuple(iterate.spline for iterate in self._best)

    def _improved(
        self, splines: Sequence[PhasedSpline], trust: TrustRegion, penalty: float, max_steps: int
    ) -> Improved:
        each = zip(self._programs, splines, strict=True)
        return self._descent.improved(
            tuple(program.iterate(spline) for program, spline in each),
            trust,
            penalty,
            min_gain=_GAIN,
            max_steps=max_steps,
            checkpoint=lambda iterates: self._checkpoint(_total(iterates)),
        )

    def _look_between(self, iterates: Sequence[Iterate]) -> bool:
        """Keep motions that are the best between samples too; return whether some are missing."""
        each = zip(self._programs, iterates, strict=True)
        found = [program.constraints.look_between_samples(iterate) for program, iterate in each]
        dense = tuple(iterate for iterate, _ in found)
        inside = all(iterate.excess <= MERIT_TOLERANCE for iterate in dense)
        if self._best is None or (inside and _total(dense) < _total(self._best)):
            self._best = dense
        return any(has_more for _, has_more in found)


def _tied_programs(
    motions: Sequence[RefinedMotion], is_tied: Sequence[bool]
) -> tuple[tuple[bool, ...], tuple[SequentialProgram, ...]]:
    """Return which legs end where the next begins, wherever that is, and the legs' programs."""
    opens = [SequentialProgram(each.problem, each.spline.grid) for each in motions]
    tied = tuple(
        wanted and program.variables.goal_moves
        for wanted, program in zip(is_tied, opens, strict=True)
    )
    programs = tuple(
        SequentialProgram(each.problem, each.spline.grid, start_moves=tied[k - 1])
        for k, each in enumerate(motions)
    )
    for k, program in enumerate(programs):
        if tied[k]:
            program.variables.tie(programs[(k + 1) % len(programs)].variables)
    return tied, programs


def _total(iterates: Sequence[Iterate]) -> float:
    return sum(iterate.duration for iterate in iterates)
