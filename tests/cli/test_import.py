"""`tubeplanner import` of beads: problem files from G-code, options that do not go together."""

import numpy as np
import pytest

from tubeplanner import load_problem

BEAD = "G0 X0 Y0 Z0\nG1 X50 F3000\nG3 X60 Y10 J10\nM5\n"
UR5 = ("--urdf", "example:ur5", "--tool-frame", "tool0", "--frame", "0.4,0,0.3")


@pytest.fixture
def bead(tmp_path):
    (tmp_path / "bead.ngc").write_text(BEAD)
    return tmp_path / "bead.ngc"


def test_a_bead_becomes_a_problem_that_loads(run, tmp_path, bead):
    path = tmp_path / "bead.yaml"
    status, out, _ = run("import", bead, *UR5, "--tilt", 0.2, "-o", path)
    assert status == 0 and "not used: M5 (line 4)" in out
    assert f"to plan it: tubeplanner plan {path}" in out
    problem = load_problem(path)
    tube = problem.tube
    np.testing.assert_allclose(tube.points[[0, -1]], [[0.4, 0, 0.32], [0.46, 0.01, 0.32]])
    assert set(tube.rotation_tolerance) == {(0.2, 0.2, np.inf)}
    assert tube.least_tool_speed[[0, 1, -1]].tolist() == [np.inf, 0.05 * 0.95, np.inf]
    assert problem.goal is None and path.read_text().startswith("## note: ")


def test_the_robot_of_another_problem_keeps_its_cell_alone(run, tmp_path, bead):
    (tmp_path / "cell.yaml").write_text(
        "include: example:ur5/over_the_wall\ntube: {tool_speed: 1.0}\n"
    )
    path = tmp_path / "bead.json"
    options = ("--problem", tmp_path / "cell.yaml", "--frame", "0.45,-0.3,0.3")
    status, out, _ = run("import", bead, *options, "-o", path)
    assert status == 0 and "not kept of the problem: tube.tool_speed; tube and" in out
    problem = load_problem(path)
    assert problem.obstacles and problem.goal is None and problem.tube.segment_count > 3


def test_a_drawing_out_of_reach_is_noted(run, tmp_path, bead):
    out = run("import", bead, *UR5[:-1], "4,0,0", "-o", tmp_path / "bead.yaml")[1]
    assert "note: the robot does not reach the drawing where --frame puts it: start" in out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("{bead}",), "takes either --urdf"),
        (("{bead}", "--urdf", "example:ur5"), "--tool-frame is required: a drawing has none"),
        (("{bead}", "{bead}", *UR5), "bead.ngc is a drawing; give it alone"),
        (("{bead}", *UR5, "--layer", "cut"), "--layer is for DXF drawings"),
        (("{bead}", *UR5, "--radius", "0"), "radius is 0 m; it must be > 0"),
        (("{bead}", *UR5[:-1], "1,2"), "--frame '1,2' must be X,Y,Z"),
        (("scene.yaml", *UR5), "--frame is for drawings: a file .gcode"),
        (("scene.yaml", *UR5[:-2], "--run-in", "1"), "--run-in is for drawings"),
    ],
)
def test_options_that_do_not_go_together_are_named(run, bead, words, message):
    status, _, error = run("import", *(word.format(bead=bead) for word in words))
    assert status == 2 and message in error
