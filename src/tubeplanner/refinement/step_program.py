"""The program of one step, of one or more legs: what legs ask together, and who solves it.

It minimises the sum over legs of duration * eta + penalty * elastic + gradient . z +
x . hessian . x / 2 under the rows, z being a leg's configurations and switching times, x all that
may change there: z, eta, elastic. Legs may share variables.
"""

from collections.abc import Sequence
from typing import Protocol

from tubeplanner.arrays import IntArray
from tubeplanner.native.library import LIBRARY
from tubeplanner.refinement.banded_program import BandedProgram
from tubeplanner.refinement.sparse_program import SparseProgram
from tubeplanner.refinement.step_block import Block, Step


class StepProgram(Protocol):
    """A program that was set up with blocks, one of each leg."""

    def solve(self, tolerance: float) -> tuple[Step, ...] | None:
        """Return the step of every leg, or None if there is none; tolerance: of the cost."""
        ...

    def join(self, blocks: Sequence[Block]) -> None:
        """Take rows that blocks have gained behind those they had, with the slack they have."""
        ...

    def correct(self, blocks: Sequence[Block]) -> None:
        """Take rows that blocks have gained, and other slack of all."""
        ...

    @property
    def goes_on(self) -> bool:
        """Whether solutions go on from the last one after rows have joined."""
        ...


def step_program(blocks: Sequence[Block], columns: Sequence[IntArray]) -> StepProgram:
    """Set up a program.

    Args:
        blocks: What it asks of each leg.
        columns: Which of the program's variables each leg's V are, shape (V,).
    """
    if LIBRARY.functions is None:
        return SparseProgram(blocks, columns)
    return BandedProgram(blocks, columns)
