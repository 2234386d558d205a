"""UrdfDescription: links, joints, limits read strictly; <mimic> followers and leaders.

The libraries accept much broken URDF silently, or reject it without a reason. Here every error
names the fault. Limits are read only here; Pinocchio gets a plain kinematic copy.
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from tubeplanner.errors import RobotError, unknown_name
from tubeplanner.resources import PackageDirs
from tubeplanner.robot.ros_files import XACRO_ENDING, Srdf, contents, expanded, parsed_robot
from tubeplanner.robot.urdf_elements import (
    LIMITS_SINCE,
    declare_prefixes,
    read_child,
    read_name,
    read_number,
    read_numbers,
    read_placement,
    read_version,
    replace_quaternions,
    require_valid_link,
    undefined_note,
    unused_values,
    written,
)
from tubeplanner.text import require_name, short_repr

MOVABLE_TYPES = ("revolute", "continuous", "prismatic")
# A planar or floating joint carries a mobile base, which is at rest while its arm moves.
STANDING_TYPES = ("planar", "floating")
_JOINT_TYPES = (*MOVABLE_TYPES, "fixed", *STANDING_TYPES)
_RATES = ("acceleration", "deceleration", "jerk")
_MAX_LINKS = 2_000  # of an arm and its cell; kinematics of more takes minutes
# Tags that Pinocchio's kinematic copy does not need; meshes are read by `link_geometry`.
_NOT_KINEMATIC = ("visual", "collision")


@dataclass(frozen=True)
class Mimic:
    """A joint's rule to follow its master: value = multiplier * master + offset."""

    master: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class UrdfJoint:
    """A joint of a URDF."""

    name: str
    type: str  # one of revolute, continuous, prismatic, fixed, planar, floating
    parent: str  # name of the parent link
    child: str  # name of the child link
    lower: float  # lower position limit [rad or m], -inf where continuous
    upper: float  # upper position limit [rad or m], inf where continuous
    effort: float | None  # effort limit [N m or N], None where the URDF gives none
    velocity: float | None  # velocity limit [rad/s or m/s], None where the URDF gives none
    mimic: Mimic | None  # the rule by which the joint follows another, if any
    # the smaller of acceleration and deceleration limit [rad/s^2 or m/s^2]; None: there is none
    acceleration: float | None = None
    jerk: float | None = None  # jerk limit [rad/s^3 or m/s^3]; None: there is none
    # the acceleration and the deceleration limit, if they differ; else empty
    accelerations: tuple[float, ...] = ()
    # values that planning does not use, as `unused_values` returns them
    unused: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class UrdfDescription:
    """A robot description that passed the structural checks."""

    path: Path  # of the file
    name: str  # of the robot
    links: tuple[str, ...]  # names of all links
    joints: dict[str, UrdfJoint]  # all joints by name, in the order of the file
    # contents of the file, with missing declarations of prefixes, and rpy for every quaternion
    xml: bytes
    # the names under each prefix that the file does not declare
    undeclared: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()  # sentences on parts of the files that are not used
    srdf: Srdf | None = None  # the SRDF beside it; None: there is none

    __repr__ = short_repr

    def chain(self, link: str) -> list[str]:
        """Return the names of the movable joints from the root to a link, in chain order."""
        if link not in self.links:
            raise RobotError(f"{self.path}: {unknown_name('link', link, self.links)}")
        by_child = {joint.child: joint for joint in self.joints.values()}
        names: list[str] = []
        while link in by_child:
            joint = by_child[link]
            if joint.type in MOVABLE_TYPES:
                names.insert(0, joint.name)
            link = joint.parent
        return names

    @property
    def root(self) -> str:
        """Name of the link without a parent."""
        children = {joint.child for joint in self.joints.values()}
        return next(link for link in self.links if link not in children)

    def movable(self) -> list[str]:
        """Return the names of all joints that can move."""
        return [name for name, joint in self.joints.items() if joint.type in MOVABLE_TYPES]

    def link_element(self, link: str) -> ElementTree.Element:
        """Return the <link> element of a link."""
        return self._elements["link", link]

    def joint_element(self, joint: str) -> ElementTree.Element:
        """Return the <joint> element of a joint."""
        return self._elements["joint", joint]

    def kinematic_xml(self) -> str:
        """Return the XML for Pinocchio: geometry removed, every limit a finite placeholder.

        Continuous joints become revolute, so that a configuration is a plain vector (nq = nv);
        planar and floating joints become fixed. The true limits stay in `joints`. Links and joints
        are renamed by `link_id` and `joint_id`, because Pinocchio confuses equal names.
        """
        root = ElementTree.fromstring(self.xml)
        plain = ElementTree.Element("robot", name=self.name)
        for link in root.findall("link"):
            for tag in _NOT_KINEMATIC:
                for element in link.findall(tag):
                    link.remove(element)
            link.set("name", link_id(str(link.get("name"))))
            plain.append(link)
        for joint in root.findall("joint"):
            joint.set("name", joint_id(str(joint.get("name"))))
            for end in ("parent", "child"):
                for link in joint.findall(end):
                    link.set("link", link_id(str(link.get("link"))))
            if joint.get("type") in STANDING_TYPES:
                joint.set("type", "fixed")
            if joint.get("type") == "continuous":
                joint.set("type", "revolute")
            for tag in ("limit", "mimic", "safety_controller", "calibration", "dynamics"):
                for child in joint.findall(tag):
                    joint.remove(child)
            if joint.get("type") != "fixed":
                placeholder = {"effort": "1", "velocity": "1", "lower": "-1", "upper": "1"}
                ElementTree.SubElement(joint, "limit", placeholder)
            plain.append(joint)
        return ElementTree.tostring(plain, encoding="unicode")

    @cached_property
    def _elements(self) -> dict[tuple[str, str], ElementTree.Element]:
        """The elements of links and joints, by tag and name."""
        root = ElementTree.fromstring(self.xml)
        return {
            (tag, str(e.get("name"))): e for tag in ("link", "joint") for e in root.findall(tag)
        }


def link_id(name: str) -> str:
    """Return the name that a link has in `kinematic_xml`."""
    return f"link:{name}"


def joint_id(name: str) -> str:
    """Return the name that a joint has in `kinematic_xml`."""
    return f"joint:{name}"


def read_urdf(
    path: Path, xacro_args: Mapping[str, object] | None = None, package_dirs: PackageDirs = ()
) -> UrdfDescription:
    """Read a URDF and check its structure.

    Args:
        path: The file; expanded if its name ends in .xacro.
        xacro_args: Values of its arguments, by name.
        package_dirs: Further folders that hold the packages it names.

    Returns:
        The description; its limits are as written, not yet checked.

    Raises:
        RobotError: The XML is malformed, a name is doubled or missing, the links are no tree, an
            inertia or a size is impossible, a number cannot be read, or the file cannot be
            expanded. The message names the file and the element.
    """
    content = contents(path)
    if b"<!ENTITY" in content:
        raise RobotError(f"{path} declares XML entities, which are not expanded; write them out")
    if path.suffix == XACRO_ENDING:
        content = expanded(path, xacro_args or {}, package_dirs)
    elif xacro_args:
        raise RobotError(
            f"{path}: robot.xacro_args are for a file that ends in {XACRO_ENDING}; leave them out"
        )
    xml, undeclared = declare_prefixes(content)
    root = parsed_robot(path, xml, "URDF")
    version = read_version(str(path), root)
    link_count = len(root.findall("link"))
    if link_count > _MAX_LINKS:
        raise RobotError(
            f"{path} has {link_count} links; at most {_MAX_LINKS} are accepted: leave out those "
            "that do not belong to the arm"
        )
    links = [read_name(str(path), element, "name") for element in root.findall("link")]
    if not links:
        macros = ", only macros: take the file that calls them"
        raise RobotError(f"{path} holds no <link>{macros * (path.suffix == XACRO_ENDING)}")
    note = undefined_note(str(path), root)
    if replace_quaternions(str(path), root, version):
        xml = ElementTree.tostring(root)
    joints = [_read_joint(path, element, version) for element in root.findall("joint")]
    _require_unique(path, "link", links)
    _require_unique(path, "joint", [joint.name for joint in joints])
    _require_tree(path, links, joints)
    for name, element in zip(links, root.findall("link"), strict=True):
        require_valid_link(f"{path}: link '{name}'", element)
    by_name = {joint.name: joint for joint in joints}
    name = require_name(f"{path}: <robot> name", root.get("name") or path.stem, RobotError)
    notes = () if note is None else (note,)
    return UrdfDescription(path, name, tuple(links), by_name, xml, undeclared, notes)


def _read_joint(path: Path, element: ElementTree.Element, version: str) -> UrdfJoint:
    name = read_name(str(path), element, "name")
    where = f"{path}: joint '{name}'"
    kind = read_name(where, element, "type")
    if kind not in _JOINT_TYPES:
        raise RobotError(f"{where}: {unknown_name('type', kind, _JOINT_TYPES)}")
    read_placement(where, element)
    if kind in MOVABLE_TYPES:  # others carry meaningless axes in the wild
        axis = element.find("axis")
        if axis is not None:
            xyz = read_numbers(where, axis, "xyz", 3)
            if not 1e-6 < np.linalg.norm(xyz) < 1e6:
                attribute = written("xyz", str(axis.get("xyz")))
                raise RobotError(f"{where}: <axis> {attribute} is no direction")
    limit = element.find("limit")
    lower, upper = read_number(where, limit, "lower"), read_number(where, limit, "upper")
    rates: dict[str, float | None] = {}
    if version >= LIMITS_SINCE:
        rates = {key: read_number(where, limit, key) for key in _RATES}
        if lower is None or upper is None:  # this version has no default for one of them
            lower = upper = None
    up, down = (rates.get(key) for key in ("acceleration", "deceleration"))
    both = np.inf if up is None else up, np.inf if down is None else down
    return UrdfJoint(
        name=name,
        type=kind,
        parent=read_name(where, read_child(where, element, "parent"), "link"),
        child=read_name(where, read_child(where, element, "child"), "link"),
        lower=-np.inf if kind == "continuous" else (lower or 0.0),
        upper=np.inf if kind == "continuous" else (upper or 0.0),
        effort=read_number(where, limit, "effort"),
        velocity=read_number(where, limit, "velocity"),
        mimic=_read_mimic(where, element.find("mimic")),
        acceleration=None if up is None and down is None else min(both),
        jerk=rates.get("jerk"),
        accelerations=both if down not in (None, up) else (),
        unused=unused_values(element, rates),
    )


def _read_mimic(where: str, element: ElementTree.Element | None) -> Mimic | None:
    if element is None:
        return None
    multiplier = read_number(where, element, "multiplier")
    offset = read_number(where, element, "offset")
    master = read_name(where, element, "joint")
    return Mimic(master, 1.0 if multiplier is None else multiplier, offset or 0.0)


def _require_unique(path: Path, kind: str, names: list[str]) -> None:
    doubled = sorted({name for name in names if names.count(name) > 1})
    if doubled:
        raise RobotError(
            f"{path}: {kind} '{doubled[0]}' is defined {names.count(doubled[0])} times"
        )


def _require_tree(path: Path, links: list[str], joints: list[UrdfJoint]) -> None:
    """Raise unless the links form a tree: known ends, single parents, a single root, no loop."""
    parents: dict[str, str] = {}
    for joint in joints:
        for end in (joint.parent, joint.child):
            if end not in links:
                raise RobotError(
                    f"{path}: joint '{joint.name}': {unknown_name('link', end, links)}"
                )
        if joint.child in parents:
            raise RobotError(f"{path}: link '{joint.child}' is the child of more than one joint")
        parents[joint.child] = joint.parent
    roots = [link for link in links if link not in parents]
    if len(roots) != 1:
        raise RobotError(
            f"{path}: the links must hang from one root; roots found: {roots or 'none'}"
        )
    for link in links:
        ancestor, steps = link, 0
        while ancestor in parents:
            ancestor, steps = parents[ancestor], steps + 1
            if steps > len(links):
                raise RobotError(f"{path}: the links form a loop through '{link}'")


# ---- Joints that follow others by a URDF's <mimic>.


def leader_of(description: UrdfDescription, name: str) -> Mimic:
    """Return the rule by which a joint follows its leader, the end of its chain of <mimic>.

    A joint without <mimic> is its own leader.
    """
    multiplier, offset = 1.0, 0.0
    chain = [name]
    while (mimic := description.joints[chain[-1]].mimic) is not None:
        where = f"{description.path}: joint '{chain[-1]}' mimics '{mimic.master}'"
        if mimic.master not in description.joints:
            names = unknown_name("joint", mimic.master, description.joints)
            raise RobotError(f"{where}: {names}")
        if mimic.master in chain:
            raise RobotError(f"{where}: joints mimic each other in a circle")
        offset += multiplier * mimic.offset
        multiplier *= mimic.multiplier
        chain.append(mimic.master)
    return Mimic(chain[-1], multiplier, offset)


def leaders(description: UrdfDescription, names: Iterable[str]) -> list[str]:
    """Return the movable leaders of joints, in the order of the joints, each once."""
    movable = set(description.movable())
    masters = (leader_of(description, name).master for name in names)
    return [name for name in dict.fromkeys(masters) if name in movable]


def followers_of(description: UrdfDescription, group: Iterable[str]) -> dict[str, Mimic]:
    """Return the rules of the joints outside a planning group that follow its joints, by name.

    A joint whose multiplier is 0 does not move, and is left out.
    """
    planned = set(group)
    rules = {
        name: leader_of(description, name)
        for name in description.movable()
        if name not in planned and description.joints[name].mimic is not None
    }
    return {name: r for name, r in rules.items() if r.master in planned and r.multiplier != 0}
