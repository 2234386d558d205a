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

    def weighted(self, weight: float) -> "Quadratic":
        """Return a multiple of the cost."""
        return replace(self.times(weight), duration=self.duration * weight)


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


@dataclass(frozen=True, eq=False)
class Block:
    """What a program asks of one leg, over all that may change there: z, eta, elastic.

    Attributes:
        rows: The constraints, R of them in all, from `sparse_rows`.
        slack: Theirs, shape (R,).
        bounds: Where the step must stay.
        quadratic: The step's cost.
        penalty: Weight of the elastic variable.
    """

    rows: Sequence[SparseRows]
    slack: FloatArray
    bounds: Bounds
    quadratic: Quadratic
    penalty: float

    @property
    def linear(self) -> FloatArray:
        """The cost's gradient, shape (V,)."""
        own = self.quadratic
        return np.concatenate([own.gradient, [own.duration, self.penalty]])

    @property
    def lower(self) -> FloatArray:
        """The least of all that may change, shape (V,)."""
        own = self.bounds
        return np.concatenate([own.lower.ravel(), -own.switching, [own.duration[0], 0.0]])

    @property
    def upper(self) -> FloatArray:
        """The largest of all that may change, shape (V,)."""
        own = self.bounds
        return np.concatenate([own.upper.ravel(), own.switching, [own.duration[1], np.inf]])

    @property
    def widths(self) -> FloatArray:
        """The largest changes of the phases, if switching times may move, shape (m,) or (0,)."""
        return self.bounds.widths if len(self.bounds.switching) else np.zeros(0)

    @property
    def width_changes(self) -> SparseRows:
        """How the phases change."""
        return _width_changes(len(self.bounds.switching), self.bounds.lower.size)

    @property
    def held(self) -> SparseRows:
        """What must not move."""
        count, n = self.bounds.held.shape
        size = self.bounds.lower.size
        column = np.tile(np.arange(size - n, size), count)
        return SparseRows(self.bounds.held.ravel(), column, np.full(count, n))

    def step(self, x: FloatArray, multipliers: FloatArray) -> Step:
        """Return the step that values of all that may change (V,) stand for."""
        shape = self.bounds.lower.shape
        size = self.bounds.lower.size
        return Step(x[:size].reshape(shape), x[size:-2], float(x[-2]), float(x[-1]), multipliers)


class StepProgram:
    """A linear program with a little curvature, and its solver.

    It minimises the sum over legs of duration * eta + penalty * elastic + gradient . z +
    x . hessian . x / 2 under the rows, z being a leg's configurations and switching times, x all
    that may change there: z, eta, elastic. Legs may share variables.
    """

    def __init__(
        self, blocks: Sequence[Block], columns: Sequence[IntArray], tolerance: float
    ) -> None:
        """Set it up.

        Args:
            blocks: What it asks of each leg.
            columns: Which of the program's variables each leg's V are, shape (V,).
            tolerance: Of the solution, absolute and relative.
        """
        self._blocks, self._columns, self._tolerance = blocks, columns, tolerance
        self._size = 1 + max(int(own.max()) for own in columns)
        self._hessian = self._summed_hessians()
        self._linear = np.zeros(self._size)
        self._lower, self._upper = np.full((2, self._size), np.inf)
        self._lower *= -1
        for block, own in zip(blocks, columns, strict=True):
            np.add.at(self._linear, own, block.linear)
            np.maximum.at(self._lower, own, block.lower)
            np.minimum.at(self._upper, own, block.upper)
        self._widths = np.concatenate([block.widths for block in blocks])
        parts = [(rows, k) for k, block in enumerate(blocks) for rows in block.rows]
        parts += [(block.width_changes, k) for k, block in enumerate(blocks)]
        self._matrix = self._over_all(parts)
        self._slack = np.concatenate([block.slack for block in blocks])
        held = [(block.held, k) for k, block in enumerate(blocks) if len(block.bounds.held)]
        self._held = self._over_all(held) if held else None
        self._solver: piqp.SparseSolver | None = None

    def solve(self) -> tuple[Step, ...] | None:
        """Return the step of every leg, or None if no solver finds one."""
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
            steps = self._solution(solver)
            if steps is not None:
                self._solver = solver
                return steps
        return None

    def solve_again(self, slack: Sequence[FloatArray]) -> tuple[Step, ...] | None:
        """Return the steps with other slack for the legs' rows, once there was a solution."""
        if self._solver is None:
            return None
        self._solver.update(h_u=self._most(np.concatenate(slack)))
        return self._solution(self._solver)

    def _most(self, slack: FloatArray) -> FloatArray:
        return np.concatenate([slack, self._widths])

    def _summed_hessians(self) -> sparse.csc_matrix:
        """Return the sum of the legs' curvatures, over all that may change."""
        if np.array_equal(self._columns[0], np.arange(self._size)):  # a leg alone, as it is
            return self._blocks[0].quadratic.hessian
        parts = [block.quadratic.hessian.tocoo() for block in self._blocks]
        placed = list(zip(parts, self._columns, strict=True))
        value = np.concatenate([part.data for part in parts])
        row = np.concatenate([own[part.row] for part, own in placed])
        column = np.concatenate([own[part.col] for part, own in placed])
        return sparse.coo_matrix((value, (row, column)), (self._size, self._size)).tocsc()

    def _over_all(self, parts: Sequence[tuple[SparseRows, int]]) -> sparse.csc_matrix:
        """Return the matrix of several sets of rows, each of a leg."""
        placed = [replace(rows, column=self._columns[leg][rows.column]) for rows, leg in parts]
        return _matrix(placed, self._size)

    def _solution(self, solver: piqp.SparseSolver) -> tuple[Step, ...] | None:
        status = solver.solve()
        x = np.array(solver.result.x)
        if status != piqp.PIQP_SOLVED or len(x) != len(self._lower) or not np.isfinite(x).all():
            return None
        x = np.clip(x, self._lower, self._upper)
        ends = np.cumsum([len(block.slack) for block in self._blocks])
        multipliers = np.split(np.array(solver.result.z_u)[: ends[-1]], ends[:-1])
        legs = zip(self._blocks, self._columns, multipliers, strict=True)
        return tuple(block.step(x[own], each) for block, own, each in legs)


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
