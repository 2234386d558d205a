"""Effort limits by direction, position and speed; effort rates; holding efforts at rest."""

from collections.abc import Iterable, Mapping, Sequence
from typing import TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.limits.path_samples import JointSpeedLimit, PathSamples, directed_friction
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


class JointEffort(JointSpeedLimit):
    """A `SpeedLimit` on the efforts of some joints, the same in both directions [N m or N]."""

    kind = "effort"
    order = 2

    def __init__(self, limit: FloatArray, *, with_coulomb_friction: bool = False) -> None:
        """Take the finite limits of n joints.

        Args:
            limit: Shape (n,) [N m or N].
            with_coulomb_friction: Whether Coulomb friction counts, by the directions of motion. Its
                jumps have no derivatives: for sums over a motion.
        """
        super().__init__(limit)
        self._with_coulomb_friction = with_coulomb_friction

    def terms(self, at: PathSamples) -> Mapping[int, FloatArray]:
        """Return the efforts by powers of the speed, (N, n) each."""
        motors = at.problem.robot.motors
        terms = {0: at.gravity, 2: at.effort - at.gravity}
        if motors.has_viscous_friction:
            terms[1] = at.viscous_effort
            terms[2] = terms[2] - terms[1]
        if self._with_coulomb_friction:
            terms[0] = terms[0] + motors.coulomb_effort(at.direction)
        return terms

    def derivatives(self, at: PathSamples, speed: float) -> Iterable[FloatArray]:
        """Return the derivatives of the efforts by q, q', q'' at a speed, (N, n, n) each."""
        return at.effort_derivatives(speed)

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


class SidedEffort(JointSpeedLimit):
    """Base of a `SpeedLimit` on the efforts of some joints on both sides: 2 I quantities.

    A key stands for both sides, raised together.
    """

    order = 2
    signs = (1.0,)

    def __init__(self, limit: FloatArray) -> None:
        """Take the finite limits of n joints, shape (n,) [N m or N]."""
        super().__init__(limit, sides=2)

    def used(self, at: PathSamples) -> SpeedPolynomial:
        """Return the efforts with the worse friction as fractions of their limits."""
        still, moving = at.gravity + at.viscous_effort, at.effort
        unsure = at.problem.robot.motors.friction_uncertainty * abs(at.viscous_effort)
        dry = self._dry(at, 0)
        terms = {
            0: self.sign * (at.gravity[:, self.joints] + dry),
            1: self.sign * at.viscous_effort[:, self.joints] + unsure[:, self.joints],
            2: self.sign * (moving - still)[:, self.joints],
        }
        return SpeedPolynomial({power: term / self.limit for power, term in terms.items()})

    def by_path(self, at: PathSamples, speed: float) -> dict[int, FloatArray]:
        """Return the derivatives of the fractions by the path at a speed, (N, 2 I, n) each."""
        motors = at.problem.robot.motors
        blocks = enumerate(at.effort_derivatives(speed))
        change = {k: by[:, self.joints] * (speed**k * self.sign[:, None]) for k, by in blocks}
        unsure = motors.friction_uncertainty * motors.viscous_friction * speed
        by_rate = (unsure * np.sign(at.by_path[1]))[:, self.joints] + self.sign * self._dry(at, 1)
        change[1][:, np.arange(len(self.joints)), self.joints] += by_rate
        return {k: by / self.limit[:, None] for k, by in change.items()}

    def _dry(self, at: PathSamples, order: int) -> FloatArray:
        """Return Coulomb friction (0) or its derivative by dq/dx (1), shape (N, 2 I)."""
        half = len(self.joints) // 2
        sides = [
            at.coulomb_friction.side(sign)[order][:, self.joints[:half]] for sign in (1.0, -1.0)
        ]
        return np.concatenate(sides, axis=1)

    def refusal(self, at: PathSamples) -> Infeasible:
        """Return the refusal of the joint that gravity and friction exceed most."""
        used = self.used(at)
        sample, column = np.unravel_index(int(used.terms[0].argmax()), used.shape)
        limit, needed = float(self.limit[column]), float(used.terms[0][sample, column])
        if used.allowed is not None:
            allowed = float(used.allowed[sample, column])
            limit, needed = allowed * limit, needed - 1 + allowed
        needed *= float(self.limit[column])
        return effort_refusal(at, int(sample), int(self.joints[column]), needed, limit)


class EffortLimit(SidedEffort):
    """The limits of joints with Coulomb friction, or with limits by direction or position.

    Nominal limits are the largest in each direction anywhere.
    """

    kind = "effort"

    def __init__(self, limits: JointLimits) -> None:
        """Take the joints that have a limit."""
        super().__init__(limits.effort)
        row_of = {int(joint): k for k, joint in enumerate(self.joints[: len(self.keys)])}
        self._ranges = [
            (row_of[each.joint] + len(self.keys) * (sign < 0), sign, each)
            for each in limits.effort_ranges
            for sign in (1.0, -1.0)
        ]
        for column, sign, each in self._ranges:
            self.limit[column] = each.side(sign).max()

    def used(self, at: PathSamples) -> SpeedPolynomial:
        """Return the efforts, and the shortfall of limits, as fractions of the nominal limits."""
        allowed = np.ones((len(at), len(self.joints)))
        for column, sign, each in self._ranges:
            allowed[:, column] = each.allowed(at.position[:, each.joint], sign) / self.limit[column]
        terms = dict(super().used(at).terms)
        terms[0] = terms[0] + (1 - allowed)
        return SpeedPolynomial(terms, allowed)

    def by_path(self, at: PathSamples, speed: float) -> dict[int, FloatArray]:
        """Return the derivatives of the fractions by the path."""
        change = super().by_path(at, speed)
        for column, sign, each in self._ranges:
            slope = each.slope(at.position[:, each.joint], sign)
            change[0][:, column, each.joint] -= slope / self.limit[column]
        return change


class MotorCurve(SidedEffort):
    """The torque-speed lines of some joints.

    An effort tau at the velocity v uses tau / S + v / v0 forwards, S the saturation effort and v0
    the no-load velocity, and minus that backwards.
    """

    kind = "motor_curve"

    def __init__(self, motors: JointMotors) -> None:
        """Take the joints that have a line."""
        super().__init__(np.where(motors.has_curve, motors.saturation_effort, np.inf))
        self._no_load = motors.no_load_velocity[self.joints]

    def used(self, at: PathSamples) -> SpeedPolynomial:
        """Return the fractions of the lines that efforts and velocities use together."""
        terms = dict(super().used(at).terms)
        terms[1] = terms[1] + self.sign * at.by_path[1][:, self.joints] / self._no_load
        return SpeedPolynomial(terms)

    def by_path(self, at: PathSamples, speed: float) -> dict[int, FloatArray]:
        """Return the derivatives of the fractions by the path."""
        change = super().by_path(at, speed)
        every = np.arange(len(self.joints))
        change[1][:, every, self.joints] += self.sign * speed / self._no_load
        return change


class EffortRate(JointSpeedLimit):
    """A `SpeedLimit` on the rates of some joints' efforts [N m/s or N/s], inside pieces.

    Rates are smooth there: those of gravity grow with s, of viscous friction with s^2, the rest
    with s^3. Coulomb friction, which jumps, does not count.
    """

    kind = "effort_rate"
    order = 3

    def terms(self, at: PathSamples) -> Mapping[int, FloatArray]:
        """Return the rates by powers of the speed, (N, n) each."""
        rate, gravity, motors = at.effort_rate, at.gravity_rate, at.problem.robot.motors
        if not motors.has_viscous_friction:
            return {1: gravity, 3: rate - gravity}
        viscous = motors.viscous_friction * at.by_path[2]
        return {1: gravity, 2: viscous, 3: rate - gravity - viscous}

    def derivatives(self, at: PathSamples, speed: float) -> Iterable[FloatArray]:
        """Return the derivatives of the rates by q and its derivatives, (N, n, n) each."""
        state = (at.position, at.rate(1, speed), at.rate(2, speed), at.rate(3, speed))
        return effort_rate_derivatives(at.problem.robot, *state)


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
