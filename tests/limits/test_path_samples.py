"""Coulomb friction blended over reversals: never less than there is, and exact away from them."""

from dataclasses import replace

import numpy as np
import pytest

from tubeplanner.limits.path_samples import CoulombFriction, blended_friction, directed_friction
from tubeplanner.robot.motors import JointMotors

BACK, FORTH = 0.9, 0.3
FRACTION = 0.2


def motors(back=(BACK,), forth=(FORTH,), uncertainty=0.0):
    return replace(
        JointMotors.ideal(len(back)),
        backwards_friction=np.array(back),
        forwards_friction=np.array(forth),
        friction_uncertainty=uncertainty,
    )


def blended(own, rate, directions=np.nan):
    """Return blended friction; directions at the ends of a motion, unknown elsewhere."""
    return blended_friction(own, rate, np.broadcast_to(directions, rate.shape), FRACTION)


def test_its_direction_is_that_of_the_motion_and_none_at_rest():
    """Each side has its own."""
    result = directed_friction(motors(uncertainty=0.5), np.array([[2.0], [-1.0], [0.0]]))
    np.testing.assert_allclose(result.most[:, 0], [1.5 * FORTH, -0.5 * BACK, 0.0])
    np.testing.assert_allclose(result.least[:, 0], [0.5 * FORTH, -1.5 * BACK, 0.0])
    assert not result.most_by_rate.any()
    assert not result.least_by_rate.any()
    friction = CoulombFriction(*(np.full((1, 1), value) for value in (1.0, 2.0, 3.0, 4.0)))
    assert [float(part[0, 0]) for part in friction.side(1.0)] == [1.0, 3.0]
    assert [float(part[0, 0]) for part in friction.side(-1.0)] == [2.0, 4.0]


@pytest.mark.parametrize("uncertainty", [0.0, 0.3])
def test_blended_it_is_no_less_anywhere_and_exact_at_speed(uncertainty):
    rng = np.random.default_rng(3)
    own = motors(rng.uniform(0, 2, 4), rng.uniform(0, 2, 4), uncertainty)
    rate = rng.normal(size=(400, 4)) * [1.0, 0.01, 3.0, 0.5]
    even, exact = blended(own, rate), directed_friction(own, rate)
    more, less = even.most - exact.most, exact.least - even.least
    fast = abs(rate) >= FRACTION * abs(rate).max(axis=0)
    assert 0.1 < fast.mean() < 0.9
    for beyond in (more, less):
        assert (beyond >= -1e-12).all()
        assert ((beyond > 1e-3) & ~fast).any(axis=0).all()
    for name in CoulombFriction.__dataclass_fields__:
        result, expected = getattr(even, name), getattr(exact, name)
        np.testing.assert_allclose(result[fast], expected[fast], atol=1e-12)


@pytest.mark.parametrize("uncertainty", [0.0, 0.5])
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_it_changes_evenly_before_a_reversal_and_is_whole_a_tenth_early(direction, uncertainty):
    """On the way to it: of the direction that comes, from nothing at the width to all of it."""
    width = FRACTION * 5.0
    fractions = np.array([1.2, 1.0, 0.775, 0.55, 0.1, 0.05, 0.0])
    rate = -direction * width * np.append(fractions, 5 / width)[:, None]
    result = blended(motors(uncertainty=uncertainty), rate)
    more, less = 1 + uncertainty, 1 - uncertainty
    ramp = np.array([0, 0, 0.25, 0.5, 1, 1, 1])
    if direction > 0:
        expected = -BACK * less + (BACK * less + FORTH * more) * ramp
        np.testing.assert_allclose(result.most[:-1, 0], expected)
        np.testing.assert_allclose(result.least[:-1], -BACK * more)
    else:
        expected = FORTH * less - (FORTH * less + BACK * more) * ramp
        np.testing.assert_allclose(result.least[:-1, 0], expected)
        np.testing.assert_allclose(result.most[:-1], FORTH * more)


def test_its_slopes_are_those_of_differences():
    """The largest velocity, by which the width is measured, is that of a sample of its own."""
    rng = np.random.default_rng(5)
    own = motors((0.5, 1.5), (1.0, 0.2), 0.2)
    rate = np.append(rng.uniform(-0.3, 0.3, (60, 2)), [[1.0, -1.0]], axis=0)
    step = 1e-7 * (abs(rate) < 0.9)
    here, above, below = (blended(own, rate + sign * step) for sign in (0.0, 1.0, -1.0))
    for name in ("most", "least"):
        slope = (getattr(above, name) - getattr(below, name))[:-1] / 2e-7
        exact = getattr(here, f"{name}_by_rate")
        np.testing.assert_allclose(exact[:-1], slope, rtol=1e-6, atol=1e-6)
        assert 0.2 < (exact[:-1] != 0).mean() < 0.8


def test_at_the_ends_it_is_that_of_the_direction_there():
    """Whatever rounding makes of a velocity of zero."""
    rate = np.array([[1e-18], [1.0], [-1e-18], [0.05]])
    result = blended(motors(), rate, np.array([[-2.0], [np.nan], [3.0], [0.0]]))
    for each in (result.most, result.least):
        np.testing.assert_allclose(each[:, 0], [-BACK, FORTH, FORTH, 0.0])
    assert not result.most_by_rate.any()
    assert not result.least_by_rate.any()


def test_a_joint_that_stands_still_has_none():
    """Alone, or beside one that moves: below a millionth of its velocity."""
    assert not blended(motors(), np.zeros((3, 1))).most.any()
    rate = np.array([[1.0, 0.9e-6, 1.1e-6, 0.0], [-1.0, -0.9e-6, -1.1e-6, 0.0]])
    own = motors((BACK,) * 4, (FORTH,) * 4)
    expected = [[FORTH, 0, FORTH, 0], [-BACK, 0, -BACK, 0]]
    np.testing.assert_allclose(blended(own, rate).most, expected)
    np.testing.assert_allclose(blended(own, rate, 1.0).most, [[FORTH, 0, FORTH, 0]] * 2)
