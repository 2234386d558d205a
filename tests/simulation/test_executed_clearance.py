import numpy as np
import pytest
from scipy.spatial import ConvexHull

from cases import anywhere, changed, one_joint
from stored_trajectories import REFINEMENT, stored_trajectory
from tubeplanner import Obstacle, load_problem, load_robot, placement_of
from tubeplanner.simulation.executed_clearance import least_clearances, obstacle_distances

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
