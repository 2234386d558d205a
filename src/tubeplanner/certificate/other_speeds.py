"""The path at other speeds: braking distances, slower runs."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.certificate.holding_conditions import HeldPart
from tubeplanner.outcome import Location
from tubeplanner.robot.model import RobotModel, effort_rate, gravity_effort_rate
from tubeplanner.task.holding import Holding
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.parts import monotone_intervals


@dataclass(frozen=True)
class SlowerRun:
    """The margin of a limit in a slower run.

    Attributes:
        condition: Name of the limit in the certificate.
        margin: 1 less the used fraction of the limit.
        speed: Speed of the run: 1 is the trajectory's own, 0 stands for arbitrarily slow.
        where: Location on the trajectory, in its own time.
    """

    condition: str
    margin: float
    speed: float
    where: Location


@dataclass(frozen=True)
class BrakingBound:
    """Bounds on time and distance in which an arm can come to rest along its path.

    Attributes:
        time: Upper bound on the shortest time, whenever the arm begins to brake [s].
        distance: Upper bound on the path length of the tool centre point [m].
        where: Location at which braking begins for the largest distance.
    """

    time: float
    distance: float
    where: Location


@dataclass(frozen=True)
class Braking(BrakingBound):
    """Braking as steep as motors allow, and braking that keeps held parts.

    Attributes:
        drops: True if braking as steep as motors allow leaves the cones of a contact; None: no part
            is held, or not by the trajectory itself.
        holding: Bounds for braking that keeps the parts; None where `drops` is.
    """

    drops: bool | None = None
    holding: BrakingBound | None = None


class OtherSpeeds:
    """Slower runs and braking of a trajectory, computed at the first use.

    Of most certificates nobody asks for either. Pickles and copies can compute both.
    """

    def __init__(
        self,
        robot: RobotModel,
        trajectory: JointTrajectory,
        tolerance: float,
        holdings: Sequence[Holding] = (),
    ) -> None:
        """Take a trajectory in the robot's joint order; limits may be exceeded by a tolerance."""
        self._arguments = (robot, trajectory, tolerance, holdings)

    @cached_property
    def slower(self) -> SlowerRun | None:
        """The tightest slower run, as `tightest_slower_run`."""
        return tightest_slower_run(*self._arguments[:2])

    @cached_property
    def braking(self) -> Braking | None:
        """The bounds on braking, as `worst_braking`."""
        return worst_braking(*self._arguments)


# ---- Short steps along a trajectory, without jumps inside.


@dataclass(frozen=True, eq=False)
class PathSteps:
    """S consecutive steps of a trajectory: pieces end and joints reverse only between steps."""

    trajectory: JointTrajectory
    piece: IntArray  # index of the piece that holds each step, shape (S,)
    local: FloatArray  # starts and ends of the steps, in the piece's own time, shape (2, S) [s]
    direction: FloatArray  # signs of the joints' velocities: 1, -1 or 0, shape (S, n)

    @property
    def width(self) -> FloatArray:
        """Durations, shape (S,) [s]."""
        width: FloatArray = self.local[1] - self.local[0]
        return width

    @property
    def start(self) -> FloatArray:
        """Start times, shape (S,) [s]."""
        start: FloatArray = self.trajectory.breakpoints[self.piece] + self.local[0]
        return start

    def at_ends(self, order: int) -> FloatArray:
        """Return a derivative of an order from 0 to 3 at starts, then at ends: (2 S, n).

        At jumps, the one-sided limit from inside the step.
        """
        return self.trajectory.within(np.tile(self.piece, 2), self.local.ravel(), order)

    def part(self, begin: int, end: int) -> "PathSteps":
        """Return the steps from `begin` to before `end`."""
        rows = slice(begin, end)
        return PathSteps(
            self.trajectory, self.piece[rows], self.local[:, rows], self.direction[rows]
        )


def path_steps(trajectory: JointTrajectory, count: int, per_piece: int) -> PathSteps:
    """Return steps of a trajectory.

    Args:
        trajectory: Any.
        count: Least number of steps.
        per_piece: Least number of steps in every piece.
    """
    pieces = len(trajectory.widths)
    each = max(per_piece, -(-count // pieces))
    intervals = monotone_intervals(trajectory)
    # Counted in pieces.
    regular = np.arange(pieces * each) / each
    begin = np.unique(np.append(regular, intervals.piece + intervals.start))
    piece = begin.astype(np.int64)
    fraction = np.stack([begin, np.append(begin[1:], pieces)]) - piece
    direction = intervals.at(piece, fraction.mean(axis=0))
    return PathSteps(trajectory, piece, fraction * trajectory.widths[piece], direction)


# ---- Limits on efforts and accelerations along a trajectory's path, one side each, at any speed.
#
# Run along its path at the speed p, 1 being the trajectory's own, and with the rate p' of that
# speed, a trajectory q(t) has the velocities q' p and the accelerations q'' p^2 + q' p'. Of the
# efforts, gravity and Coulomb friction are constant, viscous friction grows with p, inertia with
# p^2 and p'.

_SIGNS = (1.0, -1.0)


@dataclass(frozen=True, eq=False)
class LimitSides:
    """R sides of limits at N samples: a limit holds while its used fraction is at most 1.

    The used fraction is static + linear p + square p^2 + change p'.
    """

    condition: tuple[str, ...]  # names in the certificate, R of them
    joint: IntArray  # index of the joint, shape (R,)
    static: FloatArray  # shape (N, R)
    linear: FloatArray  # shape (N, R)
    square: FloatArray  # shape (N, R)
    change: FloatArray  # shape (N, R) [s]

    @classmethod
    def joined(cls, parts: Sequence["LimitSides"]) -> "LimitSides":
        """Return the sides of all parts, at the same samples."""
        names = ("static", "linear", "square", "change")
        return cls(
            sum((part.condition for part in parts), ()),
            np.concatenate([part.joint for part in parts]),
            *(np.concatenate([getattr(part, name) for part in parts], axis=1) for name in names),
        )


def effort_sides(robot: RobotModel, steps: PathSteps) -> LimitSides:
    """Return the limits on efforts and the torque-speed lines at the ends of S steps: N = 2 S.

    Friction is the worst within its uncertainty.

    Args:
        robot: The arm.
        steps: Of a trajectory in its joint order.
    """
    motors, limits = robot.motors, robot.limits
    q, v, a = (steps.at_ends(order) for order in range(3))
    gravity, viscous = robot.gravity_effort(q), motors.viscous_friction * v
    coulomb = motors.coulomb_effort(np.tile(steps.direction, (2, 1)))
    inertia = robot.inverse_dynamics(q, v, a) - gravity - viscous
    change = robot.inverse_dynamics(q, np.zeros_like(v), v) - gravity
    parts = []
    for sign in _SIGNS:
        static = sign * (gravity + coulomb) + motors.friction_uncertainty * abs(coulomb)
        linear = sign * viscous + motors.friction_uncertainty * abs(viscous)
        used = (static, linear, sign * inertia, sign * change)
        allowed = np.tile(limits.effort, (len(q), 1))
        for limit in limits.effort_ranges:
            allowed[:, limit.joint] = limit.allowed(q[:, limit.joint], sign)
        parts.append(_fractions("effort", np.isfinite(limits.effort), used, allowed))
        stall = np.broadcast_to(motors.saturation_effort, q.shape)
        with np.errstate(invalid="ignore"):
            slowed = linear + sign * v * motors.saturation_effort / motors.no_load_velocity
        parts.append(
            _fractions("motor_curve", motors.has_curve, (static, slowed, *used[2:]), stall)
        )
    return LimitSides.joined(parts)


def acceleration_sides(robot: RobotModel, steps: PathSteps) -> LimitSides:
    """Return the limits on accelerations, as `effort_sides`."""
    limit = robot.limits.acceleration
    v, a = steps.at_ends(1), steps.at_ends(2)
    none, allowed = np.zeros_like(v), np.broadcast_to(limit, v.shape)
    return LimitSides.joined(
        [
            _fractions(
                "acceleration", np.isfinite(limit), (none, none, sign * a, sign * v), allowed
            )
            for sign in _SIGNS
        ]
    )


def _fractions(
    condition: str, limited: BoolArray, used: tuple[FloatArray, ...], allowed: FloatArray
) -> LimitSides:
    """Return the sides of limited joints (n,), as fractions of the allowed values."""
    joint = np.flatnonzero(limited)
    fractions = (part[:, joint] / allowed[:, joint] for part in used)
    return LimitSides((condition,) * len(joint), joint, *fractions)


# ---- Slower runs: motors that suffice at full speed may not at a lower speed.
#
# Efforts over the speed p from 0 to 1 are quadratics in p, their rates cubics. Where inertia takes
# load off a motor, as that of a falling arm, the largest effort is at rest or between.

_STEPS, _STEPS_PER_PIECE = 2000, 20
_AT_ONCE = 4000  # steps, for memory


def tightest_slower_run(robot: RobotModel, trajectory: JointTrajectory) -> SlowerRun | None:
    """Return the slower run with the least margin in effort, torque-speed line or effort rate.

    Exact over speeds; over time at samples: at least 2,000, and 20 in every piece, on both sides of
    breakpoints and reversals.

    Returns:
        None if nothing limits efforts.
    """
    steps = path_steps(trajectory, _STEPS, _STEPS_PER_PIECE)
    parts = range(0, len(steps.piece), _AT_ONCE)
    runs = [_tightest(robot, steps.part(begin, begin + _AT_ONCE)) for begin in parts]
    return min((run for run in runs if run is not None), key=lambda run: run.margin, default=None)


def _tightest(robot: RobotModel, steps: PathSteps) -> SlowerRun | None:
    sides = effort_sides(robot, steps)
    smooth = np.stack([sides.static, sides.linear, sides.square, np.zeros_like(sides.static)])
    parts, names, joint = [smooth], sides.condition, sides.joint
    for name, terms_of in _TERMS.items():
        limit = getattr(robot.limits, name)
        limited = np.flatnonzero(np.isfinite(limit))
        if len(limited):
            terms = terms_of(robot, steps)[:, :, limited]
            parts += [sign * terms / limit[limited] for sign in _SIGNS]
            names += (name,) * 2 * len(limited)
            joint = np.concatenate([joint, limited, limited])
    if not names:
        return None
    used, speed = highest_up_to_one(np.concatenate(parts, axis=2))
    end, row = np.unravel_index(int(used.argmax()), used.shape)
    time = (steps.start + np.array([[0.0], [1.0]]) * steps.width).ravel()[end]
    where = Location(time=float(time), joint=robot.joint_names[joint[row]])
    return SlowerRun(names[row], 1 - float(used[end, row]), float(speed[end, row]), where)


def _effort_rate_terms(robot: RobotModel, steps: PathSteps) -> FloatArray:
    """Return the rates of the efforts by power of the speed, (4, N, n) [N m/s or N/s].

    With nominal viscous friction, as in the certificate.
    """
    q, v, a, jerk = (steps.at_ends(order) for order in range(4))
    gravity, friction = gravity_effort_rate(robot, q, v), robot.motors.viscous_friction * a
    inertia = effort_rate(robot, q, v, a, jerk) - gravity - friction
    return np.stack([0 * gravity, gravity, friction, inertia])


# Quantities of joints that are cubics in the speed, by the name of their limits.
_TERMS = {"effort_rate": _effort_rate_terms}


def highest_up_to_one(coefficients: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the largest values of cubics for arguments from 0 to 1, and these arguments, (...).

    Args:
        coefficients: Lowest power first, shape (4, ...).
    """
    _, one, two, three = coefficients
    # Zeros of the derivative; candidates outside, or that do not exist, are clipped to an end.
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(np.maximum(two**2 - 3 * one * three, 0.0))
        sum_ = -(two + np.copysign(root, two))
        turns = np.nan_to_num(np.clip([sum_ / (3 * three), one / sum_], 0.0, 1.0))
    argument = np.concatenate([np.zeros_like(turns[:1]), np.ones_like(turns[:1]), turns])
    value = np.zeros_like(argument)
    for row in coefficients[::-1]:
        value = value * argument + row
    best = value.argmax(axis=0)[None]
    highest = np.take_along_axis(value, best, axis=0)[0]
    return highest, np.take_along_axis(argument, best, axis=0)[0]


# ---- Braking to rest along the trajectory's own path, from any point of it.
#
# The state is the place on the trajectory and the speed p at which its time runs, 1 before the arm
# brakes. From every place, p^2 is lowered over the steps of a grid as steeply as the limits allow,
# in which p' is bounded from both sides by every limit (Bobrow, Dubowsky & Gibson, "Time-optimal
# control of robotic manipulators along specified paths", 1985). A step keeps one p', which suits
# the limits at both its ends. The wrench on a held part is static + square p^2 + change p', too:
# those p' that leave it in a cone are an interval.

_STEP = 1e-3  # [s]: longest step, unless that makes too many
_MIN_BRAKING_STEPS, _MAX_BRAKING_STEPS = 1000, 20_000
_HELD_STARTS = 4  # stops that keep held parts take longer: fewer are computed, for their time
_TANGENT, _CHORD = 0.5, 1.0


def worst_braking(
    robot: RobotModel,
    trajectory: JointTrajectory,
    tolerance: float,
    holdings: Sequence[Holding] = (),
) -> Braking | None:
    """Return the bounds for the worst instant at which an arm may begin to brake.

    Efforts, torque-speed lines, velocities and accelerations stay in their limits; jerks and effort
    rates need not. The bounds come from at least 1,000 steps, of at most 1 ms where 20,000 of them
    suffice, in which the limits hold at both ends; one step is added for an instant between.

    Args:
        robot: The arm.
        trajectory: In its joint order, itself within the limits, at rest at both ends.
        tolerance: Fraction by which each limit may be exceeded.
        holdings: Parts that the trajectory itself holds.

    Returns:
        None if nothing limits efforts and accelerations.
    """
    count = np.ceil(trajectory.duration / _STEP)
    count = np.clip(count, _MIN_BRAKING_STEPS, _MAX_BRAKING_STEPS)
    steps = path_steps(trajectory, int(count), 1)
    limits = LimitSides.joined([effort_sides(robot, steps), acceleration_sides(robot, steps)])
    if len(limits.joint) == 0:
        return None
    jacobian = robot.tool_jacobian(steps.at_ends(0))[1][:, :3]
    speed = np.linalg.norm(np.einsum("nij,nj->ni", jacobian, steps.at_ends(1)), axis=1)
    width = steps.width
    length = speed.reshape(2, -1).mean(axis=0) * width
    every = -(-len(width) // (2 * _MAX_BRAKING_STEPS))
    starts = np.arange(0, len(width), every)
    table = np.stack([1 + tolerance - limits.static, limits.linear, limits.square, limits.change])
    table = table.reshape(4, 2, len(width), -1)
    cones = _cones([HeldPart(robot, holding) for holding in holdings], steps, tolerance)

    def bound(
        sides: tuple[FloatArray, FloatArray, FloatArray], starts: IntArray
    ) -> tuple[BrakingBound, bool]:
        with np.errstate(divide="ignore", invalid="ignore"):  # a side that nothing takes from
            time, distance, leaves = _rests(*sides, width, length, starts)
        # Braking that begins between two starts runs on to the next of these.
        time[1:] += np.add.reduceat(width, starts)[:-1]
        distance[1:] += np.add.reduceat(length, starts)[:-1]
        begins = steps.start[starts]
        worst = int(distance.argmax())
        tool = robot.tool_position(trajectory.position(begins[worst : worst + 1]))[0]
        where = Location(time=float(begins[worst])).at(tool)
        return BrakingBound(float(time.max()), float(distance[worst]), where), leaves

    none = cones[:, :, :, :0]
    steepest, drops = bound((table, none, cones), starts)
    numbers = steepest.time, steepest.distance, steepest.where
    if not drops:
        return Braking(*numbers, *((drops, steepest) if holdings else ()))
    # Half spaces are sides.
    is_flat = ~cones[..., :3].any(axis=(0, 1, 2, 4))
    still, growth, turn = cones[:, :, :, is_flat, 3]
    sides_kept = np.concatenate([table, [still, 0 * still, -growth, -turn]], axis=3)
    kept = sides_kept, cones[:, :, :, ~is_flat], none
    return Braking(*numbers, drops, bound(kept, starts[::_HELD_STARTS])[0])


def _cones(parts: Sequence[HeldPart], steps: PathSteps, tolerance: float) -> FloatArray:
    """Return the terms x and t of J cones |x| <= t by 1, p^2 and p', shape (3, 2, S, J, 4)."""
    q, v, a = (steps.at_ends(order) for order in range(3))
    terms = [np.zeros((3, len(q), 0, 4))]
    for part in parts:
        still = part.wrench(q)
        wrench = np.stack([still, part.wrench(q, v, a) - still, part.wrench(q, 0 * v, v) - still])
        terms.append(part.cone_terms(wrench))
        terms[-1][0, :, :, 3] += part.offsets + tolerance
    return np.concatenate(terms, axis=2).reshape(3, 2, len(steps.piece), -1, 4)


def _rests(
    sides: FloatArray,
    cones: FloatArray,
    watched: FloatArray,
    width: FloatArray,
    length: FloatArray,
    starts: IntArray,
) -> tuple[FloatArray, FloatArray, bool]:
    """Return times and distances to rest of runs that brake from the start of steps (K,), (K,).

    A run that cannot brake at some sample counts as one that runs on to the end of the trajectory.
    The last value is True if a run that brakes leaves a watched cone.
    """
    bounds = np.stack([np.cumsum(part[::-1])[::-1][starts] for part in (width, length)])
    run, step, leaves = np.arange(len(starts)), starts, False
    square, spent = np.ones(len(starts)), np.zeros((2, len(starts)))
    while len(run):
        h = width[step]
        rate, is_possible = _steepest(sides[:, :, step], cones[:, :, step], h, square)
        after = np.maximum(square + 2 * h * rate, 0.0)
        if watched.size and not leaves:
            static, by_square, change = watched[:, :, step]
            squares = np.stack([square, after])[..., None, None]
            x = static + by_square * squares + change * rate[:, None, None]
            is_out = np.linalg.norm(x[..., :3], axis=-1) > x[..., 3]
            leaves |= bool(is_out[:, is_possible].any())
        fraction = np.where(after > 0, 1.0, -square / (2 * h * rate))
        spent += [2 * fraction * h / (np.sqrt(square) + np.sqrt(after)), fraction * length[step]]
        rests = is_possible & ((after == 0) | (step == len(width) - 1))
        bounds[:, run[rests]] = np.minimum(bounds[:, run[rests]], spent[:, rests])
        goes_on = is_possible & ~rests
        run, step, square, spent = (
            run[goes_on],
            step[goes_on] + 1,
            after[goes_on],
            spent[:, goes_on],
        )
    return bounds[0], bounds[1], leaves


def _steepest(
    sides: FloatArray, cones: FloatArray, width: FloatArray, square: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Return the least mean p' over a step for each of K runs, and a mask of its existence: (K,).

    p' changes evenly along the step; where that fails, and before rest, p' is constant.

    Args:
        sides: Slack at p = 0, and the factors of p, p^2 and p', at both ends: (4, 2, K, R).
        cones: Terms of cones at both ends, (3, 2, K, J, 4).
        width: Of the steps, shape (K,) [s].
        square: p^2 at their starts, shape (K,).
    """
    change = sides[3]
    at_start, at_end, by_square = _slack(sides, width, square)
    still, growth, turn = cones[0] + cones[1] * square[:, None, None], cones[1, 1], cones[2]
    growth = growth * width[:, None, None]
    first, is_first = _least(change[0], at_start, still[0], turn[0])
    grown = still[1] + growth * first[:, None, None]
    last, is_last = _least(
        change[1] + by_square, at_end - by_square * first[:, None], grown, turn[1] + growth
    )
    rate, is_possible = (first + last) / 2, is_first & is_last
    others = ~(is_possible & (square + 2 * width * rate > 0))
    if others.any():
        rate[others], is_possible[others] = _steady(
            sides[:, :, others], cones[:, :, others], width[others], square[others]
        )
    return rate, is_possible


def _steady(
    sides: FloatArray, cones: FloatArray, width: FloatArray, square: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Return the least constant p' within the limits at both ends of a step, as `_steepest`."""
    slack, change = sides[0], sides[3]
    at_start, at_end, by_square = _slack(sides, width, square)
    still, growth, turn = cones[0] + cones[1] * square[:, None, None], cones[1, 1], cones[2]
    growth = growth * 2 * width[:, None, None]
    factors = np.hstack([change[0], change[1] + 2 * by_square])
    rate, is_possible = _least(
        factors,
        np.hstack([at_start, at_end]),
        np.hstack([still[0], still[1]]),
        np.hstack([turn[0], turn[1] + growth]),
    )
    # For runs that rest before the end, the limits at the end count at rest.
    harder, can_rest = _least(
        np.hstack([change[0], change[1]]),
        np.hstack([at_start, slack[1]]),
        np.hstack([still[0], cones[0, 1]]),
        np.hstack([turn[0], turn[1]]),
    )
    to_rest = -square / (2 * width)
    rests = is_possible & (rate <= to_rest)
    return np.where(rests, np.minimum(harder, to_rest), rate), is_possible & (can_rest | ~rests)


def _slack(
    sides: FloatArray, width: FloatArray, square: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the slack at both ends at constant p, and the factor of p' at the end by p^2.

    p^2 grows over the step by the width times the sum of both ends' p'. The root of p^2 is below
    its tangent at the start and, as p falls, above its chord from zero.
    """
    slack, linear, quadratic, _ = sides
    p = np.sqrt(square)[:, None]
    at_start, at_end = slack - linear * p - quadratic * square[:, None]
    bend = np.where(linear[1] > 0, _TANGENT, _CHORD) * linear[1] / p
    return at_start, at_end, width[:, None] * (quadratic[1] + bend)


def _least(
    factor: FloatArray, slack: FloatArray, still: FloatArray, turn: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Return the least p' within the limits, and masks of p' <= 0: (K,).

    Args:
        factor: Of p' in C sides factor p' <= slack, shape (K, C).
        slack: Shape (K, C).
        still: x and t of J cones |x| <= t at p' = 0, shape (K, J, 4).
        turn: Their rates with p', shape (K, J, 4).
    """
    ratio = slack / factor
    low, high, is_empty = _inside(still, turn)
    least = np.hstack([np.where(factor < 0, ratio, -np.inf), low]).max(axis=1)
    most = np.hstack([np.where(factor > 0, ratio, 0.0), high]).min(axis=1)
    is_blocked = ((factor == 0) & (slack < 0)).any(axis=1) | is_empty.any(axis=1)
    return least, (least <= np.minimum(most, 0.0)) & ~is_blocked


def _inside(still: FloatArray, turn: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return the least and the largest p' inside cones as in `_least`, and where none is: (K, J).

    |x + p' d| = t + p' e at the zeros of a p'^2 + 2 b p' + c, where t + p' e is not negative.
    """
    metric = np.array([1.0, 1.0, 1.0, -1.0])
    a, b, c = turn**2 @ metric, (still * turn) @ metric, still**2 @ metric
    root = b**2 - a * c
    sum_ = -(b + np.copysign(np.sqrt(np.maximum(root, 0.0)), b))
    zeros = np.sort([sum_ / a, c / sum_], axis=0)  # NaN, of a cone that p' does not change, is last
    rises = turn[..., 3] > 0
    low = np.where(a < 0, np.where(rises, zeros[1], -np.inf), zeros[0])
    high = np.where(a < 0, np.where(rises, np.inf, zeros[0]), zeros[1])
    middle = still[..., 3] + np.clip(-b / a, low, high) * turn[..., 3]
    fixed = (turn == 0).all(axis=-1)
    is_empty = np.where(fixed, (c > 0) | (still[..., 3] < 0), (a > 0) & ((root < 0) | (middle < 0)))
    return np.where(fixed, -np.inf, low), np.where(fixed, np.inf, high), is_empty
