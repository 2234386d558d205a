"""RobotModel: kinematics, dynamics, limits of an arm at N samples; effort rates."""

import pickle
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
import yourdfpy
from follower_arm import JOINTS, RULES, follower_arm
from scipy.spatial.transform import Rotation

from cases import one_joint, with_motors
from tubeplanner import LimitOverrides, Payload, PointSpeed, RobotError, ToolOffset, load_robot
from tubeplanner.robot.effort_rate import effort_rate, effort_rate_derivatives, gravity_effort_rate

# One configuration where many are taken: the same numbers, without the leading axis.


# Each with how many arrays of joints it takes, and the axis of the samples in what it returns.
METHODS = {
    "tool_position": (1, 0),
    "tool_pose": (1, 0),
    "tool_jacobian": (1, 0),
    "tool_pose_jacobian": (1, 0),
    "body_poses": (1, 0),
    "gravity_effort": (1, 0),
    "tool_velocity": (2, 0),
    "point_velocities": (2, 1),
    "inverse_dynamics": (3, 0),
    "inverse_dynamics_derivatives": (3, 0),
}


@pytest.fixture(scope="module")
def arm():
    points = [PointSpeed("wrist_1_link", (0.0, 0.0, 0.0), 1.0)] * 2
    return load_robot("example:ur5", "ee_link", limits=LimitOverrides(point_speed=points))


def _states(count, samples=4):
    return np.random.default_rng(3).uniform(-1, 1, (count, samples, 6))


def _arrays(result):
    return result if isinstance(result, tuple) else (result,)


@pytest.mark.parametrize("name", METHODS)
def test_one_configuration_gives_what_it_gives_among_many(arm, name):
    count, axis = METHODS[name]
    states = _states(count)
    many = _arrays(getattr(arm, name)(*states))
    one = _arrays(getattr(arm, name)(*states[:, 2]))
    assert len(one) == len(many)
    for single, several in zip(one, many, strict=True):
        np.testing.assert_allclose(single, several.take(2, axis), rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", METHODS)
def test_lists_and_names_are_taken_too(arm, name):
    count, _ = METHODS[name]
    states = _states(count)[:, 0]
    named = dict(zip("qva", states.tolist(), strict=False))
    wanted = _arrays(getattr(arm, name)(*states))
    for found, expected in zip(_arrays(getattr(arm, name)(**named)), wanted, strict=True):
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("shape", [(5,), (7,), (3, 5), (1, 1, 6), ()])
def test_another_shape_is_named_beside_the_one_that_is_wanted(arm, name, shape):
    with pytest.raises(RobotError) as error:
        getattr(arm, name)(*[np.zeros(shape)] * METHODS[name][0])
    assert str(shape) in str(error.value)
    assert "(6,), or (N, 6)" in str(error.value)


@pytest.mark.parametrize("shape", [(6,), (3, 6), (2, 5)])
def test_rates_have_the_shape_of_the_configurations(arm, shape):
    with pytest.raises(RobotError, match=r"v has shape .*, and q \(2, 6\)"):
        arm.tool_velocity(np.zeros((2, 6)), np.zeros(shape))


def test_efforts_by_position_are_had_for_one_configuration_too():
    limits = LimitOverrides(effort={"elbow_joint": {"position": [-1, 1], "effort": [10, 30]}})
    robot = load_robot("example:ur5", "ee_link", limits=limits)
    q = np.full(6, 0.5)
    assert robot.limits.effort_at(q, 1.0)[2] == pytest.approx(25)
    np.testing.assert_array_equal(
        robot.limits.effort_at(q, 1.0), robot.limits.effort_at(q[None], 1.0)[0]
    )


# Rates of efforts: closed forms, differences, and how they grow with the speed.


@pytest.fixture(scope="module", params=["two_link", "panda", "slide", "payload", "followers"])
def effort_rate_arm(request, tmp_path_factory):
    if request.param == "payload":
        return load_robot("example:ur10", "tool0", payload=Payload(8.0, (0.1, 0, 0.2)))
    if request.param == "followers":
        path = tmp_path_factory.mktemp("followers") / "followers.urdf"
        path.write_text(follower_arm())
        return load_robot(path, "tip")
    return request.getfixturevalue(request.param)


@pytest.fixture
def states(effort_rate_arm):
    """Random positions, velocities, accelerations and jerks, as fast as arms get, each (8, n)."""
    scale = np.array([1.5, 2.0, 60.0, 1e4])[:, None, None]
    return scale * np.random.default_rng(0).uniform(-1, 1, (4, 8, effort_rate_arm.joint_count))


def test_a_pendulums_is_known(tmp_path):
    """Effort I a + m g l cos(q), its rate I jerk - m g l sin(q) v."""
    robot = one_joint(tmp_path, mass=0.5)
    q, v, a, jerk = np.random.default_rng(1).uniform(-3, 3, (4, 20, 1))
    gravity = -0.5 * 9.81 * 0.5 * np.sin(q) * v
    np.testing.assert_allclose(gravity_effort_rate(robot, q, v), gravity, atol=1e-12)
    inertia = robot.inverse_dynamics(q, 0 * q, 1 + 0 * q) - robot.gravity_effort(q)
    expected = inertia * jerk + gravity
    np.testing.assert_allclose(effort_rate(robot, q, v, a, jerk), expected, atol=1e-12)


def test_they_are_what_the_efforts_change_by(effort_rate_arm, states):
    def efforts(t):
        q, v, a, jerk = states
        return effort_rate_arm.inverse_dynamics(
            q + t * v + t**2 / 2 * a + t**3 / 6 * jerk, v + t * a + t**2 / 2 * jerk, a + t * jerk
        )

    step = 2e-5
    numeric = (efforts(-2 * step) - 8 * efforts(-step)) / (12 * step)
    numeric += (8 * efforts(step) - efforts(2 * step)) / (12 * step)
    found = effort_rate(effort_rate_arm, *states)
    np.testing.assert_allclose(found / abs(found).max(), numeric / abs(found).max(), atol=1e-9)


@pytest.mark.parametrize("speed", [0.1, 3.0])
def test_gravitys_grow_with_the_speed_all_others_with_its_third_power(
    effort_rate_arm, states, speed
):
    gravity = gravity_effort_rate(effort_rate_arm, *states[:2])
    expected = speed * gravity + speed**3 * (effort_rate(effort_rate_arm, *states) - gravity)
    run = (rate * speed**k for k, rate in enumerate(states))
    np.testing.assert_allclose(effort_rate(effort_rate_arm, *run), expected, rtol=1e-9, atol=1e-8)


@pytest.mark.parametrize("order", range(4))
def test_derivatives_are_what_differences_find(effort_rate_arm, states, order):
    step = (1e-5, 1e-5, 1e-3, 1e-1)[order]
    found = effort_rate_derivatives(effort_rate_arm, *states)[order]
    for joint in range(effort_rate_arm.joint_count):
        sides = []
        for sign in (step, -step):
            moved = states.copy()
            moved[order, :, joint] += sign
            sides.append(effort_rate(effort_rate_arm, *moved))
        numeric = (sides[0] - sides[1]) / (2 * step)
        scale = abs(found).max()
        np.testing.assert_allclose(found[:, :, joint] / scale, numeric / scale, atol=1e-6)


def test_an_arm_at_rest_has_derivatives_too(effort_rate_arm):
    """By the jerk its inertia, by the velocity how gravity changes with the position."""
    still = np.zeros((1, effort_rate_arm.joint_count))
    by_q, by_v, by_a, by_jerk = effort_rate_derivatives(effort_rate_arm, still, still, still, still)
    gravity, _, inertia = effort_rate_arm.inverse_dynamics_derivatives(still, still, still)
    np.testing.assert_allclose(by_q, 0.0, atol=1e-9)
    np.testing.assert_allclose(by_v, gravity, atol=1e-9)
    np.testing.assert_allclose(by_a, 0.0, atol=1e-9)
    np.testing.assert_allclose(by_jerk, inertia, atol=1e-12)


# The robot against closed forms, against yourdfpy, and against conservation laws.


RNG_SEED = 7
INERTIAL = (
    '<inertial><origin xyz="0.1 0 0"/><mass value="2"/>'
    '<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'
)
LIMIT = '<limit lower="-2" upper="2" effort="50" velocity="3"/>'


def link(name, inner=INERTIAL):
    return f'<link name="{name}">{inner}</link>'


def joint(name, parent, child, kind="revolute", xyz="0 0 0", axis="0 0 1", limit=LIMIT):
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}"/><axis xyz="{axis}"/>{limit}</joint>'
    )


@pytest.fixture
def robot_model_arm(tmp_path):
    """Load an arm from a few lines of URDF."""

    def load(*elements, tool="tip", **options):
        path = tmp_path / "arm.urdf"
        path.write_text(f'<robot name="arm">{"".join(elements)}</robot>')
        return load_robot(path, tool, **options)

    return load


SLIDER = (
    *(link(name) for name in ("base", "turn", "slide", "tip")),
    joint("turner", "base", "turn"),
    joint("slider", "turn", "slide", "prismatic", "0.2 0 0", "1 0 0", LIMIT.replace("-2", "-1")),
    joint("wrist", "slide", "tip", "revolute", "0.3 0 0.1", "0 1 0"),
)
BRANCHED = (
    *(link(name) for name in ("base", "arm", "tip", "side")),
    joint("first", "base", "arm"),
    joint("second", "arm", "tip", xyz="1 0 0"),
    joint("other", "arm", "side", xyz="0 1 0"),
)


def random_configurations(robot, count):
    low = np.maximum(robot.limits.lower_position, -2 * np.pi)
    high = np.minimum(robot.limits.upper_position, 2 * np.pi)
    return np.random.default_rng(RNG_SEED).uniform(low, high, (count, robot.joint_count))


def random_trajectory(robot, count=50):
    rng = np.random.default_rng(RNG_SEED + 1)
    q = random_configurations(robot, count)
    return q, rng.normal(size=q.shape), rng.normal(size=q.shape)


# --- closed forms: the two-link arm of the paper -----------------------------------------------

LENGTH, MASS, INERTIA = 0.3, 14.6, 0.1  # of both links; the centre of mass is at the far end


def two_link_position(q):
    return LENGTH * np.column_stack(
        [
            np.cos(q[:, 0]) + np.cos(q[:, 0] + q[:, 1]),
            np.sin(q[:, 0]) + np.sin(q[:, 0] + q[:, 1]),
            np.zeros(len(q)),
        ]
    )


def two_link_effort(q, v, a, gravity=0.0):
    """Return M(q) a + h(q, v) + g(q), from the arm's Lagrangian; gravity along -y."""
    unit = MASS * LENGTH**2
    cosine, sine = np.cos(q[:, 1]), np.sin(q[:, 1])
    m11 = 2 * INERTIA + unit + unit * (2 + 2 * cosine)
    m12 = INERTIA + unit * (1 + cosine)
    m22 = INERTIA + unit
    h1 = -unit * sine * (2 * v[:, 0] * v[:, 1] + v[:, 1] ** 2)
    h2 = unit * sine * v[:, 0] ** 2
    outer = MASS * gravity * LENGTH * np.cos(q[:, 0] + q[:, 1])
    inner = 2 * MASS * gravity * LENGTH * np.cos(q[:, 0])
    return np.column_stack(
        [
            m11 * a[:, 0] + m12 * a[:, 1] + h1 + inner + outer,
            m12 * a[:, 0] + m22 * a[:, 1] + h2 + outer,
        ]
    )


def test_two_link_tool_is_where_trigonometry_puts_it(two_link):
    q = random_configurations(two_link, 200)
    rotation, position = two_link.tool_pose(q)
    np.testing.assert_allclose(position, two_link_position(q), atol=1e-14)
    np.testing.assert_allclose(two_link.tool_position(q), position, atol=0)
    expected = Rotation.from_euler("z", q.sum(axis=1)[:, None]).as_matrix()
    np.testing.assert_allclose(rotation, expected, atol=1e-14)


def test_two_link_jacobian_is_the_textbook_one(two_link):
    q = random_configurations(two_link, 50)
    position, jacobian = two_link.tool_jacobian(q)
    elbow = LENGTH * np.column_stack([np.cos(q[:, 0]), np.sin(q[:, 0])])
    x, y = position[:, 0], position[:, 1]
    np.testing.assert_allclose(jacobian[:, 0], np.column_stack([-y, elbow[:, 1] - y]), atol=1e-14)
    np.testing.assert_allclose(jacobian[:, 1], np.column_stack([x, x - elbow[:, 0]]), atol=1e-14)
    np.testing.assert_allclose(jacobian[:, 5], 1.0, atol=1e-14)
    np.testing.assert_allclose(jacobian[:, 2:5], 0.0, atol=1e-14)


def test_two_link_effort_is_mass_times_acceleration_plus_coriolis(two_link):
    trajectory = random_trajectory(two_link, 200)
    np.testing.assert_allclose(
        two_link.inverse_dynamics(*trajectory), two_link_effort(*trajectory), atol=1e-11
    )
    np.testing.assert_array_equal(two_link.gravity_effort(trajectory[0]), 0.0)


def test_two_link_effort_in_a_vertical_plane_adds_the_weight():
    robot = load_robot("example:two_link", "hand", gravity=(0, -9.81, 0))
    trajectory = random_trajectory(robot, 200)
    expected = two_link_effort(*trajectory, gravity=9.81)
    np.testing.assert_allclose(robot.inverse_dynamics(*trajectory), expected, atol=1e-11)
    still = two_link_effort(trajectory[0], 0 * trajectory[1], 0 * trajectory[2], gravity=9.81)
    np.testing.assert_allclose(robot.gravity_effort(trajectory[0]), still, atol=1e-11)
    np.testing.assert_array_equal(robot.gravity, [0, -9.81, 0])


# --- another library ---------------------------------------------------------------------------


def yourdfpy_poses(robot, q):
    """Return yourdfpy's pose (4, 4) of every link; joints outside the group at 0."""
    model = yourdfpy.URDF.load(str(robot.urdf.path), load_meshes=False, load_collision_meshes=False)
    values = dict.fromkeys(model.actuated_joint_names, 0.0)
    values.update(zip(robot.joint_names, q, strict=True))
    model.update_cfg([values[name] for name in model.actuated_joint_names])
    return {name: model.get_transform(name, model.base_link) for name in robot.urdf.links}


@pytest.mark.parametrize("name", ["two_link", "ur5", "panda"])
def test_every_link_is_where_yourdfpy_puts_it(request, name):
    robot = request.getfixturevalue(name)
    q = random_configurations(robot, 3)
    rotation, origin = robot.body_poses(q)
    tool_rotation, tool_position = robot.tool_pose(q)
    for i, q_i in enumerate(q):
        expected = yourdfpy_poses(robot, q_i)
        for link_name, body in robot.link_body.items():
            placement = robot.link_placement[link_name]
            np.testing.assert_allclose(
                rotation[i, body] @ placement[:3, :3], expected[link_name][:3, :3], atol=1e-12
            )
            np.testing.assert_allclose(
                rotation[i, body] @ placement[:3, 3] + origin[i, body],
                expected[link_name][:3, 3],
                atol=1e-12,
            )
        tool = expected[robot.tool_frame]
        np.testing.assert_allclose(tool_rotation[i], tool[:3, :3], atol=1e-12)
        np.testing.assert_allclose(tool_position[i], tool[:3, 3], atol=1e-12)


# --- payload -----------------------------------------------------------------------------------

PAYLOAD = Payload(2.5, (0.05, -0.02, 0.1), (0.03, 0.02, 0.04, 0.005, -0.002, 0.001))


@pytest.fixture(scope="module")
def loaded_ur5():
    return load_robot("example:ur5", "tool0", payload=PAYLOAD)


@pytest.fixture(scope="module")
def ur5_at_payload():
    """A UR5 whose tool centre point is the payload's centre of mass."""
    return load_robot("example:ur5", "tool0", tool_offset=ToolOffset(PAYLOAD.com))


def test_a_payload_adds_its_weight_through_the_jacobian(ur5, loaded_ur5, ur5_at_payload):
    q = random_configurations(ur5, 20)
    weight = np.array([0, 0, -9.81 * PAYLOAD.mass])
    jacobian = ur5_at_payload.tool_jacobian(q)[1][:, :3]
    added = loaded_ur5.gravity_effort(q) - ur5.gravity_effort(q)
    np.testing.assert_allclose(added, -np.einsum("nij,i->nj", jacobian, weight), atol=1e-10)


def test_a_payload_adds_its_kinetic_energy(ur5, loaded_ur5, ur5_at_payload):
    q, v, _ = random_trajectory(ur5, 20)
    zero = np.zeros_like(q)

    def energy(robot):
        momentum = robot.inverse_dynamics(q, zero, v) - robot.gravity_effort(q)
        return np.einsum("ni,ni->n", v, momentum) / 2

    twist = np.einsum("nij,nj->ni", ur5_at_payload.tool_jacobian(q)[1], v)
    spin = np.einsum("nji,nj->ni", ur5_at_payload.tool_pose(q)[0], twist[:, 3:])
    xx, yy, zz, xy, xz, yz = PAYLOAD.inertia
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    linear = PAYLOAD.mass * np.sum(twist[:, :3] ** 2, axis=1) / 2
    angular = np.einsum("ni,ij,nj->n", spin, inertia, spin) / 2
    np.testing.assert_allclose(energy(loaded_ur5) - energy(ur5), linear + angular, atol=1e-10)


def test_a_payload_moves_nothing(ur5, loaded_ur5):
    q = random_configurations(ur5, 5)
    np.testing.assert_array_equal(loaded_ur5.tool_position(q), ur5.tool_position(q))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((-1.0,), "robot.payload: mass -1 kg must be from 0 to 1e+06 kg"),
        ((np.nan,), "robot.payload: mass nan kg must be from 0 to 1e+06 kg"),
        ((np.inf,), "robot.payload: mass inf kg must be from 0 to 1e+06 kg"),
        (
            (1.0, (0, 0, 0), (1, 1, -1, 0, 0, 0)),
            "robot.payload: inertia (1, 1, -1, 0, 0, 0) is not",
        ),
        ((1.0, (0, 0, 0), (1, 1, 1, 2, 0, 0)), "is not positive semidefinite"),
    ],
)
def test_an_impossible_payload_is_refused(arguments, message):
    with pytest.raises(RobotError) as caught:
        Payload(*arguments)
    assert message in str(caught.value)


# --- order of joints, tool offset, locked joints -----------------------------------------------


def test_joints_in_another_order_permute_everything(ur5):
    order = [3, 0, 5, 1, 4, 2]
    shuffled = load_robot("example:ur5", "tool0", joints=[ur5.joint_names[i] for i in order])
    assert shuffled.joint_names == tuple(ur5.joint_names[i] for i in order)
    trajectory = random_trajectory(ur5, 10)
    mixed = [values[:, order] for values in trajectory]
    close = {"rtol": 0, "atol": 1e-12}
    np.testing.assert_allclose(shuffled.tool_position(mixed[0]), ur5.tool_position(trajectory[0]))
    for mine, plain in zip(
        shuffled.body_poses(mixed[0]), ur5.body_poses(trajectory[0]), strict=True
    ):
        np.testing.assert_allclose(mine, plain, **close)
    np.testing.assert_allclose(
        shuffled.tool_jacobian(mixed[0])[1],
        ur5.tool_jacobian(trajectory[0])[1][:, :, order],
        **close,
    )
    np.testing.assert_allclose(
        shuffled.inverse_dynamics(*mixed), ur5.inverse_dynamics(*trajectory)[:, order], **close
    )
    for mine, plain in zip(
        shuffled.inverse_dynamics_derivatives(*mixed),
        ur5.inverse_dynamics_derivatives(*trajectory),
        strict=True,
    ):
        np.testing.assert_allclose(mine, plain[:, order][:, :, order], **close)
    np.testing.assert_array_equal(shuffled.limits.effort, ur5.limits.effort[order])
    np.testing.assert_array_equal(shuffled.limits.velocity, ur5.limits.velocity[order])
    np.testing.assert_array_equal(shuffled.joint_moves_body, ur5.joint_moves_body[:, order])
    np.testing.assert_allclose(shuffled.lever_arm, ur5.lever_arm)  # in the order of the model


def test_the_tool_offset_is_applied_in_the_tool_frame_with_urdf_angles(ur5):
    offset = ToolOffset((0.1, -0.2, 0.3), (0.4, -0.5, 0.6))
    robot = load_robot("example:ur5", "tool0", tool_offset=offset)
    q = random_configurations(ur5, 10)
    rotation, position = ur5.tool_pose(q)
    moved_rotation, moved_position = robot.tool_pose(q)
    turn = Rotation.from_euler("xyz", offset.rpy).as_matrix()
    np.testing.assert_allclose(moved_rotation, rotation @ turn, atol=1e-12)
    np.testing.assert_allclose(moved_position, position + rotation @ offset.position, atol=1e-12)


def test_locked_joints_stand_where_the_problem_puts_them(ur5):
    moving = [1, 2, 4]
    q = random_configurations(ur5, 1)
    locked = {ur5.joint_names[i]: q[0, i] for i in (0, 3, 5)}
    names = [ur5.joint_names[i] for i in moving]
    robot = load_robot("example:ur5", "tool0", joints=names, locked_joints=locked)
    part = q[:, moving]
    np.testing.assert_allclose(robot.tool_position(part), ur5.tool_position(q), atol=1e-12)
    np.testing.assert_allclose(
        robot.gravity_effort(part), ur5.gravity_effort(q)[:, moving], atol=1e-10
    )
    assert robot.joint_count == 3
    assert robot.body_count == 4


def test_a_joint_locked_by_default_stands_at_zero_or_the_nearest_limit(panda):
    others = [name for name in panda.joint_names if name != "panda_joint4"]
    robot = load_robot("example:panda", "panda_hand_tcp", joints=others)
    q = np.zeros((1, 7))
    q[0, 3] = panda.limits.upper_position[3]
    assert q[0, 3] < 0
    expected = panda.tool_position(q)
    np.testing.assert_allclose(robot.tool_position(np.zeros((1, 6))), expected, atol=1e-12)


@pytest.mark.parametrize("fingers", [{}, {"panda_finger_joint1": 0.03}], ids=["closed", "open"])
def test_panda_fingers_are_locked_and_the_second_mirrors_the_first(fingers):
    robot = load_robot("example:panda", "panda_hand_tcp", locked_joints=fingers)
    assert robot.joint_names == tuple(f"panda_joint{i}" for i in range(1, 8))
    in_tool_frame = np.linalg.inv(robot.link_placement["panda_hand"])
    left = (in_tool_frame @ robot.link_placement["panda_leftfinger"])[:3, 3]
    right = (in_tool_frame @ robot.link_placement["panda_rightfinger"])[:3, 3]
    opening = fingers.get("panda_finger_joint1", 0.0)
    np.testing.assert_allclose(left, [0, opening, 0.0584], atol=1e-9)
    np.testing.assert_allclose(right, [0, -opening, 0.0584], atol=1e-9)


def test_a_value_for_a_mimic_joint_is_accepted_if_it_agrees():
    agreeing = {"panda_finger_joint1": 0.02, "panda_finger_joint2": 0.02}
    robot = load_robot("example:panda", "panda_hand_tcp", locked_joints=agreeing)
    assert robot.joint_count == 7


@pytest.mark.parametrize(
    ("locked", "message"),
    [
        (
            {"panda_finger_joint1": 0.02, "panda_finger_joint2": 0.01},
            "robot.locked_joints: 'panda_finger_joint2' at 0.01 contradicts the joint it mimics, "
            "'panda_finger_joint1', which puts it at 0.02",
        ),
        (
            {"panda_finger_joint1": 0.5},
            "robot.locked_joints: 'panda_finger_joint1' at 0.5 is outside its position limits "
            "[0, 0.04]",
        ),
        (
            {"panda_finger_joint3": 0.0},
            "robot.locked_joints: unknown joint outside the group 'panda_finger_joint3' (did "
            "you mean",
        ),
        (
            {"panda_joint1": 0.0},
            "robot.locked_joints: unknown joint outside the group 'panda_joint1'",
        ),
    ],
)
def test_a_locked_joint_out_of_place_is_named(locked, message):
    with pytest.raises(RobotError) as caught:
        load_robot("example:panda", "panda_hand_tcp", locked_joints=locked)
    assert message in str(caught.value)


# --- joint types -------------------------------------------------------------------------------


def test_a_continuous_joint_is_a_plain_coordinate_beyond_full_turns(robot_model_arm):
    free = '<limit effort="50" velocity="3"/>'
    robot = robot_model_arm(
        link("base"),
        link("rotor"),
        link("tip"),
        joint("j", "base", "rotor", "continuous", axis="0 0 2", limit=free),
        '<joint name="weld" type="fixed"><parent link="rotor"/><child link="tip"/>'
        '<origin xyz="0.5 0 0"/></joint>',
    )
    q = np.linspace(-20, 20, 41)[:, None]
    expected = 0.5 * np.column_stack([np.cos(q), np.sin(q), 0 * q])
    np.testing.assert_allclose(robot.tool_position(q), expected, atol=1e-13)
    assert (robot.limits.lower_position[0], robot.limits.upper_position[0]) == (-np.inf, np.inf)
    assert robot.revolute.tolist() == [True]


def test_a_sliding_joint_moves_and_carries_along_its_axis(robot_model_arm):
    robot = robot_model_arm(*SLIDER)
    q, v, a = random_trajectory(robot, 30)
    turn = Rotation.from_euler("z", q[:, :1]).as_matrix()
    reach = 0.5 + q[:, 1]
    local = np.column_stack([reach, 0 * reach, 0 * reach + 0.1])
    expected = np.einsum("nij,nj->ni", turn, local)
    np.testing.assert_allclose(robot.tool_position(q), expected, atol=1e-13)
    assert robot.revolute.tolist() == [True, False, True]
    # Along the slide, force is mass times (acceleration - centripetal): wrist held straight.
    q[:, 2] = v[:, 2] = a[:, 2] = 0
    slide, tip = q[:, 1] + 0.3, q[:, 1] + 0.6
    force = 2 * (2 * a[:, 1] - v[:, 0] ** 2 * (slide + tip))
    np.testing.assert_allclose(robot.inverse_dynamics(q, v, a)[:, 1], force, atol=1e-11)


@pytest.mark.parametrize("which", ["ur5", "panda", "slider"])
def test_no_body_point_moves_further_than_the_lever_arms_allow(request, robot_model_arm, which):
    robot = robot_model_arm(*SLIDER) if which == "slider" else request.getfixturevalue(which)
    rng = np.random.default_rng(3)
    before, after = random_configurations(robot, 400).reshape(2, 200, -1)
    after[::2] = before[::2] + rng.normal(scale=0.01, size=after[::2].shape)
    after = robot.limits.clip(after)
    point = rng.normal(scale=0.2, size=(200, 3))
    rotation, origin = robot.body_poses(np.vstack([before, after]))
    world = np.einsum("nbij,nj->nbi", rotation, np.vstack([point, point])) + origin
    moved = np.linalg.norm(world[:200] - world[200:], axis=2)
    reach = np.linalg.norm(point, axis=1)[:, None, None] + robot.lever_arm
    weights = np.where(robot.revolute, reach, 1.0) * robot.joint_moves_body
    bound = np.einsum("nbj,nj->nb", weights, abs(after - before))
    assert (moved <= bound + 1e-12).all()
    np.testing.assert_array_equal(moved[:, 0], 0.0)


def test_the_lever_arm_of_a_sliding_chain_counts_the_whole_travel(robot_model_arm):
    robot = robot_model_arm(*SLIDER)
    tool = robot.link_body["tip"]
    assert robot.limits.upper_position[1] == 2
    expected = [0.2 + 2 + np.hypot(0.3, 0.1), 0.0]
    np.testing.assert_allclose(robot.lever_arm[tool, robot.revolute], expected)
    assert robot.joint_moves_body[robot.link_body["turn"]].tolist() == [True, False, False]
    assert not robot.joint_moves_body[0].any()


def test_joints_of_another_branch_do_not_move_a_body(robot_model_arm):
    robot = robot_model_arm(*BRANCHED, joints=["other", "second", "first"])
    moves = {name: robot.joint_moves_body[body].tolist() for name, body in robot.link_body.items()}
    assert moves == {
        "base": [False, False, False],
        "arm": [False, False, True],
        "tip": [False, True, True],
        "side": [True, False, True],
    }


# --- faults ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tool": "tp"}, "unknown tool_frame 'tp' (did you mean 'tip'?); there is: base, arm"),
        (
            {"joints": ["1"]},
            "robot.joints: unknown movable joint '1'; there is: first, second, other",
        ),
        ({"joints": ["first", "first"]}, "robot.joints: 'first' is listed 2 times"),
        ({"joints": ["other"]}, "no planned joint moves tool_frame 'tip'; the joints that do"),
        ({"joints": []}, "joints that do are: first, second"),
        ({"tool": "base"}, "no planned joint moves tool_frame 'base'"),
        (
            {"limits": LimitOverrides(effort={"other": 1})},
            "robot.limits.effort: unknown joint 'other'; there is: first, second",
        ),
    ],
)
def test_a_group_that_cannot_be_planned_is_refused(robot_model_arm, options, message):
    with pytest.raises(RobotError) as caught:
        robot_model_arm(*BRANCHED, **options)
    assert message in str(caught.value)


def test_a_mimic_joint_in_the_group_is_refused_with_what_to_plan_instead(robot_model_arm):
    mimic = LIMIT + '<mimic joint="first"/>'
    elements = (*BRANCHED[:5], joint("second", "arm", "tip", limit=mimic), BRANCHED[6])
    message = (
        "robot.joints: joint 'second' mimics 'first' and cannot be planned by itself; plan "
        "'first', which moves it, or leave both out: other"
    )
    with pytest.raises(RobotError, match=message):
        robot_model_arm(*elements, joints=["first", "second", "other"])


def test_joints_that_mimic_each_other_in_a_circle_are_named(robot_model_arm):
    mimic = f'{LIMIT}<mimic joint="other"/>'
    message = "joint 'other' mimics 'other': joints mimic each other in a circle"
    with pytest.raises(RobotError, match=message):
        robot_model_arm(*BRANCHED[:6], joint("other", "arm", "side", limit=mimic))


def test_a_mimic_of_a_mimic_follows_the_first_of_the_chain(robot_model_arm):
    names = ("base", "tip", "a", "b", "c")
    rules = (
        ("to_a", "a", LIMIT),
        ("to_b", "b", LIMIT + '<mimic joint="to_a" multiplier="2" offset="0.1"/>'),
        ("to_c", "c", LIMIT + '<mimic joint="to_b" multiplier="-3" offset="0.2"/>'),
    )
    robot = robot_model_arm(
        *(link(name) for name in names),
        joint("j", "base", "tip"),
        *(joint(name, "base", child, "prismatic", limit=limit) for name, child, limit in rules),
        locked_joints={"to_a": 0.05},
    )
    heights = [robot.link_placement[name][2, 3] for name in ("a", "b", "c")]
    np.testing.assert_allclose(heights, [0.05, 0.2, -0.4])


def test_a_mimic_of_an_unknown_joint_is_named(robot_model_arm):
    elements = (*BRANCHED[:6], joint("other", "arm", "side", limit=LIMIT + '<mimic joint="x"/>'))
    with pytest.raises(
        RobotError, match="'other' mimics 'x': unknown joint 'x'; there is: first, s"
    ):
        robot_model_arm(*elements)


def test_a_missing_mass_is_named_by_the_joint_that_moves_it(robot_model_arm):
    elements = (link("base", ""), link("middle"), link("tip", ""))
    joints = (joint("first", "base", "middle"), joint("last", "middle", "tip"))
    with pytest.raises(RobotError) as caught:
        robot_model_arm(*elements, *joints)
    assert "what joint 'last' moves has mass 0 kg; efforts need the links' <inertial>" in str(
        caught.value
    )


def test_masses_are_not_needed_where_efforts_do_not_count(robot_model_arm):
    free = LimitOverrides(effort={"j": np.inf})
    robot = robot_model_arm(
        link("base", ""), link("tip", ""), joint("j", "base", "tip"), limits=free
    )
    assert robot.joint_names == ("j",)


def test_a_payload_makes_up_for_a_massless_tool(robot_model_arm):
    massless = (link("base", ""), link("tip", ""), joint("j", "base", "tip", axis="0 1 0"))
    robot = robot_model_arm(*massless, payload=Payload(3.0, (0.5, 0, 0)))
    np.testing.assert_allclose(robot.gravity_effort(np.zeros((1, 1))), [[-3 * 9.81 * 0.5]])


@pytest.mark.parametrize("samples", [0, 1, 3])
def test_one_joint_and_any_number_of_samples_keep_their_shapes(robot_model_arm, samples):
    """A pendulum: 2 kg at 0.1 m, 0.1 kg m^2 about its centre of mass."""
    robot = robot_model_arm(link("base"), link("tip"), joint("j", "base", "tip", axis="0 -1 0"))
    q, v, a = np.random.default_rng(5).normal(size=(3, samples, 1))
    effort = (0.1 + 2 * 0.1**2) * a + 2 * 9.81 * 0.1 * np.cos(q)
    np.testing.assert_allclose(robot.inverse_dynamics(q, v, a), effort, atol=1e-12)
    position, jacobian = robot.tool_jacobian(q)
    assert position.shape == (samples, 3)
    np.testing.assert_allclose(jacobian, np.tile([[0], [0], [0], [0], [-1], [0]], (samples, 1, 1)))
    by_q, by_v, by_a = robot.inverse_dynamics_derivatives(q, v, a)
    np.testing.assert_allclose(by_q, -2 * 9.81 * 0.1 * np.sin(q)[:, :, None], atol=1e-12)
    np.testing.assert_allclose(by_v, np.zeros((samples, 1, 1)))
    np.testing.assert_allclose(by_a, np.full((samples, 1, 1), 0.12))


def test_loading_leaves_the_standard_error_alone(robot_model_arm, capfd):
    robot_model_arm(link("base"), link("tip"), joint("j", "base", "tip", axis="0 0 2"))
    assert capfd.readouterr().err == ""


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(RobotError) as caught:
        load_robot("arm.urdf", "tip", directory=tmp_path)
    assert str(caught.value) == f"robot description {tmp_path / 'arm.urdf'} does not exist"


def test_a_joint_and_a_link_may_share_a_name(robot_model_arm):
    robot = robot_model_arm(link("base"), link("tip"), joint("tip", "base", "tip", xyz="0 0 1"))
    np.testing.assert_allclose(robot.tool_position(np.zeros((1, 1))), [[0, 0, 1]])
    assert robot.joint_names == ("tip",)


def test_names_that_pinocchio_uses_itself_are_allowed(robot_model_arm):
    names = ("universe", "root_joint", "tool centre point")
    robot = robot_model_arm(
        *(link(name) for name in names),
        joint("universe", "universe", "root_joint", xyz="0 0 1"),
        joint("root_joint", "root_joint", "tool centre point", xyz="0 0 2"),
        tool="tool centre point",
    )
    np.testing.assert_allclose(robot.tool_position(np.zeros((1, 2))), [[0, 0, 3]])


def test_an_arm_on_a_mobile_base_is_planned_with_the_base_standing_still(robot_model_arm):
    robot = robot_model_arm(
        *(link(name) for name in ("world", "base", "tip")),
        joint("drive", "world", "base", "planar", xyz="0 0 0.5"),
        joint("j", "base", "tip", xyz="0 0 1"),
    )
    assert robot.joint_names == ("j",)
    np.testing.assert_allclose(robot.tool_position(np.zeros((1, 1))), [[0, 0, 1.5]])


def test_what_is_handed_out_cannot_be_written_to(ur5):
    for array in (ur5.gravity, ur5.lever_arm, ur5.link_placement["tool0"]):
        with pytest.raises(ValueError, match="read-only"):
            array[:] = 0.0


# --- the velocity of the tool -------------------------------------------------------------------


def require_tool_velocity(robot):
    """Against the Jacobian, and its derivatives against differences."""
    q, v, _ = random_trajectory(robot, 12)
    velocity, by_q, by_v = robot.tool_velocity(q, v)
    jacobian = robot.tool_jacobian(q)[1][:, :3]
    np.testing.assert_allclose(velocity, np.einsum("nij,nj->ni", jacobian, v), atol=1e-12)
    np.testing.assert_allclose(by_v, jacobian, atol=1e-12)
    step = 1e-6
    for j, direction in enumerate(np.eye(robot.joint_count)):
        sides = [robot.tool_velocity(q + sign * step * direction, v)[0] for sign in (1, -1)]
        np.testing.assert_allclose(by_q[:, :, j], (sides[0] - sides[1]) / (2 * step), atol=1e-7)
    ahead, behind = (robot.tool_position(q + sign * step * v) for sign in (1, -1))
    np.testing.assert_allclose(velocity, (ahead - behind) / (2 * step), atol=1e-7)


def test_the_tools_velocity_is_that_of_the_jacobian(robot):
    require_tool_velocity(robot)


def test_the_tools_velocity_of_joints_that_slide_or_follow(robot_model_arm, slide, tmp_path):
    require_tool_velocity(slide)
    require_tool_velocity(
        robot_model_arm(*SLIDER, tool_offset=ToolOffset(position=(0.1, 0.2, 0.3)))
    )
    (tmp_path / "followers.urdf").write_text(follower_arm())
    require_tool_velocity(load_robot(tmp_path / "followers.urdf", "tip"))


# An arm with other limits moves as before.


@pytest.fixture
def arms():
    """The two-link arm, and itself with half its efforts and other motors."""
    limits = LimitOverrides(effort={"joint1": 30.0, "joint2": 10.0})
    arm = load_robot("example:two_link", "hand", limits=limits)
    stalls = replace(arm.motors, saturation_effort=np.array([40.0, 20.0]))
    return arm, arm.with_limits(replace(arm.limits, effort=0.5 * arm.limits.effort), stalls)


def test_it_has_the_limits_given_and_the_other_keeps_its_own(arms):
    arm, limited = arms
    assert limited.limits.effort.tolist() == [15.0, 5.0]
    assert limited.motors.saturation_effort.tolist() == [40.0, 20.0]
    assert arm.limits.effort.tolist() == [30.0, 10.0]
    assert not np.isfinite(arm.motors.saturation_effort).any()


def test_it_moves_as_the_other_and_as_no_other_arm(arms):
    arm, limited = arms
    assert limited.moves_as(arm) and arm.moves_as(limited)
    assert not load_robot("example:two_link", "hand").moves_as(arm)
    q = np.array([[0.3, -1.2]])
    assert limited.tool_position(q).tolist() == arm.tool_position(q).tolist()
    assert limited.inverse_dynamics(q, q, q).tolist() == arm.inverse_dynamics(q, q, q).tolist()


def test_pickled_it_keeps_them(arms):
    again = pickle.loads(pickle.dumps(arms[1]))
    assert again.limits.effort.tolist() == [15.0, 5.0]
    assert again.motors.saturation_effort.tolist() == [40.0, 20.0]


# Efforts with rotors and viscous friction: against Pinocchio's own, formulas, and differences.


STEP = 1e-6


def motors_states(count, samples=30):
    return np.random.default_rng(4).uniform(-2, 2, (3, samples, count))


def motors_of(count):
    rng = np.random.default_rng(5)
    return {"armature": rng.uniform(0.1, 2, count), "viscous_friction": rng.uniform(1, 9, count)}


@pytest.fixture(scope="module")
def follower(tmp_path_factory):
    """The arm with followers, its joints in an order of their own, and all its joints planned."""
    folder = tmp_path_factory.mktemp("followers")
    arms = []
    for name, rules, joints in (
        ("following", RULES, ["wrist", "first", "side_joint", "lift"]),
        ("free", {}, list(JOINTS)),
    ):
        path = folder / f"{name}.urdf"
        path.write_text(follower_arm(rules))
        arms.append(load_robot(path, "tip", joints=joints))
    return arms


def test_rotors_are_pinocchios_armature(ur5):
    motors = motors_of(6)
    model = pin.buildModelFromUrdf(str(ur5.urdf.path))
    assert tuple(list(model.names)[1:]) == ur5.joint_names
    model.armature = motors["armature"]
    data, (q, v, a) = model.createData(), motors_states(6)
    rigid = [pin.rnea(model, data, *state).copy() for state in zip(q, v, a, strict=True)]
    expected = np.array(rigid) + motors["viscous_friction"] * v
    found = with_motors(ur5, **motors).inverse_dynamics(q, v, a)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-10)


def test_joints_in_another_order_have_their_own_motors(ur5):
    order = [3, 0, 5, 1, 4, 2]
    names = [ur5.joint_names[k] for k in order]
    other, motors = load_robot("example:ur5", "tool0", joints=names), motors_of(6)
    permuted = with_motors(other, **{name: value[order] for name, value in motors.items()})
    state, robot = motors_states(6), with_motors(ur5, **motors)
    found = permuted.inverse_dynamics(*(part[:, order] for part in state))
    np.testing.assert_allclose(found, robot.inverse_dynamics(*state)[:, order], atol=1e-10)


def test_followers_have_no_motors(follower):
    """What the masters feel is their own rotors and friction, once: not once more per follower."""
    plain, _ = follower
    motors, (q, v, a) = motors_of(4), motors_states(4)
    found = with_motors(plain, **motors).inverse_dynamics(q, v, a)
    expected = plain.inverse_dynamics(q, v, a)
    expected += motors["armature"] * a + motors["viscous_friction"] * v
    np.testing.assert_allclose(found, expected, atol=1e-10)


def test_gravity_is_held_without_friction(ur5):
    q = motors_states(6)[0]
    found = with_motors(ur5, **motors_of(6), forwards_friction=3.0).gravity_effort(q)
    np.testing.assert_allclose(found, ur5.gravity_effort(q), atol=1e-12)


@pytest.mark.parametrize("which", ["ur5", "following", "free"])
def test_derivatives_are_those_of_differences(which, ur5, follower):
    plain = ur5 if which == "ur5" else follower[which == "free"]
    robot = with_motors(plain, **motors_of(plain.joint_count))
    state = motors_states(plain.joint_count, 5)
    exact = robot.inverse_dynamics_derivatives(*state)
    for order in range(3):
        for joint in range(plain.joint_count):
            shift = np.zeros_like(state)
            shift[order, :, joint] = STEP
            sides = [robot.inverse_dynamics(*(state + way * shift)) for way in (1, -1)]
            slope = (sides[0] - sides[1]) / (2 * STEP)
            np.testing.assert_allclose(exact[order][:, :, joint], slope, rtol=1e-5, atol=1e-5)
