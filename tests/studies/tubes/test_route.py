"""Motions from start, goal and obstacles alone."""

import json
from dataclasses import replace

import numpy as np
import pytest
from cases import SHORTEST

from measured_tubes import random_attack
from tubeplanner import PlanOptions, RouteOptions, find_route, load_problem, parse_problem, plan
from tubeplanner.errors import OptionError
from tubeplanner.first_guess.joint_routes import FreeSpace, RouteSearch
from tubeplanner.limits.lower_bound import lower_bound
from tubeplanner.orientation import quaternion_of_matrix
from tubeplanner.outcome import TimeLimitReached
from tubeplanner.planning.free_plans import goal_configurations
from tubeplanner.studies.tubes.routes import reference_tube, tool_corners

GAP = "example:two_link/through_the_gap"
QUICK = RouteOptions(edges=400, samples=200, measures=True)
CELL = {
    "robot": {"urdf": "example:two_link", "tool_frame": "hand", "gravity": [0, 0, 0]},
    "start": {"joints": [0, 0.5]},
    "goal": {"joints": [1.5, 0.5]},
}
# Nothing gets past it without leaving the plane.
GATE = {"name": "gate", "box": [0.5, 0.02, 0.3], "position": [0.4, 0.4, 0], "rpy": [0, 0, 0.785]}
FAR = {"position": [0.5, 0.5, 0]}
NO_GOAL = "no configuration was found for the goal: the tool stops 0.1071 m short, from "
NO_ROUTE = "no route was found by 30"


@pytest.fixture(scope="module")
def gap():
    return load_problem(GAP, reads_tube=False)


@pytest.fixture(scope="module")
def searched(gap):
    """Return the free space and the route of seed 1."""
    ends = np.array([gap.start, gap.goal])
    return FreeSpace(gap, 0.0, ends), next(RouteSearch(gap, ends[0], ends[1:]).routes(1, 9_000))


@pytest.fixture(scope="module")
def answered(gap):
    """Return the answer of a whole search, and the progress that it told."""
    told = []
    return find_route(gap, QUICK, told.append), told


@pytest.fixture(scope="module")
def late():
    """Return the answer of a search whose time passes while it measures."""
    return stopped("step 3 of 3", TimeLimitReached())


def cell(**changes):
    return parse_problem({**CELL, **changes}, reads_tube=False)


def stopped(stage, error, problem=None):
    """Return the answer of a search that ends as a stage begins."""

    def show(progress):
        if progress.stage.startswith(stage):
            raise error

    return find_route(problem or cell(), QUICK, show)


def answer_with(monkeypatch, answer):
    """Let the command find an answer; return a list that gets its options."""
    asked = []

    def find(problem, options, progress):
        asked.append(options)
        return answer

    monkeypatch.setattr("tubeplanner.cli.tubes.find_route", find)
    return asked


def test_lines_between_corners_are_straight_and_free(gap, searched):
    space, route = searched
    corners = tool_corners(space, route)
    assert 3 <= len(corners.points) <= 5
    for a, b, q in zip(corners.points, corners.points[1:], corners.lines, strict=False):
        tool = gap.robot.tool_position(q)
        np.testing.assert_allclose(tool[[0, -1]], [a, b], atol=1e-5)
        along = np.clip((tool - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)[:, None]
        assert np.linalg.norm(tool - a - along * (b - a), axis=1).max() < 1e-5
        assert abs(np.diff(q, axis=0)).max() <= 0.3
        assert all(space.is_free(each) for each in q)
    fine = tool_corners(space, route, deviation=0.005)
    assert len(fine.points) > len(corners.points)


def test_a_tool_position_has_several_configurations(two_link):
    problem = cell(goal={"position": [0.3, 0.3, 0]})
    goals = goal_configurations(problem, problem.start, seed=1)
    assert {np.sign(q[1]) for q in goals} == {1.0, -1.0}
    tool = two_link.tool_position(goals)
    np.testing.assert_allclose(tool, [[0.3, 0.3, 0]] * len(goals), atol=2e-6)
    least = [lower_bound(replace(problem, goal=q)).duration for q in goals]
    assert least == sorted(least)


def test_signs_that_hold_everywhere_are_kept(two_link):
    q = np.array([[0.1, -0.5], [0.4, 0.2], [0.6, 0.3]])
    tube = reference_tube(two_link, two_link.tool_position(q), [q[:2], q[1:]], 0.25, 0.05)
    assert tube.joint_ranges[0] == {"joint1": (0.0, 0.65), "joint2": (-0.75, 0.45)}
    assert tube.joint_ranges[1] == {"joint1": (0.15, 0.85), "joint2": (-0.05, 0.55)}


@pytest.mark.dear("searches and plans along routes through a gap, and measures a tube")
def test_the_motion_of_a_route_is_planned_and_a_measured_tube_offered_beside_it(gap, answered):
    answer, told = answered
    found, measured = answer.answer, answer.measured
    assert answer.succeeded
    np.testing.assert_allclose(found.problem.goal, gap.goal)
    assert 0 < answer.first_answer_time <= answer.search_time
    assert answer.routes >= 1 and 400 <= answer.edges < 500
    assert measured.result.succeeded and measured.duration > found.duration
    rng = np.random.default_rng(3)
    for k in range(measured.problem.tube.segment_count):
        assert random_attack(measured.problem, k, 500, rng).collisions == 0
    fields = answer.as_dict()
    assert fields["duration"] == found.duration
    assert fields["bound"]["duration"] <= found.duration
    assert fields["route"] == found.problem.tube.route.tolist() and fields["points"] is None
    assert fields["measured"]["duration"] == measured.duration
    assert fields["measured"]["radius"] == measured.problem.tube.radius.tolist()
    steps = [int(each.stage.removeprefix("step ")[0]) for each in told]
    assert steps == sorted(steps) and set(steps) == {1, 2, 3}
    best = [each.best_duration for each in told if each.best_duration is not None]
    assert best == sorted(best, reverse=True) and told[0].best_duration is None


@pytest.mark.dear("plans along the route and in the measured tube again")
def test_route_and_measured_tube_go_to_files_that_plan(run, monkeypatch, tmp_path, answered):
    answer, _ = answered
    asked = answer_with(monkeypatch, answer)
    files = [tmp_path / "fast.yaml", tmp_path / "measured.yaml"]
    motion = tmp_path / "t.json"
    words = ("route", GAP, "--edges", 400, "--samples", 200, "-o", files[0], "--measured", files[1])
    status, out, _ = run(*words, "--trajectory", motion)
    assert status == 0 and asked == [QUICK]
    assert "measured tube, in which nothing collides: " in out
    # The answer is smooth; the measured tube has its shortest motion.
    cases = ((answer.answer, PlanOptions()), (answer.measured, SHORTEST))
    for path, (tube, options) in zip(files, cases, strict=True):
        assert str(path) in out
        assert plan(load_problem(path), options).duration == pytest.approx(tube.duration, rel=1e-6)
    assert run("check", files[0], motion)[0] == 0
    report = json.loads(run(*words, "--json")[1])
    assert (report["status"], report["problem"]) == ("success", str(files[0]))
    assert run("route", GAP, "-o", files[0])[0] == 0 and not asked[-1].measures


def test_a_robot_without_geometry_needs_no_way_around():
    robot = {"urdf": "example:asr_twodof", "tool_frame": "Tip"}
    problem = cell(robot=robot, goal={"joints": [1.0, 0.9]})
    answer = find_route(problem, QUICK)
    assert answer.succeeded and answer.routes == answer.edges == 0


def test_what_is_certified_is_the_answer_when_time_passes_or_it_is_interrupted(gap, late):
    interrupted = stopped("step 2 of 3, route 2, refine", KeyboardInterrupt(), gap)
    for answer, name, step in ((late, "time_limit", 3), (interrupted, "interrupt", 2)):
        assert answer.succeeded and answer.stopped_by == name
        assert answer.measured is None
        assert answer.as_dict()["stopped_by"] == name and answer.as_dict()["measured"] is None
        assert (
            f"the search was stopped by {name.replace('_', ' ')} in step {step} of 3: there may be "
            "a faster motion"
        ) in answer.notes


def test_a_file_for_a_measured_tube_that_is_not_there_is_told(run, monkeypatch, tmp_path, late):
    answer_with(monkeypatch, replace(late, stopped_by=None))
    files = [tmp_path / "fast.yaml", tmp_path / "measured.yaml"]
    status, out, _ = run("route", GAP, "-o", files[0], "--measured", files[1])
    assert status == 0
    assert f"note: {files[1]} was not written: there is no measured tube" in out.splitlines()
    assert files[0].exists() and not files[1].exists()
    assert "not written" not in run("route", GAP, "-o", files[0])[1]


def test_ended_before_anything_is_certified_there_is_none():
    answer = stopped("step 1 of 3", TimeLimitReached())
    assert answer.status == "time_limit" and answer.stopped_by == "time_limit"
    assert answer.answer is None
    with pytest.raises(KeyboardInterrupt):
        stopped("step 1 of 3", KeyboardInterrupt())


@pytest.mark.parametrize(
    ("changes", "options", "status", "message"),
    [
        ({"obstacles": [GATE]}, {"edges": 300}, "no_trajectory", NO_ROUTE),
        ({"goal": FAR}, {}, "unreachable", NO_GOAL),
        ({}, {"time_limit": 1e-6}, "time_limit", "the time limit of 1e-06 s passed before the end"),
    ],
)
def test_without_an_answer_the_reason_is_named(changes, options, status, message):
    answer = find_route(cell(**changes), RouteOptions(**options))
    assert answer.status == status and message in answer.message
    assert (answer.location.position is None) == (status == "time_limit")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"seed": 0}, "seed is 0; it must be >= 1"),
        ({"max_radius": 0.0}, "max_radius is 0 m; it must be > 0 and finite"),
        ({"band": np.nan}, "band is nan; it must be > 0 and finite"),
        ({"time_limit": -1}, "time_limit is -1 s"),
    ],
)
def test_options_out_of_range_are_named(changes, message):
    with pytest.raises(OptionError, match=message):
        RouteOptions(**changes)


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


def test_bad_input_ends_with_status_2(run):
    status, _, err = run("route", GAP, "--edges", 0)
    assert status == 2 and "edges is 0; it must be >= 1" in err


def test_of_the_configurations_of_a_pose_the_one_with_the_least_bound_comes_first():
    joints = [1.5, -0.5]
    near = cell(goal={"joints": joints})
    rotation, position = near.robot.tool_pose(near.goal[None])
    pose = {
        "position": position[0].tolist(),
        "quaternion": quaternion_of_matrix(rotation)[0].tolist(),
    }
    problem = cell(goal={"pose": pose})
    goals = goal_configurations(problem, problem.start, seed=1)
    least = [lower_bound(replace(problem, goal=q)).duration for q in goals]
    assert least == sorted(least)
    answer = find_route(problem, QUICK)
    assert answer.succeeded
    np.testing.assert_allclose(answer.answer.problem.goal, joints, atol=1e-6)
    assert answer.answer.result.bound.duration <= least[0]


def test_a_goal_where_the_arm_begins_is_a_rest():
    problem = load_problem("example:two_link/through_the_gap", reads_tube=False)
    answer = find_route(replace(problem, goal=problem.start))
    assert answer.succeeded, answer.message
    assert "nothing to do" in " ".join(answer.answer.result.notes)
