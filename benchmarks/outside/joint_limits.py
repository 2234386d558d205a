"""Limits and motors of joints, as a problem, its presets and a file of MoveIt's give them.

At a joint that moves with q, v and a, a motor gives

    tau = tau_rigid(q, v, a) + J a + D v + F,   F = f+ where v > 0, -f- where v < 0, 0 at rest,

and has, forwards, at most S (1 - v / v0), backwards S (1 + v / v0).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from outside.files import BUNDLED, BadInput, Joint, find_file, read_document
from outside.problem import LIMITS, MOTORS, Problem
from outside.trajectory import Samples, Trajectory

WHOLE = {"tool_speed", "tool_acceleration", "point_speed"}  # of a robot, rather than of its joints
MOVEIT = {
    "max_velocity": "velocity",
    "max_acceleration": "acceleration",
    "max_jerk": "jerk",
    "max_effort": "effort",
}
LAW = {"deceleration", "offset", "lower", "upper"}
POINT = {"link", "position", "speed"}
RULES = ("friction_from_urdf", "friction_uncertainty")  # of a robot, rather than of its joints
STILL = 1e-6  # of the fastest joint's speed: a joint that is slower throughout a piece is at rest
REST = 1e-9  # likewise: at an instant, so that the direction is that of the motion beside
BESIDE = 0.01  # of a piece: how far from such an instant that is looked at
LOOKS = np.linspace(0.0, 1.0, 101)


def given_limits(
    problem: Problem, package_dirs: list[Path], chain: list[str], followers: list[str]
) -> dict[str, Any]:
    """Return limits as a section `robot.limits` with nothing but maps by joint name.

    Args:
        problem: The problem file.
        package_dirs: Folders that hold packages.
        chain: The planning group, from the root on.
        followers: Joints that follow one of it.

    Raises:
        BadInput: A file is missing, for another arm, or has a field that this judge does not know.
    """
    robot, folder = problem.robot, problem.folder
    layers = []
    if robot.get("limits_file") is not None:
        path = find_file(robot["limits_file"], folder, package_dirs)
        layers.append(_moveit(read_document(path), {*chain, *followers}))
    layers += [preset.get("limits") or {} for preset in _presets(problem, len(chain))]
    merged: dict[str, Any] = {}
    for layer in [*layers, robot.get("limits") or {}]:
        for quantity, given in layer.items():
            if quantity in WHOLE:
                merged[quantity] = given or merged.get(quantity)
            else:
                merged[quantity] = merged.get(quantity, {}) | _by_name(
                    "limits", quantity, given, chain
                )
    return merged


def given_motors(problem: Problem, count: int) -> list[dict[str, Any]]:
    """Return sections `motors` of presets and of a problem for so many joints; later ones win.

    Raises:
        BadInput: As for `given_limits`.
    """
    layers = [preset.get("motors") or {} for preset in _presets(problem, count)]
    return [*layers, problem.robot.get("motors") or {}]


@dataclass(frozen=True)
class Law:
    """A velocity limit that falls towards both ends of a joint's range.

    Attributes:
        joint: Index of the joint.
        deceleration: [rad/s^2 or m/s^2].
        offset: [rad/s or m/s].
        lower: [rad or m].
        upper: [rad or m].
    """

    joint: int
    deceleration: float
    offset: float
    lower: float
    upper: float

    def margin(self, q: np.ndarray, v: np.ndarray, most: float) -> np.ndarray:
        """Return what is left at positions and velocities (N,), as a fraction, shape (N,).

        Args:
            q: The joint's [rad or m].
            v: Likewise [rad/s or m/s].
            most: Its velocity limit, infinite if there is none.
        """
        gap = np.where(v > 0, self.upper - q, q - self.lower)
        allowed = -self.offset + np.sqrt(2 * self.deceleration * np.clip(gap, 0, None))
        left = np.clip(allowed, 0, None) - abs(v)
        whole = math.sqrt(2 * self.deceleration * (self.upper - self.lower))
        return left / (most if math.isfinite(most) else whole)


@dataclass(frozen=True)
class Point:
    """A point that moves with a link, and how fast it may move.

    Attributes:
        link: Which.
        position: In the link's frame [m].
        speed: [m/s].
    """

    link: str
    position: tuple[float, float, float]
    speed: float


def read_laws(given: Any, names: Sequence[str], lower: np.ndarray, upper: np.ndarray) -> list[Law]:
    """Return the laws of joints whose position limits are (n,) each.

    Raises:
        BadInput: One is of no joint, or is not complete.
    """
    rows = given or {}
    by_name = rows if isinstance(rows, dict) else dict(zip(names, rows, strict=True))
    if unknown := set(by_name) - set(names):
        raise BadInput(f"robot.limits.velocity_by_position: {unknown.pop()} is no joint")
    laws = []
    for joint, name in enumerate(names):
        if (fields := by_name.get(name)) is None:
            continue
        if unknown := set(fields) - LAW:
            raise BadInput(f"robot.limits.velocity_by_position: {unknown.pop()} is not known")
        ends = {"lower": lower[joint], "upper": upper[joint]}
        ends |= {key: fields[key] for key in ends if fields.get(key) is not None}
        both = (float(ends["lower"]), float(ends["upper"]))
        numbers = (float(fields["deceleration"]), float(fields["offset"]), *both)
        if not np.isfinite(numbers).all() or not numbers[0] > 0 or not both[0] < both[1]:
            raise BadInput(f"robot.limits.velocity_by_position: {name} has {fields}")
        laws.append(Law(joint, *numbers))
    return laws


def read_points(given: Any, links: set[str]) -> list[Point]:
    """Return the points whose speed is limited.

    Raises:
        BadInput: One is of no link, or is not complete.
    """
    points = []
    for fields in given or []:
        if set(fields) != POINT or fields["link"] not in links:
            raise BadInput(f"robot.limits.point_speed: {fields} is not known")
        x, y, z = map(float, fields["position"])
        if not float(fields["speed"]) > 0:
            raise BadInput(f"robot.limits.point_speed: {fields}")
        points.append(Point(fields["link"], (x, y, z), float(fields["speed"])))
    return points


@dataclass(frozen=True, eq=False)
class Motors:
    """Motors of n joints, in group order.

    Attributes:
        armature: Shape (n,) [kg m^2 or kg].
        viscous: Shape (n,) [N m s/rad or N s/m].
        dry: Backwards and forwards, shape (2, n) [N m or N].
        stall: Infinite where there is no torque-speed line, shape (n,) [N m or N].
        no_load: Likewise [rad/s or m/s].
        unsure: By which share friction may be more or less.
    """

    armature: np.ndarray
    viscous: np.ndarray
    dry: np.ndarray
    stall: np.ndarray
    no_load: np.ndarray
    unsure: float

    def friction(self, v: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return Coulomb friction, and by how much all friction may be more or less, (N, n) each.

        Args:
            v: Velocities, shape (N, n).
            direction: 1, -1, or 0 at rest, shape (N, n).
        """
        backwards, forwards = self.dry
        dry = forwards * (direction > 0) - backwards * (direction < 0)
        viscous = np.where(direction == 0, 0.0, self.viscous * v)
        return dry, self.unsure * abs(viscous + dry)


@dataclass(frozen=True, eq=False)
class EffortLimit:
    """What one motor has at a place: linear between positions, constant beyond.

    Attributes:
        position: Shape (K,) [rad or m].
        backwards: Shape (K,) [N m or N].
        forwards: Likewise.
    """

    position: np.ndarray
    backwards: np.ndarray
    forwards: np.ndarray

    @property
    def largest(self) -> float:
        """Anywhere, either way [N m or N]."""
        return float(max(self.backwards.max(), self.forwards.max()))

    def allowed(self, q: np.ndarray, sign: int) -> np.ndarray:
        """Return the most forwards (1) or backwards (-1) at positions (N,), shape (N,)."""
        return np.interp(q, self.position, self.forwards if sign > 0 else self.backwards)

    def scaled(self, factor: float) -> "EffortLimit":
        """Return a fraction of it."""
        return EffortLimit(self.position, factor * self.backwards, factor * self.forwards)


def read_effort(name: str, given: Any) -> EffortLimit:
    """Return the effort limit of a joint: a number, a pair, or a table.

    Raises:
        BadInput: It is none of these.
    """
    table = given if isinstance(given, Mapping) else {"position": [0.0], "effort": given}
    if set(table) != {"position", "effort"} or isinstance(given, bool):
        raise BadInput(f"joint '{name}' has the effort limit {given}")
    if isinstance(given, list):
        sides = [[value] for value in given]  # backwards and forwards
    else:
        sides = [np.atleast_1d(table["effort"])] * 2
    try:
        position, backwards, forwards = (
            np.array(row, dtype=float) for row in (table["position"], *sides)
        )
    except (TypeError, ValueError):
        raise BadInput(f"joint '{name}' has the effort limit {given}") from None
    fits = position.shape == backwards.shape == forwards.shape
    if not fits or not (backwards > 0).all() or not (forwards > 0).all():
        raise BadInput(f"joint '{name}' has the effort limit {given}")
    if not (np.diff(position) > 0).all():
        raise BadInput(f"joint '{name}' has an effort limit whose positions do not rise")
    return EffortLimit(position, backwards, forwards)


def read_motors(
    layers: Sequence[Mapping[str, Any]],
    names: Sequence[str],
    chain: Sequence[str],
    urdf: Mapping[str, Joint],
    follow: np.ndarray,
    moving: Sequence[str],
    scale: float,
) -> Motors:
    """Return the motors of a group of n joints.

    Args:
        layers: Sections `motors`, of which later ones win.
        names: The group.
        chain: The group from the root on: the order of lists.
        urdf: The URDF's joints by name.
        follow: How fast M joints follow the group, shape (M, n).
        moving: Their names.
        scale: Of the efforts.

    Raises:
        BadInput: A value is of no joint, or none, or a torque-speed line has one end.
    """
    by_name: dict[str, dict[str, Any]] = {key: {} for key in MOTORS}
    rules: dict[str, Any] = {}
    for layer in layers:
        for key, given in layer.items():
            if key in RULES:
                rules |= {} if given is None else {key: given}
            else:
                by_name[key] |= _by_name("motors", key, given, chain)
    own = np.zeros((3, len(names)))
    if rules.get("friction_from_urdf"):
        # A follower turns |r| times as fast, and its friction has that lever on its master.
        rates = abs(follow).T
        damping = np.array([urdf[name].damping for name in moving])
        dry = np.array([urdf[name].friction for name in moving])
        own[:] = rates**2 @ damping, rates @ dry, rates @ dry
    endless = np.full(len(names), np.inf)
    stall = _row(by_name["saturation_effort"], names, endless, least=1e-300)
    no_load = _row(by_name["no_load_velocity"], names, endless, least=1e-300)
    if (np.isfinite(stall) != np.isfinite(no_load)).any():
        raise BadInput("robot.motors: a torque-speed line has one end alone")
    pairs = {
        name: value if isinstance(value, list) else [value, value]
        for name, value in by_name["coulomb_friction"].items()
    }
    sides = [
        _row({name: pair[side] for name, pair in pairs.items()}, names, own[1 + side])
        for side in (0, 1)
    ]
    return Motors(
        _row(by_name["armature"], names, np.zeros(len(names))),
        _row(by_name["viscous_friction"], names, own[0]),
        np.array(sides),
        stall * scale,
        no_load,
        float(rules.get("friction_uncertainty", 0.0)),
    )


def directions(trajectory: Trajectory, samples: Samples) -> np.ndarray:
    """Return which way joints move at samples, shape (N, n): 1, -1, or 0 at rest.

    Where one stops for an instant, at an end or at a turn, it is the way in which it moves next to
    that, towards the middle of the piece.
    """
    widths = np.diff(trajectory.breakpoints)
    every = np.repeat(np.arange(len(widths)), len(LOOKS))
    local = (LOOKS * widths[:, None]).ravel()
    speeds = abs(trajectory.at(Samples(every, local, local), 1))
    fastest = speeds.max()
    moves = speeds.reshape(len(widths), len(LOOKS), -1).max(axis=1) > STILL * fastest
    v, width = trajectory.at(samples, 1), widths[samples.piece]
    inwards = np.where(samples.local < width / 2, BESIDE, -BESIDE) * width
    beside = trajectory.at(Samples(samples.piece, samples.local + inwards, samples.time), 1)
    sign = np.sign(np.where(abs(v) > REST * fastest, v, beside))
    return np.where(moves[samples.piece], sign, 0.0)


def _presets(problem: Problem, count: int) -> list[dict[str, Any]]:
    names = problem.robot.get("preset") or []
    names = [names] if isinstance(names, str) else names
    return [_preset(name, problem.folder, count) for name in names]


def _by_name(section: str, quantity: str, given: Any, chain: Sequence[str]) -> dict[str, Any]:
    """Return values by joint name that are one for all, a list in the chain's order, or a map."""
    if given is None or isinstance(given, dict):
        return dict(given or {})
    values = given if isinstance(given, list) else [given] * len(chain)
    if len(values) != len(chain):
        raise BadInput(f"{section}.{quantity} has {len(values)} values for {len(chain)} joints")
    return dict(zip(chain, values, strict=True))


def _preset(name: str, folder: Path, count: int) -> dict[str, Any]:
    bundled = BUNDLED / "presets" / f"{name}.yaml"
    fields = read_document(bundled if bundled.is_file() else find_file(name, folder, []))
    if fields["format"] != "tubeplanner/preset" or fields.get("version", 1) != 1:
        raise BadInput(f"preset {name} has another format")
    if fields["joints"] != count:
        raise BadInput(f"preset {name} is for {fields['joints']} joints, not for {count}")
    for section, known in (("limits", LIMITS), ("motors", MOTORS)):
        if unknown := set(fields.get(section) or {}) - known:
            raise BadInput(f"preset {name}: {section}.{unknown.pop()} is not known here")
    return dict(fields)


def _moveit(fields: Any, known: set[str]) -> dict[str, Any]:
    """Return the limits of some joints in a file of MoveIt's; `has_...` may switch them off."""
    limits: dict[str, dict[str, Any]] = {name: {} for name in ("position", *MOVEIT.values())}
    for name, joint in fields["joint_limits"].items():
        if name not in known:
            continue
        if "min_position" in joint and joint.get("has_position_limits", True):
            limits["position"][name] = [joint["min_position"], joint["max_position"]]
        for key, quantity in MOVEIT.items():
            if key in joint and joint.get(f"has_{quantity}_limits", True):
                limits[quantity][name] = joint[key]
        if "max_deceleration" in joint and joint.get("has_deceleration_limits", True):
            own = limits["acceleration"].get(name, math.inf)
            limits["acceleration"][name] = min(own, abs(joint["max_deceleration"]))
    return limits


def _row(
    given: Mapping[str, Any], names: Sequence[str], default: np.ndarray, least: float = 0.0
) -> np.ndarray:
    if unknown := set(given) - set(names):
        raise BadInput(f"robot.motors: {unknown.pop()} is no joint of the group")
    for name, value in given.items():
        if isinstance(value, bool) or not isinstance(value, int | float) or not value >= least:
            raise BadInput(f"robot.motors: joint '{name}' has {value}")
    pairs = zip(names, default, strict=True)
    return np.array([given.get(name, value) for name, value in pairs], dtype=float)
