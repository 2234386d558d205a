"""The configurations of one segment: joint ranges, tool in a capsule; projection onto it."""

import numpy as np
import pytest
from cases import TOOL_DOWN

from tubeplanner import load_problem
from tubeplanner.native.library import LIBRARY
from tubeplanner.orientation import rotation_matrix
from tubeplanner.studies.tubes import configuration_sets as tool_moves
from tubeplanner.studies.tubes.clearance_bounds import PairClearance
from tubeplanner.studies.tubes.configuration_sets import ConfigurationSet, moved_tools
from tubeplanner.studies.tubes.segment_measurement import folding_joints, is_determined
from tubeplanner.studies.tubes.segment_search import Box, BoxSearch

NEEDS_LIBRARY = pytest.mark.skipif(LIBRARY.functions is None, reason="no native library")
COUNT = 200


@NEEDS_LIBRARY
@pytest.mark.parametrize(
    ("name", "components", "close"),
    [
        ("ur5/over_the_wall", None, (0.0, 0.0)),
        ("ur5/over_the_wall", (True, True, True), (0.02, 0.05)),
        ("panda/between_shelves", (True, False, True), (0.0, 0.0)),
    ],
)
def test_moves_are_those_of_numpy(name, components, close, monkeypatch, bundled):
    problem, rng = bundled(name), np.random.default_rng(3)
    robot, start = problem.robot, problem.start
    bounds = start - 0.5, start + 0.4
    q = rng.uniform(*bounds, (COUNT, len(start)))
    q[: COUNT // 4] = np.round(q[: COUNT // 4] - start) * 0.5 + start  # some at their bounds
    q = np.clip(q, *bounds)
    rotation, tool = robot.tool_pose(start[None])
    wanted, turn = tool + rng.normal(scale=0.1, size=(COUNT, 3)), None
    if components is not None:
        reference = rotation @ rotation_matrix(rng.normal(scale=0.2, size=(COUNT, 3)))
        turned = rng.normal(scale=0.2, size=(COUNT, 3))
        turn = reference, turned, np.array(components)
    found = moved_tools(robot, q, bounds, wanted, np.array(close), turn)
    monkeypatch.setattr(tool_moves, "_move", None)
    expected = moved_tools(robot, q, bounds, wanted, np.array(close), turn)
    apart = abs(found - expected).max(axis=1)
    assert (abs(expected - q).max(axis=1) > 0.05).mean() > 0.5
    # A bound that is just met or not lets a few paths part.
    assert (apart < 1e-7).mean() > 0.97


@NEEDS_LIBRARY
def test_tools_get_where_they_are_wanted(bundled):
    problem, rng = bundled("panda/between_shelves"), np.random.default_rng(4)
    robot, start = problem.robot, problem.start
    rotation, tool = robot.tool_pose(start + rng.uniform(-0.1, 0.1, (COUNT, 7)))
    vector = rng.uniform(-0.1, 0.1, (COUNT, 3))
    reference = rotation @ rotation_matrix(vector).transpose(0, 2, 1)
    turn = reference, vector, np.ones(3, dtype=bool)
    bounds, q = (start - 1, start + 1), np.tile(start, (COUNT, 1))
    moved = moved_tools(robot, q, bounds, tool, np.full(2, 1e-6), turn)
    turned, placed = robot.tool_pose(moved)
    assert abs(placed - tool).max() < 2e-6
    assert abs(turned - rotation).max() < 2e-6


@pytest.fixture(scope="module")
def tray():
    return load_problem("example:ur5/level_tray", changes=TOOL_DOWN)


def test_samples_keep_place_ranges_and_rotation(tray):
    lower, upper = tray.start - 0.5, tray.start + 0.5
    allowed = ConfigurationSet(tray, 0, lower, upper, 0.05)
    q = allowed.sample(300, np.random.default_rng(0))
    assert len(q) > 100
    rotation, tool = tray.robot.tool_pose(q)
    assert (tray.tube.distance(tool)[:, 0] <= 0.05 + 1e-9).all()
    assert (tray.tube.rotation_margin(rotation, tool)[:, 0] >= -1e-9).all()
    assert ((q >= lower) & (q <= upper)).all()
    assert np.ptp(q, axis=0).min() > 0.05
    moved = allowed.back_inside(q + np.random.default_rng(1).normal(scale=0.05, size=q.shape))
    assert allowed.contains(moved).mean() > 0.9


def test_the_least_clearance_is_that_of_all_distances(bundled):
    problem = bundled("ur5/over_the_wall")
    clearance = PairClearance(problem, 0.0)
    q = problem.start + np.random.default_rng(0).normal(scale=0.7, size=(60, len(problem.start)))
    found = clearance.least(q, 0.02)
    checker = problem.collision
    poses = zip(*problem.robot.body_poses(q), strict=True)
    exact = np.array(
        [checker.distances(*pose, clearance.pairs) - clearance.required for pose in poses]
    )
    least = exact.min(axis=1)
    assert ((found.clearance < 0) == (least < 0)).all()
    assert 5 < (least < 0).sum() < 50
    hit = least < 0
    assert found.clearance[hit] == pytest.approx(exact[hit, found.pair[hit]])
    told = np.minimum(found.clearance, 0.02)
    assert (told[~hit] <= least[~hit] + 1e-9).all()


def test_clearance_shrinks_as_its_derivative_says(tray):
    clearance = PairClearance(tray, 0.0)
    q = tray.start + np.random.default_rng(0).normal(scale=0.3, size=(20, 6))
    pair = np.arange(20) % len(clearance.pairs)
    value, slope = clearance.of_pairs(q, pair)
    step = 1e-6 * slope
    moved, _ = clearance.of_pairs(q + step, pair)
    predicted = np.sum(slope * step, axis=1)
    assert np.median(abs(moved - value - predicted)) < 1e-3 * np.median(predicted)


def test_a_box_leaves_all_points_out_and_cannot_grow():
    rng = np.random.default_rng(0)
    beyond = rng.uniform(-1, 1, (400, 4))
    beyond = beyond[beyond.max(axis=1) > 0.2]
    ones = np.ones(4)
    widest = Box(ones, np.full(4, -1))
    search = BoxSearch(1e-9 * ones, ones, ones, 0.05 * ones, rng)
    for count in (50, 200, len(beyond)):
        box = search.best(beyond[:count], widest)
        assert not (beyond[:count] <= box.extent).all(axis=1).any()
        for direction, blocker in enumerate(box.blocker):
            wider = box.extent.copy()
            wider[direction] += 1e-6
            if blocker < 0:
                assert box.extent[direction] == 1
            else:
                assert (beyond[:count] <= wider).all(axis=1).any()


@pytest.mark.parametrize(
    ("name", "joints", "determined"), [("two_link", [1], True), ("panda", [1, 5], False)]
)
def test_folding_joints(name, joints, determined, request):
    robot = request.getfixturevalue(name)
    assert list(folding_joints(robot)) == joints
    assert is_determined(robot) is determined
