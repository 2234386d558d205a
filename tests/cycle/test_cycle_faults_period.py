"""Dwells of cycles whose controller has a period."""

import pytest

from small_cycle import small_cycle
from tubeplanner import ProblemError


def test_a_dwell_that_is_no_multiple_of_the_period_is_refused_with_its_neighbours():
    expected = (
        r"event 'gripper': dwell is 0\.05 s, no multiple of the period, 0\.004 s; give 0\.048 or "
        r"0\.052"
    )
    with pytest.raises(ProblemError, match=expected):
        small_cycle(period=0.004)


def test_multiples_are_taken_in_spite_of_rounding():
    assert small_cycle(period=0.01).period == 0.01
    assert small_cycle(period=0.001, moves__8__dwell=0.3).period == 0.001


@pytest.mark.parametrize("period", [0.0, -0.01])
def test_a_period_that_is_none_is_blamed_itself(period):
    with pytest.raises(ProblemError, match="period is"):
        small_cycle(period=period)
