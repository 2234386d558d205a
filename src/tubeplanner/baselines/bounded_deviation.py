"""Taylor's bounded deviation: lines in joint space whose tool stays near the lines of the tool.

Knots are added at the middle of the tool's arc length between two knots until the joint line
between them deviates by no more than the tolerance; the arm runs from knot to knot at constant
joint velocities, with a transition of constant acceleration around each of them. (Taylor, "Planning
and execution of straight line manipulator trajectories", IBM J. Research and Development 23(4),
1979.)
"""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.baselines.tool_path import ToolPath, arc_lengths_on_line
from tubeplanner.constraints.time_scaling import scaled_to_limits, scaling_factor
from tubeplanner.constraints.tube_membership import first_departure
from tubeplanner.outcome import MARGIN_TOLERANCE, Infeasible, Place, PlanStatus
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

_MAX_ROUNDS = 10  # of adding knots
_PROBES = np.linspace(0.0, 1.0, 9)[1:-1]  # of every joint line
# How much of the shorter neighbour the half of a transition takes: the fastest is kept.
_TRANSITION_SHARES = (0.49, 0.4, 0.3, 0.2, 0.1)
# Rounds in which every interval is shortened as far as its own limits allow.
_TIMING_ROUNDS, _TIMING_POWER, _SAMPLES_PER_PIECE = 40, 0.5, 8


@dataclass(frozen=True, eq=False)
class BoundedDeviation:
    """A trajectory by Taylor's scheme.

    Attributes:
        trajectory: Parabolas and lines, C1, at all limits except jerk.
        knots: Number of knots.
    """

    trajectory: JointTrajectory
    knots: int


def bounded_deviation(problem: PlanningProblem, lines: list[ToolPath]) -> BoundedDeviation:
    """Return the fastest trajectory by Taylor's scheme that stays in the tube, or else the fastest.

    His time for an interval comes from velocity limits alone; here each interval lasts as long as
    the limits of effort, velocity and acceleration require around it.

    Args:
        problem: The planning problem; its radii are the tolerances.
        lines: The arm along the tool's lines, one for every segment in which it moves.

    Raises:
        Infeasible: Gravity exceeds a motor's effort, or knots do not end the deviation.
    """
    robot, tube = problem.robot, problem.tube
    parts = [lines[0].joints.position(0.0)[None]]
    for line in lines:
        radius = float(tube.effective_radius[tube.segment_index(line.segment)])
        parts.append(_knots(robot, line, radius)[1:])
    knots = np.concatenate(parts)
    found = [_fastest(problem, knots, share) for share in _TRANSITION_SHARES]
    inside = [
        trajectory
        for trajectory in found
        if first_departure(problem, trajectory, MARGIN_TOLERANCE) is None
    ]
    fastest = min(inside or found, key=lambda trajectory: trajectory.duration)
    return BoundedDeviation(fastest, len(knots))


def _knots(robot: RobotModel, line: ToolPath, tolerance: float) -> FloatArray:
    """Return configurations (K, n) on a line of the tool whose joint lines stay near it."""
    distances = np.array([0.0, line.curve.length])
    for _ in range(_MAX_ROUNDS):
        knots = line.joints.position(arc_lengths_on_line(robot, line, distances))
        off = np.flatnonzero(_deviation(robot, line, knots) > tolerance)
        if len(off) == 0:
            return knots
        middle = (distances[off] + distances[off + 1]) / 2
        distances = np.insert(distances, off + 1, middle)
    raise Infeasible(
        PlanStatus.NO_TRAJECTORY,
        f"segment {line.segment}: joint lines between {len(knots)} knots still leave the tool's "
        f"line by more than {tolerance:g} m: a singular configuration is in the way; move the "
        "reference points",
        Place(segment=line.segment),
    )


def _deviation(robot: RobotModel, line: ToolPath, knots: FloatArray) -> FloatArray:
    """Return how far the tool deviates from its line on joint lines, shape (K-1,) [m]."""
    steps = np.diff(knots, axis=0)
    probes = knots[:-1, None] + _PROBES[:, None] * steps[:, None]
    offset = robot.tool_position(probes.reshape(-1, knots.shape[1])) - line.curve.start[0]
    direction = line.curve.direction[0]
    arc_length = np.clip(offset @ direction, 0.0, line.curve.length)
    off = np.linalg.norm(offset - arc_length[:, None] * direction, axis=1)
    return off.reshape(len(steps), -1).max(axis=1)


def _fastest(problem: PlanningProblem, knots: FloatArray, share: float) -> JointTrajectory:
    """Return the fastest trajectory that the timing rounds find, scaled to the limits."""
    names, times = problem.robot.joint_names, np.linalg.norm(np.diff(knots, axis=0), axis=1)
    best, shortest = times, np.inf
    for _ in range(_TIMING_ROUNDS):
        trajectory = _trajectory(names, knots, times, share)
        speed_factor = _speed_factor(problem, trajectory, len(times))
        if (speed_factor == 0).any():  # scaling to the limits says why
            break
        if times.sum() / speed_factor.min() < shortest:
            best, shortest = times / speed_factor.min(), times.sum() / speed_factor.min()
        times = times / speed_factor**_TIMING_POWER
    trajectory = _trajectory(names, knots, best, share)
    return scaled_to_limits(problem, trajectory, with_jerk=False)


def _speed_factor(
    problem: PlanningProblem, trajectory: JointTrajectory, intervals: int
) -> FloatArray:
    """Return how many times faster the limits allow each interval to be run, shape (K-1,)."""
    samples = trajectory.per_piece(_SAMPLES_PER_PIECE)
    factor = scaling_factor(problem, samples.position, samples.velocity, samples.acceleration)
    pieces = factor.reshape(-1, _SAMPLES_PER_PIECE).min(axis=1)
    # Pieces alternate: a transition, the line after it, the next transition.
    return np.minimum(np.minimum(pieces[:-2:2], pieces[1:-1:2]), pieces[2::2])


def _trajectory(
    joint_names: tuple[str, ...], knots: FloatArray, times: FloatArray, share: float
) -> JointTrajectory:
    """Return the trajectory that takes times (K-1,) [s] from knot to knot (K, n)."""
    still = np.zeros((1, knots.shape[1]))
    velocity = np.concatenate([still, np.diff(knots, axis=0) / times[:, None], still])
    before, after = np.append(np.inf, times), np.append(times, np.inf)
    half = share * np.minimum(before, after)  # of the transitions
    acceleration = np.zeros((2 * len(knots) - 1, knots.shape[1]))
    acceleration[::2] = np.diff(velocity, axis=0) / (2 * half[:, None])
    begin_velocity = np.empty_like(acceleration)
    begin_velocity[::2], begin_velocity[1::2] = velocity[:-1], velocity[1:-1]
    widths = np.empty(len(acceleration))
    widths[::2], widths[1::2] = 2 * half, times - half[:-1] - half[1:]
    steps = begin_velocity * widths[:, None] + acceleration * widths[:, None] ** 2 / 2
    position = knots[0] + np.concatenate([still, np.cumsum(steps[:-1], axis=0)])
    breakpoints = np.concatenate([[0.0], np.cumsum(widths)])
    rows = np.array([acceleration / 2, begin_velocity, position])
    return JointTrajectory(joint_names, breakpoints, rows)
