import numpy as np
import pytest

from tubeplanner import JointTrajectory, PlanningProblem, Seed, Tube
from tubeplanner.first_guess.inverse_kinematics import solve_position
from tubeplanner.limits.tube_membership import (
    first_departure,
    may_pass_points,
    membership_margin,
    passable_segments,
    segments_reached,
)

SEED = Seed(np.array([0.0, -1.0]))


def corner(two_link, **more):
    """A tube with a corner at (0.4, 0.1); the elbow's range differs on its two sides."""
    signs = [{"joint2": "-"}, {"joint2": (-2.5, -0.2)}]
    points = [[0.4, -0.3, 0], [0.4, 0.1, 0], [0.2, 0.1, 0]]
    tube = Tube(points, [0.02, 0.05], joint_signs=signs, **more)
    return PlanningProblem(two_link, tube, SEED)


def test_the_margin_is_the_least_of_tool_and_joints(two_link):
    problem = corner(two_link)
    q = np.array([[0.9, -1.5], [0.3, -0.25], [0.3, 0.1]])
    tool = two_link.tool_position(q)
    margin = membership_margin(problem, q)
    for i, (point, (_, elbow)) in enumerate(zip(tool, q, strict=True)):
        nearest = np.array([0.4, np.clip(point[1], -0.3, 0.1), 0])
        first = 0.02 - np.linalg.norm(point - nearest)
        assert margin[i, 0] == pytest.approx(min(first, -elbow, elbow + np.pi), abs=1e-12)
        nearest = np.array([np.clip(point[0], 0.2, 0.4), 0.1, 0])
        second = 0.05 - np.linalg.norm(point - nearest)
        assert margin[i, 1] == pytest.approx(min(second, -0.2 - elbow, elbow + 2.5), abs=1e-12)


def last_reached(inside, begin, passable=None, *, ordered=True):
    inside = np.array(inside, dtype=bool)
    passable = np.zeros(inside.shape[2]) if passable is None else np.array(passable)
    return segments_reached(inside, begin, passable.astype(bool), ordered=ordered)[:, -1]


@pytest.mark.parametrize(
    ("inside", "fields", "expected"),
    [
        ([[1, 0], [1, 1], [0, 1]], {}, [False, True]),
        ([[1, 0], [0, 1]], {}, [False, True]),  # the switching time is between samples
        ([[0, 1], [0, 1]], {}, [False, True]),  # never in the first
        ([[1, 0], [0, 1], [1, 0]], {}, [False, False]),  # back again
        # No segment is skipped unless the sample is in it.
        ([[1, 0, 0], [0, 1, 1]], {}, [False, True, True]),
        # A passable one may be passed between samples.
        ([[1, 0, 0, 0], [0, 0, 0, 1]], {"passable": [0, 1, 1, 0]}, [False, False, False, True]),
        ([[1, 0, 0, 0], [0, 0, 0, 1]], {"passable": [0, 0, 1, 0]}, [False] * 4),
        # In a union any may follow any other.
        ([[1, 0], [0, 1], [1, 0]], {"ordered": False}, [True, False]),
        ([[1, 0], [0, 0], [1, 0]], {"ordered": False}, [False, False]),
    ],
)
def test_segments_are_reached_in_order(inside, fields, expected):
    is_union = not fields.get("ordered", True)
    begin = np.array([[True, *[is_union] * (len(expected) - 1)]])
    assert last_reached([inside], begin, **fields).tolist() == [expected]


@pytest.mark.parametrize(("offset", "passes"), [(0.0, True), (0.019, True), (0.025, False)])
def test_a_trajectory_that_stays_away_from_a_compulsory_point_is_seen(two_link, offset, passes):
    """The tool rises past the point (0.4, 0.1) at a distance."""
    problem = corner(two_link, pass_through_points="all")
    q = np.array([SEED.joints])
    for y in np.linspace(-0.3, 0.3, 41):
        place = np.array([0.4 - offset, y, 0])
        lower, upper = two_link.limits.lower_position, two_link.limits.upper_position
        q = np.vstack([q, solve_position(two_link, place, q[-1], lower, upper).q])
    rows = [np.diff(q[1:], axis=0), q[1:-1]]
    trajectory = JointTrajectory(two_link.joint_names, np.arange(41), rows)
    assert may_pass_points(problem, trajectory) == passes
    assert may_pass_points(corner(two_link), trajectory)  # nothing is compulsory at 90 degrees


def test_many_segments_follow_one_another_as_step_by_step():
    rng = np.random.default_rng(0)
    for _ in range(300):
        m = int(rng.integers(1, 9))
        inside = rng.random((3, 4, m)) < rng.random()
        begin, passable = rng.random((3, m)) < 0.4, rng.random(m) < 0.5
        reached = begin
        for s in range(inside.shape[1]):
            reached = one_step(reached, inside[:, s], passable)
        np.testing.assert_array_equal(last_reached(inside, begin, passable), reached)


def one_step(before, now, passable):
    """Return the segments after one sample more: entered, or passed whole, one by one."""
    after, passed = before & now, before.copy()
    for k in range(1, now.shape[1]):
        after[:, k] |= now[:, k] & (passed[:, k - 1] | after[:, k - 1])
        passed[:, k] |= passed[:, k - 1] & passable[k]
    return after


def test_short_segments_are_passable():
    points = np.array([[0, 0, 0], [0.5, 0, 0], [0.5, 0.01, 0], [0, 0.01, 0], [0, 0.4, 0]])
    assert passable_segments(Tube(points, 0.02)).tolist() == [False, True, False, False]
    many = np.column_stack([np.linspace(0, 1, 81), np.zeros(81), np.zeros(81)])
    assert passable_segments(Tube(many, 0.001)).all()


@pytest.mark.parametrize(
    ("name", "piece", "joint", "moved"),
    [("two_link/around_a_post", 7, 0, 0.3), ("ur5/level_tray", 40, 4, 0.07)],
)
def test_the_first_piece_that_leaves_the_tube_or_turns_too_far_is_named(
    name, piece, joint, moved, stored
):
    """The trajectory must arrive in the last segment, too."""
    problem, trajectory = stored(name)
    assert first_departure(problem, trajectory, 1e-6) is None
    bent = trajectory.coefficients.copy()
    bent[-1, piece, joint] += moved
    bent = JointTrajectory(problem.robot.joint_names, trajectory.breakpoints, bent)
    assert first_departure(problem, bent, 1e-6) == piece
    part = trajectory.between(0.0, trajectory.duration / 2)
    assert first_departure(problem, part, 1e-6) == len(part.widths) - 1


def test_a_departure_between_samples_is_seen(two_link):
    """A parabola of the elbow whose peak breaks its range by 1e-5 rad, between two samples."""
    tube = Tube([[0.4, -0.3, 0], [0.4, 0.3, 0]], 1.0, joint_signs={"joint2": "-"})
    problem = PlanningProblem(two_link, tube, SEED)
    peak = 0.5 + 0.5 / 64
    for height, expected in ((1e-5, 0), (-1e-5, None)):
        elbow = [-1.0, 2 * peak, height - peak**2]  # height - (t - peak)^2
        coefficients = np.array([[0.0, 0.0, 0.3], elbow]).T[:, None]
        trajectory = JointTrajectory(two_link.joint_names, [0, 1], coefficients)
        assert (trajectory.per_piece(65).position[:, 1] < 0).all()
        assert first_departure(problem, trajectory, 1e-7) == expected


def test_a_union_may_be_visited_backwards(two_link):
    """Along straight joint lines through configurations, one per second."""
    free = np.full(2, np.inf)
    q = [np.array([0.0, -1.0])]
    for y in (-0.25, -0.2, -0.15):
        q.append(solve_position(two_link, np.array([0.4, y, 0]), q[-1], -free, free).q)
    back = np.array([*q[1:], *q[-2:0:-1]])
    coefficients = np.stack([np.diff(back, axis=0), back[:-1]])
    trajectory = JointTrajectory(two_link.joint_names, np.arange(len(back)), coefficients)
    assert first_departure(corner(two_link, visit="any"), trajectory, 1e-6) is None
    assert first_departure(corner(two_link), trajectory, 1e-6) == 3  # it never arrives


def test_the_margin_knows_the_rotation(stored):
    """The tool is well inside its capsule: how far it is turned decides."""
    problem, trajectory = stored("ur5/level_tray")
    q = trajectory.position(np.array([0.6, 0.6, 0.6]))
    q[1, 4] += 0.04
    q[2, 4] += 0.07
    rotation, tool = problem.robot.tool_pose(q)
    margin = problem.tube.rotation.margin(rotation, tool, 1)
    assert margin[1] > 0 > margin[2]
    assert (problem.tube.margin(tool)[1:, 1] > margin[1:]).all()
    np.testing.assert_allclose(membership_margin(problem, q)[1:, 1], margin[1:], atol=1e-12)
