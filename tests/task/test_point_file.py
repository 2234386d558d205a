"""Reference points from a CSV file: columns, faults by line, the tube of a problem."""

import json

import numpy as np
import pytest

from tubeplanner import load_problem
from tubeplanner.errors import ProblemError
from tubeplanner.task.side_files import read_points

PLAIN = "0.45,-0.3,0.2\n0.45,-0.3,0.5\n0.45,0.3,0.5\n0.45,0.3,0.2\n"
RADII = "0.45,-0.3,0.2,0.04\n0.45,-0.3,0.5,0.03\n0.45,0.3,0.5,0.05\n0.45,0.3,0.2,\n"
BOX = {"box": [0.1, 0.06], "up": [1, 0, 0.5]}


def read(folder, text):
    (folder / "path.csv").write_text(text)
    return read_points(folder / "path.csv")


@pytest.mark.parametrize(
    ("text", "radius", "turned"),
    [
        ("1,2,3\n4,5,6", None, False),
        ("# scan\n\n z, x, y\r\n3, 1, 2\r\n6, 4, 5\r\n", None, False),
        ("1,2,3,0.1\n4,5,6,0.1", [0.1], False),
        ("1,2,3,0,0,0,1\n4,5,6,0,0,0,1", None, True),
        ("\ufeff1,2,3,0,0,0,1,1e-2\n4,5,6,0,0,0,1,", [0.01], True),
        ("radius,x,y,z\n0.1,1,2,3\n,4,5,6\n", [0.1], False),
    ],
)
def test_points_are_read_with_what_columns_there_are(tmp_path, text, radius, turned):
    content = read(tmp_path, text)
    assert content.points == [[1, 2, 3], [4, 5, 6]]
    assert content.radius == radius
    assert content.orientations == ([[0, 0, 0, 1]] * 2 if turned else None)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "path.csv is empty"),
        ("1,2\n3,4", "has 2 columns; x, y, z, then optionally"),
        ("x,y,w\n1,2,3", "No column 'w'|'w'"),
        ("x,y,z,qx\n1,2,3,4", "has no column qy"),
        ("x,y,z,x\n1,2,3,4", "has a column twice"),
        ("1,2,3\n1,2", "line 2 has 2 values for 3 columns"),
        ("x,y,z\n1,2,3\n1,two,3", "line 3: y is 'two'; it must be a finite number"),
        ("1,2,3,\n4,5,6,", "line 1: radius is ''"),
        ("1,2,3,0.1\n4,5,6,0.2", "the last radius, 0.2 m, belongs to no segment"),
    ],
)
def test_a_fault_is_named_with_its_line_and_column(tmp_path, text, message):
    with pytest.raises(ProblemError, match=message):
        read(tmp_path, text)


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(ProblemError, match=r"tube.points: .*none.csv cannot be read"):
        read_points(tmp_path / "none.csv")


def problem_with(folder, text, **tube):
    (folder / "path.csv").write_text(text)
    tube = {"points": "path.csv"} | tube
    path = folder / "problem.json"
    path.write_text(json.dumps({"include": "example:ur5/over_the_wall", "tube": tube}))
    return load_problem(path)


def test_a_problem_takes_its_points_from_a_file_next_to_it(tmp_path, bundled):
    tube = problem_with(tmp_path, PLAIN).tube
    np.testing.assert_array_equal(tube.points, bundled("ur5/over_the_wall").tube.points)
    np.testing.assert_array_equal(tube.radius, bundled("ur5/over_the_wall").tube.radius)


def test_radius_and_orientations_may_come_from_there(tmp_path):
    text = PLAIN.replace("\n", ",1,0,0,0,0.04\n")
    tube = problem_with(tmp_path, text, radius=None, rotation_tolerance=3.0).tube
    assert tube.radius.tolist() == [0.04] * 3
    np.testing.assert_array_equal(tube.orientations, [[1, 0, 0, 0]] * 4)


def test_boxes_go_with_points_from_a_file(tmp_path):
    tube = problem_with(tmp_path, PLAIN, radius=None, cross_section=BOX).tube
    np.testing.assert_allclose(tube.radius, [0.03] * 3)
    tube = problem_with(tmp_path, RADII, radius=None, cross_section=[None, BOX, None]).tube
    np.testing.assert_allclose(tube.radius, [0.04, 0.03, 0.05])


@pytest.mark.parametrize(
    ("text", "fields", "message"),
    [
        (RADII, {}, "tube.radius is given, and path.csv has it too"),
        (PLAIN, {"radius": None}, "tube.radius is required: give it here or as a column"),
        (RADII, {"radius": None, "cross_section": BOX}, r"radius\[0\] is 0.04 m, but segment 0 "),
    ],
)
def test_a_radius_is_given_once(tmp_path, text, fields, message):
    with pytest.raises(ProblemError, match=message):
        problem_with(tmp_path, text, **fields)
