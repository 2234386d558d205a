"""What a motion takes from its motors: closed forms, and quadratures of something else."""

from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import quad

from cases import ANGLE, INERTIA, PEAK_VELOCITY, one_joint, quintic, with_motors
from tubeplanner import JointTrajectory, PlanOptions, plan
from tubeplanner.constraints.effort_costs import EffortCosts

SQUARED_ACCELERATION = 120 / 7  # of the quintic of one radian in one second, integrated
SEVERAL = 40
HALVES = ((0.0, 0.5), (0.5, 1.0))


def divided(trajectory):
    """Return a motion of one piece in many pieces."""
    breakpoints = np.linspace(0, trajectory.duration, SEVERAL + 1)
    (polynomial,) = trajectory.coefficients[:, :, 0].T
    pieces = []
    for begin in breakpoints[:-1]:
        shifted = np.poly1d(polynomial)(np.poly1d([1.0, begin]))
        pieces.append(np.pad(shifted.c, (len(polynomial) - len(shifted.c), 0)))
    return JointTrajectory(trajectory.joint_names, breakpoints, np.array(pieces).T[:, :, None])


@pytest.mark.parametrize("duration", [1.0, 2.5])
def test_a_bar_in_free_rotation_has_closed_forms(duration, tmp_path):
    costs = EffortCosts(one_joint(tmp_path), divided(quintic(ANGLE, duration)))
    energy = 3.0 * (INERTIA * ANGLE) ** 2 * SQUARED_ACCELERATION / duration**3
    assert costs.energy(np.array([3.0])) == pytest.approx(energy, rel=1e-5)
    work = INERTIA * (PEAK_VELOCITY * ANGLE / duration) ** 2 / 2
    assert costs.work() == pytest.approx(work, rel=1e-5)


def test_other_durations_are_those_of_the_motion_run_slower(tmp_path):
    """With gravity, whose share does not depend on speed."""
    robot, motion, weights = one_joint(tmp_path, mass=0.5), divided(quintic()), np.array([0.04])
    costs, slower = EffortCosts(robot, motion), EffortCosts(robot, motion.scaled(1.7))
    assert costs.energy(weights, 1.7) == pytest.approx(slower.energy(weights), rel=1e-9)
    assert costs.work(1.7) == pytest.approx(slower.work(), rel=1e-9)
    assert costs.work(1.7) != pytest.approx(costs.work(), rel=0.1)


def test_of_a_planned_motion_they_are_adaptive_quadratures_of_pinocchios_efforts(bundled):
    """Piece by piece, of the two-link arm, whose joints Pinocchio has in the same order."""
    problem = bundled("two_link/around_a_post")
    robot, trajectory = problem.robot, plan(problem, PlanOptions(slack=0.05)).trajectory
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


def out_and_back(duration):
    """A bar's motion of one radian out and back, at rest at both ends, in many pieces."""
    rows = np.poly1d([-4.0, 4.0, 0.0]) ** 2
    motion = JointTrajectory(["turn"], [0.0, 1.0], rows.c[:, None, None])
    return divided(motion.scaled(duration))


@pytest.mark.parametrize("duration", [1.0, 2.5])
def test_friction_is_what_work_overcomes_and_motors_heat_for(duration, tmp_path):
    """Against quadratures of the law, split where the joint reverses; run slower they agree too."""
    viscous, back, forth, armature = 0.8, 0.9, 0.3, 0.4
    robot = with_motors(
        one_joint(tmp_path, mass=0.5),
        armature=armature,
        viscous_friction=viscous,
        backwards_friction=back,
        forwards_friction=forth,
    )
    q = np.poly1d([-4.0, 4.0, 0.0]) ** 2

    def effort(x):
        held = 0.5 * 9.81 * 0.5 * np.cos(q(x)) + (forth if x < 0.5 else -back)
        inertia = INERTIA + 0.5 * 0.5**2 + armature
        return held + viscous * q.deriv()(x) / duration + inertia * q.deriv(2)(x) / duration**2

    def integral(function):
        return sum(quad(function, *part, epsabs=1e-11, limit=200)[0] for part in HALVES)

    energy = integral(lambda x: 3.0 * effort(x) ** 2) * duration
    work = integral(lambda x: max(effort(x) * q.deriv()(x), 0.0))
    for costs, given in (
        (EffortCosts(robot, out_and_back(duration)), None),
        (EffortCosts(robot, out_and_back(0.7)), duration),
    ):
        assert costs.energy(np.array([3.0]), given) == pytest.approx(energy, rel=3e-4)
        assert costs.work(given) == pytest.approx(work, rel=3e-4)
