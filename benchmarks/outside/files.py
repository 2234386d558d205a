"""What the outside judge reads of files: where they are, their fields, a robot's description.

Poses that files give, and a robot that is fixed to its cell, are read here too.
"""

import importlib.metadata
import json
import math
import os
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

EXAMPLE, PACKAGE = "example:", "package://"
OTHER_STEMS = {"iris": "iris_simple"}  # where a name means another file than that of its name
BUNDLED = Path(__file__).parents[2] / "robots"
MOVABLE = ("revolute", "continuous", "prismatic")
_CELL = "the cell in which the robot stands"


class BadInput(Exception):
    """A file cannot be judged: it is wrong, or asks for something that this judge does not know."""


def find_urdf(name: str, folder: Path, package_dirs: list[Path]) -> Path:
    """Return the path of a robot's URDF.

    Args:
        name: A path, `package://PACKAGE/...`, or `example:NAME`.
        folder: Where relative paths start.
        package_dirs: Further folders that hold packages.

    Raises:
        BadInput: There is no such file.
    """
    if name.startswith(EXAMPLE):
        return _find_example(name.removeprefix(EXAMPLE))
    return find_file(name, folder, package_dirs)


def find_file(name: str, folder: Path, package_dirs: list[Path]) -> Path:
    """Return the path of a file named by a path or by `package://PACKAGE/...`.

    Raises:
        BadInput: There is no such file.
    """
    if not name.startswith(PACKAGE):
        path = folder / name.removeprefix("file://")
        if path.is_file():
            return path.resolve()
        raise BadInput(f"{path} does not exist")
    package, _, tail = name.removeprefix(PACKAGE).partition("/")
    tail = os.path.normpath(tail.lstrip("/"))
    if tail.split("/")[0] == "..":
        raise BadInput(f"{name} leads out of its package")
    roots = [*package_dirs, folder, *folder.parents, *_environment_roots()]
    for root in roots:
        is_package = root.name == package
        for path in (root / package / tail, *([root / tail] if is_package else [])):
            if path.is_file():
                return path.resolve()
    raise BadInput(f"{name} was not found in any of {', '.join(map(str, roots))}")


@cache  # a distribution's list of files takes a tenth of a second to read
def data_share() -> Path:
    """Return the folder that holds the package example-robot-data.

    Raises:
        BadInput: It is not installed.
    """
    try:
        distribution = importlib.metadata.distribution("example-robot-data")
    except importlib.metadata.PackageNotFoundError:
        raise BadInput("example-robot-data is not installed") from None
    for file in distribution.files or []:
        if str(file).endswith("example-robot-data/package.xml"):
            return Path(str(distribution.locate_file(file))).resolve().parents[1]
    raise BadInput("the installed example-robot-data holds no package.xml")


def data_urdfs() -> list[Path]:
    """Return all URDFs of example-robot-data, in the order of their names."""
    return sorted((data_share() / "example-robot-data" / "robots").rglob("*.urdf"))


def read_document(path: Path) -> Any:
    """Return what a YAML or JSON file holds.

    Raises:
        BadInput: It cannot be read.
    """
    try:
        text = path.read_text("utf-8-sig")
        return (
            json.loads(text)
            if path.suffix == ".json"
            else YAML(typ="safe", pure=True).load(text)  # YAML 1.2, as other readers of the file
        )
    except (OSError, ValueError, YAMLError) as error:
        raise BadInput(f"{path} cannot be read: {error}") from error


def require_known(fields: Any, known: set[str], where: str) -> None:
    """Raise BadInput, which names the field, if there is one that is not known."""
    if not isinstance(fields, dict):
        raise BadInput(f"{where.rstrip('.') or 'the file'} must be a map")
    for key in fields:
        if key not in known:
            raise BadInput(f"{where}{key} is not known here, so it cannot be judged")


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
        acceleration: The smaller of acceleration and deceleration, inf before URDF 1.2.
        jerk: Limit, likewise.
    """

    kind: str
    lower: float
    upper: float
    effort: float | None
    velocity: float | None
    mimic: tuple[str, float, float] | None
    damping: float = 0.0
    friction: float = 0.0
    acceleration: float = math.inf
    jerk: float = math.inf


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
    version = source.get("version", "1.0")  # by which Pinocchio reads quaternions and capsules
    plain = ElementTree.Element("robot", name=source.get("name", path.stem), version=version)
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
            joints[name] = _joint(element, kind, has_rates=version == "1.2")
        plain.append(_plain(element, name, kind))
    links = frozenset(link.get("name", "") for link in source.findall("link"))
    return Description(ElementTree.tostring(plain, encoding="unicode"), joints, links, parents)


def placement_of(fields: dict[str, Any]) -> pin.SE3:
    """Return the pose of something with `position` and `rpy` (as in URDF) or `quaternion`."""
    position = np.array(fields.get("position") or [0.0] * 3, dtype=float)
    if fields.get("quaternion") is not None:
        x, y, z, w = fields["quaternion"]
        turn = pin.Quaternion(float(w), float(x), float(y), float(z)).normalized()
        return pin.SE3(turn.matrix(), position)
    roll, pitch, yaw = fields.get("rpy") or [0.0] * 3
    return pin.SE3(pin.rpy.rpyToMatrix(float(roll), float(pitch), float(yaw)), position)


def standing(description: Description, base: dict[str, Any]) -> Description:
    """Return a robot whose root link hangs from one more, the cell's, by a fixed joint."""
    tree = ElementTree.fromstring(description.xml)
    roots = description.links - description.parents.keys()
    place = placement_of(base)
    joint = ElementTree.Element("joint", name=f"to {_CELL}", type="fixed")
    rpy = pin.rpy.matrixToRpy(place.rotation)
    origin = {"xyz": _written(place.translation), "rpy": _written(rpy)}
    ElementTree.SubElement(joint, "origin", origin)
    ElementTree.SubElement(joint, "parent", link=_CELL)
    ElementTree.SubElement(joint, "child", link=next(iter(roots)))
    tree.extend([ElementTree.Element("link", name=_CELL), joint])
    return replace(description, xml=ElementTree.tostring(tree, encoding="unicode"))


def _find_example(name: str) -> Path:
    """Return a bundled robot, or the one URDF of example-robot-data that a name can mean.

    It is the file of that name, or of that name and `_robot`, or the only one in the folder
    `NAME_description`. Nothing is guessed beyond that: another robot's verdict would be worthless.
    """
    bundled = sorted(BUNDLED.glob(f"*/{name}.urdf"))
    found, stem = data_urdfs(), OTHER_STEMS.get(name, name)
    places = (
        bundled,
        [path for path in found if path.stem == f"{stem}_robot"],
        [path for path in found if path.stem == stem],
        [path for path in found if f"{name}_description" in path.parts],
    )
    for paths in places:
        if len(paths) == 1:
            return paths[0].resolve()
    raise BadInput(f"example:{name} is not clear; write package://example-robot-data/robots/...")


def _environment_roots() -> list[Path]:
    def entries(variable: str) -> list[str]:
        return [entry for entry in os.environ.get(variable, "").split(os.pathsep) if entry]

    roots = [Path(entry) for entry in entries("ROS_PACKAGE_PATH")]
    roots += [Path(entry) / "share" for entry in entries("AMENT_PREFIX_PATH")]
    try:
        return [data_share(), *roots]
    except BadInput:
        return roots


def _link_of(joint: ElementTree.Element, end: str) -> str:
    element = joint.find(end)
    return "" if element is None else element.get("link", "")


def _joint(element: ElementTree.Element, kind: str, has_rates: bool) -> Joint:
    limit, mimic = element.find("limit"), element.find("mimic")

    def number(key: str) -> float | None:
        text = None if limit is None else limit.get(key)
        return None if text is None else float(text)

    def least(*keys: str) -> float:
        values = [number(key) for key in keys] if has_rates else []
        return min((value for value in values if value is not None), default=math.inf)

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
        least("acceleration", "deceleration"),
        least("jerk"),
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


def _written(values: np.ndarray) -> str:
    return " ".join(repr(float(value)) for value in values)
