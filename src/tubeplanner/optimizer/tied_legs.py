"""Consecutive legs with a common end configuration, improved together.

Legs that are planned one after the other end where that is best for each. Here the configurations
between them are optimised for the least sum of durations, in one program whose legs share them. The
sum changes only with the square of their error, so that coarser knots than those of the motions are
accurate enough.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from tubeplanner.optimizer.control_variables import ControlVariables
from tubeplanner.optimizer.descent import Descent, DescentState, SequentialProgram
from tubeplanner.optimizer.phased_spline import PhasedSpline
from tubeplanner.optimizer.rows import MERIT_TOLERANCE
from tubeplanner.optimizer.spline_constraints import BLENDED, Iterate
from tubeplanner.optimizer.starts import RefinedMotion, knot_grid, on_knots, subdivided
from tubeplanner.optimizer.step_search import TrustRegion

# So many knot intervals are joined to one, or fewer if less than the fewest would remain; the next
# number where legs then leave their tubes. (Of 3 to 6, for two and three legs of three arms, 5 took
# the least time; the sums differed by 0.3 % at most.)
_JOINED, _FEWEST = (5, 2), 14
_FIRST_TRUST, _LATER_TRUST = 0.2, 0.02  # in units of the trust region
_GAIN = 5e-4
_FIRST_STEPS, _STEPS_PER_ROUND, _MAX_ROUNDS = 30, 4, 3
# Each leg is refined once more, which mends violations of this number of merit tolerances.
_INSIDE = 2.0


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
        """Take legs.

        Args:
            motions: The legs, each beginning where the one before ends.
            is_tied: Whether the configuration between each leg and the next may change, one less
                than legs. It is fixed all the same where a leg's goal does not move.
            is_closed: Whether the configuration between the last leg and the first may change.
            checkpoint: Called with the sum of durations [s] after every step; it may raise to end
                the work.
        """
        self._motions, self._is_open = tuple(motions), (*is_tied, is_closed)
        self._checkpoint = checkpoint
        self._iterates: tuple[Iterate, ...] = ()

    @property
    def durations(self) -> tuple[float, ...]:
        """The duration of every leg [s], on the last coarse knots; empty before `run`."""
        return tuple(iterate.duration for iterate in self._iterates)

    def run(self) -> tuple[PhasedSpline, ...] | None:
        """Return the legs' splines with about the least sum of durations; tied ends agree exactly.

        Returns:
            None if they leave their tubes on all knots.
        """
        counts = [motion.spline.grid.interval_count for motion in self._motions]
        choices = [
            tuple(max(min(most, count // _FEWEST), 1) for count in counts) for most in _JOINED
        ]
        for parts in dict.fromkeys(choices):
            splines = []
            for motion, own in zip(self._motions, parts, strict=True):
                spline = motion.spline
                if own > 1:
                    times, grid = spline.switching_times, spline.grid
                    coarse = knot_grid(times, round(grid.interval_count / own), grid.runs)
                    spline = on_knots(spline, coarse, times)
                splines.append(spline)
            self._iterates = self._on_knots(splines)
            if all(
                iterate.excess <= _INSIDE * MERIT_TOLERANCE and np.isfinite(iterate.duration)
                for iterate in self._iterates
            ):
                each = zip(self._iterates, parts, strict=True)
                return tuple(subdivided(iterate.spline, own) for iterate, own in each)
        return None

    def _on_knots(self, splines: Sequence[PhasedSpline]) -> tuple[Iterate, ...]:
        """Return the improved legs, on the knots of splines."""
        legs = list(zip(self._motions, splines, self._is_open, strict=True))
        is_tied = tuple(
            is_open and ControlVariables(motion.problem, spline.grid).goal_moves
            for motion, spline, is_open in legs
        )
        programs = tuple(
            SequentialProgram(motion.problem, spline.grid, start_moves=is_tied[k - 1])
            for k, (motion, spline, _) in enumerate(legs)
        )
        for k, program in enumerate(programs):
            if is_tied[k]:
                program.variables.tie(programs[(k + 1) % len(programs)].variables)
        descent = Descent(programs, is_tied)
        for program, spline, ends_openly in zip(programs, splines, is_tied, strict=True):
            program.constraints.blend(BLENDED)
            program.constraints.links.add_samples(spline)
            if ends_openly:  # where links may touch
                program.constraints.add_samples(spline, 1.0)
        begun = DescentState(_iterates(programs, splines), TrustRegion(_FIRST_TRUST))
        if not np.isfinite(_total(begun.iterates)):
            return begun.iterates
        result = self._improved(descent, begun, _FIRST_STEPS)
        for _ in range(_MAX_ROUNDS):
            each = zip(programs, result.iterates, strict=True)
            # Not lazily: every leg adds the samples that it lacks.
            has_more = [program.constraints.add_samples_between(own)[1] for program, own in each]
            if result.has_ended and not any(has_more):
                break
            again = _iterates(programs, [iterate.spline for iterate in result.iterates])
            trust = replace(result.trust, radius=_LATER_TRUST)
            begun = DescentState(again, trust, result.penalty)
            result = self._improved(descent, begun, _STEPS_PER_ROUND)
        return result.iterates

    def _improved(self, descent: Descent, begun: DescentState, max_steps: int) -> DescentState:
        return descent.improved(
            begun,
            min_gain=_GAIN,
            max_steps=max_steps,
            checkpoint=lambda iterates: self._checkpoint(_total(iterates)),
        )


def _iterates(
    programs: Sequence[SequentialProgram], splines: Sequence[PhasedSpline]
) -> tuple[Iterate, ...]:
    each = zip(programs, splines, strict=True)
    return tuple(program.iterate(spline) for program, spline in each)


def _total(iterates: Sequence[Iterate]) -> float:
    return sum(iterate.duration for iterate in iterates)
