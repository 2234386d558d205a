"""`load_robot`: a RobotModel from a URDF and a problem's settings; likely tool frames."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tubeplanner.checks import are_numbers, checked_path, checked_row
from tubeplanner.errors import RobotError, shown
from tubeplanner.resources import GivenPackageDirs, PackageDirs, find_description
from tubeplanner.robot.joint_limits import (
    GivenLimits,
    JointLimits,
    LimitLayer,
    layers_of,
    resolve_limits,
)
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.motors import JointMotors, resolve_motors
from tubeplanner.robot.overrides import LimitOverrides, MotorOverrides
from tubeplanner.robot.pinocchio_model import BasePose, Payload, ToolOffset, planning_group
from tubeplanner.robot.ros_files import XACRO_ENDING, read_srdf
from tubeplanner.robot.urdf import MOVABLE_TYPES, UrdfDescription, read_urdf

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
    arm = described_arm(
        urdf,
        tool_frame,
        joints=joints,
        limits=limits,
        motors=motors,
        package_dirs=package_dirs,
        xacro_args=xacro_args,
        srdf=srdf,
        directory=directory,
    )
    return arm.model(
        resolve_limits(arm.description, arm.group, arm.layers),
        resolve_motors(arm.description, arm.group, arm.layers),
        locked_joints=locked_joints,
        tool_offset=tool_offset,
        base=base,
        gravity=gravity,
        payload=payload,
    )


@dataclass(frozen=True)
class DescribedArm:
    """The description of an arm, before its limits are resolved."""

    description: UrdfDescription
    folders: PackageDirs  # folders that hold the packages of `package://` names
    tool_frame: str  # the link that carries the tool
    group: list[str]  # the planned joints
    layers: list[LimitLayer]  # limits and motors, later layers above

    def model(
        self,
        limits: JointLimits,
        motors: JointMotors | None,
        *,
        locked_joints: Mapping[str, float] | None = None,
        tool_offset: ToolOffset | None = None,
        base: BasePose | None = None,
        gravity: Sequence[float] = EARTH_GRAVITY,
        payload: Payload | None = None,
    ) -> RobotModel:
        """Return the arm with resolved limits and motors; arguments as of `load_robot`."""
        if not are_numbers(gravity, 3):
            row = list(gravity) if isinstance(gravity, tuple | np.ndarray) else gravity
            raise RobotError(f"robot.gravity {shown(row)} must be three finite numbers [m/s^2]")
        for name, part in (("tool_offset", tool_offset), ("payload", payload), ("base", base)):
            kind = _KINDS[name]
            if part is not None and not isinstance(part, kind):
                raise RobotError(f"robot.{name} is {shown(part)}; give a {kind.__name__}")
        _require_map("locked_joints", locked_joints)
        return RobotModel(
            self.description,
            tuple(self.group),
            self.tool_frame,
            tool_offset or ToolOffset(),
            limits,
            self.folders,
            dict(locked_joints or {}),
            (float(gravity[0]), float(gravity[1]), float(gravity[2])),
            payload,
            motors,
            base,
        )


def described_arm(
    urdf: str | Path,
    tool_frame: str | None,
    *,
    joints: Sequence[str] | None = None,
    limits: GivenLimits | None = None,
    motors: MotorOverrides | None = None,
    package_dirs: GivenPackageDirs = (),
    xacro_args: Mapping[str, object] | None = None,
    srdf: str | Path | None = None,
    directory: str | Path = ".",
) -> DescribedArm:
    """Read the description of an arm; arguments as of `load_robot`.

    Without a tool frame, `likely_tool_frame` selects one.
    """
    directory = checked_path("directory", directory)
    folders = package_folders(package_dirs, directory)
    _require_map("xacro_args", xacro_args)
    path = find_description(urdf, directory, folders)
    if srdf is None:
        description = read_urdf(path, xacro_args, folders)
    else:
        srdf_path = find_description(srdf, directory, folders)
        uses_all = path.suffix != XACRO_ENDING and srdf_path.suffix == XACRO_ENDING
        description = read_urdf(path, None if uses_all else xacro_args, folders)
        read = read_srdf(srdf_path, xacro_args, folders, uses_all)
        notes = (*description.notes, *read.notes(description.links))
        description = replace(description, srdf=read, notes=notes)
    frame = likely_tool_frame(description) if tool_frame is None else tool_frame
    group = planning_group(description, frame, joints)
    layers = layers_of(() if limits is None else limits)
    if motors is not None:
        if not isinstance(motors, MotorOverrides):
            raise RobotError(f"motors are {shown(motors)}; give MotorOverrides")
        layers.append(LimitLayer("robot.", LimitOverrides(), motors=motors))
    return DescribedArm(description, folders, frame, group, layers)


def package_folders(value: GivenPackageDirs, directory: Path) -> PackageDirs:
    """Return package folders joined to a directory, with their names if they are a map."""
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


# ---- The links that a tool may be fixed to, and the likeliest of them.


def leaf_links(description: UrdfDescription) -> tuple[str, ...]:
    """Return the links that carry no other link, in the order of the file."""
    parents = {joint.parent for joint in description.joints.values()}
    return tuple(link for link in description.links if link not in parents)


def likely_tool_frame(description: UrdfDescription) -> str:
    """Return the link where the longest chain of movable joints ends, above its fingers.

    Fingers are the branches of a link where the chain parts, if they have fewer joints than the
    chain up to there. Of the links fixed to the end, the last of the longest row is returned; of
    rows of equal length, a link that is only a frame: no collision geometry, no inertia.
    """
    leaves = leaf_links(description)
    longest = max(leaves, key=lambda link: len(description.chain(link)))
    if not description.chain(longest):
        raise RobotError(f"{description.path}: no joint can move; there is nothing to plan")
    # The link nearest the root, on the chain, where fingers part.
    by_child = {joint.child: joint for joint in description.joints.values()}
    below, link, end = 0, longest, longest
    total = len(description.chain(longest))
    while link in by_child:
        joint = by_child[link]
        below += joint.type in MOVABLE_TYPES
        link = joint.parent
        branches = [own for own in _children(description, link) if _moves(description, own)]
        if len(branches) > 1 and 0 < below < total - below:
            end = link
    depths = dict(_fixed_links(description, end, 0))
    max_depth = max(depths.values())
    deepest = [link for link, depth in depths.items() if depth == max_depth]
    for link in deepest:
        element = description.link_element(link)
        if element.find("collision") is None and element.find("inertial") is None:
            return link
    return deepest[0]


def _children(description: UrdfDescription, link: str) -> list[str]:
    return [joint.name for joint in description.joints.values() if joint.parent == link]


def _moves(description: UrdfDescription, joint: str) -> bool:
    """Return True if a joint can move, or any joint below."""
    own = description.joints[joint]
    below = _children(description, own.child)
    return own.type in MOVABLE_TYPES or any(_moves(description, name) for name in below)


def _fixed_links(description: UrdfDescription, link: str, depth: int) -> Iterator[tuple[str, int]]:
    """Yield a link and the links fixed to it, each with its number of joints below the link."""
    yield link, depth
    for name in _children(description, link):
        joint = description.joints[name]
        if joint.type not in MOVABLE_TYPES:
            yield from _fixed_links(description, joint.child, depth + 1)
