"""Effort limits by direction, position and speed; effort rates; holding efforts at rest."""

from collections.abc import Mapping, Sequence
from typing import TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.limits.path_samples import KeptWhenSlow, LimitKey, PathSamples, directed_friction
from tubeplanner.limits.speed_polynomial import SpeedPolynomial
from tubeplanner.outcome import MARGIN_TOLERANCE, Infeasible, Location, PlanStatus
from tubeplanner.robot.joint_limits import JointLimits
from tubeplanner.robot.model import effort_rate_derivatives
from tubeplanner.robot.motors import JointMotors
from tubeplanner.robot.overrides import CURVE
from tubeplanner.task.problem import PlanningProblem


def effort_refusal(
    at: PathSamples,
    sample: int,
    joint: int,
    needed: float,
    limit: float,
    *,
    mass: float | None = None,
    proved: bool = False,
) -> Infeasible:
    """Return the refusal that a joint can neither hold nor slowly move its load.

    Args:
        at: The path.
        sample: Index of the sample on it.
        joint: Index of the joint.
        needed: Size of its effort at rest or at low speed [N m or N].
        limit: The effort limit of its motor there, in that direction [N m or N].
        mass: The heaviest payload that all joints hold there [kg]; 0: none; None: not known.
        proved: As of `Infeasible`.
    """
    robot = at.problem.robot
    name, unit = robot.joint_names[joint], "N m" if robot.revolute[joint] else "N"
    has_friction = robot.motors.backwards_friction[joint] or robot.motors.forwards_friction[joint]
    against = "gravity and friction" if has_friction else "gravity alone"
    lighten = "lighten the payload, " if mass is None else f"carry at most {mass:.3g} kg, "
    if robot.payload is None or mass == 0:
        lighten = ""
    stalls = limit >= robot.motors.saturation_effort[joint]
    key = f"motors.{CURVE[0]}" if stalls else "limits.effort"
    return Infeasible(
        PlanStatus.GRAVITY_EXCEEDS_EFFORT,
        f"joint '{name}' needs {needed:.2f} {unit} against {against}, its effort limit is "
        f"{limit:.2f}; {lighten}choose another configuration or a motor with "
        f"{needed - limit:.3g} {unit} more (robot.{key}.{name})",
        Location(joint=name).at(at.tool_pose[1][sample]),
        proved=proved,
        configuration=at.position[sample],
    )


class JointEffort:
    """A `SpeedLimit` on the efforts of some joints, the same in both directions.

    Attributes:
        joints: The I limited joints.
        limit: Their limits, shape (I,) [N m or N].
    """

    kind = "effort"
    order = 2
    signs = (1.0, -1.0)

    def __init__(self, limit: FloatArray, *, with_coulomb_friction: bool = False) -> None:
        """Take the finite limits of n joints.

        Args:
            limit: Shape (n,) [N m or N].
            with_coulomb_friction: Whether Coulomb friction counts, by the directions of motion. Its
                jumps have no derivatives: for sums over a motion.
        """
        self._with_coulomb_friction = with_coulomb_friction
        self.joints = np.flatnonzero(np.isfinite(limit))
        self.limit = limit[self.joints]
        self.keys = tuple(LimitKey(self.kind, joint=j) for j in self.joints.tolist())

    def used(self, at: PathSamples) -> SpeedPolynomial:
        """Return the efforts as fractions of their limits."""
        motors, own = at.problem.robot.motors, self.joints
        terms = {0: at.gravity[:, own], 2: (at.effort - at.gravity)[:, own]}
        if motors.has_viscous_friction:
            terms[1] = at.viscous_effort[:, own]
            terms[2] = terms[2] - terms[1]
        if self._with_coulomb_friction:
            terms[0] = terms[0] + motors.coulomb_effort(at.direction)[:, own]
        return SpeedPolynomial({power: term / self.limit for power, term in terms.items()})

    def by_path(self, at: PathSamples, speed: float) -> Mapping[int, FloatArray]:
        """Return the derivatives of the fractions by the path."""
        blocks = enumerate(at.effort_derivatives(speed))
        return {k: by[:, self.joints] * (speed**k / self.limit[:, None]) for k, by in blocks}

    def key_of(self, at: PathSamples) -> IntArray:
        """Return the index of each joint's key, shape (1, I)."""
        return np.arange(len(self.joints))[None]

    def refusal(self, at: PathSamples) -> Infeasible:
        """Return the refusal of the joint that gravity exceeds most."""
        effort = abs(at.gravity[:, self.joints])
        sample, column = np.unravel_index(int((effort - self.limit).argmax()), effort.shape)
        needed, limit = float(effort[sample, column]), float(self.limit[column])
        return effort_refusal(at, int(sample), int(self.joints[column]), needed, limit)


# ---- Efforts by side: of each joint forwards and then backwards, with its friction.
#
# The upper side bounds the most that a joint may need, the lower side the least: where friction is
# uncertain, or its direction about to change, these differ.


class SidedEffort:
    """The efforts of some joints on both sides, 2 I quantities [N m or N].

    Attributes:
        joints: The joints, twice, shape (2 I,).
        sign: 1 forwards, -1 backwards, shape (2 I,).
    """

    def __init__(self, joints: IntArray) -> None:
        """Take I joints."""
        self.joints = np.tile(joints, 2)
        self.sign = np.repeat([1.0, -1.0], len(joints))

    def terms(self, at: PathSamples) -> dict[int, FloatArray]:
        """Return the terms of the efforts by powers of the speed, with the worse friction."""
        still, moving = at.gravity + at.viscous_effort, at.effort
        unsure = at.problem.robot.motors.friction_uncertainty * abs(at.viscous_effort)
        dry = self._dry(at, 0)
        return {
            0: self.sign * (at.gravity[:, self.joints] + dry),
            1: self.sign * at.viscous_effort[:, self.joints] + unsure[:, self.joints],
            2: self.sign * (moving - still)[:, self.joints],
        }

    def by_path(self, at: PathSamples, speed: float) -> dict[int, FloatArray]:
        """Return the derivatives of the efforts by the path at a speed, (N, 2 I, n) each."""
        motors = at.problem.robot.motors
        blocks = enumerate(at.effort_derivatives(speed))
        change = {k: by[:, self.joints] * (speed**k * self.sign[:, None]) for k, by in blocks}
        unsure = motors.friction_uncertainty * motors.viscous_friction * speed
        by_rate = (unsure * np.sign(at.by_path[1]))[:, self.joints] + self.sign * self._dry(at, 1)
        every = np.arange(len(self.joints))
        change[1][:, every, self.joints] += by_rate
        return change

    def _dry(self, at: PathSamples, order: int) -> FloatArray:
        """Return Coulomb friction (0) or its derivative by dq/dx (1), shape (N, 2 I)."""
        half = len(self.joints) // 2
        sides = [
            at.coulomb_friction.side(sign)[order][:, self.joints[:half]] for sign in (1.0, -1.0)
        ]
        return np.concatenate(sides, axis=1)


# ---- Effort limits of joints with Coulomb friction, or with limits by direction or position.


class EffortLimit:
    """A `SpeedLimit` on the efforts of some joints, forwards and then backwards: 2 I quantities.

    Attributes:
        joints: The limited joints, twice, shape (2 I,).
        limit: Nominal limits: the largest in each direction anywhere, shape (2 I,) [N m or N].
    """

    kind = "effort"
    order = 2
    signs = (1.0,)

    def __init__(self, limits: JointLimits) -> None:
        """Take the joints that have a limit."""
        joints = np.flatnonzero(np.isfinite(limits.effort))
        self._effort = SidedEffort(joints)
        self.joints = self._effort.joints
        row_of = {int(joint): k for k, joint in enumerate(joints)}
        self._ranges = [
            (row_of[each.joint] + len(joints) * (sign < 0), sign, each)
            for each in limits.effort_ranges
            for sign in (1.0, -1.0)
        ]
        self.limit = limits.effort[self.joints].copy()
        for column, sign, each in self._ranges:
            self.limit[column] = each.side(sign).max()
        self.keys = tuple(LimitKey(self.kind, joint=j) for j in joints.tolist())

    def used(self, at: PathSamples) -> SpeedPolynomial:
        """Return the efforts, and the shortfall of limits, as fractions of the nominal limits."""
        allowed = np.ones((len(at), len(self.joints)))
        for column, sign, each in self._ranges:
            allowed[:, column] = each.allowed(at.position[:, each.joint], sign) / self.limit[column]
        terms = {k: term / self.limit for k, term in self._effort.terms(at).items()}
        terms[0] += 1 - allowed
        return SpeedPolynomial(terms, allowed)

    def by_path(self, at: PathSamples, speed: float) -> Mapping[int, FloatArray]:
        """Return the derivatives of the fractions by the path."""
        change = {k: by / self.limit[:, None] for k, by in self._effort.by_path(at, speed).items()}
        for column, sign, each in self._ranges:
            slope = each.slope(at.position[:, each.joint], sign)
            change[0][:, column, each.joint] -= slope / self.limit[column]
        return change

    def key_of(self, at: PathSamples) -> IntArray:
        """Return the index of each quantity's key, shape (1, 2 I)."""
        return np.tile(np.arange(len(self.keys)), 2)[None]

    def refusal(self, at: PathSamples) -> Infeasible:
        """Return the refusal of the joint that gravity and friction exceed most."""
        used = self.used(at)
        sample, column = np.unravel_index(int(used.terms[0].argmax()), used.shape)
        allowed = 1.0 if used.allowed is None else float(used.allowed[sample, column])
        needed = (used.terms[0][sample, column] - 1 + allowed) * self.limit[column]
        return effort_refusal(
            at, int(sample), int(self.joints[column]), float(needed), allowed * self.limit[column]
        )


class MotorCurve:
    """A `SpeedLimit` on the torque-speed lines of some joints: 2 I quantities.

    An effort tau at the velocity v uses tau / S + v / v0 forwards, S the saturation effort and v0
    the no-load velocity, and minus that backwards. A key stands for both, raised together.

    Attributes:
        joints: The joints with such a line, twice, shape (2 I,).
    """

    kind = "motor_curve"
    order = 2
    signs = (1.0,)

    def __init__(self, motors: JointMotors) -> None:
        """Take the joints that have a line."""
        joints = np.flatnonzero(motors.has_curve)
        self._effort = SidedEffort(joints)
        self.joints, self._sign = self._effort.joints, self._effort.sign
        self._stall = motors.saturation_effort[self.joints]
        self._no_load = motors.no_load_velocity[self.joints]
        self.keys = tuple(LimitKey(self.kind, joint=j) for j in joints.tolist())

    def used(self, at: PathSamples) -> SpeedPolynomial:
        """Return the fractions of the lines that efforts and velocities use together."""
        terms = {k: term / self._stall for k, term in self._effort.terms(at).items()}
        terms[1] = terms[1] + self._sign * at.by_path[1][:, self.joints] / self._no_load
        return SpeedPolynomial(terms)

    def by_path(self, at: PathSamples, speed: float) -> Mapping[int, FloatArray]:
        """Return the derivatives of the fractions by the path."""
        change = {k: by / self._stall[:, None] for k, by in self._effort.by_path(at, speed).items()}
        every = np.arange(len(self.joints))
        change[1][:, every, self.joints] += self._sign * speed / self._no_load
        return change

    def key_of(self, at: PathSamples) -> IntArray:
        """Return the index of each quantity's key, shape (1, 2 I)."""
        return np.tile(np.arange(len(self.keys)), 2)[None]

    def refusal(self, at: PathSamples) -> Infeasible:
        """Return the refusal of the motor that stalls under gravity and friction."""
        fraction = self.used(at).terms[0]
        sample, column = np.unravel_index(int(fraction.argmax()), fraction.shape)
        stall = float(self._stall[column])
        needed = float(fraction[sample, column]) * stall
        return effort_refusal(at, int(sample), int(self.joints[column]), needed, stall)


class EffortRate(KeptWhenSlow):
    """A `SpeedLimit` on the rates of some joints' efforts, inside pieces: they are smooth there.

    Rates of gravity grow with s, of viscous friction with s^2, the rest with s^3. Coulomb friction,
    which jumps, does not count.

    Attributes:
        joints: The I limited joints.
        limit: Their limits, shape (I,) [N m/s or N/s].
    """

    kind = "effort_rate"
    order = 3
    signs = (1.0, -1.0)

    def __init__(self, limit: FloatArray) -> None:
        """Take the finite limits of n joints, (n,) [N m/s or N/s]."""
        self.joints = np.flatnonzero(np.isfinite(limit))
        self.limit = limit[self.joints]
        self.keys = tuple(LimitKey(self.kind, joint=j) for j in self.joints.tolist())

    def used(self, at: PathSamples) -> SpeedPolynomial:
        """Return the rates as fractions of their limits."""
        rate, gravity = at.effort_rate[:, self.joints], at.gravity_rate[:, self.joints]
        motors = at.problem.robot.motors
        if not motors.has_viscous_friction:
            return SpeedPolynomial({1: gravity / self.limit, 3: (rate - gravity) / self.limit})
        viscous = (motors.viscous_friction * at.by_path[2])[:, self.joints]
        terms = {1: gravity, 2: viscous, 3: rate - gravity - viscous}
        return SpeedPolynomial({power: term / self.limit for power, term in terms.items()})

    def by_path(self, at: PathSamples, speed: float) -> Mapping[int, FloatArray]:
        """Return the derivatives of the fractions by the path."""
        state = (at.position, at.rate(1, speed), at.rate(2, speed), at.rate(3, speed))
        blocks = enumerate(effort_rate_derivatives(at.problem.robot, *state))
        return {k: by[:, self.joints] * (speed**k / self.limit[:, None]) for k, by in blocks}

    def key_of(self, at: PathSamples) -> IntArray:
        """Return the index of each joint's key, shape (1, I)."""
        return np.arange(len(self.joints))[None]


# ---- Holding efforts: at rest, gravity and friction count.

_HALVINGS = 40  # of the payload's mass
# Tolerances of a certificate, which lets both efforts and ends be off.
_PROVED = 10


def require_held(
    problem: PlanningProblem, q: FloatArray, *, is_given: bool = False, must_leave: bool = False
) -> None:
    """Check that every joint can stand still or move slowly in some direction.

    Args:
        problem: The planning problem.
        q: A configuration, shape (n,).
        is_given: Whether every trajectory rests in this configuration: then no trajectory exists
            for certain, and the message names the payload that would be held.
        must_leave: Whether every trajectory moves some joint from or to there. At rest no joint is
            carried along by others: one of them must be able to move slowly.

    Raises:
        Infeasible: Status gravity_exceeds_effort.
    """
    gravity = problem.robot.gravity_effort(q[None])
    directions = _slow_efforts(problem, q, gravity, must_leave)
    beyond = _beyond(directions)
    shortfall = beyond.min(axis=0)
    joint = int(shortfall.argmax())
    if shortfall[joint] <= 0:
        return
    needed, allowed = directions[int(beyond[:, joint].argmin())]
    side = int((needed - allowed)[:, joint].argmax())
    still = np.zeros_like(q)
    at = PathSamples(problem, np.stack([q, still, still])[:, None])
    needed_most, allowed_most = float(needed[side, joint]), float(allowed[side, joint])
    mass = _held_mass(problem, q, gravity, must_leave) if is_given else None
    limits = (problem.robot.limits.effort[joint], problem.robot.motors.saturation_effort[joint])
    tolerated = _PROVED * MARGIN_TOLERANCE * max(limit for limit in limits if limit < np.inf)
    proved = is_given and bool(shortfall[joint] > tolerated)
    raise effort_refusal(at, 0, joint, needed_most, allowed_most, mass=mass, proved=proved)


def _held_mass(
    problem: PlanningProblem, q: FloatArray, gravity: FloatArray, must_leave: bool
) -> float:
    """Return the heaviest payload that all joints hold [kg]; 0 if the empty arm is not held.

    Efforts (1, n) against gravity are affine in the payload's mass.
    """
    payload = problem.robot.payload
    if payload is None:
        return 0.0
    empty = problem.robot.with_payload(None).gravity_effort(q[None])

    def is_held(fraction: float) -> bool:
        there = empty + fraction * (gravity - empty)
        directions = _slow_efforts(problem, q, there, must_leave)
        return bool((_beyond(directions).min(axis=0) <= 0).all())

    if not is_held(0.0):
        return 0.0
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if is_held(middle) else (low, middle)
    return float(low * payload.mass)


_Efforts: TypeAlias = tuple[FloatArray, FloatArray]


def _slow_efforts(
    problem: PlanningProblem, q: FloatArray, gravity: FloatArray, must_leave: bool
) -> list[_Efforts]:
    """Return needed and available efforts when all joints stand still, creep up, creep down.

    Each (2, n): forwards and backwards. A joint that stands still has no Coulomb friction. Without
    standing still, if joints must leave and none can creep.
    """
    robot = problem.robot
    sides = [robot.limits.effort_at(q[None], sign) for sign in (1.0, -1.0)]
    allowed = np.minimum(np.concatenate(sides), robot.motors.saturation_effort)
    result = []
    for direction in (0.0, 1.0, -1.0):
        friction = directed_friction(robot.motors, np.full_like(gravity, direction))
        needed = np.concatenate([gravity + friction.most, -gravity - friction.least])
        result.append((needed, allowed))
    is_locked = must_leave and bool((_beyond(result[1:]) > 0).all())
    return result[1:] if is_locked else result


def _beyond(directions: Sequence[_Efforts]) -> FloatArray:
    """Return the shortfall of each joint's effort in each direction, (2, n)."""
    return np.array([(needed - allowed).max(axis=0) for needed, allowed in directions])
