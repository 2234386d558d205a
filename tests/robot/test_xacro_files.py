"""Macro files: expanded as xacro does, without ROS; what is wrong is said with xacro's reason."""

import builtins
import os
import sys

import pytest
from cases import SLIDE, refusal

from tubeplanner import load_robot
from tubeplanner.errors import RobotError
from tubeplanner.output.files.fingerprint import robot_hash
from tubeplanner.robot import ros_files as xacro_file
from tubeplanner.robot.ros_files import expanded
from tubeplanner.robot.urdf import read_urdf

HEAD = '<robot name="slide" xmlns:xacro="http://www.ros.org/wiki/xacro">'
BODY = SLIDE.removeprefix('<robot name="slide">').removesuffix("</robot>")
ARGUMENTS = '<xacro:arg name="effort" default="60"/><xacro:arg name="far" default="false"/>'
ARM = ARGUMENTS + BODY.replace('effort="60"', 'effort="$(arg effort)"')
JOINTS = ["turn", "extend", "lift"]


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Return a function that writes what a macro file holds; no ROS is set up."""
    for variable in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"):
        monkeypatch.delenv(variable, raising=False)

    def write(inner, name="arm.urdf.xacro"):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"{HEAD}{inner}</robot>")
        return path

    return write


def test_a_macro_file_is_the_robot_that_it_stands_for(write):
    plain, macro = write(BODY, "arm.urdf"), write(ARM)
    assert robot_hash(load_robot(macro, "tip")) == robot_hash(load_robot(plain, "tip"))
    strong = load_robot(macro, "tip", xacro_args={"effort": 70})
    assert strong.limits.effort.tolist() == [70, 80, 20]
    assert robot_hash(strong) != robot_hash(load_robot(plain, "tip"))


def test_an_argument_without_a_value_is_asked_for_and_macros_alone_are_no_robot(write):
    late = '<xacro:arg name="side" default="l"/><xacro:arg name="far" default="1"/>'
    path = write(f'<a b="$(arg side)"/>{late}')
    message = refusal(RobotError, read_urdf, path)
    assert "give it in robot.xacro_args or by --xacro-arg (its <xacro:arg>: side, far)" in message
    macros = write('<xacro:macro name="arm"><link name="a"/></xacro:macro>')
    message = refusal(RobotError, read_urdf, macros)
    assert message.endswith("holds no <link>, only macros: take the file that calls them")


def test_truth_values_are_written_as_xacro_reads_them(write):
    path = write(ARGUMENTS + '<xacro:if value="$(arg far)"><far/></xacro:if>')
    assert b"<far/>" in expanded(path, {"far": True}, ())
    assert b"<far/>" not in expanded(path, {"far": False}, ())


def test_includes_are_relative_to_the_file_that_names_them(write):
    write('<xacro:include filename="body.xacro"/>', "parts/all.xacro")
    write(BODY, "parts/body.xacro")
    path = write('<xacro:include filename="parts/all.xacro"/>')
    assert read_urdf(path).movable() == JOINTS


@pytest.mark.parametrize("found", ["package_dirs", "map", "ROS_PACKAGE_PATH", "above"])
def test_packages_are_found_without_ros(write, tmp_path, monkeypatch, found):
    write(BODY, "src/slide_description/body.xacro")
    include = '<xacro:include filename="$(find slide_description)/body.xacro"/>'
    path = write(include, "src/arm.xacro" if found == "above" else "cell/arm.xacro")
    if found == "ROS_PACKAGE_PATH":
        monkeypatch.setenv(found, str(tmp_path / "src"))
    named = ("slide_description", tmp_path / "src" / "slide_description")
    folders = {"package_dirs": (tmp_path / "src",), "map": (named,)}.get(found, ())
    assert read_urdf(path, package_dirs=folders).movable() == JOINTS
    assert "ament_index_python" not in sys.modules


def test_ros_own_index_is_back_afterwards_and_warnings_are_not_printed(
    write, tmp_path, monkeypatch, capfd
):
    (tmp_path / "sizes.yaml").write_text("length: 1")
    monkeypatch.setitem(sys.modules, "ament_index_python", sys)
    path = write("<a b=\"${load_yaml('sizes.yaml')['length']}\"/>")
    assert b'b="1"' in expanded(path, {}, ())
    assert sys.modules["ament_index_python"] is sys
    assert capfd.readouterr() == ("", "")


FAULTS = {
    '<a b="${size}"/>': "name 'size' is not defined",
    '<xacro:include filename="no.xacro"/>': "No such file or directory: ",
    "<xacro:wheel/>": "unknown macro name: xacro:wheel",
    '<a b="$(find nobody)"/>': "package 'nobody' was not found; folders tried",
    "<a>": "mismatched tag: line 1",
    '<xacro:include filename="arm.urdf.xacro"/>': "without end",
}


@pytest.mark.parametrize("inner", FAULTS)
def test_what_cannot_be_expanded_is_said_with_its_reason(write, inner):
    path = write(inner)
    message = refusal(RobotError, read_urdf, path)
    assert message.startswith(f"{path}: xacro cannot expand it: ")
    assert FAULTS[inner] in message
    assert "\n" not in message


def test_the_included_file_that_is_wrong_is_named(write):
    part = write('<a b="${size}"/>', "part.xacro")
    path = write('<xacro:include filename="part.xacro"/>')
    assert refusal(RobotError, read_urdf, path).endswith(f"(in {part})")


@pytest.mark.parametrize(
    ("name", "arguments", "message"),
    [
        ("arm.xacro", {"efort": 1}, "unknown argument 'efort' (did you mean 'effort'?)"),
        ("arm.urdf", {"effort": 1}, "robot.xacro_args are for a file that ends in .xacro"),
    ],
)
def test_arguments_that_the_file_does_not_take_are_refused(write, name, arguments, message):
    assert message in refusal(RobotError, read_urdf, write(ARM, name), arguments)


def test_without_xacro_the_remedy_is_named(write, monkeypatch):
    real = builtins.__import__

    def without(name, *rest, **more):
        if name == "xacro":
            raise ImportError(name)
        return real(name, *rest, **more)

    path = write(ARM)
    monkeypatch.setattr(builtins, "__import__", without)
    message = refusal(RobotError, read_urdf, path)
    assert "takes xacro, which is not installed: pip install" in message


@pytest.mark.parametrize(
    ("value", "limit", "message"),
    [
        ("10**10**10", ("_TIME_LIMIT", 0.2), "xacro cannot expand it within 0.2 s; simplify it"),
        ("'a' * 10**11", ("_TIME_LIMIT", 60), "xacro cannot expand it: it takes more than 1 GB"),
        ("'a' * 20000", ("_MAX_BYTES", 10_000), "what it stands for is larger than 0.01 MB"),
        ("1", ("_PROGRAM", "{path!r}"), "xacro ended without an answer; simplify it"),
    ],
    ids=["time", "memory", "size", "answer"],
)
def test_a_file_that_takes_all_time_or_memory_is_refused(write, monkeypatch, value, limit, message):
    monkeypatch.setattr(xacro_file, *limit)
    assert message in refusal(RobotError, expanded, write(f'<a b="${{{value}}}"/>'), {}, ())


def test_a_pipe_is_refused_without_waiting(tmp_path):
    os.mkfifo(tmp_path / "arm.xacro")
    message = refusal(RobotError, expanded, tmp_path / "arm.xacro", {}, ())
    assert "cannot be read: it is no regular file" in message


@pytest.mark.parametrize(
    ("expression", "name"),
    [
        ("(lambda: ().__class__.__base__.__subclasses__())()", "__class__"),
        ("[x.gi_frame.f_back for x in [(y for y in [1])]]", "gi_frame"),
    ],
)
def test_an_expression_reaches_none_of_the_names_of_python(write, expression, name):
    with pytest.raises(RobotError, match=f"a macro file may not use {name}"):
        read_urdf(write(f'<link name="${{{expression}}}"/>'))
