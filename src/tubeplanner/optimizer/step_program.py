"""The program of one step over all legs: native banded solver, or PIQP.

It minimises the sum over legs of

    duration * eta + penalty * elastic + gradient . z + x . hessian . x / 2

under the rows, z being a leg's configurations and switching times, and x its V variables: z, eta,
elastic. A leg has F configurations of n joints and m-1 switching times; legs may share variables.
"""

from collections.abc import Sequence
from ctypes import c_double, c_int, c_int64, c_void_p
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.native.library import Doubles, Integers, native_function
from tubeplanner.optimizer.rows import Rows

_compressed = native_function(
    *("compressed_rows", *(c_int64,) * 5, Integers, *(Doubles,) * 4, *(Integers,) * 3, Doubles),
    returns=c_int64,
)
_new: Any = native_function(
    "step_program_new", c_int64, c_int64, Doubles, Doubles, Doubles, Doubles, returns=c_void_p
)
_delete: Any = native_function("step_program_delete", c_void_p)
_add_quadratic: Any = native_function(
    "step_program_add_quadratic", c_void_p, c_int64, Integers, Integers, Doubles
)
_add_rows: Any = native_function(
    "step_program_add_rows", c_void_p, c_int64, Integers, Integers, Doubles, Doubles
)
_set_slack: Any = native_function("step_program_set_slack", c_void_p, Doubles)
_solve: Any = native_function("step_program_solve", c_void_p, c_double, c_int64, returns=c_int)
_read: Any = native_function("step_program_read", c_void_p, Doubles, Doubles, returns=c_int64)


@dataclass(frozen=True, eq=False)
class SymmetricEntries:
    """A symmetric matrix by entries on both sides of its diagonal; equal places are summed."""

    row: IntArray  # shape (E,)
    column: IntArray  # shape (E,)
    value: FloatArray  # shape (E,)
    size: int  # number of rows and columns

    def times(self, factor: float) -> "SymmetricEntries":
        """Return a multiple of the matrix."""
        return replace(self, value=self.value * factor)

    def plus(self, other: "SymmetricEntries") -> "SymmetricEntries":
        """Return the sum of two matrices of equal size."""
        row, column, value = (
            np.concatenate([getattr(self, name), getattr(other, name)])
            for name in ("row", "column", "value")
        )
        return SymmetricEntries(row, column, value, self.size)

    def among(self, variables: IntArray, size: int) -> "SymmetricEntries":
        """Return the matrix over `size` variables, of which `variables` are its own."""
        return SymmetricEntries(variables[self.row], variables[self.column], self.value, size)

    def product(self, x: FloatArray) -> FloatArray:
        """Return the matrix times a vector (size,)."""
        terms = self.value * x[self.column]
        product: FloatArray = np.bincount(self.row, terms, self.size).astype(np.float64)
        return product

    def dense(self) -> FloatArray:
        """Return the matrix, shape (size, size)."""
        whole = np.zeros((self.size, self.size))
        np.add.at(whole, (self.row, self.column), self.value)
        return whole


def merged_entries(row: IntArray, column: IntArray, size: int) -> tuple[IntArray, ...]:
    """Return rows and columns of the distinct places of entries, and each entry's place number."""
    keys, index = np.unique(column.astype(np.int64) * size + row, return_inverse=True)
    return keys % size, keys // size, index


# ---- Rows, bounds and cost of one leg in the program of one step.


@dataclass(frozen=True, eq=False)
class Quadratic:
    """Cost of a step without the elastic variable."""

    hessian: SymmetricEntries  # shape (V, V)
    gradient: FloatArray  # over configurations and switching times, shape (V-2,)
    duration: float = 1.0  # cost of eta

    def times(self, factor: float) -> "Quadratic":
        """Return a multiple of its curvature and gradient."""
        return replace(self, hessian=self.hessian.times(factor), gradient=self.gradient * factor)

    def weighted(self, weight: float) -> "Quadratic":
        """Return a multiple of the cost."""
        return replace(self.times(weight), duration=self.duration * weight)


@dataclass(frozen=True, eq=False)
class Bounds:
    """Bounds on a step."""

    lower: FloatArray  # of the configurations, shape (F, n)
    upper: FloatArray  # of the configurations, shape (F, n)
    switching: FloatArray  # largest steps of the switching times, shape (m-1,)
    widths: FloatArray  # largest changes of the widths of phases, shape (m,)
    duration: tuple[float, float]  # smallest and largest eta
    # directions in which the last variable must not move, shape (r, n)
    fixed_directions: FloatArray


@dataclass(frozen=True, eq=False)
class Step:
    """The solution of a program for one leg."""

    control: FloatArray  # of the configurations, shape (F, n)
    switching: FloatArray  # of the switching times, shape (m-1,)
    duration: float  # eta
    elastic: float  # largest violation of elastic rows
    multipliers: FloatArray  # of the rows, shape (R,)


@dataclass(frozen=True, eq=False)
class SparseRows:
    """R compressed rows over the variables."""

    data: FloatArray  # entries, row after row, shape (entries,)
    column: IntArray  # their columns, shape (entries,)
    count: IntArray  # number of entries of each row, shape (R,)


_NO_ROWS = SparseRows(np.zeros(0), np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))


def stacked_rows(parts: Sequence[SparseRows]) -> SparseRows:
    """Return the concatenation of sets of rows."""
    names = ("data", "column", "count")
    parts = (_NO_ROWS, *parts)
    return SparseRows(*(np.concatenate([getattr(p, name) for p in parts]) for name in names))


@dataclass(frozen=True, eq=False)
class Block:
    """One leg in a program, over z (configurations and switching times), eta, elastic."""

    rows: Sequence[SparseRows]  # the constraints, R rows in all, from `sparse_rows`
    slack: FloatArray  # of the rows, shape (R,)
    bounds: Bounds  # of the step
    quadratic: Quadratic  # cost of the step
    penalty: float  # weight of the elastic variable

    @property
    def linear(self) -> FloatArray:
        """The cost's gradient, shape (V,)."""
        own = self.quadratic
        return np.concatenate([own.gradient, [own.duration, self.penalty]])

    @property
    def lower(self) -> FloatArray:
        """Lower bounds of the variables, shape (V,)."""
        own = self.bounds
        return np.concatenate([own.lower.ravel(), -own.switching, [own.duration[0], 0.0]])

    @property
    def upper(self) -> FloatArray:
        """Upper bounds of the variables, shape (V,)."""
        own = self.bounds
        return np.concatenate([own.upper.ravel(), own.switching, [own.duration[1], np.inf]])

    @property
    def widths(self) -> FloatArray:
        """Largest changes of the phases, (m,); none, (0,), if switching times are fixed."""
        return self.bounds.widths if len(self.bounds.switching) else np.zeros(0)

    @property
    def width_changes(self) -> SparseRows:
        """Changes of the phases' widths by the switching times, as rows.

        A phase grows with the time that ends it, and shrinks with the one that begins it.
        """
        switches = len(self.bounds.switching)
        if switches == 0:
            return _NO_ROWS
        counts = np.concatenate([[1], np.full(switches - 1, 2), [1]])
        column = self.bounds.lower.size + np.repeat(np.arange(switches), 2)
        return SparseRows(np.tile([1.0, -1.0], switches), column, counts)

    @property
    def held(self) -> tuple[IntArray, FloatArray]:
        """The variables (n,) of the last configuration, and the directions (r, n) held there."""
        size, directions = self.bounds.lower.size, self.bounds.fixed_directions
        return np.arange(size - directions.shape[1], size), directions

    def step(self, x: FloatArray, multipliers: FloatArray) -> Step:
        """Return the step with values (V,) of the variables."""
        lower = self.bounds.lower
        control, switching = x[: lower.size].reshape(lower.shape), x[lower.size : -2]
        return Step(control, switching, float(x[-2]), float(x[-1]), multipliers)


def sparse_rows(rows: Rows, is_elastic: FloatArray, column: IntArray, free: int) -> SparseRows:
    """Return rows over the variables.

    Args:
        rows: R constraints.
        is_elastic: 1 for rows that may be violated at a penalty, else 0, shape (R,).
        column: The configuration of every control point, -1 where it is fixed, shape (K,).
        free: Number F of configurations.
    """
    count, weights, n = rows.control.shape
    switches = rows.switching.shape[1]
    if _compressed is not None:
        size = count * (weights * n + switches + 2)
        each, columns, data = np.empty(count, np.int64), np.empty(size, np.int64), np.empty(size)
        reals = (rows.control, rows.switching, rows.duration, is_elastic)
        first, *entries, own = map(np.ascontiguousarray, (rows.first, *reals, column))
        sizes = (count, weights, n, switches, free)
        end = _compressed(*sizes, first, *entries, own, each, columns, data)
        return SparseRows(data[:end], columns[:end], each)
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


@dataclass(frozen=True, eq=False)
class JointBlocks:
    """The blocks of all legs over the program's variables."""

    blocks: Sequence[Block]  # one of each leg
    columns: Sequence[IntArray]  # the program's variables that are each leg's, shape (V,)

    @cached_property
    def size(self) -> int:
        """Number of the program's variables."""
        return 1 + max(int(own.max()) for own in self.columns)

    @property
    def hessian(self) -> SymmetricEntries:
        """The sum of the legs' curvatures."""
        parts = zip(self.blocks, self.columns, strict=True)
        total, *others = (block.quadratic.hessian.among(own, self.size) for block, own in parts)
        for other in others:
            total = total.plus(other)
        return total

    @property
    def linear(self) -> FloatArray:
        """The cost's gradient."""
        total = np.zeros(self.size)
        for block, own in zip(self.blocks, self.columns, strict=True):
            np.add.at(total, own, block.linear)
        return total

    @cached_property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds of the variables; both legs bound a shared variable."""
        lower, upper = np.full(self.size, -np.inf), np.full(self.size, np.inf)
        for block, own in zip(self.blocks, self.columns, strict=True):
            np.maximum.at(lower, own, block.lower)
            np.minimum.at(upper, own, block.upper)
        return lower, upper

    @property
    def held(self) -> list[tuple[IntArray, FloatArray]]:
        """Variables (n,) and their orthogonal held directions (r, n), of legs that have some."""
        each = zip(self.columns, (block.held for block in self.blocks), strict=True)
        return [(own[which], held) for own, (which, held) in each if len(held)]

    def over_all(self, rows: SparseRows, leg: int) -> SparseRows:
        """Return rows of a leg over the program's variables."""
        return replace(rows, column=self.columns[leg][rows.column])

    def steps(self, x: FloatArray, multipliers: Sequence[FloatArray]) -> tuple[Step, ...]:
        """Return the legs' steps from the program's variables and their rows' multipliers."""
        legs = zip(self.blocks, self.columns, multipliers, strict=True)
        return tuple(block.step(x[own], each) for block, own, each in legs)


# ---- The program of one step for the native library: rows join it while it is being solved.

# The first eta, and the first elastic variable beyond the largest violation.
_FIRST_DURATION_STEP, _FIRST_SPARE = 0.2, 0.1
# Of held directions: neither rows nor curvature move them, this balances bounds alone.
_STIFFNESS = 1e9
_MAX_ITERATIONS = 100


class BandedProgram:
    """A program of the native library, which goes on from its last solution when rows join it.

    Attributes:
        goes_on: Whether solutions go on from the last solution after rows have joined.
        iterations: Of the last solution.
    """

    goes_on = True

    def __init__(self, blocks: Sequence[Block], columns: Sequence[IntArray]) -> None:
        """Set the program up; arguments as `step_program`."""
        self._handle: Any = None
        self._columns, self.iterations = columns, 0
        self._blocks = joint = JointBlocks(blocks, columns)
        self._bounds, self._held = joint.bounds, joint.held
        linear = self._without_held(joint.linear)
        first = np.zeros(joint.size)
        for block, own in zip(blocks, columns, strict=True):
            violation = max(-float(block.slack.min(initial=0.0)), 0.0)
            first[own[-2:]] = _FIRST_DURATION_STEP, violation + _FIRST_SPARE
        self._handle = _new(joint.size, self._band(), first, linear, *self._bounds)
        hessian = joint.hessian
        for variables, directions in self._held:
            hessian = _flattened(hessian, variables, directions)
        self._add_quadratic(hessian.row, hessian.column, hessian.value)
        for variables, directions in self._held:
            column, other = np.meshgrid(variables, variables)
            for direction in directions:
                square = _STIFFNESS * np.outer(direction, direction)
                self._add_quadratic(column.ravel(), other.ravel(), square.ravel())
        self._slack = np.zeros(0)
        for leg, block in enumerate(blocks):
            changes = joint.over_all(block.width_changes, leg)
            for sign in (1.0, -1.0):
                if len(changes.count):
                    self._add(replace(changes, data=sign * changes.data), block.widths)
        # The numbers of each leg's rows in the program, and the number of sets of rows it has.
        self._numbers = [np.zeros(0, dtype=np.int64) for _ in blocks]
        self._set_counts = [0] * len(blocks)
        self.join(blocks)

    def __del__(self) -> None:
        if self._handle is not None:
            _delete(self._handle)

    def join(self, blocks: Sequence[Block]) -> None:
        """Add the new rows of blocks, with their slack."""
        self._blocks = JointBlocks(blocks, self._columns)
        for leg, block in enumerate(blocks):
            slack = block.slack[len(self._numbers[leg]) :]
            added = stacked_rows(block.rows[self._set_counts[leg] :])
            self._set_counts[leg] = len(block.rows)
            if len(slack):
                numbers = self._add(self._blocks.over_all(added, leg), slack)
                self._numbers[leg] = np.concatenate([self._numbers[leg], numbers])

    def correct(self, blocks: Sequence[Block]) -> None:
        """Add the new rows of blocks, and set the slack of all rows; solutions begin anew."""
        self.join(blocks)
        for block, numbers in zip(blocks, self._numbers, strict=True):
            self._slack[numbers] = block.slack
        _set_slack(self._handle, self._slack)

    def solve(self, tolerance: float) -> tuple[Step, ...] | None:
        """Return the step of every leg, or None if the method does not converge.

        Args:
            tolerance: Of the gradient, the rows and the cost, absolute.
        """
        is_solved = _solve(self._handle, tolerance, _MAX_ITERATIONS)
        x, multipliers = np.empty(self._blocks.size), np.empty(len(self._slack))
        self.iterations = _read(self._handle, x, multipliers)
        if not is_solved:
            return None
        x = self._without_held(x)
        by_leg = [multipliers[own] for own in self._numbers]
        return self._blocks.steps(np.clip(x, *self._bounds), by_leg)

    def _without_held(self, x: FloatArray) -> FloatArray:
        """Return values of the variables without their parts along held directions."""
        for variables, directions in self._held:
            for direction in directions:
                x[variables] -= direction * (direction @ x[variables])
        return x

    def _add_quadratic(self, row: IntArray, column: IntArray, value: FloatArray) -> None:
        own = (np.ascontiguousarray(part, dtype=np.int64) for part in (row, column))
        _add_quadratic(self._handle, len(value), *own, np.ascontiguousarray(value))

    def _add(self, rows: SparseRows, slack: FloatArray) -> IntArray:
        """Add rows; return their numbers."""
        for variables, directions in self._held:
            rows = _projected(rows, variables, directions)
        fits = len(rows.count) == len(slack) and len(rows.column) == len(rows.data)
        fits &= len(rows.data) == rows.count.sum()
        if not fits or rows.column.max(initial=0) >= self._blocks.size:
            raise ValueError("rows and slack do not fit the program")
        own = (np.ascontiguousarray(part, dtype=np.int64) for part in (rows.count, rows.column))
        _add_rows(self._handle, len(slack), *own, np.ascontiguousarray(rows.data), slack)
        self._slack = np.concatenate([self._slack, slack])
        return np.arange(len(self._slack) - len(slack), len(self._slack))

    def _band(self) -> int:
        """Return the number of first variables that are coupled with near variables only.

        The configuration in which a cycle closes is behind all others.
        """
        legs = list(zip(self._blocks.blocks, self._columns, strict=True))
        controls = [own[: block.bounds.lower.size] for block, own in legs]
        last = max((int(own.max()) for own in controls if len(own)), default=-1)
        band = last + 1
        for own in controls:
            if (np.diff(own) < 0).any():
                band = min(band, int(own[0]))
        return band


def _flattened(
    entries: SymmetricEntries, columns: IntArray, directions: FloatArray
) -> SymmetricEntries:
    """Return curvature that vanishes along directions (r, n) of some variables (n,)."""
    index = np.full(entries.size, -1)
    index[columns] = np.arange(len(columns))
    row, column = index[entries.row], index[entries.column]
    own = np.zeros((entries.size, len(columns)))
    np.add.at(own, (entries.row[column >= 0], column[column >= 0]), entries.value[column >= 0])
    own -= own @ directions.T @ directions
    own[columns] -= directions.T @ (directions @ own[columns])
    first, second = np.nonzero(own)
    others = index[first] < 0  # coupling with other variables is on both sides
    rest = (row < 0) & (column < 0)
    return SymmetricEntries(
        np.concatenate([entries.row[rest], first, columns[second][others]]),
        np.concatenate([entries.column[rest], columns[second], first[others]]),
        np.concatenate([entries.value[rest], own[first, second], own[first, second][others]]),
        entries.size,
    )


def _projected(rows: SparseRows, columns: IntArray, directions: FloatArray) -> SparseRows:
    """Return rows without their parts along directions (r, n) of some variables (n,)."""
    number = np.repeat(np.arange(len(rows.count)), rows.count)
    index_of = np.full(max(columns.max(), rows.column.max(initial=0)) + 1, -1)
    index_of[columns] = np.arange(len(columns))
    index = index_of[rows.column]
    is_own = index >= 0
    if not is_own.any():
        return rows
    own = np.zeros((len(rows.count), len(columns)))
    np.add.at(own, (number[is_own], index[is_own]), rows.data[is_own])
    own -= own @ directions.T @ directions
    row, column = np.nonzero(own)
    number = np.concatenate([number[~is_own], row])
    sequence = np.argsort(number, kind="stable")
    data = np.concatenate([rows.data[~is_own], own[row, column]])[sequence]
    column = np.concatenate([rows.column[~is_own], columns[column]])[sequence]
    return SparseRows(data, column, np.bincount(number, minlength=len(rows.count)))


# ---- The program of one step for PIQP, an interior-point method for sparse problems.

# Tried in turn: the first is the fastest for control points in the order of time.
_SOLVERS = ("sparse_multistage", "sparse_ldlt", "sparse_ldlt_cond")


class SparseProgram:
    """A program that begins anew when rows join it; members as of `BandedProgram`."""

    goes_on = False

    def __init__(self, blocks: Sequence[Block], columns: Sequence[IntArray]) -> None:
        """Set the program up; arguments as `step_program`."""
        self._columns = columns
        self._solver: Any = None
        self.join(blocks)

    def join(self, blocks: Sequence[Block]) -> None:
        """Set the rows of blocks."""
        self._blocks, self._solver = JointBlocks(blocks, self._columns), None

    def correct(self, blocks: Sequence[Block]) -> None:
        """Set the rows of blocks; where none is new, only their slack."""
        counts = [[len(block.slack) for block in each] for each in (blocks, self._blocks.blocks)]
        if self._solver is None or counts[0] != counts[1]:
            return self.join(blocks)
        self._blocks = JointBlocks(blocks, self._columns)
        self._solver.update(h_u=self._most())
        return None

    def solve(self, tolerance: float) -> tuple[Step, ...] | None:
        """Return the step of every leg, or None if no solver converges."""
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
        # With the native library, neither of these is loaded.
        import piqp
        from scipy import sparse

        joint, entries = self._blocks, self._blocks.hessian
        hessian = sparse.coo_matrix(
            (entries.value, (entries.row, entries.column)), (entries.size, entries.size)
        )
        solver = piqp.SparseSolver()
        settings = solver.settings
        settings.kkt_solver = getattr(piqp.KKTSolver, kind)
        settings.preconditioner_iter = 0  # rows are scaled by their limits already
        settings.eps_abs = settings.eps_rel = tolerance
        settings.eps_duality_gap_abs = settings.eps_duality_gap_rel = tolerance
        rows = [
            joint.over_all(own, k) for k, block in enumerate(joint.blocks) for own in block.rows
        ]
        held = [
            SparseRows(own.ravel(), np.tile(which, len(own)), np.full(len(own), len(which)))
            for which, own in joint.held
        ]
        widths = [joint.over_all(block.width_changes, k) for k, block in enumerate(joint.blocks)]
        fixed = _matrix(held, joint.size)
        count = sum(len(block.slack) for block in joint.blocks)
        solver.setup(
            hessian.tocsc(),
            joint.linear,
            fixed if fixed.shape[0] else None,
            np.zeros(fixed.shape[0]) if fixed.shape[0] else None,
            _matrix([*rows, *widths], joint.size),
            np.concatenate([np.full(count, -np.inf), *(-block.widths for block in joint.blocks)]),
            self._most(),
            *joint.bounds,
        )
        return solver

    def _most(self) -> FloatArray:
        blocks = self._blocks.blocks
        return np.concatenate([*(own.slack for own in blocks), *(own.widths for own in blocks)])

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


def _matrix(parts: Sequence[SparseRows], columns: int) -> Any:
    from scipy import sparse

    rows = stacked_rows(parts)
    # scipy.sparse takes 32-bit indices without a copy.
    ends = np.concatenate([[0], np.cumsum(rows.count)]).astype(np.int32)
    column = rows.column.astype(np.int32, copy=False)
    matrix = sparse.csr_matrix((rows.data, column, ends), shape=(len(rows.count), columns))
    matrix.sum_duplicates()  # control points that move as one
    return matrix.tocsc()


StepProgram: TypeAlias = BandedProgram | SparseProgram


def step_program(blocks: Sequence[Block], columns: Sequence[IntArray]) -> StepProgram:
    """Set up a program, native if the library is there.

    Args:
        blocks: One of each leg.
        columns: The program's variables that are each leg's, shape (V,).
    """
    return SparseProgram(blocks, columns) if _new is None else BandedProgram(blocks, columns)
