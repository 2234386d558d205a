"""Inverse kinematics of position and rotation, exact or within a tolerance, native and NumPy."""

from functools import partial

import numpy as np
import pytest
from arms import follower_arm, rail_arm

from tubeplanner import load_robot
from tubeplanner.first_guess import inverse_kinematics
from tubeplanner.first_guess.inverse_kinematics import (
    WantedRotation,
    solve_position,
    solve_positions,
)
from tubeplanner.native.library import LIBRARY, NativeLibrary
from tubeplanner.orientation import rotation_matrix, rotation_vector

NEEDS_LIBRARY = pytest.mark.skipif(LIBRARY.functions is None, reason="the library is left out")
COMPONENTS = [None, (1, 1, 1), (1, 0, 1), (0, 1, 0), (0, 0, 0)]
UR5_POSE = np.array([0.1, -1.2, 1.6, -1.97, -np.pi / 2, 0.2])
PANDA_POSE = np.array([0.1, -0.3, 0.2, -2.0, 0.1, 2.0, 0.5])


@pytest.fixture
def by_numpy(monkeypatch):
    """Return a function that calls another one without the library."""

    def done(function, *arguments, **named):
        with monkeypatch.context() as patch:
            patch.setattr(inverse_kinematics, "LIBRARY", NativeLibrary(None, "for a test"))
            return function(*arguments, **named)

    return done


@pytest.fixture(params=[pytest.param("native", marks=NEEDS_LIBRARY), "numpy"])
def solve(request, by_numpy):
    """Return a function that solves within the robot's own bounds, or others."""

    def solved(robot, target, seed, lower=None, upper=None, **more):
        lower = robot.limits.lower_position if lower is None else lower
        upper = robot.limits.upper_position if upper is None else upper
        call = solve_position if request.param == "native" else partial(by_numpy, solve_position)
        return call(robot, np.array(target), np.array(seed), lower, upper, **more)

    return solved


def wanted(robot, q, vector=(0.0, 0.0, 0.0), components=(1, 1, 1)):
    """Return the position and rotation of a configuration, the reference off by a vector."""
    turn, position = (part[0] for part in robot.tool_pose(q[None]))
    vector = np.array(vector, dtype=float)
    counted = np.array(components, dtype=bool)
    return position, WantedRotation(turn @ rotation_matrix(-vector), vector, counted)


def rotation_off(robot, q, rotation):
    return rotation_vector(rotation.reference.T @ robot.tool_pose(q[None])[0][0]) - rotation.vector


# Against closed forms and forward kinematics, compiled and by NumPy.


def test_a_reachable_position_is_reached(robot, solve):
    rng = np.random.default_rng(1)
    limits = robot.limits
    low = np.maximum(limits.lower_position, -2.5)
    high = np.minimum(limits.upper_position, 2.5)
    for _ in range(20):
        goal = rng.uniform(low, high)
        seed = goal + rng.normal(scale=0.2, size=len(goal))
        seed = np.clip(seed, limits.lower_position, limits.upper_position)
        target = robot.tool_position(goal[None])[0]
        solution = solve(robot, target, seed)
        assert solution.error < 1e-9
        reached = robot.tool_position(solution.q[None])[0]
        np.testing.assert_allclose(reached, target, atol=2e-9)
        assert (solution.q >= low - 10).all()


@pytest.mark.parametrize(
    ("x", "elbow", "error", "accuracy"),
    [
        (0.6, (-3.0, 3.0), 0.0, 1e-6),  # as in the paper's second example
        (0.7, (-3.0, 3.0), 0.1, 1e-3),
        (0.3, (-0.5, 0.0), 0.3 * np.hypot(1 + np.cos(0.5), np.sin(0.5)) - 0.3, 1e-4),
    ],
)
def test_the_nearest_position_within_bounds_is_found(x, elbow, error, accuracy, two_link, solve):
    lower, upper = np.array([(-3.0, 3.0), elbow]).T
    solution = solve(two_link, [x, 0, 0], [0.0, elbow[0] / 2], lower, upper)
    assert solution.error == pytest.approx(error, abs=accuracy)
    expected = -0.5 if elbow[1] == 0 else 0.0
    assert solution.q[1] == pytest.approx(expected, abs=0.05 if x == 0.7 else 3e-3)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_stretched_arm_folds_the_way_its_bounds_allow(sign, two_link, solve):
    """At full stretch the tool's inward trajectory has no gradient in the joints."""
    lower, upper = np.array([[-3.0, 3.0], np.sort([0.0, 3.0 * sign])]).T
    solution = solve(two_link, [0.5, 0, 0], np.zeros(2), lower, upper)
    assert solution.error < 1e-9
    assert np.sign(solution.q[1]) == sign


def test_redundant_joints_go_to_the_preferred_configuration(panda, solve):
    """The preferred configuration reaches the target, so the solution is that configuration."""
    seed = PANDA_POSE + np.random.default_rng(2).uniform(-0.3, 0.3, 7)
    target = panda.tool_position(PANDA_POSE[None])[0]
    solution = solve(panda, target, seed, preferred=PANDA_POSE)
    np.testing.assert_allclose(solution.q, PANDA_POSE, atol=1e-6)


def test_without_a_preference_joints_move_little(panda, solve):
    target = panda.tool_position(PANDA_POSE[None])[0] + np.array([0, 0, 1e-3])
    assert abs(solve(panda, target, PANDA_POSE).q - PANDA_POSE).max() < 0.01


@pytest.mark.parametrize("vector", [(0, 0, 0), (0.3, -0.2, 0.1)])
@pytest.mark.parametrize("components", COMPONENTS[1:])
def test_a_reachable_pose_is_reached_in_the_components_that_count(
    vector, components, ur5, panda, solve
):
    for arm, middle in ((ur5, UR5_POSE), (panda, PANDA_POSE)):
        rng = np.random.default_rng(3)
        for _ in range(3):
            goal = middle + rng.uniform(-0.4, 0.4, len(middle))
            seed = goal + rng.uniform(-0.15, 0.15, len(middle))
            target, rotation = wanted(arm, goal, vector, components)
            solution = solve(arm, target, seed, rotation=rotation)
            assert solution.error < 1e-9
            off = rotation_off(arm, solution.q, rotation)[rotation.components]
            assert np.linalg.norm(off) < 1e-8
            assert solution.rotation_error == pytest.approx(np.linalg.norm(off), abs=1e-12)


def test_components_that_do_not_count_are_left_to_redundant_joints(ur5, solve):
    """The last joint turns about z of the tool: it stays where it is preferred."""
    target, rotation = wanted(ur5, UR5_POSE, components=(1, 1, 0))
    preferred = UR5_POSE + np.eye(6)[5]
    solution = solve(ur5, target, UR5_POSE, preferred=preferred, rotation=rotation)
    np.testing.assert_allclose(solution.q, preferred, atol=1e-7)


def test_the_position_comes_first(two_link, solve):
    """Two joints that are needed for the position: the rotation asked for changes nothing."""
    q = np.array([0.3, -1.0])
    target, turned = wanted(two_link, q, vector=(0, 0, 0.4))
    rotation = WantedRotation(turned.reference, np.zeros(3), turned.components)
    solution = solve(two_link, target, q + 0.1, rotation=rotation)
    np.testing.assert_allclose(solution.q, q, atol=1e-7)
    assert solution.error < 1e-9
    assert solution.rotation_error == pytest.approx(0.4, abs=1e-6)


def test_a_rotation_is_followed_beyond_half_a_turn(ur5, solve):
    """Wanted is 3.3 rad about z, of which the rotation vector of least length is -2.98."""
    target, rotation = wanted(ur5, UR5_POSE, vector=(0, 0, 3.3))
    solution = solve(ur5, target, UR5_POSE - 0.3 * np.eye(6)[5], rotation=rotation)
    np.testing.assert_allclose(solution.q, UR5_POSE, atol=1e-7)


@pytest.mark.parametrize("away", [0.0, 0.7])
def test_its_errors_are_those_of_its_configuration(away, ur5, solve):
    """Within reach and out of it, though the last ones are not evaluated but predicted."""
    target, rotation = wanted(ur5, UR5_POSE, vector=(0.2, -0.1, 0.3))
    target = target + np.array([away, 0, 0])
    solution = solve(ur5, target, UR5_POSE + 0.1, rotation=rotation)
    distance = np.linalg.norm(ur5.tool_position(solution.q[None])[0] - target)
    off = np.linalg.norm(rotation_off(ur5, solution.q, rotation))
    assert solution.error == pytest.approx(distance, abs=1e-10)
    assert solution.rotation_error == pytest.approx(off, abs=1e-10)
    assert (distance > 0.1) == (away > 0)


# Compiled against NumPy.


@pytest.fixture(params=["two_link", "ur5", "panda", "slide", "rail", "followers"])
def arm(request, tmp_path):
    sources = {"rail": (rail_arm(), "flange"), "followers": (follower_arm(), "tip")}
    if request.param not in sources:
        return request.getfixturevalue(request.param)
    text, tool = sources[request.param]
    (tmp_path / "arm.urdf").write_text(text)
    return load_robot(tmp_path / "arm.urdf", tool)


def task(robot, components, rng):
    """Return a tool position in reach, a seed, bounds, a preference and a wanted rotation."""
    low = np.maximum(robot.limits.lower_position, -3.0)
    high = np.minimum(robot.limits.upper_position, 3.0)
    goal = rng.uniform(0.8 * low + 0.2 * high, 0.2 * low + 0.8 * high)
    seed = goal + rng.uniform(-0.3, 0.3, len(goal))
    preferred = goal + rng.uniform(-0.1, 0.1, len(goal))
    position, rotation = wanted(robot, goal, rng.uniform(-0.4, 0.4, 3), components or (1, 1, 1))
    return position, seed, low, high, preferred, rotation if components is not None else None


@NEEDS_LIBRARY
@pytest.mark.parametrize("components", COMPONENTS)
def test_numpy_finds_the_same_configurations(components, arm, by_numpy):
    rng = np.random.default_rng(4)
    for _ in range(6):
        problem = (arm, *task(arm, components, rng))
        one, other = solve_position(*problem), by_numpy(solve_position, *problem)
        np.testing.assert_allclose(one.q, other.q, atol=1e-8)
        assert one.error == pytest.approx(other.error, abs=1e-9)
        assert one.rotation_error == pytest.approx(other.rotation_error, abs=1e-8)


@NEEDS_LIBRARY
def test_bounds_hold_as_in_numpy(arm, by_numpy):
    """So narrow that some joints are held at them, and the tool does not get there."""
    rng = np.random.default_rng(5)
    held = 0
    for _ in range(6):
        position, seed, _, _, preferred, _ = task(arm, None, rng)
        problem = (arm, position, seed, seed - 0.02, seed + 0.02, preferred)
        one, other = solve_position(*problem), by_numpy(solve_position, *problem)
        assert (abs(one.q - seed) <= 0.02 + 1e-15).all()
        assert one.error == pytest.approx(other.error, rel=1e-4, abs=1e-9)
        held += bool((abs(one.q - seed) >= 0.02 - 1e-15).any())
    assert held > 3


@NEEDS_LIBRARY
@pytest.mark.parametrize("components", [None, (1, 1, 0)])
def test_many_are_solved_as_each_by_itself(components, panda, by_numpy):
    """Each with its own target and bounds, or all with one."""
    rng = np.random.default_rng(6)
    tasks = [task(panda, components, rng) for _ in range(5)]
    *columns, rotations = (list(column) for column in zip(*tasks, strict=True))
    columns, rotation = [np.array(column) for column in columns], rotations[0]
    q, errors = solve_positions(panda, *columns, rotation)
    for k, own in enumerate(tasks):
        alone = solve_position(panda, *own[:5], rotation)
        np.testing.assert_array_equal(q[k], alone.q)
        assert errors[k].tolist() == [alone.error, alone.rotation_error]
    other_q, other_errors = by_numpy(solve_positions, panda, *columns, rotation)
    assert q.shape == other_q.shape == (5, 7)
    np.testing.assert_allclose(errors[:, 0], other_errors[:, 0], atol=1e-8)
    shared, _ = solve_positions(
        panda, columns[0][0], columns[1], *(column[0] for column in columns[2:]), rotation
    )
    np.testing.assert_array_equal(shared[0], q[0])
    assert len(shared) == 5
