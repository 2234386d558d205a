"""The program of one step for PIQP, an interior-point method for sparse problems."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.refinement.joint_blocks import JointBlocks
from tubeplanner.refinement.step_block import Block, SparseRows, Step, stacked_rows
from tubeplanner.refinement.symmetric_entries import SymmetricEntries

# Tried in turn: the first is the fastest for control points in the order of time.
_SOLVERS = ("sparse_multistage", "sparse_ldlt", "sparse_ldlt_cond")


class SparseProgram:
    """A program that begins anew when rows join it; see `StepProgram`."""

    goes_on = False

    def __init__(self, blocks: Sequence[Block], columns: Sequence[IntArray]) -> None:
        """Set it up; arguments as `step_program`."""
        self._columns = columns
        self._solver: Any = None
        self.join(blocks)

    def join(self, blocks: Sequence[Block]) -> None:
        """Take all rows of blocks."""
        self._blocks, self._solver = JointBlocks(blocks, self._columns), None

    def correct(self, blocks: Sequence[Block]) -> None:
        """Take all rows of blocks; where none is new, only their slack."""
        counts = [[len(block.slack) for block in each] for each in (blocks, self._blocks.blocks)]
        if self._solver is None or counts[0] != counts[1]:
            return self.join(blocks)
        self._blocks = JointBlocks(blocks, self._columns)
        self._solver.update(h_u=self._most())
        return None

    def solve(self, tolerance: float) -> tuple[Step, ...] | None:
        """Return the step of every leg, or None if no solver finds one."""
        if self._solver is not None:
            return self._solution(self._solver)
        for kind in _SOLVERS:
            solver = self._set_up(kind, tolerance)
            steps = self._solution(solver)
            if steps is not None:
                self._solver = solver
                return steps
        return None

    def _set_up(self, kind: str, tolerance: float) -> Any:
        # Where the native library is, neither this nor scipy.sparse is loaded.
        import piqp

        joint = self._blocks
        solver = piqp.SparseSolver()
        settings = solver.settings
        settings.kkt_solver = getattr(piqp.KKTSolver, kind)
        settings.preconditioner_iter = 0  # rows are scaled by their limits already
        settings.eps_abs = settings.eps_rel = tolerance
        settings.eps_duality_gap_abs = settings.eps_duality_gap_rel = tolerance
        rows = [
            joint.over_all(own, k) for k, block in enumerate(joint.blocks) for own in block.rows
        ]
        held = _matrix(joint.held, joint.size)
        lower, upper = joint.bounds
        count = sum(len(block.slack) for block in joint.blocks)
        solver.setup(
            _symmetric(joint.hessian),
            joint.linear,
            held if held.shape[0] else None,
            np.zeros(held.shape[0]) if held.shape[0] else None,
            _matrix([*rows, *joint.width_changes], joint.size),
            np.concatenate([np.full(count, -np.inf), -joint.widths]),
            self._most(),
            lower,
            upper,
        )
        return solver

    def _most(self) -> FloatArray:
        return np.concatenate(
            [*(block.slack for block in self._blocks.blocks), self._blocks.widths]
        )

    def _solution(self, solver: Any) -> tuple[Step, ...] | None:
        import piqp

        status, joint = solver.solve(), self._blocks
        x = np.array(solver.result.x)
        if status != piqp.PIQP_SOLVED or len(x) != joint.size or not np.isfinite(x).all():
            return None
        x = np.clip(x, *joint.bounds)
        ends = np.cumsum([len(block.slack) for block in joint.blocks])
        multipliers = np.split(np.array(solver.result.z_u)[: ends[-1]], ends[:-1])
        return joint.steps(x, multipliers)


def _symmetric(entries: SymmetricEntries) -> Any:
    """Return a symmetric matrix."""
    from scipy import sparse

    places = (entries.row, entries.column)
    return sparse.coo_matrix((entries.value, places), (entries.size, entries.size)).tocsc()


def _matrix(parts: Sequence[SparseRows], columns: int) -> Any:
    """Return the matrix of several sets of rows."""
    from scipy import sparse

    rows = stacked_rows(parts)
    # What scipy.sparse takes as it is.
    ends = np.concatenate([[0], np.cumsum(rows.count)]).astype(np.int32)
    column = rows.column.astype(np.int32, copy=False)
    matrix = sparse.csr_matrix((rows.data, column, ends), shape=(len(rows.count), columns))
    matrix.sum_duplicates()  # control points that move as one
    return matrix.tocsc()
