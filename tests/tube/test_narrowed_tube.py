import numpy as np
import pytest

from tubeplanner import ProblemError, Tube
from tubeplanner.tube.narrowed_tube import narrowed_tube

POINTS = [[0, 0, 0], [0.4, 0, 0], [0.4, 0.3, 0.1]]
TURNED = [[0, 0, 0, 1], [0, 0, 0.5**0.5, 0.5**0.5], [0, 0, 0.5**0.5, 0.5**0.5]]
BOX = {"box": [0.06, 0.1], "up": [0, 0, 1]}
BY = np.array([0.01, 0.004])
NOT_TURNED = np.zeros(2)


@pytest.mark.parametrize(
    "tube",
    [
        Tube(POINTS, [0.03, 0.05]),
        Tube(POINTS, [0.03, 0.05], tool_radius=0.015),
        Tube(POINTS, [None, 0.05], cross_section=[BOX, None]),
        Tube(POINTS, None, cross_section=BOX, tool_radius=0.01),
    ],
    ids=["discs", "with a tool", "box and disc", "boxes"],
)
def test_every_point_is_inside_by_as_much_less(tube):
    """Also outside of it, where a corner of a box is nearest; there by no less than that."""
    tool = np.random.default_rng(0).uniform(-0.05, 0.45, (400, 3)) * [1, 1, 0.3]
    before, after = tube.margin(tool), narrowed_tube(tube, BY, NOT_TURNED).margin(tool)
    inside = after >= 0
    assert inside.any() and not inside.all()
    taken = before - after
    assert taken[:, ~tube.is_box] == pytest.approx(
        np.broadcast_to(BY, taken.shape)[:, ~tube.is_box]
    )
    assert (taken <= BY + 1e-12).all()
    assert taken[inside] == pytest.approx(np.broadcast_to(BY, taken.shape)[inside])


def test_rotation_tolerances_are_less_by_an_angle_free_ones_stay_free():
    tolerance = [0.2, (0.1, np.inf, 0.3)]
    tube = Tube(POINTS, 0.03, orientations=TURNED, rotation_tolerance=tolerance)
    narrowed = narrowed_tube(tube, np.zeros(2), np.array([0.05, 0.02]))
    bounds = narrowed.rotation.bounds
    assert bounds[0, 3] == pytest.approx(0.15)
    assert bounds[1, :3] == pytest.approx([0.08, np.inf, 0.28])
    assert (narrowed.points == tube.points).all()


def test_what_else_is_asked_stays():
    tube = Tube(
        POINTS,
        0.03,
        joint_signs={"joint2": "-"},
        pass_through_points="all",
        tool_speed=[0.2, None],
        numbers=[0, 3, 4],
    )
    narrowed = narrowed_tube(tube, BY, NOT_TURNED)
    assert narrowed.joint_ranges == tube.joint_ranges
    assert narrowed.tool_speed.tolist() == tube.tool_speed.tolist()
    assert narrowed.numbers.tolist() == [0, 3, 4]
    assert narrowed.pass_through_points == "all"


def test_nothing_left_is_no_tube():
    with pytest.raises(ProblemError, match=r"tube\.radius\[1\] is -0\.02 m"):
        narrowed_tube(Tube(POINTS, 0.03), np.array([0.0, 0.05]), NOT_TURNED)
