"""How much speed is left: against trajectories that use all of a limit, and slower ones."""

import numpy as np
import pytest

from cases import SHORTEST, anywhere
from tubeplanner import JointTrajectory, LimitOverrides, load_problem, load_robot, plan
from tubeplanner.constraints.unused_speed import unused_speed

NAMES = ("joint1", "joint2")


@pytest.fixture(scope="module")
def fastest():
    problem = load_problem("example:two_link/paper_1_30mm")  # without gravity
    return problem, plan(problem, SHORTEST).trajectory


def test_the_fastest_trajectory_leaves_hardly_any(fastest):
    problem, trajectory = fastest
    assert 0 <= unused_speed(problem, trajectory) < 0.01


@pytest.mark.parametrize("slower", [1.5, 3.0])
def test_a_slower_one_leaves_what_it_is_slower(fastest, slower):
    """Without gravity every limit scales alike: b(t) is so many times larger everywhere."""
    problem, trajectory = fastest
    unused = unused_speed(problem, trajectory)
    expected = 1 - (1 - unused) / slower
    found = unused_speed(problem, trajectory.scaled(slower))
    assert found == pytest.approx(expected, abs=0.003)


@pytest.mark.parametrize("slower", [1.0, 2.0, 4.0])
def test_a_limit_of_jerk_counts(slower):
    """Jerk at its limit all the time, forth and back; run n times as long, 1/n^3 of it."""
    jerk = 600.0
    limits = LimitOverrides(
        velocity=dict.fromkeys(NAMES, 1e6), effort=dict.fromkeys(NAMES, 1e9), jerk={NAMES[0]: jerk}
    )
    robot = load_robot("example:two_link", "hand", gravity=(0, 0, 0), limits=limits)
    width, state, pieces = 0.05, np.zeros(3), []
    for sign in (1, -1, -1, 1):
        pieces.append([sign * jerk / 6, state[2] / 2, state[1], state[0]])
        powers = width ** np.arange(4)
        q, v, a = state
        state = np.array(
            [
                q + v * width + a * powers[2] / 2 + sign * jerk * powers[3] / 6,
                v + a * width + sign * jerk * powers[2] / 2,
                a + sign * jerk * width,
            ]
        )
    coefficients = np.zeros((4, 4, 2))
    coefficients[:, :, 0] = np.array(pieces).T
    trajectory = JointTrajectory(NAMES, width * np.arange(5), coefficients).scaled(slower)
    assert unused_speed(anywhere(robot), trajectory) == pytest.approx(1 - 1 / slower, abs=1e-6)
