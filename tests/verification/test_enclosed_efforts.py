"""The terms of the effort law: all of them, each what its bound is made for."""

import numpy as np
import pytest

from cases import SLIDE
from tubeplanner import load_robot
from tubeplanner.verification.enclosed_efforts import effort_terms


@pytest.fixture
def states(robot):
    """Random positions, velocities and accelerations, each (20, n)."""
    return np.random.default_rng(0).uniform(-2, 2, (3, 20, robot.joint_count))


def test_the_terms_add_up_to_what_the_planners_limit(robot, states):
    terms = effort_terms(robot).values()
    efforts = sum(term.values(*states[: term.derivatives + 1]) for term in terms)
    np.testing.assert_allclose(efforts, robot.inverse_dynamics(*states), rtol=1e-12, atol=1e-12)


def test_the_term_of_rigid_bodies_holds_no_friction(tmp_path):
    """What rigid bodies need is the same whichever way they move; its bound counts on that."""
    dynamics = '<dynamics damping="3" friction="2"/><limit'
    path = tmp_path / "with_friction.urdf"
    path.write_text(SLIDE.replace("<limit", dynamics))
    robot = load_robot(path, "tip")
    q, v, a = np.random.default_rng(0).uniform(-2, 2, (3, 20, robot.joint_count))
    values = effort_terms(robot)["rigid bodies"].values
    np.testing.assert_allclose(values(q, -v, a), values(q, v, a), rtol=1e-9, atol=1e-9)
