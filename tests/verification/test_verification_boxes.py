"""The judge of tubes of boxes, against closed forms: motions along the axes of a gantry."""

from itertools import pairwise

import numpy as np
import pytest

from tubeplanner import JointTrajectory, PlanningProblem, Tube, load_robot, verify
from tubeplanner.errors import ProblemError

AXIS = """<joint name="{name}" type="prismatic"><parent link="{parent}"/><child link="{child}"/>
<axis xyz="{axis}"/><limit lower="-5" upper="5" effort="1000" velocity="100"/></joint>
<link name="{child}"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
REST_TO_REST = np.array([6.0, -15.0, 10.0, 0.0, 0.0, 0.0])
FLAT = {"box": [0.2, 0.04], "up": [0, 0, 1]}
SQUARE = {"box": [0.04, 0.04], "up": [0, 0, 1]}
LINE = [[0, 0, 0], [1, 0, 0]]


@pytest.fixture(scope="module")
def gantry(tmp_path_factory):
    """A gantry: the tool is at its three joints' positions."""
    axes = (("x", "base", "1 0 0"), ("y", "at_x", "0 1 0"), ("z", "at_y", "0 0 1"))
    parts = [AXIS.format(name=n, parent=p, child=f"at_{n}", axis=a) for n, p, a in axes]
    path = tmp_path_factory.mktemp("gantry") / "gantry.urdf"
    path.write_text(f'<robot name="gantry"><link name="base"/>{"".join(parts)}</robot>')
    return load_robot(path, "at_z", gravity=(0, 0, 0))


def straight(*places):
    """Return a motion from place to place, from rest to rest in a second each."""
    parts = [REST_TO_REST[:, None, None] * np.subtract(q, p) for p, q in pairwise(places)]
    for part, begin in zip(parts, places, strict=False):
        part[-1] += begin
    return JointTrajectory(
        tuple("xyz"), np.arange(len(places)) * 1.0, np.concatenate(parts, axis=1)
    )


def judged(gantry, tube, trajectory):
    ends = (trajectory.position(0.0), trajectory.position(trajectory.duration))
    problem = PlanningProblem(gantry, tube, *ends, self_collision=False)
    return verify(problem, trajectory)


@pytest.mark.parametrize(
    ("offset", "margin"),
    [
        ([0, 0.08, 0.005], 0.015),
        ([0, 0.095, 0.005], 0.005),
        ([0, -0.095, -0.018], 0.002),
        ([0, 0.0, 0.0], 0.02),
    ],
    ids=["below the top", "beside a wall", "in a corner", "on the axis"],
)
def test_a_straight_motion_is_as_far_inside_as_its_nearest_face(gantry, offset, margin):
    trajectory = straight(np.add(LINE[0], offset), np.add(LINE[1], offset))
    certificate = judged(gantry, Tube(LINE, None, cross_section=FLAT), trajectory)
    assert certificate.passed
    assert certificate.conditions["tube"].margin == pytest.approx(margin, abs=1e-9)


def test_the_tool_radius_is_taken_off(gantry):
    trajectory = straight([0, 0.08, 0.005], [1, 0.08, 0.005])
    tube = Tube(LINE, None, cross_section=FLAT, tool_radius=0.008)
    found = judged(gantry, tube, trajectory).conditions["tube"]
    assert found.margin == pytest.approx(0.007, abs=1e-9)


@pytest.mark.parametrize("visit", ["ordered", "any"])
def test_in_the_corner_of_a_square_box_a_disc_is_left(gantry, visit):
    trajectory = straight([0, 0.019, 0.019], [1, 0.019, 0.019])
    box = judged(gantry, Tube(LINE, None, cross_section=SQUARE, visit=visit), trajectory)
    assert box.passed
    assert box.conditions["tube"].margin == pytest.approx(0.001, abs=1e-9)
    narrow = {"box": [0.04, 0.036], "up": [0, 0, 1]}
    start = [0, 0, 0]
    beside = straight(start, [0.5, 0.019, 0.019], [1, 0, 0])
    assert not judged(gantry, Tube(LINE, None, cross_section=narrow, visit=visit), beside).passed
    assert not judged(gantry, Tube(LINE, 0.02, visit=visit), beside).passed
    assert judged(gantry, Tube(LINE, None, cross_section=SQUARE, visit=visit), beside).passed


def test_a_wall_met_for_a_ten_thousandth_of_a_second_is_found(gantry):
    """A bump of 12 mm in a motion 10 mm beside the wall; one of 8 mm is none of its business."""
    for peak in (0.012, 0.008):
        begin, width = 0.5037, 1e-4
        plain = straight([0, 0.09, 0], [1, 0.09, 0])
        cuts = [0.0, begin, begin + width, 1.0]
        parts = [plain.between(low, high).coefficients for low, high in pairwise(cuts)]
        parts = [np.concatenate([np.zeros((1, 1, 3)), part]) for part in parts]
        bump = 64 * peak * np.array([-1.0, 3, -3, 1, 0, 0, 0]) / width ** np.arange(6, -1, -1)
        parts[1][:, 0, 1] += bump
        trajectory = JointTrajectory(tuple("xyz"), cuts, np.concatenate(parts, axis=1))
        found = judged(gantry, Tube(LINE, None, cross_section=FLAT), trajectory).conditions["tube"]
        assert found.margin == pytest.approx(0.01 - peak, abs=1e-6)


def test_segments_are_changed_where_both_boxes_hold_the_tool(gantry):
    """The boxes of a corner overlap farther out than the discs in them."""
    points = [[0, 0, 0], [1, 0, 0], [1, 1, 0]]
    boxes = Tube(points, None, cross_section=FLAT)
    trajectory = straight([0, 0, 0], [0.92, 0.08, 0], [1, 1, 0])
    certificate = judged(gantry, boxes, trajectory)
    assert certificate.passed
    assert certificate.conditions["tube"].margin == pytest.approx(0.02, abs=1e-9)
    assert not judged(gantry, Tube(points, 0.02), trajectory).passed
    mixed = Tube(points, [0.02, None], cross_section=[None, FLAT])
    assert not judged(gantry, mixed, trajectory).passed


def test_a_compulsory_point_is_passed_within_the_smaller_half_side(gantry):
    points = [[0, 0, 0], [1, 0, 0], [0, 0, 0]]
    tube = Tube(points, None, cross_section=FLAT)
    for short, passes in ((0.015, True), (0.03, False)):
        trajectory = straight([0, 0, 0], [1 - short, 0, 0], [0, 0, 0])
        found = judged(gantry, tube, trajectory)
        assert found.conditions["tube"].margin >= 0
        assert found.passed is passes
        assert found.conditions["points"].margin == pytest.approx(0.02 - short, abs=1e-6)


def test_a_start_outside_a_box_is_refused(gantry):
    with pytest.raises(ProblemError, match=r"0.005 m outside the box of segment 0"):
        PlanningProblem(gantry, Tube(LINE, None, cross_section=FLAT), [0.0, 0.0, 0.025])
