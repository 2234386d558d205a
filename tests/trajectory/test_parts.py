"""Parts of a trajectory, cut and joined; marks of events in time."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose as close
from numpy.testing import assert_array_equal as same
from scipy.interpolate import PPoly

from tubeplanner import JointTrajectory, Mark, TrajectoryError
from tubeplanner.trajectory.joint_trajectory import concatenate
from tubeplanner.trajectory.parts import marks_of, part_of, resting

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
        ([{"time": 0, "move": "a", "event": "b"}], r"marks\[0\] is .* one name of move, event"),
        ([{"move": "a"}], r"marks\[0\].time is None; it must be a time \[s\]"),
        ([{"time": -0.1, "move": "a"}], r"marks\[0\].time is -0.1; it must be a time"),
        ([{"time": float("nan"), "move": "a"}], r"marks\[0\].time is nan; it must be a time"),
        ([*MARKS, {"time": 0.6, "move": "b"}], r"marks\[5\].time is 0.6 s, before the one before"),
    ],
)
def test_other_marks_are_refused(fields, message):
    with pytest.raises(TrajectoryError, match=message):
        marks_of(fields)


NAMES = ("a", "b")
TIMES = [0.0, 0.4, 1.0, 1.3]


def trajectory(degree=5, seed=0):
    coefficients = np.random.default_rng(seed).normal(size=(degree + 1, 3, 2))
    return JointTrajectory(NAMES, TIMES, coefficients)


def scipys(whole):
    return PPoly(whole.coefficients, whole.breakpoints)


@pytest.mark.parametrize(
    ("begin", "end", "pieces"),
    [(0.0, 1.3, 3), (0.4, 1.0, 1), (0.3, 1.1, 3)],
)
def test_a_part_does_what_the_whole_does_then(begin, end, pieces):
    whole = trajectory()
    time = np.linspace(0, end - begin, 101)[1:-1]
    for part in (part_of(whole, begin, end), whole.between(begin, end)):
        assert part.duration == pytest.approx(end - begin)
        assert part.coefficients.shape == (6, pieces, 2)
        for order in range(4):
            expected = scipys(whole)(begin + time, order)
            result = scipys(part)(time, order)
            close(result, expected, rtol=1e-10, atol=1e-10)


def test_a_part_keeps_what_jumps_out_of_itself():
    """At a jump, a part ends with the value before it, and the next begins with the value after."""
    whole = trajectory()
    before, after = part_of(whole, 0.0, 0.4), part_of(whole, 0.4, 1.0)
    close(after.position(0.0), whole.coefficients[-1, 1])
    assert abs(before.position(0.4) - after.position(0.0)).max() > 0.1
    close(before.position(0.4), np.polyval(whole.coefficients[:, 0], 0.4))


@pytest.mark.parametrize("span", [(-0.1, 1.0), (0.5, 1.4), (0.5, 0.5), (np.nan, 1.0)])
def test_what_lies_outside_is_no_part(span):
    with pytest.raises(TrajectoryError, match=r"is no part of a trajectory of 1.3 s"):
        part_of(trajectory(), *span)


def test_parts_of_other_degrees_are_joined_one_after_the_other():
    first, second = trajectory(3, 1), trajectory(5, 2)
    rest = resting(NAMES, np.array([0.2, -0.7]), 0.25)
    whole = concatenate([first, rest, second])
    assert whole.duration == pytest.approx(1.3 + 0.25 + 1.3)
    time = np.linspace(0, 1.3, 60)[:-1]
    close(whole.position(time), scipys(first)(time), atol=1e-12)
    close(whole.velocity(1.55 + time), scipys(second)(time, 1), atol=1e-9)
    same(whole.position([1.3, 1.4, 1.5]), [[0.2, -0.7]] * 3)
    same(whole.velocity([1.3, 1.4]), np.zeros((2, 2)))
    # What is cut at breakpoints keeps its numbers.
    same(part_of(concatenate([second, first]), 0.0, 1.3).coefficients, second.coefficients)
