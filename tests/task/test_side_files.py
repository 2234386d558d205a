"""Limit files: bundled presets, MoveIt's joint_limits.yaml."""

import json
from dataclasses import replace

import numpy as np
import pytest
from cases import refusal
from ruamel.yaml import YAML

from tubeplanner import (
    LimitOverrides,
    PlanOptions,
    RobotError,
    Robustness,
    load_robot,
    parse_problem,
    plan,
    read_limits_file,
    read_preset,
    read_robustness,
)
from tubeplanner.resources import bundled_presets, bundled_problems
from tubeplanner.task.side_files import fitting_presets

SOURCES = {"limits.velocity": "sheet", "limits.jerk": "controller", "limits.tool_speed": "cell"}
PRESET = {
    "format": "tubeplanner/preset",
    "joints": 2,
    "limits": {"velocity": [2, 3], "jerk": 500, "tool_speed": 1.5},
    "sources": SOURCES,
}
PROBLEM = {
    "robot": {"urdf": "example:two_link", "tool_frame": "hand", "gravity": [0, 0, 0]},
    "tube": {"points": [[0.6, 0, 0], [0.4, 0.4, 0]], "radius": 0.1},
    "start": {"seed": [0, 1]},
}


def write(folder, name="mine.yaml", **changes):
    (folder / name).write_text(json.dumps(PRESET | changes))


def problem(folder, **robot):
    return parse_problem(PROBLEM | {"robot": PROBLEM["robot"] | robot}, folder)


def with_layers(robot, *layers):
    name, frame = {"panda": ("panda", "panda_hand_tcp"), "ur10": ("ur10", "tool0")}[robot]
    return load_robot(f"example:{name}", frame, limits=layers)


def test_a_panda_has_the_limits_of_its_documentation(panda):
    limits = with_layers("panda", read_preset("fer")).limits
    np.testing.assert_array_equal(limits.velocity, [2.175] * 4 + [2.61] * 3)
    np.testing.assert_array_equal(limits.acceleration, [15, 7.5, 10, 12.5, 15, 20, 20])
    np.testing.assert_array_equal(limits.jerk, [7500, 3750, 5000, 6250, 7500, 10000, 10000])
    np.testing.assert_array_equal(limits.effort, [87] * 4 + [12] * 3)
    assert (limits.tool_speed, limits.velocity_by_position) == (1.7, ())
    np.testing.assert_array_equal(limits.lower_position, panda.limits.lower_position)


def test_an_fr3_slows_down_towards_the_ends_of_its_joints():
    limits = with_layers("panda", read_preset("fr3")).limits
    np.testing.assert_array_equal(limits.velocity, [2.62] * 4 + [5.26, 4.18, 5.26])
    laws = limits.velocity_by_position
    assert [law.joint for law in laws] == [*range(7)]
    # libfranka's rate_limiting.h: min(2.62, max(0, -0.20 + sqrt(max(0, 5.17 (1.79180 - q)))))
    assert (2 * laws[1].deceleration, laws[1].offset, laws[1].upper) == (5.17, 0.20, 1.79180)
    assert (laws[3].lower, laws[5].lower) == (-3.0481, 0.54092)
    np.testing.assert_array_equal([law.lower for law in laws], limits.lower_position)
    np.testing.assert_array_equal([law.upper for law in laws], limits.upper_position)
    # A smaller range leaves the laws as they are.
    narrow = LimitOverrides(position={"panda_joint1": (-0.5, 0.5)})
    limits = with_layers("panda", read_preset("fr3"), narrow).limits
    assert limits.upper_position[0] == 0.5
    assert limits.velocity_by_position[0].upper == 2.7501


def test_an_fr3_has_rotors_and_on_request_friction():
    motors = with_layers("panda", read_preset("fr3")).motors
    np.testing.assert_array_equal(motors.armature, [0.195] * 4 + [0.074] * 3)
    assert not motors.has_friction
    robot = with_layers("panda", read_preset("fr3"), read_preset("fr3_friction"))
    np.testing.assert_array_equal(robot.motors.armature, motors.armature)
    np.testing.assert_array_equal(robot.motors.viscous_friction, [0.21] * 7)
    coulomb = [1.137] * 4 + [0.763, 0.44, 0.248]
    np.testing.assert_array_equal(robot.motors.backwards_friction, coulomb)
    assert robot.limits.tool_speed == 3.0


def test_friction_takes_a_ur10_a_quarter_of_its_efforts_at_full_speed():
    robot = with_layers("ur10", read_preset("ur10_friction"))
    motors, limits = robot.motors, robot.limits
    loss = motors.viscous_friction * limits.velocity + motors.forwards_friction
    fractions = [0.13, 0.13, 0.23, 0.27, 0.22, 0.24]
    np.testing.assert_allclose(loss / limits.effort, fractions, atol=0.01)
    np.testing.assert_array_equal(motors.backwards_friction, [13.7, 20.7, 9.2, 2.0, 2.3, 2.9])


@pytest.mark.parametrize("name", bundled_presets())
def test_every_number_of_a_bundled_preset_has_a_source_with_a_version(name):
    fields = YAML(typ="safe", pure=True).load(bundled_presets()[name].read_text())
    quantities = {
        f"{section}.{quantity}"
        for section in ("limits", "motors", "robustness")
        for quantity in fields.get(section, ())
    }
    assert set(fields["sources"]) == quantities
    assert all(any(c.isdigit() for c in source) for source in fields["sources"].values())
    assert f"presets/{name}" not in bundled_problems()


def test_a_controller_is_below_the_fields_of_the_problem(tmp_path):
    def errors(**fields):
        return parse_problem(PROBLEM | {"robustness": fields}, tmp_path).robustness

    franka = errors(preset="franka_controller")
    expected = Robustness(controller="pd", control_period=0.001, velocity_tolerance=0.0)
    assert franka == expected
    assert errors(preset="ros2_controller").path_tolerance is None
    own = errors(preset="ur_controller", control_period=0.008, mass=0.0)
    assert own == replace(errors(preset="ur_controller"), control_period=0.008, mass=0.0)
    assert (own.controller, own.path_tolerance) == ("feedforward-pd", 0.2)
    assert read_robustness("franka_controller")["controller"] == "pd"
    for read, name, message in (
        (read_robustness, "fr3", "preset fr3 holds no robustness: name it in robot.preset"),
        (read_preset, "ur_controller", "preset ur_controller holds robustness alone: name it in"),
    ):
        assert refusal(RobotError, read, name).startswith(message)


def test_a_preset_is_found_beside_the_problem_and_the_problem_wins(tmp_path):
    (tmp_path / "limits").mkdir()
    write(tmp_path / "limits", "arm.yaml")
    own = {"velocity": {"joint2": 1}, "jerk": 900}
    limits = problem(tmp_path, preset="limits/arm.yaml", limits=own).robot.limits
    np.testing.assert_array_equal(limits.velocity, [2, 1])
    np.testing.assert_array_equal(limits.jerk, [900, 900])
    assert limits.tool_speed == 1.5


def test_a_preset_may_have_motors_alone_and_the_problem_wins(tmp_path):
    sources = {"motors.armature": "data sheet", "motors.coulomb_friction": "identified"}
    motors = {"armature": 2, "coulomb_friction": [[1, 2], 3]}
    write(tmp_path, limits={}, motors=motors, sources=sources)
    fields = {"motors": {"armature": {"joint2": 5}}, "limits": {"scale": {"effort": 0.5}}}
    motors = problem(tmp_path, preset="mine.yaml", **fields).robot.motors
    np.testing.assert_array_equal(motors.armature, [2, 5])
    np.testing.assert_array_equal(motors.backwards_friction, [1, 3])
    np.testing.assert_array_equal(motors.forwards_friction, [2, 3])


def test_of_several_presets_the_later_one_wins(tmp_path):
    write(tmp_path, "a.yaml")
    write(tmp_path, "b.json", limits={"jerk": 700}, sources={"limits.jerk": "cell"})
    limits = problem(tmp_path, preset=["a.yaml", "b.json"]).robot.limits
    np.testing.assert_array_equal(limits.jerk, [700, 700])
    np.testing.assert_array_equal(limits.velocity, [2, 3])


def test_the_file_of_limits_is_below_the_preset_and_above_the_urdf(tmp_path):
    write(tmp_path, "a.yaml")
    read(tmp_path, {"joint1": {"max_velocity": 9, "max_effort": 9}})
    limits = problem(tmp_path, preset="a.yaml", limits_file="joint_limits.yaml").robot.limits
    np.testing.assert_array_equal(limits.velocity, [2, 3])
    assert limits.effort[0] == 9
    assert limits.effort[1] == problem(tmp_path).robot.limits.effort[1]


def test_another_number_of_joints_is_refused_by_name(tmp_path):
    assert refusal(RobotError, problem, tmp_path, preset="fer") == (
        "problem: preset fer: limits and motors are for 7 joints; the planning group has 2: "
        "joint1, joint2"
    )


SOURCE = "is required: say where it is from"
NEGATIVE = {"motors": {"armature": -1}, "sources": SOURCES | {"motors.armature": "a"}}
ARMATURE = {"motors": {"armature": 1}}
JOINTLESS = {"joints": None, "limits": {"effort": 1}, "sources": {"limits.effort": "a"}}
OF_PRESET = {"robustness": {"preset": "fer"}, "sources": SOURCES | {"robustness.preset": "a"}}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"motor": {}}, "top level: unknown key 'motor' (did you mean 'motors'?); there is: form"),
        ({"joints": 0}, "joints is 0; it must be greater than or equal to 1"),
        ({"limits": {"jerks": 1}}, "limits: unknown key 'jerks' (did you mean 'jerk'?); there is"),
        ({"limits": {"jerk": 0}, "sources": {"limits.jerk": "a"}}, "limits.jerk is 0; give a num"),
        (
            {"limits": {"scale": {"effort": 0.5}}, "sources": {"limits.scale": "a"}},
            "limits.scale belongs into robot.limits of a problem",
        ),
        ({"limits": {}, "sources": {}}, "limits, motors or robustness is required"),
        (JOINTLESS, "joints is required beside limits.effort"),
        (OF_PRESET, "robustness.preset belongs into a problem"),
        (NEGATIVE, "motors.armature is -1; give a number from 0 to 1e+09"),
        (ARMATURE, f"sources.'motors.armature' {SOURCE}"),
        ({"sources": SOURCES | {"limits.jerk": " "}}, f"sources.'limits.jerk' {SOURCE}"),
        ({"sources": SOURCES | {"limits.position": "x"}}, "sources: unknown field 'limits.positio"),
    ],
)
def test_a_fault_of_a_preset_is_named(tmp_path, changes, message):
    write(tmp_path, **changes)
    path = tmp_path / "mine.yaml"
    assert refusal(RobotError, read_preset, path).startswith(f"preset {path}: {message}")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[1, 2]", "a preset is a map with format, joints and limits or motor"),
        ("limits: [1\n", r"^preset mine\.yaml: file .* is malformed: line 1"),
    ],
)
def test_a_file_that_is_no_map_is_refused(tmp_path, text, message):
    (tmp_path / "mine.yaml").write_text(text)
    with pytest.raises(RobotError, match=message):
        read_preset("mine.yaml", tmp_path)


def test_a_wrong_name_or_a_missing_file_lists_those_that_exist(tmp_path):
    unknown = "unknown preset 'fr4' (did you mean 'fr3'?); there is: fer, fr3, fr3_friction, fran"
    assert refusal(RobotError, read_preset, "fr4").startswith(unknown)
    bundled = f"bundled are {', '.join(bundled_presets())}"
    message = refusal(RobotError, read_preset, "none.yaml", tmp_path)
    assert message == f"preset {tmp_path / 'none.yaml'} does not exist; {bundled}"


def test_the_panda_has_one_and_other_arms_have_none(panda, ur5):
    assert fitting_presets(panda) == ["fer"]
    assert fitting_presets(ur5) == []
    assert fitting_presets(load_robot("example:xarm7", "link7")) == []  # seven joints as well


def test_the_whole_group_counts_and_its_order_does_not_matter(panda):
    backwards, less = panda.joint_names[::-1], panda.joint_names[:6]
    for joints, presets in ((backwards, ["fer"]), (less, [])):
        robot = load_robot("example:panda", "panda_hand_tcp", joints=joints)
        assert fitting_presets(robot) == presets


@pytest.mark.parametrize(
    ("old", "new"), [("2.175", "2.1"), ("87.0", "80.0"), ('effort="87.0" ', "")]
)
def test_another_or_no_velocity_or_effort_is_another_arm(panda, tmp_path, old, new):
    text = panda.urdf.path.read_text()
    assert old in text
    (tmp_path / "other.urdf").write_text(text.replace(old, new, 1))
    limits = LimitOverrides(effort={} if new else {"panda_joint1": 87.0})
    robot = load_robot(tmp_path / "other.urdf", "panda_hand_tcp", limits=limits)
    assert fitting_presets(robot) == []


# As the setup assistant writes it.
TEXT = """\
default_velocity_scaling_factor: 0.1
default_acceleration_scaling_factor: 1.0
joint_limits:
  finger:
    has_velocity_limits: true
    max_velocity: 0.2
  joint1:
    has_position_limits: true
    min_position: -1.5
    max_position: 1.5
    has_velocity_limits: true
    max_velocity: 2.5
    has_acceleration_limits: true
    max_acceleration: 12.5
    has_jerk_limits: true
    max_jerk: 700.0
    has_effort_limits: true
    max_effort: 40
  joint2:
    has_velocity_limits: false
    max_velocity: 100
"""


def read(folder, joints, **others):
    path = folder / "joint_limits.yaml"
    path.write_text(json.dumps({"joint_limits": joints} | others))
    return read_limits_file(path)


def test_the_file_of_the_setup_assistant_is_taken_also_from_a_package(tmp_path):
    config = tmp_path / "packages" / "arm_moveit_config" / "config"
    config.mkdir(parents=True)
    (config / "joint_limits.yaml").write_text(TEXT)
    file = "package://arm_moveit_config/config/joint_limits.yaml"
    limits = problem(tmp_path, limits_file=file, package_dirs=["packages"]).robot.limits
    urdf = problem(tmp_path).robot.limits
    assert (limits.lower_position[0], limits.upper_position[0]) == (-1.5, 1.5)
    np.testing.assert_array_equal(limits.velocity, [2.5, urdf.velocity[1]])
    np.testing.assert_array_equal(limits.acceleration, [12.5, np.inf])
    np.testing.assert_array_equal(limits.jerk, [700, np.inf])
    np.testing.assert_array_equal(limits.effort, [40, urdf.effort[1]])


def test_a_value_without_its_switch_counts(tmp_path):
    layer = read(tmp_path, {"joint1": {"max_velocity": 2.0, "min_position": 0, "max_position": 1}})
    assert layer.limits.velocity == {"joint1": 2.0}
    assert layer.limits.position == {"joint1": (0, 1)}


@pytest.mark.parametrize(("deceleration", "limit"), [(-5.0, 5.0), (5.0, 5.0), (20.0, 12.0)])
def test_of_acceleration_and_deceleration_the_smaller_one_counts(tmp_path, deceleration, limit):
    fields = {"max_acceleration": 12.0, "max_deceleration": deceleration}
    for switch, value in ((True, limit), (False, 12.0)):
        layer = read(tmp_path, {"joint1": fields | {"has_deceleration_limits": switch}})
        assert layer.limits.acceleration == {"joint1": value}


def test_the_factors_of_requests_are_no_limits_and_noted(tmp_path):
    (tmp_path / "joint_limits.yaml").write_text(TEXT)
    layer = read_limits_file(tmp_path / "joint_limits.yaml")
    assert layer.notes == (
        f"{tmp_path / 'joint_limits.yaml'}: default_velocity_scaling_factor 0.1 not used: what "
        "MoveIt asks by default is no limit; robot.limits.scale slows the robot down",
    )
    fast = PlanOptions(quality="fast")
    result = plan(problem(tmp_path, limits_file="joint_limits.yaml"), fast)
    assert result.succeeded
    assert result.notes[0] == layer.notes[0]
    assert read(tmp_path, {"joint1": {}}, default_velocity_scaling_factor=1).notes == ()


def test_keys_of_others_are_noted_and_limits_of_ros2_control_lie_deeper(tmp_path):
    joint = {"max_velocity": 2.0, "has_jerk": False, "has_soft_limits": True, "k_position": 9}
    others = {"cartesian_limits": {"max_trans_vel": 1}}
    layer = read(tmp_path, {"joint1": joint, "joint2": {"k_position": 9}}, **others)
    assert layer.limits.velocity == {"joint1": 2.0}
    unused = (
        "cartesian_limits, has_jerk (joint1), has_soft_limits (joint1), k_position (joint1, joi"
    )
    (note,) = layer.notes
    assert f": keys that are no limits here, and are not used: {unused}" in note
    path = tmp_path / "controllers.yaml"
    nested = {"controller_manager": {"ros__parameters": {"joint_limits": {"joint1": joint}}}}
    path.write_text(json.dumps(nested))
    assert read_limits_file(path).limits == layer.limits


JOINT = "joint_limits.joint1"


@pytest.mark.parametrize(
    ("joints", "message"),
    [
        ({"joint1": {"has_jerk_limits": True}}, f"{JOINT}.max_jerk is required: has_jerk_limit"),
        ({"joint1": {"min_position": 1}}, f"{JOINT}.max_position is required beside"),
        ({"joint1": {"max_velocity": 0}}, "limits.velocity: joint 'joint1' at 0; give a number f"),
        ({"joint1": {"max_velocty": 1}}, f"{JOINT}: unknown key 'max_velocty' (did you"),
        ({"joint1": 5}, f"{JOINT} is 5; it must be a map"),
        (None, "joint_limits is empty; it must be a map"),
    ],
)
def test_a_fault_of_moveits_limits_is_named(tmp_path, joints, message):
    path = tmp_path / "joint_limits.yaml"
    assert refusal(RobotError, read, tmp_path, joints).startswith(f"{path}: {message}")


@pytest.mark.parametrize("text", ["[1]", "", "joints: {}"])
def test_a_file_without_joint_limits_is_refused(tmp_path, text):
    path = tmp_path / "joint_limits.yaml"
    path.write_text(text)
    with pytest.raises(RobotError, match=r"joint_limits|there is: joint_limits"):
        read_limits_file(path)


def test_a_missing_a_malformed_or_another_robots_file_is_named(tmp_path):
    message = refusal(RobotError, problem, tmp_path, limits_file="none.yaml")
    assert message == f"problem: robot.limits_file {tmp_path / 'none.yaml'} does not exist"
    (tmp_path / "bad.yaml").write_text("joint_limits: [\n")
    with pytest.raises(RobotError, match=r"^file of limits .*bad\.yaml is malformed: line 1"):
        read_limits_file(tmp_path / "bad.yaml")
    read(tmp_path, {"elbow": {"max_velocity": 2.0}})
    message = refusal(RobotError, problem, tmp_path, limits_file="joint_limits.yaml")
    assert message.endswith("which has: joint1, joint2; they name elbow")
