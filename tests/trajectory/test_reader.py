"""Trajectory files: our JSON, foreign CSV and ROS messages."""

import json
import os
import tracemalloc

import numpy as np
import pytest
from cases import refusal
from ruamel.yaml import YAML

from tubeplanner import JointTrajectory, verify
from tubeplanner.certificate.judged_motion import FOREIGN_TOLERANCE
from tubeplanner.errors import TrajectoryError
from tubeplanner.output.files.trajectory_writer import (
    trajectory_csv,
    trajectory_json,
    trajectory_ros,
)
from tubeplanner.trajectory.joint_trajectory import MAX_DEGREE, MAX_PIECES
from tubeplanner.trajectory.parts import Mark
from tubeplanner.trajectory.reader import (
    GivenSamples,
    joined_samples,
    joint_columns,
    read_trajectory_file,
)

JOINTS = ("elbow", "wrist_1")
FORMS = {
    "ours": "{}.position",
    "bare": "{}",
    "PlotJuggler": "/joint_states/{}/position",
    "a path": "{}/position",
    "one word": "{}_position",
    "one word, turned": "position_{}",
    "an array by name": "/robot/joint_states/position/{}",
}


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
def test_every_form_is_read(form):
    columns = [form.format(joint) for joint in JOINTS]
    for time in ("time", "t", "Timestamp", "#time", "# Time", "__time"):
        read = joint_columns([*columns, time], JOINTS)
        assert (read.time, read.joints, read.ignored) == (time, list(JOINTS), ())
        assert read.tables == {"position": columns}


def test_velocities_and_accelerations_come_along_and_others_are_named():
    columns = {quantity: f"/js/elbow/{quantity}" for quantity in ("position", "velocity")}
    header = ["t", *columns.values(), "/js/elbow/effort", "/js/header/seq", "tool/elbow"]
    read = joint_columns(header, JOINTS)
    assert read.joints == ["elbow"]
    assert read.tables == {quantity: [column] for quantity, column in columns.items()}
    assert read.ignored == ("/js/elbow/effort", "/js/header/seq", "tool/elbow")


@pytest.mark.parametrize(
    ("header", "joints", "expected"),
    [
        # Of our own files efforts are no surprise, other joints are read, the time is preferred.
        (["time", "a.position", "a.effort", "b.effort"], (), ("time", ["a"], ("b.effort",))),
        (["time", "grip.position", "a.position"], ["a", "b"], ("time", ["grip", "a"], ())),
        (["t", "time", "a"], ["a"], ("time", ["a"], ("t",))),
        # A joint may be called t.
        (["time_stamp", "timestamp", "t"], ["t"], ("timestamp", ["t"], ("time_stamp",))),
    ],
)
def test_columns_are_told_apart(header, joints, expected):
    read = joint_columns(header, joints)
    assert (read.time, read.joints, read.ignored) == expected


FAULTS = {
    "two positions": (["t", "elbow", "elbow_position"], "'elbow' and 'elbow_position' are both"),
    "two paths": (["t", "/a/elbow/position", "/b/elbow/position"], "are both the position of 'el"),
    "two times": (["t", "timestamp", "elbow"], "'t' and 'timestamp' may all be times; leave out"),
    "no time": (["clock", "elbow"], r"named as the joints: elbow, wrist_1\); its columns are 'clo"),
}


@pytest.mark.parametrize(("header", "message"), FAULTS.values(), ids=FAULTS)
def test_what_cannot_be_told_is_refused(header, message):
    with pytest.raises(TrajectoryError, match=message):
        joint_columns(header, JOINTS)


def test_without_joints_only_our_own_names_are_known():
    with pytest.raises(TrajectoryError, match=r"needs the columns time and JOINT\.position; its"):
        joint_columns(["time", "elbow", "wrist_1_position"])


def written(tmp_path, name, text):
    path = tmp_path / name
    path.write_text(text)
    return path


@pytest.fixture
def good(stored):
    return stored("ur5/over_the_wall", "branch-and-bound")


def without(text, *quantities):
    """Return a CSV without the columns of some quantities."""
    rows = [line.split(",") for line in text.splitlines()]
    columns = [i for i, name in enumerate(rows[0]) if name.rpartition(".")[2] not in quantities]
    return "\n".join(",".join(row[i] for i in columns) for row in rows)


@pytest.mark.parametrize(
    ("left_out", "interpolation", "close"),
    [
        ((), "quintics that meet every sample's position, velocity, acceleration", 1e-8),
        (("acceleration", "effort"), "cubics that meet every sample's position, velocity", 1e-5),
        (("velocity", "acceleration"), "a cubic spline through the positions, at rest at", 1e-5),
    ],
)
def test_csv_is_joined_by_what_its_columns_allow(good, tmp_path, left_out, interpolation, close):
    problem, trajectory = good
    names = problem.robot.joint_names
    text = without(trajectory_csv(names, trajectory.sample(500)), *left_out)
    read = read_trajectory_file(written(tmp_path, "t.csv", text))
    assert read.interpolation.startswith(interpolation)
    t = np.linspace(0, trajectory.duration, 3000)
    off = read.trajectory.position(t) - trajectory.position(t)
    assert abs(off).max() < close
    assert read.trajectory.duration == pytest.approx(trajectory.duration, abs=1e-12)


def test_what_was_written_passes_as_foreign_with_its_columns_in_any_order(good, tmp_path):
    problem, trajectory = good
    names, samples = problem.robot.joint_names, trajectory.sample(250)
    rows = [line.split(",") for line in trajectory_csv(names, samples).splitlines()]
    backwards = "\n".join(",".join(reversed(row)) for row in rows)
    for name, text in (("t.csv", backwards), ("t.yaml", trajectory_ros(names, samples))):
        read = read_trajectory_file(written(tmp_path, name, text))
        assert read.trajectory.joint_names == (names[::-1] if name == "t.csv" else names)
        assert verify(problem, read.trajectory, FOREIGN_TOLERANCE).failures() == []


def test_a_ros_goal_and_its_older_dialect_are_read(good, tmp_path):
    part = good[1].between(0.0, 0.3)
    message = YAML(typ="safe", pure=True).load(trajectory_ros(part.joint_names, part.sample(100)))
    for point in message["points"]:
        stamp = point["time_from_start"]
        point["time_from_start"] = {"secs": stamp["sec"], "nsecs": stamp["nanosec"]}
    path = tmp_path / "goal.yml"
    with path.open("w") as file:
        YAML(typ="safe", pure=True).dump({"trajectory": message, "path_tolerance": []}, file)
        file.write("---\n")
    t = np.linspace(0, 0.3, 100)
    position = read_trajectory_file(path).trajectory.position(t)
    np.testing.assert_allclose(position, part.position(t), atol=5e-6)


PLAIN = "time,a.position,b.position\n0.0,-0.5,0.25\n0.5,-0.25,0.5\n1.0,0.125,1.0\n"
COMMAS = PLAIN.replace(",", ";").replace(".", ",").replace(",position", ".position")
BY_NUMBER = PLAIN.replace("time,a.position,b.position", "timestamp,actual_q_0,actual_q_1")
FORMS_OF_TABLES = {
    "semicolons": PLAIN.replace(",", ";"),
    "semicolons and decimal commas": COMMAS,
    "tabs and decimal commas": COMMAS.replace(";", "\t"),
    "blanks": PLAIN.replace(",", "   ").replace("\n", "  \r\n  "),
    "quotes": COMMAS.replace(";", '","').replace("\n", '"\n"')[:-1].replace("time", '"time'),
    "a header behind #": "# a log\n# " + PLAIN.replace(",", " "),
    "a spreadsheet's": "sep=;\n" + COMMAS + ";;\n;;\n",
    "RTDE": BY_NUMBER.replace(",", " "),
}


@pytest.mark.parametrize("form", FORMS_OF_TABLES)
def test_tables_of_any_separator_and_decimal_mark_are_one_motion(tmp_path, form):
    name = {"blanks": "t.txt", "tabs and decimal commas": "t.tsv"}.get(form, "t.csv")
    read = read_trajectory_file(written(tmp_path, name, FORMS_OF_TABLES[form]), ["a", "b"])
    assert read.trajectory.joint_names == ("a", "b")
    at = read.trajectory.position(np.array([0.0, 0.5, 1.0]))
    assert at.tolist() == [[-0.5, 0.25], [-0.25, 0.5], [0.125, 1.0]]
    by_number = "columns are read by number: actual_q_0 as a, actual_q_1 as b"
    assert read.remarks == ((by_number,) if form == "RTDE" else ())


POINTS = """
  joint_names: [a, b]
  points:
  - {positions: [0, 0], time_from_start: {sec: 0, nanosec: 0}}
  - {positions: [0.5, 0.25], time_from_start: {sec: 1, nanosec: 0}}
"""
ROBOT = f"joint_trajectory:{POINTS}multi_dof_joint_trajectory: {{joint_names: [], points: []}}\n"
ITEM = "- " + ROBOT.replace("\n", "\n  ").rstrip() + "\n"
EMPTY = "- joint_trajectory: {joint_names: [], points: []}\n"


@pytest.mark.parametrize(
    ("text", "duration", "remarks"),
    [
        (ROBOT + "---\n", 1.0, ()),
        ("planned_trajectory:\n  " + ROBOT.replace("\n", "\n  "), 1.0, ()),
        (f"model_id: arm\ntrajectory:\n{ITEM}{EMPTY}trajectory_start: {{}}\n", 1.0, ()),
        (
            f"trajectory:\n{ITEM}{ITEM}",
            2.0,
            ("its 2 trajectories are joined, one after the other",),
        ),
        (f"---\n{ROBOT}---\n{ROBOT}", 1.0, ("of its 2 messages the first alone is read",)),
    ],
    ids=["RobotTrajectory", "a plan", "DisplayTrajectory", "two trajectories", "two messages"],
)
def test_messages_of_moveit_are_read(tmp_path, text, duration, remarks):
    read = read_trajectory_file(written(tmp_path, "t.yaml", text))
    assert (read.trajectory.duration, read.remarks) == (duration, remarks)
    assert read.trajectory.position(duration).tolist() == [0.5, 0.25]


def test_further_joints_are_left_out_if_they_stand_still(tmp_path):
    table = "time,a.position,grip.position,b.position\n0,0,0.02,0\n1,0.5,{},0.25\n"
    for moved, names, still in ((0.02005, ("a", "b"), {"grip": 0.02}), (0.03, None, {})):
        ros = POINTS.replace("a, b", "a, grip, b").replace("0, 0]", "0, 0.02, 0]")
        ros = ros.replace("0.5, ", f"0.5, {moved}, ").replace("\n  ", "\n")
        for name, text in (("t.csv", table.format(moved)), ("t.yaml", ros)):
            path = written(tmp_path, name, text)
            read = read_trajectory_file(path, ["b", "a"])
            assert read.still == still
            assert read.trajectory.joint_names == (names or ("a", "grip", "b"))
            assert read_trajectory_file(path).trajectory.joint_names == ("a", "grip", "b")
    message = refusal(TrajectoryError, read.trajectory.reordered, ["b", "a"])
    assert message.endswith("the problem's are b, a; leave out grip, or plan these joints too")


CSV = "time,a.position,b.position\n0,0,0\n0.1,0.1,0\n0.2,0.3,0.1\n"
ROS = """joint_names: [a, b]
points:
- {positions: [0, 0], time_from_start: {sec: 0, nanosec: 0}}
- {positions: [0.1, 1e-05], time_from_start: {sec: 0, nanosec: 100000000}}
"""
NEEDED = "needs the columns time and JOINT.position; its columns"
VELOCITY = "time,a.position,a.velocity\n"
BAD = {
    "no time.csv": (CSV.replace("time", "clock"), NEEDED),
    "nothing.csv": ("", "its columns are none"),
    "one row.csv": (CSV[:33], "at least two samples"),
    "a column twice.csv": (CSV.replace("b.pos", "a.pos"), "'a.position' is there 2 times"),
    "half of the velocities.csv": (
        "time,a.position,b.position,a.velocity\n0,0,0,0\n1,1,1,0\n",
        "velocity is missing for b; give it for all joints or none",
    ),
    "a short row.csv": (
        CSV.replace("0.1,0.1,0\n", "0.1,0.1\n"),
        "row 3 has 2 values for 3 columns",
    ),
    "a word.csv": (CSV.replace("0.3", "fast"), "row 4, a.position is 'fast', no number"),
    "no number.csv": (CSV.replace("0.3", "nan"), "row 4, a.position is nan; it must be finite"),
    "decimal commas between commas.csv": (
        PLAIN.replace("0.", "0,"),
        "row 2 has 6 values for 3 columns; are there decimal commas\\? Write points, or",
    ),
    "two decimal marks.csv": (
        COMMAS.replace("0,125", "0.125"),
        r"has decimal points .row 4, a.position: '0.125'. and commas .row 2, time: '0,0'.; write",
    ),
    "thousands.csv": ("time;a.position\n1,000;1\n1,008;2\n", "stand between thousands; write"),
    "numbers without joints.csv": (BY_NUMBER, "its columns are 'timestamp', 'actual_q_0', 'ac"),
    "a moving base.yaml": (
        ROBOT.replace("[], points: []", "[base], points: [{transforms: []}]"),
        r"multi_dof_joint_trajectory moves \['base'\], which is not read",
    ),
    "other joints.yaml": (
        f"trajectory:\n{ITEM}{ITEM.replace('a, b', 'a, c')}",
        "trajectory 1 moves a, c, trajectory 0 a, b; trajectories of the same joints alone",
    ),
    "huge.csv": (CSV.replace("0.3", "1e308"), r"is 1e\+308; it must be finite, at most 1e\+18"),
    "time going back.csv": (CSV.replace("0.2,", "0.05,"), "sample 2 comes 0.05 s before"),
    "degrees.csv": (
        VELOCITY + "0,0,0\n0.1,5.7296,1\n0.2,11.459,1\n0.3,17.189,1\n0.4,20,0\n",
        "are all in radians .a factor of 57.3 tells degrees. and seconds",
    ),
    "milliseconds.csv": (
        VELOCITY + "0,0,0\n100,0.1,1\n200,0.2,1\n300,0.3,1\n400,0.35,0\n",
        "1000: milliseconds",
    ),
    "no YAML.yaml": ("a: [", "is no YAML"),
    "a list.yaml": ("[1, 2]", "is no trajectory_msgs/JointTrajectory"),
    "no points.yaml": ("joint_names: [a]", "needs a list of points"),
    "no names.yaml": (ROS.replace("joint_names", "names"), "joint_names is None"),
    "few.yaml": (ROS.replace("[0.1, 1e-05]", "[0.1]"), "point 1: positions .* must be 2"),
    "a gap.yaml": (ROS.replace("positions: [0.1, 1e-05], ", ""), "point 1 has no positions"),
    "no time.yaml": (ROS.replace("{sec: 0, nanosec: 0}", "0.0"), "point 0: time_from_start is 0.0"),
    "the same time.yaml": (ROS.replace("100000000", "0"), "time must increase"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_file_that_cannot_be_read_says_why(name, tmp_path):
    text, message = BAD[name]
    path = written(tmp_path, name, text)
    with pytest.raises(TrajectoryError, match=message) as caught:
        read_trajectory_file(path)
    assert str(caught.value).startswith(str(path))


def test_short_files_that_are_sound_are_read_and_time_may_begin_anywhere(tmp_path):
    late = CSV.replace("0,0,0\n0.1,", "5,0,0\n5.1,").replace("0.2,0.3", "5.2,0.3")
    for text in (CSV, late):
        read = read_trajectory_file(written(tmp_path, "t.csv", text))
        assert read.trajectory.duration == pytest.approx(0.2)
    read = read_trajectory_file(written(tmp_path, "t.yaml", ROS))
    assert read.trajectory.position(0.1)[1] == pytest.approx(1e-5)  # a word to YAML 1.1


def test_what_samples_say_is_kept(tmp_path):
    """First time and efforts are reported: trajectories begin at zero and have no efforts."""
    path = written(tmp_path, "t.csv", "time,a.position,a.effort\n2.5,0,1\n3.5,1,1\n")
    assert read_trajectory_file(path).samples == GivenSamples(2.5, ("position",))
    points = [
        {"positions": [x], "velocities": [0.0], "effort": [1.0], "time_from_start": {"sec": x}}
        for x in (0, 1)
    ]
    path = written(tmp_path, "t.yaml", json.dumps({"joint_names": ["a"], "points": points}))
    samples = GivenSamples(0.0, ("position", "velocity"), has_effort=True)
    assert read_trajectory_file(path).samples == samples


def test_the_acceleration_of_a_joint_that_hardly_moves_does_not_jump_between_samples():
    time = np.arange(1000) / 1000
    tables = [0.7 + 1e-3 * np.sin(time), 1e-3 * np.cos(time), -1e-3 * np.sin(time)]
    joined = joined_samples(("a",), time, [values[:, None] for values in tables])
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


EVIL = "a\x1b[31mred\n\x9b31mFAKE: passes\u202e"
HEADER = "time,a.position,b.position\n"


def ours(breakpoints, coefficients, names=("a", "b")):
    fields = {"format": "tubeplanner/trajectory", "version": 1, "joint_names": list(names)}
    return json.dumps({**fields, "breakpoints": breakpoints, "coefficients": coefficients})


def ros(positions="[0, 0]", sec="{}", names="[a, b]", count=3):
    rows = [
        f"- positions: {positions}\n  time_from_start: {{sec: {sec.format(i)}, nanosec: 0}}\n"
        for i in range(count)
    ]
    return f"joint_names: {names}\npoints:\n" + "".join(rows)


REFUSED = {
    "brackets": ("t.yaml", "[" * 50_000, "nested more than 100 deep"),
    "brackets in JSON": ("t.json", "[" * 50_000, "nested more than 100 deep"),
    "aliases of aliases": (
        "t.yaml",
        "a0: &a0 [1, 2, 3]\n"
        + "".join(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]\n" for k in range(1, 10))
        + "joint_names: [a]\npoints: *a9\n",
        "aliases and merges stand for more than 100000 values",
    ),
    "a high degree": (
        "t.json",
        ours([0, 1.0], np.full((60, 1, 2), 9e3).tolist()),
        f"the degree is 59, at most {MAX_DEGREE}; divide the pieces",
    ),
    "many turns": (
        "t.json",
        ours([0, 1], [[[3e4, 0]], [[0, 0]]]),
        r"the position of 'a' may reach 3e\+04 rad or m in piece 0; files are read up to 10000",
    ),
    "too many pieces": (
        "t.json",
        ours(list(range(MAX_PIECES + 2)), [[[0, 0]] * (MAX_PIECES + 1)]),
        f"the number of pieces is {MAX_PIECES + 1}, at most {MAX_PIECES}; join some",
    ),
    "too many samples": (
        "t.csv",
        HEADER + "".join(f"{i},0.1,0.2\n" for i in range(100_002)),
        "has more than 100000 samples; write fewer per second",
    ),
    "a long field": ("t.csv", HEADER + f"0,0.1,{'1' * 140_000}\n", "is no CSV .field larger"),
    "samples at one instant": (
        "t.csv",
        HEADER + "0,0,0\n1e-300,1,1\n1,2,2\n",
        "it must come 1e-09 s after it or later",
    ),
    "many digits": ("t.yaml", ros(f"[{'9' * 400}, 0]"), "point 0: positions is inf; it must be"),
    "a long time": ("t.yaml", ros(sec="9" * 5000), "point 0: time_from_start is inf; it must be"),
    "a name that a terminal obeys": ("t.json", ours([0, 1], [[[0, 0]]], (EVIL, "b")), "rename it"),
    "such a name in a CSV": ("t.csv", HEADER.replace("a.", '"x\ny".'), "rename it"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_asks_for_too_much_is_refused(tmp_path, name):
    file, text, message = REFUSED[name]
    path = written(tmp_path, file, text)
    with pytest.raises(TrajectoryError, match=message) as caught:
        read_trajectory_file(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 400 + len(str(path))


def test_a_pipe_is_refused_without_waiting(tmp_path):
    path = tmp_path / "t.csv"
    os.mkfifo(path)
    with pytest.raises(TrajectoryError, match=f"{path} cannot be read: it is no regular file"):
        read_trajectory_file(path)


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("t.csv", HEADER + "".join(f"{i / 1000},0.123456,0.2345\n" for i in range(10_000))),
        ("t.json", ours(list(range(10_001)), [[[0.125, 0.25]] * 10_000])),
        ("t.yaml", ros(count=2000)),
    ],
    ids=["csv", "json", "yaml"],
)
def test_reading_takes_at_most_twenty_times_the_file(tmp_path, file, text):
    small = {"t.csv": CSV, "t.json": ours([0, 1], [[[0, 0]]]), "t.yaml": ROS}[file]
    read_trajectory_file(written(tmp_path, f"small_{file}", small))  # imports do not count
    path = written(tmp_path, file, text)
    tracemalloc.start()
    read_trajectory_file(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 20 * len(text)


def test_marks_are_read_in_order_and_those_after_the_end_refused_with_the_file(tmp_path):
    def read(**marks):
        still = JointTrajectory(["a"], [0.0, 2.0], [[[0.0]]])
        path = written(tmp_path, "t.json", trajectory_json(still, **marks))
        return read_trajectory_file(path).marks

    move = {"time": 0.0, "move": "there"}
    event = {"time": 2.0, "event": "gripper", "set": False}
    there = Mark(0.0, "move", "there")
    assert read(marks=[move, event]) == (there, Mark(2.0, "event", "gripper", False))
    assert read() == ()
    message = refusal(TrajectoryError, read, marks=[move, {"time": 2.1, "detach": "part"}])
    assert "t.json: marks[1].time is 2.1 s, after the end" in message
    assert "t.json: marks is None; it must be" in refusal(TrajectoryError, read, marks=None)
