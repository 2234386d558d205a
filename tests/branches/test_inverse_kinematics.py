"""Inverse kinematics of position and rotation, exact or within a tolerance, native and NumPy."""

import numpy as np
import pytest
from follower_arm import follower_arm
from rail_arm import rail_arm

from tubeplanner import load_robot
from tubeplanner.branches import inverse_kinematics
from tubeplanner.branches.inverse_kinematics import WantedRotation, solve_position, solve_positions
from tubeplanner.native.library import LIBRARY, NativeLibrary
from tubeplanner.tube.rotations import rotation_matrix, rotation_vector

NEEDS_LIBRARY = pytest.mark.skipif(LIBRARY.functions is None, reason="the library is left out")


# Configurations of tool positions by compiled functions, against those by numpy.


COMPONENTS = [None, (1, 1, 1), (1, 0, 1), (0, 1, 0), (0, 0, 0)]


@pytest.fixture(params=["two_link", "ur5", "panda", "slide", "rail", "followers"])
def arm(request, tmp_path):
    sources = {"rail": (rail_arm(), "flange"), "followers": (follower_arm(), "tip")}
    if request.param not in sources:
        return request.getfixturevalue(request.param)
    text, tool = sources[request.param]
    (tmp_path / "arm.urdf").write_text(text)
    return load_robot(tmp_path / "arm.urdf", tool)


@pytest.fixture
def by_numpy(monkeypatch):
    """Return a function that does what another does, without the library."""

    def done(function, *arguments):
        with monkeypatch.context() as patch:
            patch.setattr(inverse_kinematics, "LIBRARY", NativeLibrary(None, "for a test"))
            return function(*arguments)

    return done


def task(robot, components, rng, away=0.3):
    """Return a tool position in reach, a seed, bounds, a preference and a wanted rotation."""
    low = np.maximum(robot.limits.lower_position, -3.0)
    high = np.minimum(robot.limits.upper_position, 3.0)
    goal = rng.uniform(0.8 * low + 0.2 * high, 0.2 * low + 0.8 * high)
    turn, place = (part[0] for part in robot.tool_pose(goal[None]))
    seed = goal + rng.uniform(-away, away, len(goal))
    preferred = goal + rng.uniform(-0.1, 0.1, len(goal))
    rotation = None
    if components is not None:
        vector = rng.uniform(-0.4, 0.4, 3)
        counted = np.array(components, dtype=bool)
        rotation = WantedRotation(turn @ rotation_matrix(-vector), vector, counted)
    return place, seed, low, high, preferred, rotation


@NEEDS_LIBRARY
@pytest.mark.parametrize("components", COMPONENTS)
def test_numpy_finds_the_same_configurations(components, arm, by_numpy):
    rng = np.random.default_rng(4)
    for _ in range(6):
        given = (arm, *task(arm, components, rng))
        one, other = solve_position(*given), by_numpy(solve_position, *given)
        np.testing.assert_allclose(one.q, other.q, atol=1e-8)
        assert one.error == pytest.approx(other.error, abs=1e-9)
        assert one.rotation_error == pytest.approx(other.rotation_error, abs=1e-8)


@NEEDS_LIBRARY
def test_bounds_hold_as_in_numpy(arm, by_numpy):
    """So narrow that some joints are held at them, and the tool does not get there."""
    rng = np.random.default_rng(5)
    held = 0
    for _ in range(6):
        place, seed, _, _, preferred, _ = task(arm, None, rng)
        given = (arm, place, seed, seed - 0.02, seed + 0.02, preferred)
        one, other = solve_position(*given), by_numpy(solve_position, *given)
        assert (abs(one.q - seed) <= 0.02 + 1e-15).all()
        assert one.error == pytest.approx(other.error, rel=1e-4, abs=1e-9)
        held += bool((abs(one.q - seed) >= 0.02 - 1e-15).any())
    assert held > 3


@NEEDS_LIBRARY
def test_a_stretched_arm_is_bent_as_in_numpy(two_link, by_numpy):
    for bound in (0.0, 3.0):
        lower, upper = np.array([-3.0, bound - 3]), np.array([3.0, bound])
        given = (two_link, np.array([0.5, 0, 0]), np.zeros(2), lower, upper)
        one, other = solve_position(*given), by_numpy(solve_position, *given)
        np.testing.assert_allclose(one.q, other.q, atol=1e-9)
        assert one.error < 1e-9


@NEEDS_LIBRARY
def test_a_turn_the_other_way_round_is_taken_as_in_numpy(ur5, by_numpy):
    """Wanted is 3.3 rad about z, of which the rotation vector of least length is -2.98."""
    goal, vector = np.array([0.1, -1.2, 1.6, -1.97, -np.pi / 2, 0.2]), np.array([0, 0, 3.3])
    turn, place = (part[0] for part in ur5.tool_pose(goal[None]))
    wanted = WantedRotation(turn @ rotation_matrix(-vector), vector, np.ones(3, dtype=bool))
    seed, free = goal - 0.3 * np.eye(6)[5], np.full(6, np.inf)
    given = (ur5, place, seed, -free, free, None, wanted)
    one, other = solve_position(*given), by_numpy(solve_position, *given)
    np.testing.assert_allclose(one.q, goal, atol=1e-7)
    np.testing.assert_allclose(one.q, other.q, atol=1e-9)


@NEEDS_LIBRARY
@pytest.mark.parametrize("components", [None, (1, 1, 0)])
def test_many_are_solved_as_each_by_itself(components, panda, by_numpy):
    rng = np.random.default_rng(6)
    tasks = [task(panda, components, rng) for _ in range(5)]
    rotation = tasks[0][-1]
    columns = [np.array(column) for column in list(zip(*tasks, strict=True))[:5]]
    q, errors = solve_positions(panda, *columns, rotation)
    pure = by_numpy(solve_positions, panda, *columns, rotation)
    for k, own in enumerate(tasks):
        found = solve_position(panda, *own[:5], rotation)
        np.testing.assert_array_equal(q[k], found.q)
        assert errors[k].tolist() == [found.error, found.rotation_error]
    assert q.shape == pure[0].shape == (5, 7)
    np.testing.assert_allclose(errors[:, 0], pure[1][:, 0], atol=1e-8)


@NEEDS_LIBRARY
def test_seeds_may_share_a_target_and_bounds(ur5, by_numpy):
    place, seed, low, high, preferred, _ = task(ur5, None, np.random.default_rng(7))
    seeds = seed + np.linspace(-0.2, 0.2, 4)[:, None]
    given = (ur5, place, seeds, low, high, preferred)
    q, errors = solve_positions(*given)
    np.testing.assert_allclose(q, by_numpy(solve_positions, *given)[0], atol=1e-8)
    assert (errors[:, 0] < 1e-9).all()
    assert not errors[:, 1].any()
    tool = ur5.tool_position(q)
    np.testing.assert_allclose(tool, np.broadcast_to(place, (4, 3)), atol=1e-9)


def bounds(robot):
    return robot.limits.lower_position, robot.limits.upper_position


def test_a_reachable_position_is_reached(robot):
    rng = np.random.default_rng(1)
    low, high = bounds(robot)
    low, high = np.maximum(low, -2.5), np.minimum(high, 2.5)
    for _ in range(20):
        goal = rng.uniform(low, high)
        target = robot.tool_position(goal[None])[0]
        seed = np.clip(goal + rng.normal(scale=0.2, size=len(goal)), *bounds(robot))
        solution = solve_position(robot, target, seed, *bounds(robot))
        assert solution.error < 1e-9
        assert (solution.q >= low - 10).all()


def test_a_fully_stretched_arm_is_reached(two_link):
    """The goal of the paper's second example: 0.6 m away is the whole length of the arm."""
    solution = solve_position(
        two_link, np.array([0.6, 0, 0]), np.array([0.5, -1.0]), *bounds(two_link)
    )
    assert solution.error < 1e-6
    np.testing.assert_allclose(solution.q, 0, atol=3e-3)


def test_out_of_reach_the_nearest_point_is_found(two_link):
    solution = solve_position(
        two_link, np.array([0.0, 0.7, 0]), np.array([0.5, -1.0]), *bounds(two_link)
    )
    assert solution.error == pytest.approx(0.1, abs=1e-3)


def test_bounds_hold_and_are_used(two_link):
    """With the elbow held between -0.5 and 0 the tool can get no nearer than 0.58 m."""
    lower, upper = np.array([-3.0, -0.5]), np.array([3.0, 0.0])
    solution = solve_position(two_link, np.array([0.3, 0, 0]), np.zeros(2), lower, upper)
    assert solution.q[1] == -0.5
    reach = 0.3 * np.hypot(1 + np.cos(0.5), np.sin(0.5))
    assert solution.error == pytest.approx(reach - 0.3, abs=1e-4)


def test_redundant_joints_go_to_the_preferred_configuration(panda):
    """The preferred configuration reaches the target, so the solution is that configuration."""
    rng = np.random.default_rng(2)
    preferred = np.array([0.1, -0.3, 0.2, -2.0, 0.1, 2.0, 0.5])
    target = panda.tool_position(preferred[None])[0]
    seed = preferred + rng.uniform(-0.3, 0.3, 7)
    solution = solve_position(panda, target, seed, *bounds(panda), preferred)
    np.testing.assert_allclose(solution.q, preferred, atol=1e-6)


def test_without_a_preference_joints_move_little(panda):
    q = np.array([0.1, -0.3, 0.2, -2.0, 0.1, 2.0, 0.5])
    target = panda.tool_position(q[None])[0] + np.array([0, 0, 1e-3])
    solution = solve_position(panda, target, q, *bounds(panda))
    assert abs(solution.q - q).max() < 0.01


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_stretched_arm_folds_the_way_its_bounds_allow(sign, two_link):
    """At full stretch the tool's inward trajectory has no gradient in the joints."""
    lower, upper = np.sort([[0.0, 3.0 * sign], [-3.0, 3.0]], axis=1)[[0, 1]].T
    lower, upper = np.array([-3.0, lower[0]]), np.array([3.0, upper[0]])
    target = np.array([0.5, 0, 0])
    solution = solve_position(two_link, target, np.zeros(2), lower, upper)
    assert solution.error < 1e-9
    assert np.sign(solution.q[1]) == sign


def wanted(robot, q, vector=(0, 0, 0), components=(1, 1, 1)):
    """Return the pose of a configuration as what is wanted, off by the opposite of a vector."""
    rotation, position = robot.tool_pose(q[None])
    reference = rotation[0] @ rotation_matrix(-np.array(vector, dtype=float))
    vector = np.array(vector, dtype=float)
    return position[0], WantedRotation(reference, vector, np.array(components, dtype=bool))


def rotation_off(robot, q, rotation):
    return rotation_vector(rotation.reference.T @ robot.tool_pose(q[None])[0][0]) - rotation.vector


@pytest.mark.parametrize("vector", [(0, 0, 0), (0.3, -0.2, 0.1)])
@pytest.mark.parametrize("components", [(1, 1, 1), (1, 1, 0), (0, 0, 1), (0, 0, 0)])
def test_a_reachable_pose_is_reached_in_the_components_that_count(vector, components, ur5, panda):
    for arm, middle in ((ur5, [0, -1.2, 1.6, -1.8, -1.5, 0]), (panda, [0, -0.3, 0, -2, 0, 2, 0])):
        rng = np.random.default_rng(3)
        for _ in range(5):
            goal = np.array(middle) + rng.uniform(-0.4, 0.4, len(middle))
            seed = goal + rng.uniform(-0.15, 0.15, len(middle))
            target, rotation = wanted(arm, goal, vector, components)
            solution = solve_position(arm, target, seed, *bounds(arm), rotation=rotation)
            assert solution.error < 1e-9
            off = rotation_off(arm, solution.q, rotation)[np.array(components, dtype=bool)]
            assert np.linalg.norm(off) < 1e-8
            assert solution.rotation_error == pytest.approx(np.linalg.norm(off), abs=1e-12)


def test_components_that_do_not_count_are_left_to_redundant_joints(ur5):
    """The last joint turns about z of the tool: it stays where it is preferred."""
    goal = np.array([0.1, -1.2, 1.6, -1.97, -np.pi / 2, 0.0])
    target, rotation = wanted(ur5, goal, components=(1, 1, 0))
    preferred = goal + np.array([0, 0, 0, 0, 0, 1.0])
    solution = solve_position(ur5, target, goal, *bounds(ur5), preferred, rotation)
    np.testing.assert_allclose(solution.q, preferred, atol=1e-7)


def test_the_position_comes_first(two_link):
    """Two joints that are needed for the position: the rotation asked for changes nothing."""
    q = np.array([0.3, -1.0])
    target, rotation = wanted(two_link, q, vector=(0, 0, 0.4))
    asked = WantedRotation(rotation.reference, np.zeros(3), rotation.components)
    solution = solve_position(two_link, target, q + 0.1, *bounds(two_link), rotation=asked)
    np.testing.assert_allclose(solution.q, q, atol=1e-7)
    assert solution.error < 1e-9
    assert solution.rotation_error == pytest.approx(0.4, abs=1e-6)


def test_a_rotation_is_followed_beyond_half_a_turn(ur5):
    """Wanted is 3.3 rad about z, of which the rotation vector of least length is -2.98."""
    goal = np.array([0.1, -1.2, 1.6, -1.97, -np.pi / 2, 0.2])
    target, rotation = wanted(ur5, goal, vector=(0, 0, 3.3))
    seed = goal - np.array([0, 0, 0, 0, 0, 0.3])
    solution = solve_position(ur5, target, seed, *bounds(ur5), rotation=rotation)
    np.testing.assert_allclose(solution.q, goal, atol=1e-7)


@pytest.mark.parametrize("away", [0.0, 0.7])
def test_its_errors_are_those_of_its_configuration(away, ur5):
    """Within reach and out of it, though the last ones are not evaluated but predicted."""
    q = np.array([0.1, -1.2, 1.6, -1.8, -1.5, 0.2])
    target, rotation = wanted(ur5, q, vector=(0.2, -0.1, 0.3))
    target = target + np.array([away, 0, 0])
    solution = solve_position(ur5, target, q + 0.1, *bounds(ur5), rotation=rotation)
    distance = np.linalg.norm(ur5.tool_position(solution.q[None])[0] - target)
    off = np.linalg.norm(rotation_off(ur5, solution.q, rotation))
    assert solution.error == pytest.approx(distance, abs=1e-10)
    assert solution.rotation_error == pytest.approx(off, abs=1e-10)
    assert (distance > 0.1) == (away > 0)
