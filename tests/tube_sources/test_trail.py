"""Recorded trails: matched by name, unwrapped, freed of pauses and of ways back."""

from itertools import pairwise

import numpy as np
import pytest

from tubeplanner import load_robot
from tubeplanner.branches.inverse_kinematics import solve_position
from tubeplanner.errors import TrajectoryError
from tubeplanner.tube_sources.trail import joint_trail, moving_part, without_ways_back

CONTINUOUS = """<robot name="turntable">
  <link name="base"/>
  <link name="arm"><inertial><mass value="1"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="turn" type="continuous"><parent link="base"/><child link="arm"/>
    <axis xyz="0 0 1"/><limit effort="10" velocity="1"/></joint>
</robot>"""


def way(*corners, count=40):
    """Return joint lines between corners, `count` samples each."""
    parts = [np.linspace(a, b, count) for a, b in pairwise(corners)]
    return np.vstack(parts)


def test_columns_are_matched_by_name_and_others_left_out(two_link):
    samples = np.array([[9.0, 0.2, 0.1], [9.0, 0.4, 0.3]])
    trail = joint_trail(two_link, ["gripper", "joint2", "joint1"], samples)
    np.testing.assert_array_equal(trail, [[0.1, 0.2], [0.3, 0.4]])


def test_a_missing_joint_is_named(two_link):
    with pytest.raises(TrajectoryError) as caught:
        joint_trail(two_link, ["joint1", "elbow"], np.zeros((2, 2)))
    assert str(caught.value) == "the trail has no joint joint2; its joints are joint1, elbow"


def test_degrees_are_noticed(two_link):
    samples = np.array([[0.0, 0.0], [30.0, -45.0]])
    with pytest.raises(TrajectoryError, match=r"'joint1' at 30 in sample 1, outside its position"):
        joint_trail(two_link, ["joint1", "joint2"], samples)


def test_noise_at_a_limit_is_no_fault(two_link):
    upper = two_link.limits.upper_position
    trail = joint_trail(two_link, two_link.joint_names, np.array([upper + 0.005, upper - 1]))
    assert (trail <= upper).all()


def test_continuous_joints_are_unwrapped(tmp_path):
    (tmp_path / "turntable.urdf").write_text(CONTINUOUS)
    robot = load_robot(tmp_path / "turntable.urdf", "arm")
    turning = np.linspace(0, 9, 50)[:, None]
    wrapped = (turning + np.pi) % (2 * np.pi) - np.pi
    np.testing.assert_allclose(joint_trail(robot, ["turn"], wrapped), turning, atol=1e-6)


def test_pauses_duplicates_and_noise_are_dropped_and_the_ends_are_kept():
    q = np.repeat(way([0, 0], [1, 0.5]), 5, axis=0)
    noisy = q + np.random.default_rng(0).normal(0, 1e-3, q.shape)
    moving = moving_part(noisy)
    assert 20 < len(moving) < 45
    np.testing.assert_array_equal(moving[[0, -1]], noisy[[0, -1]])
    assert abs(np.diff(moving[:-1], axis=0)).max(axis=1).min() >= 0.02


def test_a_short_trail_keeps_its_ends():
    q = np.array([[0.0, 0.0], [0.03, 0.0], [0.04, 0.0]])
    np.testing.assert_array_equal(moving_part(q)[[0, -1]], q[[0, -1]])


def test_a_trail_that_stands_still_is_refused():
    with pytest.raises(TrajectoryError, match=r"does not move: .* in 30 samples"):
        moving_part(np.random.default_rng(1).normal(0, 1e-3, (30, 2)))


def test_a_way_out_and_back_is_left_out(two_link):
    start, side, turn, end = [0, 0.5], [0.6, 0.5], [1.0, 0.9], [1.2, 0.2]
    q = way(start, side, turn, side, end)
    kept, turns = without_ways_back(two_link, q, 0.01)
    there = two_link.tool_position(np.array([turn]))[0]
    assert len(turns) == 1
    np.testing.assert_allclose(turns[0], there, atol=0.02)
    assert np.linalg.norm(two_link.tool_position(kept) - there, axis=1).min() > 0.05
    np.testing.assert_array_equal(kept[[0, -1]], q[[0, -1]])
    assert abs(np.diff(kept, axis=0)).max() < 0.25


def test_a_way_back_along_a_straight_line_is_left_out_too(two_link):
    """No distance from the line between start and end shows it."""
    line = np.linspace([0.3, -0.3, 0], [0.3, 0.3, 0], 80)
    tool = np.vstack([line[:60], line[60:20:-1], line[20:]])
    q = [np.array([-0.3, 1.0])]
    for point in tool:
        free = np.full(2, np.inf)
        q.append(solve_position(two_link, point, q[-1], -free, free).q)
    kept, turns = without_ways_back(two_link, np.array(q[1:]), 0.03)
    np.testing.assert_allclose(turns, line[60:61], atol=0.01)
    assert (np.diff(two_link.tool_position(kept)[:, 1]) > -1e-9).all()


def test_a_way_around_is_no_way_back(two_link):
    q = way([0, 0.5], [0.8, 0.5], [0.8, 1.5], [0, 1.5], [0, 0.5])
    kept, turns = without_ways_back(two_link, q, 0.01)
    assert turns == [] and len(kept) == len(q)


def test_a_trail_that_only_goes_out_and_back_is_refused(two_link):
    with pytest.raises(TrajectoryError, match="comes back the way it went; record the way out and"):
        without_ways_back(two_link, way([0, 0.5], [0.8, 0.5], [0, 0.5]), 0.01)


def test_a_tool_that_stands_still_is_refused(ur5):
    q = np.tile([0, -1, 1, -1, -1.5, 0.0], (20, 1))
    q[:, 5] = np.linspace(0, 1, 20)
    with pytest.raises(TrajectoryError, match=r"the tool moves by .* m only"):
        without_ways_back(ur5, q, 0.01)
