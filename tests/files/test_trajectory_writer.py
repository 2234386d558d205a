import csv
import json
import os
from dataclasses import replace

import numpy as np
import pytest

from tubeplanner import (
    JointTrajectory,
    OptionError,
    OutputError,
    TrajectoryError,
    read_trajectory,
    verify,
)
from tubeplanner.files.file_notes import notes_on_file
from tubeplanner.files.fingerprint import problem_hash, robot_hash
from tubeplanner.files.trajectory_writer import TrajectoryFiles
from tubeplanner.trajectory.trajectory_file import read_trajectory_file
from tubeplanner.verification.judged_condition import FOREIGN_TOLERANCE

POST = "two_link/around_a_post"
SUFFIXES = (".json", ".csv", ".yaml", ".yml", ".JSON")


@pytest.fixture(scope="module")
def post(stored):
    """A time-optimal trajectory, whose plain samples break limits when they are joined."""
    return stored(POST, "refinement")


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_what_is_saved_with_its_problem_reads_back_and_passes(suffix, post, tmp_path):
    problem, trajectory = post
    path = tmp_path / f"t{suffix}"
    notes = trajectory.save(path, problem)
    read = read_trajectory_file(path)
    assert verify(problem, read.trajectory, FOREIGN_TOLERANCE).passed
    if suffix.lower() == ".json":
        assert notes == ()
        np.testing.assert_array_equal(read.trajectory.coefficients, trajectory.coefficients)
    else:
        assert [type(note) for note in notes] == [str]
        assert "at 500 Hz are averaged" in notes[0]
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_what_is_saved_alone_is_the_trajectory_itself(suffix, post, tmp_path):
    _, trajectory = post
    path = tmp_path / f"t{suffix}"
    assert trajectory.save(str(path), rate=200) == ()
    read = read_trajectory(path)
    assert read.joint_names == trajectory.joint_names
    assert read.duration == pytest.approx(trajectory.duration, abs=1e-9)
    time = trajectory.sample(200).time
    np.testing.assert_allclose(read.position(time), trajectory.position(time), atol=1e-7)


def test_only_the_json_of_a_problem_has_hashes(post, tmp_path):
    problem, trajectory = post
    path = tmp_path / "t.json"
    trajectory.save(path, problem)
    read, fields = read_trajectory_file(path), json.loads(path.read_text())
    assert read.problem_hash == problem_hash(problem)
    assert read.robot_hash == robot_hash(problem.robot)
    assert fields["problem"] == problem.name
    assert "method" not in fields
    assert notes_on_file(problem, read, failed=False) == []
    trajectory.save(path)
    assert json.loads(path.read_text()).keys() == {
        "format",
        "version",
        "joint_names",
        "duration",
        "breakpoints",
        "coefficients",
    }


def test_only_the_csv_of_a_problem_has_efforts(post, tmp_path):
    problem, trajectory = post
    path = tmp_path / "t.csv"
    trajectory.save(path, problem, 250)
    columns, *rows = csv.reader(path.read_text().splitlines())
    table = np.array(rows, dtype=float)
    assert columns[-2:] == ["joint1.effort", "joint2.effort"]
    q, v, a, tau = (table[:, 1 + 2 * k : 3 + 2 * k] for k in range(4))
    np.testing.assert_allclose(tau, problem.robot.inverse_dynamics(q, v, a))
    assert (abs(tau) <= problem.robot.limits.effort * 1.001).all()
    np.testing.assert_allclose(np.diff(table[:, 0]), 1 / 250)
    trajectory.save(path)
    columns = path.read_text().splitlines()[0].split(",")
    assert columns[-2:] == ["joint1.acceleration", "joint2.acceleration"]


def test_unless_asked_otherwise_samples_come_once_in_a_period(post, tmp_path):
    problem, trajectory = post
    for period, path in ((0.004, tmp_path / "t.csv"), (None, tmp_path / "u.csv")):
        trajectory.save(path, replace(problem, period=period))
        times = [float(row[0]) for row in list(csv.reader(path.read_text().splitlines()))[1:]]
        np.testing.assert_allclose(np.diff(times)[:-1], period or 0.002, atol=1e-9)


def test_notes_are_comments_in_the_ros_file(post, tmp_path):
    problem, trajectory = post
    path = tmp_path / "t.yaml"
    (note,) = trajectory.save(path, problem)
    assert path.read_text().startswith(f"# {note}\njoint_names:\n")
    trajectory.save(path)
    assert path.read_text().startswith("joint_names:\n")


def test_joints_are_put_in_the_order_of_the_problem(post, tmp_path):
    problem, trajectory = post
    turned = trajectory.reordered(trajectory.joint_names[::-1])
    for suffix in (".json", ".csv", ".yaml"):
        one, other = tmp_path / f"one{suffix}", tmp_path / f"other{suffix}"
        assert trajectory.save(one, problem) == turned.save(other, problem)
        assert one.read_bytes() == other.read_bytes()
    renamed = JointTrajectory(["a", "b"], trajectory.breakpoints, trajectory.coefficients)
    with pytest.raises(TrajectoryError, match=r"moves the joints a, b; the problem's are joint1"):
        renamed.save(one, problem)


def test_a_trajectory_that_fails_is_saved_as_it_is_and_said_to_fail(post, tmp_path):
    problem, trajectory = post
    path = tmp_path / "t.csv"
    stray = np.array(trajectory.coefficients)
    stray[-1, :, 0] += 0.2
    astray = JointTrajectory(trajectory.joint_names, trajectory.breakpoints, stray)
    (note,) = astray.save(path, problem)
    assert "of the trajectory as it is, which itself breaks the conditions" in note
    assert "tube" in note
    assert read_trajectory(path).duration == pytest.approx(trajectory.duration)


@pytest.mark.parametrize("name", ["t.txt", "t", "t.json.gz", ".json"])
def test_another_suffix_is_refused_with_those_that_there_are(name, post, tmp_path):
    with pytest.raises(OutputError, match=r"there is: \.json, \.csv, \.yaml, \.yml$"):
        post[1].save(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("suffix", [".json", ".csv", ".yaml"])
@pytest.mark.parametrize("rate", [0, -1.0, np.nan, np.inf, "fast"])
def test_a_rate_is_positive_and_finite(rate, suffix, post, tmp_path):
    with pytest.raises(OptionError, match=r"rate is .*; it must be .*> 0 and finite"):
        post[1].save(tmp_path / f"t{suffix}", rate=rate)
    assert list(tmp_path.iterdir()) == []


def test_a_rate_that_makes_too_many_samples_is_refused(post, tmp_path):
    with pytest.raises(TrajectoryError, match="at most 1000000 are made"):
        post[1].save(tmp_path / "t.csv", rate=1e9)


def test_a_rate_is_not_taken_for_a_problem(post, tmp_path):
    with pytest.raises(OptionError, match="problem is 250; it must be PlanningProblem"):
        post[1].save(tmp_path / "t.csv", 250)


@pytest.mark.parametrize("suffix", [".json", ".csv", ".yaml"])
def test_a_failure_leaves_the_file_as_it_was(suffix, post, tmp_path, monkeypatch):
    """The disk is full when the new contents are written."""
    path = tmp_path / f"t{suffix}"
    path.write_text("precious")

    write = os.write

    def full(handle, data):
        write(handle, data[: len(data) // 2])
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "write", full)
        with pytest.raises(OutputError, match=r"could not be written: No space left"):
            post[1].save(path)
    assert path.read_text() == "precious"
    assert list(tmp_path.iterdir()) == [path]


def test_targets_that_cannot_be_written_are_named(post, tmp_path, monkeypatch):
    with pytest.raises(OutputError, match=r"the folder .*nowhere does not exist"):
        post[1].save(tmp_path / "nowhere" / "t.json")
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(OutputError, match=r"folder\.csv is no regular file"):
        post[1].save(tmp_path / "folder.csv")
    path = tmp_path / "t.yaml"
    path.write_text("precious")

    def refused(*_):
        raise PermissionError(13, "Permission denied")

    with monkeypatch.context() as patch:
        patch.setattr(os, "open", refused)
        with pytest.raises(OutputError, match=r"t\.yaml could not be written: Permission denied"):
            post[1].save(path)
    assert path.read_text() == "precious"


def test_the_command_line_writes_the_same_files(post, run, tmp_path):
    paths = [tmp_path / f"a{suffix}" for suffix in (".json", ".csv", ".yaml")]
    options = zip(("-o", "--csv", "--ros"), paths, strict=True)
    assert run("plan", f"example:{POST}", *(word for pair in options for word in pair))[0] == 0
    for path in paths[1:]:
        again = path.with_stem("b")
        read_trajectory(paths[0]).save(again, post[0])
        assert again.read_bytes() == path.read_bytes()


def test_several_files_share_samples_and_notes(post, tmp_path):
    problem, trajectory = post
    files = TrajectoryFiles(tmp_path / "a", tmp_path / "b", tmp_path / "c", 250)
    contents, notes = files.contents(trajectory, problem, "refinement")
    assert [path.name for path in contents] == ["a", "b", "c"]
    assert json.loads(contents[tmp_path / "a"])["method"] == "refinement"
    assert len(notes) == 1
    assert list(tmp_path.iterdir()) == []
