"""Elements of a URDF: values, versions, link checks, unknown tags, undeclared prefixes."""

import difflib
from collections.abc import Iterable, Iterator, Sequence
from xml.etree.ElementTree import Element
from xml.parsers import expat

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import RobotError, shown
from tubeplanner.orientation import matrix_of_quaternion, matrix_of_rpy, rpy_of_matrix
from tubeplanner.text import require_name

# ---- Values of URDF elements. A RobotError names each fault with its element and its text.

MAX_LENGTH = 1e4  # [m]: no arm is larger, and far beyond it distances are only rounding


def read_number(where: str, element: Element | None, key: str) -> float | None:
    """Return an attribute as a number, which is not nan; None without element or attribute."""
    text = None if element is None else element.get(key)
    value = None if text is None else _number(text)
    if text is not None and value is None:
        raise RobotError(f"{where}: {written(key, text)} is not a number")
    return value


def read_numbers(where: str, element: Element, key: str, count: int) -> FloatArray:
    """Return an attribute as a vector of finite numbers, shape (count,)."""
    text = element.get(key, "")
    numbers = [_number(word) for word in text.split()]
    values = [value for value in numbers if value is not None and np.isfinite(value)]
    if len(numbers) != count or len(values) != count:
        needed = "one finite number" if count == 1 else f"{count} finite numbers"
        raise RobotError(f"{where}: <{element.tag}> {written(key, text)} must be {needed}")
    return np.array(values)


def read_placement(where: str, element: Element) -> FloatArray:
    """Return the pose of an element's <origin>, if any, shape (4, 4)."""
    placement, origin = np.eye(4), element.find("origin")
    for key, unit in (("xyz", "m"), ("rpy", "rad")):
        if origin is None or origin.get(key) is None:
            continue
        values = read_numbers(where, origin, key, 3)
        if (largest := abs(values).max()) > MAX_LENGTH:
            raise RobotError(
                f"{where}: <origin> {key} has {largest:g} {unit}; at most {MAX_LENGTH:g} {unit} "
                "are accepted (metres and radians are meant)"
            )
        if key == "xyz":
            placement[:3, 3] = values
        else:
            placement[:3, :3] = matrix_of_rpy(*values)
    return placement


def written(key: str, text: str) -> str:
    """Return an attribute as in a file, shortened if long."""
    inner = shown(text).strip("'")
    return f'{key}="{inner}"'


def read_name(where: str, element: Element, key: str) -> str:
    """Return an attribute that holds a name: not empty, not too long, and one that can be shown."""
    value = read_attribute(where, element, key)
    return require_name(f"{where}: <{element.tag}> {key}", value, RobotError)


def read_attribute(where: str, element: Element, key: str) -> str:
    """Return an attribute that is not empty."""
    value = element.get(key)
    if not value:
        raise RobotError(f"{where}: a <{element.tag}> element has no attribute '{key}'")
    return value


def read_child(where: str, element: Element, tag: str) -> Element:
    """Return the only child with a tag."""
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


# ---- Versions of URDF, read as by urdfdom 6; quaternions, which came with 1.1, become angles.

_QUATERNION, _QUATERNION_SINCE = "quat_xyzw", "1.1"
LIMITS_SINCE = "1.2"  # acceleration, deceleration and jerk of <limit>
_VERSIONS = ("1.0", _QUATERNION_SINCE, LIMITS_SINCE)
_SAME_ROTATION = 1e-6  # largest difference of matrices


def read_version(where: str, robot: Element) -> str:
    """Return the version of a <robot>, one of those known; 1.0 without the attribute."""
    version = robot.get("version", _VERSIONS[0]).strip()
    if version not in _VERSIONS:
        raise RobotError(
            f"{where}: <robot> {written('version', version)} is unknown; URDF has "
            f"{', '.join(_VERSIONS)}"
        )
    return version


def replace_quaternions(where: str, robot: Element, version: str) -> bool:
    """Replace quat_xyzw in the <origin> of links and joints by rpy; return True if replaced.

    A quaternion of any length counts, as for urdfdom.
    """
    origins: list[tuple[str, Element]] = []
    for owner in (*robot.findall("link"), *robot.findall("joint")):
        for part in (owner, *owner.findall("*")):
            element = part.find("origin")
            if element is not None and _QUATERNION in element.attrib:
                inner = "" if part is owner else f": <{part.tag}>"
                origins.append((f"{where}: {owner.tag} '{owner.get('name')}'{inner}", element))
    for label, origin in origins:
        quaternion = read_numbers(label, origin, _QUATERNION, 4)
        attribute = f"<origin> {written(_QUATERNION, origin.attrib.pop(_QUATERNION))}"
        if not quaternion.any():
            raise RobotError(f"{label}: {attribute} has no direction; give x, y, z, w")
        matrix, rpy = matrix_of_quaternion(quaternion / abs(quaternion).max()), origin.get("rpy")
        if version >= _QUATERNION_SINCE and rpy is not None:
            raise RobotError(f"{label}: {attribute} stands beside rpy; remove one of them")
        if version < _QUATERNION_SINCE:
            angles = np.zeros(3) if rpy is None else read_numbers(label, origin, "rpy", 3)
            if abs(matrix_of_rpy(*angles) - matrix).max() > _SAME_ROTATION:
                raise RobotError(
                    f"{label}: {attribute} holds from URDF {_QUATERNION_SINCE} on, and the file is "
                    f'of version {version}; write <robot version="{_QUATERNION_SINCE}">, or rpy'
                )
        else:
            origin.set("rpy", " ".join(map(repr, rpy_of_matrix(matrix))))
    return bool(origins)


# ---- Checks of a URDF's links: a physical inertia, geometry with a size.

INERTIA = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
# The lengths of each shape, with their count of numbers.
_SIZES = {
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "capsule": {"radius": 1, "length": 1},  # between the centres of its caps
    "mesh": {},
}
# A principal moment may be negative by rounding in exported files: by a fraction of the largest, or
# by an absolute value [kg m^2].
_RELATIVE_TOLERANCE, _ABSOLUTE_TOLERANCE = 1e-3, 1e-6


def require_valid_link(where: str, link: Element) -> None:
    """Raise unless a link's inertia and collision geometry can be used."""
    if link.find("inertial") is not None:
        inertial = read_child(where, link, "inertial")
        read_placement(f"{where}: <inertial>", inertial)
        element = read_child(f"{where}: <inertial>", inertial, "mass")
        mass = read_numbers(where, element, "value", 1)[0]
        if mass < 0:
            raise RobotError(f"{where}: mass {mass:g} kg must be >= 0")
        moments = principal_moments(where, inertial)
        if moments[0] < -max(_RELATIVE_TOLERANCE * moments[-1], _ABSOLUTE_TOLERANCE):
            raise RobotError(
                f"{where}: the inertia has a principal moment of {moments[0]:.3g} kg m^2; no body "
                "has a negative one"
            )
    for collision in link.findall("collision"):
        read_placement(f"{where}: <collision>", collision)
        read_shape(where, collision)


def principal_moments(where: str, inertial: Element) -> FloatArray:
    """Return the principal moments of an <inertial>, ascending, shape (3,) [kg m^2]."""
    inertia = read_child(f"{where}: <inertial>", inertial, "inertia")
    xx, yy, zz, xy, xz, yz = (read_numbers(where, inertia, key, 1)[0] for key in INERTIA)
    return np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def read_shape(where: str, element: Element) -> tuple[str, tuple[float, ...], str]:
    """Return the kind, the sizes [m] and the file name of the shape of a <collision> or <visual>.

    The sizes of a mesh are its scale along each axis; other shapes have no file.
    """
    geometry = read_child(f"{where}: a <{element.tag}>", element, "geometry")
    shapes = list(geometry)
    if len(shapes) != 1 or shapes[0].tag not in _SIZES:
        tags = ", ".join(f"<{shape.tag}>" for shape in shapes) or "nothing"
        valid_tags = ", ".join(f"<{tag}>" for tag in _SIZES)
        raise RobotError(f"{where}: a <geometry> holds {tags}; it must hold one of {valid_tags}")
    shape, sizes = shapes[0], list[float]()
    for key, count in _SIZES[shape.tag].items():
        values = read_numbers(where, shape, key, count)
        if not ((values > 0) & (values <= MAX_LENGTH)).all():
            raise RobotError(
                f"{where}: <{shape.tag}> {written(key, str(shape.get(key)))} must be > 0 m and at "
                f"most {MAX_LENGTH:g} m"
            )
        sizes += values.tolist()
    if shape.tag != "mesh":
        return shape.tag, tuple(sizes), ""
    scale = np.ones(3)
    if (text := shape.get("scale")) is not None:
        scale = read_numbers(where, shape, "scale", 3)
        if not scale.all():
            raise RobotError(f"{where}: <mesh> {written('scale', text)} must not be 0")
    return shape.tag, tuple(scale.tolist()), read_attribute(where, shape, "filename")


# ---- Tags and attributes that URDF does not define: misspelt ones are refused, others noted.

_SOFT, _LAW = "safety_controller", "position_based_velocity_limits"
# Sections of simulators and controllers, and looks, which change no motion.
_FOREIGN = (
    *("gazebo", "material", "mujoco", "ros2_control", "sensor", "transmission"),
    *("contact", "contact_coefficients", "gravity", "hardwareInterface", "kinematic"),
    *("self_collision_checking", "surface", "verbose"),
)
_MANY = ("link", "joint", "visual", "collision", *_FOREIGN)
# Attributes and inner tags by tag; <visual> is not looked into.
_DEFINED: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "robot": (("name", "version"), ("link", "joint")),
    "link": (("name", "type"), ("inertial", "visual", "collision")),
    "inertial": ((), ("origin", "mass", "inertia")),
    "collision": (("name", "group"), ("origin", "geometry")),
    "geometry": (("name",), tuple(_SIZES)),
    **{shape: (tuple(sizes), ()) for shape, sizes in _SIZES.items()},
    "mesh": (("filename", "scale"), ()),
    "joint": (
        ("name", "type", "dont_collapse"),
        (
            *("origin", "parent", "child", "axis", "limit", "mimic", "dynamics"),
            *(_SOFT, _LAW, "calibration"),
        ),
    ),
    "origin": (("xyz", "rpy", _QUATERNION), ()),
    "mass": (("value",), ()),
    "inertia": (INERTIA, ()),
    **{end: (("link",), ()) for end in ("parent", "child")},
    "axis": (("xyz",), ()),
    "limit": (("lower", "upper", "effort", "velocity", "acceleration", "deceleration", "jerk"), ()),
    "mimic": (("joint", "multiplier", "offset"), ()),
    "dynamics": (("damping", "friction"), ()),
    _SOFT: (("k_position", "k_velocity", "soft_lower_limit", "soft_upper_limit"), ()),
}
# Any other content of them would move a frame or a joint.
_CLOSED = ("origin", "axis", "mimic")
_MISSPELT = 0.75  # least similarity of a misspelt name, from 0 to 1
_MAX_OWNERS = 3  # links or joints named with a tag


def undefined_note(where: str, robot: Element) -> str | None:
    """Return a sentence that names tags and attributes that URDF does not define, if any.

    Those with a prefix, and sections of simulators and controllers, are passed over.
    """
    owners: dict[str, list[str]] = {}
    for owner in (robot, *robot.findall("link"), *robot.findall("joint")):
        label = "" if owner is robot else f"{owner.tag} '{owner.get('name')}'"
        for each in _undefined(f"{where}: {label}".removesuffix(": "), owner, owner is robot):
            names = owners.setdefault(each, [])
            if label not in names:
                names.append(label)
    if not owners:
        return None
    listed = []
    for each, names in owners.items():
        more = len(names) - _MAX_OWNERS
        named = ", ".join(filter(None, names[:_MAX_OWNERS])) + f" and {more} more" * (more > 0)
        listed.append(f"{each} ({named})" if named else each)
    return f"URDF does not define, and nothing here uses: {'; '.join(listed)}"


def _undefined(where: str, element: Element, is_root: bool = False) -> Iterator[str]:
    """Yield tags and attributes that URDF does not define, as `<tag>` or `<tag attribute>`."""
    tag = element.tag
    if tag not in _DEFINED:
        return
    attributes, tags = _DEFINED[tag]
    for name in element.attrib:
        if "}" not in name and name not in attributes:
            others = [each for each in attributes if each not in element.attrib]
            _require_intended(f"{where}: <{tag}> has the attribute '{name}'", name, others)
            if tag in _CLOSED:
                listed = ", ".join(attributes)
                raise RobotError(f"{where}: <{tag}> has the attribute '{name}'; known are {listed}")
            yield f"<{tag} {name}>"
    counts: dict[str, int] = {}
    for child in element:
        name = child.tag
        if not isinstance(name, str) or "}" in name or name in _FOREIGN:
            continue
        counts[name] = counts.get(name, 0) + 1
        if name not in tags:
            others = [each for each in tags if each in _MANY or element.find(each) is None]
            _require_intended(f"{where}: <{tag}> has <{name}>", name, others)
            if tag in _CLOSED:
                raise RobotError(f"{where}: <{tag}> has <{name}>; it has attributes alone")
            yield f"<{name}>"
        elif counts[name] > 1 and name not in _MANY and tag != "geometry":
            raise RobotError(f"{where}: <{tag}> has {counts[name]} <{name}>; one is needed")
        elif not is_root:
            yield from _undefined(where, child)


def _require_intended(what: str, name: str, known: Sequence[str]) -> None:
    """Raise RobotError if an unknown name nearly equals a known name."""
    close = difflib.get_close_matches(name.lower(), known, n=1, cutoff=_MISSPELT)
    if close:
        raise RobotError(f"{what}; did you mean '{close[0]}'?")


# ---- Values of joints that planning does not use by default: friction, further limits.

_ENDS = ("lower", "upper")  # of a continuous joint, which has none
# By tag; soft limits count where they differ from the joint's own.
_TAGS = {
    "dynamics": ("damping", "friction"),
    "limit": ("acceleration", "deceleration", "jerk", *_ENDS),
    _SOFT: ("soft_lower_limit", "soft_upper_limit"),
    _LAW: ("deceleration_limit", "velocity_offset"),
}


def unused_values(joint: Element, used: Iterable[str] = ()) -> dict[str, str]:
    """Return the values of a <joint> that are not used, as text of the file; zeros are left out.

    Their keys are such as "dynamics damping"; `used` are the attributes of <limit> that are used.
    """
    values = {}
    used = {*used, *(() if joint.get("type") == "continuous" else _ENDS)}
    for tag, attributes in _TAGS.items():
        for element in joint.findall(tag):
            for name, text in element.attrib.items():
                # ElementTree writes {namespace}attribute.
                namespace, _, local = name.rpartition("}")
                is_used = tag == "limit" and name in used
                if local not in attributes or is_used or _is_same(text, "0"):
                    continue
                if tag == _SOFT:
                    limit = joint.find("limit")
                    end = name.removeprefix("soft_").removesuffix("_limit")
                    if _is_same(text, "0" if limit is None else limit.get(end, "0")):
                        continue
                label = f"drake:{local}" if "drake" in namespace else local
                values[f"{tag} {label}"] = text.strip()
    return values


def _is_same(text: str, other: str) -> bool:
    try:
        return float(text) == float(other)
    except ValueError:
        return False


# ---- Prefixes that a URDF uses and does not declare, as `drake:`: declared before parsing.
#
# ROS and Drake read these files, as their parsers have no namespaces; by XML they are malformed.

_NAMESPACES = {"drake": "http://drake.mit.edu", "xacro": "http://www.ros.org/wiki/xacro"}


def declare_prefixes(xml: bytes) -> tuple[bytes, dict[str, tuple[str, ...]]]:
    """Return an XML text with declarations of its undeclared prefixes added to the root.

    Args:
        xml: Any text; returned unchanged if it is malformed in another way, or in an encoding that
            does not contain ASCII.

    Returns:
        The text, and the names under each prefix that was not declared, in the order of the text.
    """
    declared = [frozenset(("xml", "xmlns"))]  # by XML itself; then by every enclosing element
    undeclared: dict[str, dict[str, None]] = {}
    parser = expat.ParserCreate()
    roots: list[tuple[int, bytes]] = []

    def enter(name: str, attributes: dict[str, str]) -> None:
        if not roots:
            roots.append((parser.CurrentByteIndex, f"<{name}".encode()))
        own = {key.removeprefix("xmlns:") for key in attributes if key.startswith("xmlns:")}
        declared.append(declared[-1] | own if own else declared[-1])
        for each in (name, *attributes):
            prefix, _, local = each.partition(":")
            if prefix and local and prefix not in declared[-1]:
                undeclared.setdefault(prefix, {})[local] = None

    parser.StartElementHandler = enter
    parser.EndElementHandler = lambda name: declared.pop()
    try:
        parser.Parse(xml, True)
    except (expat.ExpatError, LookupError, ValueError):
        return xml, {}
    begin, tag = roots[0]
    if not undeclared or not xml.startswith(tag, begin):
        return xml, {}
    end = begin + len(tag)
    declarations = "".join(
        f' xmlns:{prefix}="{_NAMESPACES.get(prefix, "undeclared:" + prefix)}"'
        for prefix in undeclared
    )
    names = {prefix: tuple(own) for prefix, own in undeclared.items()}
    return xml[:end] + declarations.encode() + xml[end:], names
