"""Conditions on the tool: tube, points, orientation, speed, acceleration; speeds of link points."""

from dataclasses import dataclass, replace

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.certificate.enclosed_quantities import (
    EnclosedPose,
    derivative,
    point_majorant,
    tool_majorant,
)
from tubeplanner.certificate.enclosure import Quantity, enclosed
from tubeplanner.certificate.judged_motion import (
    RELATIVE,
    JudgedCondition,
    JudgedMotion,
    bracketed,
    not_required,
)
from tubeplanner.certificate.tube_visits import (
    LeastMargin,
    Visit,
    least_concave_margin,
    least_margin,
    passages,
    visited_parts,
)
from tubeplanner.geometry.tube.bands import REQUIRED
from tubeplanner.geometry.tube.rotation import RotationalTube
from tubeplanner.orientation import (
    MATRIX_ERROR_GAIN,
    nearest_branch,
    rotation_vector,
    turning_gain,
    turning_gain_rate,
)
from tubeplanner.outcome import Location
from tubeplanner.robot.kinematics import cross_product
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.overrides import PointSpeed
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.polynomials import halves


def judge_tube(motion: JudgedMotion) -> JudgedCondition:
    """Judge the tool's position in the tube, segment by segment or in their union."""
    if motion.tube.is_anywhere:
        return not_required("m", "the tool's position is free")
    least = least_margin(motion.tube, motion.tool, motion.visits)
    location = motion.location_in_segment(least.segment, least.time)
    judged = [bracketed(least.lower_bound, least.attained, "m", location)]
    error, banded = float(motion.tool.error.max()), np.isfinite(_floors(motion.problem))
    for gate in motion.tube.gates:
        (time,) = (visit.begin for visit in motion.visits if visit.segment == gate.point)
        beyond = float(gate.margin(motion.tool.at(np.array([time])))[0]) - error
        where = Location(time=time, point=int(motion.tube.numbers[gate.point]))
        side = "begin" if banded[gate.point] else "end"
        coverage = f"outside the {side} of a stretch at constant speed, where the tool passes on"
        judged.append(JudgedCondition(beyond, "m", where, coverage))
    return min(judged, key=lambda condition: condition.margin or 0.0)


def judge_points(motion: JudgedMotion) -> JudgedCondition:
    """Judge compulsory points, each at an instant when either of its segments is current."""
    problem, trajectory, tool = motion.problem, motion.trajectory, motion.tool
    passed = passages(problem, trajectory, tool, motion.visits, motion.rotation, motion.further)
    if not passed:
        return not_required("m", "no point is to be passed")
    worst = min(passed, key=lambda passage: passage.margin)
    location = Location(time=worst.time, point=int(motion.tube.numbers[worst.point]))
    return JudgedCondition(worst.margin, "m", location, "at the instant that is nearest")


def judge_rotation(motion: JudgedMotion) -> JudgedCondition:
    """Judge the tool's orientation, segment by segment and at the goal."""
    along, at_goal = _judge_along(motion), _judge_at_goal(motion)
    if along.margin is None or at_goal.margin is None:
        return along if at_goal.margin is None else at_goal
    return min(along, at_goal, key=lambda condition: condition.margin or 0.0)


def _judge_along(motion: JudgedMotion) -> JudgedCondition:
    """Judge the orientation against the tube's tolerances."""
    if motion.tube.rotation is None or motion.pose is None:
        return not_required("rad", "the tool's orientation is free")
    least = least_rotation_margin(motion.tube.rotation, motion.pose, motion.visits)
    if least is None:
        return not_required("rad", "free in every segment visited")
    location = motion.location_in_segment(least.segment, least.time)
    return bracketed(least.lower_bound, least.attained, "rad", location)


def _judge_at_goal(motion: JudgedMotion) -> JudgedCondition:
    """Judge the last orientation against the goal's tolerance."""
    goal, duration = motion.problem.open_goal, motion.trajectory.duration
    if goal is None or not goal.bounds_rotation or motion.problem.rotation is None:
        return not_required("rad", "the goal bounds no rotation")
    rotation, tool = motion.tube.tool_pose(motion.robot, motion.trajectory.position(duration)[None])
    margin = motion.problem.rotation.margin(rotation, tool, motion.tube.segment_count)[0]
    return JudgedCondition(float(margin), "rad", Location(time=duration), "at the goal")


# ---- The margin inside the rotation tolerances, for all t.
#
# On an interval of width w, a curve lies within w^2 / 8 max |x''| of the chord between its ends.
# The curve here is the rotation vector v of the tool against its reference, with dv/dt = J(v) s and
# s = w_tool - E^T turn du/dt (see `RotationalTube.error_jacobian`), so that
#
#     |v''| <= g (|w_tool'| + |turn| (|u''| + |s| |u'|)) + g g' |s|^2
#
# with the norms g of J and g' of its change, which grow with the angle only. Where the nearest
# point of the segment passes an end of it, u' jumps: that term is bounded by its size alone, to
# first order. Halving brings the bounds together.
#
# An angle that goes on beyond pi is the rotation vector's other branch, of which every component
# and the length are smaller: following the curve beyond pi can only overestimate them.

# The least margin is bracketed to this fraction of itself, or to this angle [rad] near zero.
_RELATIVE_RESOLUTION = 0.02
_RESOLUTION = 2e-7
_ALL = np.ones(3, dtype=bool)
_MIN_WIDTH = 2.0**-40  # of an interval
_MAX_ROWS = 1_000_000
# A part in which the rotation vector could move farther than this [rad] is halved without a bound.
_MAX_MOVE = 0.3
_MAX_GAIN = float(turning_gain(np.array(np.pi + _MAX_MOVE)))


@dataclass(frozen=True, eq=False)
class _Parts:
    """R parts of intervals, each in a segment."""

    interval: IntArray  # index of the interval, shape (R,)
    start: FloatArray  # in the interval's local time, shape (R,)
    width: FloatArray  # in the interval's local time, shape (R,)
    segment: IntArray  # index of the tube's segment, shape (R,)
    vector: FloatArray  # rotation vectors at both ends, shape (2, R, 3) [rad]
    fraction: FloatArray  # fraction of the segment, not clipped, at both ends, shape (2, R)


def least_rotation_margin(
    tube: RotationalTube, pose: EnclosedPose, visits: list[Visit]
) -> LeastMargin | None:
    """Return the least margin of the tool's rotation during visits, for all t.

    None if no segment visited bounds the rotation.
    """
    bounded = [visit for visit in visits if np.isfinite(tube.bounds[visit.segment]).any()]
    if not bounded:
        return None
    interval, start, width, segment = visited_parts(pose.tool, bounded)
    at_ends = [_vector_at(tube, pose, interval, segment, t) for t in (start, start + width)]
    vector, fraction = (np.array(values) for values in zip(*at_ends, strict=True))
    parts = _Parts(interval, start, width, segment, vector, fraction)
    attained, time, worst_segment = np.inf, 0.0, 0
    lower_bound, count = np.inf, 0
    while len(parts.interval):
        count += len(parts.interval)
        ends = np.array([tube.margin_of(v, parts.segment) for v in parts.vector])
        first, last = parts.vector
        largest = np.maximum(_measures(first), _measures(nearest_branch(last, first, _ALL)))
        off, error = _chord_distance(tube, pose, parts, largest[:, 3])
        bounds = tube.bounds[parts.segment]
        lower = (bounds - largest).min(axis=1) - off - error
        # Lower bounds between the ends. No component and no angle is larger than pi.
        lower = np.maximum(lower, bounds.min(axis=1) - np.pi)
        end, row = np.unravel_index(int(ends.argmin()), ends.shape)
        if ends[end, row] < attained:
            attained, worst_segment = float(ends[end, row]), int(parts.segment[row])
            local = parts.start[row] + (parts.width[row] if end else 0.0)
            interval = parts.interval[row]
            time = float(pose.tool.start[interval] + local * pose.tool.width[interval])
        resolution = max(_RESOLUTION, _RELATIVE_RESOLUTION * abs(attained))
        split = (lower < attained - resolution - error) & (parts.width > _MIN_WIDTH)
        split &= count < _MAX_ROWS
        lower_bound = min(lower_bound, float(lower[~split].min(initial=np.inf)))
        parts = _halves(tube, pose, parts, split)
    return LeastMargin(lower_bound, attained, time, worst_segment, count)


def _halves(tube: RotationalTube, pose: EnclosedPose, parts: _Parts, rows: BoolArray) -> _Parts:
    """Return the two halves of each selected part, in turn."""
    interval, segment = parts.interval[rows], parts.segment[rows]
    start, width = halves(parts.start[rows], parts.width[rows])
    middle = _vector_at(tube, pose, interval, segment, start[1::2])
    both = []
    for ends, between in zip((parts.vector[:, rows], parts.fraction[:, rows]), middle, strict=True):
        pairs = np.repeat(ends, 2, axis=1)
        pairs[1, 0::2] = pairs[0, 1::2] = between
        both.append(pairs)
    return _Parts(np.repeat(interval, 2), start, width, np.repeat(segment, 2), *both)


def _vector_at(
    tube: RotationalTube,
    pose: EnclosedPose,
    interval: IntArray,
    segment: IntArray,
    local: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return rotation vectors (R, 3) [rad] and fractions of segments (R,) at local times (R,)."""
    tool = pose.tool.within(interval, local)
    rotation = pose.rotation.within(interval, local).reshape(-1, 3, 3)
    u = tube.projection(tool, segment)
    relative = tube.reference_at(np.clip(u, 0.0, 1.0), segment).transpose(0, 2, 1) @ rotation
    return rotation_vector(relative), u


def _measures(v: FloatArray) -> FloatArray:
    """Return |x|, |y|, |z| and the length of rotation vectors (R, 3): shape (R, 4)."""
    return np.hstack([abs(v), np.linalg.norm(v, axis=1, keepdims=True)])


def _chord_distance(
    tube: RotationalTube, pose: EnclosedPose, parts: _Parts, angle: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return bounds on the rotation vector's distance from its chord and error, (R,) [rad] each.

    `angle` is the larger of the angles at the two ends, shape (R,) [rad].
    """
    width = parts.width * pose.tool.width[parts.interval]
    axis = np.diff(tube.points, axis=0)[parts.segment]
    length = np.linalg.norm(axis, axis=1)
    rate, bend, off = (
        bound[parts.interval] / length
        for bound in (pose.speed, pose.acceleration, pose.tool.error[:, 0])
    )
    low, high = parts.fraction.min(axis=0), parts.fraction.max(axis=0)
    slack = bend * width**2 / 8 + 2 * off
    beyond = (high + slack <= 0) | (low - slack >= 1)
    passes_end = ~beyond & ((low - slack < 0) | (high + slack > 1))
    reference_angle = np.where(
        beyond, 0.0, np.linalg.norm(tube.rotation_change, axis=1)[parts.segment]
    )
    spin, spin_rate = pose.spin[parts.interval], pose.spin_rate[parts.interval]
    relative = spin + reference_angle * rate
    move = _MAX_GAIN * relative * width
    farthest = np.minimum(angle + move / 2, np.pi + _MAX_MOVE)
    gain, gain_rate = turning_gain(farthest), turning_gain_rate(farthest)
    smooth = spin_rate + reference_angle * (bend + relative * rate) + gain_rate * relative**2
    broken = spin_rate + gain_rate * relative * spin
    jump = reference_angle * (high - low + bend * width**2 + 4 * off) / 2
    distance = gain * np.where(passes_end, broken * width**2 / 8 + jump, smooth * width**2 / 8)
    error = gain * (
        MATRIX_ERROR_GAIN * pose.rotation.error[parts.interval, 0] + reference_angle * off
    )
    return np.where(move <= _MAX_MOVE, distance, np.inf), error


# ---- Speed and acceleration of the tool, segment by segment; speeds of points on links.

# Error of enclosed vectors, as a fraction of the least limit: tighter than the certificate's
# tolerance, so that the planner may use most of that.
_ENCLOSURE = 1e-8


def judge_tool_speed(motion: JudgedMotion) -> JudgedCondition:
    """Judge the speed of the tool centre point, by polynomials that enclose its velocity.

    Limits bound it above; where the tube requires bands, their lower ends bound it below.
    """
    upper = _judged_in_segments(motion, "tool_speed", _velocity(motion.robot))
    lower = judge_least_speed(motion)
    if lower is None or upper.margin is None or lower.margin is None:
        return upper
    return min(lower, upper, key=lambda condition: condition.margin or 0.0)


def judge_least_speed(motion: JudgedMotion) -> JudgedCondition | None:
    """Judge the speed of the tool centre point above the floors of bands, relative to them.

    On an interval, the speed is at least the velocity along any unit vector, a polynomial: along
    its mean direction, what that loses falls to a quarter where an interval is halved. None where
    no band is required.
    """
    floor = _floors(motion.problem)
    if not np.isfinite(floor).any():
        return None
    visits = [visit for visit in motion.visits if np.isfinite(floor[visit.segment])]
    if not visits:
        return None
    tolerance = np.full(3, _ENCLOSURE * floor.min())
    velocity = enclosed(motion.trajectory, _velocity(motion.robot), tolerance)

    def along(values: FloatArray, segment: IntArray) -> FloatArray:
        mean = values.mean(axis=0)
        direction = mean / np.maximum(np.linalg.norm(mean, axis=1), np.finfo(float).tiny)[:, None]
        margin: FloatArray = np.einsum("nri,ri->nr", values, direction) / floor[segment] - 1
        return margin

    def speed(values: FloatArray, segment: IntArray) -> FloatArray:
        margin: FloatArray = np.linalg.norm(values, axis=2) / floor[segment] - 1
        return margin

    least = least_concave_margin(velocity, visits, along, 1 / floor, speed)
    location = motion.location_in_segment(least.segment, least.time)
    judged = bracketed(least.lower_bound, least.attained, RELATIVE, location)
    return replace(judged, coverage=f"{judged.coverage}: above the band's lower end")


def _floors(problem: PlanningProblem) -> FloatArray:
    """Return the least speed in each segment, (m,) [m/s], inf where no band is required."""
    floor, count = problem.tube.least_tool_speed, problem.tube.segment_count
    is_required = floor is not None and problem.tube.process.steady == REQUIRED
    return floor if floor is not None and is_required else np.full(count, np.inf)


def judge_tool_acceleration(motion: JudgedMotion) -> JudgedCondition:
    """Judge the acceleration of the tool centre point, likewise; gravity is not counted."""
    return _judged_in_segments(motion, "tool_acceleration", _acceleration(motion.robot))


def _judged_in_segments(motion: JudgedMotion, name: str, quantity: Quantity) -> JudgedCondition:
    """Judge the norm of a vector of the tool against each segment's limit of that name."""
    limit = _limits(motion.problem, name)
    if not np.isfinite(limit).any():
        return not_required(RELATIVE, f"the tool's {name.removeprefix('tool_')} is free")
    vector = enclosed(motion.trajectory, quantity, np.full(3, _ENCLOSURE * limit.min()))

    def margin(values: FloatArray, segment: IntArray) -> FloatArray:
        return 1 - np.linalg.norm(values, axis=2) / limit[segment]

    least = least_concave_margin(vector, motion.visits, margin, 1 / limit)
    location = motion.location_in_segment(least.segment, least.time)
    return bracketed(least.lower_bound, least.attained, RELATIVE, location)


class ToolRateMargin:
    """A `SegmentMargin`: of a norm of the tool's between each segment's limit and its floor."""

    def __init__(
        self,
        trajectory: JointTrajectory,
        quantity: Quantity,
        limit: FloatArray,
        floor: FloatArray | None = None,
    ) -> None:
        self._trajectory, self._quantity, self._limit = trajectory, quantity, limit
        self._floor = np.full(len(limit), np.inf) if floor is None else floor

    def at(self, time: FloatArray) -> FloatArray:
        """Return the margins in all segments."""
        return self._margin(self._norm(time)[:, None], np.arange(len(self._limit)))

    def within(self, segment: IntArray, time: FloatArray) -> FloatArray:
        """Return the margins, each in its segment."""
        return self._margin(self._norm(time), segment)

    def _margin(self, norm: FloatArray, segment: IntArray) -> FloatArray:
        floor = self._floor[segment]
        above = np.where(np.isfinite(floor), norm / floor - 1, np.inf)
        margin: FloatArray = np.minimum(1 - norm / self._limit[segment], above)
        return margin

    def _norm(self, time: FloatArray) -> FloatArray:
        trajectory = self._trajectory
        states = (trajectory.position, trajectory.velocity, trajectory.acceleration)
        orders = states[: self._quantity.derivatives + 1]
        norm: FloatArray = np.linalg.norm(
            self._quantity.values(*(of(time) for of in orders)), axis=1
        )
        return norm


def tool_speed_margin(
    problem: PlanningProblem, trajectory: JointTrajectory
) -> ToolRateMargin | None:
    """Return the margin of the tool's speed; None where no segment limits the speed."""
    limit = _limits(problem, "tool_speed")
    if not np.isfinite(limit).any():
        return None
    return ToolRateMargin(trajectory, _velocity(problem.robot), limit, _floors(problem))


def tool_acceleration_margin(
    problem: PlanningProblem, trajectory: JointTrajectory
) -> ToolRateMargin | None:
    """Return the margin of the tool's acceleration; None where no segment limits it."""
    limit = _limits(problem, "tool_acceleration")
    quantity = _acceleration(problem.robot)
    return ToolRateMargin(trajectory, quantity, limit) if np.isfinite(limit).any() else None


def _limits(problem: PlanningProblem, name: str) -> FloatArray:
    """Return the limit in each segment, the robot's own included, shape (m,) [m/s or m/s^2]."""
    own = np.full(problem.tube.segment_count, getattr(problem.robot.limits, name))
    of_tube = getattr(problem.tube, name)
    return own if of_tube is None else np.minimum(own, of_tube)


def _velocity(robot: RobotModel) -> Quantity:
    """Return the velocity of the tool centre point, c = 3 [m/s]."""

    def values(q: FloatArray, v: FloatArray) -> FloatArray:
        return np.einsum("nij,nj->ni", robot.tool_jacobian(q)[1][:, :3], v)

    def majorant(joints: FloatArray, width: FloatArray) -> FloatArray:
        rate = derivative(tool_majorant(robot, joints).position) / width
        return np.stack([rate] * 3, axis=2)

    return Quantity(1, values, majorant)


def _acceleration(robot: RobotModel) -> Quantity:
    """Return the acceleration of the tool centre point, c = 3 [m/s^2]; gravity is not counted.

    Joint j, with the columns J_j of the Jacobian and the axis w_j of its turning, is carried by the
    joints i before it: d J_j / d q_i = w_i x J_j, and by symmetry w_j x J_i for those behind.
    """
    carrier = robot.link_body[robot.tool_frame]
    moved = np.flatnonzero(robot.carries[carrier])
    joint, factor = robot.body_joints[moved + 1], robot.body_rules[0][moved + 1]
    turns = robot.body_is_revolute[moved + 1][:, None]

    def values(q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        rotation, position = robot.body_poses(q)
        tool = robot.tool_position(q)[:, None]
        axis = np.einsum("nmij,mj->nmi", rotation[:, moved + 1], robot.chain.axes[moved])
        spin = np.where(turns, axis, 0.0)
        arm = tool - position[:, moved + 1]
        column = np.where(turns, cross_product(axis, arm), axis)
        rate, change = (factor * each[:, joint] for each in (v, a))
        moving, turning = rate[..., None] * column, rate[..., None] * spin
        carried = np.cumsum(turning, axis=1) - turning
        bend = cross_product(2 * carried + turning, moving)
        total: FloatArray = (change[..., None] * column + bend).sum(axis=1)
        return total

    def majorant(joints: FloatArray, width: FloatArray) -> FloatArray:
        rate = derivative(tool_majorant(robot, joints).position, 2) / width**2
        return np.stack([rate] * 3, axis=2)

    return Quantity(2, values, majorant)


def judge_point_speed(motion: JudgedMotion) -> JudgedCondition:
    """Judge the speeds of points, by polynomials that enclose their velocities."""
    points = motion.robot.limits.point_speed
    if not points:
        return not_required(RELATIVE, "no point's speed is limited")
    judged = [_judged(motion, k, point) for k, point in enumerate(points)]
    return min(judged, key=lambda condition: condition.margin or 0.0)


def _judged(motion: JudgedMotion, k: int, point: PointSpeed) -> JudgedCondition:
    """Judge the speed of a point from start to end: no segment limits point speeds."""
    limit, whole = point.speed, [Visit(0, 0.0, motion.trajectory.duration)]
    tolerance = np.full(3, _ENCLOSURE * limit)
    velocity = enclosed(motion.trajectory, _point_velocity(motion.robot, point), tolerance)

    def margin(vector: FloatArray, _: IntArray) -> FloatArray:
        return 1 - np.linalg.norm(vector, axis=2) / limit

    least = least_concave_margin(velocity, whole, margin, np.array([1 / limit]))
    location = Location(time=least.time, links=(point.link,), point_speed=k)
    return bracketed(least.lower_bound, least.attained, RELATIVE, location)


def _point_velocity(robot: RobotModel, point: PointSpeed) -> Quantity:
    """Return the velocity of a point that moves with a link, c = 3 [m/s]."""
    body = robot.link_body[point.link]
    in_body = robot.link_placement[point.link] @ np.append(point.position, 1.0)

    def values(q: FloatArray, v: FloatArray) -> FloatArray:
        rotation, position = robot.body_poses(q)
        location = rotation[:, body] @ in_body[:3] + position[:, body]
        carriers = np.full(len(q), body)
        jacobian = robot.point_jacobian(rotation, position, carriers, location)
        return np.einsum("nij,nj->ni", jacobian, v)

    def majorant(joints: FloatArray, width: FloatArray) -> FloatArray:
        reach = float(np.linalg.norm(in_body[:3]))
        rate = derivative(point_majorant(robot, joints, body, reach)) / width
        return np.stack([rate] * 3, axis=2)

    return Quantity(1, values, majorant)
