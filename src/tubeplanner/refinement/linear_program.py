"""The linear program of one step: solved by PIQP, an interior-point method for sparse problems."""

from dataclasses import dataclass

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
    """The curvature of a step's cost.

    Attributes:
        hessian: Over all that may change, shape (V, V).
        gradient: Over the variables, shape (F n,).
    """

    hessian: sparse.csc_matrix
    gradient: FloatArray

    def times(self, factor: float) -> "Quadratic":
        """Return a multiple of it."""
        return Quadratic(self.hessian * factor, self.gradient * factor)


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


class StepProgram:
    """A linear program with a little curvature, and its solver.

    It minimises eta + penalty * elastic + gradient . dC + x . hessian . x / 2 under the rows, x
    being all that may change: configurations, switching times, eta, elastic.
    """

    def __init__(
        self,
        rows: Rows,
        is_elastic: FloatArray,
        column: IntArray,
        bounds: Bounds,
        quadratic: Quadratic,
        penalty: float,
        tolerance: float,
    ) -> None:
        """Set it up.

        Args:
            rows: The constraints.
            is_elastic: 1 for rows that may be violated at a penalty, else 0, shape (R,).
            column: The variable of every control point, -1 where it is fixed, shape (K,).
            bounds: Where the step must stay.
            quadratic: The curvature of the step's cost.
            penalty: Weight of the elastic variable.
            tolerance: Of the solution, absolute and relative.
        """
        self._free = bounds.lower.shape
        switches = len(bounds.switching)
        self._matrix = _matrix(rows, is_elastic, column, *self._free)
        self._widths = bounds.widths if switches else np.zeros(0)
        self._hessian = quadratic.hessian
        self._linear = np.concatenate([quadratic.gradient, np.zeros(switches), [1.0, penalty]])
        self._lower = np.concatenate(
            [bounds.lower.ravel(), -bounds.switching, [bounds.duration[0], 0.0]]
        )
        self._upper = np.concatenate(
            [bounds.upper.ravel(), bounds.switching, [bounds.duration[1], np.inf]]
        )
        self._slack, self._tolerance = rows.slack, tolerance
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
        if len(bounds.held) == 0:
            return None
        before = sparse.csc_matrix((len(bounds.held), bounds.lower[:-1].size))
        after = sparse.csc_matrix((len(bounds.held), len(self._linear) - bounds.lower.size))
        return sparse.hstack([before, bounds.held, after], format="csc")

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


def _matrix(
    rows: Rows, is_elastic: FloatArray, column: IntArray, free: int, n: int
) -> sparse.csc_matrix:
    """Return rows, and the changes of the phases' widths, over all that may change."""
    count, weights = len(rows), rows.control.shape[1]
    switches = rows.switching.shape[1]
    variable = column[rows.first[:, None] + np.arange(weights)]
    columns = (variable[:, :, None] * n + np.arange(n)).reshape(count, weights * n)
    values = rows.control * (variable >= 0)[:, :, None]
    extra = free * n + np.arange(switches + 2)
    columns = np.hstack([columns, np.tile(extra, (count, 1))])
    data = np.hstack(
        [
            values.reshape(count, weights * n),
            rows.switching,
            rows.duration[:, None],
            -is_elastic[:, None],
        ]
    )
    keep = data != 0
    ends, switch, by_switch = _width_changes(switches)
    indptr = np.concatenate([[0], np.cumsum(np.append(keep.sum(axis=1), ends))])
    matrix = sparse.csr_matrix(
        (np.append(data[keep], by_switch), np.append(columns[keep], free * n + switch), indptr),
        shape=(len(indptr) - 1, free * n + switches + 2),
    )
    matrix.sum_duplicates()  # control points that move as one
    return matrix.tocsc()


def _width_changes(switches: int) -> tuple[IntArray, IntArray, FloatArray]:
    """Return how the phases' widths change with the switching times, row after row.

    A phase grows with the time that ends it, and shrinks with the one that begins it.

    Returns:
        How many switching times count for each phase, which, and their weights.
    """
    if switches == 0:
        return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0)
    counts = np.concatenate([[1], np.full(switches - 1, 2), [1]])
    return counts, np.repeat(np.arange(switches), 2), np.tile([1.0, -1.0], switches)
