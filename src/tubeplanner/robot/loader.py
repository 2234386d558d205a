"""`load_robot`: a RobotModel from a URDF and a problem's settings."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tubeplanner.checks import are_numbers, checked_path, checked_row
from tubeplanner.errors import RobotError, shown
from tubeplanner.resources import GivenPackageDirs, PackageDirs, find_description
from tubeplanner.robot.joint_limits import resolve_limits
from tubeplanner.robot.limit_layers import GivenLimits, LimitLayer, layers_of
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.motors import resolve_motors
from tubeplanner.robot.overrides import LimitOverrides, MotorOverrides
from tubeplanner.robot.pinocchio_model import BasePose, Payload, ToolOffset, planning_group
from tubeplanner.robot.ros_files import XACRO_ENDING, read_srdf
from tubeplanner.robot.urdf import UrdfDescription, read_urdf

EARTH_GRAVITY = (0.0, 0.0, -9.81)  # [m/s^2]
_KINDS: Mapping[str, type] = {"tool_offset": ToolOffset, "payload": Payload, "base": BasePose}


def load_robot(
    urdf: str | Path,
    tool_frame: str,
    *,
    joints: Sequence[str] | None = None,
    locked_joints: Mapping[str, float] | None = None,
    tool_offset: ToolOffset | None = None,
    base: BasePose | None = None,
    gravity: Sequence[float] = EARTH_GRAVITY,
    payload: Payload | None = None,
    limits: GivenLimits | None = None,
    motors: MotorOverrides | None = None,
    package_dirs: GivenPackageDirs = (),
    xacro_args: Mapping[str, object] | None = None,
    srdf: str | Path | None = None,
    directory: str | Path = ".",
) -> RobotModel:
    """Load the arm that ends at a link of a URDF.

    Args:
        urdf: A path, `package://PACKAGE/...`, or `example:NAME`.
        tool_frame: Any link; with the tool offset it gives the point that must stay in the tube.
        joints: Planning group, in group order; default: the movable joints from the root to the
            tool frame, in chain order, a joint that mimics another replaced by its leader.
        locked_joints: Values of joints outside the group, by name [rad or m]; default 0, clipped
            to the limits. A mimic joint follows its master, locked or planned.
        tool_offset: Tool centre point in the tool frame; default: its origin.
        base: Pose of the root link in the cell, whose frame is then the base frame; default: the
            base frame is the root link's.
        gravity: In the base frame [m/s^2].
        payload: Carried mass; default: none.
        limits: Limits that replace the URDF's, or several layers, as `read_preset` returns them;
            later layers replace earlier ones; default: none.
        motors: Motors of the joints, above the motors of `limits`; default: none.
        package_dirs: Further folders that hold the packages of `package://` names, or a map from
            the names of packages to their folders.
        xacro_args: Values of the arguments of a URDF that ends in .xacro, by name.
        srdf: The SRDF, named like the URDF; of xacro_args it may use some; default: none.
        directory: Base of relative paths.

    Raises:
        RobotError: The description cannot be planned with; the message says why.
    """
    if not are_numbers(gravity, 3):
        row = list(gravity) if isinstance(gravity, tuple | np.ndarray) else gravity
        raise RobotError(f"robot.gravity {shown(row)} must be three finite numbers [m/s^2]")
    for name, part in (("tool_offset", tool_offset), ("payload", payload), ("base", base)):
        kind = _KINDS[name]
        if part is not None and not isinstance(part, kind):
            raise RobotError(f"robot.{name} is {shown(part)}; give a {kind.__name__}")
    _require_map("locked_joints", locked_joints)
    directory = checked_path("directory", directory)
    folders = package_folders(package_dirs, directory)
    description = read_description(urdf, srdf, xacro_args, folders, directory)
    group = planning_group(description, tool_frame, joints)
    layers = layers_of(() if limits is None else limits)
    if motors is not None:
        if not isinstance(motors, MotorOverrides):
            raise RobotError(f"motors are {shown(motors)}; give MotorOverrides")
        layers.append(LimitLayer("robot.", LimitOverrides(), motors=motors))
    return RobotModel(
        description,
        tuple(group),
        tool_frame,
        tool_offset or ToolOffset(),
        resolve_limits(description, group, layers),
        folders,
        dict(locked_joints or {}),
        (float(gravity[0]), float(gravity[1]), float(gravity[2])),
        payload,
        resolve_motors(description, group, layers),
        base,
    )


def read_description(
    urdf: str | Path,
    srdf: str | Path | None,
    xacro_args: Mapping[str, object] | None,
    folders: PackageDirs,
    directory: Path,
) -> UrdfDescription:
    """Return the description of a robot with its SRDF; arguments as of `load_robot`.

    Raises:
        RobotError: A file cannot be read, or neither uses an argument.
    """
    _require_map("xacro_args", xacro_args)
    path = find_description(urdf, directory, folders)
    if srdf is None:
        return read_urdf(path, xacro_args, folders)
    srdf_path = find_description(srdf, directory, folders)
    uses_all = path.suffix != XACRO_ENDING and srdf_path.suffix == XACRO_ENDING
    description = read_urdf(path, None if uses_all else xacro_args, folders)
    read = read_srdf(srdf_path, xacro_args, folders, uses_all)
    notes = (*description.notes, *read.notes(description.links))
    return replace(description, srdf=read, notes=notes)


def package_folders(value: GivenPackageDirs, directory: Path) -> PackageDirs:
    """Return package folders as paths, with their names if they are a map, joined to a directory.

    Raises:
        OptionError: The folders are no list or map of paths.
    """
    if isinstance(value, Mapping):
        folders = {str(name): checked_path("robot.package_dirs", value[name]) for name in value}
        return tuple((name, directory / folder) for name, folder in folders.items())
    rows = checked_row("robot.package_dirs", value, "folders")
    return tuple(directory / checked_path("robot.package_dirs", folder) for folder in rows)


def _require_map(name: str, value: object) -> None:
    """Raise RobotError unless a value is None or a map by name."""
    if value is not None and not isinstance(value, Mapping):
        raise RobotError(f"robot.{name} is {shown(value)}; give a map by name")
    for key in value or {}:
        if not isinstance(key, str):
            raise RobotError(f"robot.{name}: the key {shown(key)} is no name; give text")
