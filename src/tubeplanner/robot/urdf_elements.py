"""Elements of a URDF: values, faults with element and text, link checks, undeclared prefixes."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from xml.etree.ElementTree import Element
from xml.parsers import expat

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import RobotError, shown
from tubeplanner.text import require_name

# ---- Values out of URDF elements, each fault named with its element and its text.

MAX_LENGTH = 1e4  # [m]: no arm is larger, and far beyond it distances are only rounding


def read_number(where: str, element: Element | None, key: str) -> float | None:
    """Return an attribute as a number; None without the element or the attribute.

    Raises:
        RobotError: The text is no number, or not a number (nan).
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
        RobotError: It is missing, has another count, or a word is no finite number.
    """
    text = element.get(key)
    what = f"{where}: <{element.tag}> {written(key, text or '')}"
    numbers = [_number(word) for word in (text or "").split()]
    values = [value for value in numbers if value is not None and np.isfinite(value)]
    if len(numbers) != count or len(values) != count:
        wanted = "one finite number" if count == 1 else f"{count} finite numbers"
        raise RobotError(f"{what} must be {wanted}")
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
    """Return an attribute as a file has it, cut where it is long."""
    inner = shown(text).strip("'")
    return f'{key}="{inner}"'


def read_name(where: str, element: Element, key: str) -> str:
    """Return an attribute that names something.

    Raises:
        RobotError: It is missing, empty, too long, or cannot be shown.
    """
    value = read_attribute(where, element, key)
    return require_name(f"{where}: <{element.tag}> {key}", value, RobotError)


def read_attribute(where: str, element: Element, key: str) -> str:
    """Return an attribute.

    Raises:
        RobotError: It is missing or empty.
    """
    value = element.get(key)
    if not value:
        raise RobotError(f"{where}: a <{element.tag}> element has no attribute '{key}'")
    return value


def read_child(where: str, element: Element, tag: str) -> Element:
    """Return the only child with a tag.

    Raises:
        RobotError: There is none, or more than one.
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

_INERTIA = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
# The lengths that give each shape its size, and how many numbers each takes.
_SIZES = {
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "mesh": {},
}
# How negative a principal moment may be, by rounding in exported files: share of the largest, and
# [kg m^2].
_INERTIA_SHARE, _INERTIA_TOLERANCE = 1e-3, 1e-6


def require_valid_link(where: str, link: Element) -> None:
    """Raise unless a link's inertia and collision geometry can be used.

    Args:
        where: What messages call the link.
        link: The <link> element.

    Raises:
        RobotError: An inertia or a size is missing, negative or no number; the message says which.
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
    inertia = read_child(f"{where}: <inertial>", inertial, "inertia")
    xx, yy, zz, xy, xz, yz = (read_numbers(where, inertia, key, 1)[0] for key in _INERTIA)
    moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if moments[0] < -max(_INERTIA_SHARE * moments[-1], _INERTIA_TOLERANCE):
        raise RobotError(
            f"{where}: the inertia has a principal moment of {moments[0]:.3g} kg m^2; no body has "
            "a negative one"
        )


def _require_geometry(where: str, geometry: Element) -> None:
    shapes = list(geometry)
    if len(shapes) != 1 or shapes[0].tag not in _SIZES:
        found = ", ".join(f"<{shape.tag}>" for shape in shapes) or "nothing"
        known = ", ".join(f"<{tag}>" for tag in _SIZES)
        raise RobotError(f"{where}: a <geometry> holds {found}; it must hold one of {known}")
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


# ---- What the joints of a URDF say and planning does not use unasked: friction, further limits.

_SOFT = "safety_controller"
# By tag; soft limits count where they differ from the joint's own.
_TAGS = {
    "dynamics": ("damping", "friction"),
    "limit": ("acceleration", "jerk"),
    _SOFT: ("soft_lower_limit", "soft_upper_limit"),
    "position_based_velocity_limits": ("deceleration_limit", "velocity_offset"),
}


def unused_values(joint: Element) -> dict[str, str]:
    """Return the values of a <joint> that are not used, as the file writes them; zeros left out.

    Args:
        joint: The element.

    Returns:
        By "tag attribute", such as "dynamics damping" or "limit drake:acceleration".
    """
    return {
        f"{tag} {_shown(name)}": text.strip()
        for tag, known in _TAGS.items()
        for element in joint.findall(tag)
        for name, text in element.attrib.items()
        if name.rpartition("}")[2] in known
        and not _is_same(text, "0")
        and not (tag == _SOFT and _is_same(text, _hard_limit(joint, name)))
    }


def _shown(name: str) -> str:
    """Return an attribute's name; ElementTree puts a namespace into braces before it."""
    namespace, _, local = name.rpartition("}")
    return f"drake:{local}" if "drake" in namespace else local


def _hard_limit(joint: Element, soft: str) -> str:
    """Return what <limit> says where <safety_controller> has a soft limit; 0 if nothing."""
    limit = joint.find("limit")
    name = soft.removeprefix("soft_").removesuffix("_limit")
    return "0" if limit is None else limit.get(name, "0")


def _is_same(text: str, other: str) -> bool:
    try:
        return float(text) == float(other)
    except ValueError:
        return False


# ---- Prefixes that a URDF uses and does not declare, as `drake:`: declared before anything parses
# it.
#
# Parsers without namespaces, as those of ROS and Drake, read such files; by XML they are malformed.

_NAMESPACES = {
    "drake": "http://drake.mit.edu",
    "xacro": "http://www.ros.org/wiki/xacro",
}
_KNOWN = ("xml", "xmlns")  # declared by XML itself


@dataclass(frozen=True)
class DeclaredXml:
    """An XML text whose prefixes are all declared.

    Attributes:
        xml: The text; the given one if nothing was missing.
        undeclared: The names under each prefix that was not declared, in the order of the text.
    """

    xml: bytes
    undeclared: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


def declare_prefixes(xml: bytes) -> DeclaredXml:
    """Return an XML text with declarations added to its root for the prefixes that lack one.

    Args:
        xml: Any text; what is malformed in another way, or is in an encoding that ASCII is no part
            of, is returned as it is.
    """
    seen = _Prefixes()
    parser = expat.ParserCreate()
    roots: list[tuple[int, bytes]] = []

    def start(name: str, attributes: dict[str, str]) -> None:
        if not roots:
            roots.append((parser.CurrentByteIndex, f"<{name}".encode()))
        seen.enter(name, attributes)

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda name: seen.leave()
    try:
        parser.Parse(xml, True)
    except (expat.ExpatError, LookupError, ValueError):
        return DeclaredXml(xml)
    begin, tag = roots[0]
    if not seen.undeclared or not xml.startswith(tag, begin):
        return DeclaredXml(xml)
    end = begin + len(tag)
    found = {prefix: tuple(names) for prefix, names in seen.undeclared.items()}
    return DeclaredXml(xml[:end] + "".join(map(_declaration, found)).encode() + xml[end:], found)


def _declaration(prefix: str) -> str:
    return f' xmlns:{prefix}="{_NAMESPACES.get(prefix, "undeclared:" + prefix)}"'


class _Prefixes:
    """Collects names under prefixes that no element around them declares."""

    def __init__(self) -> None:
        self.undeclared: dict[str, dict[str, None]] = {}
        self._declared: list[frozenset[str]] = [frozenset(_KNOWN)]

    def enter(self, name: str, attributes: Mapping[str, str]) -> None:
        """Enter an element."""
        own = {key.removeprefix("xmlns:") for key in attributes if key.startswith("xmlns:")}
        self._declared.append(self._declared[-1] | own if own else self._declared[-1])
        for prefix, local in _prefixed((name, *attributes)):
            if prefix not in self._declared[-1]:
                self.undeclared.setdefault(prefix, {})[local] = None

    def leave(self) -> None:
        """Leave the element entered last."""
        self._declared.pop()


def _prefixed(names: tuple[str, ...]) -> Iterator[tuple[str, str]]:
    """Yield prefix and local name of those that have both."""
    for name in names:
        prefix, _, local = name.partition(":")
        if prefix and local:
            yield prefix, local
