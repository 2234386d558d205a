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


# Six configurations of two joints, a switching time after two and one after four of them.
SHORT = LegShape(6, 2, 2, np.array([1, 1]), np.array([2, 4]))
# Of forty switching times, two beside a phase of thirty knot intervals.
MANY = np.array([1] * 19 + [30] * 2 + [1] * 19)
BEHIND = np.concatenate([np.arange(20), np.arange(50, 70)])
MIXED = LegShape(70, 2, 40, MANY, BEHIND)


def test_few_switching_times_are_behind_all_configurations():
    assert not SHORT.is_among.any()
    (own,) = shared_columns([SHORT], [False])
    assert own.tolist() == list(range(6 * 2 + 2 + 2))


def test_many_switching_times_stand_among_the_configurations_unless_beside_a_long_phase():
    assert MIXED.is_among.tolist() == (MANY == 1).tolist()


def test_switching_times_stand_where_they_count():
    (own,) = shared_columns([MIXED], [False])
    assert sorted(own) == list(range(70 * 2 + 40 + 2))
    switching, begin = own[140:180], own[:140:2]
    for place, behind, is_among in zip(switching, BEHIND, MIXED.is_among, strict=True):
        before = (begin < place).sum()
        assert before == (behind if is_among else 70)
    assert (np.diff(own[:140]) > 0).all()
    assert own[-2:].tolist() == [180, 181]


def test_switching_times_of_several_legs_stand_in_their_own_leg():
    first, second = shared_columns([MIXED, MIXED], [True, False])
    assert first[140:159].max() < second[0] - 1 <= second[140:159].min()
    assert first[138:140].tolist() == second[:2].tolist()
    assert sorted(set(first) | set(second)) == list(range(139 * 2 + 80 + 4))
