"""Jumps between the pieces of a trajectory: found, added up, measured by what is large."""

from itertools import pairwise

import numpy as np
import pytest

from tubeplanner import JointTrajectory, Tolerance, load_problem, verify
from tubeplanner.trajectory.joint_trajectory import concatenate

UR5 = "ur5/over_the_wall"


@pytest.mark.parametrize(
    ("order", "condition"), [(0, "continuity"), (1, "continuity"), (2, "continuity")]
)
def test_a_jump_is_found_at_its_joint_and_time(order, condition, stored):
    problem, trajectory = stored(UR5)
    coefficients = trajectory.coefficients.copy()
    coefficients[-1 - order, 20, 3] += 1e-3
    jumping = JointTrajectory(trajectory.joint_names, trajectory.breakpoints, coefficients)
    certificate = verify(problem, jumping)
    assert condition in certificate.failures()
    where = certificate.conditions[condition].where
    assert where.joint == "wrist_1_joint"
    assert where.time in trajectory.breakpoints[[20, 21]]


def test_a_jump_of_position_is_judged_in_radians(stored):
    """There and back: a milliradian in sum, within a thousandth but not within the tolerance."""
    problem, trajectory = stored(UR5)
    coefficients = trajectory.coefficients.copy()
    coefficients[-1, 20, 1] += 5e-4
    jumping = JointTrajectory(trajectory.joint_names, trajectory.breakpoints, coefficients)
    certificate = verify(problem, jumping, Tolerance(1e-4, 1e-3))
    condition = certificate.conditions["continuity"]
    assert "continuity" in certificate.failures()
    assert condition.unit == "rad"
    assert condition.margin == pytest.approx(-1e-3, rel=1e-6)


def test_many_small_jumps_add_up(two_link):
    """A staircase turns a joint by half a radian in no time; each step is within the tolerance."""
    problem = load_problem("example:two_link/paper_1_30mm")
    steps, tolerance = 600, Tolerance(1e-3, 1e-3)
    start = np.array([1.0, 0.5])
    q = start + np.linspace(0.0, 0.5, steps)[:, None] * np.array([1.0, 0.0])
    times = np.linspace(0.0, 0.01, steps + 1)
    staircase = JointTrajectory(two_link.joint_names, times, q[None])
    assert abs(np.diff(q, axis=0)).max() < tolerance.absolute
    condition = verify(problem, staircase, tolerance).conditions["continuity"]
    assert condition.margin == pytest.approx(-0.5)
    assert not condition.holds(tolerance)


def test_slices_that_are_shifted_add_up(stored):
    problem, trajectory = stored(UR5)
    times = np.linspace(0.0, trajectory.duration, 3001)
    parts = [trajectory.between(a, b) for a, b in pairwise(times)]
    whole = concatenate([part for part in parts if len(part.widths) == 1])
    coefficients = whole.coefficients.copy()
    coefficients[-1, :, 2] += 8e-7 * (np.arange(len(whole.widths)) % 2)
    shifted = JointTrajectory(whole.joint_names, whole.breakpoints, coefficients)
    condition = verify(problem, shifted).conditions["continuity"]
    assert condition.where.joint == "elbow_joint"
    assert condition.margin < -1e-3


def test_the_rounding_errors_of_a_joint_at_rest_are_no_jumps(stored):
    """The joint that stands still is given the noise that sums of large numbers leave."""
    problem, trajectory = stored(UR5)
    still = trajectory.coefficients.copy()
    still[:, :, 5] = 0.0
    still[:-1, :, 5] = np.random.default_rng(0).normal(size=still[:-1, :, 5].shape) * 1e-15
    noisy = JointTrajectory(trajectory.joint_names, trajectory.breakpoints, still)
    failures = verify(problem, noisy).failures()
    assert "rest" not in failures
    assert "continuity" not in failures


@pytest.mark.parametrize("order", [1, 2])
def test_a_jump_is_measured_by_the_largest(order, stored):
    problem, trajectory = stored("two_link/around_a_post", "branch-and-bound")
    joint, piece = 1, 3
    coefficients = trajectory.coefficients.copy()
    coefficients[-1 - order, piece, joint] += 0.5
    jumping = JointTrajectory(trajectory.joint_names, trajectory.breakpoints, coefficients)
    dense = jumping.per_piece(2000)
    values = (dense.position, dense.velocity, dense.acceleration)
    ends = [value.reshape(-1, 2000, 2)[:, [0, -1]] for value in values]
    jumps = [abs(end[1:, 0] - end[:-1, 1]) for end in ends]
    shares = [jump / abs(v).max(axis=0) for jump, v in zip(jumps, values, strict=True)]
    worst = max(float(share.sum(axis=0).max()) for share in shares[1:])
    condition = verify(problem, jumping, Tolerance(0.5, 0.0)).conditions["continuity"]
    assert condition.margin == pytest.approx(-worst, rel=1e-3)


@pytest.mark.parametrize("slower", [1.0, 50.0])
def test_a_jump_counts_the_same_however_slow_the_trajectory(slower, stored):
    problem, trajectory = stored("two_link/around_a_post", "branch-and-bound")
    coefficients = trajectory.coefficients.copy()
    coefficients[-2, 3, 1] += 0.5
    jumping = JointTrajectory(trajectory.joint_names, trajectory.breakpoints, coefficients)
    tolerance = Tolerance(0.9, 0.0)
    fast = verify(problem, jumping, tolerance).conditions["continuity"]
    slow = verify(problem, jumping.scaled(slower), tolerance).conditions["continuity"]
    assert slow.margin == pytest.approx(fast.margin, rel=1e-9)
