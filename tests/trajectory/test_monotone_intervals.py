"""Intervals without reversal of a joint, for Coulomb friction; sign changes of polynomials."""

import numpy as np
import pytest
from numpy.testing import assert_allclose as close
from numpy.testing import assert_array_equal as same

from tubeplanner import JointTrajectory
from tubeplanner.trajectory.parts import STILL_FRACTION, monotone_intervals, sign_changes


def rows_of(polynomials, degree):
    """Return coefficients (degree+1, K) of polynomials."""
    padded = [np.pad(each.coeffs, (degree + 1 - len(each.coeffs), 0)) for each in polynomials]
    return np.array(padded).T


def test_they_are_the_roots_between_the_ends():
    """Two pieces of different widths, two polynomials each."""
    roots = [[[0.2, 0.7], [-0.1, 0.5]], [[1.5], [0.4, 2.5, 3.1]]]
    widths = np.array([1.0, 3.0])
    rows = np.stack([rows_of([np.poly1d(r, r=True) for r in piece], 3) for piece in roots], axis=1)
    changes = sign_changes(rows, widths)
    places = sorted(
        zip(changes.piece, changes.column, changes.fraction * widths[changes.piece], strict=True)
    )
    expected = [(0, 0, 0.2), (0, 0, 0.7), (0, 1, 0.5), (1, 0, 1.5), (1, 1, 0.4), (1, 1, 2.5)]
    close(places, expected, atol=1e-9)


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_where_there_are_none_nothing_is_found(degree):
    rows = np.zeros((degree + 1, 2, 3))
    rows[-1] = 1.0
    changes = sign_changes(rows, np.array([1.0, 2.0]))
    assert [len(column) for column in changes] == [0, 0, 0]
    assert changes.piece.dtype == np.int64


def test_between_them_polynomials_keep_their_sign():
    rng = np.random.default_rng(0)
    rows, widths = rng.uniform(-1, 1, (6, 5, 4)), rng.uniform(0.5, 1.5, 5)
    rows *= 2.0 ** np.arange(6)[::-1, None, None]
    rows[-1] *= 0.1
    changes = sign_changes(rows, widths)
    for piece, column in np.ndindex(5, 4):
        mine = changes.fraction[(changes.piece == piece) & (changes.column == column)]
        fraction = np.linspace(0, 1, 5001)
        sign = np.sign(np.polyval(rows[:, piece, column], fraction * widths[piece]))
        reversals = np.flatnonzero(np.diff(sign))
        close(np.sort(mine), fraction[reversals] + 1e-4, atol=1.1e-4)
    assert len(changes.fraction) > 5


def test_a_root_that_rounding_puts_just_inside_an_end_is_at_that_end():
    """A root that, added to the piece's number, rounds into the next piece."""
    just_inside = [np.poly1d([1 - 1e-13, 0.5], r=True), np.poly1d([1e-17, 0.5], r=True)]
    changes = sign_changes(rows_of(just_inside, 2)[:, None], np.ones(1))
    close(changes.fraction, 0.5)


def moved(velocities, widths=(1.0,)):
    """Return the motion of joints whose velocities are polynomials, one per piece and joint."""
    degree = max(each.order for piece in velocities for each in piece)
    rows = np.zeros((degree + 2, len(velocities), len(velocities[0])))
    for place in np.ndindex(*rows.shape[1:]):
        position = velocities[place[0]][place[1]].integ().coeffs
        rows[(slice(len(rows) - len(position), None), *place)] = position
    names = [f"joint{k}" for k in range(rows.shape[2])]
    return JointTrajectory(names, np.concatenate([[0.0], np.cumsum(widths)]), rows)


def test_stretches_end_at_reversals_and_pieces():
    v = np.poly1d([0.2, 0.7], r=True)
    intervals = monotone_intervals(moved([[v, np.poly1d([-1.0])]]))
    same(intervals.joint, [0, 0, 0, 1])
    same(intervals.direction, [1, -1, 1, -1])
    close(intervals.start, [0, 0.2, 0.7, 0], atol=1e-12)
    close(intervals.end, [0.2, 0.7, 1, 1], atol=1e-12)


@pytest.mark.parametrize("at", [0.25, 0.5, 0.75, 0.371])
def test_a_joint_that_stops_and_goes_on_moves_one_way(at):
    """The stop may also be at a sample of the velocity."""
    touching = np.poly1d([at, at], r=True) * np.poly1d([1.0, 0.0, 0.5])
    intervals = monotone_intervals(moved([[touching]]))
    lasting = intervals.end - intervals.start > 1e-6
    same(intervals.direction[lasting], np.ones(lasting.sum()))


@pytest.mark.parametrize(("fraction", "direction"), [(1.1, -1.0), (0.9, 0.0), (0.0, 0.0)])
def test_a_joint_far_slower_than_the_fastest_stands_still(fraction, direction):
    slow = np.poly1d([-2.0 * STILL_FRACTION * fraction])
    intervals = monotone_intervals(moved([[np.poly1d([2.0]), slow]]))
    same(intervals.direction, [1.0, direction])


def test_where_nothing_moves_all_stand_still():
    intervals = monotone_intervals(moved([[np.poly1d([0.0])] * 2] * 3, (1.0, 2.0, 1.0)))
    same(intervals.direction, np.zeros(6))


def test_directions_are_those_of_the_velocity():
    rng = np.random.default_rng(0)
    widths = rng.uniform(0.2, 0.8, 4)
    velocities = [[np.poly1d(rng.uniform(-0.2, 0.8, 3), r=True) for _ in range(3)] for _ in widths]
    trajectory = moved(velocities, widths)
    intervals = monotone_intervals(trajectory)
    piece, fraction = np.repeat(np.arange(4), 301), np.tile(np.linspace(0, 1, 301), 4)
    v = trajectory.within(piece, fraction * widths[piece], 1)
    clear = abs(v) > 1e-4
    same(intervals.at(piece, fraction)[clear], np.sign(v)[clear])
    assert len(intervals.joint) > 12


def test_at_a_reversal_it_is_the_next_direction_and_at_the_end_the_last():
    v = np.poly1d([0.5], r=True)
    intervals = monotone_intervals(moved([[v], [-v]], (1.0, 1.0)))
    directions = intervals.at(np.array([0, 0, 0, 1, 1]), np.array([0.0, 0.5, 1.0, 0.0, 1.0]))
    same(directions[:, 0], [-1, 1, 1, 1, -1])
