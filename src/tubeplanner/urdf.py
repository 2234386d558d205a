"""A URDF read strictly: structure, joints and limits, before any library sees it.

The libraries accept much broken URDF in silence, or reject it without saying why. Here every fault
is named. Limits are read here and only here; what Pinocchio gets is a plain kinematic copy.
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tubeplanner.errors import RobotError, unknown_name

MOVABLE_TYPES = ("revolute", "continuous", "prismatic")
_JOINT_TYPES = (*MOVABLE_TYPES, "fixed")
# Tags that Pinocchio's kinematic copy does not need; meshes are read by `link_geometry`.
_NOT_KINEMATIC = ("visual", "collision")


@dataclass(frozen=True)
class Mimic:
    """A joint's rule to follow another: value = multiplier * master + offset."""

    master: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class UrdfJoint:
    """One joint as the URDF gives it.

    Attributes:
        name: The joint's name.
        type: One of revolute, continuous, prismatic, fixed.
        parent: Name of the parent link.
        child: Name of the child link.
        lower: Lower position limit [rad or m], -inf where continuous.
        upper: Upper position limit [rad or m], inf where continuous.
        effort: Effort limit [N m or N], None where the URDF gives none.
        velocity: Velocity limit [rad/s or m/s], None where the URDF gives none.
        mimic: The rule by which the joint follows another, if any.
    """

    name: str
    type: str
    parent: str
    child: str
    lower: float
    upper: float
    effort: float | None
    velocity: float | None
    mimic: Mimic | None


@dataclass(frozen=True)
class UrdfDescription:
    """A robot description that passed the structural checks.

    Attributes:
        path: The file it was read from.
        name: The robot's name.
        links: Names of all links.
        joints: All joints by name, in the order of the file.
        text: The XML text of the file.
    """

    path: Path
    name: str
    links: tuple[str, ...]
    joints: dict[str, UrdfJoint]
    text: str

    def chain(self, link: str) -> list[str]:
        """Return the names of the movable joints from the root to a link, in chain order.

        Raises:
            RobotError: There is no such link.
        """
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

    def movable(self) -> list[str]:
        """Return the names of all joints that can move."""
        return [name for name, joint in self.joints.items() if joint.type in MOVABLE_TYPES]

    def kinematic_xml(self) -> str:
        """Return the XML for Pinocchio: geometry removed, every limit a finite placeholder.

        Continuous joints become revolute, so that a configuration is a plain vector (nq = nv).
        The true limits stay in `joints`.
        """
        root = ElementTree.fromstring(self.text)
        for link in root.findall("link"):
            for tag in _NOT_KINEMATIC:
                for element in link.findall(tag):
                    link.remove(element)
        for element in root.findall("joint"):
            self._plain_joint(element)
        return ElementTree.tostring(root, encoding="unicode")

    @staticmethod
    def _plain_joint(element: ElementTree.Element) -> None:
        if element.get("type") == "fixed":
            return
        if element.get("type") == "continuous":
            element.set("type", "revolute")
        for tag in ("limit", "mimic", "safety_controller", "calibration"):
            for child in element.findall(tag):
                element.remove(child)
        placeholder = {"effort": "1", "velocity": "1", "lower": "-1", "upper": "1"}
        ElementTree.SubElement(element, "limit", placeholder)


def read_urdf(path: Path) -> UrdfDescription:
    """Read a URDF and check its structure.

    Args:
        path: The file.

    Returns:
        The description; its limits are as written, not yet judged.

    Raises:
        RobotError: The XML is malformed, a name is doubled or missing, the links are no tree, or a
            number cannot be read. The message names the file and the element.
    """
    try:
        text = path.read_text(encoding="utf-8")
        root = ElementTree.fromstring(text)
    except (OSError, UnicodeDecodeError, ElementTree.ParseError) as error:
        raise RobotError(f"{path} cannot be read as URDF: {error}") from error
    if root.tag != "robot":
        raise RobotError(f"{path}: the root element is <{root.tag}>, not <robot>")
    links = [_attribute(path, element, "name") for element in root.findall("link")]
    joints = [_read_joint(path, element) for element in root.findall("joint")]
    _require_unique(path, "link", links)
    _require_unique(path, "joint", [joint.name for joint in joints])
    _require_tree(path, links, joints)
    return UrdfDescription(
        path,
        root.get("name", path.stem),
        tuple(links),
        {joint.name: joint for joint in joints},
        text,
    )


def _read_joint(path: Path, element: ElementTree.Element) -> UrdfJoint:
    name = _attribute(path, element, "name")
    where = f"{path}: joint '{name}'"
    kind = _attribute(path, element, "type")
    if kind not in _JOINT_TYPES:
        known = ", ".join(_JOINT_TYPES)
        raise RobotError(f"{where} has type '{kind}'; the types that can be planned are: {known}")
    axis = element.find("axis")
    if kind != "fixed" and axis is not None:
        _require_axis(where, axis)
    limit = element.find("limit")
    lower, upper = _read_number(where, limit, "lower"), _read_number(where, limit, "upper")
    return UrdfJoint(
        name=name,
        type=kind,
        parent=_attribute(path, _child(where, element, "parent"), "link"),
        child=_attribute(path, _child(where, element, "child"), "link"),
        lower=-np.inf if kind == "continuous" else (lower or 0.0),
        upper=np.inf if kind == "continuous" else (upper or 0.0),
        effort=_read_number(where, limit, "effort"),
        velocity=_read_number(where, limit, "velocity"),
        mimic=_read_mimic(where, element.find("mimic")),
    )


def _read_mimic(where: str, element: ElementTree.Element | None) -> Mimic | None:
    if element is None:
        return None
    master = element.get("joint")
    if master is None:
        raise RobotError(f"{where}: <mimic> names no joint")
    multiplier = _read_number(where, element, "multiplier")
    offset = _read_number(where, element, "offset")
    return Mimic(master, 1.0 if multiplier is None else multiplier, offset or 0.0)


def _read_number(where: str, element: ElementTree.Element | None, key: str) -> float | None:
    text = None if element is None else element.get(key)
    if text is None:
        return None
    try:
        value = float(text)
    except ValueError:
        raise RobotError(f'{where}: {key}="{text}" is not a number') from None
    if np.isnan(value):
        raise RobotError(f"{where}: {key} is not a number (nan)")
    return value


def _require_axis(where: str, element: ElementTree.Element) -> None:
    text = element.get("xyz", "")
    try:
        axis = [float(word) for word in text.split()]
    except ValueError:
        axis = []
    if len(axis) != 3 or not 1e-6 < float(np.linalg.norm(axis)) < np.inf:
        raise RobotError(f'{where}: axis xyz="{text}" is no direction; three numbers, not all zero')


def _attribute(path: Path, element: ElementTree.Element, key: str) -> str:
    value = element.get(key)
    if not value:
        raise RobotError(f"{path}: a <{element.tag}> element has no attribute '{key}'")
    return value


def _child(where: str, element: ElementTree.Element, tag: str) -> ElementTree.Element:
    child = element.find(tag)
    if child is None:
        raise RobotError(f"{where} has no <{tag}>")
    return child


def _require_unique(path: Path, kind: str, names: list[str]) -> None:
    doubled = sorted({name for name in names if names.count(name) > 1})
    if doubled:
        raise RobotError(
            f"{path}: {kind} '{doubled[0]}' is defined {names.count(doubled[0])} times"
        )


def _require_tree(path: Path, links: list[str], joints: list[UrdfJoint]) -> None:
    """Raise unless the links form one tree: known ends, one parent each, one root, no loop."""
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
        if sum(1 for _ in _ancestors(link, parents, len(links))) > len(links):
            raise RobotError(f"{path}: the links form a loop through '{link}'")


def _ancestors(link: str, parents: dict[str, str], limit: int) -> Iterator[str]:
    """Yield a link's ancestors, one more than `limit` of them if they go round in a loop."""
    for _ in range(limit + 1):
        if link not in parents:
            return
        link = parents[link]
        yield link
