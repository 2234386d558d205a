"""PathSamples: derivatives and efforts along a path; Coulomb friction; the protocol SpeedLimit."""

from collections.abc import Callable, Iterable, Mapping
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.limits.speed_polynomial import SpeedPolynomial
from tubeplanner.outcome import Infeasible, Location, PlanStatus
from tubeplanner.robot.model import effort_rate, gravity_effort_rate
from tubeplanner.robot.motors import JointMotors
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.parts import STILL_FRACTION

# ---- Coulomb friction at samples of a path.
#
# Friction jumps where a joint reverses. Both one-sided limits count there, so that on its way to a
# reversal the friction of the other direction must already be allowed for. Optimisers need to see
# that coming: for them, it is blended in over a range of low velocities.

# The fraction of the range before a reversal with the whole friction of the other direction, which
# covers the path between samples.
_EARLY = 0.1


@dataclass(frozen=True, eq=False)
class CoulombFriction:
    """Coulomb friction of n joints at N samples, each (N, n) [N m or N]."""

    most: FloatArray  # upper bound
    least: FloatArray  # lower bound
    most_by_rate: FloatArray  # derivative of `most` by the path's velocity dq/dx
    least_by_rate: FloatArray  # derivative of `least`, likewise

    def side(self, sign: float) -> tuple[FloatArray, FloatArray]:
        """Return the upper (1) or lower (-1) bound and its derivative by dq/dx."""
        upper = (self.most, self.most_by_rate)
        return upper if sign > 0 else (self.least, self.least_by_rate)


def directed_friction(motors: JointMotors, direction: FloatArray) -> CoulombFriction:
    """Return the friction of joints that move in known directions.

    Args:
        motors: Of the joints.
        direction: Its sign is the joints' direction, shape (N, n); 0: at rest.
    """
    effort = motors.coulomb_effort(direction)
    unsure = motors.friction_uncertainty * abs(effort)
    none = np.zeros_like(effort)
    return CoulombFriction(effort + unsure, effort - unsure, none, none)


# Bounds on blended friction have kinks: with the rate, they go from the friction of one direction
# over a ramp to that of the other. These pieces go on beyond them.
FRICTION_PIECES = ("ramp", "least")


def blended_friction(
    motors: JointMotors,
    rate: FloatArray,
    end_direction: FloatArray,
    fraction: float,
    largest: FloatArray | None = None,
    piece: str | None = None,
) -> CoulombFriction:
    """Return differentiable bounds on the friction of a whole path from both sides.

    Args:
        motors: Of the joints.
        rate: Velocities dq/dx of the path at samples all over it, shape (N, n).
        end_direction: Its sign is the direction in which a joint leaves the start or approaches the
            goal, at samples near these; nan at others, shape (N, n).
        fraction: Fraction of a joint's largest velocity below which the friction of both directions
            counts.
        largest: The joints' largest velocities, shape (n,); None: at the samples.
        piece: The piece of `FRICTION_PIECES` of which the bounds are at every rate; None: they are
            of all three pieces.
    """
    largest = abs(rate).max(axis=0) if largest is None else largest
    moves = largest > STILL_FRACTION * largest.max()
    width = np.where(moves, fraction * largest, 1.0)
    forwards, backwards = motors.forwards_friction, -motors.backwards_friction
    more, less = 1 + motors.friction_uncertainty, 1 - motors.friction_uncertainty
    slope = 1 / (width * (1 - _EARLY))
    ahead, behind = ((width + sign * rate) * slope for sign in (1.0, -1.0))
    if piece != "ramp":
        ahead, behind = (np.clip(each, 0, piece is None) for each in (ahead, behind))
    on_ramp = [(each < 1) & (each > 0) | (piece == "ramp") for each in (ahead, behind)]
    rise, fall = forwards * more - backwards * less, forwards * less - backwards * more
    blended = CoulombFriction(
        backwards * less + rise * ahead,
        forwards * less - fall * behind,
        rise * slope * on_ramp[0],
        fall * slope * on_ramp[1],
    )
    is_exact = ~np.isnan(end_direction) | ~moves
    exact = directed_friction(motors, np.where(moves, np.nan_to_num(end_direction), 0.0))
    names = CoulombFriction.__dataclass_fields__
    return CoulombFriction(
        *(np.where(is_exact, getattr(exact, name), getattr(blended, name)) for name in names)
    )


@dataclass(frozen=True, eq=False)
class PathSamples:
    """A path q(x) at N samples, and the quantities that limits need of it, each computed once.

    Run in x per second, its derivatives by x are velocity, acceleration and jerk.
    """

    problem: PlanningProblem  # its segments joined
    # positions and their derivatives by x, up to the second or third: (orders, N, n)
    by_path: FloatArray
    # returns the tube segment of each sample, shape (N,); None: not known
    segments: Callable[[], IntArray] | None = None
    # returns the Coulomb friction at the samples; None: by the signs of velocities
    friction: Callable[[], CoulombFriction] | None = None
    _effort_derivatives: dict[float, tuple[FloatArray, FloatArray, FloatArray]] = field(
        default_factory=dict, repr=False
    )

    def __len__(self) -> int:
        return self.by_path.shape[1]

    @property
    def position(self) -> FloatArray:
        """Shape (N, n) [rad or m]."""
        return self.by_path[0]

    def rate(self, order: int, speed: float) -> FloatArray:
        """Return velocity (1), acceleration (2) or jerk (3) at a speed, shape (N, n)."""
        rate: FloatArray = self.by_path[order] * speed**order
        return rate

    @cached_property
    def segment(self) -> IntArray:
        """The tube segment of each sample, shape (N,)."""
        if self.segments is None:
            raise RuntimeError("samples without segments: what depends on these is to be left out")
        return self.segments()

    @cached_property
    def gravity(self) -> FloatArray:
        """Efforts that hold the arm still, shape (N, n) [N m or N]."""
        return self.problem.robot.gravity_effort(self.position)

    @cached_property
    def effort(self) -> FloatArray:
        """Efforts at a speed of 1, Coulomb friction left out, shape (N, n) [N m or N]."""
        return self.problem.robot.inverse_dynamics(*self.by_path[:3])

    @cached_property
    def viscous_effort(self) -> FloatArray:
        """Efforts at a speed of 1 against viscous friction, shape (N, n) [N m or N]."""
        return self.problem.robot.motors.viscous_friction * self.by_path[1]

    @cached_property
    def coulomb_friction(self) -> CoulombFriction:
        """Coulomb friction, at any speed."""
        if self.friction is not None:
            return self.friction()
        return directed_friction(self.problem.robot.motors, self.direction)

    @cached_property
    def direction(self) -> FloatArray:
        """Velocities dq/dx whose sign is the joints' direction, 0 at rest, shape (N, n).

        A velocity of zero but for rounding has no direction.
        """
        rate = self.by_path[1]
        moves = abs(rate) > STILL_FRACTION * abs(rate).max(initial=0.0)
        return np.where(moves, rate, 0.0)

    @cached_property
    def effort_rate(self) -> FloatArray:
        """Rates of change of the efforts at a speed of 1, shape (N, n) [N m/s or N/s]."""
        return effort_rate(self.problem.robot, *self.by_path[:4])

    @cached_property
    def gravity_rate(self) -> FloatArray:
        """Rates of change of the efforts against gravity at a speed of 1, likewise."""
        return gravity_effort_rate(self.problem.robot, *self.by_path[:2])

    def with_friction(self, friction: Callable[[], CoulombFriction]) -> "PathSamples":
        """Return the path with another friction, all else shared."""
        other = copy(self)
        other.__dict__.pop("coulomb_friction", None)
        object.__setattr__(other, "friction", friction)
        return other

    def effort_derivatives(self, speed: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the efforts' derivatives by position, velocity and acceleration at a speed.

        As `RobotModel.inverse_dynamics_derivatives`, (N, n, n) each; cached for one speed.
        """
        cache = self._effort_derivatives
        if speed not in cache:
            cache.clear()
            cache[speed] = self.problem.robot.inverse_dynamics_derivatives(
                self.position, self.rate(1, speed), self.rate(2, speed)
            )
        return cache[speed]

    @cached_property
    def tool_pose(self) -> tuple[FloatArray, FloatArray]:
        """Rotation (N, 3, 3) and position (N, 3) [m] of the tool centre point."""
        return self.problem.tube.tool_pose(self.problem.robot, self.position)

    @cached_property
    def tool_rate(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Velocity of the tool (N, 3) at a speed of 1, and its derivatives by q and q', (N, 3, n).

        As `RobotModel.tool_velocity`.
        """
        return self.problem.robot.tool_velocity(*self.by_path[:2])

    @cached_property
    def tool_motion(self) -> FloatArray:
        """Motion of the tool at a speed of 1, as `RobotModel.tool_motion`, shape (N, 9)."""
        return self.problem.robot.tool_motion(*self.by_path[:3])

    @cached_property
    def tool_motion_derivatives(self) -> FloatArray:
        """Derivatives of `tool_motion` by q, q' and q'', shape (3, N, 9, n)."""
        return self.problem.robot.tool_motion_derivatives(*self.by_path[:3])

    @cached_property
    def point_rates(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Velocities of P speed-limited points (P, N, 3), their derivatives, twice (P, N, 3, n).

        As `tool_rate`.
        """
        return self.problem.robot.point_velocities(*self.by_path[:2])

    @cached_property
    def tool_jacobian(self) -> FloatArray:
        """Jacobian of the tool centre point, as `RobotModel.tool_jacobian`, shape (N, 6, n)."""
        return self.problem.robot.tool_jacobian(self.position)[1]


# ---- The interface of all limits on a trajectory's speed: phases, time scaling and plots use it.


@dataclass(frozen=True)
class LimitKey:
    """The identity of a limit."""

    kind: str  # such as "effort", "velocity", "radius"
    joint: int | None = None  # index of the limited joint; None: a segment's or the goal's
    segment: int | None = None  # index of the segment; None: a joint's or the goal's
    link: str | None = None  # name of the link with the limited point; None: none
    point: int | None = None  # index among the limited points
    contact: int | None = None  # index among the problem's holdings
    parameter: str | None = None  # of the contact: "force", "friction", "foot", "tilt", ...


class SpeedLimit(Protocol):
    """A limit of I quantities that grow with the speed s = dx/dt at which a path q(x) is run.

    Quantities are fractions of nominal limits, and sign * quantity <= 1. Where a limit L depends on
    the configuration, the quantity is used / nominal + 1 - L / nominal: L may be 0.
    """

    @property
    def kind(self) -> str:
        """The kind's name in certificate, sensitivities and figures."""

    @property
    def order(self) -> int:
        """The highest derivative of q(x) that the quantities depend on."""

    @property
    def keys(self) -> tuple[LimitKey, ...]:
        """The limits that can be raised or lowered, each on its own."""

    @property
    def signs(self) -> tuple[float, ...]:
        """The bounded sides."""

    def used(self, at: PathSamples) -> SpeedPolynomial:
        """Return the quantities at any speed, terms of shape (N, I)."""

    def by_path(self, at: PathSamples, speed: float) -> Mapping[int, FloatArray]:
        """Return the derivatives by q (0) and its derivatives by x (1, ...), each (N, I, n)."""

    def key_of(self, at: PathSamples) -> IntArray:
        """Return the index of each quantity's key, shape (N, I) or (1, I)."""

    def refusal(self, at: PathSamples) -> Infeasible:
        """Return the reason why no speed is slow enough at some sample."""


class KeptWhenSlow:
    """A `SpeedLimit` that any path keeps if it is run slowly enough."""

    kind: str

    def refusal(self, at: PathSamples) -> Infeasible:
        """Return a refusal that never occurs."""
        return Infeasible(PlanStatus.NO_TRAJECTORY, f"{self.kind} allows no motion", Location())


class JointSpeedLimit(KeptWhenSlow):
    """Base of a `SpeedLimit` on a quantity of joints, with a key for each joint.

    A subclass has `kind`, `order`, and either `terms` and `derivatives` or `used` and `by_path`.

    Attributes:
        joints: The I limited joints; of limits with two sides, twice, shape (2 I,).
        sign: 1 forwards, then -1 backwards, likewise.
        limit: Their limits in the quantity's unit, likewise.
    """

    order: int
    signs: tuple[float, ...] = (1.0, -1.0)

    def __init__(self, limit: FloatArray, sides: int = 1) -> None:
        """Take the finite limits of n joints, shape (n,), and the number of sides."""
        joints = np.flatnonzero(np.isfinite(limit))
        self.joints = np.tile(joints, sides)
        self.sign = np.repeat([1.0, -1.0][:sides], len(joints))
        self.limit = limit[self.joints]
        self.keys = tuple(LimitKey(self.kind, joint=j) for j in joints.tolist())

    def terms(self, at: PathSamples) -> Mapping[int, FloatArray]:
        """Return the terms of the quantity by powers of the speed, (N, n) each."""
        raise NotImplementedError

    def derivatives(self, at: PathSamples, speed: float) -> Iterable[FloatArray]:
        """Return the derivatives by position, velocity, ... at a speed, (N, n, n) each."""
        raise NotImplementedError

    def used(self, at: PathSamples) -> SpeedPolynomial:
        """Return the quantities as fractions of their limits."""
        terms = self.terms(at).items()
        return SpeedPolynomial({power: term[:, self.joints] / self.limit for power, term in terms})

    def by_path(self, at: PathSamples, speed: float) -> Mapping[int, FloatArray]:
        """Return the derivatives of the fractions by the path."""
        blocks = enumerate(self.derivatives(at, speed))
        return {k: by[:, self.joints] * (speed**k / self.limit[:, None]) for k, by in blocks}

    def key_of(self, at: PathSamples) -> IntArray:
        """Return the index of each quantity's key, shape (1, I) or (1, 2 I)."""
        sides = len(self.joints) // max(len(self.keys), 1)
        return np.tile(np.arange(len(self.keys)), sides)[None]
