import numpy as np
import pytest

from tubeplanner import Tube
from tubeplanner.errors import ProblemError

LINE = [[0, 0, 0], [1, 0, 0], [1, 1, 0]]
TWICE = [[0, 0, 0], [1, 0, 0], [1, 5e-7, 0], [1, 1, 0]]
UP = [0, 0, 0, 1]


def test_a_point_like_the_one_before_is_left_out_with_its_segment_and_a_note():
    signs = [{"elbow": "+"}, {"elbow": "+"}, {"elbow": "0"}]
    tube = Tube(TWICE, [0.1, 0.1, 0.2], joint_signs=signs, tool_speed=[0.3, 0.3, 0.4])
    np.testing.assert_array_equal(tube.points, LINE)
    assert tube.radius.tolist() == [0.1, 0.2]
    assert tube.tool_speed.tolist() == [0.3, 0.4]
    assert tube.joint_signs == (signs[0], signs[2])
    assert tube.numbers.tolist() == [0, 1, 3]
    assert [tube.segment_number(k) for k in (0, 1)] == [0, 2]
    assert [tube.segment_index(number) for number in (0, 2)] == [0, 1]
    (note,) = tube.notes
    assert "point 2 is the same as the one before within 1e-06 m" in note
    assert "with segment 1" in note


def test_nothing_is_said_where_all_points_are_apart():
    tube = Tube(LINE, 0.1)
    assert tube.notes == ()
    assert tube.numbers.tolist() == [0, 1, 2]


@pytest.mark.parametrize("at", [0, 1, 2])
def test_orientations_go_with_their_points(at):
    points, quaternions = [*LINE[: at + 1], *LINE[at:]], [UP, UP, [0, 0, np.sin(0.3), np.cos(0.3)]]
    turned = [*quaternions[: at + 1], *quaternions[at:]]
    tube = Tube(points, 0.1, orientations=turned, rotation_tolerance=0.2)
    np.testing.assert_allclose(tube.orientations, quaternions)
    np.testing.assert_allclose(tube.rotation.angles, [0, 0.6])
    assert tube.rotation_tolerance == (0.2, 0.2)


@pytest.mark.parametrize("change", ["radius", "signs", "tolerance", "speed"])
def test_what_only_the_segment_left_out_asks_is_not_lost(change):
    signs = [{}, {"elbow": "+"} if change == "signs" else {}, {}]
    tolerance = [0.2, 0.1 if change == "tolerance" else 0.2, 0.2]
    radius = [0.1, 0.05 if change == "radius" else 0.1, 0.1]
    speed = [0.5, 0.4 if change == "speed" else 0.5, 0.5]
    turned = {"orientations": [UP] * 4, "rotation_tolerance": tolerance}
    with pytest.raises(ProblemError, match=r"points 1 and 2 .* segment 1 .* \(0 and 2\)"):
        Tube(TWICE, radius, joint_signs=signs, tool_speed=speed, **turned)


def test_a_turn_on_the_spot_is_refused():
    turned = [UP, UP, [0, 0, np.sin(0.1), np.cos(0.1)], UP]
    with pytest.raises(ProblemError, match=r"turn by 0.2 rad between them"):
        Tube(TWICE, 0.1, orientations=turned, rotation_tolerance=1.0)


def test_at_least_two_points_are_apart():
    with pytest.raises(ProblemError, match="points 0 and 2 are the same within 1e-06 m"):
        Tube([[0, 0, 0]] * 3, 0.1)
