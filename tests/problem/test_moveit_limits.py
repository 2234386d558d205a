"""MoveIt's joint_limits.yaml: what is taken from it, and what is not."""

import json
from dataclasses import replace

import numpy as np
import pytest

from tubeplanner import PlanOptions, RobotError, parse_problem, plan, read_limits_file

# As the setup assistant writes it.
TEXT = """\
# joint_limits.yaml allows the dynamics properties specified in the URDF to be overwritten
default_velocity_scaling_factor: 0.1
default_acceleration_scaling_factor: 1.0
joint_limits:
  finger:
    has_velocity_limits: true
    max_velocity: 0.2
    has_acceleration_limits: false
    max_acceleration: 0
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
    has_acceleration_limits: false
    max_acceleration: 0
"""
PROBLEM = {
    "robot": {"urdf": "example:two_link", "tool_frame": "hand", "gravity": [0, 0, 0]},
    "tube": {"points": [[0.6, 0, 0], [0.4, 0.4, 0]], "radius": 0.1},
    "start": {"seed": [0, 1]},
}


def problem(folder, **robot):
    return parse_problem(PROBLEM | {"robot": PROBLEM["robot"] | robot}, folder)


def read(folder, joints, **others):
    path = folder / "joint_limits.yaml"
    path.write_text(json.dumps({"joint_limits": joints} | others))
    return read_limits_file(path)


def test_what_the_setup_assistant_writes_is_taken(tmp_path):
    (tmp_path / "joint_limits.yaml").write_text(TEXT)
    limits = problem(tmp_path, limits_file="joint_limits.yaml").robot.limits
    urdf = problem(tmp_path).robot.limits
    assert (limits.lower_position[0], limits.upper_position[0]) == (-1.5, 1.5)
    np.testing.assert_array_equal(limits.velocity, [2.5, urdf.velocity[1]])
    np.testing.assert_array_equal(limits.acceleration, [12.5, np.inf])
    np.testing.assert_array_equal(limits.jerk, [700, np.inf])
    np.testing.assert_array_equal(limits.effort, [40, urdf.effort[1]])


def test_it_is_found_in_a_package(tmp_path):
    config = tmp_path / "packages" / "arm_moveit_config" / "config"
    config.mkdir(parents=True)
    (config / "joint_limits.yaml").write_text(TEXT)
    limits = problem(
        tmp_path,
        limits_file="package://arm_moveit_config/config/joint_limits.yaml",
        package_dirs=["packages"],
    ).robot.limits
    assert limits.velocity[0] == 2.5


def test_a_value_without_its_switch_counts(tmp_path):
    layer = read(tmp_path, {"joint1": {"max_velocity": 2.0, "min_position": 0, "max_position": 1}})
    assert layer.limits.velocity == {"joint1": 2.0}
    assert layer.limits.position == {"joint1": (0, 1)}


@pytest.mark.parametrize(("given", "taken"), [(-5.0, 5.0), (5.0, 5.0), (20.0, 12.0)])
def test_of_acceleration_and_deceleration_the_smaller_one_counts(tmp_path, given, taken):
    fields = {"max_acceleration": 12.0, "has_deceleration_limits": True, "max_deceleration": given}
    assert read(tmp_path, {"joint1": fields}).limits.acceleration == {"joint1": taken}
    off = fields | {"has_deceleration_limits": False}
    assert read(tmp_path, {"joint1": off}).limits.acceleration == {"joint1": 12.0}


def test_the_factors_of_requests_are_no_limits_and_noted(tmp_path):
    (tmp_path / "joint_limits.yaml").write_text(TEXT)
    layer = read_limits_file(tmp_path / "joint_limits.yaml")
    assert layer.notes == (
        f"{tmp_path / 'joint_limits.yaml'}: default_velocity_scaling_factor 0.1 not used: what "
        "MoveIt asks by default is no limit; robot.limits.scale slows the robot down",
    )
    asked = replace(PlanOptions(), quality="fast")
    result = plan(problem(tmp_path, limits_file="joint_limits.yaml"), asked)
    assert result.succeeded
    assert result.notes[0] == layer.notes[0]
    assert read(tmp_path, {"joint1": {}}, default_velocity_scaling_factor=1).notes == ()


@pytest.mark.parametrize(
    ("joints", "message"),
    [
        (
            {"joint1": {"has_jerk_limits": True}},
            "joint_limits.joint1.max_jerk is required: has_jerk_limits is true",
        ),
        ({"joint1": {"min_position": 1}}, "joint_limits.joint1.max_position is required beside"),
        ({"joint1": {"max_position": 1}}, "joint_limits.joint1.min_position is required beside"),
        ({"joint1": {"max_velocity": 0}}, "limits.velocity: joint 'joint1' at 0; give a number f"),
        ({"joint1": {"max_velocity": "x"}}, "joint_limits.joint1.max_velocity is 'x'; it must be"),
        ({"joint1": {"max_velocty": 1}}, "joint_limits.joint1: unknown key 'max_velocty' (did you"),
        ({"joint1": 5}, "joint_limits.joint1 is 5; it must be a map"),
        (None, "joint_limits is empty; it must be a map"),
    ],
)
def test_a_fault_is_named(tmp_path, joints, message):
    with pytest.raises(RobotError) as caught:
        read(tmp_path, joints)
    assert str(caught.value).startswith(f"{tmp_path / 'joint_limits.yaml'}: {message}")


def test_a_file_of_another_robot_is_refused(tmp_path):
    read(tmp_path, {"elbow": {"max_velocity": 2.0}})
    with pytest.raises(RobotError) as caught:
        problem(tmp_path, limits_file="joint_limits.yaml")
    path = tmp_path / "joint_limits.yaml"
    assert str(caught.value) == (
        f"problem: {path}: limits name no joint of the planning group, which has: joint1, joint2; "
        "they name elbow"
    )


@pytest.mark.parametrize("text", ["[1]", "", "joints: {}"])
def test_a_file_without_joint_limits_is_refused(tmp_path, text):
    path = tmp_path / "joint_limits.yaml"
    path.write_text(text)
    with pytest.raises(RobotError, match=r"joint_limits|there is: joint_limits"):
        read_limits_file(path)


def test_a_missing_or_malformed_file_is_named(tmp_path):
    with pytest.raises(RobotError) as caught:
        problem(tmp_path, limits_file="none.yaml")
    path = tmp_path / "none.yaml"
    assert str(caught.value) == f"problem: robot.limits_file {path} does not exist"
    (tmp_path / "bad.yaml").write_text("joint_limits: [\n")
    with pytest.raises(RobotError, match=r"^file of limits .*bad\.yaml is malformed: line 1"):
        read_limits_file(tmp_path / "bad.yaml")
