import numpy as np
import pytest
from scipy.spatial import ConvexHull

from cases import anywhere, changed, one_joint
from lifting_arm import CASES, HALF, lifting
from stored_trajectories import REFINEMENT, stored_trajectory
from tubeplanner import Obstacle, load_problem, load_robot, placement_of
from tubeplanner.problem.robustness import Robustness
from tubeplanner.simulation.executed_clearance import (
    additional_distances,
    least_clearances,
    obstacle_distances,
)
from tubeplanner.simulation.execution import executed
from tubeplanner.simulation.judged_runs import judged_runs
from tubeplanner.simulation.plant import Draw, drawn_plants
from tubeplanner.verification.verification import judged_visits

NO_SHIFT = np.zeros(3)
BALL = """<robot name="ball"><link name="base"/><link name="arm">
<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0.5 0 0"/><geometry><sphere radius="0.1"/></geometry></collision></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
<limit lower="-9" upper="9" effort="5" velocity="4"/></joint></robot>"""


@pytest.fixture(scope="module")
def wall():
    problem = load_problem("example:ur5/over_the_wall")
    motion = stored_trajectory("ur5/over_the_wall", REFINEMENT).trajectory
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
    assert obstacles.place.time == time[sample]
    assert (obstacles.place.links, obstacles.place.obstacle) == problem.collision.owners(
        pairs[pair]
    )
    alone = measured(problem, q, problem.collision.link_pairs, NO_SHIFT)
    assert links.value == pytest.approx(alone.min(), abs=1e-9)
    assert links.place.obstacle is None


@pytest.mark.parametrize("name", ["panda/between_shelves", "ur10/onto_a_conveyor"])
@pytest.mark.parametrize("spread", [1.0, 0.02], ids=["anywhere", "close together"])
def test_they_are_found_wherever_samples_are(name, spread):
    problem, random = load_problem(f"example:{name}"), np.random.default_rng(5)
    q = problem.start + spread * random.uniform(-1, 1, (150, problem.robot.joint_count))
    found, checker = least_clearances(problem, np.arange(150.0), q, NO_SHIFT), problem.collision
    for extreme, pairs in zip(found, (checker.obstacle_pairs, checker.link_pairs), strict=True):
        expected = measured(problem, q, pairs, NO_SHIFT)
        assert extreme.value == pytest.approx(expected.min(), abs=1e-12)
        assert extreme.place.time == np.unravel_index(expected.argmin(), expected.shape)[0]


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


def test_overlaps_are_at_least_as_deep_as_they_are():
    problem, random = load_problem("example:ur10/onto_a_conveyor"), np.random.default_rng(5)
    q = problem.start + random.uniform(-0.3, 0.3, (20, problem.robot.joint_count))
    shift, pairs = np.array([0.0, 0.0, -0.2]), problem.collision.obstacle_pairs
    obstacles, _ = least_clearances(problem, np.arange(20.0), q, shift)
    bounds = measured(problem, q, pairs, shift)
    deepest = max(depth(problem, q[k], pairs[p], shift) for k, p in np.argwhere(bounds < -0.1))
    assert bounds.min() <= obstacles.value <= -deepest < -0.1


def test_one_measurement_answers_for_many_samples(wall, monkeypatch):
    problem, _, _ = wall
    motion = stored_trajectory("ur5/over_the_wall", REFINEMENT).trajectory
    many = np.linspace(0, motion.duration, 1000)
    q = motion.reordered(problem.robot.joint_names).position(many)
    measure, measured = problem.collision.closest_points, []

    def counted(rotation, position, pairs):
        measured.extend(pairs)
        return measure(rotation, position, pairs)

    monkeypatch.setattr(problem.collision, "closest_points", counted)
    least_clearances(problem, many, q, NO_SHIFT)
    assert len(measured) < 100


def test_of_tools_at_random_they_are_too(wall):
    problem, _, planned = wall
    random = np.random.default_rng(3)
    pairs, times = problem.collision.obstacle_pairs, np.arange(40) / 8
    for _ in range(6):
        q = planned[::2][:1] + random.uniform(-1.5, 1.5, (40, planned.shape[1]))
        found, _ = least_clearances(problem, times, q, NO_SHIFT)
        expected = measured(problem, q, pairs, NO_SHIFT)
        sample, pair = np.unravel_index(expected.argmin(), expected.shape)
        assert found.value == pytest.approx(expected.min(), abs=1e-9)
        assert found.place.time == times[sample]
        assert found.place.links == problem.collision.owners(pairs[pair])[0]


def test_distances_of_balls_are_those_of_their_centres(tmp_path):
    """The quick bounds are exact for them, but for rounding."""
    (tmp_path / "ball.urdf").write_text(BALL)
    robot = load_robot(tmp_path / "ball.urdf", "arm")
    post = np.array([0.9, 0.31, 0.1])
    obstacle = Obstacle.sphere("post", 0.07, placement_of(post))
    problem = changed(anywhere(robot), obstacles=[obstacle])
    random = np.random.default_rng(0)
    for _ in range(60):
        angle, shift = random.uniform(-3, 3), random.normal(scale=0.1, size=3)
        found, _ = least_clearances(problem, np.zeros(1), np.array([[angle]]), shift)
        ball = shift + 0.5 * np.array([np.cos(angle), np.sin(angle), 0.0])
        assert found.value == pytest.approx(np.linalg.norm(ball - post) - 0.17, abs=1e-9)


def test_an_arm_without_shapes_has_none(tmp_path):
    problem = anywhere(one_joint(tmp_path))
    assert least_clearances(problem, np.zeros(1), np.zeros((1, 1)), NO_SHIFT) == (None, None)


@pytest.mark.parametrize("shift", [NO_SHIFT, np.array([0.02, -0.01, -0.02])])
def test_over_time_they_are_the_least_of_all_pairs(wall, shift):
    problem, _, q = wall
    expected = measured(problem, q, problem.collision.obstacle_pairs, shift).min(axis=1)
    assert obstacle_distances(problem, q, shift) == pytest.approx(expected, abs=1e-9)


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


def test_where_no_pair_is_judged_at_all_there_is_no_least_clearance(tmp_path):
    """All of the motion is within the contact's distance."""
    problem, _, time, q, _ = planned(tmp_path, "a lift")
    more = np.full((len(time), len(problem.collision.pairs)), -np.inf)
    assert least_clearances(problem, time, q, NO_SHIFT, more) == (None, None)


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
    plants = drawn_plants(problem.robot, Robustness.exact(), Draw(1))
    (run,) = judged_runs(problem, motion, executed(problem, motion, plants))
    assert ("obstacles" in run.broken) == broken
