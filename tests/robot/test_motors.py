"""Motors of the planned joints: merged from layers, above what the URDF says of friction."""

import pickle

import numpy as np
import pytest

from tubeplanner import LimitLayer, LimitOverrides, MotorOverrides, RobotError, load_robot
from tubeplanner.robot.joint_motors import JointMotors, resolve_motors
from tubeplanner.robot.urdf import read_urdf

INF = np.inf


@pytest.fixture
def describe(tmp_path):
    """An arm of joints j and k, whose chain is k, j; f follows j at minus three times its speed."""

    def write(j="", k="", f=""):
        limit = '<limit lower="-1" upper="2" effort="10" velocity="3"/>'
        path = tmp_path / "arm.urdf"
        path.write_text(
            f"""<robot name="arm"><link name="a"/><link name="b"/><link name="c"/><link name="d"/>
            <joint name="k" type="revolute"><parent link="a"/><child link="b"/>{limit}{k}</joint>
            <joint name="j" type="revolute"><parent link="b"/><child link="c"/>{limit}{j}</joint>
            <joint name="f" type="revolute"><parent link="c"/><child link="d"/>{limit}{f}
            <mimic joint="j" multiplier="-3"/></joint></robot>"""
        )
        return read_urdf(path)

    return write


def resolved(description, *layers):
    return resolve_motors(description, ["j", "k"], layers)


def layer(limits=None, called="preset a: ", **motors):
    return LimitLayer(called, LimitOverrides(**(limits or {})), motors=MotorOverrides(**motors))


def test_motors_are_ideal_unless_they_are_given(describe):
    motors = resolved(describe('<dynamics damping="1" friction="2"/>'), LimitOverrides())
    ideal = JointMotors.ideal(2)
    for name in JointMotors.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(motors, name), getattr(ideal, name))
    assert not motors.has_friction
    assert not motors.has_curve.any()


def test_a_list_is_in_the_order_of_the_chain_and_the_motors_in_that_of_the_group(describe):
    motors = resolved(
        describe(),
        layer(
            armature=[1, 2],
            viscous_friction=[3, 4],
            coulomb_friction=[[5, 6], 7],
            saturation_effort=[8, 9],
            no_load_velocity=[10, 11],
            friction_uncertainty=0.25,
        ),
    )
    np.testing.assert_array_equal(motors.armature, [2, 1])
    np.testing.assert_array_equal(motors.viscous_friction, [4, 3])
    np.testing.assert_array_equal(motors.backwards_friction, [7, 5])
    np.testing.assert_array_equal(motors.forwards_friction, [7, 6])
    np.testing.assert_array_equal(motors.saturation_effort, [9, 8])
    np.testing.assert_array_equal(motors.no_load_velocity, [11, 10])
    assert motors.friction_uncertainty == 0.25


def test_the_later_layer_holds_joint_by_joint_and_quantity_by_quantity(describe):
    motors = resolved(
        describe(),
        layer(armature=1, coulomb_friction=[[1, 2], 3], friction_uncertainty=0.5),
        layer(armature={"k": 5}, viscous_friction=6, friction_uncertainty=0.0),
        layer(coulomb_friction={"j": [8, 9]}),
    )
    np.testing.assert_array_equal(motors.armature, [1, 5])
    np.testing.assert_array_equal(motors.viscous_friction, [6, 6])
    np.testing.assert_array_equal(motors.backwards_friction, [8, 1])
    np.testing.assert_array_equal(motors.forwards_friction, [9, 2])
    assert motors.friction_uncertainty == 0.0  # said again, above


def test_the_factor_on_the_effort_scales_the_stall_effort_alone(describe):
    line = layer(saturation_effort=20, no_load_velocity=5, coulomb_friction=2)
    scaled = LimitOverrides(scale={"effort": 0.5, "velocity": 0.1})
    motors = resolved(describe(), line, scaled)
    np.testing.assert_array_equal(motors.saturation_effort, [10, 10])
    np.testing.assert_array_equal(motors.no_load_velocity, [5, 5])
    np.testing.assert_array_equal(motors.forwards_friction, [2, 2])


# --- torque-speed lines ------------------------------------------------------------------------


def test_both_ends_of_a_line_may_come_from_different_layers(describe):
    motors = resolved(
        describe(), layer(saturation_effort={"k": 20}), layer(no_load_velocity=[5, INF])
    )
    np.testing.assert_array_equal(motors.has_curve, [False, True])
    np.testing.assert_array_equal(motors.no_load_velocity, [INF, 5])


def test_a_later_layer_takes_a_line_away(describe):
    without = {"saturation_effort": {"j": INF}, "no_load_velocity": {"j": INF}}
    line = layer(saturation_effort=20, no_load_velocity=5)
    np.testing.assert_array_equal(resolved(describe(), line, layer(**without)).has_curve, [0, 1])


@pytest.mark.parametrize(
    ("has", "lacks"),
    [("saturation_effort", "no_load_velocity"), ("no_load_velocity", "saturation_effort")],
)
def test_one_end_of_a_line_asks_for_the_other(describe, has, lacks):
    with pytest.raises(RobotError) as caught:
        resolved(describe(), layer(**{has: {"k": 7}}))
    assert str(caught.value) == (
        f"robot.motors: joint 'k' has {has} 7 and no {lacks}; a torque-speed line needs both: give "
        f"robot.motors.{lacks}, or .inf as {has}"
    )


# --- friction of the URDF ----------------------------------------------------------------------


def test_the_urdfs_friction_is_taken_where_none_is_given(describe):
    arm = describe('<dynamics damping="1" friction="2"/>', '<dynamics damping="3" friction="4"/>')
    motors = resolved(arm, layer(friction_from_urdf=True, viscous_friction={"j": 0}))
    np.testing.assert_array_equal(motors.viscous_friction, [0, 3])
    np.testing.assert_array_equal(motors.backwards_friction, [2, 4])
    np.testing.assert_array_equal(motors.forwards_friction, [2, 4])


def test_the_last_layer_that_says_so_decides(describe):
    arm = describe('<dynamics damping="1"/>')
    takes, leaves = layer(friction_from_urdf=True), layer(friction_from_urdf=False)
    assert resolved(arm, takes, layer()).has_viscous_friction
    assert not resolved(arm, takes, leaves, layer()).has_viscous_friction


def test_a_masters_friction_holds_that_of_its_followers(describe):
    """At -3 times the speed a follower's friction has three times the lever."""
    arm = describe('<dynamics damping="1" friction="2"/>', f='<dynamics damping="5" friction="7"/>')
    motors = resolved(arm, layer(friction_from_urdf=True))
    np.testing.assert_array_equal(motors.viscous_friction, [1 + 9 * 5, 0])
    np.testing.assert_array_equal(motors.forwards_friction, [2 + 3 * 7, 0])


@pytest.mark.parametrize(
    ("attribute", "text", "field"),
    [
        ("damping", "-1", "viscous_friction"),
        ("friction", "inf", "coulomb_friction"),
        ("damping", "much", "viscous_friction"),
        ("friction", "nan", "coulomb_friction"),
    ],
)
def test_a_urdfs_friction_that_is_none_is_named_once_it_is_taken(describe, attribute, text, field):
    arm = describe(k=f'<dynamics {attribute}="{text}"/>')
    assert not resolved(arm, layer()).has_friction
    with pytest.raises(RobotError) as caught:
        resolved(arm, layer(friction_from_urdf=True))
    assert str(caught.value) == (
        f"{arm.path}: joint 'k' has <dynamics {attribute}> {text}; it must be a number >= 0: mend "
        f"it, or leave robot.motors.friction_from_urdf out and give robot.motors.{field}"
    )


# --- refusals ----------------------------------------------------------------------------------


def test_an_unknown_joint_is_named_with_its_file(describe):
    with pytest.raises(RobotError) as caught:
        resolved(describe(), layer(armature={"joint": 1}))
    message = "preset a: motors.armature: unknown joint 'joint'; there is: j, k"
    assert str(caught.value) == message


def test_a_follower_has_no_motor(describe):
    with pytest.raises(RobotError) as caught:
        resolved(describe(), layer(called="robot.", armature={"f": 1}))
    assert str(caught.value) == (
        "robot.motors.armature: joint 'f' follows 'j' and has no motor of its own; give what 'j' "
        "feels of it, or leave it out"
    )


def test_a_layer_for_other_arms_is_refused_by_its_motors_alone():
    other = LimitLayer("preset a: ", LimitOverrides(), 3, motors=MotorOverrides(armature=1))
    with pytest.raises(RobotError, match=r"^preset a: limits and motors are for 3 joints; the "):
        load_robot("example:two_link", "hand", limits=other)


# --- a robot with motors -----------------------------------------------------------------------


def test_motors_given_to_a_robot_are_above_those_of_its_presets():
    preset = layer(armature=1, viscous_friction=2)
    robot = load_robot(
        "example:two_link", "hand", limits=preset, motors=MotorOverrides(armature={"joint2": 3})
    )
    np.testing.assert_array_equal(robot.motors.armature, [1, 3])
    np.testing.assert_array_equal(robot.motors.viscous_friction, [2, 2])


def test_what_are_no_motors_is_named():
    with pytest.raises(RobotError, match=r"^motors are \{'armature': 1\}; give MotorOverrides$"):
        load_robot("example:two_link", "hand", motors={"armature": 1})


def test_a_robot_takes_its_motors_along():
    motors = MotorOverrides(0.1, 0.2, [[1, 2], 3], 40, 5, friction_uncertainty=0.3)
    limits = LimitOverrides(effort={"joint1": [5, 6]})
    robot = load_robot("example:two_link", "hand", limits=limits, motors=motors)
    copied = pickle.loads(pickle.dumps(robot))
    for name in JointMotors.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(copied.motors, name), getattr(robot.motors, name))
    assert copied.limits.effort_ranges[0].forwards == [6]
    states = np.random.default_rng(0).uniform(-1, 1, (3, 4, 2))
    np.testing.assert_array_equal(copied.inverse_dynamics(*states), robot.inverse_dynamics(*states))


def test_efforts_hold_rotors_and_viscous_friction_and_no_coulomb_friction():
    ideal = load_robot("example:two_link", "hand")
    motors = MotorOverrides(armature=[1, 2], viscous_friction=[3, 4], coulomb_friction=50)
    robot = load_robot("example:two_link", "hand", motors=motors)
    q, v, a = np.random.default_rng(1).uniform(-1, 1, (3, 6, 2))
    wanted = ideal.inverse_dynamics(q, v, a) + np.array([1, 2]) * a + np.array([3, 4]) * v
    np.testing.assert_allclose(robot.inverse_dynamics(q, v, a), wanted, atol=1e-12)


def test_a_torque_speed_line_needs_masses(tmp_path):
    path = tmp_path / "arm.urdf"
    limit = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
    path.write_text(
        f"""<robot name="arm"><link name="a"/><link name="b"/><joint name="j" type="revolute">
        <parent link="a"/><child link="b"/>{limit}</joint></robot>"""
    )
    free = LimitOverrides(effort=INF)
    load_robot(path, "b", limits=free, motors=MotorOverrides(coulomb_friction=1))
    line = MotorOverrides(saturation_effort=5, no_load_velocity=2)
    with pytest.raises(RobotError, match="efforts need the links' <inertial>"):
        load_robot(path, "b", limits=free, motors=line)
