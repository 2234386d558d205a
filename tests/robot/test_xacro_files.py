"""Macro files: expanded as xacro does, without ROS; what is wrong is said with xacro's reason."""

import builtins
import os
import sys

import pytest
from cases import SLIDE

from tubeplanner import load_robot
from tubeplanner.errors import RobotError
from tubeplanner.files.fingerprint import robot_hash
from tubeplanner.robot import xacro_file
from tubeplanner.robot.urdf import read_urdf
from tubeplanner.robot.xacro_file import expanded

HEAD = '<robot name="slide" xmlns:xacro="http://www.ros.org/wiki/xacro">'
BODY = SLIDE.removeprefix('<robot name="slide">').removesuffix("</robot>")
EFFORT = '<xacro:arg name="effort" default="60"/><xacro:arg name="far" default="false"/>'
ARM = HEAD + EFFORT + BODY.replace('effort="60"', 'effort="$(arg effort)"') + "</robot>"


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Return a function that writes a file; no ROS is set up."""
    for variable in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"):
        monkeypatch.delenv(variable, raising=False)

    def write(text, name="arm.urdf.xacro"):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        return path

    return write


def test_a_macro_file_is_the_robot_that_it_stands_for(write):
    plain, macro = write(SLIDE, "arm.urdf"), write(ARM)
    assert robot_hash(load_robot(macro, "tip")) == robot_hash(load_robot(plain, "tip"))
    strong = load_robot(macro, "tip", xacro_args={"effort": 70})
    assert strong.limits.effort.tolist() == [70, 80, 20]
    assert robot_hash(strong) != robot_hash(load_robot(plain, "tip"))


def test_where_the_file_lies_changes_nothing(write):
    before, after = write(ARM), write(ARM, "elsewhere/arm.xacro")
    assert expanded(before, {}, ()) == expanded(after, {}, ())


def test_truth_values_are_written_as_xacro_reads_them(write):
    text = f'{HEAD}<xacro:arg name="far" default="false"/><xacro:if value="$(arg far)"><far/>'
    path = write(text + "</xacro:if></robot>")
    assert b"<far/>" in expanded(path, {"far": True}, ())
    assert b"<far/>" not in expanded(path, {"far": False}, ())


def test_includes_are_relative_to_the_file_that_names_them(write):
    write(HEAD + '<xacro:include filename="body.xacro"/></robot>', "parts/all.xacro")
    write(HEAD + BODY + "</robot>", "parts/body.xacro")
    path = write(HEAD + '<xacro:include filename="parts/all.xacro"/></robot>')
    assert read_urdf(path).movable() == ["turn", "extend", "lift"]


@pytest.mark.parametrize("found", ["package_dirs", "ROS_PACKAGE_PATH", "above"])
def test_packages_are_found_without_ros(write, tmp_path, monkeypatch, found):
    write(HEAD + BODY + "</robot>", "src/slide_description/body.xacro")
    include = f'{HEAD}<xacro:include filename="$(find slide_description)/body.xacro"/></robot>'
    path = write(include, "src/arm.xacro" if found == "above" else "cell/arm.xacro")
    if found == "ROS_PACKAGE_PATH":
        monkeypatch.setenv(found, str(tmp_path / "src"))
    folders = (tmp_path / "src",) if found == "package_dirs" else ()
    assert read_urdf(path, package_dirs=folders).movable() == ["turn", "extend", "lift"]
    assert "ament_index_python" not in sys.modules


def test_ros_own_index_is_back_afterwards(write, monkeypatch):
    monkeypatch.setitem(sys.modules, "ament_index_python", sys)
    expanded(write(ARM), {}, ())
    assert sys.modules["ament_index_python"] is sys


FAULTS = {
    "a property": ('<a b="${size}"/>', {}, "name 'size' is not defined"),
    "an argument": ('<a b="$(arg size)"/>', {}, "Undefined substitution argument size"),
    "a file": ('<xacro:include filename="no.xacro"/>', {}, "No such file or directory: "),
    "a macro": ("<xacro:wheel/>", {}, "unknown macro name: xacro:wheel"),
    "a package": ('<a b="$(find nobody)"/>', {}, "package 'nobody' was not found; folders tried"),
    "malformed": ("<a>", {}, "mismatched tag: line 1"),
    "endless": ('<xacro:include filename="arm.urdf.xacro"/>', {}, "without end"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_what_cannot_be_expanded_is_said_with_its_reason(write, name):
    inner, arguments, message = FAULTS[name]
    path = write(f"{HEAD}{inner}</robot>")
    with pytest.raises(RobotError) as caught:
        read_urdf(path, arguments)
    assert str(caught.value).startswith(f"{path}: xacro cannot expand it: ")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_included_file_that_is_wrong_is_named(write):
    part = write(f'{HEAD}<a b="${{size}}"/></robot>', "part.xacro")
    path = write(f'{HEAD}<xacro:include filename="part.xacro"/></robot>')
    with pytest.raises(RobotError) as caught:
        read_urdf(path)
    assert str(caught.value).endswith(f"(in {part})")


def test_an_argument_that_nothing_asks_for_is_refused(write):
    with pytest.raises(RobotError, match=r"unknown argument 'efort' \(did you mean 'effort'\?\)"):
        read_urdf(write(ARM), {"efort": 1})


def test_arguments_are_for_macro_files_alone(write):
    with pytest.raises(RobotError, match=r"robot.xacro_args are for a file that ends in \.xacro"):
        read_urdf(write(SLIDE, "arm.urdf"), {"effort": 1})


def test_without_xacro_the_remedy_is_named(write, monkeypatch):
    real = builtins.__import__

    def without(name, *rest, **more):
        if name == "xacro":
            raise ImportError(name)
        return real(name, *rest, **more)

    path = write(ARM)
    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(RobotError, match=r"takes xacro, which is not installed: pip install"):
        read_urdf(path)


HARMFUL = {
    "endless": ("${10**10**10}", "xacro cannot expand it within 0.5 s; simplify it"),
    "large": ("${'a' * 10**11}", "xacro cannot expand it: it takes more than 1 GB"),
}


@pytest.mark.parametrize("name", HARMFUL)
def test_a_file_that_takes_all_time_or_memory_is_refused(write, monkeypatch, name):
    value, message = HARMFUL[name]
    if name == "endless":
        monkeypatch.setattr(xacro_file, "_TIME_LIMIT", 0.5)
    with pytest.raises(RobotError, match=message):
        expanded(write(f'{HEAD}<a b="{value}"/></robot>'), {}, ())


def test_a_file_that_stands_for_a_large_one_is_refused(write, monkeypatch):
    monkeypatch.setattr(xacro_file, "_MAX_BYTES", 10_000)
    with pytest.raises(RobotError, match=r"what it stands for is larger than 0\.01 MB"):
        expanded(write(HEAD + "<a b=\"${'a' * 20000}\"/></robot>"), {}, ())


def test_a_pipe_is_refused_without_waiting(tmp_path):
    os.mkfifo(tmp_path / "arm.xacro")
    with pytest.raises(RobotError, match="cannot be read: it is no regular file"):
        expanded(tmp_path / "arm.xacro", {}, ())


def test_a_process_that_ends_without_an_answer_is_an_error(write, monkeypatch):
    monkeypatch.setattr(xacro_file, "_PROGRAM", "{path!r}")
    with pytest.raises(RobotError, match="xacro ended without an answer; simplify it"):
        expanded(write(ARM), {}, ())


def test_what_xacro_warns_of_is_not_printed(write, capfd):
    write("length: 1", "sizes.yaml")
    path = write(HEAD + "<a b=\"${load_yaml('sizes.yaml')['length']}\"/></robot>")
    assert b'b="1"' in expanded(path, {}, ())
    assert capfd.readouterr() == ("", "")
