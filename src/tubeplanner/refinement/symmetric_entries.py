"""Symmetric matrices by their entries, some of which may stand at one place: they are summed."""

from dataclasses import dataclass, replace

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray


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
