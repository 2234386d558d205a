"""A first problem file with comments: fields that hold, and others that can be switched on.

Lines that begin with `##` explain; in lines that begin with `# ` a field follows, which holds as
soon as that is removed, alone or with all others.
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tubeplanner.problem.problem_format import PROBLEM_FORMAT
from tubeplanner.resources import EXAMPLE_PREFIX
from tubeplanner.robot.robot_info import RobotInfo
from tubeplanner.tube_sources.starter_problem import StarterProblem

_PACKAGE_PREFIX = "package://"
_WHY = {
    "position": "ranges that the URDF lacks [rad] or [m]",
    "velocity": "velocity limits that the URDF lacks [rad/s] or [m/s]",
    "effort": "effort limits that the URDF lacks [N m] or [N]",
}
_NO_MASSES = "no effort is limited, as links lack their <inertial>"
_WORDS = ("true", "false", "null")  # which are no text in YAML
_GENTLE = (
    "acceleration: 10.0  # [rad/s^2] or [m/s^2], one number for all joints, a list or a map",
    "jerk: 500.0  # [rad/s^3] or [m/s^3]",
)


def starter_text(
    starter: StarterProblem, urdf: str, package_dirs: tuple[str, ...], folder: Path
) -> str:
    """Return the contents of a problem file.

    Args:
        starter: The problem.
        urdf: Its URDF as it was named, relative to the working folder.
        package_dirs: Further folders that hold packages, likewise.
        folder: Where the file will be: its paths are relative to that.
    """
    lines = [
        f"## {starter.info.name}: a first problem, which was planned before it was written.",
        '## Lines with "##" explain. In lines with "#" a field follows: remove "# " to use it.',
        "## `tubeplanner schema` has all fields, with units and defaults.",
        f"format: {PROBLEM_FORMAT}",
        "version: 1",
        *_robot_lines(starter, urdf, package_dirs, folder),
        *_tube_lines(starter),
        *_end_lines(starter),
        *_cell_lines(starter),
    ]
    return "\n".join(lines) + "\n"


def _robot_lines(
    starter: StarterProblem, urdf: str, package_dirs: tuple[str, ...], folder: Path
) -> list[str]:
    frame = starter.info.tool_frame
    folders = [_as_yaml(_path_from(each, folder)) for each in package_dirs]
    return [
        "robot:",
        f"  urdf: {_as_yaml(_path_from(urdf, folder))}",
        *([f"  package_dirs: [{', '.join(folders)}]"] if folders else []),
        f"  tool_frame: {_as_yaml(frame)}",
        *_other_frames(starter.info),
        "  ## the tool centre point in tool_frame; it is what stays in the tube [m]",
        "  # tool_offset: {position: [0.0, 0.0, 0.0]}",
        "  ## where the root link stands in the cell, whose frame is then that of all [m, rad]",
        "  # base: {position: [0.0, 0.0, 0.0], rpy: [0.0, 0.0, 0.0]}",
        "  ## what the tool carries: mass [kg], centre of mass and solid in tool_frame [m]",
        "  # payload: {mass: 0.1, com: [0.0, 0.0, 0.0]}",
        "  # attached: [{name: part, sphere: 0.01, position: [0.0, 0.0, 0.03], "
        f"touch_links: [{_as_yaml(frame)}]}}]",
        *_limit_lines(starter),
    ]


def _other_frames(info: RobotInfo) -> list[str]:
    others = [name for name in info.leaf_links if name != info.tool_frame]
    return [f"  ## other ends of chains: {', '.join(others)}"] if others else []


def _limit_lines(starter: StarterProblem) -> list[str]:
    """Return placeholders for the limits that are missing, to be replaced, and gentle examples."""
    why = "  ## without these a motion may be as abrupt as the motors allow"
    if not starter.placeholders:
        return [why, "  # limits: {acceleration: 10.0, jerk: 500.0}"]
    lines = ["  limits:"]
    for quantity, values in starter.placeholders.items():
        endless = quantity == "effort" and np.isinf(list(values.values())).all()
        lines.append(f"    ## PLACEHOLDERS: {_NO_MASSES if endless else _WHY[quantity]};")
        lines.append("    ## REPLACE THEM by the maker's")
        lines.append(f"    {quantity}: {_row(values)}")
    return [*lines, f"  {why}", *(f"    # {line}" for line in _GENTLE)]


def _tube_lines(starter: StarterProblem) -> list[str]:
    tube = starter.problem.tube
    signs = tube.joint_signs[0]
    return [
        "tube:",
        "  ## reference points of the tool in the frame of the root link [m]",
        "  points:",
        *(f"    - {_row(point)}" for point in tube.points.tolist()),
        "  ## how far the tool may stray from the lines between them, one number or one each [m]",
        f"  radius: {tube.radius[0]:g}",
        *(["  ## the arm stays in the configuration of its start"] if signs else []),
        *([f"  joint_signs: {_row(signs)}"] if signs else []),
        "  ## of the tool [m/s]",
        "  # tool_speed: 0.25",
    ]


def _end_lines(starter: StarterProblem) -> list[str]:
    names, trajectory = starter.problem.robot.joint_names, starter.result.trajectory
    assert isinstance(starter.problem.start, np.ndarray) and trajectory is not None
    start = dict(zip(names, starter.problem.start.tolist(), strict=True))
    last = trajectory.position(trajectory.duration).round(4).tolist()
    return [
        "start:",
        f"  joints: {_row(start)}",
        "## without a goal the motion ends in any configuration, the tool at the last point",
        f"# goal: {{joints: {_row(dict(zip(names, last, strict=True)))}}}",
    ]


def _cell_lines(starter: StarterProblem) -> list[str]:
    """Return examples of what else a problem may have."""
    beyond = round(2 * starter.reach + 1, 1)
    return [
        "## box: side lengths; also sphere, cylinder, capsule, mesh; with rpy or quaternion [m]",
        f"# obstacles: [{{name: box, box: [0.2, 0.2, 0.2], position: [{beyond}, 0.0, 0.1]}}]",
        "## least distance of links to obstacles [m]",
        "# clearance: 0.01",
        "## by which share longer than the shortest the motion may be, to be smooth",
        "# objective: {slack: 0.02, minimise: smoothness}",
        "## of the controller: duration and breakpoints are multiples of it [s]",
        "# period: 0.001",
    ]


def _path_from(path: str, folder: Path) -> str:
    """Return a path in the working folder as one relative to another folder."""
    if path.startswith((EXAMPLE_PREFIX, _PACKAGE_PREFIX)) or Path(path).is_absolute():
        return path
    return os.path.relpath(Path(path).resolve(), folder.resolve())


def _row(values: Any) -> str:
    """Return a list or map as YAML has it on one line."""
    if isinstance(values, Mapping):
        return "{" + ", ".join(f"{_as_yaml(k)}: {_row(v)}" for k, v in values.items()) + "}"
    if isinstance(values, list | tuple):
        return "[" + ", ".join(_row(value) for value in values) + "]"
    return _as_yaml(values)


def _as_yaml(value: Any) -> str:
    """Return a name or a number as YAML reads it."""
    if isinstance(value, str):
        plain = value.replace("_", "").replace("/", "").replace(".", "").replace(":", "")
        is_plain = plain.isascii() and plain.isalnum() and plain[0].isalpha()
        is_word = value.lower() in _WORDS or value.endswith(":")
        return value if is_plain and not is_word else '"' + _escaped(value) + '"'
    if np.isinf(value):
        return ".inf" if value > 0 else "-.inf"
    return repr(float(value) + 0.0)


def _escaped(text: str) -> str:
    return text.replace("\\", "\\\\").replace('"', '\\"')
