"""Pairs that an SRDF allows to touch, and its named configurations."""

import pytest
from cases import SLIDE, refusal

from tubeplanner import RobotError, load_robot, parse_problem
from tubeplanner.robot.notes import robot_notes
from tubeplanner.robot.ros_files import read_srdf

PACKAGE = "package://example-robot-data/robots"


@pytest.fixture
def srdf(tmp_path):
    """Return a function that writes what an SRDF holds."""

    def write(inner, name="arm.srdf", attributes=""):
        path = tmp_path / name
        path.write_text(f'<robot name="arm"{attributes}>{inner}</robot>')
        return path

    return write


PAIRS = """
<group name="g"/><disable_default_collisions link="d"/>
<disable_collisions link1="a" link2="b"/><disable_collisions link1="c" link2="d"/>
<enable_collisions link1="d" link2="a"/><enable_collisions link1="d" link2="c"/>
"""


def test_pairs_may_touch_by_default_unless_enabled_and_in_any_case_if_disabled(srdf):
    """As in MoveIt since 2022: the order of the lines does not matter."""
    read = read_srdf(srdf(PAIRS))
    pairs = [("a", "b"), ("c", "d"), ("d", "b"), ("d", "e")]
    assert read.allowed_pairs(["a", "b", "c", "d", "e"]) == pairs
    assert read.notes(["a", "b", "c", "d", "e"]) == ()


def test_a_planned_joint_that_is_passive_is_noted(srdf, tmp_path):
    (tmp_path / "slide.urdf").write_text(SLIDE)
    path = srdf('<passive_joint name="lift"/><passive_joint name="other"/>')
    (note,) = robot_notes(load_robot(tmp_path / "slide.urdf", "tip", srdf=path))
    assert note.startswith("the SRDF calls lift passive, so without a motor")


def test_links_and_tags_that_mean_nothing_are_noted(srdf):
    path = srdf(PAIRS + '<disable_collision link1="a" link2="d"/>')
    unknown, tag = read_srdf(path).notes(["a", "b"])
    assert "the URDF has no link d, c; pairs with such a name count for nothing" in unknown
    assert tag == f"{path}: SRDF does not define, and nothing here uses: <disable_collision>"
    assert read_srdf(path).allowed_pairs(["a", "b"]) == [("a", "b")]


def test_macros_are_expanded_and_refused_under_another_name(srdf):
    macro = (
        '<xacro:arg name="far" default="c"/><xacro:macro name="off" params="a">'
        '<disable_collisions link1="${a}" link2="$(arg far)"/></xacro:macro><xacro:off a="b"/>'
    )
    path = srdf(macro, "arm.srdf.xacro", ' xmlns:xacro="http://www.ros.org/wiki/xacro"')
    assert read_srdf(path).allowed_pairs("abc") == [("b", "c")]
    assert read_srdf(path, {"far": "a", "robot": "x"}).allowed_pairs("abc") == [("b", "a")]
    plain = path.rename(path.with_name("arm.srdf"))
    assert "a file named arm.srdf.xacro is expanded" in refusal(RobotError, read_srdf, plain)


def test_states_are_read_and_those_of_other_than_numbers_left_out_or_refused(srdf):
    state = '<group_state name="home" group="g"><joint name="a" value="{}"/>{}</group_state>'
    path = srdf(state.format(1.5, '<joint name="ball" value="0 0 0 1"/>'))
    assert read_srdf(path).group_states() == {"home": {"a": 1.5}}
    message = refusal(RobotError, read_srdf(srdf(state.format("up", ""))).group_states)
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
    refused = refusal(RobotError, lambda: read_srdf(path).allowed_pairs("a"))
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
