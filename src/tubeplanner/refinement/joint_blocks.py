"""The legs' blocks of a program over the program's own variables."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.refinement.step_block import Block, SparseRows, Step
from tubeplanner.refinement.symmetric_entries import SymmetricEntries


@dataclass(frozen=True, eq=False)
class JointBlocks:
    """What a program asks of all legs.

    Attributes:
        blocks: One of each leg.
        columns: Which of the program's variables each leg's V are, shape (V,).
    """

    blocks: Sequence[Block]
    columns: Sequence[IntArray]

    @cached_property
    def size(self) -> int:
        """Number of the program's variables."""
        return 1 + max(int(own.max()) for own in self.columns)

    @property
    def hessian(self) -> SymmetricEntries:
        """The sum of the legs' curvatures."""
        if self._is_one_alone:
            return self.blocks[0].quadratic.hessian
        parts = zip(self.blocks, self.columns, strict=True)
        total, *others = (block.quadratic.hessian.among(own, self.size) for block, own in parts)
        for other in others:
            total = total.plus(other)
        return total

    @property
    def linear(self) -> FloatArray:
        """The cost's gradient."""
        if self._is_one_alone:
            return self.blocks[0].linear
        total = np.zeros(self.size)
        for block, own in zip(self.blocks, self.columns, strict=True):
            np.add.at(total, own, block.linear)
        return total

    @cached_property
    def _is_one_alone(self) -> bool:
        """Whether a leg alone has the program's variables in their order."""
        return np.array_equal(self.columns[0], np.arange(self.size))

    @cached_property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """The least and the largest of all variables: where legs share one, those of both."""
        if self._is_one_alone:
            return self.blocks[0].lower, self.blocks[0].upper
        lower, upper = np.full(self.size, -np.inf), np.full(self.size, np.inf)
        for block, own in zip(self.blocks, self.columns, strict=True):
            np.maximum.at(lower, own, block.lower)
            np.minimum.at(upper, own, block.upper)
        return lower, upper

    @property
    def widths(self) -> FloatArray:
        """The largest changes of all phases."""
        return np.concatenate([block.widths for block in self.blocks])

    @property
    def width_changes(self) -> list[SparseRows]:
        """How all phases change, of each leg."""
        return [self.over_all(block.width_changes, k) for k, block in enumerate(self.blocks)]

    @property
    def held(self) -> list[SparseRows]:
        """What must not move, of each leg."""
        return [self.over_all(block.held, k) for k, block in enumerate(self.blocks)]

    def over_all(self, rows: SparseRows, leg: int) -> SparseRows:
        """Return rows of a leg over the program's variables."""
        if self._is_one_alone:
            return rows
        return replace(rows, column=self.columns[leg][rows.column])

    def steps(self, x: FloatArray, multipliers: Sequence[FloatArray]) -> tuple[Step, ...]:
        """Return the legs' steps from the program's variables and their rows' multipliers."""
        legs = zip(self.blocks, self.columns, multipliers, strict=True)
        return tuple(block.step(x[own], each) for block, own, each in legs)
