import pytest

from tubeplanner import RobotError, parse_problem
from tubeplanner.robot.srdf import read_allowed_pairs, read_group_states

PACKAGE = "package://example-robot-data/robots"


def test_disabled_pairs_are_read(tmp_path):
    path = tmp_path / "arm.srdf"
    path.write_text(
        '<robot name="arm"><group name="g"/>'
        '<disable_collisions link1="a" link2="b" reason="Never"/>'
        '<disable_collisions link1="b" link2="c"/></robot>'
    )
    assert read_allowed_pairs(path) == [("a", "b"), ("b", "c")]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<robot>", "cannot be read as SRDF"),
        ("<sdf/>", "the root element is <sdf>, not <robot>"),
        ('<robot><disable_collisions link1="a"/></robot>', "has no attribute 'link2'"),
    ],
)
def test_a_fault_is_named_with_its_file(tmp_path, text, message):
    path = tmp_path / "arm.srdf"
    path.write_text(text)
    with pytest.raises(RobotError) as caught:
        read_allowed_pairs(path)
    assert str(caught.value).startswith(str(path))
    assert message in str(caught.value)


def ur5(srdf):
    q = [-0.773861, -1.294184, 1.830514, -1.925057, -1.682929, 0.0]
    return {
        "robot": {"urdf": "example:ur5", "tool_frame": "tool0", "srdf": srdf},
        "tube": {"points": [[0.45, -0.3, 0.2], [0.45, -0.3, 0.4]], "radius": 0.05},
        "start": {"joints": q},
    }


def checked_pairs(problem):
    checker = problem.collision
    return {frozenset(checker.owners(pair)[0]) for pair in checker.link_pairs}


def test_the_pairs_of_a_problems_srdf_are_left_out():
    """The UR5's file disables base_link and upper_arm_link; unknown links do no harm."""
    pair = frozenset(("base_link", "upper_arm_link"))
    without = checked_pairs(parse_problem(ur5(None)))
    with_srdf = checked_pairs(parse_problem(ur5(f"{PACKAGE}/ur_description/srdf/ur5.srdf")))
    gripper = checked_pairs(parse_problem(ur5(f"{PACKAGE}/ur_description/srdf/ur5_gripper.srdf")))
    assert pair in without
    assert pair not in with_srdf
    assert with_srdf < without
    assert gripper < without


def test_a_missing_srdf_is_named():
    with pytest.raises(RobotError, match=r"problem: robot description .*none\.srdf does not exist"):
        parse_problem(ur5("none.srdf"))


def test_states_are_read(tmp_path):
    path = tmp_path / "arm.srdf"
    path.write_text(
        '<robot name="arm"><group_state name="home" group="g"><joint name="a" value="1.5"/>'
        '<joint name="ball" value="0 0 0 1"/></group_state></robot>'
    )
    assert read_group_states(path) == {"home": {"a": 1.5}}
    path.write_text(
        '<robot><group_state name="home"><joint name="a" value="up"/></group_state></robot>'
    )
    with pytest.raises(RobotError, match=r"home.*up.*must be a number"):
        read_group_states(path)
