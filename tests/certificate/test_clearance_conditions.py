"""Conditions on clearance from obstacles and between links, for all t."""

import numpy as np
import pytest
from cases import changed
from lifting_arm import CASES, HALF, LIFT, POST, RISE, Case, at_height, contacts, lifting

from tubeplanner import JointTrajectory, Obstacle, Tolerance, placement_of, verify
from tubeplanner.certificate.clearance_conditions import (
    AskedDistances,
    ClearanceMargin,
    clearance_margin,
    closest_approach,
)
from tubeplanner.certificate.judged_motion import JudgedMotion
from tubeplanner.certificate.verification import SEGMENT_MARGINS
from tubeplanner.geometry.collision_checker import CollisionChecker

# The closest approach of pairs: closed forms of an arm that passes a ball, and samples.


def random_trajectory(robot, seed, pieces=6):
    rng = np.random.default_rng(seed)
    breakpoints = np.concatenate([[0.0], np.cumsum(rng.uniform(0.05, 0.4, pieces))])
    coefficients = rng.normal(size=(4, pieces, robot.joint_count)) * [[[20]], [[8]], [[3]], [[1]]]
    return JointTrajectory(robot.joint_names, breakpoints, coefficients)


def distances(checker, q, pairs):
    """Return the distance of each pair in each configuration [m]."""
    poses = zip(*checker.robot.body_poses(np.atleast_2d(q)), strict=True)
    return np.array([checker.distances(*pose, pairs) for pose in poses])


def closest(checker, trajectory, links=False, asked=0.0):
    """Return the closest approach where the same is asked of all pairs at all times."""
    count = len(checker.obstacle_pairs)
    columns = count + np.arange(len(checker.link_pairs)) if links else np.arange(count)
    return closest_approach(
        checker, trajectory, columns, lambda begin, end, pair: np.full(len(pair), asked)
    )


def crossing(two_link, gap, when=0.5):
    """Return a checker and a trajectory in which the tool's link passes a ball at a distance."""
    ball = Obstacle.sphere("ball", 0.05, placement_of([0.75 + gap, 0, 0]))
    trajectory = JointTrajectory(two_link.joint_names, [0, 1.0], [[[1.0, 0]], [[-when, 0.0]]])
    return CollisionChecker(two_link, [ball], self_collision=False), trajectory


@pytest.mark.parametrize("when", [0.2, 0.425, 0.5, 0.65, 0.775])
def test_a_passage_is_bracketed_whenever_it_is(two_link, when):
    """The arm sweeps past the ball; it is nearest where a corner of its end points at it."""
    exact = 1.0 - np.linalg.norm([0.62, 0.02])
    nearest = closest(*crossing(two_link, 0.3, when))
    assert 0.979 * exact <= nearest.lower_bound <= exact + 1e-9
    assert exact - 1e-9 <= nearest.margin <= 1.021 * exact


def test_what_is_settled_at_once_still_counts(two_link):
    """Slowly 1 % nearer at the end of a piece; then far away and fast, which takes longer."""
    checker, _ = crossing(two_link, 0.3)
    pieces = [[[-0.01, 0], [4.0, 0]], [[0.3, 0], [1.0, 0]]]
    trajectory = JointTrajectory(two_link.joint_names, [0, 1.0, 2.0], pieces)
    least = distances(checker, [0.29, 0.0], checker.obstacle_pairs).min()
    nearest = closest(checker, trajectory)
    assert least < nearest.margin
    assert 0.979 * least <= nearest.lower_bound <= least + 1e-12


@pytest.mark.parametrize(
    ("name", "seed"), [("two_link", 1), ("slide", 0), ("slide", 2), ("ur5", 0)]
)
def test_the_bound_is_below_every_sample_and_close_to_the_least(name, seed, request):
    robot = request.getfixturevalue(name)
    block = Obstacle.box("block", [0.2, 0.2, 0.2], placement_of([0.6, 0.3 * seed - 0.4, 0.3]))
    checker, trajectory = CollisionChecker(robot, [block]), random_trajectory(robot, seed)
    for links, pairs in ((False, checker.obstacle_pairs), (True, checker.link_pairs)):
        nearest = closest(checker, trajectory, links)
        least = distances(checker, trajectory.per_piece(100).position, pairs).min()
        assert nearest.lower_bound <= least + 1e-12
        least = min(least, nearest.margin)  # samples may miss it
        assert nearest.lower_bound >= least - 0.03 * abs(least) - 1e-6
        there = distances(checker, trajectory.position([nearest.time]), np.array([nearest.pair]))
        assert there.item() == pytest.approx(nearest.margin, abs=1e-9)


def test_a_wide_gap_is_settled_with_few_intervals(two_link):
    """Two per cent of it are enough; near the required distance, it is resolved to less."""
    checker, trajectory = crossing(two_link, 0.3)
    wide = closest(checker, trajectory)
    near = closest(checker, trajectory, asked=wide.margin)
    assert near.intervals > 2 * wide.intervals
    assert near.margin - near.lower_bound <= 1e-6
    assert wide.margin - wide.lower_bound <= 0.021 * wide.margin
    assert wide.margin - wide.lower_bound > 1e-4


@pytest.mark.parametrize(
    "limits", [{"_MAX_INTERVALS": 1, "_MAX_ROUNDS": 1}, {"_MIN_INTERVAL": 0.2}]
)
def test_halving_ends_in_time(two_link, limits, monkeypatch):
    """The bounds then count as they stand."""
    whole = closest(*crossing(two_link, 0.1))
    for name, value in limits.items():
        monkeypatch.setattr(f"tubeplanner.certificate.clearance_conditions.{name}", value)
    early = closest(*crossing(two_link, 0.1))
    assert early.intervals < whole.intervals
    assert early.lower_bound < whole.lower_bound


def test_without_pairs_there_is_no_closest_approach(two_link):
    assert closest(CollisionChecker(two_link), random_trajectory(two_link, 0)) is None


# What pairs must keep along a trajectory: closed forms of a cube that is lifted, and samples.


def judged(folder, case):
    return verify(*lifting(folder, case)).conditions


def motion_of(folder, case):
    problem, trajectory = lifting(folder, case)
    return JudgedMotion(problem.joined, trajectory, Tolerance(), SEGMENT_MARGINS)


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_the_margin_and_the_place_are_those_of_the_closed_form(tmp_path, case):
    condition = judged(tmp_path, case)["obstacles"]
    assert condition.margin == pytest.approx(case.margin, abs=0.02 * abs(case.margin) + 1e-6)
    assert condition.where.links == ("hand",)
    assert condition.where.obstacle == "table"
    if case.time is not None:  # at rest, at a whole second, it is nearly as near for a while
        is_at_rest = case.time == round(case.time)
        assert condition.where.time == pytest.approx(case.time, abs=0.1 if is_at_rest else 0.002)


def rising(second, first=0.008):
    asked = {"clearance": {"segments": [first, second]}}
    return Case(RISE, [0, 1, 2], asked, 0.0, None, radius=0.03)


@pytest.mark.parametrize(("second", "passes"), [(0.019, True), (0.0213, True), (0.0217, False)])
def test_a_hand_over_is_where_both_segments_have_their_clearance(tmp_path, second, passes):
    """The first capsule ends 30 mm behind the middle: there the cube is 1.5 mm higher."""
    conditions = judged(tmp_path, rising(second))
    holds = all(conditions[name].margin >= -1e-6 for name in ("tube", "obstacles"))
    assert holds == passes


@pytest.mark.parametrize(("asked", "margin"), [(0.149, 0.001), (0.1501, -1e-4)])
def test_links_keep_a_pairs_own_clearance_from_each_other(tmp_path, asked, margin):
    pairs = [{"links": ["base", "hand"], "clearance": asked}]
    case = Case(RISE, [0, 1, 2], {"clearance": {"pairs": pairs}}, 0.0, None)
    conditions = judged(tmp_path, case)
    assert conditions["self_collision"].margin == pytest.approx(margin, rel=0.02, abs=1e-6)
    assert conditions["self_collision"].where.time == pytest.approx(0.0, abs=1e-3)
    assert conditions["obstacles"].margin == pytest.approx(0.01, rel=0.02)


BESIDE_POST = [{"links": ["base", "hand"], "clearance": 0.02}]


@pytest.mark.parametrize(("within", "margin"), [(0.03, 0.0), (0.015, -0.005)])
def test_links_may_be_in_contact_with_each_other(tmp_path, within, margin):
    """The cube begins at the post; where it is out of reach of the contact, it must be farther."""
    contact = {"links": ["hand", "base"], "within": within}
    asked = {"clearance": {"pairs": BESIDE_POST}, "contacts": [contact]}
    case = Case([(POST + HALF, 0.1), (0.0, 0.1)], [0, 1], asked, 0.0, None)
    condition = judged(tmp_path, case)["self_collision"]
    assert condition.margin == pytest.approx(margin, abs=1e-6 + 0.02 * abs(margin))


def test_a_contact_that_asks_nothing_less_changes_nothing(tmp_path):
    """Farther apart at the start than the clearance: that holds, also near the start."""
    case = Case([(0.0, 0.02), (0.0, 0.015), *LIFT[1:]], [0, 2, 3], contacts(), 0.0, None)
    assert judged(tmp_path, case)["obstacles"].margin == pytest.approx(0.005, rel=0.02)


def test_what_obstacles_lack_links_do_not(stored):
    problem, trajectory = stored("ur5/over_the_wall")
    plain = verify(problem, trajectory).conditions
    far = verify(changed(problem, clearance=0.3), trajectory).conditions
    assert far["obstacles"].margin < -0.1
    assert far["obstacles"].where.obstacle == "wall"
    assert far["self_collision"].margin == plain["self_collision"].margin > 0
    assert far["self_collision"].where.obstacle is None
    assert len(far["self_collision"].where.links) == 2


# The distances that are asked over intervals, and their margins at switching times.


def asked_over(motion, *intervals, other="table"):
    """Return what is asked over intervals of the cube and something else [m]."""
    begin, end = np.array(intervals, dtype=float).T
    columns = np.flatnonzero(motion.problem.collision.between("hand", other))
    return AskedDistances(motion).over(begin, end, np.repeat(columns, len(intervals)))


def test_over_an_interval_the_most_of_its_segments_is_asked(tmp_path):
    motion = motion_of(tmp_path, rising(0.0205))
    at = motion.visits[0].end
    assert 1.0 < at < 2.0
    found = asked_over(motion, (0, at - 1e-6), (0, at), (at, at), (0, 2), (at + 1e-6, 2))
    np.testing.assert_allclose(found, [0.008, 0.0205, 0.0205, 0.0205, 0.0205])
    motion = motion_of(tmp_path, rising(0.008, 0.0095))
    at = motion.visits[0].end
    np.testing.assert_allclose(asked_over(motion, (at, at + 0.1)), 0.0095)


def test_only_intervals_that_lie_within_the_ball_have_less_asked(tmp_path):
    motion, leaves = motion_of(tmp_path, CASES["a lift"]), at_height(0.03, 0.0, 0.2, 0.0)
    found = asked_over(
        motion, (0, 0), (0, leaves - 1e-6), (0.1, leaves + 1e-6), (leaves, 2), (2, 2)
    )
    np.testing.assert_allclose(found, [0, 0, 0.01, 0.01, 0.01], atol=1e-9)


def test_a_contact_is_of_its_own_pair(tmp_path):
    asked = contacts(within=0.5) | {"clearance": {"default": 0.01, "pairs": BESIDE_POST}}
    motion = motion_of(tmp_path, Case(LIFT, [0, 1, 2], asked, 0.0, None))
    for other, distance in (("table", 0.0), ("base", 0.02)):
        found = asked_over(motion, (0, 0.1), other=other)
        np.testing.assert_allclose(found, distance, atol=1e-9)


def test_margins_at_switching_times_are_those_of_the_segments(tmp_path):
    problem, trajectory = lifting(tmp_path, rising(0.0205))
    margin, time = clearance_margin(problem, trajectory), np.array([0.0, 0.7, 1.0, 2.0])
    gap = trajectory.position(time)[:, 1] - HALF
    every = gap[:, None] - [0.008, 0.0205]
    # Exact where less is left than some segment asks in addition; else a lower bound.
    found = margin.at(time)
    near = every[:, 1] < 0
    np.testing.assert_allclose(found[near], every[near], atol=1e-9)
    assert (found <= every + 1e-9).all()
    assert (found[~near] >= 0).all()
    segment = np.array([1, 0, 1, 1])
    each = margin.within(segment, time)
    np.testing.assert_allclose(each, found[np.arange(4), segment], atol=1e-12)


def test_margins_near_an_end_are_those_of_the_contact(tmp_path):
    problem, trajectory = lifting(tmp_path, CASES["too near when contact ends"])
    margin, leaves = ClearanceMargin(problem, trajectory), at_height(0.03, 0.0, 0.2, 0.0)
    time = np.array([0.0, leaves - 1e-5, leaves + 1e-5])
    gap = trajectory.position(time)[:, 1] - HALF
    expected = np.column_stack([gap - [0.0, 0.0, 0.04], gap - 0.04])
    np.testing.assert_allclose(margin.at(time), expected, atol=1e-9)
    assert clearance_margin(*lifting(tmp_path, CASES["one for all"])) is None
