"""RobotInfo: links, joints, candidate tool frames, each limit with its source, missing limits."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from tubeplanner.checks import given_path
from tubeplanner.errors import RobotError
from tubeplanner.resources import find_description, find_mesh
from tubeplanner.robot.joint_limits import JointLimits, resolve_limits
from tubeplanner.robot.limit_layers import (
    GivenLimits,
    LimitLayer,
    MergedLimits,
    chain_order,
    layers_of,
    merged_limits,
    merged_motors,
)
from tubeplanner.robot.loader import EARTH_GRAVITY, package_folders
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.motors import JointMotors, resolve_motors
from tubeplanner.robot.overrides import CURVE, LimitOverrides, MotorOverrides
from tubeplanner.robot.pinocchio_model import (
    BasePose,
    Payload,
    ToolOffset,
    locked_value,
    planning_group,
)
from tubeplanner.robot.urdf import (
    MOVABLE_TYPES,
    STANDING_TYPES,
    UrdfDescription,
    UrdfJoint,
    followers_of,
    read_urdf,
)
from tubeplanner.robot.urdf_elements import read_child, read_numbers

# ---- The links of a robot that a tool may be fixed to, and the likeliest of them.


def leaf_links(description: UrdfDescription) -> tuple[str, ...]:
    """Return the links from which no other hangs, in the order of the file."""
    parents = {joint.parent for joint in description.joints.values()}
    return tuple(link for link in description.links if link not in parents)


def likely_tool_frame(description: UrdfDescription) -> str:
    """Return the link where the longest chain of movable joints ends, above its fingers.

    Fingers are what hangs from a link where the chain parts, if it has fewer joints than the chain
    up to there. What hangs rigidly from the end is preferred, the last of the longest row; of equal
    ones a link that is a frame alone, without collision geometry or inertia.

    Raises:
        RobotError: No joint can move.
    """
    leaves = leaf_links(description)
    longest = max(leaves, key=lambda link: len(description.chain(link)))
    if not description.chain(longest):
        raise RobotError(f"{description.path}: no joint can move; there is nothing to plan")
    end = _above_fingers(description, longest)
    ways = dict(_rigid_ways(description, end, 0))
    deepest = max(ways.values())
    found = [link for link, depth in ways.items() if depth == deepest]
    return next((link for link in found if _is_frame(description, link)), found[0])


def _above_fingers(description: UrdfDescription, tip: str) -> str:
    """Return the highest link on the way to a tip at which fingers part; the tip if none do."""
    by_child = {joint.child: joint for joint in description.joints.values()}
    below, link, end = 0, tip, tip
    total = len(description.chain(tip))
    while link in by_child:
        joint = by_child[link]
        below += joint.type in MOVABLE_TYPES
        link = joint.parent
        branches = [own for own in _children(description, link) if _moves(description, own)]
        if len(branches) > 1 and 0 < below < total - below:
            end = link
    return end


def _children(description: UrdfDescription, link: str) -> list[str]:
    return [joint.name for joint in description.joints.values() if joint.parent == link]


def _moves(description: UrdfDescription, joint: str) -> bool:
    """Return whether a joint or one below it can move."""
    own = description.joints[joint]
    below = _children(description, own.child)
    return own.type in MOVABLE_TYPES or any(_moves(description, name) for name in below)


def _rigid_ways(description: UrdfDescription, link: str, depth: int) -> Iterator[tuple[str, int]]:
    """Yield a link and all that hang rigidly from it, each with how many joints below it."""
    yield link, depth
    for name in _children(description, link):
        joint = description.joints[name]
        if joint.type not in MOVABLE_TYPES:
            yield from _rigid_ways(description, joint.child, depth + 1)


def _is_frame(description: UrdfDescription, link: str) -> bool:
    """Return whether a link has neither geometry that collides nor mass."""
    element = description.link_element(link)
    return element.find("collision") is None and element.find("inertial") is None


# ---- What a URDF says of the links: mass, and what their geometry is made of.


@dataclass(frozen=True)
class LinkInfo:
    """One link.

    Attributes:
        name: Its name.
        parent: The joint that it hangs from; None for the root.
        mass: [kg]; None without <inertial>.
        collision: How many <collision> of each kind, such as "mesh" or "box"; empty: never checked.
        visual: How many <visual> of each kind.
        is_leaf: Whether no other link hangs from it.
    """

    name: str
    parent: str | None
    mass: float | None
    collision: dict[str, int]
    visual: dict[str, int]
    is_leaf: bool


def link_infos(description: UrdfDescription) -> tuple[LinkInfo, ...]:
    """Return what a URDF says of its links, in the order of the file."""
    leaves = leaf_links(description)
    parents = {joint.child: joint.name for joint in description.joints.values()}
    found = []
    for name in description.links:
        element = description.link_element(name)
        kinds = _kinds(element, "collision"), _kinds(element, "visual")
        mass = _mass(f"{description.path}: link '{name}'", element)
        found.append(LinkInfo(name, parents.get(name), mass, *kinds, name in leaves))
    return tuple(found)


def _kinds(link: Element, tag: str) -> dict[str, int]:
    shapes = [shape.tag for one in link.findall(tag) for shape in one.findall("geometry/*")]
    return dict(Counter(shapes))


def _mass(where: str, link: Element) -> float | None:
    inertial = link.find("inertial")
    if inertial is None:
        return None
    mass = read_child(f"{where}: <inertial>", inertial, "mass")
    return float(read_numbers(where, mass, "value", 1)[0])


# ---- What is known of the joints of an arm, limit by limit, and where each number comes from.
#
# It never fails because a limit is missing: stand-ins below all that is given take its place, and
# are shown as what they are, nothing.

NOWHERE, URDF = "none", "URDF"
LIMITS = ("position", "velocity", "effort", "acceleration", "jerk", "effort_rate")
_REQUIRED = ("velocity", "effort")
_STAND_IN_RANGE = {"prismatic": (-1.0, 1.0), "revolute": (-np.pi, np.pi)}
_STAND_IN_RATE = 1e9  # bounds the speed of a joint of which nothing else does


@dataclass(frozen=True)
class SourcedValue:
    """A number and where it comes from.

    Attributes:
        value: A number, or (lower, upper); None: there is none, or it is infinite.
        source: "URDF", "problem file", "preset NAME", "limits_file NAME", the joint that follows
            and bounds it, or "none"; with the factor of limits.scale.
    """

    value: Any
    source: str

    @property
    def is_missing(self) -> bool:
        """Whether nothing gives it."""
        return self.source == NOWHERE


@dataclass(frozen=True)
class JointInfo:
    """One planned joint.

    Attributes:
        name: Its name.
        type: As in the URDF.
        parent: The link that carries it.
        child: The link that it moves.
        limits: By quantity, those of `LIMITS`.
        motor: By quantity, what is given of the motor.
    """

    name: str
    type: str
    parent: str
    child: str
    limits: Mapping[str, SourcedValue]
    motor: Mapping[str, SourcedValue]


def joint_infos(
    description: UrdfDescription, group: Sequence[str], layers: Sequence[LimitLayer]
) -> tuple[tuple[JointInfo, ...], JointLimits]:
    """Return what is known of planned joints in chain order, and their limits with stand-ins.

    Args:
        description: The robot.
        group: Its planning group.
        layers: Limits and motors, the later ones above.

    Raises:
        RobotError: What is given is wrong, such as a joint that there is not.
    """
    standing = [_stand_ins(description, group), *layers]
    limits = resolve_limits(description, group, standing)
    merged = merged_limits(description, group, followers_of(description, group), standing)
    motors = _motors(description, group, layers)
    infos = []
    for name in chain_order(description, group):
        joint, column = description.joints[name], list(group).index(name)
        known = {
            quantity: _sourced(
                description, joint, quantity, _value(limits, quantity, column), merged
            )
            for quantity in LIMITS
        }
        infos.append(JointInfo(name, joint.type, joint.parent, joint.child, known, motors[name]))
    return tuple(infos), limits


def _stand_ins(description: UrdfDescription, group: Sequence[str]) -> LimitLayer:
    """Return limits for what a URDF lacks, to be put below all others."""
    joints = [description.joints[name] for name in group]
    lacking = {
        quantity: {j.name: np.inf for j in joints if not _is_usable(getattr(j, quantity))}
        for quantity in _REQUIRED
    }
    ranges = {joint.name: _STAND_IN_RANGE[joint.type] for joint in joints if not _has_range(joint)}
    rates = dict.fromkeys(group, _STAND_IN_RATE)
    overrides = LimitOverrides(lacking["effort"], lacking["velocity"], ranges, rates)
    return LimitLayer("stand-in ", overrides, source=NOWHERE)


def _is_usable(value: float | None) -> bool:
    return value is not None and 0 < value < np.inf


def _has_range(joint: UrdfJoint) -> bool:
    endless = not np.isfinite([joint.lower, joint.upper]).all()
    return joint.lower < joint.upper and not (joint.type == "prismatic" and endless)


def _value(limits: JointLimits, quantity: str, column: int) -> tuple[float, float] | float:
    if quantity == "position":
        return float(limits.lower_position[column]), float(limits.upper_position[column])
    return float(getattr(limits, quantity)[column])


def _sourced(
    description: UrdfDescription,
    joint: UrdfJoint,
    quantity: str,
    value: tuple[float, float] | float,
    merged: MergedLimits,
) -> SourcedValue:
    """Return a limit that holds with the source of it."""
    default = URDF if quantity in ("position", *_REQUIRED) else NOWHERE
    source = merged.sources[quantity].get(joint.name, default)
    factor = merged.scale.get(quantity, 1.0)
    own = merged.by_joint[quantity].get(joint.name)
    if own is None and default == URDF:
        own = (joint.lower, joint.upper) if quantity == "position" else getattr(joint, quantity)
    if isinstance(own, Sequence | Mapping) and quantity == "effort":
        source = f"{source}, most of a range"
    elif _is_tighter(value, own, factor):
        names = [n for n, rule in followers_of(description, [joint.name]).items()]
        return SourcedValue(value, f"follower {' or '.join(names)}")
    if source == NOWHERE or not np.isfinite(value).all():
        return SourcedValue(None, source)
    return SourcedValue(value, source if factor == 1.0 else f"{source} x {factor:g}")


def _is_tighter(value: tuple[float, float] | float, own: Any, factor: float) -> bool:
    """Return whether a limit that holds is tighter than the joint's own."""
    if own is None:
        return bool(np.isfinite(value).all())
    if isinstance(value, tuple):
        return bool(value[0] > own[0] or value[1] < own[1])
    return bool(value < float(own) * factor * (1 - 1e-12))


def _motors(
    description: UrdfDescription, group: Sequence[str], layers: Sequence[LimitLayer]
) -> dict[str, dict[str, SourcedValue]]:
    """Return what is given of the motors, by joint and quantity."""
    motors = resolve_motors(description, group, layers)
    merged = merged_motors(description, group, followers_of(description, group), layers)
    found: dict[str, dict[str, SourcedValue]] = {name: {} for name in group}
    for column, name in enumerate(group):
        for quantity, given in merged.sources.items():
            value = _motor_value(motors, quantity, column)
            if name in given:
                found[name][quantity] = SourcedValue(
                    value if np.isfinite(value).all() else None, given[name]
                )
            elif quantity not in CURVE and np.any(value):
                found[name][quantity] = SourcedValue(value, URDF)
    return found


def _motor_value(motors: JointMotors, quantity: str, column: int) -> tuple[float, float] | float:
    if quantity != "coulomb_friction":
        return float(getattr(motors, quantity)[column])
    backwards = float(motors.backwards_friction[column])
    forwards = float(motors.forwards_friction[column])
    return backwards if backwards == forwards else (backwards, forwards)


# ---- What is in a robot, and what it still lacks before an arm of it can be planned.

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
