"""Configurations of tool positions by compiled functions, against those by numpy."""

import numpy as np
import pytest

from follower_arm import follower_arm
from rail_arm import rail_arm
from tubeplanner import load_robot
from tubeplanner.branches import inverse_kinematics
from tubeplanner.branches.inverse_kinematics import (
    WantedRotation,
    solve_position,
    solve_positions,
)
from tubeplanner.native.library import LIBRARY, NativeLibrary
from tubeplanner.tube.rotations import rotation_matrix

pytestmark = pytest.mark.skipif(LIBRARY.functions is None, reason="the library is left out")
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


@pytest.mark.parametrize("components", COMPONENTS)
def test_numpy_finds_the_same_configurations(components, arm, by_numpy):
    rng = np.random.default_rng(4)
    for _ in range(6):
        given = (arm, *task(arm, components, rng))
        one, other = solve_position(*given), by_numpy(solve_position, *given)
        np.testing.assert_allclose(one.q, other.q, atol=1e-8)
        assert one.error == pytest.approx(other.error, abs=1e-9)
        assert one.rotation_error == pytest.approx(other.rotation_error, abs=1e-8)


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


def test_a_stretched_arm_is_bent_as_in_numpy(two_link, by_numpy):
    for bound in (0.0, 3.0):
        lower, upper = np.array([-3.0, bound - 3]), np.array([3.0, bound])
        given = (two_link, np.array([0.5, 0, 0]), np.zeros(2), lower, upper)
        one, other = solve_position(*given), by_numpy(solve_position, *given)
        np.testing.assert_allclose(one.q, other.q, atol=1e-9)
        assert one.error < 1e-9


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
