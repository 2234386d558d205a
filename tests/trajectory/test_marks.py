"""Marks as trajectory files have them."""

import json

import pytest

from tubeplanner import Mark, TrajectoryError
from tubeplanner.trajectory.marks import marks_of

MARKS = [
    {"time": 0.0, "move": "to_pick"},
    {"time": 0.5, "event": "gripper", "set": "close"},
    {"time": 0.5, "event": "valve", "set": False},
    {"time": 0.65, "attach": "part"},
    {"time": 0.65, "detach": "tool"},
]


def test_marks_are_read_and_written_as_they_are():
    marks = marks_of(json.loads(json.dumps(MARKS)))
    assert marks[1] == Mark(0.5, "event", "gripper", "close")
    assert [mark.kind for mark in marks] == ["move", "event", "event", "attach", "detach"]
    assert [mark.as_dict() for mark in marks] == MARKS
    assert str(marks[1]) == "0.5000 s: event gripper close"
    assert str(marks[3]) == "0.6500 s: attach part"
    assert marks_of([]) == ()


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"time": 0}, r"marks is \{'time': 0\}; it must be a list"),
        (None, "marks is None; it must be a list"),
        ([*MARKS[:1], 3], r"marks\[1\] is 3; it must be a map with a time and one name of move, "),
        ([{"time": 0, "stop": "a"}], r"marks\[0\] is .*; it must be a map with a time and one"),
        ([{"time": 0, "move": "a", "event": "b"}], r"marks\[0\] is .* one name of move, event"),
        ([{"time": 0, "move": 1}], r"marks\[0\] is .*; it must be a map with a time and one"),
        ([{"move": "a"}], r"marks\[0\].time is None; it must be a time \[s\]"),
        ([{"time": -0.1, "move": "a"}], r"marks\[0\].time is -0.1; it must be a time"),
        ([{"time": True, "move": "a"}], r"marks\[0\].time is True; it must be a time"),
        ([{"time": float("nan"), "move": "a"}], r"marks\[0\].time is nan; it must be a time"),
        ([*MARKS, {"time": 0.6, "move": "b"}], r"marks\[5\].time is 0.6 s, before the one before"),
    ],
)
def test_other_marks_are_refused(fields, message):
    with pytest.raises(TrajectoryError, match=message):
        marks_of(fields)
