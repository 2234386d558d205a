"""Marks of trajectory files."""

import json

import pytest

from tubeplanner import JointTrajectory, TrajectoryError
from tubeplanner.files.export import trajectory_json
from tubeplanner.trajectory.marks import Mark
from tubeplanner.trajectory.trajectory_file import read_trajectory_file

MOVE = {"time": 0.0, "move": "there"}


def read(tmp_path, marks):
    path = tmp_path / "t.json"
    trajectory = JointTrajectory(["a"], [0.0, 2.0], [[[0.0]]])
    path.write_text(trajectory_json(trajectory, marks=marks))
    return read_trajectory_file(path)


def test_marks_are_read_in_order(tmp_path):
    event = {"time": 2.0, "event": "gripper", "set": False}
    file = read(tmp_path, [MOVE, event])
    assert file.marks == (Mark(0.0, "move", "there"), Mark(2.0, "event", "gripper", False))


def test_a_file_without_marks_has_none(tmp_path):
    path = tmp_path / "t.json"
    fields = json.loads(trajectory_json(JointTrajectory(["a"], [0.0, 2.0], [[[0.0]]])))
    path.write_text(json.dumps(fields))
    assert read_trajectory_file(path).marks == ()


@pytest.mark.parametrize(
    ("marks", "message"),
    [
        ({}, "marks is {}; it must be a list"),
        (None, "marks is None; it must be a list"),
        ([{"time": 0.0}], r"marks\[0\] is .*one name of move, event, attach, detach"),
        ([{**MOVE, "event": "gripper"}], r"marks\[0\] is "),
        ([{"time": "soon", "move": "there"}], r"marks\[0\]\.time is 'soon'"),
        ([MOVE, {"time": -1.0, "move": "back"}], r"marks\[1\]\.time is -1\.0"),
        ([{"time": 1.0, "move": "x"}, MOVE], r"marks\[1\]\.time is 0 s, before the one before"),
        ([MOVE, {"time": 2.1, "detach": "part"}], r"marks\[1\]\.time is 2\.1 s, after the end"),
    ],
)
def test_malformed_marks_are_refused_with_the_file(marks, message, tmp_path):
    with pytest.raises(TrajectoryError, match=rf"t\.json: {message}"):
        read(tmp_path, marks)
