"""A URDF made ready for Pinocchio: only what moves, what has mass, and what can collide."""

import math
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

from outside.files import BadInput, find_file

MOVABLE = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True)
class Joint:
    """A movable joint.

    Attributes:
        kind: revolute, continuous or prismatic.
        lower: Position limit, -inf if continuous [rad or m].
        upper: Likewise.
        effort: Limit, None if there is none [N m or N].
        velocity: Limit, None if there is none [rad/s or m/s].
        mimic: (master, multiplier, offset), or None.
        damping: Of `<dynamics>`, 0 if there is none [N m s/rad or N s/m].
        friction: Likewise [N m or N].
    """

    kind: str
    lower: float
    upper: float
    effort: float | None
    velocity: float | None
    mimic: tuple[str, float, float] | None
    damping: float = 0.0
    friction: float = 0.0


@dataclass(frozen=True)
class Description:
    """A URDF.

    Attributes:
        xml: For Pinocchio: all joints revolute, prismatic or fixed, named `joint:NAME` (its links
            and joints share one name space), mimics free, meshes by absolute paths.
        joints: Movable joints by name, in the order of the file.
        links: Names of all links.
        parents: Link to (joint above it, its type, the link above that).
    """

    xml: str
    joints: dict[str, Joint]
    links: frozenset[str]
    parents: dict[str, tuple[str, str, str]]

    def chain(self, link: str) -> list[str]:
        """Return the movable joints from the root to a link."""
        names: list[str] = []
        while link in self.parents:
            joint, kind, link = self.parents[link]
            if kind in MOVABLE:
                names.insert(0, joint)
        return names


def read_description(path: Path, package_dirs: list[Path]) -> Description:
    """Read a URDF.

    Raises:
        BadInput: It cannot be read, or a mesh is missing.
    """
    try:
        source = ElementTree.parse(path).getroot()
    except (OSError, ElementTree.ParseError) as error:
        raise BadInput(f"{path} cannot be read as URDF: {error}") from error
    plain = ElementTree.Element("robot", name=source.get("name", path.stem))
    joints: dict[str, Joint] = {}
    parents: dict[str, tuple[str, str, str]] = {}
    for link in source.findall("link"):
        for visual in link.findall("visual"):
            link.remove(visual)
        for mesh in link.iter("mesh"):
            mesh.set(
                "filename", str(find_file(mesh.get("filename", ""), path.parent, package_dirs))
            )
        plain.append(link)
    for element in source.findall("joint"):
        name, kind = element.get("name", ""), element.get("type", "")
        parent, child = (_link_of(element, end) for end in ("parent", "child"))
        parents[child] = (name, kind, parent)
        if kind in MOVABLE:
            joints[name] = _joint(element, kind)
        plain.append(_plain(element, name, kind))
    links = frozenset(link.get("name", "") for link in source.findall("link"))
    return Description(ElementTree.tostring(plain, encoding="unicode"), joints, links, parents)


def _link_of(joint: ElementTree.Element, end: str) -> str:
    element = joint.find(end)
    return "" if element is None else element.get("link", "")


def _joint(element: ElementTree.Element, kind: str) -> Joint:
    limit, mimic = element.find("limit"), element.find("mimic")

    def number(key: str) -> float | None:
        text = None if limit is None else limit.get(key)
        return None if text is None else float(text)

    continuous = kind == "continuous"
    rule = None
    if mimic is not None:
        factor, offset = (float(mimic.get(k, d)) for k, d in (("multiplier", 1), ("offset", 0)))
        rule = (mimic.get("joint", ""), factor, offset)
    dynamics = element.find("dynamics")
    stated = {} if dynamics is None else dynamics.attrib
    return Joint(
        kind,
        -math.inf if continuous else number("lower") or 0.0,
        math.inf if continuous else number("upper") or 0.0,
        number("effort"),
        number("velocity"),
        rule,
        *(float(stated.get(key, 0.0)) for key in ("damping", "friction")),
    )


def _plain(element: ElementTree.Element, name: str, kind: str) -> ElementTree.Element:
    """Return a joint for Pinocchio: a configuration is then a plain vector of joint values."""
    plain = ElementTree.Element("joint", name=f"joint:{name}")
    plain.set("type", {"continuous": "revolute"}.get(kind, kind) if kind in MOVABLE else "fixed")
    for tag in ("origin", "parent", "child", "axis"):
        plain.extend(element.findall(tag))
    if kind in MOVABLE:
        placeholder = {"effort": "1", "velocity": "1", "lower": "-1", "upper": "1"}
        ElementTree.SubElement(plain, "limit", placeholder)
    return plain
