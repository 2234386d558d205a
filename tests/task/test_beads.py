"""Beads: G-code, DXF drawings and files of points as tubes; every refusal is named."""

import sys

import numpy as np
import pytest

from tubeplanner.errors import OptionError, ProblemError
from tubeplanner.orientation import matrix_of_quaternion
from tubeplanner.task.beads import BeadOptions, bead_fields, frame_of, read_drawing
from tubeplanner.task.drawings import BEAD, FREE, LIMITED
from tubeplanner.task.gcode import read_gcode

SAGITTA = 1e-4


def ways_of(folder, text, **values):
    (folder / "bead.nc").write_text(text)
    return read_gcode(folder / "bead.nc", SAGITTA, **values)


CIRCLES = {
    "from centre": ("G17 G0 X10 Y0 Z0 \n G3 I-10 F600", (0, 1, 2), 1, 2 * np.pi),
    "clockwise": ("G0 X10 Y0 Z0 \n G2 X0 Y10 I-10 J0 F600", (0, 1, 2), -1, 1.5 * np.pi),
    "by radius": ("G0 X10 Y0 Z0 \n G3 X0 Y10 R10 F600", (0, 1, 2), 1, np.pi / 2),
    "the longer way": ("G0 X10 Y0 Z0 \n G2 X0 Y10 R-10 F600", (0, 1, 2), -1, 1.5 * np.pi),
    "zx plane": ("G18 G0 Z10 X0 Y0 \n G3 Z0 X10 K-10 F600", (2, 0, 1), 1, np.pi / 2),
    "yz plane": ("G19 G0 Y10 Z0 X0 \n G2 Y0 Z10 J-10 F600", (1, 2, 0), -1, 1.5 * np.pi),
    "helix": ("G0 X10 Y0 Z0 \n G91 G3 X-10 Y10 Z5 I-10 F600", (0, 1, 2), 1, np.pi / 2),
    "inches": ("G20 G0X0.393700787 Y0Z0 \n G3 I-0.393700787 F23.622", (0, 1, 2), 1, 2 * np.pi),
}


@pytest.mark.parametrize("name", CIRCLES)
def test_arcs_are_those_of_the_formula(tmp_path, name):
    text, (first, second, normal), turn, sweep = CIRCLES[name]
    (way,) = ways_of(tmp_path, text).ways
    assert (way.kind, round(way.speed, 6)) == (BEAD, 0.01)
    plane = way.points[:, [first, second]]
    np.testing.assert_allclose(np.linalg.norm(plane, axis=1), 0.01, rtol=1e-8)
    angle = np.unwrap(np.arctan2(plane[:, 1], plane[:, 0]))
    np.testing.assert_allclose(angle[-1] - angle[0], turn * sweep, atol=1e-8)
    middles = np.linalg.norm(plane[1:] + plane[:-1], axis=1) / 2
    assert 0 < 0.01 - middles.min() <= SAGITTA * (1 + 1e-9)
    rise = np.linspace(0, 0.005 if name == "helix" else 0, len(plane))
    np.testing.assert_allclose(way.points[:, normal], rise, atol=1e-12)


def test_modal_words_rapids_and_plunges_are_followed(tmp_path):
    text = """%\n(part: a) N1 G21 G90 G0 X1 Y2 Z5 ; to the place\nG1Z.5F60\nM8\nx11 F120.
    G91\nY-2\nZ1\nG0 Z4\nM30\nG1 X100\n"""
    drawing = ways_of(tmp_path, text)
    assert [way.kind for way in drawing.ways] == [LIMITED, BEAD, BEAD, LIMITED, FREE]
    assert [way.speed for way in drawing.ways] == [0.001, 0.002, 0.002, 0.002, None]
    ends = [[1, 2, 0.5], [11, 2, 0.5], [11, 0, 0.5], [11, 0, 1.5], [11, 0, 5.5]]
    np.testing.assert_allclose([way.points[-1] for way in drawing.ways], np.array(ends) / 1000)
    notes = "\n".join(drawing.notes)
    assert "not used: M8 (line 4), M30 (line 10)" in notes
    assert "not read: 1 lines from line 11 on, after the end of the program in line 10" in notes
    assert [way.speed for way in ways_of(tmp_path, text, speed=0.1).ways[1:3]] == [0.1, 0.1]


def test_a_position_that_was_not_set_is_zero_with_a_note(tmp_path):
    drawing = ways_of(tmp_path, "G1 X10 Y5 F60")
    np.testing.assert_allclose(drawing.ways[0].points, [[0, 0, 0], [0.01, 0.005, 0]])
    assert "line 1: the position has no Z yet; 0 is taken" in drawing.notes[0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "bead.nc has no bead"),
        ("G0 X0 Y0 Z0\nG1 Z1 F60", "has no bead"),
        ("G1 X1 F60\nG28", "line 2: G28 is not read; lines and arcs are"),
        ("G1 X#1", "line 1: 'X#1' is not read; a line has words"),
        ("G1 X1 (open F60", "line 1: '.*OPE.*' is not read"),
        ("G1 X1 A90 F60", "line 1: A90 is not read; the tool is moved by"),
        ("G1 X1 X2 F60", "line 1: X is given twice"),
        ("G0 G1 X1", "line 1: G0 and G1 are in one line"),
        ("X1", "line 1: X is given, but neither here nor before G0"),
        ("G1 X1", "line 1: G1 has no feed"),
        ("G1 X1 F0", "line 1: F is 0; a feed must be > 0"),
        ("G1 X1 I1 F60", "line 1: I is for arcs, and the motion is G1"),
        ("G2 X1 F60", "line 1: an arc takes I, J, K or R, and the motion is G2"),
        ("G2 X1 I1 R1 F60", "line 1: an arc takes R or I, J, K; it has both"),
        ("G2 X1 K1 F60", "line 1: K is along the normal of the plane G17"),
        ("G2 X10 I2 F60", "the arc's radius is 2 mm at its begin and 8 mm at its end"),
        ("G2 X10 R2 F60", "R is 2 mm, and the ends of the arc are 10 mm apart"),
        ("G2 R2 F60", "ends of the arc are 0 mm apart"),
    ],
)
def test_a_fault_of_g_code_is_named_with_its_line(tmp_path, text, message):
    with pytest.raises(ProblemError, match=message):
        ways_of(tmp_path, text)


# ---- DXF.


def drawn(folder, draw, unit=4):
    document = pytest.importorskip("ezdxf").new()
    document.units = unit
    draw(document)
    document.saveas(folder / "bead.dxf")
    return folder / "bead.dxf"


def mixed(document):
    space = document.modelspace()
    space.add_arc((50, 20), 10, 0, 90)  # from the end of the polyline
    space.add_lwpolyline([(0, 0), (60, 20)])
    space.add_text("part 1")
    document.layouts.get("Layout1").add_line((0, 0), (1, 0))
    document.layers.add("second")
    space.add_circle((0, 0), 30, dxfattribs={"layer": "second"})


def test_entities_that_meet_become_one_bead(tmp_path):
    path = drawn(tmp_path, mixed)
    first, circle = read_drawing(path, BeadOptions()).ways
    np.testing.assert_allclose(first.points[[0, -1]], [[0, 0, 0], [0.05, 0.03, 0]], atol=1e-12)
    arc = np.linalg.norm(first.points[1:, :2] - [0.05, 0.02], axis=1)
    np.testing.assert_allclose(arc, 0.01)
    np.testing.assert_allclose(np.linalg.norm(circle.points, axis=1), 0.03)
    sides = np.linalg.norm(circle.points[1:] + circle.points[:-1], axis=1) / 2
    assert sides.min() >= 0.03 - 1e-4
    only = read_drawing(path, BeadOptions(speed=0.1), ("second",))
    assert [way.speed for way in only.ways] == [0.1]
    assert "entities that are not used: 3 on layer 0, 1 on sheets (paper space)" in only.notes[0]


def test_bulges_keep_the_direction_of_their_polyline(tmp_path):
    def draw(document):
        points = [(0, 0, -1), (20, 0, 0), (40, 0, 1), (60, 0, 0)]
        document.modelspace().add_lwpolyline(points, format="xyb")
        document.modelspace().add_spline([(60, 0, 0), (80, 10, 0), (100, 0, 0)])

    (way,) = read_drawing(drawn(tmp_path, draw), BeadOptions()).ways
    np.testing.assert_allclose(way.points[[0, -1]], [[0, 0, 0], [0.1, 0, 0]], atol=1e-9)
    assert (np.diff(way.points[:, 0]) > -1e-9).all()
    upper, lower = way.points[:, 0] < 0.02, (way.points[:, 0] > 0.04) & (way.points[:, 0] < 0.06)
    assert way.points[upper, 1].max() > 0.0098 and way.points[lower, 1].min() < -0.0098


@pytest.mark.parametrize(
    ("draw", "unit", "layers", "message"),
    [
        (mixed, 17, (), r"\$INSUNITS is 17; a length of 1"),
        (mixed, 4, ("third",), "--layer: unknown layer 'third'; there is: 0, second"),
        (lambda document: document.modelspace().add_text("a"), 4, (), "has no bead on layers 0"),
    ],
)
def test_a_fault_of_a_drawing_is_named(tmp_path, draw, unit, layers, message):
    with pytest.raises(ProblemError, match=message):
        read_drawing(drawn(tmp_path, draw, unit), BeadOptions(), layers)


def test_a_drawing_without_a_unit_is_in_mm_with_a_note(tmp_path):
    drawing = read_drawing(drawn(tmp_path, mixed, 0), BeadOptions())
    assert "has no unit" in drawing.notes[0] and drawing.ways[1].points[0, 0] == 0.03


def test_a_file_that_is_no_drawing_and_a_missing_library_are_named(tmp_path, monkeypatch):
    (tmp_path / "bead.dxf").write_text("G1 X1")
    with pytest.raises(ProblemError, match=r"bead.dxf cannot be read"):
        read_drawing(tmp_path / "bead.dxf", BeadOptions())
    monkeypatch.setitem(sys.modules, "ezdxf", None)
    with pytest.raises(ProblemError, match=r"takes ezdxf, which is not installed: pip install"):
        read_drawing(tmp_path / "bead.dxf", BeadOptions())


# ---- The tube.


def fields_of(folder, text, ending=".nc", **values):
    path = folder / f"bead{ending}"
    path.write_text(text)
    options = BeadOptions(**values)
    return bead_fields(read_drawing(path, options), options)


def test_beads_begin_and_end_with_ways_along_the_tool(tmp_path):
    fields, notes = fields_of(tmp_path, "x,y,z\n0,0,0\n0.1,0,0\n", ".csv", lift=0.03, radius=0.002)
    tube = fields["tube"]
    assert tube["points"] == [[0, 0, 0.03], [0, 0, 0], [0.1, 0, 0], [0.1, 0, 0.03]]
    assert tube["radius"] == [0.002] * 3 and "tool_speed" not in tube
    assert notes == ["beads have no speed; --speed gives them one"]
    assert fields["start"]["pose"] == {"position": [0, 0, 0.03], "quaternion": [1, 0, 0, 0]}


def test_tool_axes_of_a_file_turn_with_the_frame(tmp_path):
    text = "0,0,0,0,1,0\n0.1,0,0,0,1,0\n"
    fields, _ = fields_of(
        tmp_path, text, ".csv", speed=0.1, frame=frame_of("1,0,0,0,0,1.5707963267948966")
    )
    tube = fields["tube"]
    np.testing.assert_allclose(tube["points"][0], [1.02, 0, 0], atol=1e-8)  # against the axis
    axes = matrix_of_quaternion(np.array(tube["orientations"]))[:, :, 2]
    np.testing.assert_allclose(axes, [[-1, 0, 0]] * 4, atol=1e-8)
    assert tube["tool_speed"] == [None, {"speed": 0.1, "tolerance": 0.05}, None]


def test_ways_between_beads_are_wide_and_stay_above_them(tmp_path):
    text = "G0 X0 Y0 Z6\nG0 X9\nG1 Z0 F6000\nG1 X20\nG0 Z6\nG0 X0"
    fields, _ = fields_of(tmp_path, text, tolerance=0.0)
    assert fields["tube"]["radius"] == [0.005, 0.001, 0.001, 0.001, 0.005]
    assert fields["tube"]["tool_speed"] == [None, 0.1, 0.1, None, None]


def test_speeds_that_have_none_in_common_get_a_segment_with_both(tmp_path):
    text = "G0 X0 Y0 Z20\nG1 Z0 F600\nG1 X50 F6000\nX90 F3000\nX91 F6000\n"
    fields, notes = fields_of(tmp_path, text, run_in=0.001)
    tube = fields["tube"]
    fast, slow = ({"speed": v, "tolerance": 0.05} for v in (0.1, 0.05))
    both = {"between": [0.05 * 0.95, 0.1]}
    assert tube["tool_speed"] == [0.01, 0.1, fast, both, slow, both, None]
    heights = [point[2] for point in tube["points"]]
    ramp = (0.1**2 - 0.01**2) / 2
    np.testing.assert_allclose(heights[:3], [0.02, ramp, 0])
    assert "speeds change at 3 points" in notes[-1]
    assert tube["process"] == {"run_in": 0.001, "run_out": 0.001}


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"radius": 0.0}, "radius is 0 m; it must be > 0"),
        ({"speed": -1.0}, "speed is -1 m/s; it must be > 0"),
        ({"tolerance": 0.95}, "tolerance is 0.95; it must be from 0 to 0.9"),
        ({"run_in": -1.0}, "run_in is -1; it must be >= 0"),
        ({"tilt": 4.0}, "tilt is 4 rad; it must be > 0 and < 3.14"),
    ],
)
def test_an_option_out_of_its_bounds_is_named(values, message):
    with pytest.raises(OptionError, match=message):
        BeadOptions(**values)


@pytest.mark.parametrize("text", ["1,2", "1,2,x", "1,2,3,0,0,0,0"])
def test_a_frame_is_a_position_and_a_rotation(text):
    with pytest.raises(OptionError, match="--frame"):
        frame_of(text)
    np.testing.assert_array_equal(frame_of("1,2,3,0,0,0,1")[:3, 3], [1, 2, 3])
