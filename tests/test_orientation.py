"""Rotation matrices against scipy's."""

import numpy as np
from scipy.spatial.transform import Rotation

from tubeplanner.orientation import matrix_of_quaternion, matrix_of_rpy


def test_quaternions_of_any_length_give_the_matrices_of_scipy():
    quaternions = np.random.default_rng(0).normal(size=(20, 4))
    expected = Rotation.from_quat(quaternions).as_matrix()
    np.testing.assert_allclose(matrix_of_quaternion(quaternions), expected, atol=1e-15)
    np.testing.assert_allclose(matrix_of_quaternion(3 * quaternions[0]), expected[0], atol=1e-15)


def test_roll_pitch_and_yaw_turn_about_fixed_axes():
    for angles in np.random.default_rng(1).uniform(-4, 4, (20, 3)):
        expected = Rotation.from_euler("xyz", angles).as_matrix()
        np.testing.assert_allclose(matrix_of_rpy(*angles), expected, atol=1e-15)
