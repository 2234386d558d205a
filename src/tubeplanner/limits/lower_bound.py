"""A proved lower bound on the duration of all motions of a problem or a cycle.

No motion that keeps the conditions is shorter. The bound is the largest of several, each of which
takes a part of the conditions alone: one joint through its ranges, a sliding joint at its efforts,
the tool from start to goal by all joints together, or a point at its speed limits. A certificate's
tolerance of 1e-6 is not part of it.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import ProblemError
from tubeplanner.geometry.tube.points import MIN_LENGTH
from tubeplanner.limits.rates import RATES, PointSpeedLimit, ToolSpeed
from tubeplanner.limits.tool_travel import end_ball, tool_travel
from tubeplanner.outcome import MARGIN_TOLERANCE
from tubeplanner.robot.urdf import followers_of
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.motion import Task
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import MAX_DURATION

_DECIMALS = 1e4  # of the texts of durations
_ROUNDING = 1e-2  # of the last decimal, or of a period: a bound this little below counts as there


@dataclass(frozen=True)
class LowerBound:
    """A proved lower bound on the duration of all motions of a problem or a cycle.

    Attributes:
        duration: No motion is shorter [s]; 0: nothing is known.
        reason: What decides, in words.
        limit: The limit that decides, as a sensitivity's; None: several limits, or none.
        joint: Its joint; None: not a joint's limit.
        segment: Its segment of the tube; None: not a segment's limit.
    """

    duration: float = 0.0
    reason: str = "nothing is known"
    limit: str | None = None
    joint: str | None = None
    segment: int | None = None

    def beside(self, duration: float = np.inf) -> str:
        """Return the bound as text beside a duration [s]; empty if nothing is known.

        Rounded downwards, and never above the duration: a certificate's tolerance may be used.
        """
        least = np.floor(min(self.duration, duration) * _DECIMALS + _ROUNDING) / _DECIMALS
        return f"nothing is faster than {least:.4f} s" if least > 0 else ""


def lower_bound(task: Task) -> LowerBound:
    """Return a lower bound on the duration of all motions of a problem or a cycle [s].

    Of a cycle, the sum over its legs and rests. Where a leg ends in no given configuration, over
    all configurations there.

    Args:
        task: The problem or the cycle.

    Raises:
        ProblemError: It is neither.
    """
    if not isinstance(task, Cycle):
        PlanningProblem.require(task)
        return _of_problem(task)
    problems = [task.problem_from_anywhere(k) for k in range(len(task.legs))]
    junctions = [problems[0].start, *(each.goal for each in problems)]
    if task.closed and not isinstance(junctions[-1], np.ndarray):
        junctions[-1] = junctions[0]
    duration, before = task.after.duration, None
    for leg, problem, (start, goal) in zip(task.legs, problems, pairwise(junctions), strict=True):
        with suppress(ProblemError):  # a leg that cannot begin or end there has no motion
            problem = replace(
                problem,
                start=start if isinstance(start, np.ndarray) else problem.start,
                goal=goal if isinstance(goal, np.ndarray) else problem.goal,
            )
        is_known = before is None or isinstance(start, np.ndarray) or _begins_in(before, problem)
        part = _of_problem(problem) if is_known else slowest_joint(problem)
        duration += leg.before.duration + part.duration
        before = problem
    return LowerBound(duration, "its moves and rests, one after the other")


def _begins_in(before: PlanningProblem, after: PlanningProblem) -> bool:
    """Return True if the tool is at the end of one leg where the bound of the next assumes it."""
    (end, radius), (begin, most) = end_ball(before, -1), end_ball(after, 0)
    return float(np.linalg.norm(end - begin)) + radius <= most + MIN_LENGTH


def _of_problem(problem: PlanningProblem) -> LowerBound:
    """Return the largest of the bounds of a problem; with a period, the next multiple of it."""
    parts = slowest_joint, slowest_slide, all_joints, first_joint, slowest_point
    best = max((part(problem.joined) for part in parts), key=lambda each: each.duration)
    tool = slowest_tool(problem.joined, best.duration)
    best = tool if tool.duration > best.duration else best
    if problem.period is None:
        return best
    periods = np.ceil(best.duration / problem.period - _ROUNDING)
    return replace(best, duration=float(periods * problem.period))


# ---- One joint alone: every motion moves it from rest to rest, through the ranges of all segments.
#
# At start, hand-overs and goal, in this order, a joint is in the intervals I_0, ... I_m: its
# configuration there, or the ranges of the segments that meet. Its least way is that of a joint
# which moves no farther than the next interval asks. Where this way turns, the joint is at an
# extreme value and has no velocity, so that the times of the pieces between add up; but it may have
# an acceleration there, and the jerk limit does not count. It counts from I_0 to I_m, since the
# joint rests in both: no motion from rest to rest over at least that distance is shorter.

_MORE = 1.1  # a limit decides where this factor of it would take most from the bound


def slowest_joint(problem: PlanningProblem) -> LowerBound:
    """Return the least time of the slowest joint through its ranges, from rest to rest [s]."""
    limits, names = problem.robot.limits, problem.robot.joint_names
    gap, ways = _least_ways(problem)

    def least_time(joint: int, velocity: float, acceleration: float, jerk: float) -> float:
        pieces = [rest_to_rest(way, velocity, acceleration, np.inf) for way in ways[joint]]
        return max(rest_to_rest(gap[joint], velocity, acceleration, jerk), sum(pieces))

    rows = np.column_stack([getattr(limits, name) for name in RATES]).tolist()
    times = [least_time(joint, *row) for joint, row in enumerate(rows)]
    joint = int(np.argmax(times))
    if times[joint] == 0:
        return LowerBound()
    higher = np.where(np.eye(len(RATES), dtype=bool), _MORE, 1.0) * rows[joint]
    limit = list(RATES)[int(np.argmin([least_time(joint, *row) for row in higher.tolist()]))]
    return LowerBound(times[joint], f"{limit} of {names[joint]}", limit, names[joint])


def _least_ways(problem: PlanningProblem) -> tuple[list[float], list[list[float]]]:
    """Return the distance of each joint from I_0 to I_m, and the pieces of its least way."""
    lower, upper = problem.joint_lower, problem.joint_upper
    if problem.tube.visit == "any":
        lower, upper = lower.min(axis=0, keepdims=True), upper.max(axis=0, keepdims=True)
    low = np.vstack([lower[:1], np.maximum(lower[:-1], lower[1:]), lower[-1:]]) - MARGIN_TOLERANCE
    high = np.vstack([upper[:1], np.minimum(upper[:-1], upper[1:]), upper[-1:]]) + MARGIN_TOLERANCE
    for row, end in zip((0, -1), problem.endpoints, strict=True):
        if end.joints is not None:
            low[row] = high[row] = end.joints
    gap = np.maximum(np.maximum(low[-1] - high[0], low[0] - high[-1]), 0.0)
    return gap.tolist(), [
        _pieces(list(zip(*ends, strict=True)))
        for ends in zip(low.T.tolist(), high.T.tolist(), strict=True)
    ]


def _pieces(intervals: list[tuple[float, float]]) -> list[float]:
    """Return the lengths of the least way through intervals in order, from turn to turn."""
    low, high = -np.inf, np.inf  # all intervals so far meet here
    steps: list[float] = []
    is_under_way, position = False, 0.0
    for below, above in intervals:
        if not is_under_way and max(low, below) <= min(high, above):
            low, high = max(low, below), min(high, above)
            continue
        if not is_under_way:
            is_under_way, position = True, high if below > high else low
        step = max(below - position, 0.0) + min(above - position, 0.0)
        position += step
        if steps and step * steps[-1] > 0:
            steps[-1] += step
        elif step != 0:
            steps.append(step)
    return [abs(step) for step in steps]


def rest_to_rest(distance: float, velocity: float, acceleration: float, jerk: float) -> float:
    """Return the least time of a joint from rest to rest over a distance [s].

    With the peak velocity v it takes d/v + T, where T is the time of either change of velocity: v/A
    + A/J, or 2 sqrt(v/J) if v is below A^2/J. That falls with v as long as there is time between
    both changes, v T <= d. (Double S: Biagiotti & Melchiorri, "Trajectory Planning for Automatic
    Machines and Robots", 2008, section 3.4.)

    Args:
        distance: [rad or m].
        velocity: Limit [rad/s or m/s]; inf: none, as of the others.
        acceleration: Limit [rad/s^2 or m/s^2].
        jerk: Limit [rad/s^3 or m/s^3].
    """
    if distance == 0 or (np.isinf(acceleration) and np.isinf(jerk)):
        return distance / velocity
    rise = acceleration / jerk  # [s]
    peak = min(velocity, float(np.cbrt(distance**2 * jerk / 4)))
    if peak <= rise * acceleration:
        return distance / peak + 2 * float(np.sqrt(peak / jerk))
    root = float(np.hypot(rise / 2, np.sqrt(distance / acceleration)))
    peak = min(velocity, distance / (rise / 2 + root))
    return distance / peak + peak / acceleration + rise


# ---- A sliding joint whose axis never turns, with its effort.
#
# The bodies that it carries have the momentum p = sum m_k (x_k)' along its axis, x_k the centres of
# mass, and its rotor r q', so that y = sum m_k x_k + r q has
#
#   y'' = effort - friction + gravity's force along the axis,  |y''| <= limit + friction + gravity.
#
# Between given configurations y moves by a known distance, at rest at both ends, whatever the other
# joints do. If all joints slide, y' = sum M_jk q'_k with a constant M, and the joints' limits bound
# all rates of y too. There is no such bound for a turning joint: its momentum is no rate of a
# function of the configuration, and turns of the others move it without effort of its own.

_PARALLEL = 1e-9  # largest sine of the angle between parallel axes


def slowest_slide(problem: PlanningProblem) -> LowerBound:
    """Return the least time of sliding joints between given configurations at their efforts [s]."""
    robot, (start, goal) = problem.robot, (end.joints for end in problem.endpoints)
    if start is None or goal is None or robot.revolute.all():
        return LowerBound()
    if followers_of(robot.urdf, robot.joint_names):
        return LowerBound()
    limits, motors = robot.limits, robot.motors
    mass = np.array([body.mass for body in robot.inertias])
    com = np.array([body.com for body in robot.inertias])
    rotation, position = robot.body_poses(np.array([start, goal]))
    moved = mass[:, None] * np.diff(position + (rotation @ com[..., None])[..., 0], axis=0)[0]
    axes = (rotation[0, 1:] @ robot.chain.axes[..., None])[..., 0]
    still = np.zeros((1, robot.joint_count))
    inertia = abs(robot.inverse_dynamics_derivatives(start[None], still, still)[2][0])
    best = LowerBound()
    for body in np.flatnonzero(~robot.body_is_revolute)[1:]:
        j, axis = int(robot.body_joints[body]), axes[body - 1]
        turning = robot.body_is_revolute & robot.joint_moves_body[body, robot.body_joints]
        if not all(_are_parallel(axis, other) for other in axes[turning[1:]]):
            continue
        carried = robot.joint_moves_body[:, j]
        way = float(moved[carried].sum(axis=0) @ axis + motors.armature[j] * (goal - start)[j])
        sliding = max(motors.backwards_friction[j], motors.forwards_friction[j])
        if motors.viscous_friction[j] > 0:
            sliding += motors.viscous_friction[j] * limits.velocity[j]
        force = limits.effort[j] + abs(mass[carried].sum() * robot.gravity @ axis)
        force += (1 + motors.friction_uncertainty) * sliding
        rates = [np.inf, force, np.inf]
        if not robot.revolute.any():
            moves = inertia[j] > 0
            own = [float(inertia[j, moves] @ getattr(limits, name)[moves]) for name in RATES]
            rates = [min(pair) for pair in zip(rates, own, strict=True)]
        if (duration := rest_to_rest(abs(way), *rates)) > best.duration:
            name = robot.joint_names[j]
            best = LowerBound(duration, f"effort of {name}", "effort", name)
    return best


def _are_parallel(first: FloatArray, second: FloatArray) -> bool:
    return bool(np.linalg.norm(np.cross(first, second)) <= _PARALLEL)


# ---- All joints together: the tool from start to goal, where an end is no given configuration.
#
# In a time T from rest to rest, joint j moves by at most d_j(T), the inverse of `rest_to_rest`. One
# after the other from the base to the tip, the joints bring the tool from start to goal: joint j
# moves it by at most r_j d_j, where r_j is its lever arm, and turns it by at most d_j. So
#
#   sum r_j d_j(T) >= distance of the tool,  and  sum of turning joints' d_j(T) >= its rotation.
#
# A lever arm depends on the joints after j alone, which have not moved yet: it is that of the given
# configuration; without one, the largest of all.

_FULL_TURNS = 2 * np.pi * np.arange(-1, 2)[:, None]
_FIRST_TIME, _HALVINGS = 1e-3, 50  # of the bisection: the first time [s]
_UNLIMITED = 1e9  # [rad or m]: infinite distances are cut to it, as no lever arm times inf is one


def all_joints(problem: PlanningProblem) -> LowerBound:
    """Return the least time in which all joints bring the tool from start to goal [s]."""
    robot, ends = problem.robot, problem.endpoints
    configurations = [end.joints for end in ends if end.joints is not None]
    if len(configurations) == len(ends):  # then the slowest joint takes longer
        return LowerBound()
    centres, radii = zip(*[end_ball(problem, index) for index in (0, -1)], strict=True)
    distance = float(np.linalg.norm(centres[1] - centres[0])) - sum(radii)
    body, none = np.array([robot.link_body[robot.tool_frame]]), np.zeros(1)
    lever = robot.approach_rates((body, 0 * body), (none + robot.tool_reach, none))[0]
    times = []
    if not followers_of(robot.urdf, robot.joint_names):
        if configurations:
            columns = robot.tool_jacobian(configurations[0])[1][:3]
            lever = np.sqrt(np.einsum("ij,ij->j", columns, columns))
        poses = [end.pose for end in ends if end.pose is not None]
        rotations = [pose.rotation for pose in poses]
        rotations += [robot.tool_pose(q)[0] for q in configurations]
        if len(rotations) == len(ends):
            turn = poses[0].errors(rotations[1], poses[0].position)[1]
            times.append((_time_together(problem, robot.revolute.astype(float), turn), "rotation"))
    times.append((_time_together(problem, lever, distance), "position"))
    duration, what = max(times)
    return LowerBound(duration, f"all joints together, for the tool's {what}")


def _time_together(problem: PlanningProblem, lever: FloatArray, distance: float) -> float:
    """Return the least T with sum r_j d_j(T) >= a distance, for lever arms (n,) [s]."""
    if distance <= 0:
        return 0.0
    return _least_enough(lambda time: float(lever @ _distances(problem, time)) >= distance)


def _distances(problem: PlanningProblem, time: float) -> FloatArray:
    """Return the largest distance of each joint from rest to rest in a time [s], (n,)."""
    rates = np.column_stack([getattr(problem.robot.limits, name) for name in RATES]).tolist()
    most = [distance_in(time, *row) for row in rates]
    return np.minimum(most, _UNLIMITED)


def _least_enough(is_enough: Callable[[float], bool]) -> float:
    """Return the time from which on it is enough, by bisection from below [s]; 0: it never is."""
    low, high = 0.0, _FIRST_TIME
    while not is_enough(high):
        low, high = high, 2 * high
        if high > MAX_DURATION:
            return 0.0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (low, middle) if is_enough(middle) else (middle, high)
    return low


def distance_in(time: float, velocity: float, acceleration: float, jerk: float) -> float:
    """Return the largest distance of a joint from rest to rest in a time: [s] to [rad or m].

    The inverse of `rest_to_rest`; limits as there.
    """
    if np.isinf(acceleration) and np.isinf(jerk):
        return velocity * time
    rise = acceleration / jerk
    peak = jerk * time**2 / 16 if time < 4 * rise else acceleration * (time / 2 - rise)
    peak = min(velocity, peak)
    if peak < rise * acceleration:
        return peak * (time - 2 * float(np.sqrt(peak / jerk)))
    return peak * (time - peak / acceleration - rise)


# ---- The first joint and then the others, where one end alone is a given configuration.
#
# That joint turns by delta about its axis z, |delta| <= d_1(T), and takes the tool from p to
# Rot(delta) p, both from a point of z. The others bring it to the other end o, as above:
#
#   |Rot(-delta) o - p| <= sum of r_j d_j(T) over all j after the first.
#
# If the second joint turns, about an axis a, then it and those that follow with parallel axes keep
# the component of the tool along that axis, and only the joints after these change it:
#
#   |a Rot(-delta) o - a p| <= sum of r_j d_j(T) over these,
#   a Rot(-delta) o = c + h cos(delta + gamma).
#
# T is long enough only if some delta fulfils both.


def first_joint(problem: PlanningProblem) -> LowerBound:
    """Return the least time in which the first joint and then the others move the tool [s]."""
    robot, ends = problem.robot, problem.endpoints
    index = 0 if ends[1].joints is None else 1
    q = ends[index].joints
    if q is None or ends[1 - index].joints is not None:
        return LowerBound()
    body_of = {int(joint): body for body, joint in enumerate(robot.body_joints) if body}
    moving = np.flatnonzero(robot.joint_moves_body[robot.link_body[robot.tool_frame]]).tolist()
    chain = sorted(moving, key=lambda j: int(robot.joint_moves_body[body_of[j]].sum()))
    if not chain or not robot.revolute[chain[0]] or followers_of(robot.urdf, robot.joint_names):
        return LowerBound()
    first, *others = chain
    tool, jacobian = robot.tool_jacobian(q)
    lever, axes = np.sqrt((jacobian[:3] ** 2).sum(axis=0)), jacobian[3:].T
    z, axis, rest = axes[first], axes[chain[min(1, len(others))]], others
    while rest and robot.revolute[rest[0]] and _are_parallel(axis, axes[rest[0]]):
        rest = rest[1:]
    origin = robot.body_poses(q)[1][body_of[first]]
    other, radius = end_ball(problem, (-1, 0)[index])
    along = [z * (z @ (point - origin)) for point in (tool, other)]
    p, o = tool - origin - along[0], other - origin - along[1]  # across z
    height, gamma = _polar(axis @ o, axis @ np.cross(z, o))
    product, phi = _polar(p @ o, z @ np.cross(p, o))
    constant = float(np.sum((along[1] - along[0]) ** 2) + p @ p + o @ o)
    level = float(axis @ (tool - origin - along[1]))

    def is_enough(time: float) -> bool:
        most = _distances(problem, time)
        near = float(lever[rest] @ most[rest]) + radius
        low, high = 0.0, np.pi
        if height > MIN_LENGTH:
            cosines = (level + near) / height, (level - near) / height
            if cosines[0] < -1 or cosines[1] > 1:
                return False
            low, high = np.arccos(np.clip(cosines, -1.0, 1.0)).tolist()
        deltas = np.array([[low, high], [-high, -low]])[:, None] - gamma + _FULL_TURNS
        begin = np.maximum(deltas[..., 0], -most[first])
        end = np.minimum(deltas[..., 1], most[first])
        if (begin > end).all():
            return False
        nearest = phi + _FULL_TURNS[:, None]
        away = np.maximum(np.maximum(begin - nearest, nearest - end), 0.0)
        cosine = np.cos(min(away[:, begin <= end].min(), np.pi))
        distance = np.sqrt(max(constant - 2 * product * cosine, 0.0)) - radius
        return bool(distance <= lever[others] @ most[others])

    name = robot.joint_names[first]
    reason = f"{name} and the joints after it, for the tool's position"
    return LowerBound(_least_enough(is_enough), reason, None, name)


def _polar(x: float, y: float) -> tuple[float, float]:
    """Return length and angle of a vector (x, y)."""
    return float(np.hypot(x, y)), float(np.arctan2(y, x))


# ---- Points and the tool alone: no faster than their speed limits.


def slowest_point(problem: PlanningProblem) -> LowerBound:
    """Return the least time of points with a speed limit between given configurations [s]."""
    robot, (start, goal) = problem.robot, (end.joints for end in problem.endpoints)
    best = LowerBound()
    if start is None or goal is None:
        return best
    for k, point in enumerate(robot.limits.point_speed):
        rotation, position = robot.body_poses(np.array([start, goal]))
        body, pose = robot.link_body[point.link], robot.link_placement[point.link]
        local = pose[:3, :3] @ np.array(point.position) + pose[:3, 3]
        way = np.diff(rotation[:, body] @ local + position[:, body], axis=0)
        duration = float(np.linalg.norm(way)) / point.speed
        if duration > best.duration:
            reason = f"{PointSpeedLimit.kind} of point {k}, on {point.link}"
            best = LowerBound(duration, reason, PointSpeedLimit.kind)
    return best


def slowest_tool(problem: PlanningProblem, known: float = 0.0) -> LowerBound:
    """Return the least time of the tool through the tube, if beyond a known lower bound [s]."""
    duration, longest = tool_travel(problem, known)
    if longest is None:
        return LowerBound(duration, ToolSpeed.kind, ToolSpeed.kind)
    segment = problem.tube.segment_number(longest)
    return LowerBound(
        duration, f"{ToolSpeed.kind} of segment {segment}", ToolSpeed.kind, None, segment
    )
