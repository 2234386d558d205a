"""A trajectory that still moves at an end: found, at its joint, measured by its largest rates."""

import pytest

from tubeplanner import JointTrajectory, verify

UR5 = "ur5/over_the_wall"


def test_a_trajectory_that_does_not_stop_is_found(stored):
    problem, trajectory = stored(UR5)
    moving = trajectory.between(0.0, trajectory.duration * 0.97)
    failures = verify(problem, moving).failures()
    assert {"rest", "goal"} <= set(failures)


@pytest.mark.parametrize("at_end", [False, True])
@pytest.mark.parametrize("order", [1, 2])
def test_trajectory_at_an_end_is_measured_by_the_largest(order, at_end, stored):
    """A slope or a bend of one joint at the start or the end, as a share of its largest."""
    problem, trajectory = stored("two_link/around_a_post", "branch-and-bound")
    joint = 1
    coefficients = trajectory.coefficients.copy()
    piece = -1 if at_end else 0
    coefficients[-1 - order, piece, joint] += 0.3
    moving = JointTrajectory(trajectory.joint_names, trajectory.breakpoints, coefficients)
    rate = moving.velocity if order == 1 else moving.acceleration
    dense = moving.per_piece(2000)
    largest = abs((dense.velocity, dense.acceleration)[order - 1][:, joint]).max()
    time = moving.duration if at_end else 0.0
    condition = verify(problem, moving).conditions["rest"]
    shares = [
        abs(f(time)[joint]) / abs(values[:, joint]).max()
        for f, values in (
            (moving.velocity, dense.velocity),
            (moving.acceleration, dense.acceleration),
        )
    ]
    assert abs(rate(time)[joint]) / largest in shares
    assert condition.margin == pytest.approx(-max(shares), rel=1e-3)
    assert condition.where.time == time
    assert condition.where.joint == "joint2"
