"""Tubes from start, goal and obstacles alone."""

import builtins
import json
from dataclasses import replace
from importlib import import_module
from itertools import pairwise

import numpy as np
import pytest
from cases import SHORTEST

from measured_tubes import random_attack
from tubeplanner import PlanOptions, RouteOptions, find_route, load_problem, parse_problem, plan
from tubeplanner.errors import OptionError
from tubeplanner.progress import PlanningClock, TimeLimitReached
from tubeplanner.tube_sources.free_space import FreeSpace
from tubeplanner.tube_sources.goal_configurations import goal_configurations
from tubeplanner.tube_sources.joint_route import RouteSearch
from tubeplanner.tube_sources.reference_tube import reference_tube
from tubeplanner.tube_sources.tool_corners import tool_corners

GAP = "example:two_link/through_the_gap"
QUICK = RouteOptions(tries=1, samples=200)
CELL = {
    "robot": {"urdf": "example:two_link", "tool_frame": "hand", "gravity": [0, 0, 0]},
    "start": {"joints": [0, 0.5]},
    "goal": {"joints": [1.5, 0.5]},
}
# Nothing gets past it without leaving the plane.
CLOSED = [
    {"name": "gate", "box": [0.5, 0.02, 0.3], "position": [0.4, 0.4, 0], "rpy": [0, 0, 0.785]}
]


@pytest.fixture(scope="module")
def gap():
    return load_problem(GAP, reads_tube=False)


@pytest.fixture(scope="module")
def searched(gap):
    ends = np.array([gap.start, gap.goal])
    space = FreeSpace(gap, 0.01, ends)
    limits = gap.robot.limits
    search = RouteSearch(space, gap.start, ends[1:], limits.lower_position, limits.upper_position)
    return space, search, search.route(1, 20_000)


@pytest.fixture(scope="module")
def answer(gap):
    return find_route(gap, QUICK)


def cell(**changes):
    return parse_problem({**CELL, **changes}, reads_tube=False)


# --- the steps ----------------------------------------------------------------------------------


def test_a_route_goes_from_start_to_goal_and_is_free(gap, searched):
    space, search, route = searched
    np.testing.assert_allclose(route[0], gap.start)
    np.testing.assert_allclose(route[-1], gap.goal)
    assert search.checks > 0
    for a, b in pairwise(route):
        assert all(space.is_free(a + share * (b - a)) for share in np.linspace(0, 1, 20))


def test_the_straight_way_was_not_free(gap, searched):
    space = searched[0]
    line = gap.start + np.linspace(0, 1, 50)[:, None] * (gap.goal - gap.start)
    assert not all(space.is_free(q) for q in line)


def test_the_same_seed_gives_the_same_route(searched):
    _, search, route = searched
    assert not np.array_equal(search.route(2, 20_000), route)
    np.testing.assert_array_equal(search.route(1, 20_000), route)


def test_lines_between_corners_are_straight_and_free(gap, searched):
    space, _, route = searched
    corners = tool_corners(gap.robot, space, route)
    assert 3 <= len(corners.points) <= 5
    for a, b, q in zip(corners.points, corners.points[1:], corners.lines, strict=False):
        tool = gap.robot.tool_position(q)
        np.testing.assert_allclose(tool[[0, -1]], [a, b], atol=1e-5)
        away = (
            tool - a - np.clip((tool - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)[:, None] * (b - a)
        )
        assert np.linalg.norm(away, axis=1).max() < 1e-5
        assert abs(np.diff(q, axis=0)).max() <= 0.3
        assert all(space.is_free(each) for each in q)


def test_more_corners_follow_a_route_more_closely(gap, searched):
    space, _, route = searched
    coarse = tool_corners(gap.robot, space, route)
    fine = tool_corners(gap.robot, space, route, deviation=0.005)
    assert len(fine.points) > len(coarse.points)


def test_clearance_is_the_distance_beyond_what_is_asked():
    ball = [{"name": "ball", "sphere": 0.05, "position": [0.75, 0, 0.02]}]
    data = {"start": {"joints": [0, 0]}, "obstacles": ball, "clearance": 0.01}
    problem = cell(**data)
    # The second link ends 0.62 m from the base; see two_link.urdf.
    space = FreeSpace(problem, 0.0, problem.start[None])
    assert space.clearance(problem.start) == pytest.approx(0.75 - 0.05 - 0.62 - 0.01, abs=1e-6)
    assert space.is_free(problem.start)
    wider = FreeSpace(problem, 0.1, np.array([[1.0, 0]]))
    assert wider.lacking(problem.start).obstacle == "ball"
    # An end that has no more clearance itself does not ask for it.
    assert FreeSpace(problem, 0.1, problem.start[None]).is_free(problem.start)


def test_a_tool_position_has_several_configurations(two_link):
    problem = cell(goal={"position": [0.3, 0.3, 0]})
    goals = goal_configurations(problem, problem.start, seed=1)
    assert {np.sign(q[1]) for q in goals} == {1.0, -1.0}
    np.testing.assert_allclose(
        two_link.tool_position(goals), [[0.3, 0.3, 0]] * len(goals), atol=2e-6
    )
    assert abs(goals[0] - problem.start).max() == min(abs(goals - problem.start).max(axis=1))


def test_signs_that_hold_everywhere_are_kept(two_link):
    lines = [np.array([[0.1, -0.5], [0.4, 0.2]]), np.array([[0.4, 0.2], [0.6, 0.3]])]
    points = two_link.tool_position(np.array([[0.1, -0.5], [0.4, 0.2], [0.6, 0.3]]))
    tube = reference_tube(two_link, points, lines, 0.25, 0.05)
    assert tube.joint_ranges[0] == {"joint1": (0.0, 0.65), "joint2": (-0.75, 0.45)}
    assert tube.joint_ranges[1] == {"joint1": (0.15, 0.85), "joint2": (-0.05, 0.55)}


# --- the answer ---------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_tube_of_a_route_is_planned_and_certified(gap, answer):
    assert answer.succeeded
    problem = answer.found.problem
    again = plan(problem)
    assert again.succeeded and again.duration == answer.found.duration
    np.testing.assert_allclose(problem.goal, gap.goal)
    assert 2 <= len(answer.compared) <= 3
    assert answer.found.duration <= min(answer.compared)


@pytest.mark.slow
def test_the_measured_tube_is_offered_beside_the_faster_motion(answer):
    measured = answer.measured
    assert measured is not answer.found
    assert measured.result.succeeded and measured.duration > answer.found.duration
    rng = np.random.default_rng(3)
    for k in range(measured.problem.tube.segment_count):
        assert random_attack(measured.problem, k, 500, rng).collisions == 0
    fields = answer.as_dict()
    assert fields["duration"] == answer.found.duration
    assert fields["measured"]["duration"] == measured.duration
    assert fields["measured"]["radius"] == measured.problem.tube.radius.tolist()
    assert fields["radius"] == [0.05] * len(fields["radius"])


@pytest.mark.slow
def test_one_progress_tells_of_the_whole(gap):
    told = []
    find_route(gap, QUICK, told.append)
    steps = [int(each.stage.split()[1]) for each in told]
    assert all(each.stage.startswith("step ") for each in told)
    assert steps == sorted(steps) and set(steps) == {1, 2, 3, 4}
    best = [each.best_duration for each in told if each.best_duration is not None]
    assert best == sorted(best, reverse=True)
    assert told[-1].best_duration is not None and told[0].best_duration is None


def stopping(gap, monkeypatch, at, error):
    """Find a route whose work is ended as a step begins."""

    def enter(self, progress, announce=PlanningClock.announce):
        announce(self, progress)
        if at in progress.stage:
            raise error

    monkeypatch.setattr(PlanningClock, "announce", enter)
    return find_route(gap, QUICK)


@pytest.mark.parametrize(
    ("error", "name"), [(TimeLimitReached(), "time_limit"), (KeyboardInterrupt(), "interrupt")]
)
def test_what_is_certified_is_the_answer_when_it_is_ended(gap, monkeypatch, error, name):
    answer = stopping(gap, monkeypatch, "measuring segment", error)
    assert answer.succeeded and answer.stopped_by == name
    assert answer.found.duration == pytest.approx(min(answer.compared), rel=0.02)
    assert answer.measured is None
    assert answer.as_dict()["stopped_by"] == name and answer.as_dict()["measured"] is None
    how = name.replace("_", " ")
    noted = f"the search was stopped by {how} in step 4 of 4: there may be a faster tube"
    assert noted in answer.notes


def test_a_file_for_a_measured_tube_that_is_not_there_is_told(run, monkeypatch, tmp_path, answer):
    module = import_module("tubeplanner.tube_sources.route")
    monkeypatch.setattr(module, "find_route", lambda *_: replace(answer, measured=None))
    files = [tmp_path / "fast.yaml", tmp_path / "measured.yaml"]
    status, out, _ = run("route", GAP, "-o", files[0], "--measured", files[1])
    assert status == 0
    assert f"note: {files[1]} was not written: there is no measured tube" in out.splitlines()
    assert files[0].exists() and not files[1].exists()
    _, out, _ = run("route", GAP, "-o", files[0])
    assert "not written" not in out


def test_ended_before_anything_is_certified(gap, monkeypatch):
    answer = stopping(gap, monkeypatch, "planning along", TimeLimitReached())
    assert answer.status == "time_limit" and answer.stopped_by == "time_limit"
    assert answer.found is None


def test_interrupted_before_anything_is_certified(gap, monkeypatch):
    with pytest.raises(KeyboardInterrupt):
        stopping(gap, monkeypatch, "planning along", KeyboardInterrupt())


def test_a_time_limit_of_no_length_is_kept(gap):
    answer = find_route(gap, RouteOptions(time_limit=1e-6))
    assert answer.status == "time_limit"
    assert answer.message.startswith("the time limit of 1e-06 s passed before the end of: ")
    with pytest.raises(OptionError, match="time_limit is -1 s"):
        RouteOptions(time_limit=-1)


@pytest.mark.slow
def test_both_tubes_go_to_files_that_plan(run, tmp_path, answer):
    files = [tmp_path / "fast.yaml", tmp_path / "measured.yaml"]
    options = ("--tries", 1, "--samples", 200, "-o", files[0], "--measured", files[1])
    status, out, _ = run("route", GAP, *options)
    assert status == 0
    assert "measured tube, in which nothing collides: " in out
    # The answer is smooth; tubes are compared by their shortest motions.
    cases = ((answer.found, PlanOptions()), (answer.measured, SHORTEST))
    for path, (tube, options) in zip(files, cases, strict=True):
        assert str(path) in out
        assert plan(load_problem(path), options).duration == pytest.approx(tube.duration, rel=1e-6)


def test_a_start_in_collision_is_an_answer_with_its_place(run, tmp_path):
    ball = {"name": "ball", "sphere": 0.1, "position": [0.3, 0, 0]}
    path = tmp_path / "blocked.json"
    path.write_text(json.dumps({**CELL, "obstacles": [ball]}))
    status, out, _ = run("route", path, "--json", "-o", tmp_path / "no.yaml")
    report = json.loads(out)
    assert status == 1 and report["status"] == "tube_blocked"
    assert "in the start configuration" in report["message"]
    assert report["where"]["obstacle"] == "ball"
    assert not (tmp_path / "no.yaml").exists()


def test_no_route_is_an_answer_with_how_far_it_came():
    answer = find_route(cell(obstacles=CLOSED), RouteOptions(tries=1, checks=300))
    assert answer.status == "no_trajectory"
    assert answer.message.startswith("no route was found in 3 tries of 300 configurations;")
    assert answer.place.position is not None


def test_a_goal_out_of_reach_is_named():
    answer = find_route(cell(goal={"position": [0.5, 0.5, 0]}))
    assert answer.status == "unreachable"
    assert (
        "no configuration was found for the goal: the tool was brought no nearer than 0.1071 m"
        in (answer.message)
    )


@pytest.mark.slow
def test_a_robot_without_geometry_needs_no_way_around():
    data = {**CELL, "robot": {"urdf": "example:asr_twodof", "tool_frame": "Tip"}}
    problem = parse_problem({**data, "goal": {"joints": [1.0, 0.9]}}, reads_tube=False)
    assert find_route(problem, QUICK).succeeded


def test_without_ompl_the_message_says_what_to_install(monkeypatch):
    real = builtins.__import__

    def without(name, *rest, **more):
        if name.startswith("ompl"):
            raise ImportError(name)
        return real(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(OptionError, match=r"pip install -e '\.\[route\]'"):
        find_route(cell())


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"seed": 0}, "seed is 0; it must be >= 1"),
        ({"tries": 0}, "tries is 0; it must be >= 1"),
        ({"max_radius": 0.0}, "max_radius is 0 m; it must be > 0 and finite"),
        ({"band": np.nan}, "band is nan; it must be > 0 and finite"),
    ],
)
def test_options_out_of_range_are_named(changes, message):
    with pytest.raises(OptionError, match=message):
        RouteOptions(**changes)


# --- the command --------------------------------------------------------------------------------


def test_the_command_writes_a_problem_that_plan_plans(run, tmp_path):
    data = {**CELL, "goal": {"position": [0.1, 0.5, 0]}}
    (tmp_path / "cell.json").write_text(json.dumps(data))
    target = tmp_path / "tube.yaml"
    status, out, _ = run(
        "route", tmp_path / "cell.json", "-o", target, "--tries", 1, "--samples", 200, "--json"
    )
    report = json.loads(out)
    assert status == 0 and report["status"] == "success"
    assert report["problem"] == str(target)
    assert len(report["points"]) == len(report["radius"]) + 1
    planned = json.loads(run("plan", target, "--json")[1])
    assert planned["duration"] == report["duration"]


def test_bad_input_ends_with_status_2(run):
    status, _, err = run("route", "example:two_link/around_a_post")
    assert status == 2 and "start.joints is required" in err
    status, _, err = run("route", GAP, "--tries", 0)
    assert status == 2 and "tries is 0" in err
    status, _, err = run("plan", GAP)
    assert status == 2 and "tube is required; `tubeplanner route` finds one" in err
