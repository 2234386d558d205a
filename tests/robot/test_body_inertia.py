import numpy as np
import pytest

from tubeplanner.robot.body_inertia import BodyInertia


def cloud(random):
    """Mass points, and what they are as a body."""
    mass, place = random.uniform(0.5, 2, 9), random.normal(size=(9, 3))
    return mass, place, of_points(mass, place)


def of_points(mass, place):
    com = mass @ place / mass.sum()
    away = place - com
    inertia = sum(m * (a @ a * np.eye(3) - np.outer(a, a)) for m, a in zip(mass, away, strict=True))
    return BodyInertia(mass.sum(), com, inertia)


def assert_same(found, expected):
    assert found.mass == pytest.approx(expected.mass)
    np.testing.assert_allclose(found.com, expected.com, atol=1e-12)
    np.testing.assert_allclose(found.inertia, expected.inertia, atol=1e-11)


def test_two_bodies_as_one_are_all_their_points():
    random = np.random.default_rng(0)
    (mass, place, body), (other_mass, other_place, other) = cloud(random), cloud(random)
    points = np.append(mass, other_mass), np.concatenate([place, other_place])
    both = body.plus(other)
    assert_same(both, of_points(*points))
    assert_same(both.plus(other.scaled(-1.0)), body)


def test_a_body_in_another_frame_has_its_points_there():
    random = np.random.default_rng(1)
    mass, place, body = cloud(random)
    placement = np.eye(4)
    placement[:3, :3] = np.linalg.qr(random.normal(size=(3, 3)))[0]
    placement[:3, 3] = random.normal(size=3)
    expected = of_points(mass, place @ placement[:3, :3].T + placement[:3, 3])
    assert_same(body.placed(placement), expected)


def test_a_denser_and_a_shifted_body():
    mass, place, body = cloud(np.random.default_rng(2))
    assert_same(body.scaled(1.5), of_points(1.5 * mass, place))
    by = np.array([0.1, 0.0, -0.2])
    assert_same(body.shifted(by), of_points(mass, place + by))


def test_bounds_on_norms():
    body = BodyInertia(2.0, np.array([3.0, 0.0, 4.0]), np.diag([1.0, 3.0, 2.0]))
    assert (body.com_distance, body.moment) == (5.0, 3.0)


def test_nothing_and_nothing_is_nothing():
    nothing = BodyInertia(0.0, np.zeros(3), np.zeros((3, 3)))
    assert_same(nothing.plus(nothing), nothing)
