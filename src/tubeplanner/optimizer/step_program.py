"""The program of one step over all legs: native banded solver, or PIQP."""

from collections.abc import Sequence
from ctypes import c_double, c_int, c_int64, c_void_p
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.native.library import LIBRARY, Doubles, Integers, native_function
from tubeplanner.optimizer.step_block import (
    Block,
    JointBlocks,
    SparseRows,
    Step,
    SymmetricEntries,
    stacked_rows,
)

# ---- The program of one step, of one or more legs.
#
# It minimises the sum over legs of duration * eta + penalty * elastic + gradient . z + x . hessian
# . x / 2 under the rows, z being a leg's configurations and switching times, and x its variables:
# z, eta, elastic. Legs may have common variables.


class StepProgram(Protocol):
    """A program with a block of each leg."""

    def solve(self, tolerance: float) -> tuple[Step, ...] | None:
        """Return the step of every leg, None without a solution; tolerance: of the cost."""
        ...

    def join(self, blocks: Sequence[Block]) -> None:
        """Append the new rows of blocks, with their slack."""
        ...

    def correct(self, blocks: Sequence[Block]) -> None:
        """Add the new rows of blocks, and set the slack of all rows."""
        ...

    @property
    def goes_on(self) -> bool:
        """True if solutions go on from the last solution after rows have joined."""
        ...


def step_program(blocks: Sequence[Block], columns: Sequence[IntArray]) -> StepProgram:
    """Set up a program, native if the library is there.

    Args:
        blocks: One of each leg.
        columns: The program's variables that are each leg's, shape (V,).
    """
    if LIBRARY.functions is None:
        return SparseProgram(blocks, columns)
    return BandedProgram(blocks, columns)


# ---- The program of one step for the native library: rows join it while it is being solved.

# The first eta, and the first elastic variable beyond the largest violation.
_FIRST_DURATION_STEP, _FIRST_SPARE = 0.2, 0.1
# Of held directions: neither rows nor curvature move them, this balances bounds alone.
_STIFFNESS = 1e9


class BandedProgram:
    """A program that goes on from its last solution when rows join it; see `StepProgram`."""

    goes_on = True

    def __init__(self, blocks: Sequence[Block], columns: Sequence[IntArray]) -> None:
        """Set the program up; arguments as `step_program`."""
        self._columns = columns
        self._blocks = joint = JointBlocks(blocks, columns)
        self._bounds = joint.bounds
        self._held = [row for directions in joint.held for row in directions.rows()]
        linear = joint.linear
        for row in self._held:
            linear[row.column] -= row.data * (row.data @ linear[row.column])
        first = np.zeros(joint.size)
        for block, own in zip(blocks, columns, strict=True):
            violation = max(-float(block.slack.min(initial=0.0)), 0.0)
            first[own[-2:]] = _FIRST_DURATION_STEP, violation + _FIRST_SPARE
        self._program = NativeProgram(first, linear, *self._bounds, self._band())
        hessian = joint.hessian
        for variables, directions in _groups(self._held):
            hessian = _flattened(hessian, variables, directions)
        self._program.add_quadratic(hessian.row, hessian.column, hessian.value)
        for row in self._held:
            column, other = np.meshgrid(row.column, row.column)
            square = _STIFFNESS * np.outer(row.data, row.data)
            self._program.add_quadratic(column.ravel(), other.ravel(), square.ravel())
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

    def join(self, blocks: Sequence[Block]) -> None:
        """Add the new rows of blocks."""
        self._blocks = JointBlocks(blocks, self._columns)
        for leg, block in enumerate(blocks):
            slack = block.slack[len(self._numbers[leg]) :]
            added = stacked_rows(block.rows[self._set_counts[leg] :])
            self._set_counts[leg] = len(block.rows)
            if len(slack):
                numbers = self._add(self._blocks.over_all(added, leg), slack)
                self._numbers[leg] = np.concatenate([self._numbers[leg], numbers])

    def correct(self, blocks: Sequence[Block]) -> None:
        """Add the new rows of blocks, and set the slack of all rows."""
        self.join(blocks)
        for block, numbers in zip(blocks, self._numbers, strict=True):
            self._slack[numbers] = block.slack
        self._program.set_slack(self._slack)

    def solve(self, tolerance: float) -> tuple[Step, ...] | None:
        """Return the step of every leg, or None if the method does not converge."""
        solution = self._program.solve(tolerance)
        if solution is None:
            return None
        x, multipliers = solution
        for row in self._held:
            x[row.column] -= row.data * (row.data @ x[row.column])
        by_leg = [multipliers[own] for own in self._numbers]
        return self._blocks.steps(np.clip(x, *self._bounds), by_leg)

    def _add(self, rows: SparseRows, slack: FloatArray) -> IntArray:
        """Add rows; return their numbers."""
        if self._held:
            rows = _without(rows, self._held)
        self._program.add_rows(rows.count, rows.column, rows.data, slack)
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


def _without(rows: SparseRows, held: Sequence[SparseRows]) -> SparseRows:
    """Return rows without their changes along held directions, which are orthogonal."""
    for columns, directions in _groups(held):
        rows = _projected(rows, columns, directions)
    return rows


def _groups(held: Sequence[SparseRows]) -> list[tuple[IntArray, FloatArray]]:
    """Return sets of variables (n,) and their held directions (r, n)."""
    groups: dict[tuple[int, ...], list[FloatArray]] = {}
    for row in held:
        groups.setdefault(tuple(row.column.tolist()), []).append(row.data)
    return [(np.array(columns), np.array(own)) for columns, own in groups.items()]


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


# ---- The native program of one step: quadratic, sparse, banded but for a few variables.

_new = native_function(
    "step_program_new", c_int64, c_int64, Doubles, Doubles, Doubles, Doubles, returns=c_void_p
)
_delete = native_function("step_program_delete", c_void_p)
_add_quadratic = native_function(
    "step_program_add_quadratic", c_void_p, c_int64, Integers, Integers, Doubles
)
_add_rows = native_function(
    "step_program_add_rows", c_void_p, c_int64, Integers, Integers, Doubles, Doubles
)
_set_slack = native_function("step_program_set_slack", c_void_p, Doubles)
_solve = native_function("step_program_solve", c_void_p, c_double, c_int64, returns=c_int)
_read = native_function("step_program_read", c_void_p, Doubles, Doubles, returns=c_int64)
_MAX_ITERATIONS = 100


class NativeProgram:
    """Minimisation of x . Q x / 2 + c . x under A x <= b and bounds on x.

    Rows may be added after it was solved: the next solution goes on from the last.
    """

    def __init__(
        self, first: FloatArray, linear: FloatArray, lower: FloatArray, upper: FloatArray, band: int
    ) -> None:
        """Set the program up without rows.

        Args:
            first: The first x, shape (V,).
            linear: c, shape (V,).
            lower: Of x, shape (V,).
            upper: Likewise; may be infinite.
            band: How many of the first variables only rows and Q's entries of neighbours couple.
        """
        self._handle: Any = None
        self._size, self.row_count, self.iterations = len(linear), 0, 0
        self._handle = _call(_new)(len(linear), band, first, linear, lower, upper)

    def __del__(self) -> None:
        if self._handle is not None:
            _call(_delete)(self._handle)

    def add_quadratic(self, row: IntArray, column: IntArray, value: FloatArray) -> None:
        """Add entries (E,) of Q; entries below the diagonal are ignored."""
        own = (np.ascontiguousarray(part, dtype=np.int64) for part in (row, column))
        _call(_add_quadratic)(self._handle, len(value), *own, np.ascontiguousarray(value))

    def add_rows(
        self, count: IntArray, column: IntArray, value: FloatArray, slack: FloatArray
    ) -> None:
        """Add R rows.

        Args:
            count: Number of entries of each, shape (R,).
            column: Columns of the entries, row after row, shape (entries,); they may repeat.
            value: Values of the entries, shape (entries,).
            slack: b, shape (R,).

        Raises:
            ValueError: They do not fit together, or the program has no such variable.
        """
        fits = len(count) == len(slack) and len(column) == len(value) == count.sum()
        if not fits or column.max(initial=0) >= self._size:
            raise ValueError("rows and slack do not fit the program")
        own = (np.ascontiguousarray(part, dtype=np.int64) for part in (count, column))
        _call(_add_rows)(self._handle, len(slack), *own, np.ascontiguousarray(value), slack)
        self.row_count += len(slack)

    def set_slack(self, slack: FloatArray) -> None:
        """Set the slack (R,) of all rows; the next solution begins anew."""
        _call(_set_slack)(self._handle, slack)

    def solve(self, tolerance: float) -> tuple[FloatArray, FloatArray] | None:
        """Return x (V,) and the rows' multipliers (R,), or None without convergence.

        Args:
            tolerance: Of the gradient, the rows and the cost, absolute.
        """
        is_solved = _call(_solve)(self._handle, tolerance, _MAX_ITERATIONS)
        x, multipliers = np.empty(self._size), np.empty(self.row_count)
        self.iterations = _call(_read)(self._handle, x, multipliers)
        return (x, multipliers) if is_solved else None


def _call(function: Any) -> Any:
    if function is None:
        raise RuntimeError("the native library is left out")
    return function


# ---- The program of one step for PIQP, an interior-point method for sparse problems.

# Tried in turn: the first is the fastest for control points in the order of time.
_SOLVERS = ("sparse_multistage", "sparse_ldlt", "sparse_ldlt_cond")


class SparseProgram:
    """A program that begins anew when rows join it; see `StepProgram`."""

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
        fixed = _matrix(joint.held, joint.size)
        lower, upper = joint.bounds
        count = sum(len(block.slack) for block in joint.blocks)
        solver.setup(
            hessian.tocsc(),
            joint.linear,
            fixed if fixed.shape[0] else None,
            np.zeros(fixed.shape[0]) if fixed.shape[0] else None,
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


def _matrix(parts: Sequence[SparseRows], columns: int) -> Any:
    from scipy import sparse

    rows = stacked_rows(parts)
    # scipy.sparse takes 32-bit indices without a copy.
    ends = np.concatenate([[0], np.cumsum(rows.count)]).astype(np.int32)
    column = rows.column.astype(np.int32, copy=False)
    matrix = sparse.csr_matrix((rows.data, column, ends), shape=(len(rows.count), columns))
    matrix.sum_duplicates()  # control points that move as one
    return matrix.tocsc()
