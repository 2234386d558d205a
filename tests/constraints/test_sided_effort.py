"""What a bar's motor needs on either side, by the powers of the speed: closed forms."""

import numpy as np
import pytest

from cases import INERTIA, anywhere, one_joint, with_motors
from tubeplanner.constraints.path_samples import PathSamples
from tubeplanner.constraints.sided_effort import SidedEffort

MASS, LEVER, GRAVITY = 0.5, 0.5, 9.81
VISCOUS, BACK, FORTH, UNSURE, ARMATURE = 0.8, 0.9, 0.3, 0.2, 0.4
SPEED = 1.7


@pytest.fixture
def bar(tmp_path):
    robot = one_joint(tmp_path, mass=MASS)
    return with_motors(
        robot,
        armature=ARMATURE,
        viscous_friction=VISCOUS,
        backwards_friction=BACK,
        forwards_friction=FORTH,
        friction_uncertainty=UNSURE,
    )


def path(robot, q, v, a):
    rows = np.stack([np.array(part, dtype=float)[:, None] for part in (q, v, a)])
    return PathSamples(anywhere(robot), rows)


@pytest.mark.parametrize("v", [1.5, -1.5])
def test_upwards_the_most_counts_and_downwards_the_least(bar, v):
    q, a = 0.3, 2.0
    terms = SidedEffort(np.array([0])).terms(path(bar, [q], [v], [a]))
    held = MASS * GRAVITY * LEVER * np.cos(q)
    dry = FORTH if v > 0 else -BACK
    inertia = INERTIA + MASS * LEVER**2 + ARMATURE
    for column, way in enumerate((1.0, -1.0)):
        expected = {
            0: way * (held + dry) + UNSURE * abs(dry),
            1: way * VISCOUS * v + UNSURE * VISCOUS * abs(v),
            2: way * inertia * a,
        }
        assert {k: term[0, column] for k, term in terms.items()} == pytest.approx(expected)


def test_it_is_of_the_given_joints_forwards_and_then_backwards(ur5):
    own = SidedEffort(np.array([1, 4]))
    assert own.joints.tolist() == [1, 4, 1, 4]
    assert own.way.tolist() == [1.0, 1.0, -1.0, -1.0]
    rng = np.random.default_rng(2)
    arm = with_motors(
        ur5, forwards_friction=np.arange(6.0) + 1, backwards_friction=np.arange(6.0) + 11
    )
    state = rng.uniform(-1, 1, (3, 5, 6))
    found = own.terms(PathSamples(anywhere(arm), state))
    total = sum(term * SPEED**k for k, term in found.items())
    q, v, a = state[0], SPEED * state[1], SPEED**2 * state[2]
    effort = ur5.inverse_dynamics(q, v, a) + np.where(v > 0, np.arange(6) + 1, -np.arange(6) - 11)
    np.testing.assert_allclose(total, np.hstack([effort[:, [1, 4]], -effort[:, [1, 4]]]))


@pytest.mark.parametrize("v", [1.5, -1.5])
def test_its_change_with_the_path_is_that_of_differences(bar, v):
    own, here, step = SidedEffort(np.array([0])), np.array([0.3, v, 2.0]), 1e-6

    def at(point):
        terms = own.terms(path(bar, *point[:, None]))
        return sum(term * SPEED**k for k, term in terms.items())[0]

    exact = own.by_path(path(bar, *here[:, None]), SPEED)
    for order, shift in enumerate(step * np.eye(3)):
        slope = (at(here + shift) - at(here - shift)) / (2 * step)
        np.testing.assert_allclose(exact[order][0, :, 0], slope, atol=1e-7)
