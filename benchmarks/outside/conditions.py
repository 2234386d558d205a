"""Conditions on a trajectory but for its tube and its distances: limits, ends and continuity."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from outside.arm import Arm
from outside.files import BadInput, placement_of
from outside.joint_limits import directions
from outside.problem import Problem
from outside.trajectory import ORDERS, Samples, Trajectory
from outside.tube_fields import TubeFields

RELATIVE = "relative"
QUANTITIES = ("position", "velocity", "acceleration", "jerk")
STILL = 1e-6  # of the fastest joint's speed: a slower joint is measured by that
NEAR_FRACTION, NEAR_ABSOLUTE = 0.01, 1e-3  # relative; [rad, m]: where steps are divided
PARTS = 20  # into so many
MET = 1e-6  # [m]: a tool that near is at its point
FRACTION = 1e-3  # of a piece: the step of differences


@dataclass(frozen=True)
class Condition:
    """One condition's least margin.

    Attributes:
        margin: How far it is kept; None where it is not asked.
        unit: "m", "rad" or "relative".
        time: When it is least [s].
        where: Which joint, segment, links or obstacle.
    """

    margin: float | None
    unit: str
    time: float | None = None
    where: str = ""

    def holds(self, tolerance: float) -> bool:
        """Return whether it is kept, or broken by no more than a tolerance."""
        return self.margin is None or self.margin >= -tolerance


def margin_of(condition: Condition) -> float:
    """Return a condition's margin, infinite where it is not asked."""
    return math.inf if condition.margin is None else condition.margin


def judge_limits(arm: Arm, trajectory: Trajectory, samples: Samples) -> dict[str, Condition]:
    """Return position, velocity, acceleration, jerk, effort, motor_curve, effort_rate, point_speed.

    Args:
        arm: Its limits are judged.
        trajectory: Of the arm's joints.
        samples: Steps beside one that is within 1 % or 1 mm of a limit are divided.
    """
    margins = _margins(arm, trajectory, samples)
    found = {name: _condition(arm, name, margin, samples) for name, margin in margins.items()}
    near = np.zeros(len(samples), dtype=bool)
    for name, margin in margins.items():
        near |= (margin < (NEAR_ABSOLUTE if name == "position" else NEAR_FRACTION)).any(axis=1)
    rows = np.flatnonzero(near)
    finer = samples.between(np.concatenate([rows - 1, rows]), PARTS)
    if len(finer) == 0:
        return found
    more = _margins(arm, trajectory, finer)
    for name, margin in more.items():
        found[name] = min(found[name], _condition(arm, name, margin, finer), key=margin_of)
    return found


def judge_ends(problem: Problem, arm: Arm, trajectory: Trajectory) -> dict[str, Condition]:
    """Return the conditions start, goal, rest and continuity."""
    ends = Samples(*(np.array(row) for row in zip(*_end_rows(trajectory), strict=True)))
    q = trajectory.at(ends)
    asked = (("start", problem.start, 0, 0), ("goal", problem.goal, 1, -1))
    found = {
        name: _end(arm, given, q[row], problem.tube, point, float(ends.time[row]))
        for name, given, row, point in asked
    }
    largest = _largest(trajectory)
    fractions = [abs(trajectory.at(ends, order)) / largest[order] for order in (1, 2)]
    fraction = np.maximum(*fractions)
    row, joint = np.unravel_index(int(fraction.argmax()), fraction.shape)
    where = f"joint {arm.joint_names[joint]}"
    found["rest"] = Condition(-float(fraction.max()), RELATIVE, float(ends.time[row]), where)
    found["continuity"] = _continuity(arm, trajectory, largest)
    return found


def judge_ball(goal: dict[str, Any], arm: Arm, q: np.ndarray, time: float) -> Condition:
    """Return how far inside its ball the tool is in a configuration (n,)."""
    away = math.dist(arm.tool(q[None])[1][0], goal["position"])
    return Condition(float(goal.get("tolerance", 0.0)) - away, "m", time, "tool in its ball")


def judge_pose(pose: dict[str, Any], arm: Arm, q: np.ndarray, time: float) -> Condition:
    """Return how far the tool is from its pose in a configuration (n,), metres or radians."""
    asked = placement_of(pose)
    rotation, position = arm.tool(q[None])
    away = math.dist(position[0], asked.translation)
    turned = float(Rotation.from_matrix(asked.rotation.T @ rotation[0]).magnitude())
    unit = "rad" if turned > away else "m"
    return Condition(-max(away, turned), unit, time, "tool in its pose")


def judge_turn(problem: Problem, arm: Arm, trajectory: Trajectory) -> Condition:
    """Return how far inside the goal's bounds the last orientation is; no margin if it has none.

    Raises:
        BadInput: The tube has no orientations, or the bounds are no angle and no triple.
    """
    given = problem.goal.get("rotation_tolerance")
    if given is None:
        return Condition(None, "rad")
    if problem.tube.orientations is None or np.shape(given) not in ((), (3,)):
        raise BadInput("goal.rotation_tolerance needs tube.orientations, and an angle or a triple")
    time = float(trajectory.breakpoints[-1])
    last = trajectory.samples(1)
    rotation = arm.tool(trajectory.at(last)[-1:])[0][0]
    reference = Rotation.from_quat(problem.tube.orientations[-1])
    vector = (reference.inv() * Rotation.from_matrix(rotation)).as_rotvec()
    used = abs(vector) if np.ndim(given) else np.linalg.norm(vector)
    margin = float(np.min(np.array(given, dtype=float) - used))
    return Condition(margin if math.isfinite(margin) else None, "rad", time, "at the goal")


def _margins(arm: Arm, trajectory: Trajectory, samples: Samples) -> dict[str, np.ndarray]:
    """Return how far each joint is inside its limits, shape (N, n): rad or m, then relative.

    Of points' speeds, shape (N, P).
    """
    limits = arm.limits
    q, v, a, jerk = (trajectory.at(samples, order) for order in range(ORDERS))
    margins = {
        "position": np.minimum(q - limits.lower, limits.upper - q),
        "velocity": 1 - abs(v) / limits.velocity,
        "acceleration": 1 - abs(a) / limits.acceleration,
        "jerk": 1 - abs(jerk) / limits.jerk,
    }
    margins |= _motor_margins(arm, trajectory, samples)
    is_bounded = np.isfinite(limits.effort_rate)
    rates = _effort_rates(arm, trajectory, samples) if is_bounded.any() else np.zeros_like(q)
    margins["effort_rate"] = 1 - abs(rates) / limits.effort_rate
    for name in ("velocity", "acceleration", "jerk", "effort_rate"):
        margins[name][:, ~np.isfinite(getattr(limits, name))] = math.inf
    for law in limits.laws:
        j = law.joint
        by_place = law.margin(q[:, j], v[:, j], float(limits.velocity[j]))
        margins["velocity"][:, j] = np.minimum(margins["velocity"][:, j], by_place)
    fractions = [
        np.linalg.norm(arm.point_velocity(p, q, v), axis=1) / p.speed for p in limits.points
    ]
    margins["point_speed"] = 1 - np.array(fractions).reshape(len(fractions), len(q)).T
    return margins


def _motor_margins(arm: Arm, trajectory: Trajectory, samples: Samples) -> dict[str, np.ndarray]:
    """Return what motors have left of their efforts and of their torque-speed lines, (N, n)."""
    limits, motors = arm.limits, arm.motors
    q, v, a = (trajectory.at(samples, order) for order in range(3))
    left = {name: np.full_like(q, math.inf) for name in ("effort", "motor_curve")}
    if not np.isfinite([limits.effort, motors.stall]).any():
        return left
    dry, unsure = motors.friction(v, directions(trajectory, samples))
    efforts = arm.efforts(q, v, a) + dry
    for way in (1, -1):
        most = way * efforts + unsure
        for j, limit in enumerate(limits.by_place):
            if np.isfinite(limit.largest):
                own = (limit.allowed(q[:, j], way) - most[:, j]) / limit.largest
                left["effort"][:, j] = np.minimum(left["effort"][:, j], own)
        lines = np.isfinite(motors.stall)
        curve = 1 - most / motors.stall - way * v / motors.no_load
        left["motor_curve"][:, lines] = np.minimum(left["motor_curve"], curve)[:, lines]
    return left


def _effort_rates(arm: Arm, trajectory: Trajectory, samples: Samples) -> np.ndarray:
    """Return how fast the efforts change, by differences of fourth order, shape (N, n).

    Of the polynomial that holds at each sample, which goes on beyond its breakpoints.
    """
    step = FRACTION * np.diff(trajectory.breakpoints)[samples.piece]
    total = np.zeros((len(samples), len(arm.joint_names)))
    for steps, weight in ((-2, 1.0), (-1, -8.0), (1, 8.0), (2, -1.0)):
        moved = replace(samples, local=samples.local + steps * step)
        total += weight * arm.efforts(*(trajectory.at(moved, order) for order in range(3)))
    return total / (12 * step[:, None])


def _condition(arm: Arm, name: str, margin: np.ndarray, samples: Samples) -> Condition:
    if margin.size == 0:
        return Condition(None, RELATIVE)
    row, joint = np.unravel_index(int(margin.argmin()), margin.shape)
    if name == "point_speed":
        where = f"point {joint} on {arm.limits.points[joint].link}"
        return Condition(float(margin[row, joint]), RELATIVE, float(samples.time[row]), where)
    unit = ("m" if arm.slides[joint] else "rad") if name == "position" else RELATIVE
    if not np.isfinite(margin[row, joint]):
        return Condition(None, unit)
    where = f"joint {arm.joint_names[joint]}"
    return Condition(float(margin[row, joint]), unit, float(samples.time[row]), where)


def _end_rows(trajectory: Trajectory) -> list[tuple[int, float, float]]:
    last = len(trajectory.breakpoints) - 2
    width = float(trajectory.breakpoints[-1] - trajectory.breakpoints[-2])
    return [(0, 0.0, 0.0), (last, width, trajectory.duration)]


def _end(
    arm: Arm, given: dict, q: np.ndarray, tube: TubeFields, index: int, time: float
) -> Condition:
    """Return whether an end is the given configuration, or else has its tool at the point.

    A tool that no joints move in three directions is hardly ever at a point that somebody typed:
    where none of the joints' motions from here leads it there, it must be within the radius.
    """
    joints, point = given.get("joints"), tube.points[index]
    if given.get("pose") is not None:
        return judge_pose(given["pose"], arm, q, time)
    if "position" in given:
        return judge_ball(given, arm, q, time)
    if joints is None:
        error = float(np.linalg.norm(arm.tool(q[None])[1][0] - point))
        if error > MET and directions_of_tool(arm) < 3 and _least(arm, q, tube, index) > MET:
            return Condition(float(tube.radius[index]) - error, "m", time, "tool near the point")
        return Condition(-error, "m", time, "tool at the reference point")
    if isinstance(joints, dict):
        joints = [joints[name] for name in arm.joint_names]
    error = abs(q - np.array(joints, dtype=float))
    joint = int(error.argmax())
    unit = "m" if arm.slides[joint] else "rad"
    return Condition(-float(error[joint]), unit, time, f"joint {arm.joint_names[joint]}")


def directions_of_tool(arm: Arm) -> int:
    """Return in how many directions joints move the tool, at the most of some configurations."""
    ranks = []
    for q in arm.random(np.random.default_rng(1), 5):
        columns = arm.tool_velocity(np.tile(q, (len(q), 1)), np.eye(len(q)))
        columns = columns[arm.limits.upper > arm.limits.lower]
        ranks.append(int(np.linalg.matrix_rank(columns, tol=1e-6)))
    return max(ranks)


def _least(arm: Arm, q: np.ndarray, tube: TubeFields, index: int) -> float:
    """Return how near the tool comes to an end's point from a configuration (n,) [m]."""
    ranges = [tube.ranges[index].get(name, (-np.inf, np.inf)) for name in arm.joint_names]
    lower, upper = np.array(ranges).T
    lower, upper = np.maximum(lower, arm.limits.lower), np.minimum(upper, arm.limits.upper)
    free = upper > lower

    def off(moved: np.ndarray) -> np.ndarray:
        places = q.copy()
        places[free] = moved
        return arm.tool(places[None])[1][0] - tube.points[index]

    begin = np.clip(q, lower, upper)[free]
    found = least_squares(off, begin, bounds=(lower[free], upper[free]), xtol=1e-15, ftol=1e-15)
    return float(np.linalg.norm(found.fun))


def _sides(trajectory: Trajectory, order: int) -> np.ndarray:
    """Return a derivative at the beginning and the end of every piece, shape (2, P, n)."""
    widths = np.diff(trajectory.breakpoints)
    every = np.arange(len(widths))
    local = np.concatenate([np.zeros_like(widths), widths])
    both = Samples(np.tile(every, 2), local, trajectory.breakpoints[np.tile(every, 2)] + local)
    return trajectory.at(both, order).reshape(2, len(widths), -1)


def _largest(trajectory: Trajectory) -> list[np.ndarray]:
    """Return the largest position, velocity and acceleration of each joint, each (n,)."""
    samples = trajectory.samples(2000)
    found = []
    for order in range(3):
        largest = abs(trajectory.at(samples, order)).max(axis=0)
        overall = float(largest.max())
        found.append(np.maximum(largest, STILL * overall if overall > 0 else 1.0))
    return found


def _continuity(arm: Arm, trajectory: Trajectory, largest: list[np.ndarray]) -> Condition:
    """Return whether position, velocity and acceleration go on across breakpoints.

    The jumps of a joint are added up: many small ones lead as far as a large one. Of position in
    rad or m, of its derivatives relative to their largest value.
    """
    worst = Condition(0.0, RELATIVE, 0.0)
    for order in range(3):
        begins, ends = _sides(trajectory, order)
        jumps = abs(begins[1:] - ends[:-1])
        if order:
            jumps = jumps / largest[order]
        total = jumps.sum(axis=0)
        joint = int(total.argmax())
        if -float(total[joint]) < margin_of(worst) or order == 0:
            at = int(jumps[:, joint].argmax()) if len(jumps) else 0
            unit = RELATIVE if order else ("m" if arm.slides[joint] else "rad")
            where = f"{QUANTITIES[order]} of joint {arm.joint_names[joint]}"
            time = float(trajectory.breakpoints[at + 1])
            worst = Condition(0.0 - float(total[joint]), unit, time, where)
    return worst
