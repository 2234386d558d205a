"""Pairs that an SRDF allows to touch, and its named configurations."""

import pytest
from cases import refusal

from tubeplanner import RobotError, parse_problem
from tubeplanner.robot.ros_files import read_allowed_pairs, read_group_states

PACKAGE = "package://example-robot-data/robots"


@pytest.fixture
def srdf(tmp_path):
    """Return a function that writes what an SRDF holds."""

    def write(inner):
        path = tmp_path / "arm.srdf"
        path.write_text(f'<robot name="arm">{inner}</robot>')
        return path

    return write


def test_disabled_pairs_are_read(srdf):
    pairs = '<disable_collisions link1="a" link2="b"/><disable_collisions link1="b" link2="c"/>'
    assert read_allowed_pairs(srdf(f'<group name="g"/>{pairs}')) == [("a", "b"), ("b", "c")]


def test_states_are_read_and_those_of_other_than_numbers_left_out_or_refused(srdf):
    state = '<group_state name="home" group="g"><joint name="a" value="{}"/>{}</group_state>'
    path = srdf(state.format(1.5, '<joint name="ball" value="0 0 0 1"/>'))
    assert read_group_states(path) == {"home": {"a": 1.5}}
    message = refusal(RobotError, read_group_states, srdf(state.format("up", "")))
    assert "home" in message and "up" in message and "must be a number" in message


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<robot>", "cannot be read as SRDF"),
        ("<sdf/>", "the root element is <sdf>, not <robot>"),
        ('<robot><disable_collisions link1="a"/></robot>', "has no attribute 'link2'"),
    ],
)
def test_a_fault_is_named_with_its_file(srdf, text, message):
    path = srdf("")
    path.write_text(text)
    refused = refusal(RobotError, read_allowed_pairs, path)
    assert refused.startswith(str(path))
    assert message in refused


def ur5_problem(srdf):
    q = [-0.773861, -1.294184, 1.830514, -1.925057, -1.682929, 0.0]
    robot = {"urdf": "example:ur5", "tool_frame": "tool0", "srdf": srdf}
    tube = {"points": [[0.45, -0.3, 0.2], [0.45, -0.3, 0.4]], "radius": 0.05}
    return parse_problem({"robot": robot, "tube": tube, "start": {"joints": q}})


def test_the_pairs_of_a_problems_srdf_are_left_out():
    """The UR5's file disables base_link and upper_arm_link; unknown links do no harm."""

    def checked_pairs(srdf):
        checker = ur5_problem(srdf).collision
        return {frozenset(checker.owners(pair)[0]) for pair in checker.link_pairs}

    without, plain, gripper = (
        checked_pairs(srdf and f"{PACKAGE}/ur_description/srdf/{srdf}")
        for srdf in (None, "ur5.srdf", "ur5_gripper.srdf")
    )
    assert frozenset(("base_link", "upper_arm_link")) in without - plain
    assert plain < without
    assert gripper < without


def test_a_missing_srdf_is_named():
    with pytest.raises(RobotError, match=r"problem: robot description .*none\.srdf does not exist"):
        ur5_problem("none.srdf")
