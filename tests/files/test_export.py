import csv
import io
import json
import re
from itertools import product
from xml.sax.saxutils import quoteattr

import numpy as np
import pytest
from ruamel.yaml import YAML
from scipy.interpolate import PPoly

from cases import PROBLEMS, slow_but
from tubeplanner import (
    JointTrajectory,
    OutputError,
    TrajectoryError,
    load_robot,
    read_trajectory,
    verify,
)
from tubeplanner.files.export import trajectory_csv, trajectory_json, trajectory_ros
from tubeplanner.files.export_samples import samples_for_export
from tubeplanner.trajectory.trajectory_file import read_trajectory_file
from tubeplanner.verification.judged_condition import FOREIGN_TOLERANCE

UR5 = "ur5/over_the_wall"


def test_a_trajectory_file_reads_back_to_the_last_bit(stored, tmp_path):
    _, trajectory = stored(UR5)
    path = tmp_path / "t.json"
    path.write_text(trajectory_json(trajectory, method="stop-at-corners"))
    again = read_trajectory(str(path))
    np.testing.assert_array_equal(again.coefficients, trajectory.coefficients)
    np.testing.assert_array_equal(again.breakpoints, trajectory.breakpoints)
    assert again.joint_names == trajectory.joint_names


def test_a_trajectory_file_is_what_scipy_takes(stored):
    _, trajectory = stored(UR5)
    fields = json.loads(trajectory_json(trajectory))
    assert fields["format"] == "tubeplanner/trajectory"
    assert fields["version"] == 1
    assert fields["duration"] == fields["breakpoints"][-1] == trajectory.duration
    position = PPoly(np.array(fields["coefficients"]), np.array(fields["breakpoints"]))
    np.testing.assert_allclose(position(0.3), trajectory.position(0.3), rtol=1e-14)


def test_csv_has_every_quantity_of_every_joint(stored):
    problem, trajectory = stored(UR5)
    names, samples = problem.robot.joint_names, trajectory.sample(100)
    effort = problem.robot.inverse_dynamics(
        samples.position, samples.velocity, samples.acceleration
    )
    rows = list(csv.DictReader(io.StringIO(trajectory_csv(names, samples, effort))))
    quantities = ("position", "velocity", "acceleration", "effort")
    assert list(rows[0]) == ["time", *(f"{name}.{what}" for what in quantities for name in names)]
    time = np.array([float(row["time"]) for row in rows])
    np.testing.assert_allclose(np.diff(time)[:-1], 0.01)
    assert time[-1] == trajectory.duration
    q, v, a, tau = (
        np.array([[float(row[f"{name}.{what}"]) for name in names] for row in rows])
        for what in quantities
    )
    np.testing.assert_array_equal(q, trajectory.position(time))
    np.testing.assert_array_equal(v, trajectory.velocity(time))
    np.testing.assert_allclose(tau, problem.robot.inverse_dynamics(q, v, a))


def test_ros_is_a_joint_trajectory_without_efforts(stored):
    _, trajectory = stored(UR5)
    names = trajectory.joint_names
    text = trajectory_ros(names, trajectory.sample(50))
    message = YAML(typ="safe", pure=True).load(text)
    assert message["joint_names"] == list(names)
    point = message["points"][7]
    assert set(point) == {"positions", "velocities", "accelerations", "time_from_start"}
    stamp = point["time_from_start"]
    time = stamp["sec"] + 1e-9 * stamp["nanosec"]
    assert time == pytest.approx(7 / 50)
    np.testing.assert_allclose(point["positions"], trajectory.position(7 / 50))
    last = message["points"][-1]["time_from_start"]
    assert last["sec"] + 1e-9 * last["nanosec"] == pytest.approx(trajectory.duration, abs=1e-9)
    assert all(isinstance(value, float) for row in message["points"] for value in row["positions"])


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


def test_the_undamaged_one_is_read(tmp_path):
    path = tmp_path / "t.json"
    path.write_text("\ufeff" + json.dumps(GOOD))
    assert read_trajectory(path).duration == 1.0


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
    # Near the trajectory itself, where both have run the same share of their time.
    share = np.linspace(0, 1, 500)
    apart = read.trajectory.position(share * time[-1]) - trajectory.position(
        share * trajectory.duration
    )
    assert abs(apart).max() < 0.02


EXPORTED = {  # method, how many times slower than planned, rate, note
    "what the motors can do at leisure is sampled as it is": ("stop-at-corners", 2, 500, None),
    "few samples are slowed down": ("refinement", 1, 60, "slowed down|averaged"),
    "too few are written with the reason": ("refinement", 1, 8, "too few.*raise the rate"),
}


@pytest.mark.parametrize(("method", "factor", "rate", "note"), EXPORTED.values(), ids=EXPORTED)
def test_what_is_exported_fits_the_rate(method, factor, rate, note, stored):
    problem, trajectory = stored(UR5, method)
    trajectory = trajectory.scaled(factor)
    sampled = samples_for_export(problem, trajectory, rate)
    if note is None:
        assert sampled.note is None
        assert sampled.slowed == 0
        expected = trajectory.sample(rate).position
        np.testing.assert_array_equal(sampled.samples.position, expected)
    else:
        assert re.search(note, sampled.note)


@pytest.mark.parametrize("name", ["a,b", 'a"b', "a b.c", "関節", "'x'"])
def test_names_with_commas_and_quotes_come_back_from_csv(tmp_path, name):
    named_arm(tmp_path, name)
    moving = JointTrajectory([name], [0, 1.0], [[[1.0]], [[0.0]]])
    path = tmp_path / "t.csv"
    path.write_text(trajectory_csv([name], moving.sample(10)))
    assert read_trajectory(path).joint_names == (name,)


@pytest.mark.parametrize("name", ["=1+1", "+a", "-a", "@a", " =a"])
def test_a_name_that_is_a_formula_to_spreadsheets_is_refused(tmp_path, run, name):
    named_arm(tmp_path, name)
    moving = JointTrajectory([name], [0, 1.0], [[[1.0]], [[0.0]]])
    with pytest.raises(OutputError, match="a formula to spreadsheets; rename the joint, or write"):
        trajectory_csv([name], moving.sample(10))


def test_a_formula_is_refused_before_anything_is_planned(tmp_path, run, monkeypatch):
    named_arm(tmp_path, "=1+1")
    (tmp_path / "p.json").write_text(json.dumps({
        "robot": {"urdf": "arm.urdf", "tool_frame": "tip"},
        "tube": {"points": [[1, 0, 0], [0, 1, 0]], "radius": 0.5},
        "start": {"joints": [0.0]},
    }))  # fmt: skip
    monkeypatch.setattr("tubeplanner.planning.planner.plan", None)
    status, _, err = run("plan", tmp_path / "p.json", "--csv", tmp_path / "t.csv")
    assert status == 2
    assert "would begin with '=', a formula to spreadsheets" in err


def named_arm(folder, name):
    """Return an arm of one joint, whose name is given."""
    inertia = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    (folder / "arm.urdf").write_text(
        f"""<robot name="arm"><link name="base"/>
        <link name="bar"><inertial><mass value="1"/>{inertia}</inertial></link><link name="tip"/>
        <joint name={quoteattr(name)} type="revolute"><parent link="base"/><child link="bar"/>
          <axis xyz="0 0 1"/><limit lower="-9" upper="9" effort="5" velocity="4"/></joint>
        <joint name="fix" type="fixed"><parent link="bar"/><child link="tip"/>
          <origin xyz="1 0 0"/></joint></robot>"""
    )
    return load_robot("arm.urdf", "tip", directory=folder)
