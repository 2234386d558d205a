import os
from contextlib import closing

import numpy as np
import pytest

from cases import SLIDE, one_joint, with_motors
from tubeplanner import load_problem, load_robot
from tubeplanner.problem.robustness import Robustness
from tubeplanner.simulation.mujoco_model import ArmsTogether, mujoco_arms
from tubeplanner.simulation.plant import Draw, drawn_plants

STEP, STEPS, PERIODS = 2.5e-4, 4, 100


def wrong_arms(robot, runs=5):
    """Arms in states of their own, and efforts for them, (PERIODS, STEPS, R, n)."""
    random = np.random.default_rng(3)
    arms = mujoco_arms(robot, drawn_plants(robot, Robustness(), Draw(runs)), STEP)
    for arm in arms:
        arm.place(*random.uniform(-0.5, 0.5, (2, robot.joint_count)))
    most = np.minimum(robot.limits.effort, 30.0)
    return arms, most * random.uniform(-1, 1, (PERIODS, STEPS, runs, robot.joint_count))


def alone(robot):
    arms, effort = wrong_arms(robot)
    for given in effort.reshape(-1, len(arms), robot.joint_count):
        for arm, own in zip(arms, given, strict=True):
            arm.step(own)
    return np.array([[arm.position, arm.velocity] for arm in arms])


def together(robot):
    arms, effort = wrong_arms(robot)
    with closing(ArmsTogether(arms)) as moved:
        for given in effort:
            moved.move(given, np.arange(len(arms)))
        return np.stack([moved.position, moved.velocity], axis=1)


@pytest.fixture
def slide(tmp_path):
    (tmp_path / "slide.urdf").write_text(SLIDE)
    return load_robot(tmp_path / "slide.urdf", "tip", joints=["lift", "turn", "extend"])


def test_without_friction_they_move_as_each_alone_to_the_last_bit():
    robot = load_problem("example:ur5/over_the_wall").robot
    np.testing.assert_array_equal(together(robot), alone(robot))


def test_joints_may_be_in_another_order_than_on_the_arm(slide):
    np.testing.assert_array_equal(together(slide), alone(slide))


def test_with_friction_they_differ_by_rounding(slide):
    rubbing = with_motors(slide, backwards_friction=1.0, forwards_friction=3.0)
    found, expected = together(rubbing), alone(rubbing)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
    assert abs(found - alone(slide)).max() > 1e-3


@pytest.mark.parametrize("processors", [1, 3, None])
def test_the_number_of_processors_changes_nothing(slide, monkeypatch, processors):
    rubbing = with_motors(slide, backwards_friction=1.0, forwards_friction=3.0)
    expected = together(rubbing)
    monkeypatch.setattr(os, "cpu_count", lambda: processors)
    np.testing.assert_array_equal(together(rubbing), expected)


def test_only_those_move_that_are_to(tmp_path):
    robot = one_joint(tmp_path)
    arms, effort = wrong_arms(robot)
    before = np.array([arm.position for arm in arms])
    with closing(ArmsTogether(arms)) as moved:
        np.testing.assert_array_equal(moved.position, before)
        moved.move(effort[0], np.array([], dtype=int))
        np.testing.assert_array_equal(moved.position, before)
        moved.move(effort[0], np.array([1, 3]))
        assert ((moved.position != before)[:, 0] == [False, True, False, True, False]).all()
    for own in effort[0, :, 3]:
        arms[3].step(own)
    np.testing.assert_array_equal(moved.position[3], arms[3].position)


def test_they_go_on_as_others_where_they_are(slide):
    """Half of the way each; alone the state is carried over by hand."""
    others = with_motors(slide, backwards_friction=0.0, forwards_friction=0.0, armature=0.5)
    runs, effort = 3, np.ones((1, 3, 3))
    first, second = (
        mujoco_arms(robot, drawn_plants(robot, Robustness(), Draw(runs, seed)), STEP)
        for robot, seed in ((slide, 0), (others, 1))
    )
    with closing(ArmsTogether(first)) as moved:
        moved.move(effort, np.arange(runs))
        moved.become(second)
        for arm, *state in zip(second, moved.position, moved.velocity, strict=True):
            arm.place(*state)
            arm.step(effort[0, 0])
        moved.move(effort, np.arange(runs))
        np.testing.assert_array_equal(moved.position, [arm.position for arm in second])
        np.testing.assert_array_equal(moved.velocity, [arm.velocity for arm in second])
