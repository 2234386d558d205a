"""What is known of a problem that cannot be posed, and what can be drawn of it."""

import numpy as np
import pytest

from asked_problems import POINTS, asked
from tubeplanner.errors import ProblemError
from tubeplanner.explanation.unposed import Unposed

APART = [{"joint2": [-2, -1]}, {"joint2": [0, 1]}, {}]


def unposed(**changes):
    """Return what is known of the planar problem with values by field path, dots as `__`."""
    question = asked({path.replace("__", "."): value for path, value in changes.items()})
    with pytest.raises(ProblemError) as raised:
        question.load()
    return Unposed.of(question, raised.value)


def test_a_start_outside_a_limit_has_its_place_and_is_drawn():
    known = unposed(start={"joints": [0.2, 4.0]})
    assert known.message.startswith("start: joint 'joint2' at 4 is outside")
    assert (known.place.joint, known.place.segment, known.proved) == ("joint2", 0, None)
    np.testing.assert_array_equal(known.configuration, [0.2, 4.0])
    np.testing.assert_array_equal(known.drawn.tube.points, POINTS)
    assert [each.name for each in known.drawn.obstacles] == ["post.1"]


def test_a_start_outside_its_segment_has_the_tool_as_its_place():
    known = unposed(start={"joints": [0.0, -0.5]})
    tool = known.drawn.robot.tool_position(np.array([[0.0, -0.5]]))[0]
    assert known.place.position == pytest.approx(tool)
    assert (known.place.segment, known.place.point) == (0, 0)
    np.testing.assert_array_equal(known.configuration, [0.0, -0.5])


def test_a_goal_outside_its_segment_is_shown_there():
    known = unposed(goal={"joints": [0.0, -0.5]})
    assert (known.place.segment, known.place.point) == (2, 3)
    np.testing.assert_array_equal(known.configuration, [0.0, -0.5])


@pytest.mark.parametrize("signs", [APART, {"joint2": [4, 5]}])
def test_ranges_that_do_not_meet_are_proved_and_the_tube_is_drawn_without(signs):
    known = unposed(tube__joint_signs=signs)
    assert known.proved is True
    assert known.message.endswith("proved: there is no motion")
    assert (known.place.joint, known.place.segment) == ("joint2", 0)
    assert known.drawn.tube.joint_ranges == ({}, {}, {})


def test_of_a_union_of_capsules_one_may_be_left_out():
    known = unposed(tube__joint_signs={"joint2": [4, 5]}, tube__visit="any")
    assert known.proved is None


def test_a_tube_is_drawn_without_what_it_contradicts():
    known = unposed(tube__tool_radius=0.04)
    assert known.drawn.tube.tool_radius == 0
    assert known.drawn.tube.radius.tolist() == [0.03, 0.05, 0.05]


def test_a_tube_of_no_size_cannot_be_drawn():
    known = unposed(tube__radius=-1.0)
    assert known.drawn is None
    assert known.place.joint is None


def test_a_solid_that_cannot_be_read_is_refused_as_by_a_plan():
    with pytest.raises(ProblemError, match=r"no\.stl"):
        unposed(obstacles=[{"name": "part", "mesh": "no.stl"}])
