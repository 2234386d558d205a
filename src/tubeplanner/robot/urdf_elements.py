"""Elements of a URDF: values, faults with element and text, link checks, undeclared prefixes."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from xml.etree.ElementTree import Element
from xml.parsers import expat

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import RobotError, shown
from tubeplanner.text import require_name

# ---- Values of URDF elements; each fault is named with its element and its text.

MAX_LENGTH = 1e4  # [m]: no arm is larger, and far beyond it distances are only rounding


def read_number(where: str, element: Element | None, key: str) -> float | None:
    """Return an attribute as a number; None without the element or the attribute.

    Raises:
        RobotError: The text is no number, or nan.
    """
    text = None if element is None else element.get(key)
    if text is None:
        return None
    value = _number(text)
    if value is None:
        raise RobotError(f"{where}: {written(key, text)} is not a number")
    return value


def read_numbers(where: str, element: Element, key: str, count: int) -> FloatArray:
    """Return an attribute as a vector of finite numbers, shape (count,).

    Raises:
        RobotError: The attribute is missing, has another count, or a word is no finite number.
    """
    text = element.get(key, "")
    numbers = [_number(word) for word in text.split()]
    values = [value for value in numbers if value is not None and np.isfinite(value)]
    if len(numbers) != count or len(values) != count:
        needed = "one finite number" if count == 1 else f"{count} finite numbers"
        raise RobotError(f"{where}: <{element.tag}> {written(key, text)} must be {needed}")
    return np.array(values)


def require_origin(where: str, element: Element) -> None:
    """Raise unless an element's <origin>, if any, has three sensible numbers in xyz and in rpy."""
    origin = element.find("origin")
    for key, unit in (("xyz", "m"), ("rpy", "rad")):
        if origin is None or origin.get(key) is None:
            continue
        largest = abs(read_numbers(where, origin, key, 3)).max()
        if largest > MAX_LENGTH:
            raise RobotError(
                f"{where}: <origin> {key} has {largest:g} {unit}; at most {MAX_LENGTH:g} {unit} "
                "are accepted (metres and radians are meant)"
            )


def written(key: str, text: str) -> str:
    """Return an attribute as in a file, shortened if long."""
    inner = shown(text).strip("'")
    return f'{key}="{inner}"'


def read_name(where: str, element: Element, key: str) -> str:
    """Return an attribute that holds a name.

    Raises:
        RobotError: The name is missing, empty, too long, or cannot be shown.
    """
    value = read_attribute(where, element, key)
    return require_name(f"{where}: <{element.tag}> {key}", value, RobotError)


def read_attribute(where: str, element: Element, key: str) -> str:
    """Return an attribute.

    Raises:
        RobotError: The attribute is missing or empty.
    """
    value = element.get(key)
    if not value:
        raise RobotError(f"{where}: a <{element.tag}> element has no attribute '{key}'")
    return value


def read_child(where: str, element: Element, tag: str) -> Element:
    """Return the only child with a tag.

    Raises:
        RobotError: There is no child, or more than one.
    """
    children = element.findall(tag)
    if len(children) != 1:
        count = "no" if not children else str(len(children))
        raise RobotError(f"{where} has {count} <{tag}>; one is needed")
    return children[0]


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return None if np.isnan(value) else value


# ---- Checks of a URDF's links: a physical inertia, geometry with a size.

INERTIA = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
# The lengths of each shape, with their count of numbers.
_SIZES = {
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "mesh": {},
}
# A principal moment may be negative by rounding in exported files: by a fraction of the largest, or
# by an absolute value [kg m^2].
_RELATIVE_TOLERANCE, _ABSOLUTE_TOLERANCE = 1e-3, 1e-6


def require_valid_link(where: str, link: Element) -> None:
    """Raise unless a link's inertia and collision geometry can be used.

    Args:
        where: Label of the link in messages.
        link: The <link> element.

    Raises:
        RobotError: An inertia or a size is missing, negative or no number.
    """
    if link.find("inertial") is not None:
        _require_inertia(where, read_child(where, link, "inertial"))
    for collision in link.findall("collision"):
        require_origin(f"{where}: <collision>", collision)
        _require_geometry(where, read_child(f"{where}: a <collision>", collision, "geometry"))


def _require_inertia(where: str, inertial: Element) -> None:
    require_origin(f"{where}: <inertial>", inertial)
    mass = read_numbers(where, read_child(f"{where}: <inertial>", inertial, "mass"), "value", 1)[0]
    if mass < 0:
        raise RobotError(f"{where}: mass {mass:g} kg must be >= 0")
    moments = principal_moments(where, inertial)
    if moments[0] < -max(_RELATIVE_TOLERANCE * moments[-1], _ABSOLUTE_TOLERANCE):
        raise RobotError(
            f"{where}: the inertia has a principal moment of {moments[0]:.3g} kg m^2; no body has "
            "a negative one"
        )


def principal_moments(where: str, inertial: Element) -> FloatArray:
    """Return the principal moments of an <inertial>, ascending, shape (3,) [kg m^2].

    Raises:
        RobotError: A number is missing or not finite.
    """
    inertia = read_child(f"{where}: <inertial>", inertial, "inertia")
    xx, yy, zz, xy, xz, yz = (read_numbers(where, inertia, key, 1)[0] for key in INERTIA)
    return np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _require_geometry(where: str, geometry: Element) -> None:
    shapes = list(geometry)
    if len(shapes) != 1 or shapes[0].tag not in _SIZES:
        tags = ", ".join(f"<{shape.tag}>" for shape in shapes) or "nothing"
        valid_tags = ", ".join(f"<{tag}>" for tag in _SIZES)
        raise RobotError(f"{where}: a <geometry> holds {tags}; it must hold one of {valid_tags}")
    shape = shapes[0]
    for key, count in _SIZES[shape.tag].items():
        sizes = read_numbers(where, shape, key, count)
        if not ((sizes > 0) & (sizes <= MAX_LENGTH)).all():
            raise RobotError(
                f"{where}: <{shape.tag}> {written(key, str(shape.get(key)))} must be > 0 m and at "
                f"most {MAX_LENGTH:g} m"
            )
    if shape.tag == "mesh":
        read_attribute(where, shape, "filename")
        scale = shape.get("scale")
        if scale is not None and not read_numbers(where, shape, "scale", 3).all():
            raise RobotError(f"{where}: <mesh> {written('scale', scale)} must not be 0")


# ---- Values of joints that planning does not use by default: friction, further limits.

_SOFT = "safety_controller"
# By tag; soft limits count where they differ from the joint's own.
_TAGS = {
    "dynamics": ("damping", "friction"),
    "limit": ("acceleration", "jerk"),
    _SOFT: ("soft_lower_limit", "soft_upper_limit"),
    "position_based_velocity_limits": ("deceleration_limit", "velocity_offset"),
}


def unused_values(joint: Element) -> dict[str, str]:
    """Return the values of a <joint> that are not used, as text of the file; zeros are left out.

    Args:
        joint: The element.

    Returns:
        By "tag attribute", such as "dynamics damping" or "limit drake:acceleration".
    """
    values = {}
    for tag, attributes in _TAGS.items():
        for element in joint.findall(tag):
            for name, text in element.attrib.items():
                # ElementTree writes {namespace}attribute.
                namespace, _, local = name.rpartition("}")
                if local not in attributes or _is_same(text, "0"):
                    continue
                if tag == _SOFT and _is_same(text, _hard_limit(joint, name)):
                    continue
                label = f"drake:{local}" if "drake" in namespace else local
                values[f"{tag} {label}"] = text.strip()
    return values


def _hard_limit(joint: Element, soft: str) -> str:
    """Return the text of the <limit> beside a soft limit; "0" if there is no limit."""
    limit = joint.find("limit")
    name = soft.removeprefix("soft_").removesuffix("_limit")
    return "0" if limit is None else limit.get(name, "0")


def _is_same(text: str, other: str) -> bool:
    try:
        return float(text) == float(other)
    except ValueError:
        return False


# ---- Prefixes that a URDF uses and does not declare, as `drake:`: declared before parsing.
#
# ROS and Drake read these files, as their parsers have no namespaces; by XML they are malformed.

_NAMESPACES = {
    "drake": "http://drake.mit.edu",
    "xacro": "http://www.ros.org/wiki/xacro",
}
_PREDEFINED = ("xml", "xmlns")  # by XML itself


@dataclass(frozen=True)
class DeclaredXml:
    """An XML text with all its prefixes declared.

    Attributes:
        xml: The text; unchanged if all prefixes were declared.
        undeclared: The names under each prefix that was not declared, in the order of the text.
    """

    xml: bytes
    undeclared: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


def declare_prefixes(xml: bytes) -> DeclaredXml:
    """Return an XML text with declarations of its undeclared prefixes added to the root.

    Args:
        xml: Any text; returned unchanged if it is malformed in another way, or in an encoding that
            does not contain ASCII.
    """
    prefixes = _Prefixes()
    parser = expat.ParserCreate()
    roots: list[tuple[int, bytes]] = []

    def start(name: str, attributes: dict[str, str]) -> None:
        if not roots:
            roots.append((parser.CurrentByteIndex, f"<{name}".encode()))
        prefixes.enter(name, attributes)

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda name: prefixes.leave()
    try:
        parser.Parse(xml, True)
    except (expat.ExpatError, LookupError, ValueError):
        return DeclaredXml(xml)
    begin, tag = roots[0]
    if not prefixes.undeclared or not xml.startswith(tag, begin):
        return DeclaredXml(xml)
    end = begin + len(tag)
    undeclared = {prefix: tuple(names) for prefix, names in prefixes.undeclared.items()}
    declarations = "".join(
        f' xmlns:{prefix}="{_NAMESPACES.get(prefix, "undeclared:" + prefix)}"'
        for prefix in undeclared
    )
    return DeclaredXml(xml[:end] + declarations.encode() + xml[end:], undeclared)


class _Prefixes:
    """Collects names under prefixes that no enclosing element declares."""

    def __init__(self) -> None:
        self.undeclared: dict[str, dict[str, None]] = {}
        self._declared: list[frozenset[str]] = [frozenset(_PREDEFINED)]

    def enter(self, name: str, attributes: Mapping[str, str]) -> None:
        """Enter an element."""
        own = {key.removeprefix("xmlns:") for key in attributes if key.startswith("xmlns:")}
        self._declared.append(self._declared[-1] | own if own else self._declared[-1])
        for each in (name, *attributes):
            prefix, _, local = each.partition(":")
            if prefix and local and prefix not in self._declared[-1]:
                self.undeclared.setdefault(prefix, {})[local] = None

    def leave(self) -> None:
        """Leave the innermost element."""
        self._declared.pop()
