"""FR3's velocity limits by position, against the formula as Franka prints it."""

import numpy as np
import pytest

from tubeplanner.controllers.franka_limits import franka_limits

FER, FR3 = franka_limits("fer"), franka_limits("fr3")


def test_the_velocity_is_limited_near_the_ends_of_the_second_joint():
    for q in np.linspace(-1.9, 1.9, 41):
        lower, upper = FR3.velocity_bounds(np.full((1, 7), q))
        assert upper[0, 1] == pytest.approx(
            min(2.62, max(0, -0.2 + np.sqrt(max(0, 5.17 * (1.7918 - q)))))
        )
        assert lower[0, 1] == pytest.approx(
            max(-2.62, min(0, 0.2 - np.sqrt(max(0, 5.17 * (1.7918 + q)))))
        )


def test_the_fourth_and_the_sixth_joint_have_other_ends_below_than_above():
    q = np.array([[0, 0, 0, -3.0, 0, 0.6, 0]])
    lower, upper = FR3.velocity_bounds(q)
    assert upper[0, [3, 5]] == pytest.approx([2.62, 4.18])
    assert lower[0, 3] == pytest.approx(0.3 - np.sqrt(8 * (3.0481 - 3.0)))
    assert lower[0, 5] == pytest.approx(0.35 - np.sqrt(11 * (0.6 - 0.54092)))


def test_the_panda_has_one_limit_everywhere():
    lower, upper = FER.velocity_bounds(np.full((3, 7), 2.8))
    assert upper == pytest.approx(np.tile(FER.velocity, (3, 1)))
    assert lower == pytest.approx(-upper)
