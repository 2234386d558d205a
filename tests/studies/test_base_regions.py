"""Regions of base poses; free standing; problems with a movable base."""

import numpy as np
import pytest
from gantry import FLOOR, POST, gantry

from tubeplanner import (
    BasePlacement,
    Obstacle,
    OptionError,
    PlanningProblem,
    ProblemError,
    Seed,
    ToolPose,
    Tube,
    load_problem,
    placement_of,
)
from tubeplanner.first_guess.branches import end_configuration
from tubeplanner.orientation import matrix_of_rpy
from tubeplanner.outcome import Infeasible
from tubeplanner.studies.base_regions import (
    MovableProblem,
    Region,
    leading_seeds,
    require_base_free,
)
from tubeplanner.studies.problem_spec import ProblemSpec
from tubeplanner.task.endpoints import Endpoint

# The gantry's base is a cube of 0.1 m whose top is at -0.05: it stands on the floor's top.
ON_FLOOR = ("floor",)
THERE = BasePlacement(-0.2, -0.3, 0.0, -0.5)
POINTS = [[0.4, 0.0, 0.0], [0.35, 0.0, 0.0]]
BELOW = np.array([-0.8, 1.6])  # the elbow is on the right of the way to the tool


def test_a_grid_stands_in_the_middles_of_cells_and_turns_all_the_way():
    grid = Region.of([0.0, 1.0, -1.0, 1.0], 0.25).grid(8 * 8, 0.5)
    base_placements = np.array(grid.base_placements)
    assert grid.spacing == (0.5, 0.5, 0.0, np.pi / 4)
    assert len(base_placements) == len(set(grid.base_placements)) == 64
    np.testing.assert_allclose(np.unique(base_placements[:, 0]), [0.25, 0.75])
    np.testing.assert_allclose(np.unique(base_placements[:, 1]), [-0.75, -0.25, 0.25, 0.75])
    turns = np.sort((base_placements[:8, 3] - 0.5) % (2 * np.pi) / (np.pi / 4))
    np.testing.assert_allclose(turns, np.arange(8), atol=1e-5)
    assert (abs(base_placements[:, 3]) <= np.pi).all()


@pytest.mark.parametrize(
    ("bounds", "count", "columns"),
    [
        ([1, 1, 1, 1], 3, (1, 1, 1, 3)),
        ([0, 1, 0, 1], 25, (2, 3, 1, 4)),
        ([0, 1, 0, 1, 0, 1], 9 * 24, (3, 3, 3, 8)),
        ([0, 900, 0, 1], 72, (9, 1, 1, 8)),
    ],
)
def test_a_grid_has_about_as_many_stands_as_asked_in_cells_as_square_as_can_be(
    bounds, count, columns
):
    region = Region.of(bounds, 0.0)
    base_placements = region.grid(count, 0.0).base_placements
    assert tuple(len(set(values)) for values in zip(*base_placements, strict=True)) == columns
    assert len(base_placements) == np.prod(columns)
    assert all(region.holds(base_placement) for base_placement in base_placements)


def test_the_nearest_stand_is_in_the_region_and_rounded():
    region = Region.of([0.0, 1 / 3, -1.0, 1.0], 0.1)
    assert region.nearest(BasePlacement(2, -2, 0.3, 4.0)) == BasePlacement(
        1 / 3, -1.0, 0.1, round(4 - 2 * np.pi, 6)
    )
    assert region.nearest(BasePlacement(0.12345649, 0.0, 0.1, 1.0)) == BasePlacement(
        0.123456, 0.0, 0.1, 1.0
    )
    assert region.holds(region.nearest(BasePlacement(9, 9, 9, 9)))
    assert not region.holds(BasePlacement(0.1, 0.0, 0.11, 0.0))


@pytest.mark.parametrize(
    ("bounds", "message"),
    [
        ([0, 1, 0, float("nan")], "give X0, X1, Y0, Y1"),
        ([0, 1, 0, True], "give X0, X1, Y0, Y1"),
        ([0, 1, 0.5, 0.2], "y goes from 0.5 to 0.2 m"),
    ],
)
def test_what_is_no_region_is_refused(bounds, message):
    with pytest.raises(OptionError, match=message):
        Region.of(bounds, 0.0)


def at(folder, x, y, **changes):
    """Return the gantry's problem with its base somewhere, beside a post from -0.4 to -0.2."""
    path = gantry(folder, [FLOOR, POST], **changes)
    tube = [[x, y, 0.0], [x + 0.25, y, 0.0], [x + 0.5, y, 0.0]]
    return load_problem(path, changes={"robot.base": {"position": [x, y, 0]}, "tube.points": tube})


def test_a_base_that_stands_in_an_obstacle_is_refused_by_name_and_depth(tmp_path):
    with pytest.raises(Infeasible) as refused:
        require_base_free(at(tmp_path, -0.17, 0.3), ON_FLOOR)
    assert str(refused.value) == "'base', which no joint moves, stands 20.0 mm in 'post'"
    location = refused.value.location
    assert (refused.value.status, location.links, location.obstacle) == (
        "tube_blocked",
        ("base",),
        "post",
    )
    require_base_free(at(tmp_path, -0.14, 0.3), ON_FLOOR)  # beside it, it stands well
    require_base_free(at(tmp_path, -0.17, 0.3), ("floor", "post"))
    require_base_free(load_problem(gantry(tmp_path)))


def test_what_it_stands_on_counts_unless_it_is_named(tmp_path):
    problem = at(tmp_path, 0.3, 0.3, clearance=0.004)
    require_base_free(problem, ON_FLOOR)
    with pytest.raises(Infeasible, match=r"touches 'floor' .clearance 4 mm.$"):
        require_base_free(problem)
    require_base_free(at(tmp_path, 0.3, 0.3))  # touching is standing


@pytest.mark.parametrize(
    ("clearance", "nearest"),
    [
        ({"default": 0.01, "segments": [0.005, 0.02]}, -0.13),
        ({"default": 0.01, "segments": [0.005, 0.005]}, -0.145),
    ],
)
def test_it_keeps_the_clearance_of_the_other_links(tmp_path, clearance, nearest):
    require_base_free(at(tmp_path, nearest + 0.001, 0.3, clearance=clearance), ON_FLOOR)
    with pytest.raises(Infeasible, match=r"from 'post' .clearance"):
        require_base_free(at(tmp_path, nearest - 0.001, 0.3, clearance=clearance), ON_FLOOR)


def test_ignored_pairs_and_moving_links_do_not_count(tmp_path):
    ignoring = at(tmp_path, -0.17, 0.3, collision={"ignore": [["base", "post"]]})
    require_base_free(ignoring, ON_FLOOR)
    roof = {"name": "roof", "box": [1, 1, 0.05], "position": [0, 0, 0.02]}
    require_base_free(load_problem(gantry(tmp_path, [roof])))


def movable(path, **changes):
    return MovableProblem.of(ProblemSpec.read(path).changed(changes))


def test_joints_become_seeds_and_the_tube_stays(tmp_path):
    problem = movable(gantry(tmp_path), **{"goal": {"joints": {"across": 0.0, "along": 0.5}}})
    assert problem.given == BasePlacement(0, 0, 0, 0)
    assert problem.changes(THERE) == {
        "robot.base": {"position": [-0.2, -0.3, 0.0], "rpy": [0.0, 0.0, -0.5]},
        "start": {"seed": [0.0, 0.0]},
        "goal": {"seed": {"across": 0.0, "along": 0.5}},
    }
    loaded = problem.load(THERE)
    assert isinstance(loaded.start, Seed)
    np.testing.assert_array_equal(loaded.goal.joints, [0.5, 0.0])
    np.testing.assert_array_equal(loaded.tube.points[-1], [0.5, 0.0, 0.0])


def test_ends_that_are_of_the_tool_stay_as_they_are(tmp_path):
    pose = {"pose": {"position": [0.0, 0.0, 0.0], "rpy": [0, 0, 0]}}
    goal = {"position": [0.5, 0, 0], "tolerance": 0.001}
    problem = movable(gantry(tmp_path, start=pose, goal=goal))
    assert set(problem.changes(THERE)) == {"robot.base"}
    assert isinstance(problem.load(THERE).start, ToolPose)
    assert movable(gantry(tmp_path, start={"seed": [0.5, 0.5]})).seeds == {}


def test_a_base_keeps_its_roll_and_pitch(tmp_path):
    path = gantry(tmp_path)
    tilted = movable(path, **{"robot.base": {"position": [1, 2, 3], "rpy": [0.1, 0.2, 0.3]}})
    assert (tilted.given, tilted.tilt) == (BasePlacement(1, 2, 3, 0.3), (0.1, 0.2))
    turned = movable(path, **{"robot.base": {"quaternion": [0.1, -0.2, 0.3, 0.9]}})
    own = turned.load(turned.given).robot.base.placement
    as_given = turned.spec.changed({"start": {"seed": [0, 0]}}).load().robot.base.placement
    np.testing.assert_allclose(own, as_given, atol=1e-12)
    moved = turned.load(turned.given._replace(yaw=turned.given.yaw + 0.7)).robot.base.placement
    expected = matrix_of_rpy(0, 0, 0.7) @ as_given[:3, :3]
    np.testing.assert_allclose(moved[:3, :3], expected, atol=1e-12)


def test_what_contradicts_itself_is_refused(tmp_path):
    with pytest.raises(ProblemError, match="gantry: start takes either joints or seed"):
        movable(gantry(tmp_path, start={"joints": [0, 0], "seed": [0, 0]}))


def problem(two_link, seed=BELOW, obstacles=(), points=POINTS):
    return PlanningProblem(two_link, Tube(points, 0.02), Seed(seed), Seed(seed), obstacles)


def post(y):
    return Obstacle.cylinder("post", 0.03, 0.4, placement_of((0.2, y, 0.0)))


def test_a_seed_that_leads_to_a_free_configuration_or_nowhere_stays(two_link):
    far = [[0.9, 0.0, 0.0], [0.8, 0.0, 0.0]]
    for changes in ({}, {"obstacles": [post(0.22)]}, {"points": far}):
        assert leading_seeds(problem(two_link, **changes), ("start", "goal")) == {}


def test_a_seed_that_leads_into_an_obstacle_gives_way_to_the_nearest_that_does_not(two_link):
    blocked = problem(two_link, obstacles=[post(-0.22)])
    found = leading_seeds(blocked, ("start", "goal"))
    assert set(leading_seeds(blocked, ("goal",))) == {"goal"}
    for end, point in (("start", 0), ("goal", -1)):
        q = end_configuration(blocked, Endpoint("seed", seed=np.array(found[end])), point)
        np.testing.assert_allclose(q, found[end], atol=2e-6)
        assert q[1] < 0
        others = q + 2 * np.pi * np.array([[1, 0], [-1, 0]])
        assert np.linalg.norm(q - BELOW) < np.linalg.norm(others - BELOW, axis=1).min()
