"""Trajectories made elsewhere: what is read, how it is joined, what is refused and why."""

import json

import numpy as np
import pytest
from ruamel.yaml import YAML

from tubeplanner import TrajectoryError, verify
from tubeplanner.files.export import trajectory_csv, trajectory_ros
from tubeplanner.trajectory.trajectory_file import (
    GivenSamples,
    joined_samples,
    read_trajectory_file,
)
from tubeplanner.verification.judged_condition import FOREIGN_TOLERANCE

UR5 = "ur5/over_the_wall"


def written(tmp_path, name, text):
    path = tmp_path / name
    path.write_text(text)
    return path


@pytest.fixture
def good(stored):
    return stored(UR5, "branch-and-bound")


def without(text, *quantities):
    """Return a CSV without the columns of some quantities."""
    rows = [line.split(",") for line in text.splitlines()]
    kept = [i for i, name in enumerate(rows[0]) if name.rpartition(".")[2] not in quantities]
    return "\n".join(",".join(row[i] for i in kept) for row in rows)


@pytest.mark.parametrize(
    ("left_out", "interpolation", "close"),
    [
        ((), "quintics that meet every sample's position, velocity, acceleration", 1e-8),
        (("acceleration", "effort"), "cubics that meet every sample's position, velocity", 1e-5),
        (
            ("velocity", "acceleration"),
            "a cubic spline through the positions, at rest at both ends",
            1e-5,
        ),
    ],
)
def test_csv_is_joined_by_what_its_columns_allow(good, tmp_path, left_out, interpolation, close):
    problem, trajectory = good
    names = problem.robot.joint_names
    text = without(trajectory_csv(names, trajectory.sample(500)), *left_out)
    read = read_trajectory_file(written(tmp_path, "t.csv", text))
    assert read.interpolation == interpolation
    assert read.problem_hash is None
    t = np.linspace(0, trajectory.duration, 3000)
    off = read.trajectory.position(t) - trajectory.position(t)
    assert abs(off).max() < close
    assert read.trajectory.duration == pytest.approx(trajectory.duration, abs=1e-12)


def test_what_was_written_passes_as_foreign(good, tmp_path):
    problem, trajectory = good
    for name, text in (
        ("t.csv", trajectory_csv(problem.robot.joint_names, trajectory.sample(250))),
        ("t.yaml", trajectory_ros(problem.robot.joint_names, trajectory.sample(250))),
    ):
        read = read_trajectory_file(written(tmp_path, name, text))
        assert verify(problem, read.trajectory, FOREIGN_TOLERANCE).failures() == []


def test_columns_come_in_any_order_and_are_matched_by_name(good, tmp_path):
    problem, trajectory = good
    text = trajectory_csv(problem.robot.joint_names, trajectory.sample(250))
    rows = [line.split(",") for line in text.splitlines()]
    backwards = "\n".join(",".join(reversed(row)) for row in rows)
    read = read_trajectory_file(written(tmp_path, "t.csv", backwards))
    assert read.trajectory.joint_names == problem.robot.joint_names[::-1]
    assert verify(problem, read.trajectory, FOREIGN_TOLERANCE).passed


def test_a_ros_goal_and_its_older_dialect_are_read(good, tmp_path):
    _, trajectory = good
    message = YAML(typ="safe", pure=True).load(
        trajectory_ros(trajectory.joint_names, trajectory.sample(100))
    )
    for point in message["points"]:
        stamp = point["time_from_start"]
        point["time_from_start"] = {"secs": stamp["sec"], "nsecs": stamp["nanosec"]}
    path = tmp_path / "goal.yml"
    with path.open("w") as file:
        YAML(typ="safe", pure=True).dump({"trajectory": message, "path_tolerance": []}, file)
    path.write_text(path.read_text() + "---\n")
    read = read_trajectory_file(path)
    t = np.linspace(0, trajectory.duration, 500)
    np.testing.assert_allclose(read.trajectory.position(t), trajectory.position(t), atol=5e-6)


CSV = "time,a.position,b.position\n0,0,0\n0.1,0.1,0\n0.2,0.3,0.1\n"
ROS = """joint_names: [a, b]
points:
- {positions: [0, 0], time_from_start: {sec: 0, nanosec: 0}}
- {positions: [0.1, 1e-05], time_from_start: {sec: 0, nanosec: 100000000}}
"""
BAD_CSV = {
    "no time": (
        CSV.replace("time", "clock"),
        "needs the columns time and JOINT.position; its columns",
    ),
    "no position": ("time,a,b\n0,0,0\n", "needs the columns time and JOINT.position; its columns"),
    "nothing": ("", "its columns are none"),
    "one row": (CSV[:33], "at least two samples"),
    "a column twice": (CSV.replace("b.pos", "a.pos"), "'a.position' is there 2 times"),
    "half of the velocities": (
        "time,a.position,b.position,a.velocity\n0,0,0,0\n1,1,1,0\n",
        "velocity is missing for b; give it for all joints or none",
    ),
    "a short row": (CSV.replace("0.1,0.1,0\n", "0.1,0.1\n"), "row 3 has 2 values for 3 columns"),
    "a word": (CSV.replace("0.3", "fast"), "row 4, a.position is 'fast', no number"),
    "not a number": (CSV.replace("0.3", "nan"), "row 4, a.position is nan; it must be finite"),
    "time going back": (CSV.replace("0.2,", "0.05,"), "sample 2 comes 0.05 s before"),
    "degrees": (
        "time,a.position,a.velocity\n0,0,0\n0.1,5.7296,1\n0.2,11.459,1\n0.3,17.189,1\n0.4,20,0\n",
        "are all in radians .a factor of 57.3 tells degrees. and seconds",
    ),
    "milliseconds": (
        "time,a.position,a.velocity\n0,0,0\n100,0.1,1\n200,0.2,1\n300,0.3,1\n400,0.35,0\n",
        "1000: milliseconds",
    ),
}
BAD_ROS = {
    "no YAML": ("a: [", "is no YAML"),
    "a list": ("[1, 2]", "is no trajectory_msgs/JointTrajectory"),
    "no points": ("joint_names: [a]", "needs a list of points"),
    "no names": (ROS.replace("joint_names", "names"), "joint_names is None"),
    "too few numbers": (ROS.replace("[0.1, 1e-05]", "[0.1]"), "point 1: positions .* must be 2"),
    "a gap": (ROS.replace("positions: [0.1, 1e-05], ", ""), "point 1 has no positions"),
    "no time": (ROS.replace("{sec: 0, nanosec: 0}", "0.0"), "point 0: time_from_start is 0.0"),
    "the same time": (ROS.replace("100000000", "0"), "time must increase"),
}


@pytest.mark.parametrize(("text", "message"), BAD_CSV.values(), ids=BAD_CSV)
def test_csv_that_cannot_be_read_says_why(text, message, tmp_path):
    path = written(tmp_path, "t.csv", text)
    with pytest.raises(TrajectoryError, match=message) as caught:
        read_trajectory_file(path)
    assert str(caught.value).startswith(str(path))


@pytest.mark.parametrize(("text", "message"), BAD_ROS.values(), ids=BAD_ROS)
def test_ros_that_cannot_be_read_says_why(text, message, tmp_path):
    path = written(tmp_path, "t.yaml", text)
    with pytest.raises(TrajectoryError, match=message) as caught:
        read_trajectory_file(path)
    assert str(caught.value).startswith(str(path))


def test_short_files_that_are_sound_are_read(tmp_path):
    assert read_trajectory_file(written(tmp_path, "t.csv", CSV)).trajectory.duration == 0.2
    read = read_trajectory_file(written(tmp_path, "t.yaml", ROS))
    assert read.trajectory.position(0.1)[1] == pytest.approx(1e-5)  # a word to YAML 1.1


def test_time_may_begin_anywhere(tmp_path):
    text = CSV.replace("0,0,0\n0.1,", "5,0,0\n5.1,").replace("0.2,0.3", "5.2,0.3")
    read = read_trajectory_file(written(tmp_path, "t.csv", text))
    assert read.trajectory.duration == pytest.approx(0.2)


def test_what_samples_say_is_kept(tmp_path):
    """Trajectories begin at zero and know no efforts; a controller is given both."""
    csv_file, ros_file = tmp_path / "t.csv", tmp_path / "t.yaml"
    csv_file.write_text("time,a.position,a.effort\n2.5,0,1\n3.5,1,1\n")
    assert read_trajectory_file(csv_file).samples == GivenSamples(2.5, ("position",))
    points = [
        {"positions": [x], "velocities": [0.0], "effort": [1.0], "time_from_start": {"sec": x}}
        for x in (0, 1)
    ]
    ros_file.write_text(json.dumps({"joint_names": ["a"], "points": points}))
    given = read_trajectory_file(ros_file).samples
    assert given == GivenSamples(0.0, ("position", "velocity"), has_effort=True)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_joined_samples_meet_all_that_is_known_of_them(count):
    time = np.array([0.0, 0.3, 1.0])
    known = np.random.default_rng(0).normal(size=(count, 3, 2))
    joined = joined_samples(("a", "b"), time, known)
    assert len(joined.coefficients) == 2 * count
    samples = joined.per_piece(2)
    for got, values in zip(
        (samples.position, samples.velocity, samples.acceleration), known, strict=False
    ):
        np.testing.assert_allclose(got[::2], values[:-1], atol=1e-13)
        np.testing.assert_allclose(got[1::2], values[1:], atol=1e-11)


def test_the_acceleration_of_a_joint_that_hardly_moves_does_not_jump_between_samples():
    time = np.arange(1000) / 1000
    known = [0.7 + 1e-3 * np.sin(time), 1e-3 * np.cos(time), -1e-3 * np.sin(time)]
    joined = joined_samples(("a",), time, [values[:, None] for values in known])
    acceleration = joined.per_piece(2).acceleration
    assert abs(acceleration[1:-1:2] - acceleration[2::2]).sum() < 1e-10


def test_a_recording_begins_at_zero_and_says_what_it_does_not_read(tmp_path):
    """PlotJuggler's times are seconds since 1970."""
    lines = ["__time,/js/a/position,/js/b/position,/js/header/seq"]
    lines += [f"{1763900000 + 0.1 * k:.3f},{0.1 * k * k},{-0.1 * k},{k}" for k in range(4)]
    path = written(tmp_path, "t.csv", "\n".join(lines))
    read = read_trajectory_file(path, ["b", "a"])
    assert read.trajectory.joint_names == ("a", "b")
    assert read.trajectory.duration == pytest.approx(0.3, abs=1e-6)
    assert read.trajectory.position(0.3) == pytest.approx([0.9, -0.3])
    assert read.ignored == ("/js/header/seq",)
    assert read.interpolation == "a cubic spline through the positions, at rest at both ends"
