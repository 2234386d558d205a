"""Efforts beyond their limits: found with joint and time, the margin on the safe side."""

import numpy as np
import pytest

from cases import changed, unlimited
from tubeplanner import LimitOverrides, load_robot, verify


def test_two_parts_in_a_thousand_of_effort_are_found_with_joint_and_time(stored):
    """A motor that is weaker by 0.2 %, under a trajectory that uses all of it."""
    problem, trajectory = stored("two_link/around_a_post", "branch-and-bound")
    tau = effort_shares(problem.robot, trajectory)
    joint = problem.robot.joint_names[int(tau.max(axis=0).argmax())]
    weak = LimitOverrides(
        velocity=unlimited().velocity,
        effort={joint: 0.998 * problem.robot.limits.effort[int(tau.max(axis=0).argmax())]},
    )
    robot = load_robot("example:two_link", "hand", gravity=(0, 0, 0), limits=weak)
    certificate = verify(changed(problem, robot=robot), trajectory)
    assert certificate.failures() == ["effort"]
    condition = certificate.conditions["effort"]
    assert condition.margin == pytest.approx(1 - 1 / 0.998, abs=1e-6)
    assert condition.where.joint == joint
    t = np.linspace(0, trajectory.duration, len(tau))
    assert condition.where.time == pytest.approx(t[tau.max(axis=1).argmax()], abs=1e-3)


def effort_shares(robot, trajectory, count=20_001):
    s = trajectory.at(np.linspace(0, trajectory.duration, count))
    return abs(robot.inverse_dynamics(s.position, s.velocity, s.acceleration)) / robot.limits.effort


def test_the_error_of_an_enclosure_is_taken_off_the_margin(stored, monkeypatch):
    """Polynomials that miss a hundredth: the margin is then a hundredth on the safe side."""
    problem, trajectory = stored("two_link/around_a_post", "branch-and-bound")
    exact = verify(problem, trajectory).conditions["effort"].margin
    monkeypatch.setattr("tubeplanner.verification.judged_motion.EFFORT_ENCLOSURE", 1e-2)
    rough = verify(problem, trajectory).conditions["effort"].margin
    assert exact - 2e-2 < rough < exact - 1e-6


def test_an_undecided_effort_tells_what_was_found(stored, monkeypatch):
    problem, trajectory = stored("two_link/around_a_post", "branch-and-bound")
    monkeypatch.setattr("tubeplanner.verification.enclosure._MAX_INTERVALS", 1)
    condition = verify(problem, trajectory).conditions["effort"]
    found = float(condition.coverage.removeprefix("for all t, undecided: the margin found is ")
                  .removesuffix(" relative"))  # fmt: skip
    assert found == pytest.approx(0.0, abs=0.1)
    assert condition.margin < found
