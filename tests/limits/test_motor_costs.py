"""Motor costs of a motion: efforts, heat, work, effort variation."""

from itertools import pairwise

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from arms import follower_arm
from cases import ANGLE, INERTIA, PEAK_ACCELERATION, PEAK_VELOCITY, one_joint, quintic, with_motors
from scipy.integrate import quad

from tubeplanner import JointTrajectory, load_robot
from tubeplanner.limits.peaks import (
    EffortCosts,
    coulomb_effort,
    effort_variation,
    motor_effort,
)

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

# 1 rad (1 - 4 t^2)^2 from t = -1/2 to 1/2: out and back, at rest at both ends.
OUT_AND_BACK = np.poly1d([-4.0, 4.0, 0.0]) ** 2


def in_one_second(polynomial):
    """Return a bar's motion."""
    return JointTrajectory(["turn"], [0.0, 1.0], polynomial.c[:, None, None])


def test_at_a_reversal_it_is_that_of_the_direction_taken_and_at_the_goal_of_its_approach(tmp_path):
    robot = with_motors(one_joint(tmp_path), **ALL)
    motion = in_one_second(OUT_AND_BACK)
    samples = motion.at(np.array([0.0, 0.2, 0.5, 0.8, 1.0]))
    dry = coulomb_effort(robot, motion, samples)[:, 0]
    np.testing.assert_allclose(dry, [FORTH, FORTH, -BACK, -BACK, -BACK])
    expected = (INERTIA + ARMATURE) * samples.acceleration + VISCOUS * samples.velocity
    effort = motor_effort(robot, motion, samples)
    np.testing.assert_allclose(effort, expected + dry[:, None], atol=1e-12)


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


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_puma_560s_motors_are_what_they_are_behind_its_gears(sign, ur5):
    """The law at the motors, taken through the gears: efforts grow by them, speeds fall."""
    v = sign * np.array([1.0, 0.8, 1.5, 3.0, 2.0, 4.0])
    a = np.array([2.0, -3.0, 1.0, 5.0, 4.0, -9.0])
    rows = np.stack([a / 2, v, np.zeros(6)])[:, None]
    motion = JointTrajectory(ur5.joint_names, [0.0, 0.1], rows)
    samples, size = motion.at(np.zeros(1)), abs(GEARS)
    spinning = AT_MOTORS * size * v + sign * (FORTH_AT_MOTORS if sign > 0 else BACK_AT_MOTORS)
    expected = size * (spinning + ROTORS * size * a)
    state = (samples.position, samples.velocity, samples.acceleration)
    effort = motor_effort(with_motors(ur5, **PUMA), motion, samples) - ur5.inverse_dynamics(*state)
    np.testing.assert_allclose(effort[0], expected, rtol=0.01, atol=0.02)


# Efforts of motors against MuJoCo's inverse dynamics, which reads the same URDF its own way.

LEFT_OUT = mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
STATE = mujoco.mjtConstraintState
SATURATED = (STATE.mjCNSTRSTATE_LINEARNEG, STATE.mjCNSTRSTATE_LINEARPOS)
JOINTS = ["lift", "first", "second", "slide", "wrist", "tip_joint", "side_joint"]


@pytest.fixture(scope="module")
def arms(tmp_path_factory):
    """Seven joints that turn and slide in two branches: ours, and MuJoCo's with the same motors."""
    path = tmp_path_factory.mktemp("mujoco") / "arm.urdf"
    path.write_text(follower_arm({}))
    plain, rng = load_robot(path, "tip", joints=JOINTS), np.random.default_rng(6)
    armature, viscous, dry = rng.uniform(0.1, 2, (3, len(JOINTS)))
    friction = {"backwards_friction": dry, "forwards_friction": dry}
    robot = with_motors(plain, armature=armature, viscous_friction=viscous, **friction)
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.disableflags |= LEFT_OUT
    place = [model.joint(name).dofadr[0] for name in JOINTS]
    model.dof_armature[place] = armature
    model.dof_damping[place] = viscous
    model.dof_frictionloss[place] = dry
    return robot, model, place


def test_where_friction_is_saturated_efforts_are_mujocos(arms):
    robot, model, place = arms
    rng, data = np.random.default_rng(7), mujoco.MjData(model)
    for _ in range(10):
        q, v, a = rng.uniform(-2, 2, (3, len(JOINTS)))
        v += 0.5 * np.sign(v)
        for own, part in zip((data.qpos, data.qvel, data.qacc), (q, v, a), strict=True):
            own[place] = part
        mujoco.mj_inverse(model, data)
        assert np.isin(data.efc_state, SATURATED).tolist() == [True] * len(place)
        motion = JointTrajectory(JOINTS, [0.0, 0.05], np.stack([a / 2, v, q])[:, None])
        effort = motor_effort(robot, motion, motion.at(np.zeros(1)))
        np.testing.assert_allclose(effort[0], data.qfrc_inverse[place], rtol=1e-8, atol=1e-8)


SQUARED_ACCELERATION = 120 / 7  # of the quintic of one radian in one second, integrated
SEVERAL = 40


def divided(trajectory):
    """Return a motion of one piece in many pieces."""
    breakpoints = np.linspace(0, trajectory.duration, SEVERAL + 1)
    (polynomial,) = trajectory.coefficients[:, :, 0].T
    pieces = []
    for begin in breakpoints[:-1]:
        shifted = np.poly1d(polynomial)(np.poly1d([1.0, begin]))
        pieces.append(np.pad(shifted.c, (len(polynomial) - len(shifted.c), 0)))
    return JointTrajectory(trajectory.joint_names, breakpoints, np.array(pieces).T[:, :, None])


def test_a_bar_in_free_rotation_has_closed_forms(tmp_path):
    duration, bar = 2.5, one_joint(tmp_path)
    costs = EffortCosts(bar, divided(quintic(ANGLE, duration)))
    energy = 3.0 * (INERTIA * ANGLE) ** 2 * SQUARED_ACCELERATION / duration**3
    assert costs.energy(np.array([3.0])) == pytest.approx(energy, rel=1e-5)
    work = INERTIA * (PEAK_VELOCITY * ANGLE / duration) ** 2 / 2
    assert costs.work() == pytest.approx(work, rel=1e-5)


def test_of_a_planned_motion_they_are_adaptive_quadratures_of_pinocchios_efforts(stored):
    """Piece by piece, of the two-link arm, whose joints Pinocchio has in the same order."""
    problem, trajectory = stored("two_link/around_a_post", "refinement")
    robot, trajectory = problem.robot, trajectory.between(0.0, 0.25 * trajectory.duration)
    model = pin.buildModelFromUrdf(str(robot.urdf.path))
    model.gravity.linear = np.asarray(robot.gravity)
    data, weights = model.createData(), np.array([0.3, 2.0])

    def effort(t):
        state = (trajectory.position(t), trajectory.velocity(t), trajectory.acceleration(t))
        return pin.rnea(model, data, *(np.ravel(part) for part in state))

    def integral(function):
        pieces = pairwise(trajectory.breakpoints)
        return sum(quad(function, *piece, epsabs=1e-9, epsrel=1e-7)[0] for piece in pieces)

    def power(t):
        return np.maximum(effort(t) * np.ravel(trajectory.velocity(t)), 0.0).sum()

    costs = EffortCosts(robot, trajectory)
    energy = integral(lambda t: effort(t) ** 2 @ weights)
    assert costs.energy(weights) == pytest.approx(energy, rel=1e-4)
    assert costs.work() == pytest.approx(integral(power), rel=1e-4)


def test_friction_is_what_work_overcomes_and_motors_heat_for(tmp_path):
    """Against quadratures of the law, split where the joint reverses; run slower they agree too."""
    robot = with_motors(one_joint(tmp_path, mass=0.5), **ALL)
    q, duration, motion = OUT_AND_BACK, 2.5, in_one_second(OUT_AND_BACK)

    def effort(x):
        static = 0.5 * 9.81 * 0.5 * np.cos(q(x)) + (FORTH if x < 0.5 else -BACK)
        inertia = INERTIA + 0.5 * 0.5**2 + ARMATURE
        return static + VISCOUS * q.deriv()(x) / duration + inertia * q.deriv(2)(x) / duration**2

    def integral(function):
        halves = ((0.0, 0.5), (0.5, 1.0))
        return sum(quad(function, *part, epsabs=1e-11, limit=200)[0] for part in halves)

    energy = integral(lambda x: 3.0 * effort(x) ** 2) * duration
    work = integral(lambda x: max(effort(x) * q.deriv()(x), 0.0))
    for run_in, asked in ((duration, None), (0.7, duration)):
        costs = EffortCosts(robot, divided(motion.scaled(run_in)))
        assert costs.energy(np.array([3.0]), asked) == pytest.approx(energy, rel=3e-4)
        assert costs.work(asked) == pytest.approx(work, rel=3e-4)


MASS, LEVER, GRAVITY, EFFORT = 2.0, 0.5, 9.81, 5.0


def test_a_rest_to_rest_quintic_moves_its_effort_up_down_and_back(tmp_path):
    """From 0 to the peak, to the opposite one, and to 0: four peaks."""
    duration = 0.4
    peak = INERTIA * PEAK_ACCELERATION * ANGLE / duration**2
    result = effort_variation(one_joint(tmp_path), quintic(duration=duration))
    assert result == pytest.approx([4 * peak / EFFORT], rel=5e-3)
    assert result <= 4 * peak / EFFORT


def test_a_pendulums_effort_moves_with_gravity_too(tmp_path):
    """Its extremes are where the closed form turns, found on a fine grid."""
    s = np.linspace(0, 1, 50_001)
    q = ANGLE * s**3 * (10 - 15 * s + 6 * s**2)
    acceleration = ANGLE * s * (60 - 180 * s + 120 * s**2)
    weight = MASS * GRAVITY * LEVER * np.cos(q)
    effort = (INERTIA + MASS * LEVER**2) * acceleration + weight
    expected = abs(np.diff(effort)).sum() / EFFORT
    result = effort_variation(one_joint(tmp_path, mass=MASS), quintic())
    assert result == pytest.approx([expected], rel=1e-2)
    assert abs(result - 4 * INERTIA * PEAK_ACCELERATION * ANGLE / EFFORT) > 0.1


def test_jumps_between_pieces_count_and_the_hold_before_and_after_does_not(tmp_path, two_link):
    """Full effort one way, then the other: from one limit to the opposite; at rest nothing."""
    peak = EFFORT / INERTIA
    coefficients = np.array([[[peak / 2], [-peak / 2]], [[0], [peak]], [[0], [peak / 2]]])
    bang_bang = JointTrajectory(["turn"], [0.0, 1.0, 2.0], coefficients)
    assert effort_variation(one_joint(tmp_path), bang_bang) == pytest.approx([2.0], rel=1e-12)
    still = JointTrajectory(two_link.joint_names, [0.0, 1.0], np.zeros((4, 1, 2)))
    np.testing.assert_array_equal(effort_variation(two_link, still), [0.0, 0.0])


def test_without_a_limit_the_largest_effort_is_the_unit(tmp_path):
    """Or that of another motion: twice as slow, a quarter of the effort and its variation."""
    robot, slower = one_joint(tmp_path, effort=np.inf, acceleration=50.0), quintic().scaled(2.0)
    whole = effort_variation(robot, quintic())
    assert whole == pytest.approx([4.0], rel=5e-3)
    assert effort_variation(robot, slower, quintic()) == pytest.approx(whole / 4, rel=1e-9)
    assert effort_variation(robot, slower) == pytest.approx(whole, rel=1e-9)
