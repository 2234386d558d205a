"""Holding: a part that a cup, a tray or a gripper holds, or a liquid; the cones of its contact.

The wrench of the tool on the part has its moment about the contact's middle p and the contact's
axes C, z along the normal from the tool into the part:

    W = (C^T f, C^T tau),  f = m (b + al x c + w x (w x c)),  tau = I al + w x I w + (c - p) x f

with the acceleration b of the tool frame's origin less gravity, the angular velocity w and the
angular acceleration al, all in the tool frame. A contact holds while W is in cones
|across W| <= along . W + offset.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar, TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray, read_only
from tubeplanner.errors import ProblemError, shown
from tubeplanner.fields import Finite, Vector, declaration, declared, documented
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


def _both_ways(
    name: str, component: FloatArray, along: FloatArray, offset: float, nominal: float
) -> list[Cone]:
    """Return the two half spaces of |component . W| <= along . W + offset."""
    none = np.zeros((0, 6))
    return [Cone(name, none, along - sign * component, offset, nominal) for sign in (1.0, -1.0)]


# ---- Contacts.


@documented
@dataclass(frozen=True)
class Cup:
    """A suction cup: a ring that the vacuum presses onto the part."""

    kind: ClassVar[str] = "cup"
    force: Finite = field(metadata=declaration("at working pressure [N]"))
    radius: Finite = field(metadata=declaration("of the ring [m]"))
    friction: Finite = field(metadata=declaration("coefficient between ring and part"))
    safety: Finite = declared(1.5, "divides the force")
    position: Vector = declared((0.0, 0.0, 0.0), "middle of the ring in tool_frame [m]")
    normal: Vector = declared((0.0, 0.0, 1.0), "from the tool into the part, in tool_frame")

    def cones(self, part: Payload) -> list[Cone]:
        """Return the cones of a part."""
        pull, mu, r = self.force / self.safety, self.friction, self.radius
        slide, tip = mu * pull, r * pull
        return [
            Cone("slides", np.array([_FX, _FY, _TZ / r]), mu * _FZ, slide, slide),
            Cone("tips", np.array([_TX, _TY]), r * _FZ, tip, tip),
        ]


@documented
@dataclass(frozen=True)
class Tray:
    """A tray: the part stands on it."""

    kind: ClassVar[str] = "tray"
    friction: Finite = field(metadata=declaration("coefficient between tray and part"))
    foot: tuple[Finite, Finite] | Finite = field(
        metadata=declaration(
            "full lengths along x, the tool frame's x made perpendicular to the normal, and y; or "
            "a disc's radius [m]"
        )
    )
    safety: Finite = declared(1.2, "divides friction and foot; 1 - 1/safety of the weight is kept")
    position: Vector = declared((0.0, 0.0, 0.0), "middle of the foot in tool_frame [m]")
    normal: Vector = declared((0.0, 0.0, 1.0), "from the tool into the part, in tool_frame")

    def cones(self, part: Payload) -> list[Cone]:
        """Return the cones of a part, of a rectangle by Caron, Pham & Nakamura (ICRA 2015)."""
        mu, weight = self.friction / self.safety, part.mass * GRAVITY
        kept = (1 - 1 / self.safety) * weight
        slide = mu * weight
        if isinstance(self.foot, (int, float)):
            r = self.foot / self.safety
            tip = np.array([_TX, _TY])
            across = np.array([_FX, _FY, _TZ / (2 * self.foot / 3)])
            return [
                Cone("slides", across, mu * _FZ, -mu * kept, slide),
                Cone("tips", tip, r * _FZ, -r * kept, r * weight),
            ]
        x, y = (length / 2 / self.safety for length in self.foot)
        rho = 0.383 * 2 * np.sqrt(x * y) * self.safety
        across = np.array([_FX, _FY, _TZ / rho])
        cones = [Cone("slides", across, mu * _FZ, -mu * kept, slide)]
        cones += _both_ways("tips", _TY, x * _FZ, -x * kept, x * weight)
        cones += _both_ways("tips", _TX, y * _FZ, -y * kept, y * weight)
        both = mu * (x + y)
        for sign in (1.0, -1.0):
            one, two = y * _FX + sign * mu * _TX, x * _FY + sign * mu * _TY
            bound = both * _FZ - sign * _TZ
            for component in (one + two, one - two):
                cones += _both_ways("slides", component, bound, -both * kept, both * weight)
        return cones


@documented
@dataclass(frozen=True)
class Gripper:
    """A gripper with two fingers: it presses the part from both sides."""

    kind: ClassVar[str] = "gripper"
    force: Finite = field(metadata=declaration("of each finger [N]"))
    friction: Finite = field(metadata=declaration("coefficient between pads and part"))
    pad: tuple[Finite, Finite] = field(
        metadata=declaration("full lengths of the pads along the contact's x and y [m]")
    )
    torsion: Finite = declared(0.01, "radius of the friction against turning [m]")
    safety: Finite = declared(2.0, "divides the force")
    position: Vector = declared((0.0, 0.0, 0.0), "middle between the pads in tool_frame [m]")
    closing: Vector = declared((1.0, 0.0, 0.0), "direction in which it closes, in tool_frame")

    @property
    def normal(self) -> Vector:
        """The closing direction."""
        return self.closing

    def cones(self, part: Payload) -> list[Cone]:
        """Return the cones of a part."""
        press, mu = self.force / self.safety, self.friction
        slide = 2 * mu * press
        across = np.array([_FX, _FY, _TZ / self.torsion])
        cones = [Cone("slides", across, sign * mu * _FZ, slide, slide) for sign in (1.0, -1.0)]
        x, y = (length / 2 * press for length in self.pad)
        none = np.zeros(6)
        return [
            *cones,
            *_both_ways("tips", _TX, none, y, y),
            *_both_ways("tips", _TY, none, x, x),
        ]


@documented
@dataclass(frozen=True)
class Liquid:
    """A liquid in an open vessel: its surface leans against the vessel."""

    kind: ClassVar[str] = "liquid"
    tilt: Finite = field(metadata=declaration("largest angle of the surface in the vessel [rad]"))
    position: Vector = declared((0.0, 0.0, 0.0), "middle of the surface in tool_frame [m]")
    normal: Vector = declared((0.0, 0.0, 1.0), "upwards out of the vessel, in tool_frame")
    safety: ClassVar[float] = 1.0

    def cones(self, part: Payload) -> list[Cone]:
        """Return the cone of a small mass at the surface."""
        slope = float(np.tan(self.tilt))
        nominal = slope * part.mass * GRAVITY
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
    """

    contact: ContactKind
    part: Payload | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.contact, CONTACT_KINDS):
            raise ProblemError(
                f"holding is by {shown(self.contact)}; give a Cup, Tray, Gripper or Liquid"
            )
        if isinstance(self.contact, Liquid):
            position = self.contact.position
            object.__setattr__(self, "part", Payload(1.0, position))
        if self.part is None or not self.part.mass > 0:
            raise ProblemError("holding.part is required, with a mass above 0 kg")

    @property
    def kind(self) -> str:
        """The contact's name in files: "cup", "tray", "gripper" or "liquid"."""
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

        def larger(value: float | tuple[float, ...]) -> Any:
            raised = (1 + fraction) * np.array(value)
            return tuple(raised.tolist()) if raised.ndim else float(raised)

        part, contact = self.mass_properties, self.contact
        if name == "mass":
            part = replace(part, mass=larger(part.mass), inertia=larger(part.inertia))
        else:
            contact = replace(contact, **{name: larger(getattr(contact, name))})
        return replace(self, contact=contact, part=part)

    @cached_property
    def cones(self) -> tuple[Cone, ...]:
        """The cones of wrenches in the contact's axes."""
        return tuple(self.contact.cones(self.mass_properties))

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
    gravity = -robot.gravity @ frame  # of the tool less gravity, in tool_frame
    margins = []
    for holding in holdings:
        force = holding.mass_properties.mass * gravity
        lever = np.subtract(holding.mass_properties.com, holding.contact.position)
        moment = np.cross(lever, force)
        wrench = np.hstack([force @ holding.axes, moment @ holding.axes])
        margins += [cone.margin(wrench) for cone in holding.cones]
    return np.reshape(margins, (-1, len(q))).T


def loss_at_rest(robot: RobotModel, holdings: Sequence[Holding], q: FloatArray) -> str | None:
    """Return the sentence on the part that is lost at rest in a configuration (n,); None: held."""
    margins = rest_margins(robot, holdings, q[None])[0]
    if not margins.size or margins.min() >= -MARGIN_TOLERANCE:
        return None
    cones = [(holding, cone) for holding in holdings for cone in holding.cones]
    holding, cone = cones[int(margins.argmin())]
    rotation, _ = robot.tool_pose(q[None])
    normal = rotation[0] @ robot.tool_offset.placement[:3, :3].T @ holding.axes[:, 2]
    gravity = robot.gravity / max(float(np.linalg.norm(robot.gravity)), 1e-300)
    lean = float(np.degrees(np.arccos(np.clip(-gravity @ normal, -1, 1))))
    return (
        f"the held part {cone.name} off at rest: the {holding.kind}'s normal is {lean:.1f} degrees "
        f"from upright there, {-100 * margins.min():.1f} % more than the contact carries"
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
