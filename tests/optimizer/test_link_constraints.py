"""Clearance constraints at samples of small distance."""

from dataclasses import replace

import numpy as np
import pytest
from cases import begun

from tubeplanner import (
    AttachedSolid,
    Contact,
    Obstacle,
    PlanningProblem,
    Seed,
    Tube,
    placement_of,
)
from tubeplanner.geometry.collision_checker import CollisionChecker
from tubeplanner.geometry.convex_shapes import box
from tubeplanner.optimizer.link_constraints import (
    CORNERS,
    DistancesAlong,
    LinkConstraints,
    of_corners,
)
from tubeplanner.optimizer.phased_spline import PhasedSpline, Samples
from tubeplanner.optimizer.stages import Refinement
from tubeplanner.optimizer.starts import knot_grid
from tubeplanner.task.required_distances import RequiredDistances

TOP = 0.02


@pytest.fixture
def part(ur5):
    """A part that the tool carries, 1 mm above a table, tilted by so much: checker, q, poses."""

    def make(tilt):
        q = np.array([[-0.79, -1.31, 1.9, -2.159, -1.5708 + tilt, 0.0]])
        rotation, tool = ur5.tool_pose(q)
        block = box([0.06, 0.06, 0.1]).transformed(placement_of([0, 0, 0.05]))
        solid = AttachedSolid("part", (block,), ("wrist_3_link",))
        lowest = (block.vertices @ rotation[0].T + tool[0])[:, 2].min()
        height = lowest - 0.001 - TOP
        table = Obstacle.box("table", [2, 2, 2 * TOP], placement_of([0.5, 0, height]))
        checker = CollisionChecker(ur5, [table], attached=[solid], self_collision=False)
        pair = checker.pairs[checker.between("part", "table")]
        return checker, np.repeat(q, CORNERS + 1, axis=0), np.repeat(pair, CORNERS + 1, axis=0)

    return make


def measured(checker, q, pairs, numbers=range(-1, CORNERS)):
    """Return the closest points of a pair, and the corners with these numbers; -1: none."""
    poses = checker.robot.body_poses(q)
    closest = checker.closest_points(*poses, pairs)
    return closest, of_corners(checker, poses, pairs, closest, np.array(numbers))


def test_all_corners_of_a_face_are_found(part):
    """Those far from the face do not count; a pair may have none."""
    checker, q, pairs = part(0.01)
    closest, corners = measured(checker, q, pairs)
    lengths = 0.06 * 0.01
    assert corners.distance[0] == closest.distance[0] == pytest.approx(0.001, abs=1e-9)
    expected = 0.001 + np.array([0, 0, lengths, lengths])
    np.testing.assert_allclose(np.sort(corners.distance[1:]), expected, atol=2e-4)
    upper, lower = corners.first[1:, 2], corners.second[1:, 2]
    np.testing.assert_allclose(abs(upper - lower), corners.distance[1:], atol=1e-9)
    assert len(np.unique(corners.first[1:, :2].round(6), axis=0)) == CORNERS
    _, same = measured(checker, q, pairs, [-1] * (CORNERS + 1))
    np.testing.assert_array_equal(same.distance, closest.distance)
    np.testing.assert_array_equal(same.direction, closest.direction)
    closest, corners = measured(*part(0.3))
    assert corners.distance.max() < closest.distance[0] + 0.005
    assert (corners.distance < 0.002).all()  # the others are 18 mm farther


def test_their_gradients_are_those_of_the_corners(part):
    checker, q, pairs = part(0.01)
    _, corners = measured(checker, q, pairs)
    exact = checker.distance_gradient(*checker.robot.body_poses(q), pairs, corners)[1:]
    for joint, step in enumerate(1e-6 * np.eye(q.shape[1])):
        after, before = (measured(checker, q + s * step, pairs)[1].distance for s in (1, -1))
        np.testing.assert_allclose(exact[:, joint], (after - before)[1:] / 2e-6, atol=1e-4)


# What is required along a spline: at hand-overs of both segments, near the ends less.

START, GOAL = np.array([0.2, 0.3]), np.array([0.9, 0.5])
NAMES = ("ball", "link2")


@pytest.fixture
def problem(two_link):
    def make(clearances=None, segments=2, **others):
        ways = np.linspace(0, 1, segments + 1)[:, None]
        tool = two_link.tool_position(START + ways * (GOAL - START))
        ball = Obstacle.sphere("ball", 0.05, placement_of([0.0, 2.2, 0.0]))
        tube = Tube(tool, 0.3, clearance=clearances)
        return PlanningProblem(two_link, tube, START, GOAL, obstacles=[ball], **others)

    return make


def along(problem):
    return DistancesAlong(problem, np.array([START, GOAL]), 0.0)


def column_of(problem):
    return problem.collision.between(*NAMES).argmax()


def in_the_middle(count):
    """Return samples in the middle of an interval."""
    return Samples(np.zeros(count, int), np.full(count, 0.5), np.ones(count, int))


GRID = knot_grid(np.array([0.0, 0.5, 1.0]), 8)
PIECES = GRID.interval_count


def test_at_a_hand_over_both_segments_ask(problem):
    made = problem([0.01, 0.02])
    samples = Samples(
        np.array([0, 0, 0, 1, 1, 1]),
        np.array([0.0, 0.5, 1.0, 0.0, 0.5, 1.0]),
        np.array([0, 1, PIECES // 2 - 1, PIECES // 2, PIECES - 2, PIECES - 1]),
    )
    required = along(made).at(GRID, samples, np.tile(START, (6, 1)))[:, column_of(made)]
    np.testing.assert_allclose(required, [0.01, 0.01, 0.02, 0.02, 0.02, 0.02])


def test_more_is_required_than_the_judge_asks_and_all_of_it_before_the_distance_ends(problem):
    made = problem(clearance=3.0, contacts=[Contact(NAMES, 0.2, "start")])
    column, q = column_of(made), START + np.linspace(0, 1, 60)[:, None] * [0.2, 0.0]
    tool = made.robot.tool_position(q)
    judged = RequiredDistances(made, START, GOAL).at(np.zeros(60, int), tool)[:, column]
    required = along(made).at(GRID, in_the_middle(60), q)[:, column]
    away = np.linalg.norm(tool - tool[0], axis=1)
    assert (judged[away < 0.2] < 3.0).all()
    assert (judged[away > 0.2] == 3.0).all()
    assert (required >= judged - 1e-12).all()
    assert required[0] == pytest.approx(judged[0])
    assert (np.diff(required) >= 0).all()
    assert (required[away > 0.19] == 3.0).all()
    assert required[away < 0.1].max() < (judged[0] + 3.0) / 2


def test_where_the_same_is_asked_throughout_nothing_changes_with_the_joints(problem):
    made, q = problem(clearance=0.01), np.tile(START, (3, 1))
    required, change = along(made).of_pairs(GRID, in_the_middle(3), q, np.arange(3))
    np.testing.assert_array_equal(change, 0.0)
    np.testing.assert_array_equal(required, RequiredDistances(made, START, GOAL).by_segment[0, :3])


def test_what_changes_with_the_joints_is_what_is_required(problem):
    """Of both ends of one segment the one counts that requires less."""
    contacts = [Contact(NAMES, 0.9, ("start", "goal"))]
    made = problem(segments=1, clearance=3.0, contacts=contacts)
    grid, column = knot_grid(np.array([0.0, 1.0]), 8), column_of(made)
    q = START + np.linspace(0.02, 0.98, 25)[:, None] * (GOAL - START)

    def required(x):
        return along(made).of_pairs(grid, in_the_middle(25), x, np.full(25, column))

    distance, change = required(q)
    np.testing.assert_allclose(distance, along(made).at(grid, in_the_middle(25), q)[:, column])
    for joint, step in enumerate(1e-6 * np.eye(2)):
        slope = (required(q + step)[0] - required(q - step)[0]) / 2e-6
        np.testing.assert_allclose(change[:, joint], slope, atol=1e-5)


def problem_with(two_link, *obstacles, **more):
    tube = Tube([[0.3, -0.3, 0], [0.3, 0.3, 0]], 0.08, joint_signs={"joint2": "-"})
    return PlanningProblem(two_link, tube, Seed(np.array([0.0, -1.0])), obstacles=obstacles, **more)


POST = Obstacle.cylinder("post", 0.03, 0.5, placement_of([0.46, 0.0, 0.0]))


def test_what_was_far_off_at_the_last_look_is_seen_once_it_comes_near(two_link):
    """A second look finds what a first one would, however the spline has moved in between."""
    problem = problem_with(two_link, POST)
    far = begun(problem, 12)
    bent = far.control_points.copy()
    bent[3:-3, 1] *= 0.4
    near = PhasedSpline(far.grid, far.switching_times, bent)
    used, fresh = LinkConstraints(problem), LinkConstraints(problem)
    assert not used.add_samples(far)
    assert used.add_samples(near)
    assert fresh.add_samples(near)
    distances = [links.at(near).closest.distance.min() for links in (used, fresh)]
    assert distances[0] == pytest.approx(distances[1], abs=1e-12)
    assert distances[0] < -0.005


@pytest.mark.dear("refines the motion of seven joints between meshes")
def test_links_that_pass_between_coarse_samples_are_given_up_on_the_finest(bundled):
    """A thin plate across the tube is jumped over where there is no sample."""
    problem = bundled("panda/between_shelves")
    plate = Obstacle.box("plate", [0.08, 0.2, 0.02], placement_of([0.38, 0, 0.6]))
    problem = replace(problem, obstacles=[*problem.obstacles, plate])
    start = begun(problem, 18)
    refinement = Refinement(problem, start, (4,))
    refinement.run()
    assert refinement.gave_up
    # Not for what it looked like on coarse knots.
    assert refinement.spline.grid.interval_count == 4 * start.grid.interval_count


def test_room_beyond_what_is_asked_is_kept_from_obstacles(two_link):
    """As if the clearance were larger by it, between links and obstacles."""
    clearance, slack = 0.01, 0.015
    problem = problem_with(two_link, POST, clearance=clearance)
    spline = begun(problem, 12)
    samples = spline.grid.samples_at(spline.switching_times, np.linspace(0.2, 0.8, 7))

    def slacks_of(problem, slack=0.0):
        links = LinkConstraints(problem, slack)
        links.set_samples(spline, samples)
        return np.sort(links.at(spline).slack(1.0, 1.0))

    with_room, less = slacks_of(problem, slack), slacks_of(problem)
    np.testing.assert_array_equal(
        with_room, slacks_of(replace(problem, clearance=clearance + slack))
    )
    assert len(less) == 0 or less[0] > with_room[0]
