import numpy as np
import pytest

from tubeplanner import JointTrajectory, Obstacle, placement_of
from tubeplanner.collision.collision_checker import CollisionChecker
from tubeplanner.verification.closest_approach import closest_approach


def random_trajectory(robot, seed, pieces=6):
    rng = np.random.default_rng(seed)
    breakpoints = np.concatenate([[0.0], np.cumsum(rng.uniform(0.05, 0.4, pieces))])
    coefficients = rng.normal(size=(4, pieces, robot.joint_count)) * [[[20]], [[8]], [[3]], [[1]]]
    return JointTrajectory(robot.joint_names, breakpoints, coefficients)


def sampled(checker, trajectory, pairs, count=600):
    q = trajectory.per_piece(count // len(trajectory.widths)).position
    rotation, position = checker.robot.body_poses(q)
    return min(
        checker.distances(rotation[i], position[i], pairs).min() for i in range(len(rotation))
    )


def closest(checker, trajectory, pairs, asked=0.0):
    """Return the closest approach where the same is asked of all pairs at all times."""
    first = 0 if pairs is checker.obstacle_pairs else len(checker.obstacle_pairs)

    def of_all(begin, end, pair):
        return np.full(len(pair), asked)

    columns = first + np.arange(len(pairs))
    return closest_approach(checker, trajectory, columns, of_all)


END = 0.62, 0.02  # corner of the stretched arm's end [m]


def crossing(two_link, gap, when=0.5):
    """Return a checker and a trajectory in which the tool's link passes a ball at a distance."""
    ball = Obstacle.sphere("ball", 0.05, placement_of([0.75 + gap, 0, 0]))
    trajectory = JointTrajectory(two_link.joint_names, [0, 1.0], [[[1.0, 0]], [[-when, 0.0]]])
    return CollisionChecker(two_link, [ball], self_collision=False), trajectory


@pytest.mark.parametrize("when", np.linspace(0.2, 0.8, 25).round(3))
def test_a_passage_is_bracketed_whenever_it_is(two_link, when):
    """The arm sweeps past the ball; it is nearest where a corner of its end points at it."""
    checker, trajectory = crossing(two_link, 0.3, when)
    exact = 1.0 - np.linalg.norm(END)
    nearest = closest(checker, trajectory, checker.obstacle_pairs, 0.0)
    assert 0.979 * exact <= nearest.lower_bound <= exact + 1e-9
    assert exact - 1e-9 <= nearest.margin <= 1.021 * exact


def test_what_is_settled_at_once_still_counts(two_link):
    """Slowly 1 % nearer at the end of a piece; then far away and fast, which takes longer."""
    checker, _ = crossing(two_link, 0.3)
    pieces = [[[-0.01, 0], [4.0, 0]], [[0.3, 0], [1.0, 0]]]
    trajectory = JointTrajectory(two_link.joint_names, [0, 1.0, 2.0], pieces)
    rotation, position = two_link.body_poses(np.array([[0.29, 0.0]]))
    least = checker.distances(rotation[0], position[0], checker.obstacle_pairs).min()
    nearest = closest(checker, trajectory, checker.obstacle_pairs, 0.0)
    assert least < nearest.margin
    assert 0.979 * least <= nearest.lower_bound <= least + 1e-12


CASES = [(name, seed) for name in ("two_link", "slide") for seed in range(4)]


@pytest.mark.parametrize(("name", "seed"), [*CASES, ("ur5", 0), ("ur5", 2)])
def test_the_bound_is_below_every_sample_and_close_to_the_least(name, seed, request):
    robot = request.getfixturevalue(name)
    block = Obstacle.box("block", [0.2, 0.2, 0.2], placement_of([0.6, 0.3 * seed - 0.4, 0.3]))
    checker = CollisionChecker(robot, [block])
    trajectory = random_trajectory(robot, seed)
    for pairs in (checker.obstacle_pairs, checker.link_pairs):
        nearest = closest(checker, trajectory, pairs, 0.0)
        least = sampled(checker, trajectory, pairs)
        assert nearest.lower_bound <= least + 1e-12
        least = min(least, nearest.margin)  # samples may miss it
        assert nearest.lower_bound >= least - 0.03 * abs(least) - 1e-6


def test_the_time_and_the_pair_are_those_of_the_distance(ur5):
    checker = CollisionChecker(ur5)
    trajectory = random_trajectory(ur5, 9)
    nearest = closest(checker, trajectory, checker.link_pairs, 0.0)
    rotation, position = ur5.body_poses(trajectory.position([nearest.time]))
    distance = checker.distances(rotation[0], position[0], np.array([nearest.pair]))
    assert distance[0] == pytest.approx(nearest.margin, abs=1e-9)


def test_a_thin_plate_passed_in_a_moment_is_seen(two_link):
    """The arm sweeps through a 0.2 mm plate in about a millisecond of a one-second trajectory."""
    plate = Obstacle.box("plate", [0.1, 2e-4, 0.2], placement_of([0.55, 0, 0]))
    checker = CollisionChecker(two_link, [plate], self_collision=False)
    sweep = [[[3.0, 0.0]], [[-1.5, 0.0]]]
    trajectory = JointTrajectory(two_link.joint_names, [0, 1.0], sweep)
    nearest = closest(checker, trajectory, checker.obstacle_pairs, 0.0)
    assert nearest.lower_bound < 0
    assert nearest.time == pytest.approx(0.5, abs=0.04)


def test_without_pairs_there_is_no_closest_approach(two_link):
    checker = CollisionChecker(two_link)
    assert closest(checker, random_trajectory(two_link, 0), checker.obstacle_pairs, 0) is None


def test_a_wide_gap_is_settled_with_few_intervals(two_link):
    """Two per cent of it are enough; near the required distance, it is resolved to less."""
    checker, trajectory = crossing(two_link, 0.3)
    wide = closest(checker, trajectory, checker.obstacle_pairs, 0.0)
    near = closest(checker, trajectory, checker.obstacle_pairs, wide.margin)
    assert near.intervals > 2 * wide.intervals
    assert near.margin - near.lower_bound <= 1e-6
    assert wide.margin - wide.lower_bound <= 0.021 * wide.margin
    assert wide.margin - wide.lower_bound > 1e-4


def test_halving_ends_when_there_are_too_many_intervals(two_link, monkeypatch):
    """The bounds then count as they stand."""
    checker, trajectory = crossing(two_link, 0.1)
    whole = closest(checker, trajectory, checker.obstacle_pairs, 0.0)
    monkeypatch.setattr("tubeplanner.verification.closest_approach._MAX_INTERVALS", 1)
    monkeypatch.setattr("tubeplanner.verification.closest_approach._MAX_ROUNDS", 1)
    early = closest(checker, trajectory, checker.obstacle_pairs, 0.0)
    assert early.intervals < whole.intervals
    assert early.lower_bound < whole.lower_bound


def test_halving_ends_at_the_shortest_interval(two_link, monkeypatch):
    checker, trajectory = crossing(two_link, 0.1)
    whole = closest(checker, trajectory, checker.obstacle_pairs, 0.0)
    monkeypatch.setattr("tubeplanner.verification.closest_approach._MIN_INTERVAL", 0.2)
    early = closest(checker, trajectory, checker.obstacle_pairs, 0.0)
    assert early.intervals < whole.intervals
    assert early.lower_bound < whole.lower_bound
