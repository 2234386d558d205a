import numpy as np
import pytest

from tubeplanner import JointTrajectory, PlanningProblem, Seed, Tube
from tubeplanner.branches.inverse_kinematics import solve_position
from tubeplanner.constraints.tube_membership import (
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


INSIDE = {
    "in order": ([[1, 0], [1, 1], [0, 1]], [False, True]),
    "switching time between samples": ([[1, 0], [0, 1]], [False, True]),
    "still in both": ([[1, 0], [1, 1]], [True, True]),
    "never in the first": ([[0, 1], [0, 1]], [False, True]),
    "outside for a moment": ([[1, 0], [0, 0], [0, 1]], [False, False]),
    "back again": ([[1, 0], [0, 1], [1, 0]], [False, False]),
}


def last_reached(inside, begin, passable=None, *, ordered=True):
    inside = np.array(inside, dtype=bool)
    passable = np.zeros(inside.shape[2], dtype=bool) if passable is None else passable
    return segments_reached(inside, begin, passable, ordered=ordered)[:, -1]


@pytest.mark.parametrize(("inside", "expected"), INSIDE.values(), ids=INSIDE)
def test_segments_are_reached_in_order(inside, expected):
    begin = np.array([[True, False]])
    assert last_reached([inside], begin).tolist() == [expected]


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
    after, left = before & now, before.copy()
    for k in range(1, now.shape[1]):
        after[:, k] |= now[:, k] & (left[:, k - 1] | after[:, k - 1])
        left[:, k] |= left[:, k - 1] & passable[k]
    return after


def test_no_segment_is_skipped_unless_the_sample_is_in_it():
    begin = np.array([[True, False, False]])
    jump = np.array([[[1, 0, 0], [0, 0, 1]]], dtype=bool)
    short = np.array([[[1, 0, 0], [0, 1, 1]]], dtype=bool)
    assert not last_reached(jump, begin).any()
    assert last_reached(short, begin)[0, 2]


def test_a_passable_segment_may_be_passed_between_samples():
    begin = np.array([[True, False, False, False]])
    jump = np.array([[[1, 0, 0, 0], [0, 0, 0, 1]]], dtype=bool)
    for passable, expected in ([0, 1, 1, 0], True), ([0, 1, 0, 0], False), ([0, 0, 1, 0], False):
        reached = last_reached(jump, begin, np.array(passable, dtype=bool))
        assert reached[0, 3] == expected


def test_short_segments_are_passable():
    points = np.array([[0, 0, 0], [0.5, 0, 0], [0.5, 0.01, 0], [0, 0.01, 0], [0, 0.4, 0]])
    assert passable_segments(Tube(points, 0.02)).tolist() == [False, True, False, False]
    many = np.column_stack([np.linspace(0, 1, 81), np.zeros(81), np.zeros(81)])
    assert passable_segments(Tube(many, 0.001)).all()


def test_in_a_union_any_segment_may_follow_any_other():
    begin = np.ones((1, 2), dtype=bool)
    back = np.array([[[1, 0], [0, 1], [1, 0]]], dtype=bool)
    out = np.array([[[1, 0], [0, 0], [1, 0]]], dtype=bool)
    assert last_reached(back, begin, ordered=False).tolist() == [[True, False]]
    assert not last_reached(out, begin, ordered=False).any()


def lines(two_link, q):
    """Return a trajectory along straight joint lines through configurations, one per second."""
    q = np.array(q)
    coefficients = np.stack([np.diff(q, axis=0), q[:-1]])
    return JointTrajectory(two_link.joint_names, np.arange(len(q)), coefficients)


def test_the_first_piece_that_leaves_the_tube_is_named(stored):
    problem, trajectory = stored("two_link/around_a_post")
    assert first_departure(problem, trajectory, 1e-6) is None
    bent = trajectory.coefficients.copy()
    bent[-1, 7, 0] += 0.3
    moved = JointTrajectory(problem.robot.joint_names, trajectory.breakpoints, bent)
    assert first_departure(problem, moved, 1e-6) == 7


def test_a_trajectory_must_arrive_in_the_last_segment(stored):
    problem, trajectory = stored("two_link/around_a_post")
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
    free = np.full(2, np.inf)
    q = [np.array([0.0, -1.0])]
    for y in (-0.25, -0.2, -0.15):
        target = np.array([0.4, y, 0])
        q.append(solve_position(two_link, target, q[-1], -free, free).q)
    back = lines(two_link, [*q[1:], *q[-2:0:-1]])
    assert first_departure(corner(two_link, visit="any"), back, 1e-6) is None
    assert first_departure(corner(two_link), back, 1e-6) == 3  # it never arrives


def test_the_margin_knows_the_rotation(stored):
    """The tool is well inside its capsule: how far it is turned decides."""
    problem, trajectory = stored("ur5/level_tray")
    q = trajectory.position(np.array([0.6, 0.6, 0.6]))
    q[1, 4] += 0.04
    q[2, 4] += 0.07
    rotation, tool = problem.robot.tool_pose(q)
    turned = problem.tube.rotation.margin(rotation, tool, 1)
    assert turned[1] > 0 > turned[2]
    assert (problem.tube.margin(tool)[1:, 1] > turned[1:]).all()
    np.testing.assert_allclose(membership_margin(problem, q)[1:, 1], turned[1:], atol=1e-12)


def test_the_first_piece_that_turns_the_tool_too_far_is_named(stored):
    problem, trajectory = stored("ur5/level_tray")
    assert first_departure(problem, trajectory, 1e-6) is None
    piece = len(trajectory.widths) // 2
    bent = trajectory.coefficients.copy()
    bent[-1, piece, 4] += 0.07
    moved = JointTrajectory(problem.robot.joint_names, trajectory.breakpoints, bent)
    assert first_departure(problem, moved, 1e-6) == piece
