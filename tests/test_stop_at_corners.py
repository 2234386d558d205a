from itertools import pairwise

import numpy as np
import pytest

from conftest import PROBLEMS
from tubeplanner.reference_branch import reference_branch, spare_joint_rules
from tubeplanner.stop_at_corners import stop_at_corners
from tubeplanner.time_scaling import minimum_duration

# Durations of the conventional scheme of the paper, straight lines at trapezoidal hand speed with
# stops (0.75 m/s, 1.2 m/s^2), by the formula d/v + v/a or 2 sqrt(d/a).
SPEED, ACCELERATION = 0.75, 1.2


def branch_of(problem):
    """Return the branch by the first rule for spare joints."""
    return reference_branch(problem, spare_joint_rules(problem)[0])


def conventional_duration(points):
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    short = lengths < SPEED**2 / ACCELERATION
    times = np.where(
        short, 2 * np.sqrt(lengths / ACCELERATION), lengths / SPEED + SPEED / ACCELERATION
    )
    return times.sum()


@pytest.mark.parametrize("name", PROBLEMS)
def test_the_arm_rests_at_every_reference_point(name, planned):
    problem, result = planned(name)
    trajectory = result.trajectory
    t = np.linspace(0, trajectory.duration, 20_000)
    speed = abs(trajectory.velocity(t)).max(axis=1)
    hand = problem.robot.tool_position(trajectory.position(t))
    for corner in problem.tube.points[1:-1]:
        nearest = int(np.linalg.norm(hand - corner, axis=1).argmin())
        assert np.linalg.norm(hand[nearest] - corner) < 1e-4
        around = slice(nearest - 100, nearest + 100)
        assert speed[around].min() < 1e-3 * speed.max()


@pytest.mark.parametrize("name", PROBLEMS)
def test_every_segment_runs_at_its_limits(name, planned):
    """No segment could be run faster, and none breaks a limit: its own minimum is its duration."""
    problem, result = planned(name)
    trajectory = result.trajectory
    moving = abs(trajectory.velocity(trajectory.breakpoints)).max(axis=1) > 1e-9
    stops = trajectory.breakpoints[~moving]
    assert len(stops) == problem.tube.segment_count + 1
    for begin, end in pairwise(stops):
        part = trajectory.between(begin, end)
        assert minimum_duration(problem.robot, part) == pytest.approx(end - begin, rel=1e-5)


def test_it_beats_the_conventional_scheme_of_the_paper(planned):
    problem, result = planned("two_link/around_a_post")
    assert result.duration < conventional_duration(problem.tube.points)


def test_the_same_problem_gives_the_same_numbers(planned):
    problem, result = planned("panda/between_shelves")
    again = stop_at_corners(problem, branch_of(problem))
    np.testing.assert_array_equal(again.coefficients, result.trajectory.coefficients)
