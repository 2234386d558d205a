"""Limits on the speed of points: what they may be."""

import numpy as np
import pytest

from tubeplanner import PointSpeed, RobotError


@pytest.mark.parametrize("position", [(0, 0, 1), [0, 0, 1], np.array([0.0, 0.0, 1.0])])
def test_a_point_is_three_numbers_however_they_come(position):
    assert PointSpeed("hand", position, 1) == PointSpeed("hand", (0.0, 0.0, 1.0), 1)


@pytest.mark.parametrize("position", [(0, 0), 3, "abc", (0, 0, np.inf), (0, [1], 0), (0, True, 0)])
def test_a_position_that_is_none_is_refused(position):
    with pytest.raises(RobotError, match=r"of link 'hand': position is .*; give \[x, y, z\] in m"):
        PointSpeed("hand", position, 1.0)


@pytest.mark.parametrize("speed", [0, -1.0, np.nan, np.inf, 2e9, True, "fast", None])
def test_a_speed_out_of_bounds_is_refused(speed):
    with pytest.raises(RobotError, match=r"of link 'hand': speed is .*; give a number from 1e-06"):
        PointSpeed("hand", (0, 0, 0), speed)
