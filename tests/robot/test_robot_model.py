"""RobotModel: kinematics, dynamics, limits of an arm at N samples; effort rates."""

import pickle
from dataclasses import replace
from functools import partial

import numpy as np
import pinocchio as pin
import pytest
import yourdfpy
from arms import LIMIT, follower_arm, joint, link, links, loaded
from cases import one_joint, refusal, with_motors
from numpy.testing import assert_allclose as close
from numpy.testing import assert_array_equal as same
from scipy.spatial.transform import Rotation

from tubeplanner import LimitOverrides, Payload, PointSpeed, RobotError, ToolOffset, load_robot
from tubeplanner.robot.model import effort_rate, effort_rate_derivatives, gravity_effort_rate

SLIDER = (
    links("base", "turn", "slide", "tip"),
    joint("turner", "base", "turn"),
    joint("slider", "turn", "slide", "prismatic", "0.2 0 0", "1 0 0", LIMIT.replace("-2", "-1")),
    joint("wrist", "slide", "tip", "revolute", "0.3 0 0.1", "0 1 0"),
)
TRUNK = (links("base", "arm", "tip", "side"), joint("first", "base", "arm"))
SECOND, OTHER = (
    joint("second", "arm", "tip", xyz="1 0 0"),
    joint("other", "arm", "side", xyz="0 1 0"),
)
BRANCHED = (*TRUNK, SECOND, OTHER)


@pytest.fixture
def load(tmp_path):
    """Load an arm from a few lines of URDF."""
    return partial(loaded, tmp_path)


@pytest.fixture(scope="module")
def followers(tmp_path_factory):
    """The arm with followers, its joints in an order of their own."""
    path = tmp_path_factory.mktemp("followers") / "arm.urdf"
    path.write_text(follower_arm())
    return load_robot(path, "tip", joints=["wrist", "first", "side_joint", "lift"])


def random_configurations(robot, count):
    low = np.maximum(robot.limits.lower_position, -2 * np.pi)
    high = np.minimum(robot.limits.upper_position, 2 * np.pi)
    return np.random.default_rng(7).uniform(low, high, (count, robot.joint_count))


def random_trajectory(robot, count=50):
    rng = np.random.default_rng(8)
    q = random_configurations(robot, count)
    return q, rng.normal(size=q.shape), rng.normal(size=q.shape)


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


@pytest.mark.parametrize("name", METHODS)
def test_one_configuration_lists_and_names_are_taken_and_other_shapes_named(arm, name):
    (count, axis), method = METHODS[name], getattr(arm, name)
    states = np.random.default_rng(3).uniform(-1, 1, (count, 4, 6))
    named = dict(zip("qva", states[:, 2].tolist(), strict=False))
    many, one, by_name = (
        result if isinstance(result, tuple) else (result,)
        for result in (method(*states), method(*states[:, 2]), method(**named))
    )
    for several, single, again in zip(many, one, by_name, strict=True):
        close(single, several.take(2, axis), rtol=0, atol=1e-12)
        same(again, single)
    for shape in ((5,), (3, 5), (1, 1, 6), ()):
        message = refusal(RobotError, method, *[np.zeros(shape)] * count)
        assert str(shape) in message and "(6,), or (N, 6)" in message


def test_rates_have_the_shape_of_the_configurations(arm):
    for shape in ((6,), (3, 6), (2, 5)):
        with pytest.raises(RobotError, match=r"v has shape .*, and q \(2, 6\)"):
            arm.tool_velocity(np.zeros((2, 6)), np.zeros(shape))


def test_efforts_by_position_are_had_for_one_configuration_too():
    limits = LimitOverrides(effort={"elbow_joint": {"position": [-1, 1], "effort": [10, 30]}})
    limits, q = load_robot("example:ur5", "ee_link", limits=limits).limits, np.full(6, 0.5)
    assert limits.effort_at(q, 1.0)[2] == pytest.approx(25)
    same(limits.effort_at(q, 1.0), limits.effort_at(q[None], 1.0)[0])


# Rates of efforts: closed forms, differences, and how they grow with the speed.


@pytest.fixture(scope="module", params=["two_link", "slide", "payload", "followers"])
def effort_rate_arm(request):
    if request.param == "payload":
        return load_robot("example:ur10", "tool0", payload=Payload(8.0, (0.1, 0, 0.2)))
    return request.getfixturevalue(request.param)


@pytest.fixture
def states(effort_rate_arm):
    """Random positions, velocities, accelerations and jerks, as fast as arms get, each (8, n)."""
    scale = np.array([1.5, 2.0, 60.0, 1e4])[:, None, None]
    return scale * np.random.default_rng(0).uniform(-1, 1, (4, 8, effort_rate_arm.joint_count))


def test_the_effort_rate_of_a_pendulum_is_known(tmp_path):
    """Effort I a + m g l cos(q), its rate I jerk - m g l sin(q) v."""
    robot = one_joint(tmp_path, mass=0.5)
    q, v, a, jerk = np.random.default_rng(1).uniform(-3, 3, (4, 20, 1))
    gravity = -0.5 * 9.81 * 0.5 * np.sin(q) * v
    close(gravity_effort_rate(robot, q, v), gravity, atol=1e-12)
    inertia = robot.inverse_dynamics(q, 0 * q, 1 + 0 * q) - robot.gravity_effort(q)
    close(effort_rate(robot, q, v, a, jerk), inertia * jerk + gravity, atol=1e-12)


def test_effort_rates_are_what_the_efforts_change_by(effort_rate_arm, states):
    def efforts(t):
        q, v, a, jerk = states
        return effort_rate_arm.inverse_dynamics(
            q + t * v + t**2 / 2 * a + t**3 / 6 * jerk, v + t * a + t**2 / 2 * jerk, a + t * jerk
        )

    step = 2e-5
    numeric = (efforts(-2 * step) - 8 * efforts(-step)) / (12 * step)
    numeric += (8 * efforts(step) - efforts(2 * step)) / (12 * step)
    rate = effort_rate(effort_rate_arm, *states)
    close(rate / abs(rate).max(), numeric / abs(rate).max(), atol=1e-9)


def test_gravitys_grow_with_the_speed_all_others_with_its_third_power(effort_rate_arm, states):
    gravity = gravity_effort_rate(effort_rate_arm, *states[:2])
    rest = effort_rate(effort_rate_arm, *states) - gravity
    for speed in (0.1, 3.0):
        run = (rate * speed**k for k, rate in enumerate(states))
        expected = speed * gravity + speed**3 * rest
        close(effort_rate(effort_rate_arm, *run), expected, rtol=1e-9, atol=1e-8)


def test_derivatives_of_effort_rates_are_those_of_differences(effort_rate_arm, states):
    exact = effort_rate_derivatives(effort_rate_arm, *states)
    for order, step in enumerate((1e-5, 1e-5, 1e-3, 1e-1)):
        for k in range(effort_rate_arm.joint_count):
            sides = []
            for sign in (step, -step):
                moved = states.copy()
                moved[order, :, k] += sign
                sides.append(effort_rate(effort_rate_arm, *moved))
            numeric, scale = (sides[0] - sides[1]) / (2 * step), abs(exact[order]).max()
            close(exact[order][:, :, k] / scale, numeric / scale, atol=1e-6)


def test_an_arm_at_rest_has_derivatives_of_effort_rates_too(effort_rate_arm):
    """By the jerk its inertia, by the velocity how gravity changes with the position."""
    still = np.zeros((1, effort_rate_arm.joint_count))
    by_q, by_v, by_a, by_jerk = effort_rate_derivatives(effort_rate_arm, still, still, still, still)
    gravity, _, inertia = effort_rate_arm.inverse_dynamics_derivatives(still, still, still)
    close(by_q, 0.0, atol=1e-9)
    close(by_v, gravity, atol=1e-9)
    close(by_a, 0.0, atol=1e-9)
    close(by_jerk, inertia, atol=1e-12)


LENGTH, MASS, INERTIA = 0.3, 14.6, 0.1  # of both links; the centre of mass is at the far end


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
    efforts = (
        m11 * a[:, 0] + m12 * a[:, 1] + h1 + inner + outer,
        m12 * a[:, 0] + m22 * a[:, 1] + h2 + outer,
    )
    return np.column_stack(efforts)


def test_two_link_tool_and_jacobian_are_those_of_trigonometry(two_link):
    q = random_configurations(two_link, 200)
    angle, zero = q.cumsum(axis=1), np.zeros(len(q))
    elbow, fore = (LENGTH * np.column_stack([np.cos(a), np.sin(a), zero]) for a in angle.T)
    rotation, position = two_link.tool_pose(q)
    close(position, elbow + fore, atol=1e-14)
    close(two_link.tool_position(q), position, atol=0)
    close(rotation, Rotation.from_euler("z", angle[:, 1:]).as_matrix(), atol=1e-14)
    position, jacobian = two_link.tool_jacobian(q)
    (x, y, _), (away_x, away_y, _) = position.T, fore.T
    close(jacobian[:, 0], np.column_stack([-y, -away_y]), atol=1e-14)
    close(jacobian[:, 1], np.column_stack([x, away_x]), atol=1e-14)
    close(jacobian[:, 5], 1.0, atol=1e-14)
    close(jacobian[:, 2:5], 0.0, atol=1e-14)


def test_two_link_effort_is_mass_times_acceleration_plus_coriolis_plus_weight(two_link):
    motion = random_trajectory(two_link, 200)
    close(two_link.inverse_dynamics(*motion), two_link_effort(*motion), atol=1e-11)
    same(two_link.gravity_effort(motion[0]), 0.0)
    upright = load_robot("example:two_link", "hand", gravity=(0, -9.81, 0))
    expected = two_link_effort(*motion, gravity=9.81)
    close(upright.inverse_dynamics(*motion), expected, atol=1e-11)
    same(upright.gravity, [0, -9.81, 0])


def yourdfpy_poses(robot, configurations):
    """Yield yourdfpy's poses (4, 4) of all links, by name; joints outside the group at 0."""
    model = yourdfpy.URDF.load(str(robot.urdf.path), load_meshes=False, load_collision_meshes=False)
    for q in configurations:
        values = dict.fromkeys(model.actuated_joint_names, 0.0)
        values.update(zip(robot.joint_names, q, strict=True))
        model.update_cfg([values[name] for name in model.actuated_joint_names])
        yield {name: model.get_transform(name, model.base_link) for name in robot.urdf.links}


def test_every_link_is_where_yourdfpy_puts_it(robot):
    q = random_configurations(robot, 3)
    rotation, origin = robot.body_poses(q)
    tool_rotation, tool_position = robot.tool_pose(q)
    for i, expected in enumerate(yourdfpy_poses(robot, q)):
        for name, body in robot.link_body.items():
            turn, place = robot.link_placement[name][:3, :3], robot.link_placement[name][:3, 3]
            close(rotation[i, body] @ turn, expected[name][:3, :3], atol=1e-12)
            place = rotation[i, body] @ place + origin[i, body]
            close(place, expected[name][:3, 3], atol=1e-12)
        close(tool_rotation[i], expected[robot.tool_frame][:3, :3], atol=1e-12)
        close(tool_position[i], expected[robot.tool_frame][:3, 3], atol=1e-12)


PAYLOAD = Payload(2.5, (0.05, -0.02, 0.1), (0.03, 0.02, 0.04, 0.005, -0.002, 0.001))


def test_a_payload_adds_its_weight_and_its_kinetic_energy_and_moves_nothing(ur5):
    """Weight through the Jacobian of its centre of mass; energy of that point and of its spin."""
    loaded = load_robot("example:ur5", "tool0", payload=PAYLOAD)
    at_payload = load_robot("example:ur5", "tool0", tool_offset=ToolOffset(PAYLOAD.com))
    q, v, _ = random_trajectory(ur5, 20)
    same(loaded.tool_position(q), ur5.tool_position(q))
    weight, jacobian = np.array([0, 0, -9.81 * PAYLOAD.mass]), at_payload.tool_jacobian(q)[1]
    added = loaded.gravity_effort(q) - ur5.gravity_effort(q)
    close(added, -np.einsum("nij,i->nj", jacobian[:, :3], weight), atol=1e-10)

    def energy(robot):
        momentum = robot.inverse_dynamics(q, 0 * q, v) - robot.gravity_effort(q)
        return np.einsum("ni,ni->n", v, momentum) / 2

    twist = np.einsum("nij,nj->ni", jacobian, v)
    spin = np.einsum("nji,nj->ni", at_payload.tool_pose(q)[0], twist[:, 3:])
    xx, yy, zz, xy, xz, yz = PAYLOAD.inertia
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    linear = PAYLOAD.mass * np.sum(twist[:, :3] ** 2, axis=1) / 2
    angular = np.einsum("ni,ij,nj->n", spin, inertia, spin) / 2
    close(energy(loaded) - energy(ur5), linear + angular, atol=1e-10)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((-1.0,), "mass -1 kg must be from 0 to 1e+06 kg"),
        ((np.nan,), "mass nan kg must be from 0 to 1e+06 kg"),
        ((1.0, (0, 0, 0), (1, 1, 1, 2, 0, 0)), "inertia (1, 1, 1, 2, 0, 0) is not positive semid"),
    ],
)
def test_an_impossible_payload_is_refused(arguments, message):
    assert refusal(RobotError, Payload, *arguments).startswith(f"robot.payload: {message}")


def test_joints_in_another_order_permute_everything(ur5):
    order = [3, 0, 5, 1, 4, 2]
    shuffled = load_robot("example:ur5", "tool0", joints=[ur5.joint_names[i] for i in order])
    assert shuffled.joint_names == tuple(ur5.joint_names[i] for i in order)
    motion = random_trajectory(ur5, 10)
    mixed = [values[:, order] for values in motion]
    exact = {"rtol": 0, "atol": 1e-12}
    close(shuffled.tool_position(mixed[0]), ur5.tool_position(motion[0]))
    for mine, plain in zip(shuffled.body_poses(mixed[0]), ur5.body_poses(motion[0]), strict=True):
        close(mine, plain, **exact)
    jacobian = ur5.tool_jacobian(motion[0])[1][:, :, order]
    close(shuffled.tool_jacobian(mixed[0])[1], jacobian, **exact)
    efforts = ur5.inverse_dynamics(*motion)[:, order]
    close(shuffled.inverse_dynamics(*mixed), efforts, atol=1e-10)
    derivatives = ur5.inverse_dynamics_derivatives(*motion)
    for one, other in zip(shuffled.inverse_dynamics_derivatives(*mixed), derivatives, strict=True):
        close(one, other[:, order][:, :, order], **exact)
    same(shuffled.limits.effort, ur5.limits.effort[order])
    same(shuffled.joint_moves_body, ur5.joint_moves_body[:, order])
    close(shuffled.lever_arm, ur5.lever_arm)  # in the order of the model


def test_the_tool_offset_is_applied_in_the_tool_frame_with_urdf_angles(ur5):
    offset = ToolOffset((0.1, -0.2, 0.3), (0.4, -0.5, 0.6))
    q = random_configurations(ur5, 10)
    rotation, position = ur5.tool_pose(q)
    moved = load_robot("example:ur5", "tool0", tool_offset=offset).tool_pose(q)
    close(moved[0], rotation @ Rotation.from_euler("xyz", offset.rpy).as_matrix(), atol=1e-12)
    close(moved[1], position + rotation @ offset.position, atol=1e-12)


def test_locked_joints_stand_where_the_problem_puts_them(ur5):
    moving = [1, 2, 4]
    q = random_configurations(ur5, 1)
    locked = {ur5.joint_names[i]: q[0, i] for i in (0, 3, 5)}
    names = [ur5.joint_names[i] for i in moving]
    robot = load_robot("example:ur5", "tool0", joints=names, locked_joints=locked)
    part = q[:, moving]
    close(robot.tool_position(part), ur5.tool_position(q), atol=1e-12)
    close(robot.gravity_effort(part), ur5.gravity_effort(q)[:, moving], atol=1e-10)
    assert (robot.joint_count, robot.body_count) == (3, 4)


def test_a_joint_locked_by_default_stands_at_zero_or_the_nearest_limit(panda):
    others = [name for name in panda.joint_names if name != "panda_joint4"]
    robot = load_robot("example:panda", "panda_hand_tcp", joints=others)
    q = np.zeros((1, 7))
    q[0, 3] = panda.limits.upper_position[3]
    assert q[0, 3] < 0
    close(robot.tool_position(np.zeros((1, 6))), panda.tool_position(q), atol=1e-12)


ONE, TWO = "panda_finger_joint1", "panda_finger_joint2"


def test_panda_fingers_are_locked_and_the_second_mirrors_the_first():
    for opening, fingers in ((0.0, {}), (0.03, {ONE: 0.03}), (0.02, {ONE: 0.02, TWO: 0.02})):
        robot = load_robot("example:panda", "panda_hand_tcp", locked_joints=fingers)
        assert robot.joint_names == tuple(f"panda_joint{i}" for i in range(1, 8))
        hand = np.linalg.inv(robot.link_placement["panda_hand"])
        for side, y in (("left", opening), ("right", -opening)):
            finger = hand @ robot.link_placement[f"panda_{side}finger"]
            close(finger[:3, 3], [0, y, 0.0584], atol=1e-9)


@pytest.mark.parametrize(
    ("locked", "message"),
    [
        (
            {ONE: 0.02, TWO: 0.01},
            f"'{TWO}' at 0.01 contradicts the joint it mimics, '{ONE}', which puts it at 0.02",
        ),
        ({ONE: 0.5}, f"'{ONE}' at 0.5 is outside its position limits [0, 0.04]"),
        ({"panda_joint1": 0.0}, "unknown joint outside the group 'panda_joint1' (did you mean"),
    ],
)
def test_a_locked_joint_out_of_place_is_named(locked, message):
    text = refusal(RobotError, load_robot, "example:panda", "panda_hand_tcp", locked_joints=locked)
    assert f"robot.locked_joints: {message}" in text


def test_a_sliding_joint_moves_and_carries_along_its_axis(load):
    robot = load(*SLIDER)
    q, v, a = random_trajectory(robot, 30)
    turn = Rotation.from_euler("z", q[:, :1]).as_matrix()
    reach = 0.5 + q[:, 1]
    local = np.column_stack([reach, 0 * reach, 0 * reach + 0.1])
    close(robot.tool_position(q), np.einsum("nij,nj->ni", turn, local), atol=1e-13)
    assert robot.revolute.tolist() == [True, False, True]
    # Along the slide, force is mass times (acceleration - centripetal): wrist held straight.
    q[:, 2] = v[:, 2] = a[:, 2] = 0
    slide, tip = q[:, 1] + 0.3, q[:, 1] + 0.6
    force = 2 * (2 * a[:, 1] - v[:, 0] ** 2 * (slide + tip))
    close(robot.inverse_dynamics(q, v, a)[:, 1], force, atol=1e-11)


def test_lever_arms_count_the_whole_travel_of_a_slide_and_no_other_branch(load):
    robot = load(*SLIDER)
    expected = [0.2 + 2 + np.hypot(0.3, 0.1), 0.0]
    close(robot.lever_arm[robot.link_body["tip"], robot.revolute], expected)
    close(robot.joint_units, np.where(robot.revolute, 1.0, robot.arm_length))
    assert robot.joint_moves_body[robot.link_body["turn"]].tolist() == [True, False, False]
    robot = load(*BRANCHED, joints=["other", "second", "first"])
    moves = {name: robot.joint_moves_body[body].tolist() for name, body in robot.link_body.items()}
    assert moves == {
        "base": [False, False, False],
        "arm": [False, False, True],
        "tip": [False, True, True],
        "side": [True, False, True],
    }


GROUPS = (
    ({"tool": "tp"}, "unknown tool_frame 'tp' (did you mean 'tip'?); there is: base, arm"),
    (
        {"joints": ["1"]},
        "robot.joints: unknown movable joint '1'; there is: first, second, other",
    ),
    ({"joints": ["first", "first"]}, "robot.joints: 'first' is listed 2 times"),
    (
        {"joints": ["other"]},
        "no planned joint moves tool_frame 'tip'; the joints that do are: first, second",
    ),
)


@pytest.mark.parametrize(("options", "message"), GROUPS)
def test_a_group_that_cannot_be_planned_is_refused(load, options, message):
    assert message in refusal(RobotError, load, *BRANCHED, **options)


def test_mimic_joints_that_cannot_be_planned_are_named(load):
    def mimic(master):
        return LIMIT + f'<mimic joint="{master}"/>'

    second = joint("second", "arm", "tip", limit=mimic("first"))
    group = ["first", "second", "other"]
    assert refusal(RobotError, load, *TRUNK, second, OTHER, joints=group).endswith(
        "robot.joints: joint 'second' mimics 'first' and cannot be planned by itself; plan "
        "'first', which moves it, or leave both out: other"
    )
    for master, message in (
        ("other", "joint 'other' mimics 'other': joints mimic each other in a circle"),
        ("x", "'other' mimics 'x': unknown joint 'x'; there is: first, s"),
    ):
        other = joint("other", "arm", "side", limit=mimic(master))
        assert message in refusal(RobotError, load, *TRUNK, SECOND, other)


def test_a_missing_mass_is_named_by_the_joint_that_moves_it_unless_efforts_do_not_count(load):
    chain = (joint("first", "base", "middle"), joint("last", "middle", "tip"))
    message = refusal(RobotError, load, link("base", ""), link("middle"), link("tip", ""), *chain)
    assert "what joint 'last' moves has mass 0 kg; efforts need the links' <inertial>" in message
    massless = (link("base", ""), link("tip", ""), joint("j", "base", "tip", axis="0 1 0"))
    assert load(*massless, limits=LimitOverrides(effort={"j": np.inf})).joint_names == ("j",)
    robot = load(*massless, payload=Payload(3.0, (0.5, 0, 0)))
    close(robot.gravity_effort(np.zeros((1, 1))), [[-3 * 9.81 * 0.5]])


@pytest.mark.parametrize("samples", [0, 1, 3])
def test_one_joint_and_any_number_of_samples_keep_their_shapes(load, capfd, samples):
    """A pendulum: 2 kg at 0.1 m, 0.1 kg m^2 about its centre of mass."""
    robot = load(links("base", "tip"), joint("j", "base", "tip", axis="0 -2 0"))
    assert capfd.readouterr().err == ""
    q, v, a = np.random.default_rng(5).normal(size=(3, samples, 1))
    effort = (0.1 + 2 * 0.1**2) * a + 2 * 9.81 * 0.1 * np.cos(q)
    close(robot.inverse_dynamics(q, v, a), effort, atol=1e-12)
    position, jacobian = robot.tool_jacobian(q)
    assert position.shape == (samples, 3)
    close(jacobian, np.tile([[0], [0], [0], [0], [-1], [0]], (samples, 1, 1)))
    for derivatives in robot.inverse_dynamics_derivatives(q, v, a):
        assert derivatives.shape == (samples, 1, 1)


def test_a_missing_file_is_named(tmp_path):
    message = refusal(RobotError, load_robot, "arm.urdf", "tip", directory=tmp_path)
    assert message == f"robot description {tmp_path / 'arm.urdf'} does not exist"


def test_names_may_be_shared_and_be_pinocchios_own(load):
    robot = load(
        links("universe", "root_joint", "tool centre point"),
        joint("universe", "universe", "root_joint", xyz="0 0 1"),
        joint("root_joint", "root_joint", "tool centre point", xyz="0 0 2"),
        tool="tool centre point",
    )
    close(robot.tool_position(np.zeros((1, 2))), [[0, 0, 3]])


def test_an_arm_on_a_mobile_base_is_planned_with_the_base_standing_still(load):
    drive = joint("drive", "world", "base", "planar", xyz="0 0 0.5")
    robot = load(links("world", "base", "tip"), drive, joint("j", "base", "tip", xyz="0 0 1"))
    assert robot.joint_names == ("j",)
    close(robot.tool_position(np.zeros((1, 1))), [[0, 0, 1.5]])


def test_what_is_handed_out_cannot_be_written_to(ur5):
    for array in (ur5.gravity, ur5.lever_arm, ur5.link_placement["tool0"]):
        with pytest.raises(ValueError, match="read-only"):
            array[:] = 0.0


@pytest.mark.parametrize("name", ["panda", "slide", "followers"])
def test_the_tools_velocity_is_that_of_the_jacobian_and_of_differences(request, name):
    robot = request.getfixturevalue(name)
    q, v, _ = random_trajectory(robot, 12)
    velocity, by_q, by_v = robot.tool_velocity(q, v)
    jacobian = robot.tool_jacobian(q)[1][:, :3]
    close(velocity, np.einsum("nij,nj->ni", jacobian, v), atol=1e-12)
    close(by_v, jacobian, atol=1e-12)
    step = 1e-6
    for j, direction in enumerate(np.eye(robot.joint_count)):
        sides = [robot.tool_velocity(q + sign * step * direction, v)[0] for sign in (1, -1)]
        close(by_q[:, :, j], (sides[0] - sides[1]) / (2 * step), atol=1e-7)


def test_an_arm_with_other_limits_moves_as_before():
    arm = load_robot(
        "example:two_link", "hand", limits=LimitOverrides(effort={"joint1": 30.0, "joint2": 10.0})
    )
    stalls = replace(arm.motors, saturation_effort=np.array([40.0, 20.0]))
    limited = arm.with_limits(replace(arm.limits, effort=0.5 * arm.limits.effort), stalls)
    for each in (limited, pickle.loads(pickle.dumps(limited))):
        assert each.limits.effort.tolist() == [15.0, 5.0]
        assert each.motors.saturation_effort.tolist() == [40.0, 20.0]
    assert arm.limits.effort.tolist() == [30.0, 10.0]
    assert not np.isfinite(arm.motors.saturation_effort).any()
    assert limited.moves_as(arm) and arm.moves_as(limited)
    q = np.array([[0.3, -1.2]])
    assert limited.inverse_dynamics(q, q, q).tolist() == arm.inverse_dynamics(q, q, q).tolist()


# Efforts with rotors and viscous friction: against Pinocchio's own, formulas, and differences.


def motors_of(count):
    rng = np.random.default_rng(5)
    return {"armature": rng.uniform(0.1, 2, count), "viscous_friction": rng.uniform(1, 9, count)}


def test_rotors_are_pinocchios_armature_and_gravity_is_held_without_friction(ur5):
    motors = motors_of(6)
    model = pin.buildModelFromUrdf(str(ur5.urdf.path))
    assert tuple(list(model.names)[1:]) == ur5.joint_names
    model.armature = motors["armature"]
    data, (q, v, a) = model.createData(), random_trajectory(ur5, 30)
    rigid = [pin.rnea(model, data, *state).copy() for state in zip(q, v, a, strict=True)]
    expected = np.array(rigid) + motors["viscous_friction"] * v
    robot = with_motors(ur5, **motors, forwards_friction=3.0)
    close(robot.inverse_dynamics(q, v, a), expected, rtol=1e-12, atol=1e-10)
    close(robot.gravity_effort(q), ur5.gravity_effort(q), atol=1e-12)


def test_followers_have_no_motors(followers):
    """What the masters feel is their own rotors and friction, once: not once more per follower."""
    motors, (q, v, a) = motors_of(4), random_trajectory(followers, 30)
    expected = followers.inverse_dynamics(q, v, a)
    expected += motors["armature"] * a + motors["viscous_friction"] * v
    close(with_motors(followers, **motors).inverse_dynamics(q, v, a), expected, atol=1e-10)


@pytest.mark.parametrize("name", ["ur5", "followers"])
def test_derivatives_of_efforts_are_those_of_differences(request, name):
    plain, step = request.getfixturevalue(name), 1e-6
    robot = with_motors(plain, **motors_of(plain.joint_count))
    state = np.random.default_rng(4).uniform(-2, 2, (3, 5, plain.joint_count))
    for order, exact in enumerate(robot.inverse_dynamics_derivatives(*state)):
        for k in range(plain.joint_count):
            shift = np.zeros_like(state)
            shift[order, :, k] = step
            sides = [robot.inverse_dynamics(*(state + sign * shift)) for sign in (1, -1)]
            slope = (sides[0] - sides[1]) / (2 * step)
            close(exact[:, :, k], slope, rtol=1e-5, atol=1e-5)
