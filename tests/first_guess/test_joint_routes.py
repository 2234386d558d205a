"""Free configurations and edges; routes of free edges."""

from itertools import islice, pairwise

import numpy as np
import pytest
from arms import follower_arm
from gantry import gantry

from tubeplanner import load_problem, parse_problem
from tubeplanner.first_guess import joint_routes
from tubeplanner.first_guess.joint_routes import FreeSpace, RouteSearch

GAP = "example:two_link/through_the_gap"
WALL = "example:ur5/past_a_wall"
CELL = {
    "robot": {"urdf": "example:two_link", "tool_frame": "hand", "gravity": [0, 0, 0]},
    "start": {"joints": [0, 0.5]},
    "goal": {"joints": [1.5, 0.5]},
}
FRACTIONS = np.linspace(0, 1, 40)[:, None]


@pytest.fixture(scope="module")
def gap():
    return load_problem(GAP, reads_tube=False)


@pytest.fixture(scope="module")
def wall():
    return load_problem(WALL, reads_tube=False)


def cell(**changes):
    return parse_problem({**CELL, **changes}, reads_tube=False)


def searched(problem):
    return RouteSearch(problem, problem.start, problem.goal[None])


def random_edges(space, problem, count, length, seed=0):
    """Return edges from free configurations in random directions."""
    rng = np.random.default_rng(seed)
    limits, edges = problem.robot.limits, []
    low, high = np.clip((limits.lower_position, limits.upper_position), -3, 3)
    while len(edges) < count:
        q = rng.uniform(low, high)
        if space.is_free(q):
            step = rng.normal(size=len(q))
            edges.append([q, q + rng.uniform(0, length) * step / np.linalg.norm(step)])
    return np.array(edges)


def test_clearance_is_the_distance_beyond_the_required_one():
    ball = [{"name": "ball", "sphere": 0.05, "position": [0.75, 0, 0.02]}]
    problem = cell(start={"joints": [0, 0]}, obstacles=ball, clearance=0.01)
    # The second link ends 0.62 m from the base; see two_link.urdf.
    space = FreeSpace(problem, 0.0, problem.start[None])
    assert space.clearances(problem.start).min() == pytest.approx(
        0.75 - 0.05 - 0.62 - 0.01, abs=1e-6
    )
    assert space.is_free(problem.start)
    wider = FreeSpace(problem, 0.1, np.array([[1.0, 0]]))
    assert wider.shortfall(problem.start).obstacle == "ball"
    # An end that has no more clearance itself does not ask for it.
    assert FreeSpace(problem, 0.1, problem.start[None]).is_free(problem.start)


@pytest.fixture(scope="module")
def followers(tmp_path_factory):
    """Return an arm with turning and sliding joints, some of which follow, and two posts."""
    path = tmp_path_factory.mktemp("arm") / "arm.urdf"
    path.write_text(follower_arm())
    posts = [
        {"name": f"post{k}", "cylinder": [0.05, 3], "position": [0.3, y, 0]}
        for k, y in enumerate((-0.5, 0.6))
    ]
    robot = {"urdf": str(path), "tool_frame": "tip", "joints": ["lift", "first", "wrist"]}
    part = {"name": "part", "box": [0.1, 0.1, 0.1], "position": [0.1, 0, 0], "touch_links": ["tip"]}
    fields = {"robot": {**robot, "attached": [part]}, "start": {"joints": [0.1, 0, 0]}}
    return parse_problem(
        {**fields, "goal": {"joints": [0.1, 0.1, 0]}, "obstacles": posts}, "/", reads_tube=False
    )


@pytest.mark.parametrize(("name", "margin"), [("wall", 0.0), ("wall", 0.02), ("followers", 0.01)])
def test_edges_are_free_where_all_configurations_are(request, name, margin, monkeypatch):
    problem = request.getfixturevalue(name)
    space = FreeSpace(problem, margin, np.array([problem.start, problem.goal]))
    edges = random_edges(space, problem, 40, 1.5)
    free = space.are_free_edges(edges)
    dense = [all(space.is_free(q) for q in a + FRACTIONS * (b - a)) for a, b in edges]
    assert 5 < free.sum() < 35
    # Thinned shapes are up to a millimetre larger.
    assert (free <= dense).all() and (free != dense).sum() <= 2
    monkeypatch.setattr(joint_routes, "_free_edges", None)
    np.testing.assert_array_equal(space.are_free_edges(edges), free)


def test_a_pair_in_contact_at_an_end_may_be_as_near_there_alone(monkeypatch):
    # The second link ends 6 mm from the ball at the start, and nearer if it turns back.
    ball = [{"name": "ball", "sphere": 0.05, "position": [0.675, 0, 0.02]}]
    contact = [{"links": ["link2", "ball"], "within": 0.1}]
    parts = {"start": {"joints": [0.05, 0]}, "obstacles": ball, "clearance": 0.02}
    problem = cell(**parts, contacts=contact)
    near = FreeSpace(problem, 0.0, np.array([problem.start, problem.goal]))
    far = FreeSpace(cell(**parts), 0.0, problem.goal[None])
    assert near.is_free(problem.start) and not far.is_free(problem.start)
    edges = np.array([[[0.05, 0], [1, 0]], [[1, 0], [0.05, 0]], [[1, 0], [0.04, 0]]])
    for native in (joint_routes._free_edges, None):
        monkeypatch.setattr(joint_routes, "_free_edges", native)
        np.testing.assert_array_equal(near.are_free_edges(edges), [True, True, False])
        assert not far.are_free_edges(edges[1:]).any()


def test_a_route_is_free_where_the_straight_line_is_not_and_the_same_for_the_same_seed(gap):
    search = searched(gap)
    route = next(search.routes(1, 9_000))
    np.testing.assert_array_equal(route[[0, -1]], [gap.start, gap.goal])
    assert 0 < search.edges < 9_000
    space = FreeSpace(gap, 0.0, np.array([gap.start, gap.goal]))
    for a, b in pairwise(route):
        assert all(space.is_free(q) for q in a + FRACTIONS * (b - a))
    assert not all(space.is_free(q) for q in gap.start + FRACTIONS * (gap.goal - gap.start))
    again = list(islice(searched(gap).routes(1, 9_000), 2))
    np.testing.assert_array_equal(again[0], route)
    np.testing.assert_array_equal(again[1], next(searched(gap).routes(2, 9_000)))
    assert not np.array_equal(*again)


def test_trees_grow_the_same_without_the_native_library(gap, monkeypatch):
    search = searched(gap)
    trees = [joint_routes._Trees((gap.start[None], gap.goal[None]), 5) for _ in range(2)]
    for own, native in zip(trees, (joint_routes._grow_trees, None), strict=True):
        monkeypatch.setattr(joint_routes, "_grow_trees", native)
        own.reserve(200)
        search._grow(own, 150)
    np.testing.assert_array_equal(trees[0].state, trees[1].state)
    assert trees[0].state[:2].min() > 1
    for tree in range(2):
        np.testing.assert_allclose(*(own.nodes(tree) for own in trees), atol=1e-12)


def test_sliding_joints_find_the_goal_that_can_be_reached(tmp_path):
    walls = [  # one before the first goal; one beside the second, up to a gap
        {"name": "before", "box": [1.4, 0.1, 0.4], "position": [0.5, 0.7, 0]},
        {"name": "beside", "box": [0.1, 0.6, 0.4], "position": [0.4, 0.2, 0]},
    ]
    ends = {"start": {"joints": [0.2, 0.3]}, "goal": {"joints": [0.2, 0.9]}}
    problem = load_problem(gantry(tmp_path, walls, **ends), reads_tube=False)
    goals = np.array([problem.goal, [0.8, 0.3]])
    route = next(RouteSearch(problem, problem.start, goals).routes(1, 20_000))
    np.testing.assert_array_equal(route[[0, -1]], [problem.start, goals[1]])
    assert route[:, 1].max() > 0.5 + 0.02  # past the second wall, beside the ball of the tool
    assert ((route >= 0) & (route <= 1)).all()


def test_a_straight_route_is_the_last():
    problem = cell()
    routes = list(searched(problem).routes(1, 9_000))
    np.testing.assert_array_equal(routes, [[problem.start, problem.goal]])


def test_without_a_route_the_search_ends_after_its_edges_or_when_time_is_over():
    gate = {"name": "gate", "box": [0.5, 0.02, 0.3], "position": [0.4, 0.4, 0]}
    search = searched(cell(obstacles=[{**gate, "rpy": [0, 0, 0.785]}]))
    assert list(search.routes(1, 200)) == []
    assert search.edges == pytest.approx(200, abs=5)
    assert search.reached[0] < 1.5
    assert list(search.routes(1, 200, is_over=lambda: True)) == []
