"""Tubes from recorded trails."""

import json
from itertools import pairwise

import numpy as np
import pytest

from tubeplanner import TeachOptions, load_problem
from tubeplanner.errors import OptionError

CORNERS = np.array([[0.0, -1.2], [0.4, -1.6], [1.2, -1.6], [1.6, -0.8]])
POST = "obstacles: [{name: post, cylinder: [0.02, 0.3], position: [0.55, 0.25, 0]}]\n"
ROBOT = ("--urdf", "example:two_link", "--tool-frame", "hand")


def recorded(path, corners, *, noise=1e-3, names=("joint2", "gripper", "joint1")):
    """Write a trail as a recorder would: noise, pauses, a way out and back, a joint more."""
    rng = np.random.default_rng(0)
    parts = []
    for a, b in pairwise(corners):
        parts += [np.repeat(a[None], 30, axis=0), np.linspace(a, b, 60)]
    q = np.vstack([*parts, np.repeat(corners[-1:], 50, axis=0)])
    q = q + rng.normal(0, noise, q.shape)
    columns = {"joint1": q[:, 0], "joint2": q[:, 1], "gripper": np.zeros(len(q))}
    rows = [",".join(["time", *(f"{name}.position" for name in names)])]
    for k in range(len(q)):
        rows.append(",".join([f"{0.02 * k:.3f}", *(f"{columns[name][k]:.5f}" for name in names)]))
    path.write_text("\n".join(rows) + "\n")
    return q


@pytest.fixture(scope="module")
def taught(tmp_path_factory):
    """Return the folder, the trail and the command's report, of a trail with all that is wrong."""
    from click.testing import CliRunner

    from tubeplanner.commands.cli import cli

    folder = tmp_path_factory.mktemp("taught")
    there = CORNERS[1] + 0.7 * (CORNERS[2] - CORNERS[1])
    q = recorded(folder / "trail.csv", np.vstack([CORNERS[:2], there, CORNERS[1:]]))
    (folder / "post.yaml").write_text(POST)
    arguments = ["teach", folder / "trail.csv", *ROBOT, "--obstacles", folder / "post.yaml"]
    arguments += ["-o", folder / "tube.yaml", "--samples", 200, "--deviation", 0.03]
    arguments += ["--json"]
    done = CliRunner().invoke(cli, [str(word) for word in arguments], standalone_mode=False)
    assert done.return_value == 0, done.output
    return folder, q, json.loads(done.stdout)


def test_a_noisy_trail_becomes_few_points(taught):
    _, _, report = taught
    assert report["status"] == "success"
    assert 3 <= len(report["points"]) <= 6


def test_the_way_out_and_back_is_left_out_and_said(taught):
    notes = [note for note in taught[2]["notes"] if note.startswith("removed: a detour")]
    assert len(notes) == 1


def test_the_written_problem_goes_from_the_trails_start_to_its_end(taught, run):
    folder, q, report = taught
    problem = load_problem(folder / "tube.yaml")
    np.testing.assert_allclose(problem.start, q[0], atol=1e-5)
    np.testing.assert_allclose(problem.goal, q[-1], atol=1e-5)
    assert [obstacle.name for obstacle in problem.obstacles] == ["post"]
    planned = json.loads(run("plan", folder / "tube.yaml", "--json")[1])
    assert planned["status"] == "success" and planned["duration"] == report["duration"]


def test_the_trail_is_within_the_deviation_of_the_tube(taught, two_link):
    folder, q, _ = taught
    tube = load_problem(folder / "tube.yaml").tube
    distance = tube.distance(two_link.tool_position(q)).min(axis=1)
    assert distance.max() < 0.03 + 0.02  # samples that were dropped are near those that were not


def test_the_elbow_keeps_the_trails_sign(taught):
    tube = load_problem(taught[0] / "tube.yaml").tube
    assert all(ranges["joint2"][1] <= 0 for ranges in tube.joint_ranges if "joint2" in ranges)


def test_a_trail_through_an_obstacle_is_an_answer_with_its_place(run, tmp_path):
    recorded(tmp_path / "trail.csv", CORNERS)
    wall = "obstacles: [{name: wall, box: [0.2, 0.2, 0.3], position: [0.3, 0.3, 0]}]\n"
    (tmp_path / "wall.yaml").write_text(wall)
    words = ("teach", tmp_path / "trail.csv", *ROBOT, "--obstacles", tmp_path / "wall.yaml")
    status, out, _ = run(*words, "--json")
    report = json.loads(out)
    assert status == 1 and report["status"] == "tube_blocked"
    assert report["message"].startswith("the trail itself has too little clearance: link")
    assert report["where"]["obstacle"] == "wall"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "teach takes either --urdf and --tool-frame, or --problem"),
        (("--urdf", "example:ur5"), "teach takes either --urdf and --tool-frame, or --problem"),
        (
            ("--problem", "example:ur5/past_a_wall", "--tool-frame", "tool0"),
            "--problem has robot and obstacles; leave out the other options for them",
        ),
        ((*ROBOT, "--deviation", "0"), "deviation is 0 m; it must be > 0 and finite"),
        (("--urdf", "example:ur5", "--tool-frame", "tool0"), "the trail has no joint shoulder_pan"),
        (("--urdf", "example:two_lnk", "--tool-frame", "hand"), "did you mean 'two_link'?"),
    ],
)
def test_bad_input_ends_with_status_2(run, tmp_path, words, message):
    recorded(tmp_path / "trail.csv", CORNERS)
    status, _, err = run("teach", tmp_path / "trail.csv", *words)
    assert status == 2 and message in err


def test_a_template_gives_robot_limits_and_obstacles(run, tmp_path):
    problem = load_problem("example:ur5/past_a_wall", reads_tube=False)
    far = problem.start + np.array([0, 0, 0, 0, 0, 0.5])
    names = ",".join(f"{name}.position" for name in problem.robot.joint_names)
    rows = [f"time,{names}"]
    for k, q in enumerate(np.linspace(problem.start, far, 20)):
        rows.append(",".join(f"{value:.5f}" for value in [0.1 * k, *q]))
    (tmp_path / "trail.csv").write_text("\n".join(rows) + "\n")
    status, _, err = run("teach", tmp_path / "trail.csv", "--problem", "example:ur5/past_a_wall")
    assert status == 2 and "the tool moves by" in err


def test_a_trail_of_too_many_segments_is_refused_before_measuring(run, tmp_path):
    """A trail that bends everywhere, at a deviation of a hundredth of a millimetre."""
    angle = np.linspace(0, 1.6, 400)
    q = np.column_stack([angle, -1.2 - 0.3 * np.sin(4 * angle)])
    rows = [f"{0.02 * k:.3f},{a!r},{b!r}" for k, (a, b) in enumerate(q.tolist())]
    header = "time,joint1.position,joint2.position"
    (tmp_path / "trail.csv").write_text("\n".join([header, *rows]) + "\n")
    status, _, err = run("teach", tmp_path / "trail.csv", *ROBOT, "--deviation", "1e-5")
    assert status == 2 and "at most 40 are measured" in err
    assert "deviation is 1e-05 m, at which the trail becomes" in err


def test_options_out_of_range_are_named():
    with pytest.raises(OptionError, match="band is 0; it must be > 0 and finite"):
        TeachOptions(band=0.0)
