"""UrdfDescription: links, joints, limits read strictly; <mimic> followers and leaders."""

import os
import xml.etree.ElementTree as ElementTree

import numpy as np
import pinocchio
import pytest
from arms import JOINTS, LINKS, RULES, follower_arm, solid
from cases import refusal
from numpy.testing import assert_allclose as close

from tubeplanner import LimitOverrides, Obstacle, load_robot
from tubeplanner.errors import RobotError
from tubeplanner.geometry.collision_checker import CollisionChecker
from tubeplanner.geometry.link_geometry import link_elements
from tubeplanner.geometry.solids import placement_of
from tubeplanner.robot.urdf import Mimic, followers_of, leader_of, read_urdf
from tubeplanner.robot.urdf_elements import declare_prefixes

LIMIT = '<limit lower="-1" upper="2" effort="10" velocity="3"/>'


def joint(name="j", kind="revolute", parent="a", child="b", inner=LIMIT):
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{inner}</joint>'


def links(names):
    return "".join(f'<link name="{name}"/>' for name in names)


def robot(*parts):
    return f'<robot name="arm">{"".join(parts)}</robot>'


@pytest.fixture
def read(tmp_path):
    """Return a function that reads a text or bytes as the description of an arm."""

    def read(text):
        path = tmp_path / "arm.urdf"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return read_urdf(path)

    return read


XACRO = '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:property name="l"/></robot>'
ENTITY = '<!DOCTYPE robot [<!ENTITY a "a">]><robot name="&a;"/>'
BACK = joint("k", parent="b", child="a")
ROOTS, LOOP = "the links must hang from one root; roots found: ", "the links form a loop through"
FAULTS = {
    "": "cannot be read as URDF: no element found",
    "<robot><link></robot>": "cannot be read as URDF: mismatched tag: line 1",
    "<sdf/>": "the root element is <sdf>, not <robot>",
    XACRO: "holds <xacro:property>: it must be expanded first, by xacro arm.urdf > arm.expanded.u",
    XACRO.replace("www.ros.org/wiki", "wiki.ros.org"): "holds <xacro:property>: it must be expan",
    ENTITY: "declares XML entities, which are not expanded; write them out",
    robot(): "holds no <link>",
    robot(links("ab"), joint(), "<jiont/>"): ": <robot> has <jiont>; did you mean 'joint'?",
    robot(links("ab"), joint()).replace("<robot", '<robot version="2.0"'): (
        ': <robot> version="2.0" is unknown; URDF has 1.0, 1.1, 1.2'
    ),
    robot(links("abc"), joint()): f"{ROOTS}['a', 'c']",
    robot(links("rab"), joint(), BACK): f"{LOOP} 'a'",
    robot("<link/>"): "a <link> element has no attribute 'name'",
    robot(links("ab"), joint(name="")): "a <joint> element has no attribute 'name'",
    robot(links("aba"), joint()): "link 'a' is defined 2 times",
    robot(links("abc"), joint(), joint(), joint(child="c")): "joint 'j' is defined 3 times",
    robot(links(["arm", "b"]), joint(parent="arn")): (
        "joint 'j': unknown link 'arn' (did you mean 'arm'?); there is: arm, b"
    ),
    robot(links("abc"), joint(child="c"), joint("k", parent="b", child="c")): (
        "link 'c' is the child of more than one joint"
    ),
    robot(links("ab"), joint(kind="revolut")): (
        "joint 'j': unknown type 'revolut' (did you mean 'revolute'?); there is: revolute, "
        "continuous, prismatic, fixed"
    ),
    robot(links("ab"), joint().replace('<parent link="a"/>', "")): "joint 'j' has no <parent>",
    robot(links("ab"), joint().replace('<child link="b"/>', "")): "joint 'j' has no <child>",
    robot(*(f'<link name="l{k}"/>' for k in range(2001))): (
        "has 2001 links; at most 2000 are accepted"
    ),
}
# By what a joint has beside its limits.
JOINT_FAULTS = {
    '<axis xyz="0 0 0"/>': ': <axis> xyz="0 0 0" is no direction',
    '<axis xyz="0 nan 1"/>': ': <axis> xyz="0 nan 1" must be 3 finite numbers',
    '<limit effort="10,5" velocity="1"/>': ': effort="10,5" is not a number',
    "<mimic/>": ": a <mimic> element has no attribute 'joint'",
    '<parent link="b"/>': " has 2 <parent>; one is needed",
    '<origin quat="0 0 1 0"/>': ": <origin> has the attribute 'quat'; known are xyz, rpy, quat_xyz",
    '<origin quat_xyzw="0 0 1 0"/>': (
        ': <origin> quat_xyzw="0 0 1 0" holds from URDF 1.1 on, and the file is of version 1.0'
    ),
    '<limits effort="1" velocity="1"/>': ": <joint> has <limits>; did you mean 'limit'?",
    '<limit efort="1" velocity="1"/>': ": <limit> has the attribute 'efort'; did you mean 'effort'",
    LIMIT + LIMIT: ": <joint> has 2 <limit>; one is needed",
    '<origin rpy="0 0 pi"/>': ': <origin> rpy="0 0 pi" must be 3 finite numbers',
    '<origin xyz="0 0 1e308"/>': ": <origin> xyz has 1e+308 m; at most 10000 m are accepted",
}
INERTIA = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
ONE = '<mass value="1"/>'


def inertial(inner):
    return f"<inertial>{inner}</inertial>"


def ball(origin):
    return solid('<sphere radius="1"/>', f"<origin {origin}/>")


# By what a link holds.
LINK_FAULTS = {
    inertial(INERTIA): "<inertial> has no <mass>; one is needed",
    inertial(ONE): "<inertial> has no <inertia>; one is needed",
    2 * inertial(ONE + INERTIA): "has 2 <inertial>; one is needed",
    inertial('<mass value="-2"/>' + INERTIA): "mass -2 kg must be >= 0",
    inertial(f'<mass value="{"x" * 10**6}"/>' + INERTIA): '..." must be one finite number',
    inertial(ONE + INERTIA.replace('ixx="1"', "")): '<inertia> ixx="" must be one finite number',
    inertial(ONE + INERTIA.replace('ixy="0"', 'ixy="3"')): (
        "the inertia has a principal moment of -2 kg m^2; no body has a negative one"
    ),
    solid('<box size="1 1"/>'): '<box> size="1 1" must be 3 finite numbers',
    solid('<box size="1 -1 1"/>'): '<box> size="1 -1 1" must be > 0 m',
    solid('<sphere radius="1e92"/>'): '<sphere> radius="1e92" must be > 0 m and at most',
    solid("<mesh/>"): "a <mesh> element has no attribute 'filename'",
    solid('<mesh filename="a.stl" scale="1 0 1"/>'): 'scale="1 0 1" must not be 0',
    solid('<cone radius="1" length="2"/>'): (
        "a <geometry> holds <cone>; it must hold one of <box>, <sphere>, <cylinder>, <capsule>, <me"
    ),
    solid('<capsule radius="1"/>'): '<capsule> length="" must be one finite number',
    "<Colision/>": ": <link> has <Colision>; did you mean 'collision'?",
    solid(""): "a <geometry> holds nothing; it must hold one of <box>, <sphere>",
    "<collision/>": "a <collision> has no <geometry>; one is needed",
    ball('xyz="0 0 x"'): '<collision>: <origin> xyz="0 0 x" must be 3 finite numbers',
    ball('rpy="0 1e308 0"'): "<origin> rpy has 1e+308 rad; at most 10000 rad are accepted",
}


CASES = [(text, "", message) for text, message in FAULTS.items()]
for inner, message in JOINT_FAULTS.items():
    limit = "" if "<limit" in inner else LIMIT
    CASES.append((robot(links("ab"), joint(inner=inner + limit)), ": joint 'j'", message))
for inner, message in LINK_FAULTS.items():
    CASES.append((robot(f'<link name="base">{inner}</link>'), ": link 'base'", message))


@pytest.mark.parametrize(("text", "part", "message"), CASES, ids=[case[2] for case in CASES])
def test_a_fault_is_named_with_its_file_and_part_shortly(tmp_path, read, text, part, message):
    refused = refusal(RobotError, read, text)
    assert refused.startswith(f"{tmp_path / 'arm.urdf'}{part}")
    assert message in refused
    assert len(refused) < 300 + len(str(tmp_path))


FOREIGN = """
<gazebo/><transmission><limits/></transmission><material name="m"/><ros2_control/>
<loop_joint name="l"><link1/></loop_joint>
"""


def test_what_urdf_does_not_define_is_noted_and_simulators_sections_are_passed_over(read):
    inner = LIMIT.replace("/>", ' accel="3"/>') + "<hardwareInterface/><spring/>"
    kept = '<link name="c" type="laser"><gravity/><visual><shade/></visual></link>'
    text = robot(FOREIGN, links("ab"), joint(inner=inner), kept, joint("k", child="c"))
    expected = "<loop_joint>; <limit accel> (joint 'j'); <spring> (joint 'j')"
    assert read(text).notes == (f"URDF does not define, and nothing here uses: {expected}",)
    assert read(robot(links("ab"), joint())).notes == ()


QUATERNION = "0.2 -0.4 0.1 1.6"  # of any length


@pytest.mark.parametrize("quaternion", [QUATERNION, "0 2 0 2", "0 -0.5 0 0.5"])
def test_quaternions_turn_frames_solids_and_inertias_as_pinocchio_and_angles_do(
    tmp_path, quaternion
):
    """Each <origin> in the arm is also one of Pinocchio's, which reads quaternions itself."""
    origin = f'<origin xyz="0.1 0.2 0.3" quat_xyzw="{quaternion}"/>'
    moments = '<inertia ixx="1" iyy="2" izz="3" ixy="0" ixz="0" iyz="0"/>'
    inner = f"<inertial>{origin}{ONE}{moments}</inertial>" + solid('<box size="1 2 3"/>', origin)
    tip = f'<link name="b">{inner}</link>'
    text = robot(links("a"), tip, joint(inner=origin + LIMIT))
    path = tmp_path / "arm.urdf"
    path.write_text(text.replace("<robot", '<robot version="1.1"'))
    arm = load_robot(path, "b")
    model = pinocchio.buildModelFromUrdf(str(path))
    solids = pinocchio.buildGeomFromUrdf(model, str(path), pinocchio.GeometryType.COLLISION)
    rotation, position = arm.body_poses(np.zeros(1))
    close(rotation[1], model.jointPlacements[1].rotation, atol=1e-14)
    close(position[1], model.jointPlacements[1].translation, atol=1e-14)
    close(arm.inertias[1].inertia, model.inertias[1].inertia, atol=1e-14)
    (element,) = link_elements(arm)["b"]
    close(element.placement, solids.geometryObjects[0].placement.homogeneous, atol=1e-14)


def test_a_quaternion_stands_alone_and_without_effect_is_no_fault_of_an_old_file(read):
    both = '<origin rpy="0 0 3.141592653589793" quat_xyzw="0 0 1 0"/>'
    text = robot(links("ab"), joint(inner=both + LIMIT))
    assert read(text).joints["j"].upper == 2
    newer = text.replace("<robot", '<robot version="1.1"')
    assert "stands beside rpy; remove one of them" in refusal(RobotError, read, newer)
    zero = newer.replace("0 0 1 0", "0 0 0 0")
    assert "has no direction" in refusal(RobotError, read, zero)


@pytest.mark.parametrize(
    ("name", "reason"),
    [("\u202e", "rename it"), ("&#10;FAKE", "rename it"), ("x" * 300, "shorten")],
)
def test_names_that_cannot_be_shown_are_refused(read, name, reason):
    for text in (robot(f'<link name="{name}"/>'), robot(links("a")).replace("arm", name, 1)):
        message = refusal(RobotError, read, text)
        assert reason in message and message.isprintable()


def test_a_file_that_is_not_there_and_a_pipe_are_refused_without_waiting(tmp_path):
    path = tmp_path / "arm.urdf"
    message = refusal(RobotError, read_urdf, path)
    assert message.startswith(f"{path} cannot be read: No such file")
    os.mkfifo(path)
    assert "cannot be read: it is no regular file" in refusal(RobotError, read_urdf, path)


def test_a_link_seen_but_not_touched_may_have_any_visual(read):
    visual = "<visual><geometry><capsule radius='1' length='x'/></geometry></visual>"
    assert read(robot(f'<link name="base">{visual}</link>')).links == ("base",)


def test_a_good_file_gives_name_links_and_joints_as_written(read):
    """With a byte order mark and a declared encoding; without a name it is called as the file."""
    text = robot(links("abc"), joint(), joint("k", "fixed", "b", "c", ""))
    declared = '<?xml version="1.0" encoding="utf-8"?>\n' + text
    for description in (read(text), read(declared.encode("utf-8-sig"))):
        assert (description.name, description.links) == ("arm", ("a", "b", "c"))
        assert list(description.joints) == ["j", "k"]
        j = description.joints["j"]
        assert (j.type, j.parent, j.child) == ("revolute", "a", "b")
        assert (j.lower, j.upper, j.effort, j.velocity) == (-1, 2, 10, 3)
        assert description.movable() == ["j"]
    assert read(robot(links("a")).replace(' name="arm"', "", 1)).name == "arm"


@pytest.mark.parametrize(
    ("kind", "limit", "expected"),
    [
        ("revolute", "", (0, 0, None, None)),
        ("revolute", '<limit effort="0" velocity="inf"/>', (0, 0, 0, np.inf)),
        ("prismatic", '<limit lower="-inf" upper="0.5"/>', (-np.inf, 0.5, None, None)),
        ("continuous", '<limit lower="-1" upper="1" effort="5"/>', (-np.inf, np.inf, 5, None)),
    ],
)
def test_limits_are_read_but_not_judged(read, kind, limit, expected):
    j = read(robot(links("ab"), joint(kind=kind, inner=limit))).joints["j"]
    assert (j.lower, j.upper, j.effort, j.velocity) == expected


def test_a_mimic_joint_keeps_its_rule(read):
    for rule, expected in (
        ("", Mimic("k", 1.0, 0.0)),
        ('multiplier="-2" offset="0.5"', Mimic("k", -2.0, 0.5)),
        ('multiplier="0"', Mimic("k", 0.0, 0.0)),
    ):
        follower = joint(inner=f'{LIMIT}<mimic joint="k" {rule}/>')
        joints = read(robot(links("abc"), follower, joint("k", child="c"))).joints
        assert joints["j"].mimic == expected


def test_the_chain_runs_from_the_root_and_skips_what_stands_still_and_branches(read):
    description = read(
        robot(
            links("fedcba"),
            joint("last", "prismatic", "d", "e"),
            joint("weld", "fixed", "b", "d", ""),
            joint("first", "continuous", "a", "b"),
            joint("branch", "revolute", "b", "c"),
            joint("tip", "fixed", "e", "f", ""),
        ),
    )
    assert description.chain("f") == ["first", "last"]
    assert description.chain("c") == ["first", "branch"]
    assert description.chain("a") == []
    message = f"{description.path}: unknown link 'x'; there is: f, e, d, c, b, a"
    assert refusal(RobotError, description.chain, "x") == message
    moving = (joint("rail", "planar"), joint("float", "floating", "b", "c"))
    description = read(robot(links("abcd"), *moving, joint("turn", "revolute", "c", "d")))
    assert description.movable() == description.chain("d") == ["turn"]


def test_the_kinematic_copy_has_no_geometry_and_only_plain_bounded_joints(read):
    ball = "<geometry><sphere radius='1'/></geometry>"
    extra = '<safety_controller k_velocity="1"/><calibration rising="0"/><mimic joint="k"/>'
    description = read(
        robot(
            f'<link name="a"><visual>{ball}</visual><collision>{ball}</collision></link>',
            links("bcd"),
            joint("j", "continuous", "a", "b", ""),
            joint("k", "prismatic", "b", "c", LIMIT + extra),
            joint("weld", "fixed", "c", "d", ""),
        ),
    )
    root = ElementTree.fromstring(description.kinematic_xml())
    tags = {element.tag for element in root.iter()}
    assert tags == {"robot", "link", "joint", "parent", "child", "limit"}
    assert [j.get("type") for j in root.findall("joint")] == ["revolute", "prismatic", "fixed"]
    limits = [element.attrib for element in root.iter("limit")]
    assert len(limits) == 2
    for limit in limits:
        assert float(limit["lower"]) < float(limit["upper"])
        assert min(float(limit["effort"]), float(limit["velocity"])) > 0


# Prefixes that are used and not declared: declared on the root, and nothing else changed.

DRAKE = ' xmlns:drake="http://drake.mit.edu"'
UNCHANGED = {
    "no prefix": '<robot name="a"><link name="b"/></robot>',
    "a declared one": f'<robot{DRAKE}><limit drake:acceleration="2"/></robot>',
    "declared beside": f'<robot><limit{DRAKE} drake:acceleration="2"/></robot>',
    "XML's own": '<robot xml:lang="en"/>',
    "malformed": "<robot><drake:a></robot>",
    "empty": "",
    "an encoding that nobody has": '<?xml version="1.0" encoding="klingon"?><robot drake:a="1"/>',
    "in two bytes": '<?xml version="1.0" encoding="utf-16"?><robot drake:a="1"/>',
}


@pytest.mark.parametrize("name", UNCHANGED)
def test_what_lacks_nothing_or_is_malformed_stays(name):
    xml = UNCHANGED[name].encode("utf-16" if name == "in two bytes" else "utf-8")
    assert declare_prefixes(xml) == (xml, {})


def test_the_root_declares_what_was_missing_and_the_rest_stays():
    """A declaration serves only inside its element."""
    text = (
        '<?xml version="1.0"?><!-- <robot> -->\n<robot name="ä">'
        f'<drake:b drake:c="1"/><limit{DRAKE} drake:jerk="2"/>'
        '<limit drake:acceleration="2.5"/><x y:z="1"/><drake:b/></robot>'
    )
    xml, undeclared = declare_prefixes(text.encode())
    added = f'{DRAKE} xmlns:y="undeclared:y"'
    assert xml.decode() == text.replace("\n<robot", f"\n<robot{added}")
    assert undeclared == {"drake": ("b", "c", "acceleration"), "y": ("z",)}
    ElementTree.fromstring(xml)


# Joints that mimic planned ones, against the same arm with all joints planned.


def load(folder, rules, own=None, **options):
    path = folder / "arm.urdf"
    path.write_text(follower_arm(rules, own))
    return load_robot(path, "tip", **options)


PLANNED = ("lift", "first", "wrist", "side_joint")
ALL = tuple(JOINTS)


@pytest.fixture(scope="module")
def arms(tmp_path_factory):
    """The arm with followers, and the same with every joint planned."""
    folder = tmp_path_factory.mktemp("followers")
    return (
        load(folder, RULES, joints=["wrist", "first", "side_joint", "lift"]),
        load(folder, {}, joints=list(ALL)),
    )


def map_of(robot):
    """Return the matrix and the offsets by which all joints follow the planned ones."""
    rules = {"second": ("first", -2.0, 0.3), "slide": ("lift", 0.5, 0.1)}
    rules["tip_joint"] = ("first", -1.0, 0.35)  # 0.5 (-2 q + 0.3) + 0.2
    matrix, offset = np.zeros((len(ALL), robot.joint_count)), np.zeros(len(ALL))
    for row, name in enumerate(ALL):
        master, multiplier, offset[row] = rules.get(name, (name, 1.0, 0.0))
        matrix[row, robot.joint_names.index(master)] = multiplier
    return matrix, offset


@pytest.fixture(scope="module")
def states(arms):
    """States of the planned joints and of all joints, and the matrix between them."""
    q, v, a = np.random.default_rng(1).uniform(-1, 1, (3, 20, arms[0].joint_count))
    matrix, offset = map_of(arms[0])
    return (q, v, a), (q @ matrix.T + offset, v @ matrix.T, a @ matrix.T), matrix


def test_rules_are_followed_to_the_end(arms):
    description = arms[0].urdf
    rule = leader_of(description, "tip_joint")
    assert (rule.master, rule.multiplier, rule.offset) == ("first", -1.0, pytest.approx(0.35))
    assert set(followers_of(description, PLANNED)) == set(RULES)
    assert set(followers_of(description, ["first"])) == {"second", "tip_joint"}


def test_tool_and_bodies_are_where_they_are_with_every_joint_planned(arms, states):
    (robot, plain), (mine, full, matrix) = arms, states
    for one, other in zip(robot.tool_pose(mine[0]), plain.tool_pose(full[0]), strict=True):
        close(one, other, atol=1e-12)
    jacobian = robot.tool_jacobian(mine[0])[1]
    close(jacobian, plain.tool_jacobian(full[0])[1] @ matrix, atol=1e-12)
    poses, others = robot.body_poses(mine[0]), plain.body_poses(full[0])
    point = np.random.default_rng(3).normal(size=(20, 3))
    for link in LINKS:
        body, other = robot.link_body[link], plain.link_body[link]
        for one, another in zip(poses, others, strict=True):
            close(one[:, body], another[:, other], atol=1e-12)
        jacobian = robot.point_jacobian(*poses, np.full(20, body), point)
        expected = plain.point_jacobian(*others, np.full(20, other), point) @ matrix
        close(jacobian, expected, atol=1e-12)


def test_efforts_of_followers_go_to_their_masters(arms, states):
    (robot, plain), (mine, full, matrix) = arms, states
    expected = plain.inverse_dynamics(*full) @ matrix
    close(robot.inverse_dynamics(*mine), expected, atol=1e-10)
    gravity = plain.gravity_effort(full[0]) @ matrix
    close(robot.gravity_effort(mine[0]), gravity, atol=1e-10)


def test_distances_change_by_no_more_than_the_motion_weights(arms):
    """Between links that share a master too: one moves by it once, the other twice.

    A master and a follower of it lie between `column` and `fore`, which may meet.
    """
    robot = arms[0]
    checker = CollisionChecker(robot, [Obstacle.box("b", [0.2] * 3, placement_of([0.8, 0, 0.3]))])
    names = {frozenset(checker.shapes[i].owner for i in pair) for pair in checker.pairs}
    assert names >= {frozenset(("upper", "tip")), frozenset(("column", "fore"))}
    assert frozenset(("upper", "fore")) not in names
    rng = np.random.default_rng(4)
    before = rng.uniform(-1, 1, (60, robot.joint_count))
    after = before + rng.normal(scale=0.02, size=before.shape)
    first, second = (
        np.array([checker.distances(*poses, checker.pairs) for poses in zip(*bodies, strict=True)])
        for bodies in (robot.body_poses(before), robot.body_poses(after))
    )
    bound = abs(after - before) @ checker.motion_weights(checker.pairs).T
    assert (abs(first - second) <= bound + 1e-9)[(first > 0) & (second > 0)].all()


def test_limits_of_followers_bound_their_master(tmp_path):
    limits = {
        "second": '<limit lower="-1" upper="1.5" effort="1" velocity="4"/>',
        "slide": '<limit lower="0" upper="0.5" effort="1" velocity="0"/>',
    }
    names = ["lift", "first", "wrist"]
    limited = load(tmp_path, RULES, limits, joints=names).limits
    # second = 0.3 - 2 first in [-1, 1.5]; slide = 0.1 + 0.5 lift in [0, 0.5]
    close(limited.lower_position, [-0.2, -0.6, -2])
    close(limited.upper_position, [0.8, 0.65, 2])
    close(limited.velocity, [3, 2, 3])
    given = LimitOverrides(
        position={"second": (-9, 9)}, velocity={"second": 8}, acceleration={"tip_joint": 7}
    )
    limited = load(tmp_path, RULES, limits, joints=names, limits=given).limits
    close(limited.velocity, [3, 3, 3])
    close(limited.lower_position, [-0.2, -2, -2])
    close(limited.acceleration, [np.inf, 7, np.inf])


@pytest.mark.parametrize(
    ("own", "options", "message"),
    [
        (
            {"second": '<limit lower="7" upper="8" effort="1" velocity="4"/>'},
            {},
            "joint 'second', which follows 'first', has position limits [7, 8]; they leave",
        ),
        (
            {},
            {"locked_joints": {"second": 0.3}},
            "robot.locked_joints: 'second' follows 'first', which is planned; remove it",
        ),
    ],
)
def test_what_contradicts_a_follower_is_named(tmp_path, own, options, message):
    assert message in refusal(RobotError, load, tmp_path, RULES, own, **options)


def test_a_follower_of_multiplier_zero_stands_still(tmp_path):
    robot = load(tmp_path, {"second": ("first", 0.0, 0.3)})
    assert "second" not in robot.joint_names
    assert robot.body_count == robot.joint_count + 1
    still = np.zeros((1, robot.joint_count))
    full = np.insert(still, 2, 0.3, axis=1)
    close(robot.tool_position(still), load(tmp_path, {}).tool_position(full), atol=1e-12)


def test_a_mimic_joint_on_the_tools_chain_is_planned_by_its_master(tmp_path):
    robot = load(tmp_path, {"wrist": ("side_joint", 1.0, 0.0)})
    assert robot.joint_names == ("lift", "first", "second", "slide", "side_joint", "tip_joint")
