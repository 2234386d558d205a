"""Conditions on joints: position, velocity to jerk, signs, continuity, start, goal, rest."""

from dataclasses import dataclass
from itertools import groupby
from typing import NamedTuple

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.certificate.judged_motion import (
    FOR_ALL_TIMES,
    RELATIVE,
    JudgedCondition,
    JudgedMotion,
    bracketed,
    not_required,
)
from tubeplanner.outcome import Location
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.polynomials import (
    Extrema,
    bernstein_coefficients,
    halves,
    maxima,
    peak_magnitudes,
)


def judge_position(motion: JudgedMotion) -> JudgedCondition:
    """Judge the position limits, exactly."""
    limits = motion.robot.limits
    least = range_margin(motion.trajectory, limits.lower_position, limits.upper_position)
    if least is None:
        return not_required("rad", "no joint has position limits")
    location = Location(time=least.time, joint=least.joint)
    return JudgedCondition(least.margin, motion.position_unit(least.joint), location, FOR_ALL_TIMES)


NOT_LIMITED = not_required(RELATIVE, "no joint has this limit")
_ORDERS = {"velocity": 1, "acceleration": 2, "jerk": 3}


def judge_velocity(motion: JudgedMotion) -> JudgedCondition:
    """Judge the velocity limits, exactly, and the limits that depend on positions."""
    constant, by_position = judge_rate("velocity", motion), velocity_by_position_left(motion)
    required = [each for each in (constant, by_position) if each.margin is not None]
    return min(required, key=lambda each: each.margin or 0.0, default=constant)


def judge_rate(quantity: str, motion: JudgedMotion) -> JudgedCondition:
    """Judge the limits of a derivative of the positions, exactly."""
    limit = getattr(motion.robot.limits, quantity)
    bounded = np.flatnonzero(np.isfinite(limit))
    if len(bounded) == 0:
        return NOT_LIMITED
    trajectory = motion.trajectory
    rows = trajectory.derivative_coefficients(_ORDERS[quantity])[:, :, bounded]
    peak = highest(peak_magnitudes(rows / limit[bounded], trajectory.widths), trajectory)
    location = Location(time=peak.time, joint=motion.robot.joint_names[bounded[peak.column]])
    return JudgedCondition(1 - peak.value, RELATIVE, location, FOR_ALL_TIMES)


def judge_joint_signs(motion: JudgedMotion) -> JudgedCondition:
    """Judge the segments' joint ranges, exactly between the switching times."""
    lower, upper = motion.tube.ranges_of(motion.robot.joint_names)
    margins = []
    # Neighbours whose segments have the same joint ranges are judged together.
    ranges = np.hstack((lower, upper))
    groups = groupby(motion.visits, key=lambda visit: ranges[visit.segment].tobytes())
    for visits in [list(group) for _, group in groups]:
        segment, begin = visits[0].segment, visits[0].begin
        part = motion.trajectory.between(begin, visits[-1].end)
        least = range_margin(part, lower[segment], upper[segment])
        if least is not None:
            margins.append((least._replace(time=begin + least.time), visits))
    if not margins:
        return not_required("rad", "no segment has joint signs")
    worst, visits = min(margins, key=lambda item: item[0].margin)
    segment = next((v.segment for v in visits if worst.time <= v.end), visits[-1].segment)
    location = Location(worst.time, worst.joint, motion.segment_number(segment, worst.time))
    return JudgedCondition(worst.margin, motion.position_unit(worst.joint), location, FOR_ALL_TIMES)


def judge_start(motion: JudgedMotion) -> JudgedCondition:
    """Judge the start of the trajectory."""
    return _judge_end(motion, 0, 0.0)


def judge_goal(motion: JudgedMotion) -> JudgedCondition:
    """Judge the end of the trajectory."""
    goal, duration = motion.problem.endpoints[1], motion.trajectory.duration
    if goal.kind != "position" or (region := goal.region) is None:
        return _judge_end(motion, -1, duration)
    tool = motion.robot.tool_position(motion.trajectory.position(duration)[None])[0]
    coverage = f"tool within {region.tolerance:g} m of the goal's position"
    return JudgedCondition(region.margin(tool), "m", Location(time=duration), coverage)


def _judge_end(motion: JudgedMotion, index: int, time: float) -> JudgedCondition:
    """Judge start (0) or goal (-1) at a time [s]: against joints, pose or the reference point."""
    q, end = motion.trajectory.position(time), motion.problem.endpoints[index]
    if end.pose is not None:
        rotation, position = (part[0] for part in motion.robot.tool_pose(q[None]))
        distance, angle = end.pose.errors(rotation, position)
        unit, worst = ("m", distance) if distance >= angle else ("rad", angle)
        return JudgedCondition(0.0 - worst, unit, Location(time=time), "tool at its pose")
    if end.joints is None:
        tool = motion.robot.tool_position(q[None])[0]
        error = float(np.linalg.norm(tool - motion.tube.points[index]))
        radius = float(motion.problem.end_radii[index])
        if radius and error > motion.tolerance.absolute and not _reaches(motion, index, q):
            coverage = f"tool within {radius:g} m of the reference point, out of the arm's reach"
            return JudgedCondition(radius - error, "m", Location(time=time), coverage)
        return JudgedCondition(0.0 - error, "m", Location(time=time), "tool at the reference point")
    off = abs(q - end.joints)
    joint = motion.robot.joint_names[int(off.argmax())]
    location = Location(time=time, joint=joint)
    return JudgedCondition(
        0.0 - float(off.max()), motion.position_unit(joint), location, FOR_ALL_TIMES
    )


_MAX_STEPS = 50
_MET = 1e-7  # [m]: well within the planner's bound, so that it never takes such a point for missed
_SINGULAR = 1e-6  # of the largest singular value


def _reaches(motion: JudgedMotion, index: int, q: FloatArray) -> bool:
    """Return True if least-squares steps from a configuration (n,) lead to the reference point."""
    lower, upper = motion.problem.joint_lower[index], motion.problem.joint_upper[index]
    for _ in range(_MAX_STEPS):
        tool, jacobian = (part[0] for part in motion.robot.tool_jacobian(q[None]))
        error = motion.tube.points[index] - tool
        if np.linalg.norm(error) <= _MET:
            return True
        step = np.linalg.lstsq(jacobian[:3], error, rcond=_SINGULAR)[0]
        q = np.minimum(np.maximum(q + step, lower), upper)
    return False


def judge_rest(motion: JudgedMotion) -> JudgedCondition:
    """Judge velocity and acceleration at both ends, relative to their largest values."""
    worst, location = 0.0, Location()
    for order in (1, 2):
        values = motion.piece_ends(order)
        ends = np.array([values[0, 0], values[1, -1]])
        fraction = abs(ends) / motion.largest_rates[order]
        if fraction.max() > worst:
            end, joint = np.unravel_index(int(fraction.argmax()), fraction.shape)
            time = float(motion.trajectory.breakpoints[-end])
            worst = float(fraction.max())
            location = Location(time=time, joint=motion.robot.joint_names[joint])
    return JudgedCondition(0.0 - worst, RELATIVE, location, FOR_ALL_TIMES)


def judge_continuity(motion: JudgedMotion) -> JudgedCondition:
    """Judge jumps of position, or of velocity and acceleration relative to their largest values.

    All jumps of a joint add up: otherwise many small jumps could skip any part of its path. The
    worst sum is reported, each measured by its own tolerance, at its largest jump.
    """
    sums = [JudgedCondition(0.0, RELATIVE, Location(), FOR_ALL_TIMES)]
    for order in range(3):
        values = motion.piece_ends(order)
        jumps = abs(values[0, 1:] - values[1, :-1])
        if jumps.size == 0:
            continue
        if order > 0:
            jumps = jumps / motion.largest_rates[order]
        total = jumps.sum(axis=0)
        worst = int(total.argmax())
        joint = motion.robot.joint_names[worst]
        time = float(motion.trajectory.breakpoints[jumps[:, worst].argmax() + 1])
        unit = motion.position_unit(joint) if order == 0 else RELATIVE
        location = Location(time=time, joint=joint)
        sums.append(JudgedCondition(0.0 - float(total[worst]), unit, location, FOR_ALL_TIMES))

    def in_tolerances(condition: JudgedCondition) -> float:
        return (condition.margin or 0.0) / max(motion.tolerance.of(condition.unit), 1e-300)

    return min(sums, key=in_tolerances)


# ---- Nearest approaches of joint polynomials to their bounds, exactly.


class Highest(NamedTuple):
    """The largest of several extrema."""

    value: float  # in the unit of the polynomials
    time: float  # from the trajectory's begin [s]
    column: int  # index of the extremum


class JointMargin(NamedTuple):
    """The least margin between joints and their ranges."""

    margin: float  # [rad or m]
    time: float  # from the trajectory's begin [s]
    joint: str  # name of the joint


def highest(extrema: Extrema, trajectory: JointTrajectory) -> Highest:
    """Return the largest of a trajectory's extrema."""
    column = int(extrema.value.argmax())
    start = trajectory.breakpoints[extrema.piece[column]]
    return Highest(float(extrema.value[column]), float(start + extrema.local_time[column]), column)


def range_margin(
    trajectory: JointTrajectory, lower: FloatArray, upper: FloatArray
) -> JointMargin | None:
    """Return the least margin between joints and their ranges; None if no joint has any.

    Args:
        trajectory: Of n joints.
        lower: Shape (n,) [rad or m]; minus infinity where there is no bound.
        upper: Likewise, infinity where there is no bound.
    """
    over, joints = [], []
    for sign, bound in ((1.0, upper), (-1.0, -lower)):
        bounded = np.flatnonzero(np.isfinite(bound))
        beyond = sign * trajectory.coefficients[:, :, bounded]
        beyond[-1] -= bound[bounded]
        over.append(beyond)
        joints += bounded.tolist()
    if not joints:
        return None
    worst = highest(maxima(np.concatenate(over, axis=2), trajectory.widths), trajectory)
    return JointMargin(-worst.value, worst.time, trajectory.joint_names[joints[worst.column]])


# ---- Velocity limits that fall towards the ends of joints' ranges, exactly.
#
# Towards an end at a distance g, a joint's velocity v keeps v <= max(0, sqrt(2 d g) - o). The
# margin is the larger of two concave functions of g and v, sqrt(2 d g) - o - v and -v. On a piece g
# and v are polynomials of time and lie in the hull of their Bernstein coefficients, and each
# function is nowhere less than at the worst of these.

_RESOLUTION = 1e-9  # of the largest velocity
_MIN_WIDTH = 2.0**-40  # of a piece
_MAX_ROWS = 1_000_000


@dataclass(frozen=True, eq=False)
class _Approaches:
    """Motions of A joints towards an end of their ranges: upwards, then downwards."""

    joint: IntArray  # shape (A,)
    deceleration: FloatArray  # shape (A,) [rad/s^2 or m/s^2]
    offset: FloatArray  # shape (A,) [rad/s or m/s]
    largest: FloatArray  # the velocity that margins are relative to, shape (A,) [rad/s or m/s]
    distance: FloatArray  # from the end, as polynomials (degree+1, pieces, A) [rad or m]
    velocity: FloatArray  # towards the end, as polynomials of the same degree [rad/s or m/s]

    def left(
        self, distance: FloatArray, velocity: FloatArray, which: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return both functions, relative, (K, R), of approaches (R,); -inf beyond the end."""
        with np.errstate(invalid="ignore"):
            root = np.sqrt(2 * self.deceleration[which] * distance) - self.offset[which]
        near = np.where(distance >= 0, root - velocity, -np.inf)
        return near / self.largest[which], -velocity / self.largest[which]


def velocity_by_position_left(motion: JudgedMotion) -> JudgedCondition:
    """Judge the velocity limits that depend on positions, for all t.

    Margins are relative to the joint's velocity limit or, where there is none, to the velocity from
    which the joint would stop over its whole range.
    """
    if not motion.robot.limits.velocity_by_position:
        return not_required(RELATIVE, "no joint has such a limit")
    trajectory = motion.trajectory
    laws = motion.robot.limits.velocity_by_position
    joint = np.array([law.joint for law in laws])
    deceleration = np.array([law.deceleration for law in laws])
    span = np.array([law.upper - law.lower for law in laws])
    limit = motion.robot.limits.velocity[joint]
    largest = np.where(np.isfinite(limit), limit, np.sqrt(2 * deceleration * span))
    position = trajectory.coefficients[:, :, joint]
    velocity = np.zeros_like(position)
    velocity[1:] = trajectory.derivative_coefficients(1)[:, :, joint]
    to_upper, to_lower = -position, position.copy()
    to_upper[-1] += [law.upper for law in laws]
    to_lower[-1] -= [law.lower for law in laws]
    approaches = _Approaches(
        np.tile(joint, 2),
        np.tile(deceleration, 2),
        np.tile([law.offset for law in laws], 2),
        np.tile(largest, 2),
        np.concatenate([to_upper, to_lower], axis=2),
        np.concatenate([velocity, -velocity], axis=2),
    )
    lower_bound, attained, time, which = _least_left(approaches, trajectory)
    name = motion.robot.joint_names[approaches.joint[which]]
    return bracketed(lower_bound, attained, RELATIVE, Location(time=time, joint=name))


def _least_left(
    approaches: _Approaches, trajectory: JointTrajectory
) -> tuple[float, float, float, int]:
    """Return lower bound and attained value of the least margin, its time [s], its approach."""
    pieces, count = approaches.distance.shape[1:]
    piece, which = np.repeat(np.arange(pieces), count), np.tile(np.arange(count), pieces)
    start, width = np.zeros(len(piece)), trajectory.widths[piece]
    smallest = _MIN_WIDTH * trajectory.widths.min()
    lower_bound, attained, time, worst, rows = np.inf, np.inf, 0.0, 0, 0
    while len(piece):
        rows += len(piece)
        near, away = approaches.left(
            _hull(approaches.distance[:, piece, which], start, width),
            _hull(approaches.velocity[:, piece, which], start, width),
            which,
        )
        ends = np.maximum(near, away)[[0, -1]]
        end, row = np.unravel_index(int(ends.argmin()), ends.shape)
        if ends[end, row] < attained:
            attained, worst = float(ends[end, row]), int(which[row])
            local = start[row] + (width[row] if end else 0.0)
            time = float(trajectory.breakpoints[piece[row]] + local)
        lower = np.maximum(near.min(axis=0), away.min(axis=0))
        split = (lower < attained - _RESOLUTION) & (width > smallest) & (rows < _MAX_ROWS)
        lower_bound = min(lower_bound, float(lower[~split].min(initial=np.inf)))
        piece, which = np.repeat(piece[split], 2), np.repeat(which[split], 2)
        start, width = halves(start[split], width[split])
    return lower_bound, attained, time, worst


def _hull(rows: FloatArray, start: FloatArray, width: FloatArray) -> FloatArray:
    """Return the Bernstein coefficients of R polynomials (degree+1, R) on intervals."""
    return bernstein_coefficients(rows[:, :, None], start, width)[:, :, 0]
