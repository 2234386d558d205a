"""Block: rows, bounds and cost of one leg in a step's program, as sparse entries."""

from collections.abc import Iterator, Sequence
from ctypes import c_int64
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.native.library import LIBRARY, Doubles, Integers, native_function
from tubeplanner.optimizer.rows import Rows

# ---- Symmetric matrices by their entries, some of which may stand at one place: they are summed.


@dataclass(frozen=True, eq=False)
class SymmetricEntries:
    """A symmetric matrix; entries off the diagonal stand on both of its sides.

    Attributes:
        row: Shape (E,).
        column: Shape (E,).
        value: Shape (E,).
        size: Number of rows and columns.
    """

    row: IntArray
    column: IntArray
    value: FloatArray
    size: int

    def times(self, factor: float) -> "SymmetricEntries":
        """Return a multiple."""
        return replace(self, value=self.value * factor)

    def plus(self, other: "SymmetricEntries") -> "SymmetricEntries":
        """Return the sum of two matrices of one size."""
        row, column, value = (
            np.concatenate([getattr(self, name), getattr(other, name)])
            for name in ("row", "column", "value")
        )
        return SymmetricEntries(row, column, value, self.size)

    def among(self, variables: IntArray, size: int) -> "SymmetricEntries":
        """Return the matrix over more variables (size,), its own being those that are given."""
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
    """Return the different places of entries, rows and columns, and each entry's among them."""
    keys, place = np.unique(column.astype(np.int64) * size + row, return_inverse=True)
    return keys % size, keys // size, place


# ---- What the program of one step asks of one leg: its rows, its bounds and its cost.

_compressed = native_function(
    "compressed_rows",
    *(c_int64,) * 5,
    Integers,
    *(Doubles,) * 4,
    *(Integers,) * 3,
    Doubles,
    returns=c_int64,
)


@dataclass(frozen=True, eq=False)
class Quadratic:
    """What a step costs, but for the elastic variable.

    Attributes:
        hessian: Over all that may change, shape (V, V).
        gradient: Over configurations and switching times, shape (V-2,).
        duration: What eta costs.
    """

    hessian: SymmetricEntries
    gradient: FloatArray
    duration: float = 1.0

    def times(self, factor: float) -> "Quadratic":
        """Return a multiple of its curvature and gradient."""
        return replace(self, hessian=self.hessian.times(factor), gradient=self.gradient * factor)

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

    def rows(self) -> Iterator["SparseRows"]:
        """Yield the rows one by one."""
        ends = np.cumsum(self.count)
        for begin, end in zip(ends - self.count, ends, strict=True):
            yield SparseRows(self.data[begin:end], self.column[begin:end], np.array([end - begin]))


def stacked_rows(parts: Sequence[SparseRows]) -> SparseRows:
    """Return several sets of rows as one."""
    if len(parts) == 1:
        return parts[0]
    nothing = np.zeros(0, dtype=np.int64)
    none = SparseRows(np.zeros(0), nothing, nothing)
    names = ("data", "column", "count")
    return SparseRows(*(np.concatenate([getattr(p, n) for p in (none, *parts)]) for n in names))


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


def sparse_rows(rows: Rows, is_elastic: FloatArray, column: IntArray, free: int) -> SparseRows:
    """Return rows over all that may change.

    Args:
        rows: R constraints.
        is_elastic: 1 for rows that may be violated at a penalty, else 0, shape (R,).
        column: The variable of every control point, -1 where it is fixed, shape (K,).
        free: How many variables there are.
    """
    if LIBRARY.functions is not None:
        entries = (rows.first, rows.control, rows.switching, rows.duration, is_elastic)
        each, columns, data = compressed_rows(*entries, column, free)
        return SparseRows(data, columns, each)
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


def compressed_rows(
    first: IntArray,
    control: FloatArray,
    switching: FloatArray,
    duration: FloatArray,
    is_elastic: FloatArray,
    variable: IntArray,
    free: int,
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the entries of R rows over all that may change, but for zeros.

    Args:
        first: The first control point that counts, shape (R,).
        control: By the four that do, shape (R, 4, n).
        switching: By switching times, shape (R, m-1).
        duration: By eta, shape (R,).
        is_elastic: What the elastic variable gives, shape (R,).
        variable: Of every control point, -1 where it is fixed, shape (K,).
        free: How many variables there are.

    Returns:
        How many each row has (R,), their columns and values, row after row.
    """
    (rows, weights, joints), switches = control.shape, switching.shape[1]
    most = rows * (weights * joints + switches + 2)
    count, column, value = np.empty(rows, np.int64), np.empty(most, np.int64), np.empty(most)
    arrays = (np.ascontiguousarray(part) for part in (control, switching, duration, is_elastic))
    own = np.ascontiguousarray(first, dtype=np.int64)
    sizes = (rows, weights, joints, switches, free)
    known = np.ascontiguousarray(variable, dtype=np.int64)
    assert _compressed is not None  # the caller asks LIBRARY first
    end = _compressed(*sizes, own, *arrays, known, count, column, value)
    return count, column[:end], value[:end]


# ---- The legs' blocks of a program over the program's own variables.


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
