"""The steps that keep the constraints of one or more legs: programs solved until nothing is broken.

What a step breaks that its program was not given is given to the next program.
"""

from collections.abc import Sequence

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.refinement.linearization import Linearization, Slack
from tubeplanner.refinement.spline_constraints import Iterate
from tubeplanner.refinement.step_block import Block, Step
from tubeplanner.refinement.step_program import StepProgram, step_program

_MAX_ROUNDS, _MAX_CORRECTIONS = 4, 3
STEP_TOLERANCE = 1e-4  # of a step's cost
# Where solutions go on from the last one, what a step this rough breaks joins at once.
_ROUGH = 0.05


class StepSearch:
    """The search for the steps of legs, all at once."""

    def __init__(self, legs: Sequence[Linearization], columns: Sequence[IntArray]) -> None:
        """Take the legs' linearizations, and which variables each has: see `StepProgram`."""
        self._legs, self._columns = legs, columns
        self._program: StepProgram | None = None

    def solve(self) -> tuple[Step, ...] | None:
        """Return the step of every leg, or None if there is none."""
        slack, steps = [leg.plain for leg in self._legs], None
        self._program = program = step_program(self._blocks(slack), self._columns)
        if program.goes_on:
            rough = program.solve(_ROUGH)
            if rough is not None and self._absorb(rough):
                program.join(self._blocks(slack))
        for _ in range(_MAX_ROUNDS):
            better = program.solve(STEP_TOLERANCE)
            if better is None:  # what there was before leaves something to the correction
                break
            steps = better
            if not self._absorb(steps):
                break
            program.join(self._blocks(slack))
        return steps

    def solve_closely(self, tolerance: float) -> tuple[Step, ...] | None:
        """Return the steps to a finer tolerance, after `solve`; None if there are none."""
        assert self._program is not None
        self._program.join(self._blocks([leg.plain for leg in self._legs]))
        return self._program.solve(tolerance)

    def solve_again(
        self, steps: Sequence[Step], trials: Sequence[Iterate], slack: Sequence[FloatArray]
    ) -> tuple[Step, ...] | None:
        """Return steps that are corrected by what the first ones left out: curvature.

        Args:
            steps: The first step of every leg.
            trials: Where they led.
            slack: Of every leg's rows there, by their numbers.
        """
        program = self._program
        if program is None:
            return None
        legs = list(zip(self._legs, steps, trials, slack, strict=True))
        corrected = [leg.corrected(step, trial, left) for leg, step, trial, left in legs]
        program.correct(self._blocks(corrected))
        others = program.solve(STEP_TOLERANCE)
        for _ in range(_MAX_CORRECTIONS - 1):
            if others is None:
                break
            tried = zip(self._legs, others, corrected, steps, strict=True)
            if not any([leg.absorb_bent(o, own, step.elastic) for leg, o, own, step in tried]):
                break
            program.join(self._blocks(corrected))
            others = program.solve(STEP_TOLERANCE)
        return others

    def _absorb(self, steps: Sequence[Step]) -> bool:
        """Add what steps break to the legs' linearizations; return whether there is some."""
        return any([leg.absorb(step) for leg, step in zip(self._legs, steps, strict=True)])

    def _blocks(self, slack: Sequence[Slack]) -> list[Block]:
        return [leg.block(own) for leg, own in zip(self._legs, slack, strict=True)]
