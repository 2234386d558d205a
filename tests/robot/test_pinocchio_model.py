"""The Pinocchio model of the planned joints: base, payload, tool attached, other joints locked."""

import pickle

import numpy as np
import pinocchio as pin
import pytest
from cases import SLIDE, with_motors
from numpy.testing import assert_allclose as close
from numpy.testing import assert_array_equal as same
from scipy.spatial.transform import Rotation

from tubeplanner import BasePose, LimitOverrides, Payload, PointSpeed, RobotError, load_robot
from tubeplanner.output.files.fingerprint import robot_hash
from tubeplanner.robot.info import robot_info
from tubeplanner.robot.pinocchio_model import BodyInertia
from tubeplanner.studies.tubes.starter_problem import typical_configurations

POSE = BasePose((0.3, -0.2, 1.1), (0.4, -1.2, 2.5))
# Hangs from the root, turned.
PLATE = """<link name="plate"/><joint name="screw" type="fixed"><parent link="base"/>
<child link="plate"/><origin xyz="0.1 0.2 0" rpy="0 0.5 0.3"/></joint></robot>"""
# Fixed above its root, it stands as POSE says.
MOUNT = """<link name="cell"/><joint name="mount" type="fixed"><parent link="cell"/>
<child link="base"/><origin xyz="0.3 -0.2 1.1" rpy="0.4 -1.2 2.5"/></joint></robot>"""


def ur5_with(**options):
    return load_robot("example:ur5", "tool0", **options)


def states(robot, count=12):
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
    for name, values in (
        ("tool_pose_jacobian", (q,)),
        ("body_poses", (q,)),
        ("tool_velocity", (q, v)),
        ("point_velocities", (q, v)),
    ):
        ours, theirs = (getattr(robot, name)(*values) for robot in both)
        for found, expected in zip(ours, theirs, strict=True):
            close(found, expected, rtol=0, atol=1e-14)
    expected = mounted.inverse_dynamics(q, v, a)
    close(based.inverse_dynamics(q, v, a), expected, rtol=0, atol=1e-12)
    assert abs(based.tool_position(q) - based.in_root_frame().tool_position(q)).max() > 1.0
    assert (based.urdf.root, mounted.urdf.root) == ("base", "cell")
    for link in based.urdf.links:
        assert based.link_body[link] == mounted.link_body[link]
        close(based.link_placement[link], mounted.link_placement[link], rtol=0, atol=1e-15)


def test_an_arm_in_its_root_frame_is_the_one_without_a_base(both):
    based, motion = both[0], states(both[0])
    alone = based.in_root_frame()
    plain = load_robot(based.urdf.path, "tip", payload=based.payload)
    same(alone.tool_pose(motion[0])[1], plain.tool_pose(motion[0])[1])
    down = Rotation.from_euler("xyz", POSE.rpy).inv().apply([1, 2, -9])
    close(alone.gravity, down, rtol=0, atol=1e-14)
    efforts = based.inverse_dynamics(*motion)
    close(alone.inverse_dynamics(*motion), efforts, rtol=0, atol=1e-12)
    assert alone.in_root_frame() is alone
    same(based.lever_arm, alone.lever_arm)
    assert based.tool_reach == alone.tool_reach
    same(based.body_offsets[2:], alone.body_offsets[2:])


def test_a_base_travels_and_takes_another_payload(both):
    based, motion = both[0], states(both[0])
    for other in (pickle.loads(pickle.dumps(based)), based.with_payload(based.payload)):
        assert other.base == POSE
        same(other.tool_position(motion[0]), based.tool_position(motion[0]))
        same(other.inverse_dynamics(*motion), based.inverse_dynamics(*motion))


def test_a_quaternion_says_the_same_as_rpy():
    rotation = Rotation.from_euler("xyz", POSE.rpy)
    other = BasePose(POSE.position, quaternion=tuple(2.0 * rotation.as_quat()))
    close(other.placement, POSE.placement, rtol=0, atol=1e-15)
    close(POSE.placement[:3, :3], rotation.as_matrix(), atol=1e-15)
    same(POSE.placement[:, 3], [0.3, -0.2, 1.1, 1.0])


def test_a_hash_has_the_base_only_where_one_moves_the_arm(ur5):
    assert robot_hash(ur5_with(base=BasePose())) == robot_hash(ur5)
    assert robot_hash(ur5_with(base=POSE)) != robot_hash(ur5)


def test_typical_configurations_are_above_the_base_however_it_stands():
    hung = BasePose((0.0, 0.0, 3.0), (np.pi, 0.0, 0.0))
    plain, turned = (robot_info("example:ur5", "tool0", base=base).arm for base in (None, hung))
    same(typical_configurations(turned), typical_configurations(plain))


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"position": (0.0, 0.0)}, r"robot.base: position \(0.0, 0.0\) must be three finite"),
        ({"position": (0.0, 0.0, 2e4)}, r"position .* within 10000 m"),
        ({"rpy": (0.0, np.inf, 0.0)}, r"robot.base: rpy \(0.0, inf, 0.0\) must be three"),
        ({"quaternion": (0, 0, 0, 0)}, r"robot.base: quaternion \(0, 0, 0, 0\) has no direction"),
        ({"rpy": (0, 0, 0), "quaternion": (0, 0, 0, 1)}, "robot.base takes rpy or quaternion, not"),
    ],
)
def test_a_pose_that_is_none_is_refused(fields, message):
    with pytest.raises(RobotError, match=message):
        BasePose(**fields)


def cloud(rng):
    """Return mass points, and the body that they stand for."""
    mass, points = rng.uniform(0.5, 2, 9), rng.normal(size=(9, 3))
    return mass, points, of_points(mass, points)


def of_points(mass, points):
    com = mass @ points / mass.sum()
    away = points - com
    inertia = sum(m * (a @ a * np.eye(3) - np.outer(a, a)) for m, a in zip(mass, away, strict=True))
    return BodyInertia(mass.sum(), com, inertia)


def require_body(found, expected):
    assert found.mass == pytest.approx(expected.mass)
    close(found.com, expected.com, atol=1e-12)
    close(found.inertia, expected.inertia, atol=1e-11)


def test_bodies_are_added_placed_scaled_and_shifted_as_their_points_are():
    rng = np.random.default_rng(0)
    (mass, points, body), (other_mass, other_points, other) = cloud(rng), cloud(rng)
    sum_of_both = body.plus(other)
    expected = of_points(np.append(mass, other_mass), np.concatenate([points, other_points]))
    require_body(sum_of_both, expected)
    require_body(sum_of_both.plus(other.scaled(-1.0)), body)
    placement = np.eye(4)
    placement[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    placement[:3, 3] = rng.normal(size=3)
    moved = points @ placement[:3, :3].T + placement[:3, 3]
    require_body(body.placed(placement), of_points(mass, moved))
    require_body(body.scaled(1.5), of_points(1.5 * mass, points))
    by = np.array([0.1, 0.0, -0.2])
    require_body(body.shifted(by), of_points(mass, points + by))
    nothing = BodyInertia(0.0, np.zeros(3), np.zeros((3, 3)))
    require_body(nothing.plus(nothing), nothing)


def test_a_body_knows_how_far_its_centre_is_and_its_largest_moment():
    body = BodyInertia(2.0, np.array([3.0, 0.0, 4.0]), np.diag([1.0, 3.0, 2.0]))
    assert (body.com_distance, body.moment) == (5.0, 3.0)


FIRST = Payload(2.5, (0.05, -0.02, 0.1), (0.03, 0.02, 0.04, 0.005, -0.002, 0.001))
SECOND = Payload(0.7, (-0.1, 0.3, 0.0), (0.01, 0.03, 0.02, -0.001, 0.002, 0.004))
NOTHING = Payload(0.0, (1.0, 2.0, 3.0))


@pytest.mark.parametrize("pair", [(FIRST, SECOND), (FIRST, NOTHING)])
def test_payloads_add_as_inertias_do(pair):
    weights = [pin.Inertia(p.mass, np.array(p.com), p.inertia_matrix()) for p in pair]
    total, expected = pair[0].plus(pair[1]), weights[0] + weights[1]
    assert total.mass == pytest.approx(expected.mass)
    close(total.com, expected.lever, atol=1e-14)
    close(total.inertia_matrix(), expected.inertia, atol=1e-13)


def test_an_arm_with_another_payload_is_as_one_loaded_with_it(ur5):
    loaded, motion = ur5_with(payload=FIRST), states(ur5)
    changed = ur5.with_payload(SECOND).with_payload(FIRST)
    assert (changed.payload, ur5.payload) == (FIRST, None)
    same(changed.inverse_dynamics(*motion), loaded.inverse_dynamics(*motion))
    without = loaded.with_payload(None).inverse_dynamics(*motion)
    same(without, ur5.inverse_dynamics(*motion))
    assert (changed.limits, changed.motors) == (ur5.limits, ur5.motors)


def test_points_that_are_heavy_add_to_something_possible():
    """What two points weigh turns freely about their line, but for rounding."""
    rng = np.random.default_rng(0)
    for _ in range(50):
        first, second = (Payload(1e5 * rng.uniform(0.1, 1), rng.normal(size=3)) for _ in range(2))
        assert first.plus(second).mass == pytest.approx(first.mass + second.mass)
