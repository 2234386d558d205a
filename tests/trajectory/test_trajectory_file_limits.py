"""Trajectory files that ask for too much: refused by name, in little time and memory."""

import json
import os
import time
import tracemalloc

import numpy as np
import pytest

from tubeplanner import TrajectoryError
from tubeplanner.trajectory.joint_trajectory import MAX_DEGREE, MAX_PIECES
from tubeplanner.trajectory.trajectory_file import read_trajectory_file

EVIL = "a\x1b[31mred\n\x9b31mFAKE: passes\u202e"
HEADER = "time,a.position,b.position\n"


def ours(breakpoints, coefficients, names=("a", "b")):
    fields = {"format": "tubeplanner/trajectory", "version": 1, "joint_names": list(names)}
    return json.dumps({**fields, "breakpoints": breakpoints, "coefficients": coefficients})


def ros(positions="[0, 0]", sec="{}", names="[a, b]"):
    rows = [
        f"- positions: {positions}\n  time_from_start: {{sec: {sec.format(i)}, nanosec: 0}}\n"
        for i in range(3)
    ]
    return f"joint_names: {names}\npoints:\n" + "".join(rows)


def one_coefficient(value, width, degree=5):
    rows = np.zeros((degree + 1, 2, 2))
    rows[0, 0, 0] = value
    return ours([0, width, 1.0], rows.tolist())


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
    "one huge coefficient": (
        "t.json",
        one_coefficient(1e300, 0.5),
        r"the position of 'a' may reach 3\.13e\+298 rad or m in piece 0; beyond 1e\+06",
    ),
    "a huge coefficient in a short piece": (
        "t.json",
        one_coefficient(1e300, 1e-60),
        "the velocity of 'a' may reach .* rad/s or m/s in piece 0; beyond 1e",
    ),
    "many turns": ("t.json", one_coefficient(3e6, 0.5), "may reach 9\\.38e.* in piece 0"),
    "too many pieces": (
        "t.json",
        ours(list(range(MAX_PIECES + 2)), [[[0, 0]] * (MAX_PIECES + 1)]),
        f"the number of pieces is {MAX_PIECES + 1}, at most {MAX_PIECES}; join some",
    ),
    "a motion of no time": (
        "t.json",
        ours([0, 1e-300], [[[0.1, 0.2]]]),
        "the duration is 1e-300 s; it must be from 1e-09 to 1e",
    ),
    "a motion without end": ("t.json", ours([0, 1e300], [[[0, 0]]]), "the duration is 1e.300 s"),
    "too many samples": (
        "t.csv",
        HEADER + "".join(f"{i},0.1,0.2\n" for i in range(100_002)),
        "has more than 100000 samples; write fewer per second",
    ),
    "a long field": ("t.csv", HEADER + f"0,0.1,{'1' * 140_000}\n", "is no CSV .field larger"),
    "huge positions": (
        "t.csv",
        HEADER + "0,0.1,1e308\n1,-1e308,3\n2,1e308,1\n",
        r"row 2, b\.position is 1e\+308; it must be finite, at most 1e\+18",
    ),
    "samples at one instant": (
        "t.csv",
        HEADER + "0,0,0\n1e-300,1,1\n1,2,2\n",
        "it must come 1e-09 s after it or later",
    ),
    "many digits": ("t.yaml", ros(f"[{'9' * 400}, 0]"), "point 0: positions is inf; it must be"),
    "more digits": ("t.yaml", ros(sec="9" * 5000), "point 0: time_from_start is inf; it must be"),
    "a name that a terminal obeys": ("t.json", ours([0, 1], [[[0, 0]]], (EVIL, "b")), "rename it"),
    "such a name in a CSV": ("t.csv", HEADER.replace("a.", '"x\ny".'), "rename it"),
    "such a name in a message": ("t.yaml", ros(names='["a\\e[31m", b]'), "rename it"),
    "a name twice": ("t.json", ours([0, 1], [[[0, 0]]], ("a", "a")), "joint_names has 'a' twice"),
    "a name of a megabyte": (
        "t.json",
        ours([0, 1], [[[0, 0]]], ("x" * 10**6, "b")),
        r"1000000 characters long; shorten it to at most 200",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_asks_for_too_much_is_refused(tmp_path, name):
    file, text, message = REFUSED[name]
    path = tmp_path / file
    path.write_text(text)
    begin = time.process_time()
    with pytest.raises(TrajectoryError, match=message) as caught:
        read_trajectory_file(path)
    assert time.process_time() - begin < 10
    assert str(caught.value).startswith(f"{path}: ")
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 400 + len(str(path))


@pytest.mark.parametrize("ending", ["json", "csv", "yaml"])
def test_a_pipe_is_refused_without_waiting(tmp_path, ending):
    path = tmp_path / f"t.{ending}"
    os.mkfifo(path)
    with pytest.raises(TrajectoryError, match=f"{path} cannot be read: it is no regular file"):
        read_trajectory_file(path)


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("t.csv", HEADER + "".join(f"{i / 1000},0.123456,0.2345\n" for i in range(20_000))),
        ("t.json", ours(list(range(20_001)), [[[0.125, 0.25]] * 20_000])),
        pytest.param("t.yaml", "joint_names: [a, b]\npoints:\n" + "".join(
            f"- {{positions: [0.1, 0.2], time_from_start: {{sec: {i}}}}}\n" for i in range(20_000)
        ), marks=pytest.mark.slow),
    ],
)  # fmt: skip
def test_reading_takes_at_most_twenty_times_the_file(tmp_path, file, text):
    small, large = tmp_path / f"small_{file}", tmp_path / file
    start = ours([0, 1], [[[0, 0]]]) if file == "t.json" else text[:2000].rpartition("\n")[0]
    small.write_text(start)
    large.write_text(text)
    read_trajectory_file(small)  # what is imported does not count
    tracemalloc.start()
    read_trajectory_file(large)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 20 * len(text)


def test_a_quoted_name_is_read(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text('time,"a, ""b"".position"\n0,0\n1,1\n2,0\n')
    assert read_trajectory_file(path).trajectory.joint_names == ('a, "b"',)
