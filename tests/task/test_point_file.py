"""Reference points from a CSV file: columns, faults by line, the tube of a problem."""

import json

import numpy as np
import pytest

from tubeplanner import load_problem
from tubeplanner.errors import ProblemError
from tubeplanner.orientation import matrix_of_quaternion, rotation_vector
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
        ("1,2,3,0,0,2\n4,5,6,0,0,1e-3", None, True),
        ("k,j,i,radius,x,y,z\n1,0,0,0.1,1,2,3\n1,0,0,,4,5,6\n", [0.1], True),
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
        ("x,y,z,i,j\n1,2,3,0,0", "has no column k"),
        ("x,y,z,i,j,k,qx,qy,qz,qw\n", "columns qx, qy, qz, qw and i, j, k; both say how"),
        ("x,y,z,i,j,k\n1,2,3,0,nan,1", "line 2: j is 'nan'; it must be a finite number"),
        ("# cam\n1,2,3,0,0,1\n4,5,6,0,0,0", "line 3: i, j, k are 0; give the direction"),
        ("1,2,3,0,0,1\n4,5,6,0,0,-2", "line 2: i, j, k are opposed to those of line 1"),
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


def test_tools_along_axes_turn_from_point_to_point_by_the_least_angle(tmp_path):
    axes = np.array([[0, 0, -1], [0, 1, -1], [1, 2, -1], [3, 1, -0.5]])
    rows = [f"{k},0,0,{','.join(map(str, axis))}" for k, axis in enumerate(axes.tolist())]
    matrices = matrix_of_quaternion(np.array(read(tmp_path, "\n".join(rows)).orientations))
    units = axes / np.linalg.norm(axes, axis=1)[:, None]
    np.testing.assert_allclose(matrices[:, :, 2], units, atol=1e-12)
    np.testing.assert_allclose(matrices[0, :, 0], [1, 0, 0], atol=1e-12)
    turned = np.linalg.norm(
        rotation_vector(matrices[:-1].transpose(0, 2, 1) @ matrices[1:]), axis=1
    )
    np.testing.assert_allclose(np.cos(turned), np.sum(units[1:] * units[:-1], axis=1))


def test_tool_axes_take_a_tolerance_that_may_leave_the_turn_about_them_free(tmp_path):
    text = PLAIN.replace("\n", ",0,0,-1\n")
    tube = problem_with(tmp_path, text, rotation_tolerance=[[3.0, 3.0, np.inf]]).tube
    assert tube.rotation_tolerance == ((3.0, 3.0, np.inf),) * 3
    with pytest.raises(ProblemError, match=r"rotation_tolerance is required beside the tool axes"):
        problem_with(tmp_path, text)


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
