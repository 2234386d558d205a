"""Rotation matrices against scipy's."""

import numpy as np
from scipy.spatial.transform import Rotation

from tubeplanner.orientation import matrix_of_quaternion, matrix_of_rpy, rpy_of_matrix


def test_quaternions_of_any_length_give_the_matrices_of_scipy():
    quaternions = np.random.default_rng(0).normal(size=(20, 4))
    expected = Rotation.from_quat(quaternions).as_matrix()
    np.testing.assert_allclose(matrix_of_quaternion(quaternions), expected, atol=1e-15)
    np.testing.assert_allclose(matrix_of_quaternion(3 * quaternions[0]), expected[0], atol=1e-15)


def test_roll_pitch_and_yaw_turn_about_fixed_axes():
    for angles in np.random.default_rng(1).uniform(-4, 4, (20, 3)):
        expected = Rotation.from_euler("xyz", angles).as_matrix()
        np.testing.assert_allclose(matrix_of_rpy(*angles), expected, atol=1e-15)


def test_a_matrix_gives_roll_pitch_and_yaw_back():
    angles = np.random.default_rng(2).uniform(-1.5, 1.5, (20, 3)) * (2, 1, 2)
    for own in angles:
        np.testing.assert_allclose(rpy_of_matrix(matrix_of_rpy(*own)), own, atol=1e-12)
    for pitch in (np.pi / 2, -np.pi / 2):  # roll and yaw turn about one axis
        upright = matrix_of_rpy(0.3, pitch, 0.8)
        found = rpy_of_matrix(upright)
        assert found[0] == 0
        np.testing.assert_allclose(matrix_of_rpy(*found), upright, atol=1e-12)
