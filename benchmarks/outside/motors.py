"""Motors as the formulas have them: rotors, friction, torque-speed lines, efforts by place.

At a joint that moves with q, v and a, a motor gives

    tau = tau_rigid(q, v, a) + J a + D v + F,   F = f+ where v > 0, -f- where v < 0, 0 at rest,

and has, forwards, at most S (1 - v / v0), backwards S (1 + v / v0).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from outside.files import BadInput
from outside.problem import MOTORS
from outside.trajectory import Samples, Trajectory
from outside.urdf import Joint

RULES = ("friction_from_urdf", "friction_uncertainty")  # of a robot, rather than of its joints
STILL = 1e-6  # of the fastest joint's speed: a joint that is slower throughout a piece is at rest
REST = 1e-9  # likewise: at an instant, so that the direction is that of the motion beside
BESIDE = 0.01  # of a piece: how far from such an instant that is looked at
LOOKS = np.linspace(0.0, 1.0, 101)


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

    def allowed(self, q: np.ndarray, way: int) -> np.ndarray:
        """Return the most forwards (1) or backwards (-1) at positions (N,), shape (N,)."""
        return np.interp(q, self.position, self.forwards if way > 0 else self.backwards)

    def scaled(self, factor: float) -> "EffortLimit":
        """Return a share of it."""
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
                by_name[key] |= _by_name(key, given, chain)
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
    way = np.sign(np.where(abs(v) > REST * fastest, v, beside))
    return np.where(moves[samples.piece], way, 0.0)


def _by_name(key: str, given: Any, chain: Sequence[str]) -> dict[str, Any]:
    if given is None or isinstance(given, dict):
        return dict(given or {})
    values = given if isinstance(given, list) else [given] * len(chain)
    if len(values) != len(chain):
        raise BadInput(f"motors.{key} has {len(values)} values for {len(chain)} joints")
    return dict(zip(chain, values, strict=True))


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
