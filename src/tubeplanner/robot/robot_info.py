"""What is in a robot, and what it still lacks before an arm of it can be planned."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from tubeplanner.arguments import given_path
from tubeplanner.errors import RobotError
from tubeplanner.resources import find_description, find_mesh
from tubeplanner.robot.base_pose import BasePose
from tubeplanner.robot.followers import followers_of
from tubeplanner.robot.joint_info import JointInfo, joint_infos
from tubeplanner.robot.joint_limits import JointLimits
from tubeplanner.robot.limit_layers import GivenLimits, LimitLayer, layers_of
from tubeplanner.robot.limit_overrides import LimitOverrides
from tubeplanner.robot.link_info import LinkInfo, link_infos
from tubeplanner.robot.motor_overrides import MotorOverrides
from tubeplanner.robot.pinocchio_model import Payload, ToolOffset, locked_value, planning_group
from tubeplanner.robot.robot_loader import EARTH_GRAVITY, package_folders
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.robot.tool_frames import likely_tool_frame
from tubeplanner.robot.urdf import STANDING_TYPES, UrdfDescription, read_urdf

_UNITS = {"velocity": "rad/s or m/s", "effort": "N m or N"}


@dataclass(frozen=True)
class OtherJoint:
    """A joint that is not planned; of a mobile base, the one that carries it.

    Attributes:
        name: Its name.
        type: As in the URDF.
        follows: The planned joint that it follows; None: it is locked.
        position: Where it is locked, or where its leader's zero puts it [rad or m].
        multiplier: How fast it follows; None where it is locked.
        master: The joint that the URDF says it mimics, if any.
    """

    name: str
    type: str
    follows: str | None
    position: float
    multiplier: float | None
    master: str | None


@dataclass(frozen=True)
class RobotInfo:
    """What is in a robot.

    Attributes:
        path: Its URDF.
        name: Its name.
        tool_frame: The link that carries the tool.
        tool_frame_is_given: Whether it was named, rather than found by `likely_tool_frame`.
        joints: The planned joints in chain order.
        other_joints: Joints that can move and are not planned.
        links: All links.
        missing: What must be given before it is planned, and how.
        notes: What in files of limits was not used.
        arm: Its kinematics and masses, whatever limits are missing: efforts have none.
    """

    path: Path
    name: str
    tool_frame: str
    tool_frame_is_given: bool
    joints: tuple[JointInfo, ...]
    other_joints: tuple[OtherJoint, ...]
    links: tuple[LinkInfo, ...]
    missing: tuple[str, ...]
    notes: tuple[str, ...]
    arm: RobotModel = field(repr=False)

    @property
    def mass(self) -> float:
        """Mass of all links together [kg]."""
        return float(sum(link.mass or 0.0 for link in self.links))

    @property
    def leaf_links(self) -> tuple[str, ...]:
        """The links from which no other hangs: the likely tool frames."""
        return tuple(link.name for link in self.links if link.is_leaf)

    def as_dict(self) -> dict[str, Any]:
        """Return all of it as JSON values."""
        values = {
            name: getattr(self, name)
            for name in ("name", "tool_frame", "tool_frame_is_given", "mass", "missing", "notes")
        }
        listed = {
            name: [asdict(each) for each in getattr(self, name)]
            for name in ("joints", "other_joints", "links")
        }
        base = None if self.arm.base is None else asdict(self.arm.base)
        placed = {"root_link": self.arm.urdf.root, "base": base, "leaf_links": self.leaf_links}
        return {"urdf": str(self.path), **values, **placed, **listed}


def robot_info(
    urdf: str | Path,
    tool_frame: str | None = None,
    *,
    joints: Sequence[str] | None = None,
    locked_joints: Mapping[str, float] | None = None,
    tool_offset: ToolOffset | None = None,
    base: BasePose | None = None,
    gravity: Sequence[float] = EARTH_GRAVITY,
    payload: Payload | None = None,
    limits: GivenLimits | None = None,
    motors: MotorOverrides | None = None,
    package_dirs: Sequence[str | Path] = (),
    xacro_args: Mapping[str, object] | None = None,
    directory: str | Path = ".",
) -> RobotInfo:
    """Return what is in a robot, whatever limits and masses are missing.

    Args as for `load_robot`; without a tool frame the likely one is taken.

    Raises:
        RobotError: The URDF is malformed, no joint can move, or what is given does not fit it.
    """
    directory = given_path("directory", directory)
    folders = package_folders(package_dirs, directory)
    description = read_urdf(find_description(urdf, directory, folders), xacro_args, folders)
    frame = likely_tool_frame(description) if tool_frame is None else tool_frame
    group = planning_group(description, frame, joints)
    layers = layers_of(limits or ())
    if motors is not None:
        layers = [*layers, LimitLayer("robot.", LimitOverrides(), motors=motors)]
    infos, resolved = joint_infos(description, group, layers)
    locked = dict(locked_joints or {})
    arm = RobotModel(
        description,
        tuple(group),
        frame,
        tool_offset or ToolOffset(),
        _without_efforts(resolved),
        folders,
        locked,
        tuple(gravity),
        payload,
        base=base,
    )
    links = link_infos(description)
    return RobotInfo(
        path=description.path,
        name=description.name,
        tool_frame=frame,
        tool_frame_is_given=tool_frame is not None,
        joints=infos,
        other_joints=_other_joints(description, group, locked),
        links=links,
        missing=(
            *_missing_limits(description, infos),
            *_missing_masses(arm, infos),
            *_missing_geometry(description, links, folders),
        ),
        notes=resolved.notes,
        arm=arm,
    )


def _without_efforts(limits: JointLimits) -> JointLimits:
    """Return limits that ask no efforts, and so no masses."""
    endless = np.full(len(limits.effort), np.inf)
    return replace(limits, effort=endless, effort_rate=endless, effort_ranges=())


def _other_joints(
    description: UrdfDescription, group: Sequence[str], locked: Mapping[str, float]
) -> tuple[OtherJoint, ...]:
    followers = followers_of(description, group)
    found = []
    for name in description.movable():
        joint = description.joints[name]
        master = None if joint.mimic is None else joint.mimic.master
        if name in followers:
            rule = followers[name]
            where = (rule.master, rule.offset, rule.multiplier)
            found.append(OtherJoint(name, joint.type, *where, master))
        elif name not in group:
            value = locked_value(description, name, group, locked)
            found.append(OtherJoint(name, joint.type, None, value, None, master))
    found += [
        OtherJoint(joint.name, joint.type, None, 0.0, None, None)
        for joint in description.joints.values()
        if joint.type in STANDING_TYPES
    ]
    return tuple(found)


def _missing_limits(description: UrdfDescription, joints: Sequence[JointInfo]) -> list[str]:
    """Return what limits are to be given, of which joints, and where."""
    found = []
    for quantity, unit in _UNITS.items():
        named = [
            f"{joint.name} ({_in_urdf(getattr(description.joints[joint.name], quantity))})"
            for joint in joints
            if joint.limits[quantity].is_missing
        ]
        if named:
            found.append(
                f"{quantity} limit of {', '.join(named)}: give the maker's in "
                f"robot.limits.{quantity} [{unit}], or .inf if there is none"
            )
    ranges = [joint.name for joint in joints if joint.limits["position"].is_missing]
    if ranges:
        found.append(
            f"position limits of {', '.join(ranges)}: give [lower, upper] in "
            "robot.limits.position [rad or m]"
        )
    return found


def _in_urdf(value: float | None) -> str:
    return "the URDF has none" if value is None else f"the URDF has {value:g}"


def _missing_masses(arm: RobotModel, joints: Sequence[JointInfo]) -> list[str]:
    efforts = [joint.limits["effort"] for joint in joints]
    if all(effort.value is None and not effort.is_missing for effort in efforts):
        return []  # on purpose, no joint has an effort limit
    of_joint = arm.body_joints
    without = [
        arm.joint_names[int(of_joint[body])]
        for body in range(1, arm.body_count)
        if not arm.inertias[body].mass > 0
    ]
    if not without:
        return []
    return [
        f"mass of what {', '.join(dict.fromkeys(without))} moves: give the links an <inertial>, or "
        "plan without efforts by robot.limits.effort: .inf"
    ]


def _missing_geometry(
    description: UrdfDescription, links: Sequence[LinkInfo], folders: tuple[Path, ...]
) -> list[str]:
    """Return what collision geometry is missing: all of it, or meshes that are not found."""
    if not any(link.collision for link in links):
        return ["collision geometry: no link has any, so nothing is checked; give <collision>"]
    lost: list[str] = []
    for link in links:
        for mesh in description.link_element(link.name).findall("collision/geometry/mesh"):
            try:
                find_mesh(str(mesh.get("filename")), description.path, folders)
            except RobotError as error:
                lost.append(str(error))
    return [f"{len(lost)} collision meshes: {lost[0]}"] if lost else []
