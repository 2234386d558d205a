"""What motors give along motions with reversals and rests: closed forms; Puma 560's friction."""

import numpy as np
import pytest

from cases import INERTIA, one_joint, with_motors
from tubeplanner import JointTrajectory, load_robot
from tubeplanner.constraints.motor_effort import coulomb_effort, motor_effort

BACK, FORTH, VISCOUS, ARMATURE = 0.9, 0.3, 0.8, 0.4
ALL = {
    "armature": ARMATURE,
    "viscous_friction": VISCOUS,
    "backwards_friction": BACK,
    "forwards_friction": FORTH,
}
# Puma 560 at its motors (Corke & Armstrong-Helouvry, "A search for consensus among model parameters
# reported for the PUMA 560 robot", 1994): gear ratios, rotors [kg m^2], viscous friction
# [N m s/rad], and Coulomb friction forwards and backwards [N m].
GEARS = np.array([-62.6111, 107.815, -53.7063, 76.0364, 71.923, 76.686])
ROTORS = np.array([200e-6, 200e-6, 200e-6, 33e-6, 33e-6, 33e-6])
AT_MOTORS = np.array([1.48e-3, 0.817e-3, 1.38e-3, 71.2e-6, 82.6e-6, 36.7e-6])
FORTH_AT_MOTORS = np.array([0.395, 0.126, 0.132, 11.2e-3, 9.26e-3, 3.96e-3])
BACK_AT_MOTORS = np.array([0.435, 0.071, 0.105, 16.9e-3, 14.5e-3, 10.5e-3])
# And as felt at its joints.
PUMA = {
    "armature": [0.784, 2.325, 0.577, 0.191, 0.171, 0.194],
    "viscous_friction": [5.8, 9.5, 3.98, 0.41, 0.43, 0.22],
    "forwards_friction": [24.7, 13.6, 7.1, 0.85, 0.67, 0.30],
    "backwards_friction": [27.2, 7.7, 5.6, 1.29, 1.04, 0.81],
}


def there_and_back():
    """0.5 (1 - 4 t^2)^2 from t = -1/2 to 1/2: out to 0.5 rad and back, at rest at both ends."""
    rows = np.poly1d([-4.0, 4.0, 0.0]) ** 2 * 0.5
    return JointTrajectory(["turn"], [0.0, 1.0], rows.c[:, None, None])


def test_at_a_reversal_it_is_that_of_the_direction_taken_and_at_the_goal_of_its_approach(tmp_path):
    robot, motion = with_motors(one_joint(tmp_path), **ALL), there_and_back()
    samples = motion.at(np.array([0.0, 0.2, 0.5, 0.8, 1.0]))
    dry = coulomb_effort(robot, motion, samples)[:, 0]
    np.testing.assert_allclose(dry, [FORTH, FORTH, -BACK, -BACK, -BACK])
    expected = (INERTIA + ARMATURE) * samples.acceleration + VISCOUS * samples.velocity
    found = motor_effort(robot, motion, samples)
    np.testing.assert_allclose(found, expected + dry[:, None], atol=1e-12)


def test_at_instants_of_no_velocity_pieces_of_any_width_have_their_own_directions(tmp_path):
    """The second takes half as long as the first, turns back there, and reverses twice."""
    robot = with_motors(one_joint(tmp_path), **ALL)
    first = np.poly1d([-1.0, 2.0, 0.0])  # out, to rest at its end
    second = np.poly1d([0.0, 0.125, 0.375], r=True).integ() * -1.0
    rows = np.stack([np.pad(each.c, (4 - each.order, 0)) for each in (first, second)])
    motion = JointTrajectory(["turn"], [0.0, 1.0, 1.5], rows.T[:, :, None])
    time = np.array([0.0, 0.999, 1.0, 1.1, 1.125, 1.2, 1.375, 1.45, 1.5])
    dry = coulomb_effort(robot, motion, motion.at(time))[:, 0]
    turns = [FORTH] * 2 + [-BACK] * 2 + [FORTH] * 2 + [-BACK] * 3
    np.testing.assert_allclose(dry, turns)


def test_a_joint_that_stands_still_has_none(tmp_path, slide):
    robot = with_motors(slide, backwards_friction=BACK, forwards_friction=FORTH)
    rows = np.zeros((2, 1, 3))
    rows[0, 0] = [1.0, 0.5e-6, -2e-6]
    motion = JointTrajectory(slide.joint_names, [0.0, 1.0], rows)
    dry = coulomb_effort(robot, motion, motion.at(np.array([0.0, 0.4])))
    np.testing.assert_allclose(dry, [[FORTH, 0.0, -BACK]] * 2)


def test_without_coulomb_friction_it_is_what_the_arm_needs(ur5):
    rng = np.random.default_rng(1)
    motion = JointTrajectory(ur5.joint_names, [0.0, 0.3, 1.0], rng.normal(size=(4, 2, 6)))
    samples = motion.at(np.linspace(0, 1, 20))
    arm = with_motors(ur5, viscous_friction=VISCOUS)
    assert not coulomb_effort(arm, motion, samples).any()
    state = (samples.position, samples.velocity, samples.acceleration)
    expected = ur5.inverse_dynamics(*state) + VISCOUS * samples.velocity
    np.testing.assert_allclose(motor_effort(arm, motion, samples), expected)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_puma_560s_motors_are_what_they_are_behind_its_gears(way):
    """The law at the motors, taken through the gears: efforts grow by them, speeds fall."""
    plain = load_robot("example:ur5", "tool0")
    robot = with_motors(plain, **PUMA)
    v, a = (
        way * np.array([1.0, 0.8, 1.5, 3.0, 2.0, 4.0]),
        np.array([2.0, -3.0, 1.0, 5.0, 4.0, -9.0]),
    )
    rows = np.stack([a / 2, v, np.zeros(6)])[:, None]
    motion = JointTrajectory(plain.joint_names, [0.0, 0.1], rows)
    samples = motion.at(np.zeros(1))
    size = abs(GEARS)
    spinning = AT_MOTORS * size * v + way * (FORTH_AT_MOTORS if way > 0 else BACK_AT_MOTORS)
    expected = size * (spinning + ROTORS * size * a)
    state = (samples.position, samples.velocity, samples.acceleration)
    found = motor_effort(robot, motion, samples) - plain.inverse_dynamics(*state)
    np.testing.assert_allclose(found[0], expected, rtol=0.01, atol=0.02)
