"""Motors of the planned joints: merged from layers, above what the URDF says of friction."""

import numpy as np
import pytest
from arms import LIMIT, joint, link, links, loaded, written
from cases import refusal
from numpy.testing import assert_array_equal as same

from tubeplanner import LimitLayer, LimitOverrides, MotorOverrides, RobotError, load_robot
from tubeplanner.robot.motors import JointMotors, resolve_motors
from tubeplanner.robot.urdf import read_urdf

INF = np.inf


@pytest.fixture
def describe(tmp_path):
    """An arm of joints j and k, whose chain is k, j; f follows j at minus three times its speed."""

    def write(j="", k="", f=""):
        return read_urdf(
            written(
                tmp_path,
                links("a", "b", "c", "d"),
                joint("k", "a", "b", limit=LIMIT + k),
                joint("j", "b", "c", limit=LIMIT + j),
                joint("f", "c", "d", limit=f'{LIMIT}{f}<mimic joint="j" multiplier="-3"/>'),
            )
        )

    return write


def resolved(description, *layers):
    return resolve_motors(description, ["j", "k"], layers)


def layer(limits=None, label="preset a: ", **motors):
    return LimitLayer(label, LimitOverrides(**(limits or {})), motors=MotorOverrides(**motors))


def two_link(**options):
    return load_robot("example:two_link", "hand", **options)


def require_same(motors, others):
    for name in JointMotors.__dataclass_fields__:
        same(getattr(motors, name), getattr(others, name))


def test_motors_are_ideal_unless_they_are_given(describe):
    motors = resolved(describe('<dynamics damping="1" friction="2"/>'), LimitOverrides())
    require_same(motors, JointMotors.ideal(2))
    assert not motors.has_friction
    assert not motors.has_curve.any()


# Layers, and the motors of j and k that they become. A list is in the order of the chain: k, j.
LINE = layer(saturation_effort=20, no_load_velocity=5, coulomb_friction=2)
MERGED = {
    "lists go by the chain": (
        [
            layer(
                armature=[1, 2],
                viscous_friction=[3, 4],
                coulomb_friction=[[5, 6], 7],
                saturation_effort=[8, 9],
                no_load_velocity=[10, 11],
                friction_uncertainty=0.25,
            )
        ],
        {"armature": [2, 1], "viscous_friction": [4, 3]}
        | {"backwards_friction": [7, 5], "forwards_friction": [7, 6]}
        | {"saturation_effort": [9, 8], "no_load_velocity": [11, 10], "friction_uncertainty": 0.25},
    ),
    "the later layer holds joint by joint": (
        [
            layer(armature=1, coulomb_friction=[[1, 2], 3], friction_uncertainty=0.5),
            layer(armature={"k": 5}, viscous_friction=6, friction_uncertainty=0.0),
            layer(coulomb_friction={"j": [8, 9]}),
        ],
        {"armature": [1, 5], "viscous_friction": [6, 6], "friction_uncertainty": 0.0}
        | {"backwards_friction": [8, 1], "forwards_friction": [9, 2]},
    ),
    "the scale of the effort scales the stall effort alone": (
        [LINE, LimitOverrides(scale={"effort": 0.5, "velocity": 0.1})],
        {"saturation_effort": [10, 10], "no_load_velocity": [5, 5], "forwards_friction": [2, 2]},
    ),
    "both ends of a torque-speed line may come from different layers": (
        [layer(saturation_effort={"k": 20}), layer(no_load_velocity=[5, INF])],
        {"has_curve": [False, True], "no_load_velocity": [INF, 5]},
    ),
    "a later layer takes a line away": (
        [LINE, layer(saturation_effort={"j": INF}, no_load_velocity={"j": INF})],
        {"has_curve": [False, True]},
    ),
}


@pytest.mark.parametrize(("layers", "expected"), MERGED.values(), ids=MERGED)
def test_motors_of_layers(describe, layers, expected):
    motors = resolved(describe(), *layers)
    for name, values in expected.items():
        same(getattr(motors, name), values, err_msg=name)


def test_the_urdfs_friction_is_taken_where_none_is_given(describe):
    arm = describe('<dynamics damping="1" friction="2"/>', '<dynamics damping="3" friction="4"/>')
    motors = resolved(arm, layer(friction_from_urdf=True, viscous_friction={"j": 0}))
    same(motors.viscous_friction, [0, 3])
    same(motors.backwards_friction, [2, 4])
    same(motors.forwards_friction, [2, 4])


def test_the_last_layer_that_says_whether_to_take_it_decides(describe):
    arm = describe('<dynamics damping="1"/>')
    takes, leaves = layer(friction_from_urdf=True), layer(friction_from_urdf=False)
    assert resolved(arm, takes, layer()).has_viscous_friction
    assert not resolved(arm, takes, leaves, layer()).has_viscous_friction


def test_a_masters_friction_holds_that_of_its_followers(describe):
    """At -3 times the speed a follower's friction has three times the lever."""
    arm = describe('<dynamics damping="1" friction="2"/>', f='<dynamics damping="5" friction="7"/>')
    motors = resolved(arm, layer(friction_from_urdf=True))
    same(motors.viscous_friction, [1 + 9 * 5, 0])
    same(motors.forwards_friction, [2 + 3 * 7, 0])


@pytest.mark.parametrize(
    ("attribute", "text", "field"),
    [
        ("damping", "-1", "viscous_friction"),
        ("friction", "inf", "coulomb_friction"),
    ],
)
def test_a_urdfs_friction_that_is_none_is_named_once_it_is_taken(describe, attribute, text, field):
    arm = describe(k=f'<dynamics {attribute}="{text}"/>')
    assert not resolved(arm, layer()).has_friction
    assert refusal(RobotError, resolved, arm, layer(friction_from_urdf=True)) == (
        f"{arm.path}: joint 'k' has <dynamics {attribute}> {text}; it must be a number >= 0: mend "
        f"it, or leave robot.motors.friction_from_urdf out and give robot.motors.{field}"
    )


AMOUNT = "give a number from 0 to 1e+09"
LINE = "give a number from 1e-06 to 1e+09, or .inf where there is no torque-speed line"
FRACTION = "give a fraction from 0, below 1"


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"armature": -0.1}, f"armature is -0.1; {AMOUNT}"),
        ({"armature": {"j": np.nan}}, f"armature: joint 'j' at nan; {AMOUNT}"),
        ({"viscous_friction": {"j": 2e9}}, f"viscous_friction: joint 'j' at 2e+09; {AMOUNT}"),
        ({"saturation_effort": 0}, f"saturation_effort is 0; {LINE}"),
        ({"friction_from_urdf": 1}, "friction_from_urdf is 1; it must be true or false"),
        (
            {"armature": "a"},
            "armature is 'a'; it must be one number for all joints, a list with one for each, or "
            "a map by name, such as {'elbow_joint': 1.5}",
        ),
        *(
            (
                {"coulomb_friction": {"j": value}},
                f"coulomb_friction: joint 'j' at {value!r}; {AMOUNT}, or [backwards, forwards] of "
                "such",
            )
            for value in (-1, [1, -1], [1], "12")
        ),
        *(
            ({"friction_uncertainty": value}, f"friction_uncertainty is {shown}; {FRACTION}")
            for value, shown in ((-0.1, "-0.1"), (1.0, "1"), (np.nan, "nan"), (True, "True"))
        ),
    ],
)
def test_a_senseless_motor_is_refused_at_once(given, message):
    assert refusal(RobotError, MotorOverrides, **given) == f"robot.motors.{message}"


def test_bounds_of_motors_themselves_are_allowed():
    friction = {"viscous_friction": 1e9, "coulomb_friction": [[0, 1e9], (0, 0), np.zeros(2)]}
    line = {"saturation_effort": [1e-6, INF], "no_load_velocity": {"j": 1e9}}
    MotorOverrides(armature=0, **friction, **line, friction_uncertainty=0)


def lone_end(has, lacks):
    message = (
        f"robot.motors: joint 'k' has {has} 7 and no {lacks}; a torque-speed line needs both: give "
        f"robot.motors.{lacks}, or .inf as {has}"
    )
    return {has: {"k": 7}}, message


@pytest.mark.parametrize(
    ("given", "message"),
    [
        lone_end("saturation_effort", "no_load_velocity"),
        lone_end("no_load_velocity", "saturation_effort"),
        (
            {"armature": {"joint": 1}},
            "preset a: motors.armature: unknown joint 'joint'; there is: j, k",
        ),
        (
            {"label": "robot.", "armature": {"f": 1}},
            "robot.motors.armature: joint 'f' follows 'j' and has no motor of its own; give what "
            "'j' feels of it, or leave it out",
        ),
    ],
)
def test_motors_that_the_arm_cannot_have_are_refused(describe, given, message):
    assert refusal(RobotError, resolved, describe(), layer(**given)) == message


def test_motors_of_other_arms_and_what_are_none_are_refused():
    other = LimitLayer("preset a: ", LimitOverrides(), 3, motors=MotorOverrides(armature=1))
    message = refusal(RobotError, two_link, limits=other)
    assert message.startswith("preset a: limits and motors are for 3 joints; the ")
    message = refusal(RobotError, two_link, motors={"armature": 1})
    assert message == "motors are {'armature': 1}; give MotorOverrides"


def test_motors_given_to_a_robot_are_above_those_of_its_presets():
    own = MotorOverrides(armature={"joint2": 3})
    robot = two_link(limits=layer(armature=1, viscous_friction=2), motors=own)
    same(robot.motors.armature, [1, 3])
    same(robot.motors.viscous_friction, [2, 2])


def test_a_torque_speed_line_needs_masses(tmp_path):
    def load(**motors):
        parts = link("a", ""), link("tip", ""), joint("j", "a", "tip")
        free = LimitOverrides(effort=INF)
        return loaded(tmp_path, *parts, limits=free, motors=MotorOverrides(**motors))

    load(coulomb_friction=1)
    message = refusal(RobotError, load, saturation_effort=5, no_load_velocity=2)
    assert "efforts need the links' <inertial>" in message
