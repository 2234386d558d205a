"""What the program of one step asks of one leg: its rows, its bounds and its cost."""

from collections.abc import Iterator, Sequence
from ctypes import c_int64
from dataclasses import dataclass, replace

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.native.library import LIBRARY, Doubles, Integers, native_function
from tubeplanner.refinement.linear_rows import Rows
from tubeplanner.refinement.symmetric_entries import SymmetricEntries

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
