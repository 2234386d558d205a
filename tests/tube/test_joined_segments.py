import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from tubeplanner import Tube
from tubeplanner.tube.joined_segments import joined_segments

CORNER = np.array([[0, 0, 0], [0.7, 0, 0.1], [0.7, 0.9, 0.1]])
QUATERNIONS = Rotation.from_rotvec([[0, 0, 0.1], [0, 1.2, 0.3], [0.5, 1.0, 0]]).as_quat()


def divided(parts, quaternions=None, **options):
    """Return the corner's tube with every segment divided."""
    places = np.arange(2 * parts + 1) / parts
    points = np.array([np.interp(places, [0, 1, 2], column) for column in CORNER.T]).T
    points[::parts] = CORNER
    signs = [{"elbow": "+"}] * parts + [{"elbow": [0.0, 2.0]}] * parts
    if quaternions is not None:
        turned = Slerp([0, 1, 2], Rotation.from_quat(quaternions))(places).as_quat()
        turned[::parts] = quaternions
        options |= {"orientations": turned, "rotation_tolerance": [0.2] * parts + [0.3] * parts}
    speeds = [0.5] * parts + [None] * parts
    return Tube(
        points, np.repeat([0.1, 0.2], parts), joint_signs=signs, tool_speed=speeds, **options
    )


@pytest.mark.parametrize("parts", [2, 3, 16])
@pytest.mark.parametrize("quaternions", [None, QUATERNIONS], ids=["free", "turned"])
@pytest.mark.parametrize("visit", ["ordered", "any"])
def test_a_divided_line_is_one_segment_to_the_last_digit(parts, quaternions, visit):
    whole = divided(1, quaternions, visit=visit, tool_radius=0.01)
    given = divided(parts, quaternions, visit=visit, tool_radius=0.01)
    joined = joined_segments(given)
    np.testing.assert_array_equal(joined.points, whole.points)
    np.testing.assert_array_equal(joined.tool_speed, whole.tool_speed)
    np.testing.assert_array_equal(joined.radius, whole.radius)
    assert joined.joint_ranges == whole.joint_ranges
    assert (joined.visit, joined.tool_radius) == (visit, 0.01)
    assert joined.parts is given
    assert joined.numbers.tolist() == [0, parts, 2 * parts]
    if quaternions is not None:
        np.testing.assert_array_equal(joined.rotation.begin, whole.rotation.begin)
        np.testing.assert_array_equal(joined.rotation.turn, whole.rotation.turn)
        np.testing.assert_array_equal(joined.rotation.bounds, whole.rotation.bounds)
    assert joined_segments(joined) is joined


def test_a_segment_is_called_by_the_part_that_is_meant():
    joined = joined_segments(divided(4))
    assert [joined.segment_number(k) for k in (0, 1)] == [0, 4]
    near_the_end = np.array([0.69, 0.05, 0.1])
    assert joined.segment_number(0, near_the_end) == 3
    assert joined.segment_number(1, CORNER[2]) == 7
    assert [joined.segment_index(number) for number in range(8)] == [0] * 4 + [1] * 4


LINE = [[0, 0, 0], [1, 0, 0], [2, 0, 0]]
UP = [0, 0, 0, 1]


@pytest.mark.parametrize(
    ("points", "radius", "options"),
    [
        (LINE, [0.1, 0.2], {}),
        (LINE, 0.1, {"joint_signs": [{"elbow": "+"}, {"elbow": "0"}]}),
        (LINE, 0.1, {"pass_through_points": "all"}),
        (LINE, 0.1, {"tool_speed": [0.5, 0.6]}),
        (LINE, 0.1, {"tool_speed": [None, 0.6]}),
        (LINE, 0.1, {"orientations": [UP] * 3, "rotation_tolerance": [0.1, 0.2]}),
        (
            LINE,
            0.1,
            {
                "orientations": [UP, [0, 0, np.sin(0.1), np.cos(0.1)], UP],
                "rotation_tolerance": 0.1,
            },
        ),
        ([[0, 0, 0], [1, 0, 0], [0.5, 0, 0]], 0.1, {}),
        ([[0, 0, 0], [1, 0, 0], [0, 0, 0]], 0.1, {}),
        ([[0, 0, 0], [1, 2e-8, 0], [2, 0, 0]], 0.1, {}),
    ],
    ids=[
        "radius",
        "signs",
        "all",
        "speed",
        "free speed",
        "tolerance",
        "turn",
        "back",
        "there and back",
        "off",
    ],
)
def test_segments_that_ask_for_different_things_stay_apart(points, radius, options):
    tube = Tube(points, radius, **options)
    assert joined_segments(tube) is tube


@pytest.mark.parametrize("step", [1.0, np.pi / 4])
def test_segments_join_only_as_long_as_the_short_way_round_is_the_same(step):
    angles = np.arange(5) * step
    turned = Rotation.from_rotvec(angles[:, None] * [0, 0, 1]).as_quat()
    points = np.arange(5)[:, None] * [1.0, 0, 0]
    tube = Tube(points, 0.1, orientations=turned, rotation_tolerance=0.1)
    assert joined_segments(tube).numbers.tolist() == [0, 3, 4]


def test_orientations_that_bound_nothing_are_no_reason():
    turned = {"orientations": [UP, [1, 0, 0, 0], UP], "rotation_tolerance": np.inf}
    turned["orientations"][1] = [0, 0, np.sin(0.3), np.cos(0.3)]
    assert joined_segments(Tube(LINE, 0.1, **turned)).segment_count == 1
