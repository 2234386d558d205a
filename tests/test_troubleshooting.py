"""Every message that the page on refusals quotes is what its mistake gets."""

import re
from pathlib import Path

import pytest

from rail_arm import rail_arm
from test_docs import require_same
from tubeplanner.commands.cli import main

PAGES = Path(__file__).parents[1] / "docs/how_to"
QUOTED = re.findall(r"^> `(.*)`$", (PAGES / "troubleshooting.md").read_text(), re.M)
RAIL = """\
robot: {urdf: arm.urdf, tool_frame: flange}
tube: {points: [[0.4, 0.5, 0.7], [0.4, 0.5, 0.5]], radius: 0.05}
start: {seed: [0, 1, 0.5, 1.4, -0.4, 0]}
"""
WALL = """\
robot:
  urdf: example:ur5
  tool_frame: tool0
tube:
  points: [[0.45, -0.3, 0.2], [0.45, -0.3, 0.5], [0.45, 0.3, 0.5], [0.45, 0.3, 0.2]]
  radius: [0.03, 0.08, 0.03]
  joint_signs: {elbow_joint: "+"}
start: {joints: [-0.773861, -1.294184, 1.830514, -1.925057, -1.682929, 0.0]}
obstacles:
  - {name: wall, box: [0.6, 0.05, 0.44], position: [0.6, 0, 0.22]}
  - {name: table, box: [0.9, 1.6, 0.04], position: [0.75, 0, -0.02]}
clearance: 0.01
"""
PICK = re.search(r"```yaml\n(.*?)```", (PAGES / "contacts.md").read_text(), re.S).group(1)
CYCLE = re.search(r"```yaml\n(.*?)```", (PAGES / "cycles.md").read_text(), re.S).group(1)
WEIGHT = re.search(r"part, payload: .*", CYCLE).group(0)
CONTACTS = "contacts:\n  - {links: [part, table], within: 0.03}\n"
XACRO = 'name="rail_arm" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include filename='
SOLID = '<cylinder radius="0.03" length="0.02"/>'
IN_DEGREES = """\
joint_limits:
  elbow_joint: {has_velocity_limits: true,
    max_velocity: !degrees 180.0}
"""


def changed(text, *changes):
    """Return a text with every old part replaced by its new one."""
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return text


def arm(old, new, name="arm.urdf"):
    """Return the files of a problem whose arm has a mistake."""
    robot = changed(rail_arm(), (old, new))
    return {name: robot, "problem.yaml": RAIL.replace("arm.urdf", name)}


def wall(old, new):
    return {"problem.yaml": changed(WALL, (old, new))}


def robot(field):
    """Return the files of a problem whose robot has a further field."""
    return wall("tool_frame: tool0\n", f"tool_frame: tool0\n  {field}\n")


def pick(*changes):
    return {"problem.yaml": changed(PICK, *changes)}


def cycle(*changes):
    return {"cycle.yaml": changed(CYCLE, *changes)}


def slow(files):
    """Mark what is planned before it is refused."""
    return pytest.param(files, marks=pytest.mark.slow)


# Of each quoted message, in the page's order; the last file is planned.
MISTAKES = [
    arm('name="rail_arm">', f'{XACRO}"hand.xacro"/>'),
    arm('name="rail_arm">', f'{XACRO}"$(find our_description)/a.xacro"/>', "arm.urdf.xacro"),
    arm(SOLID, '<mesh filename="package://our_description/meshes/flange.stl"/>'),
    arm(SOLID, '<mesh filename="meshes/flange.stl"/>'),
    {"flange.dae": "nonsense", **arm(SOLID, '<mesh filename="flange.dae"/>')},
    arm("</robot>", ""),
    {**arm("", ""), "problem.yaml": RAIL.replace("flange", "tool")},
    arm('effort="80"', 'effort="0"'),
    arm('<limit lower="-2.2" upper="2.2" effort="28" velocity="4"/>', ""),
    arm('<mass value="2.5"/>', '<mass value="0"/>'),
    robot("preset: fer"),
    {"joint_limits.yaml": IN_DEGREES, **robot("limits_file: joint_limits.yaml")},
    wall("clearance", "clearence"),
    wall("  radius", "\tradius"),
    {"arm.urdf": rail_arm()},
    wall(", 0.0]}", "]}"),
    wall("[0.03, 0.08, 0.03]", "[0.03, 0.08]"),
    wall("-0.773861", "-0.673861"),
    wall("-0.773861", "-44.3"),
    wall('elbow_joint: "+"', 'elbow_joint: "-"'),
    pick(
        ("[1, 0, 0, 0]", "[0, 0.7071068, -0.7071068, 0]"),
        (
            "start: {seed: [-0.8, -1.3, 1.9, -2.2",
            "start: {joints: [-0.7912, -1.312, 1.9004, -2.1592",
        ),
    ),
    pick(("orientations: [[1, 0, 0, 0]", "orientations: [[0.7, -0.9, 0, 0]")),
    pick(("[1, 0, 0, 0]]", "[0, 0, 0, 1]]")),
    wall("elbow_joint", "elbow"),
    pick((CONTACTS, "")),
    pick(("within: 0.03}", "within: 0.03, segments: [-1]}")),
    wall("position: [0.75, 0, -0.02]", "position: [0.75, 0, 0.18]"),
    wall("clearance: 0.01", "clearance: 0.08"),
    robot("attached: [{name: gripper, box: [0.3, 0.1, 0.1], position: [0, 0, -0.02]}]"),
    slow(wall("0.44], position: [0.6, 0, 0.22]", "0.9], position: [0.6, 0, 0.45]")),
    wall("[0.45, 0.3, 0.2]]", "[0.95, 0.5, 0.2]]"),
    slow(
        wall('{elbow_joint: "+"}', '[{elbow_joint: "+"}, {elbow_joint: "+"}, {elbow_joint: "-"}]')
    ),
    slow(wall('"+"}', '"+", shoulder_pan_joint: "-"}')),
    robot("payload: {mass: 30, com: [0, 0, 0.05]}"),
    slow(wall("clearance: 0.01", "objective: {duration: 0.3}")),
    cycle(("points: [[0.45, 0.3, 0.1]", "points: [[0.45, 0.2, 0.1]")),
    cycle((WEIGHT, "prt}")),
    cycle(("  - {detach: part}\n", "")),
    cycle(("closed: true", "closed: true\nperiod: 0.004")),
]


@pytest.mark.parametrize("files", MISTAKES, ids=range(len(MISTAKES)))
def test_a_mistake_gets_the_message_that_is_quoted(files, request, tmp_path, monkeypatch, capsys):
    number = int(request.node.callspec.id)
    assert len(QUOTED) == len(MISTAKES)
    monkeypatch.chdir(tmp_path)
    for name, text in files.items():
        Path(name).write_text(text)
    assert main(["plan", list(files)[-1]]) in (1, 2)
    printed = capsys.readouterr()
    require_same(f"{printed.out} {printed.err} end", f"...{QUOTED[number]} ...")
