"""The linear program of one step: solved by PIQP, an interior-point method for sparse problems."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import piqp
from scipy import sparse

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.refinement.linear_rows import Rows

# Tried in turn: the first is the fastest for control points in the order of time.
_SOLVERS = (
    piqp.KKTSolver.sparse_multistage,
    piqp.KKTSolver.sparse_ldlt,
    piqp.KKTSolver.sparse_ldlt_cond,
)


@dataclass(frozen=True, eq=False)
class Quadratic:
    """What a step costs, but for the elastic variable.

    Attributes:
        hessian: Over all that may change, shape (V, V).
        gradient: Over configurations and switching times, shape (V-2,).
        duration: What eta costs.
    """

    hessian: sparse.csc_matrix
    gradient: FloatArray
    duration: float = 1.0

    def times(self, factor: float) -> "Quadratic":
        """Return a multiple of its curvature and gradient."""
        return replace(self, hessian=self.hessian * factor, gradient=self.gradient * factor)


@dataclass(frozen=True, eq=False)
class Bounds:
    """Where the step must stay.

    Attributes:
        lower: Of the variable configurations, shape (F, n).
        upper: Likewise.
        switching: Largest steps of the switching times, shape (m-1,).
        widths: Largest changes of the phases between them, shape (m,).
        duration: Smallest and largest eta.
        held: Directions in which the last variable must not move, shape (r, n).
    """

    lower: FloatArray
    upper: FloatArray
    switching: FloatArray
    widths: FloatArray
    duration: tuple[float, float]
    held: FloatArray


@dataclass(frozen=True, eq=False)
class Step:
    """The solution of a linear program.

    Attributes:
        control: Shape (F, n).
        switching: Shape (switching_times,).
        duration: eta.
        elastic: By how much elastic rows are broken at most.
        multipliers: Of the rows, shape (R,).
    """

    control: FloatArray
    switching: FloatArray
    duration: float
    elastic: float
    multipliers: FloatArray


@dataclass(frozen=True, eq=False)
class SparseRows:
    """R rows over all that may change, compressed.

    Attributes:
        data: Their entries, row after row, shape (entries,).
        column: Where they are, shape (entries,).
        count: How many entries each row has, shape (R,).
    """

    data: FloatArray
    column: IntArray
    count: IntArray


class StepProgram:
    """A linear program with a little curvature, and its solver.

    It minimises duration * eta + penalty * elastic + gradient . z + x . hessian . x / 2 under the
    rows, z being configurations and switching times, x all that may change: z, eta, elastic.
    """

    def __init__(
        self,
        rows: Sequence[SparseRows],
        slack: FloatArray,
        bounds: Bounds,
        quadratic: Quadratic,
        penalty: float,
        tolerance: float,
    ) -> None:
        """Set it up.

        Args:
            rows: The constraints, R of them in all, from `sparse_rows`.
            slack: Theirs, shape (R,).
            bounds: Where the step must stay.
            quadratic: The step's cost.
            penalty: Weight of the elastic variable.
            tolerance: Of the solution, absolute and relative.
        """
        self._free = bounds.lower.shape
        switches = len(bounds.switching)
        self._widths = bounds.widths if switches else np.zeros(0)
        self._hessian = quadratic.hessian
        self._linear = np.concatenate([quadratic.gradient, [quadratic.duration, penalty]])
        self._lower = np.concatenate(
            [bounds.lower.ravel(), -bounds.switching, [bounds.duration[0], 0.0]]
        )
        self._upper = np.concatenate(
            [bounds.upper.ravel(), bounds.switching, [bounds.duration[1], np.inf]]
        )
        changes = _width_changes(switches, bounds.lower.size)
        self._matrix = _matrix([*rows, changes], len(self._linear))
        self._slack, self._tolerance = slack, tolerance
        self._held = self._equalities(bounds)
        self._solver: piqp.SparseSolver | None = None

    def solve(self) -> Step | None:
        """Return the step, or None if no solver finds one."""
        for kind in _SOLVERS:
            solver = piqp.SparseSolver()
            settings = solver.settings
            settings.kkt_solver = kind
            settings.preconditioner_iter = 0  # rows are scaled by their limits already
            settings.eps_abs = settings.eps_rel = self._tolerance
            settings.eps_duality_gap_abs = settings.eps_duality_gap_rel = self._tolerance
            solver.setup(
                self._hessian,
                self._linear,
                self._held,
                None if self._held is None else np.zeros(self._held.shape[0]),
                self._matrix,
                np.concatenate([np.full(len(self._slack), -np.inf), -self._widths]),
                self._most(self._slack),
                self._lower,
                self._upper,
            )
            step = self._solution(solver)
            if step is not None:
                self._solver = solver
                return step
        return None

    def solve_again(self, slack: FloatArray) -> Step | None:
        """Return the step with other slack for the rows, once there was a solution."""
        if self._solver is None:
            return None
        self._solver.update(h_u=self._most(slack))
        return self._solution(self._solver)

    def _most(self, slack: FloatArray) -> FloatArray:
        return np.concatenate([slack, self._widths])

    def _equalities(self, bounds: Bounds) -> sparse.csc_matrix | None:
        count, n = bounds.held.shape
        if count == 0:
            return None
        column = np.tile(np.arange(bounds.lower.size - n, bounds.lower.size), count)
        rows = SparseRows(bounds.held.ravel(), column, np.full(count, n))
        return _matrix([rows], len(self._linear))

    def _solution(self, solver: piqp.SparseSolver) -> Step | None:
        status = solver.solve()
        x = np.array(solver.result.x)
        if status != piqp.PIQP_SOLVED or len(x) != len(self._lower) or not np.isfinite(x).all():
            return None
        x = np.clip(x, self._lower, self._upper)
        free, n = self._free
        return Step(
            x[: free * n].reshape(free, n),
            x[free * n : -2],
            float(x[-2]),
            float(x[-1]),
            np.array(solver.result.z_u)[: len(self._slack)],
        )


def sparse_rows(rows: Rows, is_elastic: FloatArray, column: IntArray, free: int) -> SparseRows:
    """Return rows over all that may change.

    Args:
        rows: R constraints.
        is_elastic: 1 for rows that may be violated at a penalty, else 0, shape (R,).
        column: The variable of every control point, -1 where it is fixed, shape (K,).
        free: How many variables there are.
    """
    count, weights, n = rows.control.shape
    switches = rows.switching.shape[1]
    variable = column[rows.first[:, None] + np.arange(weights)]
    data = np.empty((count, weights * n + switches + 2))
    columns = np.empty(data.shape, dtype=np.int32)
    by_control = (rows.control * (variable >= 0)[:, :, None]).reshape(count, weights * n)
    data[:, : weights * n] = by_control
    data[:, weights * n : -2], data[:, -2], data[:, -1] = rows.switching, rows.duration, -is_elastic
    columns[:, : weights * n] = np.add.outer(variable * n, np.arange(n)).reshape(count, weights * n)
    columns[:, weights * n :] = free * n + np.arange(switches + 2)
    keep = data != 0
    return SparseRows(data[keep], columns[keep], keep.sum(axis=1))


def _width_changes(switches: int, first: int) -> SparseRows:
    """Return how the phases' widths change with the switching times, that begin at a column.

    A phase grows with the time that ends it, and shrinks with the one that begins it.
    """
    if switches == 0:
        nothing = np.zeros(0, dtype=np.int64)
        return SparseRows(np.zeros(0), nothing, nothing)
    counts = np.concatenate([[1], np.full(switches - 1, 2), [1]])
    column = first + np.repeat(np.arange(switches), 2)
    return SparseRows(np.tile([1.0, -1.0], switches), column, counts)


def _matrix(parts: Sequence[SparseRows], columns: int) -> sparse.csc_matrix:
    """Return the matrix of several sets of rows."""
    data, column, count = (
        np.concatenate([getattr(part, name) for part in parts])
        for name in ("data", "column", "count")
    )
    ends = np.concatenate([[0], np.cumsum(count)])
    matrix = sparse.csr_matrix((data, column, ends), shape=(len(count), columns))
    matrix.sum_duplicates()  # control points that move as one
    return matrix.tocsc()
