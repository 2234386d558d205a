"""Block: rows, bounds and cost of one leg in a step's program, as sparse entries.

V variables of a leg: F configurations of n joints, m-1 switching times, eta, elastic variable.
"""

from collections.abc import Iterator, Sequence
from ctypes import c_int64
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.native.library import LIBRARY, Doubles, Integers, native_function
from tubeplanner.optimizer.rows import Rows


@dataclass(frozen=True, eq=False)
class SymmetricEntries:
    """A symmetric matrix by entries on both sides of its diagonal; equal places are summed.

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
        """Return the matrix over `size` variables, the numbers of its own being given."""
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
    """Cost of a step without the elastic variable.

    Attributes:
        hessian: Shape (V, V).
        gradient: Over configurations and switching times, shape (V-2,).
        duration: Cost of eta.
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
    """Bounds on a step.

    Attributes:
        lower: Of the configurations, shape (F, n).
        upper: Of the configurations, shape (F, n).
        switching: Largest steps of the switching times, shape (m-1,).
        widths: Largest changes of the widths of phases, shape (m,).
        duration: Smallest and largest eta.
        fixed_directions: Directions in which the last variable must not move, shape (r, n).
    """

    lower: FloatArray
    upper: FloatArray
    switching: FloatArray
    widths: FloatArray
    duration: tuple[float, float]
    fixed_directions: FloatArray


@dataclass(frozen=True, eq=False)
class Step:
    """The solution of a program for one leg.

    Attributes:
        control: Of the configurations, shape (F, n).
        switching: Of the switching times, shape (m-1,).
        duration: eta.
        elastic: Largest violation of elastic rows.
        multipliers: Of the rows, shape (R,).
    """

    control: FloatArray
    switching: FloatArray
    duration: float
    elastic: float
    multipliers: FloatArray


@dataclass(frozen=True, eq=False)
class SparseRows:
    """R compressed rows over the variables.

    Attributes:
        data: Entries, row after row, shape (entries,).
        column: Their columns, shape (entries,).
        count: Number of entries of each row, shape (R,).
    """

    data: FloatArray
    column: IntArray
    count: IntArray

    def rows(self) -> Iterator["SparseRows"]:
        """Yield every row."""
        ends = np.cumsum(self.count)
        for begin, end in zip(ends - self.count, ends, strict=True):
            yield SparseRows(self.data[begin:end], self.column[begin:end], np.array([end - begin]))


_NO_ROWS = SparseRows(np.zeros(0), np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))


def stacked_rows(parts: Sequence[SparseRows]) -> SparseRows:
    """Return the concatenation of sets of rows."""
    if len(parts) == 1:
        return parts[0]
    names = ("data", "column", "count")
    parts = (_NO_ROWS, *parts)
    return SparseRows(*(np.concatenate([getattr(p, name) for p in parts]) for name in names))


@dataclass(frozen=True, eq=False)
class Block:
    """One leg in a program, over z (configurations and switching times), eta, elastic.

    Attributes:
        rows: The constraints, R rows in all, from `sparse_rows`.
        slack: Of the rows, shape (R,).
        bounds: Of the step.
        quadratic: Cost of the step.
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
    def held(self) -> SparseRows:
        """The held directions of the last configuration, as rows."""
        count, n = self.bounds.fixed_directions.shape
        size = self.bounds.lower.size
        column = np.tile(np.arange(size - n, size), count)
        return SparseRows(self.bounds.fixed_directions.ravel(), column, np.full(count, n))

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


_compressed = native_function(
    *("compressed_rows", *(c_int64,) * 5, Integers, *(Doubles,) * 4, *(Integers,) * 3, Doubles),
    returns=c_int64,
)


def compressed_rows(
    first: IntArray,
    control: FloatArray,
    switching: FloatArray,
    duration: FloatArray,
    is_elastic: FloatArray,
    variable: IntArray,
    free: int,
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return counts (R,), columns and values of the rows of `sparse_rows`; needs the library."""
    (rows, weights, joints), switches = control.shape, switching.shape[1]
    most = rows * (weights * joints + switches + 2)
    count, column, value = np.empty(rows, np.int64), np.empty(most, np.int64), np.empty(most)
    arrays = (np.ascontiguousarray(part) for part in (control, switching, duration, is_elastic))
    own = np.ascontiguousarray(first, dtype=np.int64)
    sizes = (rows, weights, joints, switches, free)
    variables = np.ascontiguousarray(variable, dtype=np.int64)
    assert _compressed is not None  # the caller asks LIBRARY first
    end = _compressed(*sizes, own, *arrays, variables, count, column, value)
    return count, column[:end], value[:end]


@dataclass(frozen=True, eq=False)
class JointBlocks:
    """The blocks of all legs over the program's variables.

    Attributes:
        blocks: One of each leg.
        columns: The program's variables that are each leg's, shape (V,).
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
        """True if a single leg has the program's variables in their order."""
        return np.array_equal(self.columns[0], np.arange(self.size))

    @cached_property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds of the variables; both legs bound a shared variable."""
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
        """Changes of the phases' widths, as rows of each leg."""
        return [self.over_all(block.width_changes, k) for k, block in enumerate(self.blocks)]

    @property
    def held(self) -> list[SparseRows]:
        """Held directions, as rows of each leg."""
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
