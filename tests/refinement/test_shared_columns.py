"""Which variables legs share, and their order."""

import numpy as np
import pytest

from tubeplanner.refinement.shared_columns import LegShape, shared_columns

# Three, one and two configurations of two joints; one, no and two switching times.
LEGS = [LegShape(3, 2, 1), LegShape(1, 2, 0), LegShape(2, 2, 2)]


def test_a_leg_alone_has_all_variables_in_its_order():
    (own,) = shared_columns([LegShape(3, 2, 2)], [False])
    assert own.tolist() == list(range(6 + 2 + 2))


def test_configurations_stand_first_then_switching_times_then_eta_then_elastic():
    first, second, third = shared_columns(LEGS, [False, False, False])
    assert first.tolist() == [0, 1, 2, 3, 4, 5, 12, 15, 18]
    assert second.tolist() == [6, 7, 16, 19]
    assert third.tolist() == [8, 9, 10, 11, 13, 14, 17, 20]


def test_a_tied_end_is_the_next_ones_beginning():
    first, second, third = shared_columns(LEGS, [True, False, False])
    assert first[:6].tolist() == [0, 1, 2, 3, 4, 5]
    assert second[:2].tolist() == [4, 5]
    assert third[:4].tolist() == [6, 7, 8, 9]
    assert first[6] == 10


def test_where_a_cycle_closes_comes_after_all_other_configurations():
    first, second, third = shared_columns(LEGS, [False, False, True])
    assert first[:6].tolist() == [8, 9, 0, 1, 2, 3]
    assert second[:2].tolist() == [4, 5]
    assert third[:4].tolist() == [6, 7, 8, 9]
    assert first[6] == 10


@pytest.mark.parametrize("is_tied", [[True, True, True], [False, True, True], [True, False, False]])
def test_no_column_is_left_out_and_only_tied_ones_are_shared(is_tied):
    legs = [LegShape(4, 3, 2), LegShape(5, 3, 1), LegShape(3, 3, 0)]
    columns = shared_columns(legs, is_tied)
    found, count = np.unique(np.concatenate(columns), return_counts=True)
    assert found.tolist() == list(range(len(found)))
    assert (count == 2).sum() == 3 * sum(is_tied)
    assert count.max() <= 2
    for k in np.flatnonzero(is_tied):
        size = 3 * legs[k].configurations
        following = columns[(k + 1) % 3]
        np.testing.assert_array_equal(columns[k][size - 3 : size], following[:3])


def test_a_cycle_of_one_leg_ends_where_it_begins():
    (own,) = shared_columns([LegShape(3, 2, 1)], [True])
    assert own.tolist() == [2, 3, 0, 1, 2, 3, 4, 5, 6]
