"""Where piecewise polynomials change their sign."""

from typing import NamedTuple

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.trajectory.bernstein import bernstein_coefficients

# Nearer to an end of a piece, as a share of it, a change of sign is at that end: the next piece has
# its own.
_END = 1e-12


class SignChanges(NamedTuple):
    """Instants at which polynomials may change their sign, K of them, in no order.

    Attributes:
        column: Which polynomial does, shape (K,).
        piece: In which piece, shape (K,).
        share: How far inside it, between 0 and 1, shape (K,).
    """

    column: IntArray
    piece: IntArray
    share: FloatArray


def sign_changes(coefficients: FloatArray, widths: FloatArray) -> SignChanges:
    """Return all of n piecewise polynomials inside their pieces, none for sure where they touch 0.

    Args:
        coefficients: Shape (degree+1, pieces, n), highest power first.
        widths: Widths of the pieces [s], shape (pieces,).
    """
    hull = bernstein_coefficients(coefficients, np.zeros(len(widths)), widths)
    both = (hull.min(axis=0) < 0) & (hull.max(axis=0) > 0)
    powers = np.arange(len(coefficients) - 1, -1, -1)
    found = [
        (column, piece, root)
        for piece, column in np.argwhere(both).tolist()
        for root in _roots_inside(coefficients[:, piece, column] * widths[piece] ** powers)
    ]
    columns, pieces, roots = zip(*found, strict=True) if found else ((), (), ())
    return SignChanges(
        np.array(columns, dtype=np.int64), np.array(pieces, dtype=np.int64), np.array(roots)
    )


def _roots_inside(coefficients: FloatArray) -> list[float]:
    """Return where a polynomial, highest power first, may change its sign between 0 and 1."""
    roots = np.roots(coefficients)
    real = roots.real[roots.imag == 0]
    return real[(real > _END) & (real < 1 - _END)].tolist()
