"""The steps that keep the constraints of one or more legs: programs solved until nothing is broken.

What a step breaks that its program was not given is given to the next program.
"""

from collections.abc import Sequence

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.refinement.linear_program import Step, StepProgram
from tubeplanner.refinement.linearization import Linearization, Slack
from tubeplanner.refinement.spline_constraints import Iterate

_MAX_ROUNDS, _MAX_CORRECTIONS = 4, 3
STEP_TOLERANCE = 1e-4  # of a step, absolute and relative


class StepSearch:
    """The search for the steps of legs, all at once."""

    def __init__(self, legs: Sequence[Linearization], columns: Sequence[IntArray]) -> None:
        """Take the legs' linearizations, and which variables each has: see `StepProgram`."""
        self._legs, self._columns = legs, columns
        self._program: StepProgram | None = None

    def solve(self) -> tuple[Step, ...] | None:
        """Return the step of every leg, or None if there is none."""
        slack, steps = [leg.plain for leg in self._legs], None
        for _ in range(_MAX_ROUNDS):
            better = self._solved(slack)
            if better is None:  # what there was before leaves something to the correction
                break
            steps = better
            if not any([leg.absorb(step) for leg, step in zip(self._legs, steps, strict=True)]):
                break
        return steps

    def solve_again(
        self, steps: Sequence[Step], trials: Sequence[Iterate], slack: Sequence[FloatArray]
    ) -> tuple[Step, ...] | None:
        """Return steps that are corrected by what the first ones left out: curvature.

        Args:
            steps: The first step of every leg.
            trials: Where they led.
            slack: Of every leg's rows there, by their numbers.
        """
        legs = list(zip(self._legs, steps, trials, slack, strict=True))
        corrected = [leg.corrected(step, trial, left) for leg, step, trial, left in legs]
        others = self._solved_again(corrected)
        for _ in range(_MAX_CORRECTIONS - 1):
            if others is None:
                break
            tried = zip(self._legs, others, corrected, steps, strict=True)
            if not any([leg.absorb_bent(o, own, step.elastic) for leg, o, own, step in tried]):
                break
            others = self._solved(corrected)
        return others

    def _solved(self, slack: Sequence[Slack]) -> tuple[Step, ...] | None:
        """Return the steps of the program of all legs, each with some slack."""
        blocks = [leg.block(own) for leg, own in zip(self._legs, slack, strict=True)]
        self._program = StepProgram(blocks, self._columns, STEP_TOLERANCE)
        return self._program.solve()

    def _solved_again(self, slack: Sequence[Slack]) -> tuple[Step, ...] | None:
        """Return the steps of the last program, if nothing was added, for other slack."""
        if self._program is None or any(leg.has_more for leg in self._legs):
            return self._solved(slack)
        given = [leg.given_slack(own) for leg, own in zip(self._legs, slack, strict=True)]
        return self._program.solve_again(given)
