"""The pattern search on functions whose minimum is known."""

import math

import pytest

from tubeplanner.studies.pattern_search import pattern_search

LOW, HIGH = -2.0, 3.0


def neighbours(point, share):
    """Return the neighbours of a point in a square, first steps one long."""
    x, y = point
    moved = [(x + share, y), (x - share, y), (x, y + share), (x, y - share)]
    return [tuple(min(max(v, LOW), HIGH) for v in each) for each in moved]


def found(function, starts, halvings=8):
    """Return the best point that the search finds, and all that it tried."""
    tried = []

    def values(points):
        tried.extend(points)
        return [function(*point) for point in points]

    given = [(start, function(*start)) for start in starts]
    ends = pattern_search(given, neighbours, values, halvings)
    assert [value for _, value in ends] == [function(*point) for point, _ in ends]
    return min(ends, key=lambda end: end[1])[0], tried


def test_it_finds_the_bottom_of_a_bowl():
    point, tried = found(lambda x, y: 1 + (x - 0.7) ** 2 + 3 * (y + 0.4) ** 2, [(3.0, 3.0)])
    assert point == pytest.approx((0.7, -0.4), abs=0.02)
    assert len(tried) < 150


def test_it_stays_within_its_neighbours_bounds():
    point, tried = found(lambda x, y: 10 + x + y, [(0.3, 0.2)])
    assert point == (LOW, LOW)
    assert all(LOW <= value <= HIGH for each in tried for value in each)


def test_it_goes_round_what_has_no_value():
    def walled(x, y):
        return math.inf if abs(x) < 0.4 and y > -1 else 2 + (x - 1) ** 2 + y**2

    point, _ = found(walled, [(-1.0, 1.0), (2.0, -2.0)])
    assert point == pytest.approx((1.0, 0.0), abs=0.05)
    point, _ = found(lambda x, y: 1.0 if (x, y) == (0.5, 0.5) else math.inf, [(0.5, 0.5)])
    assert point == (0.5, 0.5)


def test_every_way_goes_down_its_own_valley():
    def two_valleys(x, y):
        return 2 + min((x + 1) ** 2, (x - 2) ** 2 - 0.5) + y**2

    assert found(two_valleys, [(-1.5, 0.0), (2.2, 0.0)])[0] == pytest.approx((2.0, 0.0), abs=0.05)
    assert found(lambda x, y: 1.0, [(1.0, 0.0), (2.0, 0.0)])[0] == (1.0, 0.0)


def test_steps_halve_so_often_and_gains_too_small_do_not_count():
    tries = [len(found(lambda x, y: 1.0, [(0.0, 0.0)], halvings)[1]) for halvings in (0, 1, 5)]
    assert tries == [4, 8, 24]
    assert found(lambda x, y: 10 - 0.005 * x, [(0.0, 0.0)], 0)[0] == (0.0, 0.0)
    assert found(lambda x, y: 10 - 0.02 * x, [(0.0, 0.0)], 0)[0] == (HIGH, 0.0)


def test_all_ways_go_on_side_by_side():
    sizes = []

    def values(points):
        sizes.append(len(points))
        return [1.0] * len(points)

    pattern_search([((0.0, 0.0), 1.0), ((2.0, 2.0), 1.0)], neighbours, values, 2)
    assert sizes == [8, 8, 8]
    assert pattern_search([], neighbours, values, 2) == []
