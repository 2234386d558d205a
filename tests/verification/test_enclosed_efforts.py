"""The terms of the effort law: all of them, each what its bound is made for."""

import numpy as np
import pytest

from cases import SLIDE, one_joint, with_motors
from tubeplanner import JointTrajectory, load_robot
from tubeplanner.robot.effort_rate import effort_rate
from tubeplanner.verification.enclosed_efforts import (
    effort_terms,
    enclosed_effort_rates,
    enclosed_efforts,
)


@pytest.fixture(params=["rigid", "motors"])
def arm(request, robot):
    """Arms without and with rotors and viscous friction."""
    if request.param == "rigid":
        return robot
    amounts = np.random.default_rng(1).uniform(0.1, 2.0, (3, robot.joint_count))
    return with_motors(
        robot, armature=amounts[0], viscous_friction=amounts[1], forwards_friction=amounts[2]
    )


@pytest.fixture
def states(robot):
    """Random positions, velocities and accelerations, each (20, n)."""
    return np.random.default_rng(0).uniform(-2, 2, (3, 20, robot.joint_count))


def test_the_terms_add_up_to_what_the_planners_limit(arm, states):
    terms = effort_terms(arm).values()
    efforts = sum(term.values(*states[: term.derivatives + 1]) for term in terms)
    np.testing.assert_allclose(efforts, arm.inverse_dynamics(*states), rtol=1e-12, atol=1e-12)


def test_friction_of_the_urdf_is_not_in_it_unasked(tmp_path):
    """What rigid bodies need is the same whichever way they move; its bound counts on that."""
    dynamics = '<dynamics damping="3" friction="2"/><limit'
    path = tmp_path / "with_friction.urdf"
    path.write_text(SLIDE.replace("<limit", dynamics))
    robot = load_robot(path, "tip")
    q, v, a = np.random.default_rng(0).uniform(-2, 2, (3, 20, robot.joint_count))
    values = effort_terms(robot)["rigid bodies and motors"].values
    np.testing.assert_allclose(values(q, -v, a), values(q, v, a), rtol=1e-9, atol=1e-9)


def test_what_rotors_and_friction_take_is_missed_by_no_more_than_the_error(tmp_path):
    """A polynomial of a degree that interpolation misses, of a joint with hardly any inertia."""
    motors = {"armature": 400.0, "viscous_friction": 3000.0}
    robot = with_motors(one_joint(tmp_path), **motors)
    rows = np.random.default_rng(2).uniform(-1, 1, (13, 1, 1))
    trajectory = JointTrajectory(["turn"], [0, 1.0], rows)
    efforts = enclosed_efforts(robot, trajectory, np.array([1e-3]))
    interval = np.repeat(np.arange(len(efforts.width)), 101)
    u = np.tile(np.linspace(0, 1, 101), len(efforts.width))
    at = trajectory.at(efforts.start[interval] + u * efforts.width[interval])
    expected = robot.inverse_dynamics(at.position, at.velocity, at.acceleration)
    missed = abs(efforts.within(interval, u) - expected)
    assert (missed <= efforts.error[interval] + 1e-9).all()
    assert missed.max() > 1e-6


def test_enclosed_rates_are_those_that_the_planners_limit(arm):
    """On either side of breakpoints at which the jerk jumps, and in between."""
    n = arm.joint_count
    coefficients = np.random.default_rng(3).uniform(-1, 1, (4, 3, n))
    coefficients *= np.array([400.0, 30.0, 2.0, 1.5])[:, None, None]
    trajectory = JointTrajectory(arm.joint_names, [0, 0.05, 0.08, 0.2], coefficients)
    rates = enclosed_effort_rates(arm, trajectory, np.full(n, 1e-4))
    assert rates.error.max() <= 1e-4
    interval = np.repeat(np.arange(len(rates.width)), 9)
    u = np.tile(np.linspace(0, 1, 9), len(rates.width))
    piece = np.searchsorted(trajectory.breakpoints, rates.start + 1e-9)[interval] - 1
    local = rates.start[interval] + u * rates.width[interval] - trajectory.breakpoints[piece]
    expected = effort_rate(arm, *(trajectory.within(piece, local, k) for k in range(4)))
    np.testing.assert_allclose(rates.within(interval, u), expected, atol=1.01e-4)
