import numpy as np
import pytest

from tubeplanner import JointTrajectory, PlanningProblem, Seed, Tube
from tubeplanner.tube_membership import first_departure, membership_margin, segments_reached

SEED = Seed(np.array([0.0, -1.0]))


def corner(two_link, **more):
    """A tube with a corner at (0.4, 0.1); the elbow's range differs on its two sides."""
    signs = [{"joint2": "-"}, {"joint2": (-2.5, -0.2)}]
    points = [[0.4, -0.3, 0], [0.4, 0.1, 0], [0.2, 0.1, 0]]
    tube = Tube(points, [0.02, 0.05], joint_signs=signs, **more)
    return PlanningProblem(two_link, tube, SEED)


def test_the_margin_is_the_least_of_hand_and_joints(two_link):
    problem = corner(two_link)
    q = np.array([[0.9, -1.5], [0.3, -0.25], [0.3, 0.1]])
    hand = two_link.tool_position(q)
    margin = membership_margin(problem, q)
    for i, (point, (_, elbow)) in enumerate(zip(hand, q, strict=True)):
        nearest = np.array([0.4, np.clip(point[1], -0.3, 0.1), 0])
        first = 0.02 - np.linalg.norm(point - nearest)
        assert margin[i, 0] == pytest.approx(min(first, -elbow, elbow + np.pi), abs=1e-12)
        nearest = np.array([np.clip(point[0], 0.2, 0.4), 0.1, 0])
        second = 0.05 - np.linalg.norm(point - nearest)
        assert margin[i, 1] == pytest.approx(min(second, -0.2 - elbow, elbow + 2.5), abs=1e-12)


INSIDE = {
    "in order": ([[1, 0], [1, 1], [0, 1]], [False, True]),
    "hand-over between samples": ([[1, 0], [0, 1]], [False, True]),
    "still in both": ([[1, 0], [1, 1]], [True, True]),
    "never in the first": ([[0, 1], [0, 1]], [False, True]),
    "outside for a moment": ([[1, 0], [0, 0], [0, 1]], [False, False]),
    "back again": ([[1, 0], [0, 1], [1, 0]], [False, False]),
}


@pytest.mark.parametrize(("inside", "expected"), INSIDE.values(), ids=INSIDE)
def test_segments_are_reached_in_order(inside, expected):
    begin = np.array([[True, False]])
    reached = segments_reached(np.array([inside], dtype=bool), begin, ordered=True)
    np.testing.assert_array_equal(reached, [expected])


def test_no_segment_is_skipped_unless_the_sample_is_in_it():
    begin = np.array([[True, False, False]])
    jump = np.array([[[1, 0, 0], [0, 0, 1]]], dtype=bool)
    short = np.array([[[1, 0, 0], [0, 1, 1]]], dtype=bool)
    assert not segments_reached(jump, begin, ordered=True).any()
    assert segments_reached(short, begin, ordered=True)[0, 2]


def test_in_a_union_any_segment_may_follow_any_other():
    begin = np.ones((1, 2), dtype=bool)
    back = np.array([[[1, 0], [0, 1], [1, 0]]], dtype=bool)
    out = np.array([[[1, 0], [0, 0], [1, 0]]], dtype=bool)
    np.testing.assert_array_equal(segments_reached(back, begin, ordered=False), [[True, False]])
    assert not segments_reached(out, begin, ordered=False).any()


def lines(two_link, q):
    """Return a motion along straight joint lines through configurations, one per second."""
    q = np.array(q)
    coefficients = np.stack([np.diff(q, axis=0), q[:-1]])
    return JointTrajectory(two_link.joint_names, np.arange(len(q)), coefficients)


def test_the_first_piece_that_leaves_the_tube_is_named(planned):
    problem, result = planned("two_link/around_a_post")
    assert first_departure(problem, result.trajectory, 1e-6) is None
    bent = result.trajectory.coefficients.copy()
    bent[-1, 7, 0] += 0.3
    moved = JointTrajectory(problem.robot.joint_names, result.trajectory.breakpoints, bent)
    assert first_departure(problem, moved, 1e-6) == 7


def test_a_motion_must_arrive_in_the_last_segment(planned):
    problem, result = planned("two_link/around_a_post")
    part = result.trajectory.between(0.0, result.duration / 2)
    assert first_departure(problem, part, 1e-6) == len(part.widths) - 1


def test_a_departure_between_samples_is_seen(two_link):
    """A parabola of the elbow whose peak breaks its range by 1e-5 rad, between two samples."""
    tube = Tube([[0.4, -0.3, 0], [0.4, 0.3, 0]], 1.0, joint_signs={"joint2": "-"})
    problem = PlanningProblem(two_link, tube, SEED)
    peak = 0.5 + 0.5 / 64
    for height, expected in ((1e-5, 0), (-1e-5, None)):
        elbow = [-1.0, 2 * peak, height - peak**2]  # height - (t - peak)^2
        coefficients = np.array([[0.0, 0.0, 0.3], elbow]).T[:, None]
        motion = JointTrajectory(two_link.joint_names, [0, 1], coefficients)
        assert (motion.per_piece(65).position[:, 1] < 0).all()
        assert first_departure(problem, motion, 1e-7) == expected


def test_a_union_may_be_visited_backwards(two_link):
    problem = corner(two_link, visit="any")
    forwards = [[0.9, -1.5], [1.15, -1.75]]
    ordered = corner(two_link)
    margin = membership_margin(problem, np.array(forwards))
    back = lines(two_link, [*forwards, forwards[0]])
    assert (first_departure(problem, back, 1e-6) is None) == bool(margin.max(axis=1).min() > 0)
    assert first_departure(ordered, back, 1e-6) is not None
