"""RobotInfo: links, joints, candidate tool frames, each limit with its source, missing limits."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from tubeplanner.errors import RobotError
from tubeplanner.resources import PackageDirs, find_mesh
from tubeplanner.robot.joint_limits import (
    LIMITS,
    JointLimits,
    LimitLayer,
    MergedValues,
    chain_order,
    merged_limits,
    merged_scale,
    resolve_limits,
)
from tubeplanner.robot.loader import DescribedArm, described_arm, leaf_links
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.motors import merged_motors, resolve_motors
from tubeplanner.robot.notes import robot_notes
from tubeplanner.robot.overrides import CURVE, QUANTITIES, LimitOverrides
from tubeplanner.robot.pinocchio_model import locked_value
from tubeplanner.robot.urdf import STANDING_TYPES, UrdfDescription, UrdfJoint, followers_of
from tubeplanner.robot.urdf_elements import read_child, read_numbers

# ---- The links of a URDF: mass and kinds of geometry.


@dataclass(frozen=True)
class LinkInfo:
    """A link of a URDF."""

    name: str
    parent: str | None  # the joint that moves or fixes it; None for the root
    mass: float | None  # [kg]; None without <inertial>
    # number of <collision> by kind, such as "mesh" or "box"; empty: the link is never checked
    collision: dict[str, int]
    visual: dict[str, int]  # number of <visual> by kind
    is_leaf: bool  # True if it carries no other link


def link_infos(description: UrdfDescription) -> tuple[LinkInfo, ...]:
    """Return the links of a URDF, in the order of the file."""
    leaves = leaf_links(description)
    parents = {joint.child: joint.name for joint in description.joints.values()}
    infos = []
    for name in description.links:
        element = description.link_element(name)
        where, mass = f"{description.path}: link '{name}'", None
        if (inertial := element.find("inertial")) is not None:
            child = read_child(f"{where}: <inertial>", inertial, "mass")
            mass = float(read_numbers(where, child, "value", 1)[0])
        kinds = _kinds(element, "collision"), _kinds(element, "visual")
        infos.append(LinkInfo(name, parents.get(name), mass, *kinds, name in leaves))
    return tuple(infos)


def _kinds(link: Element, tag: str) -> dict[str, int]:
    return dict(Counter(shape.tag for shape in link.findall(f"{tag}/geometry/*")))


# ---- The joints of an arm: each limit with its source.
#
# A missing limit is no error here: a stand-in below all layers takes its place, and is reported as
# no limit.

NOWHERE, URDF = "none", "URDF"
INFO_LIMITS = ("position", *LIMITS)
_OF_URDF = [name for name in LIMITS if QUANTITIES[name].in_urdf != "never"]
_STAND_IN_RANGE = {"prismatic": (-1.0, 1.0), "revolute": (-np.pi, np.pi)}
_STAND_IN_RATE = 1e9  # an acceleration: `resolve_limits` refuses a joint of unbounded speed


@dataclass(frozen=True)
class SourcedValue:
    """A number and its source."""

    value: Any  # a number, or (lower, upper); None: there is none, or it is infinite
    # "URDF", "problem file", "preset NAME", "limits_file NAME", the joint that follows and bounds
    # it, or "none"; with the factor of limits.scale or the position margin
    source: str

    @property
    def is_missing(self) -> bool:
        """True if there is no source."""
        return self.source == NOWHERE


@dataclass(frozen=True)
class JointInfo:
    """A planned joint."""

    name: str
    type: str  # as in the URDF
    parent: str  # the link that carries it
    child: str  # the link that it moves
    limits: Mapping[str, SourcedValue]  # by quantity, those of `INFO_LIMITS`
    motor: Mapping[str, SourcedValue]  # by quantity, the values of the motor that have a source


def joint_infos(arm: DescribedArm) -> tuple[tuple[JointInfo, ...], JointLimits]:
    """Return the planned joints in chain order, and their limits with stand-ins."""
    description, group = arm.description, arm.group
    # Limits for the gaps of a URDF, below all layers.
    joints = [description.joints[name] for name in group]
    gaps: dict[str, Any] = {
        quantity: {j.name: np.inf for j in joints if not 0 < (getattr(j, quantity) or 0.0) < np.inf}
        for quantity in _OF_URDF
    }
    gaps["acceleration"] = dict.fromkeys(gaps["acceleration"], _STAND_IN_RATE)
    gaps["position"] = {}
    for joint in joints:
        is_endless = not np.isfinite([joint.lower, joint.upper]).all()
        if not joint.lower < joint.upper or (joint.type == "prismatic" and is_endless):
            gaps["position"][joint.name] = _STAND_IN_RANGE[joint.type]
    layers = [LimitLayer("stand-in ", LimitOverrides(**gaps), source=NOWHERE), *arm.layers]
    limits = resolve_limits(description, group, layers)
    merged = merged_limits(description, group, layers)
    motors = _motors(arm)
    infos = []
    for name in chain_order(description, group):
        joint, column = description.joints[name], group.index(name)
        values: dict[str, Any] = {
            "position": (float(limits.lower_position[column]), float(limits.upper_position[column]))
        }
        values |= {quantity: float(getattr(limits, quantity)[column]) for quantity in LIMITS}
        sourced = {
            quantity: _sourced(arm, joint, quantity, value, merged)
            for quantity, value in values.items()
        }
        infos.append(JointInfo(name, joint.type, joint.parent, joint.child, sourced, motors[name]))
    return tuple(infos), limits


def _sourced(
    arm: DescribedArm, joint: UrdfJoint, quantity: str, value: Any, merged: MergedValues
) -> SourcedValue:
    """Return the limit of a joint, a number or (lower, upper), with its source."""
    is_of_urdf = quantity == "position" or QUANTITIES[quantity].in_urdf == "required"
    default = URDF if is_of_urdf or getattr(joint, quantity, None) is not None else NOWHERE
    source = merged.sources[quantity].get(joint.name, default)
    factor = merged_scale(arm.layers).get(quantity, 1.0)
    own = merged.by_joint[quantity].get(joint.name)
    if own is None and default == URDF:
        own = (joint.lower, joint.upper) if quantity == "position" else getattr(joint, quantity)
    margin = merged.by_joint["position_margin"].get(joint.name, 0.0)
    less = f", less {margin:g}" if quantity == "position" and margin else ""
    if own is None:
        is_tighter = bool(np.isfinite(value).all())
    elif isinstance(value, tuple):
        is_tighter = value[0] > own[0] + margin or value[1] < own[1] - margin
    elif isinstance(own, Sequence | Mapping):
        source, is_tighter = f"{source}, most of a range", False
    else:
        is_tighter = value < float(own) * factor * (1 - 1e-12)
    if is_tighter:
        followers = followers_of(arm.description, [joint.name])
        return SourcedValue(value, f"follower {' or '.join(followers)}{less}")
    if source == NOWHERE or not np.isfinite(value).all():
        return SourcedValue(None, source)
    return SourcedValue(value, f"{source}{less}" if factor == 1.0 else f"{source} x {factor:g}")


def _motors(arm: DescribedArm) -> dict[str, dict[str, SourcedValue]]:
    """Return the values of motors that have a source, by joint and quantity."""
    motors = resolve_motors(arm.description, arm.group, arm.layers)
    merged = merged_motors(arm.description, arm.group, arm.layers)
    values: dict[str, dict[str, SourcedValue]] = {name: {} for name in arm.group}
    for column, name in enumerate(arm.group):
        for quantity, sources in merged.sources.items():
            value: tuple[float, float] | float
            if quantity == "coulomb_friction":
                backwards = float(motors.backwards_friction[column])
                forwards = float(motors.forwards_friction[column])
                value = backwards if backwards == forwards else (backwards, forwards)
            else:
                value = float(getattr(motors, quantity)[column])
            if name in sources:
                finite = value if np.isfinite(value).all() else None
                values[name][quantity] = SourcedValue(finite, sources[name])
            elif quantity not in CURVE and np.any(value):
                values[name][quantity] = SourcedValue(value, URDF)
    return values


# ---- A robot, and the values that it lacks for planning.


@dataclass(frozen=True)
class OtherJoint:
    """A joint that is not planned; the joint of a mobile base is among them."""

    name: str
    type: str  # as in the URDF
    follows: str | None  # the planned joint that it follows; None: it is locked
    position: float  # the locked position, or the position at its leader's zero [rad or m]
    multiplier: float | None  # its velocity over its leader's; None: it is locked
    master: str | None  # the joint that it mimics in the URDF, if any


@dataclass(frozen=True)
class RobotInfo:
    """The contents and gaps of a robot."""

    path: Path  # of the URDF
    name: str
    tool_frame: str  # the link that carries the tool
    tool_frame_is_given: bool  # False if `likely_tool_frame` selected it
    joints: tuple[JointInfo, ...]  # the planned joints in chain order
    other_joints: tuple[OtherJoint, ...]  # joints that can move and are not planned
    links: tuple[LinkInfo, ...]  # all links
    missing: tuple[str, ...]  # values that planning needs and the robot lacks, each with its remedy
    # sentences on what the files hold and planning does not use, and implausible values
    notes: tuple[str, ...]
    # kinematics and masses; efforts are unlimited, so that no mass need be there
    arm: RobotModel = field(repr=False)

    @property
    def mass(self) -> float:
        """Mass of all links together [kg]."""
        return float(sum(link.mass or 0.0 for link in self.links))

    @property
    def leaf_links(self) -> tuple[str, ...]:
        """The links that carry no other link: the likely tool frames."""
        return tuple(link.name for link in self.links if link.is_leaf)

    def as_dict(self) -> dict[str, Any]:
        """Return all fields as JSON values."""
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


_OF_MODEL = ("locked_joints", "tool_offset", "base", "gravity", "payload")


def robot_info(urdf: str | Path, tool_frame: str | None = None, **settings: Any) -> RobotInfo:
    """Return the contents and gaps of a robot; missing limits and masses are no errors.

    Args as for `load_robot`; without a tool frame, `likely_tool_frame` selects one.
    """
    of_model = {name: settings.pop(name) for name in _OF_MODEL if name in settings}
    described = described_arm(urdf, tool_frame, **settings)
    description, group = described.description, described.group
    infos, resolved = joint_infos(described)
    endless = np.full(len(group), np.inf)
    # Without effort limits the arm needs no masses.
    unlimited = replace(resolved, effort=endless, effort_rate=endless, effort_ranges=())
    arm = described.model(unlimited, None, **of_model)
    links = link_infos(description)
    # An acceleration without a source is a stand-in.
    limited = {joint.name: not joint.limits["acceleration"].is_missing for joint in infos}
    acceleration = np.where([limited[name] for name in group], resolved.acceleration, np.inf)
    motors = resolve_motors(description, group, described.layers)
    noted = arm.with_limits(replace(resolved, acceleration=acceleration), motors)
    return RobotInfo(
        path=description.path,
        name=description.name,
        tool_frame=described.tool_frame,
        tool_frame_is_given=tool_frame is not None,
        joints=infos,
        other_joints=_other_joints(description, group, arm.locked_joints),
        links=links,
        missing=(
            *_missing_limits(description, infos),
            *_missing_masses(arm, infos),
            *_missing_geometry(description, links, described.folders),
        ),
        notes=robot_notes(noted),
        arm=arm,
    )


def _other_joints(
    description: UrdfDescription, group: Sequence[str], locked: Mapping[str, float]
) -> tuple[OtherJoint, ...]:
    followers = followers_of(description, group)
    others = []
    for name in description.movable():
        joint = description.joints[name]
        master = None if joint.mimic is None else joint.mimic.master
        if name in followers:
            rule = followers[name]
            follows = (rule.master, rule.offset, rule.multiplier)
            others.append(OtherJoint(name, joint.type, *follows, master))
        elif name not in group:
            value = locked_value(description, name, group, locked)
            others.append(OtherJoint(name, joint.type, None, value, None, master))
    others += [
        OtherJoint(joint.name, joint.type, None, 0.0, None, None)
        for joint in description.joints.values()
        if joint.type in STANDING_TYPES
    ]
    return tuple(others)


def _missing_limits(description: UrdfDescription, joints: Sequence[JointInfo]) -> list[str]:
    """Return a sentence for each quantity without a limit: joints, field of the problem, unit."""
    sentences = []
    for quantity in _OF_URDF:
        unit, named = " or ".join(QUANTITIES[quantity].units), []
        for joint in joints:
            value = getattr(description.joints[joint.name], quantity)
            is_needed = QUANTITIES[quantity].in_urdf == "required" or value is not None
            if is_needed and joint.limits[quantity].is_missing:
                stated = "none" if value is None else f"{value:g}"
                named.append(f"{joint.name} (the URDF has {stated})")
        if named:
            sentences.append(
                f"{quantity} limit of {', '.join(named)}: give the maker's in "
                f"robot.limits.{quantity} [{unit}], or .inf if there is none"
            )
    ranges = [joint.name for joint in joints if joint.limits["position"].is_missing]
    if ranges:
        sentences.append(
            f"position limits of {', '.join(ranges)}: give [lower, upper] in "
            "robot.limits.position [rad or m]"
        )
    return sentences


def _missing_masses(arm: RobotModel, joints: Sequence[JointInfo]) -> list[str]:
    efforts = [joint.limits["effort"] for joint in joints]
    if all(effort.value is None and not effort.is_missing for effort in efforts):
        return []  # the problem says that no joint has an effort limit
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
    description: UrdfDescription, links: Sequence[LinkInfo], folders: PackageDirs
) -> list[str]:
    """Return a sentence if there is no collision geometry, or if meshes are not found."""
    if not any(link.collision for link in links):
        return ["collision geometry: no link has any, so nothing is checked; give <collision>"]
    errors: list[str] = []
    for link in links:
        for mesh in description.link_element(link.name).findall("collision/geometry/mesh"):
            try:
                find_mesh(str(mesh.get("filename")), description.path, folders)
            except RobotError as error:
                errors.append(str(error))
    return [f"{len(errors)} collision meshes: {errors[0]}"] if errors else []
