"""The Pinocchio model of the planned joints: base, payload, tool attached, other joints locked."""

import pickle

import numpy as np
import pinocchio as pin
import pytest
from cases import SLIDE, with_motors
from scipy.spatial.transform import Rotation

from tubeplanner import BasePose, LimitOverrides, Payload, PointSpeed, RobotError, load_robot
from tubeplanner.files.fingerprint import robot_hash
from tubeplanner.robot.body_inertia import BodyInertia
from tubeplanner.robot.robot_info import robot_info
from tubeplanner.robot.typical_configurations import typical_configurations

# Where a robot stands: against a URDF with one more fixed joint, and against turned gravity.


POSE = BasePose((0.3, -0.2, 1.1), (0.4, -1.2, 2.5))
# Hangs from the root, turned.
PLATE = """<link name="plate"/><joint name="screw" type="fixed"><parent link="base"/>
<child link="plate"/><origin xyz="0.1 0.2 0" rpy="0 0.5 0.3"/></joint></robot>"""
# Fixed above its root, it stands as POSE says.
MOUNT = """<link name="cell"/><joint name="mount" type="fixed"><parent link="cell"/>
<child link="base"/><origin xyz="0.3 -0.2 1.1" rpy="0.4 -1.2 2.5"/></joint></robot>"""
WALL = BasePose(rpy=(0.0, np.pi / 2, 0.0))  # its z axis is the cell's x axis


def states(robot, count):
    return np.random.default_rng(8).uniform(-1, 1, (3, count, robot.joint_count))


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """The arm with a base, and the arm whose URDF has the mount; both carry something."""
    folder = tmp_path_factory.mktemp("mounted")
    plain = SLIDE.replace("</robot>", PLATE)
    (folder / "plain.urdf").write_text(plain)
    (folder / "mounted.urdf").write_text(plain.replace("</robot>", MOUNT))
    limits = LimitOverrides(point_speed=[PointSpeed("boom", (0.1, 0.2, 0.3), 1.0)])
    options = {"payload": Payload(2.0, (0.1, 0, 0)), "gravity": (1, 2, -9), "limits": limits}
    based = load_robot(folder / "plain.urdf", "tip", base=POSE, **options)
    mounted = load_robot(folder / "mounted.urdf", "tip", **options)
    motors = {"armature": 0.3, "viscous_friction": 4.0}
    return with_motors(based, **motors), with_motors(mounted, **motors)


@pytest.mark.parametrize("count", [5, 80])  # few are taken one by one
def test_a_base_is_a_fixed_joint_above_the_root(both, count):
    based, mounted = both
    q, v, a = states(based, count)
    for name in ("tool_pose_jacobian", "body_poses"):
        for found, expected in zip(getattr(based, name)(q), getattr(mounted, name)(q), strict=True):
            np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14)
    for name in ("tool_velocity", "point_velocities"):
        for found, expected in zip(
            getattr(based, name)(q, v), getattr(mounted, name)(q, v), strict=True
        ):
            np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14)
    expected = mounted.inverse_dynamics(q, v, a)
    np.testing.assert_allclose(based.inverse_dynamics(q, v, a), expected, rtol=0, atol=1e-12)
    assert abs(based.tool_position(q) - based.in_root_frame().tool_position(q)).max() > 1.0


def test_links_that_stand_still_are_where_the_mounted_ones_are(both):
    based, mounted = both
    assert based.urdf.root == "base"
    assert mounted.urdf.root == "cell"
    for link in based.urdf.links:
        assert based.link_body[link] == mounted.link_body[link]
        np.testing.assert_allclose(
            based.link_placement[link], mounted.link_placement[link], rtol=0, atol=1e-15
        )


def test_a_wall_mounted_arm_has_the_efforts_of_turned_gravity():
    wall = load_robot("example:ur5", "tool0", base=WALL)
    turned = load_robot("example:ur5", "tool0", gravity=(9.81, 0, 0))
    motion = states(wall, 10)
    expected = turned.inverse_dynamics(*motion)
    np.testing.assert_allclose(wall.inverse_dynamics(*motion), expected, rtol=0, atol=1e-12)
    assert np.linalg.norm(wall.gravity_effort(motion[0]) - expected) > 10


def test_bounds_do_not_grow_with_a_base(both):
    based, _ = both
    alone = based.in_root_frame()
    np.testing.assert_array_equal(based.lever_arm, alone.lever_arm)
    assert based.tool_reach == alone.tool_reach
    np.testing.assert_array_equal(based.body_offsets[2:], alone.body_offsets[2:])


def test_an_arm_in_its_root_frame_is_the_one_without_a_base(both):
    based, _ = both
    alone = based.in_root_frame()
    motion = states(based, 5)
    plain = load_robot(based.urdf.path, "tip", payload=based.payload)
    np.testing.assert_array_equal(alone.tool_pose(motion[0])[1], plain.tool_pose(motion[0])[1])
    down = Rotation.from_euler("xyz", POSE.rpy).inv().apply([1, 2, -9])
    np.testing.assert_allclose(alone.gravity, down, rtol=0, atol=1e-14)
    np.testing.assert_allclose(
        alone.inverse_dynamics(*motion), based.inverse_dynamics(*motion), rtol=0, atol=1e-12
    )
    assert alone.in_root_frame() is alone


def test_it_travels_and_takes_another_payload(both):
    based, _ = both
    q, v, a = states(based, 5)
    for other in (pickle.loads(pickle.dumps(based)), based.with_payload(based.payload)):
        assert other.base == POSE
        np.testing.assert_array_equal(other.tool_position(q), based.tool_position(q))
        efforts = other.inverse_dynamics(q, v, a)
        np.testing.assert_array_equal(efforts, based.inverse_dynamics(q, v, a))


def test_a_quaternion_says_the_same_as_rpy():
    quaternion = 2.0 * Rotation.from_euler("xyz", POSE.rpy).as_quat()
    other = BasePose(POSE.position, quaternion=tuple(quaternion))
    np.testing.assert_allclose(other.placement, POSE.placement, rtol=0, atol=1e-15)
    np.testing.assert_allclose(
        POSE.placement[:3, :3], Rotation.from_euler("xyz", POSE.rpy).as_matrix(), atol=1e-15
    )
    np.testing.assert_array_equal(POSE.placement[:, 3], [0.3, -0.2, 1.1, 1.0])


def test_a_hash_has_the_base_only_where_one_moves_the_arm(ur5):
    assert robot_hash(load_robot("example:ur5", "tool0", base=BasePose())) == robot_hash(ur5)
    assert robot_hash(load_robot("example:ur5", "tool0", base=POSE)) != robot_hash(ur5)


def test_typical_configurations_are_above_the_base_however_it_stands():
    hung = BasePose((0.0, 0.0, 3.0), (np.pi, 0.0, 0.0))
    plain, turned = (robot_info("example:ur5", "tool0", base=base).arm for base in (None, hung))
    np.testing.assert_array_equal(typical_configurations(turned), typical_configurations(plain))


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"position": (0.0, 0.0)}, r"robot.base: position \(0.0, 0.0\) must be three finite"),
        ({"position": (0.0, 0.0, 2e4)}, r"position .* within 10000 m"),
        ({"position": (0.0, 0.0, np.nan)}, r"robot.base: position .* must be three finite"),
        ({"rpy": (0.0, np.inf, 0.0)}, r"robot.base: rpy \(0.0, inf, 0.0\) must be three"),
        ({"rpy": (0.0, 1.0)}, r"robot.base: rpy \(0.0, 1.0\) must be three finite angles"),
        ({"quaternion": (0, 0, 0, 0)}, r"robot.base: quaternion \(0, 0, 0, 0\) has no direction"),
        ({"quaternion": (0, 0, 0, 1e10)}, "robot.base: quaternion .* has no direction"),
        ({"quaternion": (0, 0, 1)}, r"robot.base: quaternion \(0, 0, 1\) has no direction"),
        ({"rpy": (0, 0, 0), "quaternion": (0, 0, 0, 1)}, "robot.base takes rpy or quaternion, not"),
    ],
)
def test_a_pose_that_is_none_is_refused(fields, message):
    with pytest.raises(RobotError, match=message):
        BasePose(**fields)


def cloud(random):
    """Mass points, and what they are as a body."""
    mass, place = random.uniform(0.5, 2, 9), random.normal(size=(9, 3))
    return mass, place, of_points(mass, place)


def of_points(mass, place):
    com = mass @ place / mass.sum()
    away = place - com
    inertia = sum(m * (a @ a * np.eye(3) - np.outer(a, a)) for m, a in zip(mass, away, strict=True))
    return BodyInertia(mass.sum(), com, inertia)


def assert_same(found, expected):
    assert found.mass == pytest.approx(expected.mass)
    np.testing.assert_allclose(found.com, expected.com, atol=1e-12)
    np.testing.assert_allclose(found.inertia, expected.inertia, atol=1e-11)


def test_two_bodies_as_one_are_all_their_points():
    random = np.random.default_rng(0)
    (mass, place, body), (other_mass, other_place, other) = cloud(random), cloud(random)
    points = np.append(mass, other_mass), np.concatenate([place, other_place])
    both = body.plus(other)
    assert_same(both, of_points(*points))
    assert_same(both.plus(other.scaled(-1.0)), body)


def test_a_body_in_another_frame_has_its_points_there():
    random = np.random.default_rng(1)
    mass, place, body = cloud(random)
    placement = np.eye(4)
    placement[:3, :3] = np.linalg.qr(random.normal(size=(3, 3)))[0]
    placement[:3, 3] = random.normal(size=3)
    expected = of_points(mass, place @ placement[:3, :3].T + placement[:3, 3])
    assert_same(body.placed(placement), expected)


def test_a_denser_and_a_shifted_body():
    mass, place, body = cloud(np.random.default_rng(2))
    assert_same(body.scaled(1.5), of_points(1.5 * mass, place))
    by = np.array([0.1, 0.0, -0.2])
    assert_same(body.shifted(by), of_points(mass, place + by))


def test_bounds_on_norms():
    body = BodyInertia(2.0, np.array([3.0, 0.0, 4.0]), np.diag([1.0, 3.0, 2.0]))
    assert (body.com_distance, body.moment) == (5.0, 3.0)


def test_nothing_and_nothing_is_nothing():
    nothing = BodyInertia(0.0, np.zeros(3), np.zeros((3, 3)))
    assert_same(nothing.plus(nothing), nothing)


# What several payloads weigh together: against Pinocchio, and against bodies of their own.


FIRST = Payload(2.5, (0.05, -0.02, 0.1), (0.03, 0.02, 0.04, 0.005, -0.002, 0.001))
SECOND = Payload(0.7, (-0.1, 0.3, 0.0), (0.01, 0.03, 0.02, -0.001, 0.002, 0.004))


def as_inertia(payload):
    return pin.Inertia(payload.mass, np.array(payload.com), payload.inertia_matrix())


def payload_states(robot, count=12):
    return np.random.default_rng(5).uniform(-1.5, 1.5, (3, count, robot.joint_count))


@pytest.mark.parametrize("pair", [(FIRST, SECOND), (SECOND, FIRST), (FIRST, FIRST)])
def test_payloads_add_as_inertias_do(pair):
    both, expected = pair[0].plus(pair[1]), as_inertia(pair[0]) + as_inertia(pair[1])
    assert both.mass == pytest.approx(expected.mass)
    np.testing.assert_allclose(both.com, expected.lever, atol=1e-14)
    np.testing.assert_allclose(both.inertia_matrix(), expected.inertia, atol=1e-13)


def test_an_arm_feels_two_payloads_as_it_feels_each(ur5):
    """Efforts are linear in what an arm carries, whatever it does."""
    motion = payload_states(ur5)
    bare, first, second, both = (
        ur5.with_payload(load).inverse_dynamics(*motion)
        for load in (None, FIRST, SECOND, FIRST.plus(SECOND))
    )
    np.testing.assert_allclose(both - bare, (first - bare) + (second - bare), atol=1e-10)
    assert abs(both - first).max() > 1.0


def test_an_arm_with_another_payload_is_as_one_loaded_with_it(ur5):
    loaded, motion = load_robot("example:ur5", "tool0", payload=FIRST), payload_states(ur5)
    changed = ur5.with_payload(SECOND).with_payload(FIRST)
    assert (changed.payload, ur5.payload) == (FIRST, None)
    expected = loaded.inverse_dynamics(*motion)
    np.testing.assert_array_equal(changed.inverse_dynamics(*motion), expected)
    without = loaded.with_payload(None).inverse_dynamics(*motion)
    np.testing.assert_array_equal(without, ur5.inverse_dynamics(*motion))
    assert changed.limits is ur5.limits
    assert changed.motors is ur5.motors
    assert (changed.joint_names, changed.tool_frame) == (ur5.joint_names, ur5.tool_frame)


def test_points_that_are_heavy_add_to_something_possible():
    """What two points weigh turns freely about their line, but for rounding."""
    random = np.random.default_rng(0)
    for _ in range(50):
        first, second = (
            Payload(1e5 * random.uniform(0.1, 1), random.normal(size=3)) for _ in range(2)
        )
        assert first.plus(second).mass == pytest.approx(first.mass + second.mass)


def test_nothing_weighs_nothing_more():
    both = FIRST.plus(Payload(0.0, (1.0, 2.0, 3.0)))
    assert both.mass == FIRST.mass
    np.testing.assert_allclose(both.com, FIRST.com, atol=1e-15)
    np.testing.assert_allclose(both.inertia, FIRST.inertia, atol=1e-15)
