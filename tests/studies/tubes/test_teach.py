"""teach: a tube from a recorded trail, unwrapped, without pauses and detours."""

import json
import re
from itertools import pairwise

import numpy as np
import pytest
from arms import joint, links, loaded
from click.testing import CliRunner

from tubeplanner import TeachOptions, load_problem
from tubeplanner.cli.main import cli
from tubeplanner.errors import OptionError, TrajectoryError
from tubeplanner.first_guess.inverse_kinematics import solve_position
from tubeplanner.studies.tubes.teach import joint_trail, moving_part, without_ways_back

CORNERS = np.array([[0.0, -1.2], [0.4, -1.6], [1.2, -1.6], [1.6, -0.8]])
POST = "obstacles: [{name: post, cylinder: [0.02, 0.3], position: [0.55, 0.25, 0]}]\n"
WALL = "obstacles: [{name: wall, box: [0.2, 0.2, 0.3], position: [0.3, 0.3, 0]}]\n"
ROBOT = ("--urdf", "example:two_link", "--tool-frame", "hand")
UR5 = "example:ur5/past_a_wall"


def lines(*corners, count=40):
    """Return joint lines between corners, `count` samples each."""
    return np.vstack([np.linspace(a, b, count) for a, b in pairwise(corners)])


def write_trail(path, names, q):
    """Write joint values of so many samples as a recorder would."""
    rows = [",".join(["time", *(f"{name}.position" for name in names)])]
    rows += [",".join(f"{value:.6g}" for value in [0.02 * k, *row]) for k, row in enumerate(q)]
    path.write_text("\n".join(rows) + "\n")
    return path


def recorded(path, corners):
    """Write a trail with noise, pauses and a joint more; return its configurations."""
    parts = [np.vstack([np.tile(a, (30, 1)), np.linspace(a, b, 60)]) for a, b in pairwise(corners)]
    q = np.vstack([*parts, np.tile(corners[-1], (50, 1))])
    q = q + np.random.default_rng(0).normal(0, 1e-3, q.shape)
    columns = np.column_stack([q[:, 1], np.zeros(len(q)), q[:, 0]])
    write_trail(path, ["joint2", "gripper", "joint1"], columns)
    return q


def test_columns_are_matched_by_name_and_others_left_out(two_link):
    samples = np.array([[9.0, 0.2, 0.1], [9.0, 0.4, 0.3]])
    trail = joint_trail(two_link, ["gripper", "joint2", "joint1"], samples)
    np.testing.assert_array_equal(trail, [[0.1, 0.2], [0.3, 0.4]])
    with pytest.raises(TrajectoryError) as caught:
        joint_trail(two_link, ["joint1", "elbow"], np.zeros((2, 2)))
    assert str(caught.value) == "the trail has no joint joint2; its joints are joint1, elbow"


def test_degrees_are_noticed_and_noise_at_a_limit_is_no_fault(two_link):
    with pytest.raises(TrajectoryError, match=r"'joint1' at 30 in sample 1, outside its position"):
        joint_trail(two_link, two_link.joint_names, np.array([[0.0, 0.0], [30.0, -45.0]]))
    upper = two_link.limits.upper_position
    trail = joint_trail(two_link, two_link.joint_names, np.array([upper + 0.005, upper - 1]))
    assert (trail <= upper).all()


def test_continuous_joints_are_unwrapped(tmp_path):
    detour = joint("turn", "base", "arm", "continuous", limit='<limit effort="10" velocity="1"/>')
    robot = loaded(tmp_path, links("base", "arm"), detour, tool="arm")
    turning = np.linspace(0, 9, 50)[:, None]
    wrapped = (turning + np.pi) % (2 * np.pi) - np.pi
    np.testing.assert_allclose(joint_trail(robot, ["turn"], wrapped), turning, atol=1e-6)


def test_pauses_duplicates_and_noise_are_dropped_and_the_ends_are_kept():
    q = np.repeat(lines([0, 0], [1, 0.5]), 5, axis=0)
    noisy = q + np.random.default_rng(0).normal(0, 1e-3, q.shape)
    moving = moving_part(noisy)
    assert 20 < len(moving) < 45
    np.testing.assert_array_equal(moving[[0, -1]], noisy[[0, -1]])
    assert abs(np.diff(moving[:-1], axis=0)).max(axis=1).min() >= 0.02
    short = np.array([[0.0, 0.0], [0.03, 0.0], [0.04, 0.0]])
    np.testing.assert_array_equal(moving_part(short)[[0, -1]], short[[0, -1]])


def test_a_way_out_and_back_is_left_out(two_link):
    start, side, detour, end = [0, 0.5], [0.6, 0.5], [1.0, 0.9], [1.2, 0.2]
    q = lines(start, side, detour, side, end)
    kept, detours = without_ways_back(two_link, q, 0.01)
    there = two_link.tool_position(np.array([detour]))[0]
    np.testing.assert_allclose(detours, [there], atol=0.02)
    assert np.linalg.norm(two_link.tool_position(kept) - there, axis=1).min() > 0.05
    np.testing.assert_array_equal(kept[[0, -1]], q[[0, -1]])
    assert abs(np.diff(kept, axis=0)).max() < 0.25


def test_a_way_back_along_a_straight_line_is_left_out_too(two_link):
    """No distance from the line between start and end shows it."""
    line = np.linspace([0.3, -0.3, 0], [0.3, 0.3, 0], 80)
    q, free = [np.array([-0.3, 1.0])], np.full(2, np.inf)
    for point in np.vstack([line[:60], line[60:20:-1], line[20:]]):
        q.append(solve_position(two_link, point, q[-1], -free, free).q)
    kept, detours = without_ways_back(two_link, np.array(q[1:]), 0.03)
    np.testing.assert_allclose(detours, line[60:61], atol=0.01)
    assert (np.diff(two_link.tool_position(kept)[:, 1]) > -1e-9).all()


def test_a_way_around_is_no_way_back(two_link):
    q = lines([0, 0.5], [0.8, 0.5], [0.8, 1.5], [0, 1.5], [0, 0.5])
    kept, detours = without_ways_back(two_link, q, 0.01)
    assert detours == [] and len(kept) == len(q)


def test_trails_that_lead_nowhere_are_refused(two_link):
    with pytest.raises(TrajectoryError, match=r"does not move: .* in 30 samples"):
        moving_part(np.random.default_rng(1).normal(0, 1e-3, (30, 2)))
    with pytest.raises(TrajectoryError, match="comes back the way it went; record the way out and"):
        without_ways_back(two_link, lines([0, 0.5], [0.8, 0.5], [0, 0.5]), 0.01)


@pytest.fixture(scope="module")
def taught(tmp_path_factory):
    """Return the folder, the trail and the command's report, of a trail with all that is wrong."""
    folder = tmp_path_factory.mktemp("taught")
    there = CORNERS[1] + 0.7 * (CORNERS[2] - CORNERS[1])
    q = recorded(folder / "trail.csv", np.vstack([CORNERS[:2], there, CORNERS[1:]]))
    (folder / "post.yaml").write_text(POST)
    arguments = ["teach", folder / "trail.csv", *ROBOT, "--obstacles", folder / "post.yaml"]
    arguments += ["-o", folder / "tube.yaml", "--samples", 50, "--deviation", 0.03, "--json"]
    done = CliRunner().invoke(cli, [str(word) for word in arguments], standalone_mode=False)
    assert done.return_value == 0, done.output
    return folder, q, json.loads(done.stdout)


def test_a_noisy_trail_becomes_few_points_near_it(taught, two_link):
    folder, q, report = taught
    assert report["status"] == "success"
    assert 3 <= len(report["points"]) <= 6
    assert len([note for note in report["notes"] if note.startswith("removed: a detour")]) == 1
    tube = load_problem(folder / "tube.yaml").tube
    distance = tube.distance(two_link.tool_position(q)).min(axis=1)
    assert distance.max() < 0.03 + 0.02  # samples that were dropped are near those that were not
    assert all(ranges["joint2"][1] <= 0 for ranges in tube.joint_ranges if "joint2" in ranges)


def test_the_written_problem_is_planned_from_the_trails_start_to_its_end(taught, run):
    folder, q, report = taught
    problem = load_problem(folder / "tube.yaml")
    np.testing.assert_allclose([problem.start, problem.goal], q[[0, -1]], atol=1e-5)
    assert [obstacle.name for obstacle in problem.obstacles] == ["post"]
    planned = json.loads(run("plan", folder / "tube.yaml", "--json")[1])
    assert planned["status"] == "success" and planned["duration"] == report["duration"]


def test_what_the_trail_saved_is_said(taught):
    _, q, report = taught
    assert report["recorded_duration"] == pytest.approx(0.02 * (len(q) - 1))


@pytest.mark.dear("measures a tube")
def test_a_template_keeps_its_tolerances_and_what_is_not_kept_is_named(run, tmp_path):
    q = write_trail(tmp_path / "trail.csv", ["joint1", "joint2"], lines([0.0, -1.2], [0.8, -1.2]))
    detour = [0.0, 0.0, 0.0, 1.0]
    tube = {
        **{"points": [[0.4, 0, 0], [0.5, 0, 0], [0.5, 0.1, 0]], "radius": 0.1, "visit": "any"},
        **{"orientations": [detour] * 3, "rotation_tolerance": 1.0, "tool_speed": [2.0, 2.0]},
    }
    robot = {"urdf": "example:two_link", "tool_frame": "hand"}
    goal = {"position": [0.5, 0.1, 0], "tolerance": 0.01}
    fields = {"robot": robot, "tube": tube, "start": {"seed": [0, -1]}, "goal": goal}
    (tmp_path / "cell.json").write_text(json.dumps(fields))
    files = ("--problem", tmp_path / "cell.json", "-o", tmp_path / "tube.json")
    status, out, _ = run("teach", q, *files, "--samples", 50)
    assert status == 0, out
    assert "rotation_tolerance 1.0, about the trail's orientations" in out
    assert "not kept of the problem: tube.visit, goal.position, goal.tolerance; " in out
    assert re.search(r"recorded 0\.780 s -> planned 0\.\d+ s, \d+\.\d% less", out)
    tube = load_problem(tmp_path / "tube.json").tube
    assert set(tube.rotation_tolerance) == {1.0} and set(tube.tool_speed) == {2.0}


def test_a_trail_through_an_obstacle_is_an_answer_with_its_place(run, tmp_path):
    recorded(tmp_path / "trail.csv", CORNERS)
    (tmp_path / "wall.yaml").write_text(WALL)
    obstacles = ("--obstacles", tmp_path / "wall.yaml")
    status, out, _ = run("teach", tmp_path / "trail.csv", *ROBOT, *obstacles, "--json")
    report = json.loads(out)
    assert status == 1 and report["status"] == "tube_blocked"
    assert report["message"].startswith("the trail itself has too little clearance: link")
    assert report["where"]["obstacle"] == "wall"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--urdf", "example:ur5"), "teach takes either --urdf and --tool-frame, or --problem"),
        (("--problem", UR5, "--tool-frame", "tool0"), "leave out the other options for them"),
        ((*ROBOT, "--deviation", "0"), "deviation is 0 m; it must be > 0 and finite"),
    ],
)
def test_bad_input_ends_with_status_2(run, tmp_path, options, message):
    recorded(tmp_path / "trail.csv", CORNERS)
    status, _, err = run("teach", tmp_path / "trail.csv", *options)
    assert status == 2 and message in err


def test_a_template_gives_robot_limits_and_obstacles(run, tmp_path):
    problem = load_problem(UR5, reads_tube=False)
    q = np.linspace(problem.start, problem.start + np.array([0, 0, 0, 0, 0, 0.5]), 20)
    path = write_trail(tmp_path / "trail.csv", problem.robot.joint_names, q)
    status, _, err = run("teach", path, "--problem", UR5)
    assert status == 2 and re.search(r"the tool moves by .* m only", err)


def test_a_trail_of_too_many_segments_is_refused_before_measuring(run, tmp_path):
    """A trail that bends everywhere, at a deviation of a hundredth of a millimetre."""
    angle = np.linspace(0, 1.6, 400)
    q = np.column_stack([angle, -1.2 - 0.3 * np.sin(4 * angle)])
    path = write_trail(tmp_path / "trail.csv", ["joint1", "joint2"], q)
    status, _, err = run("teach", path, *ROBOT, "--deviation", "1e-5")
    assert status == 2 and "at most 40 are measured" in err
    assert "deviation is 1e-05 m, at which the trail becomes" in err


def test_options_out_of_range_are_named():
    with pytest.raises(OptionError, match="band is 0; it must be > 0 and finite"):
        TeachOptions(band=0.0)
