"""Notes on a robot: unused parts of its files, limits by direction, implausible values."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import RobotError, shown
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.motors import URDF_FRICTION, urdf_friction
from tubeplanner.robot.urdf_elements import INERTIA, principal_moments, read_child, read_numbers

_MAX_NAMES = 8  # under a prefix
_IMPLAUSIBLE = 1 / 3  # geared arms lose up to 27 % (UR10, identified)
_EQUAL = 1e-3  # relative: joints of equal fractions are named together
# Fields of the problem by the URDF's names; a value given there makes the URDF's irrelevant.
_FIELDS = {
    "acceleration": "robot.limits.acceleration",
    "deceleration": "robot.limits.acceleration",
    "jerk": "robot.limits.jerk",
    "deceleration_limit": "robot.limits.velocity_by_position",
    "velocity_offset": "robot.limits.velocity_by_position",
    "limit lower": "robot.limits.position",
    "limit upper": "robot.limits.position",
    **dict.fromkeys(URDF_FRICTION, "robot.motors.friction_from_urdf: true"),
}


def robot_notes(robot: RobotModel) -> tuple[str, ...]:
    """Return sentences for the user; none if all is well."""
    prefix_notes = []
    for prefix, names in robot.urdf.undeclared.items():
        named = [shown(f"{prefix}:{name}").strip("'") for name in names]
        prefix_notes.append(
            f"the URDF does not declare the prefix '{prefix}'; it is read all the same, and "
            f"nothing here uses what stands under it: {_listed(named)}"
        )
    kinds = (_passive_note, unused_note, _acceleration_note, _friction_note)
    notes = [kind(robot) for kind in kinds]
    read = (*prefix_notes, *robot.urdf.notes, *robot.limits.notes)
    return (*read, *(note for note in notes if note is not None))


def _passive_note(robot: RobotModel) -> str | None:
    """Return a sentence on planned joints that the SRDF calls passive."""
    srdf = robot.urdf.srdf
    passive = [] if srdf is None else [j for j in srdf.passive_joints if j in robot.joint_names]
    if not passive:
        return None
    return (
        f"the SRDF calls {', '.join(passive)} passive, so without a motor; planned all the same "
        "unless robot.joints names the others alone"
    )


def _acceleration_note(robot: RobotModel) -> str | None:
    """Return a sentence on joints that the URDF lets slow down otherwise than speed up."""
    joints: dict[tuple[float, ...], list[str]] = {}
    for name, limit in zip(robot.joint_names, robot.limits.acceleration, strict=True):
        both = robot.urdf.joints[name].accelerations
        if both and limit <= min(both):  # else the problem has its own
            joints.setdefault(both, []).append(name)
    if not joints:
        return None
    listed = "; ".join(
        f"acceleration {up:g}, deceleration {down:g} ({_whose(names, robot)})"
        for (up, down), names in joints.items()
    )
    return (
        f"the URDF limits {listed}; a limit holds in both directions here, so the smaller counts; "
        "robot.limits.acceleration replaces it"
    )


def unlimited_notes(robot: RobotModel) -> tuple[str, ...]:
    """Return a sentence on joints with neither effort nor acceleration limit; none without any."""
    limits = robot.limits
    efforts = np.minimum(limits.effort, robot.motors.saturation_effort)
    unlimited = np.isinf(efforts) & np.isinf(limits.acceleration)
    if not unlimited.any():
        return ()
    names = ", ".join(robot.joint_names[joint] for joint in np.flatnonzero(unlimited))
    return (
        f"NEITHER an effort NOR an acceleration limit: {names}; nothing shows that a motor can "
        "follow a certified motion of these joints; give the maker's in robot.limits.acceleration, "
        "or efforts and masses",
    )


def _friction_note(robot: RobotModel) -> str | None:
    motors = robot.motors
    coulomb = np.maximum(motors.backwards_friction, motors.forwards_friction)
    largest = friction_fraction(robot, motors.viscous_friction, coulomb)
    if largest is None or not largest.is_implausible:
        return None
    return (
        f"at full speed friction takes {largest}, more than a third: implausible for a geared arm; "
        "have it identified, or leave it out of robot.motors"
    )


# ---- Values of the planned joints in the URDF that planning does not use.


def unused_note(robot: RobotModel) -> str | None:
    """Return a sentence that names unused values with their joints; None if there are none."""
    joints: dict[str, dict[str, list[str]]] = {}
    for column, name in enumerate(robot.joint_names):
        for key, value in robot.urdf.joints[name].unused.items():
            if not _is_given(robot, column, key):
                joints.setdefault(key, {}).setdefault(value, []).append(name)
    if not joints:
        return None
    listed = []
    for key, by_value in joints.items():
        whose = [f"{value} ({_whose(names, robot)})" for value, names in by_value.items()]
        listed.append(f"<{key}> {', '.join(whose)}")
    friction = ""
    largest = _unused_friction(robot, joints)
    if largest is not None:
        doubt = ", more than a third: rather a placeholder" if largest.is_implausible else ""
        friction = f"; that friction would at full speed take {largest}{doubt}"
    fields = dict.fromkeys(field for key in joints if (field := _field(key)) is not None)
    remedy = "".join(f"; to keep it, give {field}" for field in fields)
    return f"the URDF says, and nothing here uses: {'; '.join(listed)}{friction}{remedy}"


def _whose(names: Sequence[str], robot: RobotModel) -> str:
    return "every joint" if len(names) == robot.joint_count else ", ".join(names)


def _is_given(robot: RobotModel, column: int, key: str) -> bool:
    """Return True if the problem has its own value of a joint."""
    motors, limits = robot.motors, robot.limits
    if key == "dynamics damping":
        return bool(motors.viscous_friction[column])
    if key == "dynamics friction":
        return bool(motors.backwards_friction[column] or motors.forwards_friction[column])
    quantity = (_field(key) or "").rpartition(".")[2]
    if quantity == "velocity_by_position":
        return any(law.joint == column for law in limits.velocity_by_position)
    if quantity == "position":
        return bool(np.isfinite(limits.lower_position[column]))
    return bool(quantity) and bool(np.isfinite(getattr(limits, quantity)[column]))


def _field(key: str) -> str | None:
    return next((field for word, field in _FIELDS.items() if key.endswith(word)), None)


def _unused_friction(robot: RobotModel, unused: Mapping[str, object]) -> "FrictionFraction | None":
    """Return the largest fraction of an effort limit that the unused friction would take."""
    try:
        urdf_values = urdf_friction(robot.urdf, robot.joint_names)
    except RobotError:  # the URDF's values are no friction
        return None
    friction = {}
    for key, values in zip(URDF_FRICTION, urdf_values, strict=True):
        is_given = [_is_given(robot, column, key) for column in range(robot.joint_count)]
        friction[key] = np.where(is_given, 0.0, values) if key in unused else np.zeros(len(values))
    return friction_fraction(robot, *friction.values())


# ---- The fraction of the effort limits that friction takes at the velocity limits.


@dataclass(frozen=True)
class FrictionFraction:
    """The largest fraction of an effort limit that friction takes."""

    fraction: float  # of the effort limit, at the velocity limit
    joints: tuple[str, ...]  # names of the joints with this fraction; empty: every joint

    @property
    def is_implausible(self) -> bool:
        """True if no geared arm loses as much."""
        return self.fraction > _IMPLAUSIBLE

    def __str__(self) -> str:
        whose = ", ".join(self.joints) or "every joint"
        percent = 100 * self.fraction
        figures = f"{percent:.0f}" if percent >= 10 else f"{percent:.2g}"
        return f"{figures} % of the effort limit ({whose})"


def friction_fraction(
    robot: RobotModel, viscous: FloatArray, coulomb: FloatArray
) -> FrictionFraction | None:
    """Return the largest fraction of an effort limit that friction, (n,) each, takes.

    None without friction, or if no joint has finite limits of velocity and effort.
    """
    limits = robot.limits
    is_bounded = np.isfinite(limits.velocity) & np.isfinite(limits.effort)
    velocity = np.where(is_bounded, limits.velocity, 0.0)
    fractions = np.where(is_bounded, (viscous * velocity + coulomb) / limits.effort, 0.0)
    if not fractions.any():
        return None
    is_largest = fractions >= (1 - _EQUAL) * fractions.max()
    largest = () if is_largest.all() else np.flatnonzero(is_largest)
    names = tuple(robot.joint_names[joint] for joint in largest)
    return FrictionFraction(float(fractions.max()), names)


# ---- Implausible values: each quantity with the largest value that arms and cells have.
#
# The bounds are above what the arms of example-robot-data have where their values are right: legged
# robots turn with 30 rad/s, the radius of gyration of an identified link is 1.2 times its size.


class Plausible(NamedTuple):
    """A quantity with its largest plausible value and unit, and what a larger value may come of."""

    quantity: str
    most: float
    unit: str
    doubt: str


_METRES = "millimetres? Metres are meant"
_RADIANS = "degrees? Radians are meant"
_IN_URDF = ": correct the URDF, or give robot.limits"
_REACHES = "times the arm's reach"
BOUNDS = {
    "turning": Plausible(
        "position range", 62.9, "rad", f"that is ten turns; {_RADIANS}{_IN_URDF}.position"
    ),
    "sliding": Plausible("position range", 100.0, "m", f"{_METRES}{_IN_URDF}.position"),
    "turning speed": Plausible(
        "velocity limit", 30.0, "rad/s", f"a placeholder, or {_RADIANS}{_IN_URDF}.velocity"
    ),
    "sliding speed": Plausible(
        "velocity limit", 30.0, "m/s", f"a placeholder, or {_METRES}{_IN_URDF}.velocity"
    ),
    "length": Plausible("length of the arm", 100.0, "m", f"{_METRES}: correct <origin>"),
    "carried": Plausible(
        "farthest point", 10.0, _REACHES, f'{_METRES}; a <mesh> takes scale="0.001 0.001 0.001"'
    ),
    "standing": Plausible("size", 50.0, _REACHES, f"{_METRES}; a mesh takes a scale of 0.001"),
    "away": Plausible("distance from the arm's base", 50.0, _REACHES, _METRES),
    "offset": Plausible("distance from the last link", 10.0, _REACHES, _METRES),
    "angle": Plausible("rpy", 6.3, "rad", f"{_RADIANS}, and a full turn is 6.28"),
    "tolerance": Plausible(
        "rotation tolerance",
        3.15,
        "rad",
        f"{_RADIANS}; no rotation is above 3.14, so that this bounds nothing (.inf: free)",
    ),
    "moment": Plausible(
        "principal moments",
        1.0,
        "times the sum of the others",
        "no body has such; a decimal point? Correct <inertia>",
    ),
    "gyration": Plausible(
        "radius of gyration",
        2.0,
        "times the link's size",
        "a placeholder, a decimal point, or other units? Correct <mass> and <inertia>",
    ),
    "centre": Plausible(
        "centre of mass outside the geometry by",
        1.5,
        "times the link's size",
        f"a decimal point, or {_METRES}: correct the <origin> of <inertial>",
    ),
}
_MIN_REACH = 0.1  # [m]: solids around a smaller arm are larger by more
# A lighter link, and a radius of gyration below 1 mm [kg, m]: a placeholder of no consequence.
_MIN_MASS, _MIN_GYRATION = 1e-3, 1e-3
# Of principal moments: relative to the largest; half of the last digit as written [kg m^2].
_MOMENT_ERROR, _MAX_ROUNDING = 0.01, 1.5e-4


class Value(NamedTuple):
    """A value to be compared with a bound: key in `BOUNDS`, owner, and what it comes from."""

    key: str
    owner: str
    value: float
    origin: str = ""


@dataclass(frozen=True, eq=False)
class Extent:
    """The extent of a solid."""

    body: int  # index of the robot's body that carries it; 0 is fixed
    box: FloatArray  # least and largest coordinates in the body's frame, shape (2, 3) [m]


def doubts(values: Iterable[Value]) -> list[str]:
    """Return a sentence for each quantity with values above its bound."""
    by_key: dict[str, dict[str, list[str]]] = {}
    for each in values:
        bound = BOUNDS[each.key]
        if each.value > bound.most:
            figures = f"{each.value:.3g}" if each.value < 1000 else f"{each.value:,.0f}"
            text = f"{each.origin}{figures} {bound.unit}"
            by_key.setdefault(each.key, {}).setdefault(text, []).append(each.owner)
    sentences = []
    for key, owners in by_key.items():
        bound = BOUNDS[key]
        listed = [f"{text} ({_listed(names)})" for text, names in owners.items()]
        sentences.append(
            f"{bound.quantity} {_listed(listed)}, more than {bound.most:.3g}: {bound.doubt}"
        )
    return sentences


def _listed(names: Sequence[str]) -> str:
    more = len(names) - _MAX_NAMES
    return ", ".join(names[:_MAX_NAMES]) + (f" and {more} more" if more > 0 else "")


def implausible_values(robot: RobotModel, extents: Mapping[str, Extent]) -> tuple[str, ...]:
    """Return sentences on values of a robot and its solids, by label, that no arm or cell has."""
    joints: list[Value] = []
    limits = robot.limits
    for k, name in enumerate(robot.joint_names):
        lower, upper = limits.lower_position[k], limits.upper_position[k]
        kind = "turning" if robot.revolute[k] else "sliding"
        if np.isfinite([lower, upper]).all():
            joints.append(Value(kind, name, float(max(upper - lower, -lower, upper))))
        if np.isfinite(limits.velocity[k]):
            joints.append(Value(f"{kind} speed", name, float(limits.velocity[k])))
    # The distances between the joints from the root to the tool frame.
    length, link = 0.0, robot.tool_frame
    by_child = {joint.child: joint for joint in robot.urdf.joints.values()}
    while link in by_child:
        length += float(np.linalg.norm(_xyz(robot.urdf.joint_element(by_child[link].name))))
        link = by_child[link].parent
    travel = sum(each.value for each in joints if each.key == "sliding")
    reach = max(length + travel, _MIN_REACH)
    # The angles of the origins of joints, collision geometry and inertias.
    description = robot.urdf
    angles: list[Value] = []
    elements = [(f"joint '{name}'", description.joint_element(name)) for name in description.joints]
    for link in description.links:
        for tag in ("inertial", "collision"):
            tagged = description.link_element(link).findall(tag)
            elements += [(f"<{tag}> of link '{link}'", element) for element in tagged]
    for owner, element in elements:
        origin = element.find("origin")
        if origin is not None and origin.get("rpy") is not None:
            largest = float(abs(read_numbers(owner, origin, "rpy", 3)).max())
            angles.append(Value("angle", owner, largest))
    values = [
        *joints,
        Value("length", robot.name, length),
        *angles,
        *_values_of_solids(robot, extents, reach),
        *_values_of_inertias(robot, extents, reach),
    ]
    moves_tool = robot.joint_moves_body[robot.link_body[robot.tool_frame]]
    idle = [robot.joint_names[k] for k in np.flatnonzero(~moves_tool)]
    idle_note = (
        f"planned, but not moving tool_frame '{robot.tool_frame}': {', '.join(idle)}; the tube is "
        "of the tool: leave what does not move it out of robot.joints"
    )
    return (*doubts(values), *[idle_note][: len(idle)])


def _xyz(element: Element) -> FloatArray:
    """Return the position of an element's <origin>, shape (3,) [m]."""
    origin = element.find("origin")
    if origin is None or origin.get("xyz") is None:
        return np.zeros(3)
    return read_numbers(element.tag, origin, "xyz", 3)


def _values_of_solids(
    robot: RobotModel, extents: Mapping[str, Extent], reach: float
) -> Iterator[Value]:
    """Yield sizes and distances in units of the reach [m]; fixed solids may be large and flat."""
    points = {"tool centre point": robot.tool_reach}
    if robot.payload is not None:
        points["centre of mass of the payload"] = float(np.linalg.norm(robot.payload.com))
    for owner, distance in points.items():
        yield Value("offset", owner, distance / reach, f"{distance:.4g} m, ")
    base = np.zeros(3) if robot.base is None else np.array(robot.base.position)
    for owner, extent in extents.items():
        low, high = extent.box
        if extent.body > 0:
            lengths = {"carried": float(np.linalg.norm(np.maximum(abs(low), abs(high))))}
        else:
            least, most = (high - low).min(), (high - low).max()
            away = np.linalg.norm(np.maximum(np.maximum(low - base, base - high), 0.0))
            lengths = {"standing": float(most if least > reach else 0.0), "away": float(away)}
        for key, metres in lengths.items():
            yield Value(key, owner, metres / reach, f"{metres:.4g} m, ")


def _values_of_inertias(
    robot: RobotModel, extents: Mapping[str, Extent], reach: float
) -> Iterator[Value]:
    """Yield moments, radii of gyration and centres of mass of the links that move.

    A link without collision geometry is compared with the arm's reach [m].
    """
    for link, body in robot.link_body.items():
        owner, inertial = f"link '{link}'", robot.urdf.link_element(link).find("inertial")
        if body == 0 or inertial is None:
            continue
        mass = read_numbers(owner, read_child(owner, inertial, "mass"), "value", 1)[0]
        moments = principal_moments(owner, inertial)
        gyration = np.sqrt(max(moments[2], 0.0) / mass) if mass >= _MIN_MASS else 0.0
        if gyration > _MIN_GYRATION:
            others = moments[0] + moments[1]
            # The error of a sum of three moments by the digits written [kg m^2].
            inertia = read_child("inertial", inertial, "inertia")
            texts = [inertia.get(key, "0").strip() for key in INERTIA[:3]]
            decimals = max(int(Decimal(text).as_tuple().exponent) for text in texts)
            rounding = min(1.5 * 10.0**decimals, _MAX_ROUNDING)
            if moments[2] - others > max(_MOMENT_ERROR * moments[2], rounding):
                ratio = moments[2] / others if others > 0 else np.inf
                named = ", ".join(f"{moment:.3g}" for moment in moments)
                yield Value("moment", owner, ratio, f"{named} kg m^2, the largest ")
        extent = extents.get(owner)
        size, outside = reach, _xyz(inertial)
        if extent is not None:
            placement = robot.link_placement[link]
            centre = placement[:3, :3] @ outside + placement[:3, 3]
            low, high = extent.box
            outside = np.maximum(np.maximum(low - centre, centre - high), 0.0)
            size = max(float(np.linalg.norm(high - low)), _MIN_GYRATION)
        away = float(np.linalg.norm(outside)) if mass >= _MIN_MASS else 0.0
        yield Value("gyration", owner, gyration / size, f"{gyration:.3g} m, ")
        yield Value("centre", owner, away / size, f"{away:.3g} m, ")


_ANGLES = {"rpy": "angle", "rotation_tolerance": "tolerance"}


def angles_of(fields: Any, path: str = "") -> Iterator[Value]:
    """Yield the largest finite angle of each field of a document, below a path [rad]."""
    if isinstance(fields, Mapping):
        for key, value in fields.items():
            where = f"{path}.{key}" if path else str(key)
            if key in _ANGLES and value is not None:
                angles = [abs(angle) for angle in _flat(value) if np.isfinite(angle)]
                yield Value(_ANGLES[key], where, max(angles, default=0.0))
            else:
                yield from angles_of(value, where)
    elif isinstance(fields, list | tuple):
        for k, each in enumerate(fields):
            if isinstance(each, Mapping):
                yield from angles_of(each, f"{path}.{each.get('name', k)}")


def _flat(value: Any) -> list[float]:
    """Return the numbers of nested lists; a null is left out."""
    if isinstance(value, list | tuple):
        return [number for each in value for number in _flat(each)]
    return [] if value is None else [float(value)]
