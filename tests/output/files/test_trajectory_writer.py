"""Trajectories as JSON, CSV and ROS: written, read back, sampled so that limits hold."""

import csv
import json
import os
import re
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
import yaml
from cases import PROBLEMS, slow_but
from rosbags.typesys import Stores, get_typestore
from scipy.interpolate import PPoly

from tubeplanner import (
    JointTrajectory,
    OptionError,
    OutputError,
    TrajectoryError,
    read_trajectory,
    verify,
)
from tubeplanner.certificate.judged_motion import FOREIGN_TOLERANCE
from tubeplanner.output.files.file_notes import notes_on_file
from tubeplanner.output.files.fingerprint import problem_hash, robot_hash
from tubeplanner.output.files.samples import samples_for_export
from tubeplanner.output.files.trajectory_writer import (
    FORMATS,
    ExportedMotion,
    trajectory_csv,
    trajectory_json,
    trajectory_ros,
)
from tubeplanner.resources import bundled_folder
from tubeplanner.task.motion import ProblemMotion
from tubeplanner.trajectory.reader import read_trajectory_file

POST = "two_link/around_a_post"


@pytest.fixture(scope="module")
def post(stored):
    """A time-optimal trajectory, whose plain samples break limits when they are joined."""
    return stored(POST, "refinement")


# Our JSON holds the polynomials.


def test_a_trajectory_file_is_what_scipy_takes(post):
    _, trajectory = post
    fields = json.loads(trajectory_json(trajectory))
    assert fields["format"] == "tubeplanner/trajectory"
    assert fields["version"] == 1
    assert fields["duration"] == fields["breakpoints"][-1] == trajectory.duration
    position = PPoly(np.array(fields["coefficients"]), np.array(fields["breakpoints"]))
    np.testing.assert_allclose(position(0.3), trajectory.position(0.3), rtol=1e-14)


GOOD = {
    "format": "tubeplanner/trajectory",
    "version": 1,
    "joint_names": ["a"],
    "duration": 1.0,
    "breakpoints": [0.0, 1.0],
    "coefficients": [[[1.0]], [[0.0]]],
}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "is no JSON"),
        ("[" * 100_000, "is no JSON"),
        ("time,a.position\n0,1\n", ".csv and .yaml are read as CSV and ROS"),
        ("[]", "is no trajectory file"),
        ('{"format": "other"}', "format must be tubeplanner/trajectory"),
    ],
)
def test_a_file_that_is_no_trajectory_is_refused(text, message, tmp_path):
    path = tmp_path / "t.json"
    path.write_text(text)
    with pytest.raises(TrajectoryError, match=message) as caught:
        read_trajectory(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("version", 2, "version is 2; 1 can be read"),
        ("version", True, "version is True; 1 can be read"),
        ("joint_names", [1], r"joint_names is \[1\]; it must be a list of names"),
        ("joint_names", None, "joint_names is None; it must be a list of names"),
        ("breakpoints", None, "breakpoints is None; it must be numbers"),
        ("breakpoints", ["0", "1"], "breakpoints is .* must be numbers"),
        ("breakpoints", [0, 10**400], "breakpoints is .* must be numbers"),
        ("breakpoints", [0, float("nan")], "increase from 0"),
        ("coefficients", [[[1], [2]]], "coefficients have shape"),
        ("coefficients", [[[1], [2, 3]]], "coefficients has rows of different lengths"),
        ("coefficients", [[[1e300]]], "'a' may reach 1e\\+300 rad or m in piece 0"),
        ("duration", 2, r"duration 2\.0 s contradicts the last breakpoint, 1\.0 s"),
        ("duration", float("nan"), "duration nan s contradicts"),
        ("duration", "1", "duration is '1'; it must be numbers"),
    ],
)
def test_a_damaged_trajectory_is_refused_by_name(key, value, message, tmp_path):
    path = tmp_path / "t.json"
    path.write_text(json.dumps({**GOOD, key: value}))
    with pytest.raises(TrajectoryError, match=message) as caught:
        read_trajectory(path)
    assert str(path) in str(caught.value)


def test_the_undamaged_one_is_read_behind_a_mark_of_byte_order(tmp_path):
    path = tmp_path / "t.json"
    path.write_text("\ufeff" + json.dumps(GOOD))
    assert read_trajectory(path).duration == 1.0


# CSV and ROS hold samples, which keep the limits when polynomials join them.


@pytest.mark.parametrize(
    ("name", "suffix"),
    slow_but(
        [("ur5/over_the_wall", ".csv"), ("ur5/level_tray", ".yaml")],
        product(PROBLEMS, (".csv", ".yaml")),
    ),
)
def test_samples_of_a_refined_trajectory_read_back_pass(name, suffix, stored, tmp_path):
    problem, trajectory = stored(name, "refinement")
    sampled = samples_for_export(problem, trajectory, 500)
    time = sampled.samples.time
    np.testing.assert_allclose(np.diff(time), 0.002, atol=1e-12)
    assert time[-1] == pytest.approx(trajectory.duration * (1 + sampled.slowed))
    assert 0 < sampled.slowed < 0.02
    assert "averaged" in sampled.note
    path = tmp_path / f"t{suffix}"
    if suffix == ".csv":
        path.write_text(trajectory_csv(problem.robot.joint_names, sampled.samples))
    else:
        names = problem.robot.joint_names
        path.write_text(trajectory_ros(names, sampled.samples, sampled.note))
        assert path.read_text().startswith("# CSV and ROS samples at 500 Hz are averaged")
    read = read_trajectory_file(path)
    assert "quintics" in read.interpolation
    assert verify(problem, read.trajectory, FOREIGN_TOLERANCE).passed
    # Near the trajectory itself, where both have run the same fraction of their time.
    fraction = np.linspace(0, 1, 500)
    apart = read.trajectory.position(fraction * time[-1]) - trajectory.position(
        fraction * trajectory.duration
    )
    assert abs(apart).max() < 0.02


EXPORTED = {  # method, how many times slower than planned, rate, note
    "what the motors can do at leisure is sampled as it is": ("stop-at-corners", 2, 500, None),
    "few samples are slowed down": ("refinement", 1, 60, "slowed down|averaged"),
    "too few are written with the reason": ("refinement", 1, 8, "too few.*raise the rate"),
}


@pytest.mark.parametrize(("method", "factor", "rate", "note"), EXPORTED.values(), ids=EXPORTED)
def test_what_is_exported_fits_the_rate(method, factor, rate, note, stored):
    problem, trajectory = stored("ur5/over_the_wall", method)
    trajectory = trajectory.scaled(factor)
    sampled = samples_for_export(problem, trajectory, rate)
    if note is None:
        assert sampled.note is None
        assert sampled.slowed == 0
        expected = trajectory.sample(rate).position
        np.testing.assert_array_equal(sampled.samples.position, expected)
    else:
        assert re.search(note, sampled.note)


# A YAML file is what ROS 2 takes: loaded into the message's own type, serialised, read back.


TYPE = "trajectory_msgs/msg/JointTrajectory"


def as_message(store, fields):
    """Return a JointTrajectory as rosidl's set_message_fields makes it from YAML."""
    types = store.types
    points = [
        types["trajectory_msgs/msg/JointTrajectoryPoint"](
            **{name: np.array(point[name]) for name in ("positions", "velocities")},
            accelerations=np.array(point["accelerations"]),
            effort=np.array([]),
            time_from_start=types["builtin_interfaces/msg/Duration"](**point["time_from_start"]),
        )
        for point in fields["points"]
    ]
    stamp = types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="")
    return types[TYPE](header=header, joint_names=fields["joint_names"], points=points)


@pytest.mark.parametrize("release", [Stores.ROS2_HUMBLE, Stores.ROS2_JAZZY])
def test_the_file_is_a_ros_2_message_and_survives_the_wire(release, post):
    problem, trajectory = post
    sampled = samples_for_export(problem, trajectory, 500)
    names, samples = problem.robot.joint_names, sampled.samples
    fields = yaml.load(trajectory_ros(names, samples, sampled.note), yaml.CSafeLoader)
    known = {"positions", "velocities", "accelerations", "time_from_start"}
    assert set(fields) == {"joint_names", "points"}
    assert set(fields["points"][0]) == known
    assert all(isinstance(q, float) for point in fields["points"] for q in point["positions"])
    store = get_typestore(release)
    wire = store.serialize_cdr(as_message(store, fields), TYPE)
    read = store.deserialize_cdr(wire, TYPE)
    assert read.joint_names == list(names)
    for ours, field in (
        (samples.position, "positions"),
        (samples.velocity, "velocities"),
        (samples.acceleration, "accelerations"),
    ):
        theirs = np.array([getattr(point, field) for point in read.points])
        np.testing.assert_array_equal(theirs, ours)
    stamps = [point.time_from_start for point in read.points]
    assert all(0 <= stamp.nanosec < 10**9 for stamp in stamps)
    time = np.array([stamp.sec + 1e-9 * stamp.nanosec for stamp in stamps])
    np.testing.assert_allclose(time, samples.time, atol=5.1e-10)
    assert (np.diff(time) > 0).all()


# What `save` writes: hashes and efforts if it knows the problem.


SUFFIXES = (".json", ".csv", ".yaml", ".yml", ".JSON")


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


@pytest.mark.parametrize("suffix", SUFFIXES[:3])
def test_what_is_saved_alone_is_the_trajectory_itself(suffix, post, tmp_path):
    _, trajectory = post
    path = tmp_path / f"t{suffix}"
    assert trajectory.save(str(path), rate=200) == ()
    read = read_trajectory(path)
    assert read.joint_names == trajectory.joint_names
    assert read.duration == pytest.approx(trajectory.duration, abs=1e-9)
    time = trajectory.sample(200).time
    np.testing.assert_allclose(read.position(time), trajectory.position(time), atol=1e-7)
    np.testing.assert_allclose(read.velocity(time), trajectory.velocity(time), atol=1e-7)


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
    assert json.loads(path.read_text()).keys() == GOOD.keys()


def test_only_the_csv_of_a_problem_has_efforts(post, tmp_path):
    problem, trajectory = post
    path = tmp_path / "t.csv"
    trajectory.save(path, problem, 250)
    columns, *rows = csv.reader(path.read_text().splitlines())
    table = np.array(rows, dtype=float)
    quantities = ("position", "velocity", "acceleration", "effort")
    assert columns == ["time", *(f"joint{k}.{name}" for name in quantities for k in (1, 2))]
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
    reordered = trajectory.reordered(trajectory.joint_names[::-1])
    for suffix in (".json", ".csv", ".yaml"):
        one, other = tmp_path / f"one{suffix}", tmp_path / f"other{suffix}"
        assert trajectory.save(one, problem) == reordered.save(other, problem)
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


def test_targets_that_cannot_be_written_are_named(post, tmp_path):
    with pytest.raises(OutputError, match=r"the folder .*nowhere does not exist"):
        post[1].save(tmp_path / "nowhere" / "t.json")
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(OutputError, match=r"folder\.csv is no regular file"):
        post[1].save(tmp_path / "folder.csv")


def test_the_command_line_writes_the_same_files(post, run, tmp_path):
    paths = [tmp_path / f"a{suffix}" for suffix in (".json", ".csv", ".yaml")]
    options = zip(("-o", "--csv", "--ros"), paths, strict=True)
    words = [word for pair in options for word in pair]
    assert run("plan", f"example:{POST}", "--method", "stop-at-corners", *words)[0] == 0
    for path in paths[1:]:
        again = path.with_stem("b")
        read_trajectory(paths[0]).save(again, post[0])
        assert again.read_bytes() == path.read_bytes()


def test_several_files_share_samples_and_notes(post):
    problem, trajectory = post
    exported = ExportedMotion(ProblemMotion(problem, trajectory), "refinement", 250)
    assert json.loads(FORMATS[0].text(exported))["method"] == "refinement"
    assert exported.notes == ()
    texts = [each.text(exported) for each in FORMATS[1:]]
    (note,) = exported.notes
    assert note in texts[1]


# Names of joints in CSV.


@pytest.fixture
def turning():
    """Return a function from a joint's name to a motion of it."""
    return lambda name: JointTrajectory([name], [0, 1.0], [[[1.0]], [[0.0]]])


@pytest.mark.parametrize("name", ["a,b", 'a"b', "a b.c", "関節", "'x'"])
def test_names_with_commas_and_quotes_come_back_from_csv(name, turning, tmp_path):
    path = tmp_path / "t.csv"
    path.write_text(trajectory_csv([name], turning(name).sample(10)))
    assert read_trajectory(path).joint_names == (name,)


@pytest.mark.parametrize("name", ["=1+1", "+a", "-a", "@a", " =a"])
def test_a_name_that_is_a_formula_to_spreadsheets_is_refused(name, turning):
    with pytest.raises(OutputError, match="a formula to spreadsheets; rename the joint, or write"):
        trajectory_csv([name], turning(name).sample(10))


def test_a_formula_is_refused_before_anything_is_planned(tmp_path, run, monkeypatch):
    urdf = bundled_folder() / "two_link" / "two_link.urdf"
    (tmp_path / "arm.urdf").write_text(urdf.read_text().replace('"joint1"', '"=1+1"'))
    (tmp_path / "p.json").write_text(json.dumps({
        "robot": {"urdf": "arm.urdf", "tool_frame": "hand"},
        "tube": {"points": [[0.6, 0, 0], [0, 0.6, 0]], "radius": 0.5},
        "start": {"joints": [0.0, 0.0]},
    }))  # fmt: skip
    monkeypatch.setattr("tubeplanner.planning.strategy.plan", None)
    status, _, err = run("plan", tmp_path / "p.json", "--csv", tmp_path / "t.csv")
    assert status == 2
    assert "would begin with '=', a formula to spreadsheets" in err
