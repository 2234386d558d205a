"""Rotation matrices from quaternions, roll-pitch-yaw and rotation vectors; their rates."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tubeplanner.orientation import (
    MATRIX_ERROR_GAIN,
    inverse_right_jacobian,
    matrix_of_quaternion,
    matrix_of_rpy,
    nearest_branch,
    rotation_matrix,
    rotation_vector,
    rpy_of_matrix,
    turning_gain,
    turning_gain_rate,
)


# Rotation matrices against scipy's.
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
        result = rpy_of_matrix(upright)
        assert result[0] == 0
        np.testing.assert_allclose(matrix_of_rpy(*result), upright, atol=1e-12)
        nearly = matrix_of_rpy(0.3, 0.99999999 * pitch, 0.8)
        np.testing.assert_allclose(matrix_of_rpy(*rpy_of_matrix(nearly)), nearly, atol=1e-14)


# Rotation vectors against scipy and their own definitions, at all angles.
ANGLES = (0.0, 1e-300, 1e-160, 1e-20, 1e-8, 9.99e-3, 1.001e-2, 1.0, 2.5, np.pi - 1e-9, np.pi)


def directions(count=500, seed=0):
    v = np.random.default_rng(seed).normal(size=(count, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def vectors(largest, seed=1):
    angle = np.random.default_rng(seed).uniform(0, largest, (500, 1))
    return angle * directions(seed=seed)


@pytest.mark.parametrize("angle", ANGLES)
def test_matrix_and_vector_are_inverse_at_every_angle(angle):
    v = np.vstack([angle * directions(), angle * np.eye(3), -angle * np.eye(3)])
    matrix = rotation_matrix(v)
    np.testing.assert_allclose(matrix, Rotation.from_rotvec(v).as_matrix(), atol=4e-15)
    result = rotation_vector(matrix)
    off = np.linalg.norm(result - v, axis=1)
    if angle == np.pi:  # either sign
        off = np.minimum(off, np.linalg.norm(result + v, axis=1))
    assert off.max() <= 4e-15 * angle + (1e-150 if angle < 1e-150 else 0)
    assert (np.linalg.norm(result, axis=1) <= np.pi * (1 + 1e-15)).all()


def test_a_vector_keeps_any_leading_shape():
    v = vectors(3.0)[:12].reshape(3, 4, 3)
    np.testing.assert_allclose(rotation_vector(rotation_matrix(v)), v, atol=1e-14)
    np.testing.assert_allclose(rotation_vector(rotation_matrix(v[0, 0])), v[0, 0], atol=1e-14)


def test_the_inverse_jacobian_turns_spin_into_the_vectors_change():
    v, spin, step = vectors(3.1), directions(seed=3), 1e-6
    rotations = [rotation_matrix(v) @ rotation_matrix(sign * step * spin) for sign in (1, -1)]
    difference = (rotation_vector(rotations[0]) - rotation_vector(rotations[1])) / (2 * step)
    exact = np.einsum("nij,nj->ni", inverse_right_jacobian(v), spin)
    np.testing.assert_allclose(exact, difference, atol=1e-8)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 9.99e-3, 1.001e-2, 1.0, 3.0, np.pi, 3.4])
def test_the_gains_bound_the_jacobian_and_its_change(angle):
    v, across, step = angle * directions(), directions(seed=5), 1e-6
    gain = np.linalg.norm(inverse_right_jacobian(v), 2, axis=(1, 2))
    np.testing.assert_allclose(gain, turning_gain(np.array(angle)), rtol=1e-12)
    change = inverse_right_jacobian(v + step * across) - inverse_right_jacobian(v - step * across)
    rate = np.linalg.norm(change, 2, axis=(1, 2)) / (2 * step)
    bound = turning_gain_rate(np.array(angle))
    assert rate.max() <= bound * (1 + 1e-6)
    assert rate.max() >= 0.6 * bound


def test_the_gains_grow_with_the_angle():
    angle = np.linspace(0, 3.5, 5000)
    assert (np.diff(turning_gain(angle)) >= 0).all()
    assert (np.diff(turning_gain_rate(angle)) >= -1e-9).all()


def test_an_error_of_the_matrix_is_amplified_no_more_than_said():
    v, size = vectors(3.0), 1e-6
    error = np.random.default_rng(2).normal(size=(500, 3, 3))
    error /= np.linalg.norm(error, axis=1, keepdims=True)
    off = rotation_vector(rotation_matrix(v) + size * error) - rotation_vector(rotation_matrix(v))
    gain = np.linalg.norm(off, axis=1) / size / turning_gain(np.linalg.norm(v, axis=1))
    assert gain.max() < MATRIX_ERROR_GAIN


@pytest.mark.parametrize(
    ("v", "near", "components", "expected"),
    [
        ([0, 0, 3], [0, 0, -3], [1, 1, 1], [0, 0, 3 - 2 * np.pi]),
        ([0, 0, 3], [0, 0, 0.1], [1, 1, 1], [0, 0, 3]),
        ([0.3, 0, 3], [-0.3, 0, 9], [1, 1, 0], [-0.3 * 1.0840, 0, -3 * 1.0840]),
        ([0, 0, 1], [0, 0, -5], [1, 1, 1], [0, 0, 1]),
        ([0, 0, 0], [0, 0, 5], [1, 1, 1], [0, 0, 0]),
    ],
    ids=["the other way round", "near already", "two count", "too far round", "no rotation"],
)
def test_the_nearest_of_a_rotations_vectors_is_taken(v, near, components, expected):
    v, near = np.array(v, dtype=float), np.array(near, dtype=float)
    result = nearest_branch(v, near, np.array(components, dtype=bool))
    np.testing.assert_allclose(result, expected, atol=1e-4)
    np.testing.assert_allclose(rotation_matrix(result), rotation_matrix(v), atol=1e-14)
