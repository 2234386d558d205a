"""Holding: a part that a cup, a tray or a gripper holds, or a liquid; the cones of its contact.

The wrench of the tool on the part has its moment about the contact's middle p and the contact's
axes C, z along the normal from the tool into the part:

    W = (C^T f, C^T tau),  f = m (b + al x c + w x (w x c)),  tau = I al + w x I w + (c - p) x f

with the acceleration b of the tool frame's origin less gravity, the angular velocity w and the
angular acceleration al, all in the tool frame. A contact holds while W is in cones
|across W| <= along . W + offset.

The cones are sound: forces at points of the contact, each in its cone of friction mu, add up to
every wrench inside. They are exact for a force g across and N along the normal whose line meets the
axis of the centre of mass: it acts at the centre of pressure. Inertia adds a moment d. Then a share
N2 of N is pressed about the middle, evenly over a circle of radius rho in the foot; the rest N1,
with g1 along g, at the centre of pressure. That leaves the twist T = dz + g1 . d_t / N1. For every
sliding, two points of a diameter take up at least the power of any g2 and T with
|(g2, T / rho)| <= mu N2, since a norm is convex. With N2 = 5/4 |T| / (mu rho), |g2| = 3/5 mu N2 is
left. So the part holds while

    |g| <= mu N - |T| / (2 rho)  and the centre of pressure of N - N2 is inside the foot.

As |g1| = k mu N1 with k from 0 to 1, T is between its values dz and dz + mu e . d_t of both, with
e = g / |g|; and |g| + e . a <= |g + a| makes cones of that. On a round foot of radius r, the com at
the height h, likewise g1 . d_t / N1 = k (r / h) e . (z x d_t) with e = t / |t|, which is little
where h is not. Else |T| <= |dz| + mu |d_t|.

If the centre of pressure is within half of an ellipse, both parts of any chord c1, c2 through it
have 2 c1 c2 / (c1 + c2) >= 3/4 of its smaller radius, and |(g, h / that)| <= mu N.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from typing import Annotated, Any, ClassVar, TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray, read_only
from tubeplanner.checks import are_numbers, in_figures, is_number
from tubeplanner.errors import ProblemError, shown
from tubeplanner.fields import (
    Finite,
    Vector,
    declaration,
    declared,
    documented,
    is_pair,
    is_plain_number,
    one_of,
)
from tubeplanner.geometry.solids import MAX_SIZE
from tubeplanner.outcome import MARGIN_TOLERANCE
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.pinocchio_model import Payload

GRAVITY = 9.81  # [m/s^2]: nominal forces of cones are weights on earth, wherever the robot is

# ---- Cones of wrenches.

_FX, _FY, _FZ, _TX, _TY, _TZ = np.eye(6)


@dataclass(frozen=True, eq=False)
class Cone:
    """A convex cone of wrenches (6,) [N, N m]: |across W| <= along . W + offset.

    Attributes:
        name: What happens outside: "slides", "tips", ...
        across: Shape (r, 6); r = 0: the cone is a half space.
        along: Shape (6,).
        offset: [N or N m].
        nominal: What margins are relative to [N or N m].
    """

    name: str
    across: FloatArray
    along: FloatArray
    offset: float
    nominal: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "across", read_only(np.reshape(self.across, (-1, 6))))
        object.__setattr__(self, "along", read_only(self.along))

    def margin(self, wrench: FloatArray) -> FloatArray:
        """Return the margin at wrenches (N, 6) as a share of the nominal, shape (N,)."""
        size = np.linalg.norm(wrench @ self.across.T, axis=1)
        margin: FloatArray = (wrench @ self.along + self.offset - size) / self.nominal
        return margin

    def share(self, wrench: FloatArray) -> FloatArray:
        """Return the used share of the cone at wrenches (N, 6): 1 on the cone, shape (N,).

        Where a contact holds without a load, the required over the available force; elsewhere the
        required over the available friction, foot or slope under the load that presses there is.
        """
        size = np.linalg.norm(wrench @ self.across.T, axis=1)
        pressing = np.zeros_like(wrench) if self.offset > 0 else wrench * _FZ
        available = pressing @ self.along + self.offset
        required = np.maximum(size - (wrench - pressing) @ self.along, 0.0)
        nothing = np.where(required > 0, np.inf, np.where(available < 0, np.inf, 0.0))
        return np.divide(required, available, out=nothing, where=available > 0)


_NONE = np.zeros((0, 6))
# Of the share of the normal force that carries a twist, and what it takes off the friction.
_SHARE, _LESS_FRICTION = 1.25, 0.5
_OFF_AXIS = 1e-9  # [m]
# From this height of the com on, in radii over the friction, cones of tipping by the com's height
# contain more. No round number, so that prices, which change radius and friction, stay beside it.
_FLAT = 0.6127


def _extra_moment(arm: FloatArray) -> FloatArray:
    """Return the rows (3, 6) of a wrench's moment beside that of its force at a point (3,)."""
    return np.hstack([-np.cross(arm, np.eye(3)).T, np.eye(3)])


def _twists(extra: FloatArray, mu: float) -> list[FloatArray]:
    """Return rows (6,) of which the largest is |dz| + mu (|dx| + |dy|), of d = extra W."""
    signs = product((1.0, -1.0), repeat=3) if extra.any() else ((0.0, 0.0, 0.0),)
    return [np.array([x * mu, y * mu, z]) @ extra for x, y, z in signs]


def _slides(mu: float, rho: float, extra: FloatArray, offset: float, nominal: float) -> list[Cone]:
    """Return cones of slipping: |g| + |T| / (2 rho) <= mu (fz + offset)."""
    lever = _LESS_FRICTION / rho
    pairs = _twisted(np.array([_FX, _FY]), lever * mu * extra[:2], lever * extra[2])
    return [Cone("slides", g, mu * _FZ - twist, mu * offset, nominal) for g, twist in pairs]


def _twisted(
    across: FloatArray, change: FloatArray, twist: FloatArray
) -> list[tuple[FloatArray, FloatArray]]:
    """Return rows (2, 6) and (6,) of which the largest |.| + . is above |across| + |T|.

    T W is between twist W and twist W + e . change W, with e along across W.
    """
    if not (change.any() or twist.any()):
        return [(across, twist)]
    parts = ((sign, part) for sign in (1.0, -1.0) for part in (1.0, 0.0))
    return [(across + sign * part * change, sign * twist) for sign, part in parts]


def _disc_tips(
    mu: float, radius: float, com: FloatArray, extra: FloatArray, offset: float, nominal: float
) -> list[Cone]:
    """Return cones of tipping about a rim; the twist's share is pressed below the com (3,)."""
    away, height = float(np.hypot(*com[:2])), float(com[2])
    reach, across = radius + away, np.array([_TX, _TY])
    share = reach * _SHARE / (mu * (radius - away))
    if away <= _OFF_AXIS and mu * height > _FLAT * radius:
        lean = share * radius / height * np.array([-extra[1], extra[0]])
        pairs = _twisted(across, lean, share * extra[2])
    else:
        pairs = [(across, share * twist) for twist in _twists(extra, mu)]
    return [
        Cone("tips", each, radius * _FZ - twist, reach * offset, nominal) for each, twist in pairs
    ]


# ---- Contacts.

Foot: TypeAlias = Annotated[
    tuple[Finite, Finite] | Finite,
    one_of(
        lambda value: is_plain_number(value) or is_pair(value),
        "two lengths, or a number, the radius of a disc",
    ),
]

# Least and largest values of the numbers of contacts, their unit, and how many there may be.
_ONE, _TWO = (None,), (2,)
_BOUNDS: dict[str, tuple[float, float, str, tuple[int | None, ...]]] = {
    "force": (1e-3, 1e6, " N", _ONE),
    "friction": (1e-3, 10.0, "", _ONE),
    "safety": (1.0, 100.0, "", _ONE),
    "tilt": (1e-3, 1.5, " rad", _ONE),
    "radius": (1e-5, 10.0, " m", _ONE),
    "torsion": (1e-5, 10.0, " m", _ONE),
    "foot": (1e-5, 10.0, " m", _ONE + _TWO),
    "pad": (1e-5, 10.0, " m", _TWO),
}


class _Checked:
    """A contact that checks its numbers; messages begin with its kind."""

    kind: ClassVar[str]

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            low, high, unit, counts = _BOUNDS.get(name, (-MAX_SIZE, MAX_SIZE, "", (3,)))
            count = None if is_number(value) else np.size(value)
            numbers = [value] if count is None else value
            if count not in counts or not are_numbers(numbers, count or 1):
                kinds = " or ".join("a number" if n is None else f"{n} numbers" for n in counts)
                raise ProblemError(f"{self.kind}.{name} is {shown(value)}; give {kinds}")
            if not all(low <= number <= high for number in numbers):
                size = in_figures(value) if count is None else shown(value)
                raise ProblemError(
                    f"{self.kind}.{name} is {size}{unit}; {low:g} to {high:g}{unit} are accepted"
                )
            if name in ("normal", "closing") and not np.linalg.norm(value) > 1e-6:
                raise ProblemError(f"{self.kind}.{name} is {shown(value)}; it must have a length")
            object.__setattr__(self, name, value if count is None else tuple(value))


@documented
@dataclass(frozen=True)
class Cup(_Checked):
    """A suction cup: a ring that the vacuum presses onto the part."""

    kind: ClassVar[str] = "cup"
    force: Finite = field(metadata=declaration("at working pressure [N]"))
    radius: Finite = field(metadata=declaration("of the ring [m]"))
    friction: Finite = field(metadata=declaration("coefficient between ring and part"))
    safety: Finite = declared(1.5, "divides the force")
    position: Vector = declared((0.0, 0.0, 0.0), "middle of the ring in tool_frame [m]")
    normal: Vector = declared((0.0, 0.0, 1.0), "from the tool into the part, in tool_frame")

    def cones(self, mass: float, com: FloatArray, turns: bool) -> list[Cone]:
        """Return the cones for a com (3,) in the contact's axes; `turns`: the part has inertia."""
        pull, mu, r = self.force / self.safety, self.friction, self.radius
        turns = turns or bool(np.hypot(*com[:2]) > _OFF_AXIS)
        below = com * (0, 0, 1)
        extra = _extra_moment(below) * turns
        return [
            *_slides(mu, r, extra, pull, mu * pull),
            *_disc_tips(mu, r, below, extra, pull, r * pull),
        ]


@documented
@dataclass(frozen=True)
class Tray(_Checked):
    """A tray: the part stands on it."""

    kind: ClassVar[str] = "tray"
    friction: Finite = field(metadata=declaration("coefficient between tray and part"))
    foot: tuple[float, float] | float = field(
        metadata=declaration(
            "full lengths along x, the tool frame's x made perpendicular to the normal, and y; or "
            "a disc's radius [m]",
            Foot,
        )
    )
    safety: Finite = declared(1.2, "divides friction and foot; 1 - 1/safety of the weight is kept")
    position: Vector = declared((0.0, 0.0, 0.0), "middle of the foot in tool_frame [m]")
    normal: Vector = declared((0.0, 0.0, 1.0), "from the tool into the part, in tool_frame")

    def cones(self, mass: float, com: FloatArray, turns: bool) -> list[Cone]:
        """Return the cones, as of a cup; the weight that is kept rests below the com."""
        mu, weight = self.friction / self.safety, mass * GRAVITY
        kept, extra = (1 - 1 / self.safety) * weight, _extra_moment(com) * turns
        if isinstance(self.foot, (int, float)):
            r, away = self.foot / self.safety, float(np.hypot(*com[:2]))
            return [
                *_slides(mu, r - away, extra, -kept, mu * weight),
                *_disc_tips(mu, r, com, extra, -kept, r * weight),
            ]
        half = np.array(self.foot) / 2 / self.safety
        rho = float((half - abs(com[:2])).min())
        cones = _slides(mu, rho, extra, -kept, mu * weight)
        # |dz| + mu |d_t| <= sqrt(2) |(dz, mu dx, mu dy)|, as one cone.
        twist = np.sqrt(2) * _SHARE / (mu * rho) * np.array([[mu], [mu], [1]]) * extra
        # The centre of pressure is (-ty, tx) / fz.
        for edge, middle, lever in zip(half, com, (-_TY, _TX), strict=False):
            for side in (1.0, -1.0):
                reach, along = edge - side * middle, edge * _FZ - side * lever
                across = reach * twist if turns else _NONE
                cones.append(Cone("tips", across, along, -reach * kept, edge * weight))
        return cones


@documented
@dataclass(frozen=True)
class Gripper(_Checked):
    """A gripper with two fingers: it presses the part from both sides.

    The fingers' forces add up to twice the force. The smaller is half of the size of fz below it.
    Each pad carries half of what is across, whatever the part's width.
    """

    kind: ClassVar[str] = "gripper"
    force: Finite = field(metadata=declaration("of each finger [N]"))
    friction: Finite = field(metadata=declaration("coefficient between pads and part"))
    pad: tuple[Finite, Finite] = field(
        metadata=declaration("full lengths of the pads along the contact's x and y [m]")
    )
    torsion: Finite = declared(
        0.01, "radius of the friction against turning, up to 3/8 of the shorter length [m]"
    )
    safety: Finite = declared(2.0, "divides the force")
    position: Vector = declared((0.0, 0.0, 0.0), "middle between the pads in tool_frame [m]")
    closing: Vector = declared((1.0, 0.0, 0.0), "direction in which it closes, in tool_frame")

    @property
    def normal(self) -> tuple[float, float, float]:
        """The closing direction."""
        return self.closing

    def cones(self, mass: float, com: FloatArray, turns: bool) -> list[Cone]:
        """Return the cones, as of a cup."""
        press, mu = self.force / self.safety, self.friction
        turns = turns or bool(np.hypot(*com[:2]) > _OFF_AXIS)
        extra, (x, y) = _extra_moment(com * (0, 0, 1)) * turns, np.array(self.pad) / 2
        rho, slide = min(self.torsion, 0.75 * min(x, y)), 2 * mu * press
        cones = []
        for pull in (_FZ, -_FZ):
            # A twist and its opposite are one cone.
            for twist in _twists(extra, mu)[::2]:
                across = np.array([_FX, _FY, twist / rho])
                cones.append(Cone("slides", across, mu * pull, slide, slide))
            cones.append(Cone("tips", np.array([_TX / y, _TY / x]), pull / 2, press, press))
        return cones


@documented
@dataclass(frozen=True)
class Liquid(_Checked):
    """A liquid in an open vessel: its surface leans against the vessel."""

    kind: ClassVar[str] = "liquid"
    tilt: Finite = field(metadata=declaration("largest angle of the surface in the vessel [rad]"))
    position: Vector = declared((0.0, 0.0, 0.0), "middle of the surface in tool_frame [m]")
    normal: Vector = declared((0.0, 0.0, 1.0), "upwards out of the vessel, in tool_frame")
    safety: ClassVar[float] = 1.0

    def cones(self, mass: float, com: FloatArray, turns: bool) -> list[Cone]:
        """Return the cone of a small mass at the surface."""
        slope = float(np.tan(self.tilt))
        nominal = slope * mass * GRAVITY
        return [Cone("spills", np.array([_FX, _FY]), slope * _FZ, 0.0, nominal)]


# Numbers that have a price, each with the unit that the price is for, and its size.
PRICED = {
    "force": ("N", 1.0),
    "friction": ("0.1", 0.1),
    **dict.fromkeys(("radius", "foot", "pad", "torsion"), ("mm", 1e-3)),
    "tilt": ("degree", float(np.radians(1))),
    "mass": ("kg", 1.0),
}
ContactKind: TypeAlias = Cup | Tray | Gripper | Liquid
CONTACT_KINDS: tuple[type[ContactKind], ...] = (Cup, Tray, Gripper, Liquid)


@dataclass(frozen=True)
class Holding:
    """A part, and the contact that holds it.

    Attributes:
        contact: Cup, tray, gripper or liquid.
        part: Mass properties in tool_frame; None: of a liquid alone.
        backoff: Share of the nominal that every cone keeps back.
    """

    contact: ContactKind
    part: Payload | None = None
    backoff: float = 0.0

    def __post_init__(self) -> None:
        if not isinstance(self.contact, CONTACT_KINDS):
            raise ProblemError(
                f"holding is by {shown(self.contact)}; give a Cup, Tray, Gripper or Liquid"
            )
        if isinstance(self.contact, Liquid):
            object.__setattr__(self, "part", Payload(1.0, self.contact.position))
        if not isinstance(self.part, Payload):
            raise ProblemError(
                f"part is {shown(self.part)}; give the mass, com and inertia of what the "
                f"{self.kind} holds"
            )
        if not self.part.mass > 0:
            raise ProblemError("part.mass is 0 kg; it must be above 0 kg")
        tray, (x, y, z) = self.contact, self._com.tolist()
        if not isinstance(tray, Tray):
            return
        if z < 0:
            raise ProblemError(
                f"tray: the part's com is {-1000 * z:.4g} mm below the tray; turn tray.normal, "
                "which points from the tool into the part, or move part.com"
            )
        is_disc, safety = isinstance(tray.foot, (int, float)), tray.safety
        half = np.array(tray.foot) / safety / (1 if is_disc else 2)
        if np.any(half <= (np.hypot(x, y) if is_disc else np.abs((x, y)))):
            raise ProblemError(
                f"tray: the part's com is at x {1000 * x:.4g} mm, y {1000 * y:.4g} mm from the "
                f"middle of the foot, over or beyond its rim: {1000 * half.min():.4g} mm away with "
                f"safety {safety:g}; move part.com or tray.position, or give a larger foot"
            )

    @property
    def kind(self) -> str:
        """Name of the contact's kind in files, such as "cup"."""
        return self.contact.kind

    @property
    def mass_properties(self) -> Payload:
        """The part, of a liquid 1 kg at the middle of its surface."""
        assert self.part is not None
        return self.part

    @cached_property
    def priced(self) -> dict[str, float]:
        """The contact's numbers that have a price, and the part's mass [N, m, rad or kg].

        The shorter side of a foot or a pad.
        """
        numbers = {name: getattr(self.contact, name, None) for name in PRICED}
        if self.kind != "liquid":
            numbers["mass"] = self.mass_properties.mass
        return {name: float(np.min(each)) for name, each in numbers.items() if each is not None}

    def raised(self, name: str, fraction: float) -> "Holding":
        """Return the holding with a priced number larger by a fraction; inertia grows with mass."""
        owner: Any = copy(self.mass_properties if name == "mass" else self.contact)
        for each in ("mass", "inertia") if name == "mass" else (name,):
            value = (1 + fraction) * np.array(getattr(owner, each))
            object.__setattr__(owner, each, value.tolist())  # beyond accepted values, too
        return replace(self, **{"part" if name == "mass" else "contact": owner})

    @cached_property
    def cones(self) -> tuple[Cone, ...]:
        """The cones of wrenches in the contact's axes."""
        part = self.mass_properties
        cones = self.contact.cones(part.mass, self._com, any(part.inertia))
        return tuple(
            replace(cone, offset=cone.offset - self.backoff * cone.nominal) for cone in cones
        )

    @property
    def _com(self) -> FloatArray:
        """The part's centre of mass in the contact's axes, from its middle, shape (3,) [m]."""
        com: FloatArray = np.subtract(self.mass_properties.com, self.contact.position) @ self.axes
        return com

    @cached_property
    def axes(self) -> FloatArray:
        """The contact's axes in tool_frame, as columns, shape (3, 3); z is the normal.

        x is the tool frame's x made perpendicular to the normal, or its y where they are parallel.
        """
        z = np.array(self.contact.normal, dtype=float)
        z /= np.linalg.norm(z)
        for along in np.eye(3)[:2]:
            x = along - (along @ z) * z
            if np.linalg.norm(x) > 1e-6:
                break
        x /= np.linalg.norm(x)
        return read_only(np.column_stack([x, np.cross(z, x), z]))


# ---- At rest.


def rest_margins(robot: RobotModel, holdings: Sequence[Holding], q: FloatArray) -> FloatArray:
    """Return the margins of all cones of held parts at rest in configurations (N, n), (N, J).

    The J cones are those of the holdings in their order. Margins are shares of the nominal, as of
    `Cone.margin`. A part that is held at rest is held at every lower speed than one that holds it.
    """
    rotation, _ = robot.tool_pose(q)
    frame = rotation @ robot.tool_offset.placement[:3, :3].T
    return margins_against(holdings, -robot.gravity @ frame)


def margins_against(holdings: Sequence[Holding], gravity: FloatArray) -> FloatArray:
    """Return the margins of `rest_margins`, (N, J), by the tool's accelerations at rest.

    Less gravity and in the tool frame's axes: they point upwards, shape (N, 3) [m/s^2].
    """
    margins = []
    for holding in holdings:
        force = holding.mass_properties.mass * gravity
        lever = np.subtract(holding.mass_properties.com, holding.contact.position)
        moment = np.cross(lever, force)
        wrench = np.hstack([force @ holding.axes, moment @ holding.axes])
        margins += [cone.margin(wrench) for cone in holding.cones]
    return np.reshape(margins, (-1, len(gravity))).T


def loss_at_rest(robot: RobotModel, holdings: Sequence[Holding], q: FloatArray) -> str | None:
    """Return the sentence on the part that is lost at rest in a configuration (n,); None: held."""
    margins = rest_margins(robot, holdings, q[None])[0]
    if not margins.size or margins.min() >= -MARGIN_TOLERANCE:
        return None
    cones = [(holding, cone) for holding in holdings for cone in holding.cones]
    holding, cone = cones[int(margins.argmin())]
    excess = f"{-100 * margins.min():.1f} % more than"
    if holding.kind not in ("tray", "liquid"):
        return (
            f"the held part {cone.name} off at rest: it takes {excess} the {holding.kind} carries"
        )
    rotation, _ = robot.tool_pose(q[None])
    normal = rotation[0] @ robot.tool_offset.placement[:3, :3].T @ holding.axes[:, 2]
    gravity = robot.gravity / max(float(np.linalg.norm(robot.gravity)), 1e-300)
    lean = float(np.degrees(np.arccos(np.clip(-gravity @ normal, -1, 1))))
    return (
        f"the held part {cone.name} off at rest: the {holding.kind}'s normal is {lean:.1f} degrees "
        f"from upright there, {excess} the contact carries"
    )


def holdings_of(value: object) -> tuple[Holding, ...]:
    """Return one or several holdings as a tuple.

    Raises:
        ProblemError: A member is none.
    """
    members: Sequence[object] = value if isinstance(value, (list, tuple)) else (value,)
    for k, member in enumerate(members):
        if not isinstance(member, Holding):
            raise ProblemError(f"holding[{k}] is {shown(member)}; give a Holding")
    return tuple(members)  # type: ignore[arg-type]


def require_carried(holdings: Sequence[Holding], payload: Payload | None, label: str) -> None:
    """Raise ProblemError if held parts are heavier than the payload, which has a label."""
    mass = sum(each.mass_properties.mass for each in holdings if each.kind != "liquid")
    carried = 0.0 if payload is None else payload.mass
    if mass > carried * (1 + 1e-9):
        parts = "holding.part.mass is" if len(holdings) == 1 else "the masses of held parts are"
        raise ProblemError(
            f"{parts} {mass:g} kg, more than {label}, {carried:g} kg, which counts for the arm's "
            "efforts; add what is held to it"
        )


def holding_notes(holdings: Sequence[Holding]) -> list[str]:
    """Return notes on held parts without a reserve, and on parts without inertia."""
    notes = []
    for k, holding in enumerate(holdings):
        here = "holding" if len(holdings) == 1 else f"holding[{k}]"
        contact = holding.contact
        if isinstance(contact, Liquid):
            continue
        if contact.safety == 1:
            notes.append(
                f"{here}.{holding.kind}.safety is 1: a motion that just holds the part loses it at "
                f"the slightest compliance or error; {type(contact).safety:g} is usual"
            )
        if not any(holding.mass_properties.inertia):
            notes.append(
                f"{here}.part.inertia is not given: the part counts as a point at its com, which "
                "turns without a moment"
            )
    return notes
