"""Sign changes of polynomials, against factors and dense samples."""

import numpy as np
import pytest

from tubeplanner.trajectory.sign_changes import sign_changes


def rows_of(polynomials, degree):
    """Return coefficients (degree+1, K) of polynomials."""
    padded = [np.pad(each.coeffs, (degree + 1 - len(each.coeffs), 0)) for each in polynomials]
    return np.array(padded).T


def test_they_are_the_roots_between_the_ends():
    """In two pieces of other widths, of two polynomials each."""
    roots = [[[0.2, 0.7], [-0.1, 0.5]], [[1.5], [0.4, 2.5, 3.1]]]
    widths = np.array([1.0, 3.0])
    rows = np.stack([rows_of([np.poly1d(r, r=True) for r in piece], 3) for piece in roots], axis=1)
    found = sign_changes(rows, widths)
    places = sorted(zip(found.piece, found.column, found.share * widths[found.piece], strict=True))
    expected = [(0, 0, 0.2), (0, 0, 0.7), (0, 1, 0.5), (1, 0, 1.5), (1, 1, 0.4), (1, 1, 2.5)]
    np.testing.assert_allclose(places, expected, atol=1e-9)


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_where_there_are_none_nothing_is_found(degree):
    rows = np.zeros((degree + 1, 2, 3))
    rows[-1] = 1.0
    found = sign_changes(rows, np.array([1.0, 2.0]))
    assert [len(column) for column in found] == [0, 0, 0]
    assert found.piece.dtype == np.int64


@pytest.mark.parametrize("seed", range(5))
def test_between_them_polynomials_keep_their_sign(seed):
    rng = np.random.default_rng(seed)
    rows, widths = rng.uniform(-1, 1, (6, 5, 4)), rng.uniform(0.5, 1.5, 5)
    rows *= 2.0 ** np.arange(6)[::-1, None, None]
    rows[-1] *= 0.1
    found = sign_changes(rows, widths)
    for piece, column in np.ndindex(5, 4):
        mine = found.share[(found.piece == piece) & (found.column == column)]
        share = np.linspace(0, 1, 5001)
        sign = np.sign(np.polyval(rows[:, piece, column], share * widths[piece]))
        turned = np.flatnonzero(np.diff(sign))
        np.testing.assert_allclose(np.sort(mine), share[turned] + 1e-4, atol=1.1e-4)
    assert len(found.share) > 5


def test_a_root_that_rounding_puts_just_inside_an_end_is_at_that_end():
    """Added to the piece's number, it would be in the next piece."""
    just_inside = [np.poly1d([1 - 1e-13, 0.5], r=True), np.poly1d([1e-17, 0.5], r=True)]
    found = sign_changes(rows_of(just_inside, 2)[:, None], np.ones(1))
    np.testing.assert_allclose(found.share, 0.5)
