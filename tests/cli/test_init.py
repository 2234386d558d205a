"""`tubeplanner init`: a first problem that plans as it stands, with comments that can be fields."""

import re
from contextlib import redirect_stdout
from io import StringIO

import numpy as np
import pytest
from cases import SLIDE, slow_but

from tubeplanner import PlanOptions, load_problem, parse_problem, plan
from tubeplanner.cli.main import main
from tubeplanner.documents import parse_yaml
from tubeplanner.fields import check_fields
from tubeplanner.task.problem_format import ProblemFields

SCARA = """<robot name="scara"><link name="base"/>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper arm"/>
  <origin xyz="0 0 0.2"/><axis xyz="0 0 1"/>
  <limit lower="-2.5" upper="2.5" effort="0" velocity="0"/></joint>
<link name="upper arm"><inertial><origin xyz="0.15 0 0"/><mass value="2"/>
  <inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="elbow" type="revolute"><parent link="upper arm"/><child link="forearm"/>
  <origin xyz="0.3 0 0.07"/><axis xyz="0 0 1"/>
  <limit lower="-2.5" upper="2.5" velocity="2"/></joint>
<link name="forearm"><inertial><origin xyz="0.12 0 0"/><mass value="1.5"/>
  <inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="lift" type="prismatic"><parent link="forearm"/><child link="true"/>
  <origin xyz="0.25 0 0"/><axis xyz="0 0 1"/><limit lower="-0.2" upper="0"/></joint>
<link name="true"><inertial><mass value="0.5"/>
  <inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
</robot>"""
ROBOTS = {"scara": SCARA, "slide": SLIDE}


@pytest.fixture(scope="module")
def named(tmp_path_factory):
    """Return a function from a name to what `init` is given."""
    folder = tmp_path_factory.mktemp("robots")
    for name, text in ROBOTS.items():
        (folder / f"{name}.urdf").write_text(text)

    def of(name):
        return str(folder / f"{name}.urdf") if name in ROBOTS else f"example:{name}"

    return of


@pytest.fixture(scope="module")
def starter(named, shared):
    """Return a function from a name to the file that `init` prints, made once."""

    def printed(name):
        with redirect_stdout(StringIO()) as stream:
            assert main(["init", named(name)]) == 0
        return stream.getvalue()

    return lambda name: shared(f"starter.{name}", lambda: printed(name))


def _switched_on(text, chosen=lambda number: True):
    """Return a problem file with commented-out fields switched on."""
    lines = text.split("\n")
    return "\n".join(
        re.sub(r"^( *)# ", r"\1", line) if chosen(number) else line
        for number, line in enumerate(lines)
    )


def _commented(text):
    return [k for k, line in enumerate(text.split("\n")) if re.match(r" *# ", line)]


@pytest.mark.slow  # plans once more what `init` has planned
@pytest.mark.parametrize("name", ["scara", "ur5", "talos_arm"])
def test_what_is_printed_plans(starter, name):
    problem = parse_problem(parse_yaml(starter(name)), name=name)
    assert plan(problem, PlanOptions(slack=0.0)).succeeded


@pytest.mark.dear("plans the first problem of an arm")
def test_every_commented_field_may_be_given_alone(starter):
    text = starter("scara")
    commented = _commented(text)
    assert len(commented) >= 9
    for number in commented:
        one = _switched_on(text, lambda k, number=number: k == number)
        assert one != text
        check_fields(ProblemFields, parse_yaml(one), "the file")


@pytest.mark.dear("plans the first problem of an arm")
@pytest.mark.parametrize("name", slow_but(["scara"], ["scara", "ur5"]))
def test_the_commented_fields_load_all_together(starter, name):
    every = parse_problem(parse_yaml(_switched_on(starter(name))))
    assert np.isfinite(every.robot.limits.jerk).all()
    assert (len(every.obstacles), len(every.attached)) == (1, 1)
    assert every.clearance == 0.01 and every.period == 0.001 and every.goal is not None


@pytest.mark.dear("plans the first problem of an arm")
def test_limits_that_the_urdf_lacks_are_placeholders_to_be_replaced(starter):
    text = starter("scara")
    fields = parse_yaml(text)["robot"]["limits"]
    assert set(fields) == {"velocity", "effort"}
    assert set(fields["velocity"]) == {"shoulder", "lift"}  # the elbow has one
    assert set(fields["effort"]) == {"shoulder", "elbow", "lift"}
    assert fields["effort"]["lift"] >= 2 * 0.5 * 9.81  # more than holds the quill
    assert text.count("REPLACE THEM by the maker's") == 2
    assert "limits" not in parse_yaml(starter("slide"))["robot"]


def test_without_masses_accelerations_are_limited_in_place_of_efforts(run, tmp_path):
    weightless = re.sub(r"<inertial>.*?</inertial>", "", SLIDE, flags=re.DOTALL)
    (tmp_path / "light.urdf").write_text(weightless)
    text = run("init", tmp_path / "light.urdf")[1]
    limits = parse_yaml(text)["robot"]["limits"]
    assert set(limits["effort"].values()) == {float("inf")}
    assert limits["acceleration"] == dict.fromkeys(("turn", "extend", "lift"), 10.0)
    assert limits["jerk"] == dict.fromkeys(("turn", "extend", "lift"), 500.0)
    assert text.count("REPLACE THEM by the maker's") == 3 and "# jerk" not in text


def test_the_start_is_held_free_and_well_inside_limits(starter):
    problem = parse_problem(parse_yaml(starter("ur5")))
    robot, q = problem.robot, problem.start
    assert (abs(robot.gravity_effort(q)) < 0.7 * robot.limits.effort).all()
    lower, upper = robot.limits.lower_position, robot.limits.upper_position
    assert (np.minimum(q - lower, upper - q) > 0.1 * (upper - lower)).all()
    checker = problem.collision
    assert not checker.any_overlap(*robot.body_poses(q), checker.pairs)
    assert np.linalg.svd(robot.tool_jacobian(q)[1], compute_uv=False)[-1] > 0.05
    assert problem.tube.joint_signs[0]["elbow_joint"] == ("+" if q[2] > 0 else "-")


def test_paths_are_relative_to_the_file_that_is_written(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "slide.urdf").write_text(SLIDE)
    path = tmp_path / "cell" / "first.yaml"
    path.parent.mkdir()
    status, text, _ = run("init", "slide.urdf", "-o", "cell/first.yaml")
    assert status == 0 and "problem: cell/first.yaml" in text
    assert parse_yaml(path.read_text())["robot"]["urdf"] == "../slide.urdf"
    assert load_problem(path).robot.name == "slide"


def test_arguments_of_a_macro_file_are_taken_and_written_as_text(run, tmp_path):
    head = '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="slide">'
    text = SLIDE.replace('<robot name="slide">', head).replace('effort="60"', 'effort="$(arg e)"')
    urdf, output = tmp_path / "arm.urdf.xacro", tmp_path / "first.yaml"
    urdf.write_text(text)
    status, _, error = run("info", urdf)
    assert status == 2 and "--xacro-arg (its <xacro:arg>: none)" in error
    assert run("info", urdf, "--xacro-arg", "e=70")[0] == 0
    assert run("init", urdf, "--xacro-arg", "e=070", "-o", output)[0] == 0
    assert '  xacro_args: {"e": "070"}\n' in output.read_text()
    assert load_problem(output).robot.limits.effort[0] == 70
    for words in (("e",), ("e=1", "--xacro-arg", "e=2")):
        assert run("info", urdf, "--xacro-arg", *words)[0] == 2
    assert "robot.xacro_args" in run("info", output, "--xacro-arg", "e=1")[2]


def test_json_has_the_text_and_another_tool_frame_is_taken(run_json, named, tmp_path):
    path = tmp_path / "first.yaml"
    path.write_text("something else")
    _, answer = run_json("init", named("slide"), "--tool-frame", "boom", "-o", path)
    assert answer["text"] == path.read_text()
    assert (answer["problem"], answer["placeholders"]) == (str(path), [])
    assert answer["duration"] > 0
    fields = parse_yaml(answer["text"])
    assert fields["robot"]["tool_frame"] == "boom"
    assert set(fields["start"]["joints"]) == {"turn", "extend"}


def test_an_arm_too_weak_to_hold_itself_is_refused(run, tmp_path):
    weak = SLIDE.replace('effort="20"', 'effort="1e-3"').replace("0 0 -0.1", "0.2 0 0")
    (tmp_path / "weak.urdf").write_text(weak)
    status, _, error = run("init", tmp_path / "weak.urdf")
    assert status == 2
    assert "gravity takes at most 70% of the effort limits" in error
