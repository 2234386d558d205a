"""An arm with other limits moves as before."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from tubeplanner import LimitOverrides, load_robot


@pytest.fixture
def arms():
    """The two-link arm, and itself with half its efforts and other motors."""
    limits = LimitOverrides(effort={"joint1": 30.0, "joint2": 10.0})
    arm = load_robot("example:two_link", "hand", limits=limits)
    stalls = replace(arm.motors, saturation_effort=np.array([40.0, 20.0]))
    return arm, arm.with_limits(replace(arm.limits, effort=0.5 * arm.limits.effort), stalls)


def test_it_has_the_limits_given_and_the_other_keeps_its_own(arms):
    arm, limited = arms
    assert limited.limits.effort.tolist() == [15.0, 5.0]
    assert limited.motors.saturation_effort.tolist() == [40.0, 20.0]
    assert arm.limits.effort.tolist() == [30.0, 10.0]
    assert not np.isfinite(arm.motors.saturation_effort).any()


def test_it_moves_as_the_other_and_as_no_other_arm(arms):
    arm, limited = arms
    assert limited.moves_as(arm) and arm.moves_as(limited)
    assert not load_robot("example:two_link", "hand").moves_as(arm)
    q = np.array([[0.3, -1.2]])
    assert limited.tool_position(q).tolist() == arm.tool_position(q).tolist()
    assert limited.inverse_dynamics(q, q, q).tolist() == arm.inverse_dynamics(q, q, q).tolist()


def test_pickled_it_keeps_them(arms):
    again = pickle.loads(pickle.dumps(arms[1]))
    assert again.limits.effort.tolist() == [15.0, 5.0]
    assert again.motors.saturation_effort.tolist() == [40.0, 20.0]
