"""Excursions of executed motions from the tube; executed clearances."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from cases import anywhere, changed, followed, one_joint
from lifting_arm import CASES, HALF, lifting
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation
from stored_trajectories import REFINEMENT

from tubeplanner import (
    Obstacle,
    PlanningProblem,
    Seed,
    Tube,
    load_robot,
    placement_of,
    verify,
)
from tubeplanner.certificate.verification import judged_visits
from tubeplanner.execution.excursions import (
    additional_distances,
    least_clearances,
    obstacle_distances,
    tube_excursions,
    tube_margins,
)
from tubeplanner.execution.run_verdict import judged_runs
from tubeplanner.limits.tube_membership import current_segments

CORNER = [[0.1, 0.0, 0.0], [0.4, 0.0, 0.0], [0.4, 0.3, 0.0]]
BACK = [[0.4, -0.2, 0.0], [0.4, 0.2, 0.0], [0.4, -0.2, 0.0]]


def two_link(points, radius=0.05, **tube):
    robot = load_robot("example:two_link", "hand")
    return PlanningProblem(robot, Tube(points, radius, **tube), Seed(np.array([0.0, -1.0])))


def excursions(problem, tool, q=(0.0, -1.0), angles=0.0):
    count = len(tool)
    joints = np.broadcast_to(np.array(q, dtype=float), (count, 2))
    turned = Rotation.from_rotvec(np.outer(np.full(count, angles), [0, 0, 1])).as_matrix()
    return tube_excursions(problem, np.arange(count) / 10, joints, turned, np.array(tool))


@pytest.mark.parametrize("name", ["two_link/around_a_post", "ur5/level_tray"])
def test_of_the_plan_itself_they_are_the_certificates_margins(name, stored):
    problem, motion = stored(name, REFINEMENT)
    time = np.linspace(0.0, motion.duration, 2000)
    q = motion.position(time)
    found = tube_excursions(problem, time, q, *problem.robot.tool_pose(q))
    judged = verify(problem, motion).conditions
    assert found.tube.value == pytest.approx(-judged["tube"].margin, abs=3e-5)
    if judged["rotation"].margin is None:
        assert found.rotation is None
    else:
        assert found.rotation.value == pytest.approx(-judged["rotation"].margin, abs=3e-4)
    assert (found.points is None) == (len(problem.tube.compulsory_points) == 0)


TOOL = [[0.1, 0, 0], [0.2, 0, 0.08], [0.4, 0, 0], [0.4, 0.2, 0.06], [0.4, 0.3, 0]]


def test_the_farthest_out_counts_and_when_and_where():
    found = excursions(two_link(CORNER), TOOL).tube
    assert found.value == pytest.approx(0.03)
    assert (found.location.time, found.location.segment) == (0.1, 0)
    found = excursions(two_link(CORNER), [*TOOL[2:], [0.4, 0.3, 0.07]]).tube
    assert found.value == pytest.approx(0.02)
    assert (found.location.time, found.location.segment) == (pytest.approx(0.3), 1)
    ended = excursions(two_link(CORNER), [[0.1, 0, 0], [0.3, 0, 0]])  # before the last segment
    assert ended.tube.value == pytest.approx(0.05)


def test_every_segment_has_its_own_worst_while_it_is_current():
    found = excursions(two_link(CORNER), TOOL)
    np.testing.assert_allclose(found.tube_by_segment, [0.03, 0.01], atol=1e-12)
    assert found.rotation is None
    assert found.rotation_by_segment.tolist() == [-1e3, -1e3]
    bounded = two_link(CORNER, orientations=[[0, 0, 0, 1]] * 3, rotation_tolerance=[0.1, 0.2])
    turned = excursions(bounded, TOOL, angles=[0.0, -0.13, 0.02, 0.15, 0.1])
    assert turned.rotation.value == pytest.approx(0.03)
    assert (turned.rotation.location.time, turned.rotation.location.segment) == (0.1, 0)
    np.testing.assert_allclose(turned.rotation_by_segment, [0.03, -0.05], atol=1e-9)


def test_segments_and_points_have_the_numbers_of_the_problem():
    """The first two segments are joined to one."""
    divided = two_link([CORNER[0], [0.25, 0.0, 0.0], *CORNER[1:]])
    tool = [[0.1, 0, 0], [0.4, 0, 0], [0.4, 0.2, 0.06], [0.4, 0.3, 0]]
    assert excursions(divided, tool).tube.location.segment == 2
    back = two_link([BACK[0], [0.4, 0.0, 0.0], *BACK[1:]])
    found = excursions(back, [[0.4, y, 0] for y in (-0.2, 0.13, -0.2)])
    assert found.points.location.point == 2


def test_a_hand_over_may_lie_between_samples():
    """No sample is in both segments; the straight line between two of them passes through."""
    tool = [[0.1, 0, 0], [0.34, 0, 0], [0.4, 0.06, 0], [0.4, 0.3, 0]]
    assert excursions(two_link(CORNER), tool).tube.value <= 0
    far = [[0.1, 0, 0], [0.3, 0, 0], [0.4, 0.1, 0], [0.4, 0.3, 0]]
    assert excursions(two_link(CORNER), far).tube.value == pytest.approx(0.0, abs=1e-9)
    farther = [[0.1, 0, 0], [0.28, 0, 0], [0.4, 0.12, 0], [0.4, 0.3, 0]]
    assert excursions(two_link(CORNER), farther).tube.value == pytest.approx(0.01)


def test_segments_come_in_order_unless_any_may():
    tool = [[0.4, 0.3, 0], [0.4, 0.0, 0], [0.1, 0.0, 0]]
    assert excursions(two_link(CORNER), tool).tube.value > 0.2
    free = excursions(two_link(CORNER, visit="any"), tool)
    assert free.tube.value == pytest.approx(-0.05)


# Points are passed within the smaller radius beside them.
@pytest.mark.parametrize("radius", [0.05, [0.08, 0.05], [0.05, 0.08]])
def test_turning_back_too_early_misses_the_point(radius):
    problem = two_link(BACK, radius)
    whole = [[0.4, y, 0] for y in (-0.2, 0.0, 0.2, 0.0, -0.2)]
    early = [[0.4, y, 0] for y in (-0.2, 0.0, 0.13, 0.0, -0.2)]
    assert excursions(problem, whole).points.value == pytest.approx(-0.05)
    missed = excursions(problem, early)
    assert missed.tube.value <= 0 < missed.points.value
    assert missed.points.value == pytest.approx(0.02)
    assert (missed.points.location.point, missed.points.location.time) == (1, 0.2)


def test_every_point_has_its_own_radius_and_the_farthest_passed_counts():
    line = [[x, 0.0, 0.0] for x in (0.1, 0.2, 0.3, 0.4)]
    problem = two_link(line, [0.05, 0.04, 0.03], pass_through_points="all")
    found = excursions(problem, [[x, 0.035, 0] for x in (0.1, 0.2, 0.3, 0.4)]).points
    assert found.value == pytest.approx(0.005)
    assert found.location.point == 2


@pytest.mark.parametrize("backwards", [False, True])
def test_a_point_counts_while_a_segment_beside_it_is_current(backwards):
    """It is passed once more, at the far end of the tube."""
    way = slice(None, None, -1 if backwards else 1)
    corners = [*BACK, [0.1, -0.2, 0.0], [0.4, 0.2, 0.0]]
    tool = [BACK[0], [0.4, 0.13, 0.0], *corners[2:]]
    found = excursions(two_link(corners[way]), tool[way])
    assert found.tube.value == pytest.approx(-0.05)
    assert found.points.value == pytest.approx(0.02)
    assert found.points.location.point == (3 if backwards else 1)


def test_where_any_segment_may_be_current_a_point_is_passed_at_any_time():
    points = [[0.4, -0.2, 0.0], [0.4, 0.2, 0.0], [0.4, -0.2, 0.0], [0.42, 0.3, 0.0]]
    tool = [[0.4, -0.2, 0], [0.4, 0.13, 0], [0.4, -0.2, 0], [0.416, 0.2, 0], [0.42, 0.3, 0]]
    found = excursions(two_link(points, visit="any"), tool).points
    assert found.value == pytest.approx(0.016 - 0.05)


def test_a_hand_over_waits_for_the_signs_that_the_next_segment_asks():
    problem = two_link(CORNER, joint_signs=[{"joint2": "-"}, {"joint2": "+"}])
    tool = np.array([[0.1, 0, 0], [0.4, 0, 0], [0.4, 0.01, 0], [0.4, 0.2, 0], [0.4, 0.3, 0]])
    turned = np.tile(np.eye(3), (5, 1, 1))
    found = {}
    for late in (2, 3):
        q = np.zeros((5, 2))
        q[:, 1] = np.where(np.arange(5) < late, -1.0, 1.0)
        found[late] = tube_excursions(problem, np.arange(5.0), q, turned, tool).tube.value
    assert found[2] <= 0 < found[3]


def margins_of(problem, tool):
    count = len(tool)
    joints, turned = np.zeros((count, 2)), np.tile(np.eye(3), (count, 1, 1))
    margins = tube_margins(problem, np.arange(count) / 10, joints, turned, np.array(tool))
    return SimpleNamespace(tube=margins[0], rotation=margins[1])


def test_the_margin_over_time_is_that_of_the_segment_the_tool_is_in():
    tool = [[0.1, 0, 0.02], [0.2, 0, 0.08], [0.36, 0, 0], [0.4, 0.03, 0], [0.4, 0.2, 0.01]]
    found = margins_of(two_link(CORNER), tool)
    # Half way from the third to the fourth both axes are 0.02 and 0.015 m away.
    assert found.tube == pytest.approx([0.03, -0.03, 0.05, 0.05, 0.04], abs=0.02)
    assert found.tube[[0, 1, 4]] == pytest.approx([0.03, -0.03, 0.04])
    assert found.rotation is None
    # Neither sample is where the segments hand over, 0.01 m outside both: the later one counts.
    cut = margins_of(two_link(CORNER), [[0.1, 0, 0], [0.28, 0, 0], [0.4, 0.12, 0], [0.4, 0.3, 0]])
    assert cut.tube == pytest.approx([0.05, 0.05, -0.01, 0.05])


def test_the_margin_over_time_of_a_plan_is_the_tubes(stored):
    """Far from hand-overs, whose instants are the judge's, one segment alone counts."""
    problem, motion = stored("ur5/level_tray", REFINEMENT)
    time = np.linspace(0.0, motion.duration, 1500)
    q = motion.position(time)
    rotation, tool = problem.robot.tool_pose(q)
    margin, turn = tube_margins(problem, time, q, rotation, tool)
    whole = tube_excursions(problem, time, q, rotation, tool)
    assert margin.min() == -whole.tube.value
    samples = motion.per_piece(200)
    is_last = np.diff(current_segments(problem, motion, samples)) > 0
    begins = [0.0, *samples.time[1:][is_last], motion.duration]
    for k, (begin, end) in enumerate(pairwise(begins)):
        inner = (time > begin + 2e-3) & (time < end - 2e-3)
        assert margin[inner] == pytest.approx(problem.tube.margin(tool[inner])[:, k])
        allowed = problem.tube.rotation.margin(rotation[inner], tool[inner], k)
        assert turn[inner] == pytest.approx(allowed)
    assert turn.min() == -whole.rotation.value


def test_where_the_rotation_is_free_its_margin_has_no_end():
    turns = [[0, 0, 0, 1]] * 3
    problem = two_link(
        CORNER, orientations=turns, rotation_tolerance=[0.1, [np.inf, np.inf, np.inf]]
    )
    tool = [[0.1, 0, 0], [0.2, 0, 0], [0.4, 0, 0], [0.4, 0.1, 0], [0.4, 0.3, 0]]
    found = margins_of(problem, tool)
    assert found.rotation[:2] == pytest.approx([0.1, 0.1])
    assert (found.rotation[-2:] == np.inf).all()


NO_SHIFT = np.zeros(3)
BALL = """<robot name="ball"><link name="base"/><link name="arm">
<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0.5 0 0"/><geometry><sphere radius="0.1"/></geometry></collision></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
<limit lower="-9" upper="9" effort="5" velocity="4"/></joint></robot>"""


@pytest.fixture(scope="module")
def wall(stored):
    problem, motion = stored("ur5/over_the_wall", REFINEMENT)
    time = np.linspace(0, motion.duration, 60)
    return problem, time, motion.reordered(problem.robot.joint_names).position(time)


def measured(problem, q, pairs, shift):
    """The least distance of all pairs at all samples, each measured."""
    found = []
    for rotation, position in zip(*problem.robot.body_poses(q), strict=True):
        moved = position.copy()
        moved[1:] += shift
        found.append(problem.collision.distances(rotation, moved, pairs))
    return np.array(found)


@pytest.mark.parametrize("shift", [NO_SHIFT, np.array([0.02, -0.01, -0.02])])
def test_they_are_the_least_of_all_distances(wall, shift):
    problem, time, q = wall
    obstacles, links = least_clearances(problem, time, q, shift)
    pairs = problem.collision.obstacle_pairs
    expected = measured(problem, q, pairs, shift)
    sample, pair = np.unravel_index(expected.argmin(), expected.shape)
    assert obstacles.value == pytest.approx(expected.min(), abs=1e-9)
    assert obstacles.location.time == time[sample]
    assert (obstacles.location.links, obstacles.location.obstacle) == problem.collision.owners(
        pairs[pair]
    )
    alone = measured(problem, q, problem.collision.link_pairs, NO_SHIFT)
    assert links.value == pytest.approx(alone.min(), abs=1e-9)
    assert links.location.obstacle is None
    over_time = obstacle_distances(problem, q, shift)
    assert over_time == pytest.approx(expected.min(axis=1), abs=1e-9)


@pytest.mark.parametrize("spread", [1.0, 0.02], ids=["anywhere", "close together"])
def test_they_are_found_wherever_samples_are(spread, bundled):
    problem, random = bundled("ur10/onto_a_conveyor"), np.random.default_rng(5)
    q = problem.start + spread * random.uniform(-1, 1, (80, problem.robot.joint_count))
    found, checker = least_clearances(problem, np.arange(80.0), q, NO_SHIFT), problem.collision
    for extreme, pairs in zip(found, (checker.obstacle_pairs, checker.link_pairs), strict=True):
        expected = measured(problem, q, pairs, NO_SHIFT)
        assert extreme.value == pytest.approx(expected.min(), abs=1e-12)
        assert extreme.location.time == np.unravel_index(expected.argmin(), expected.shape)[0]


def depth(problem, q, pair, shift):
    """How deep two shapes overlap: the way out of their Minkowski difference."""
    rotation, position = (each[0] for each in problem.robot.body_poses(q[None]))
    position[1:] += shift
    first, second = (problem.collision.shapes[index] for index in pair)
    corners = [
        each.shape.vertices @ rotation[each.body].T + position[each.body]
        for each in (first, second)
    ]
    hull = ConvexHull((corners[0][:, None] - corners[1]).reshape(-1, 3))
    return -hull.equations[:, 3].max() + first.shape.radius + second.shape.radius


def test_overlaps_are_at_least_as_deep_as_they_are(bundled):
    problem, random = bundled("ur10/onto_a_conveyor"), np.random.default_rng(5)
    q = problem.start + random.uniform(-0.3, 0.3, (20, problem.robot.joint_count))
    shift, pairs = np.array([0.0, 0.0, -0.2]), problem.collision.obstacle_pairs
    obstacles, _ = least_clearances(problem, np.arange(20.0), q, shift)
    bounds = measured(problem, q, pairs, shift)
    deepest = max(depth(problem, q[k], pairs[p], shift) for k, p in np.argwhere(bounds < -0.1))
    assert bounds.min() <= obstacles.value <= -deepest < -0.1


def test_one_measurement_answers_for_many_samples(stored, monkeypatch):
    problem, motion = stored("ur5/over_the_wall", REFINEMENT)
    many = np.linspace(0, motion.duration, 1000)
    q = motion.reordered(problem.robot.joint_names).position(many)
    measure, pairs_measured = problem.collision.closest_points, []

    def counted(rotation, position, pairs):
        pairs_measured.extend(pairs)
        return measure(rotation, position, pairs)

    monkeypatch.setattr(problem.collision, "closest_points", counted)
    least_clearances(problem, many, q, NO_SHIFT)
    assert len(pairs_measured) < 100


def test_distances_of_balls_are_those_of_their_centres(tmp_path):
    """The quick bounds are exact for them, but for rounding."""
    (tmp_path / "ball.urdf").write_text(BALL)
    robot = load_robot(tmp_path / "ball.urdf", "arm")
    post = np.array([0.9, 0.31, 0.1])
    obstacle = Obstacle.sphere("post", 0.07, placement_of(post))
    problem = changed(anywhere(robot), obstacles=[obstacle])
    random = np.random.default_rng(0)
    for _ in range(20):
        angle, shift = random.uniform(-3, 3), random.normal(scale=0.1, size=3)
        found, _ = least_clearances(problem, np.zeros(1), np.array([[angle]]), shift)
        ball = shift + 0.5 * np.array([np.cos(angle), np.sin(angle), 0.0])
        assert found.value == pytest.approx(np.linalg.norm(ball - post) - 0.17, abs=1e-9)


def test_where_no_pair_is_judged_at_all_there_is_no_least_clearance(tmp_path):
    """All of the motion is within the contact's distance, or the arm has no shapes."""
    problem, _, time, q, _ = planned(tmp_path, "a lift")
    more = np.full((len(time), len(problem.collision.pairs)), -np.inf)
    assert least_clearances(problem, time, q, NO_SHIFT, more) == (None, None)
    shapeless = anywhere(one_joint(tmp_path))
    assert least_clearances(shapeless, np.zeros(1), np.zeros((1, 1)), NO_SHIFT) == (None, None)


def test_over_time_what_pairs_ask_is_taken_off(wall):
    problem, _, q = wall
    pairs = problem.collision.obstacle_pairs
    more = np.random.default_rng(2).uniform(-0.3, 0.3, (len(q), len(problem.collision.pairs)))
    more[:, ::3] = -np.inf
    more[7] = -np.inf
    expected = (measured(problem, q, pairs, NO_SHIFT) - more[:, : len(pairs)]).min(axis=1)
    assert expected[7] == np.inf
    found = obstacle_distances(problem, q, NO_SHIFT, more)
    np.testing.assert_allclose(found, expected, atol=1e-9)


def planned(folder, name, count=401):
    """Return problem, motion, times, configurations and the column of cube and table."""
    problem, motion = lifting(folder, CASES[name])
    time = np.linspace(0, motion.duration, count)
    column = int(np.flatnonzero(problem.collision.between("hand", "table"))[0])
    return problem, motion, time, motion.position(time), column


def test_pairs_in_contact_are_not_judged_near_the_ends(tmp_path):
    """The base stands 2 mm too low: on the table that is no collision, elsewhere it counts."""
    problem, motion, time, q, column = planned(tmp_path, "a lift")
    more = additional_distances(problem, motion, time)
    near = (np.linalg.norm(q[:, None] - q[[0, -1]], axis=2) <= 0.03).any(axis=1)
    np.testing.assert_array_equal(more[near, column], -np.inf)
    np.testing.assert_array_equal(more[~near, column], 0.0)
    np.testing.assert_array_equal(np.delete(more, column, axis=1), 0.0)
    low = np.array([0.0, 0.0, -0.002])
    obstacles, _ = least_clearances(problem, time, q, low, more)
    assert obstacles.value == pytest.approx((q[~near, 1] - HALF - 0.002).min(), abs=1e-9)
    everywhere, _ = least_clearances(problem, time, q, low)
    assert everywhere.value == pytest.approx(-0.002, abs=1e-6)


def test_a_segments_clearance_is_asked_while_the_plan_is_in_it(tmp_path):
    problem, motion, time, _, column = planned(tmp_path, "by segment")
    more = additional_distances(problem, motion, time)[:, column]
    first, second = judged_visits(problem, motion)
    np.testing.assert_allclose(more[time < first.end], 0.008)
    np.testing.assert_allclose(more[time > second.begin], 0.017)
    assert first.end == second.begin


def test_what_pairs_of_links_must_keep_counts_from_nothing(tmp_path):
    problem, motion = lifting(tmp_path, CASES["one for all"])
    assert additional_distances(problem, motion, np.zeros(3)) is None
    asked = changed(problem, pair_clearances={("base", "hand"): 0.02, ("hand", "table"): 0.003})
    more = additional_distances(asked, motion, np.zeros(3))
    links = asked.collision.between("base", "hand")
    np.testing.assert_allclose(more[:, links], 0.02)
    np.testing.assert_allclose(more[:, asked.collision.between("hand", "table")], -0.005)


@pytest.mark.parametrize(
    ("name", "broken"),
    [("by segment", False), ("swapped", True), ("a lift", False), ("a lift without contact", True)],
)
def test_a_run_survives_if_it_keeps_what_its_segments_ask(tmp_path, name, broken):
    problem, motion = lifting(tmp_path, CASES[name])
    (run,) = judged_runs(problem, motion, followed(problem, motion, [[0, 0, 0]]))
    assert ("obstacles" in run.broken) == broken
