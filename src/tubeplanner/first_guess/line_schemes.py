"""Baselines: tool lines at trapezoidal speed; Taylor's bounded deviation in joint space."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from tubeplanner.arrays import FloatArray
from tubeplanner.first_guess.tool_paths import ToolPath, arc_lengths_on_line
from tubeplanner.limits.speed_limits import minimum_duration, scaled_to_limits, scaling_factor
from tubeplanner.limits.tube_membership import first_departure
from tubeplanner.outcome import MARGIN_TOLERANCE, Infeasible, Location, PlanStatus
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory, concatenate

# ---- The conventional scheme: the tool's lines at trapezoidal speed, a stop at every corner.
#
# The tool speeds up at constant acceleration, cruises, and slows down at the same rate, on every
# line of the reference path (Suh & Bishop 1988, their standard of comparison).

_TOLERANCE = 2e-6  # [m] between the tool and its position by the timing
_MIN_NODES, _MAX_NODES = 16, 2048  # per phase of constant acceleration
# Fractions of the longest line for speeding up and slowing down: the fastest counts.
_RAMP_FRACTIONS = np.geomspace(1.0, 0.02, 12)
# A tool that moves less per joint-space arc length [m/rad] stands still: the arm is singular there.
_MIN_GAIN = 1e-3


@dataclass(frozen=True)
class TrapezoidalSpeed:
    """Trapezoidal speed of the tool on its lines."""

    speed: float  # while cruising [m/s]
    acceleration: float  # while speeding up, and while slowing down [m/s^2]

    def duration(self, distance: float) -> float:
        """Return the duration of a line of a length [m], from stop to stop [s]."""
        if distance >= self.speed**2 / self.acceleration:
            return distance / self.speed + self.speed / self.acceleration
        return 2 * float(np.sqrt(distance / self.acceleration))

    def timing(self, distance: float) -> JointTrajectory:
        """Return the tool's arc length over time on a line of a length [m]: 2 or 3 parabolas."""
        ramp = min(self.speed**2 / self.acceleration, distance) / 2  # arc length of a ramp
        top = np.sqrt(2 * ramp * self.acceleration)
        cruise = (distance - 2 * ramp) / top
        half = self.acceleration / 2
        parabolas = [(half, 0.0, 0.0), (0.0, top, ramp), (-half, top, distance - ramp)]
        durations = [top / self.acceleration, cruise, top / self.acceleration]
        if cruise <= _TOLERANCE * self.duration(distance):
            del parabolas[1], durations[1]
        times = np.concatenate([[0.0], np.cumsum(durations)])
        return JointTrajectory(("tool",), times, np.array(parabolas).T[:, :, None])


PAPER = TrapezoidalSpeed(speed=0.75, acceleration=1.2)


def largest_trapezoidal_speed(problem: PlanningProblem, lines: list[ToolPath]) -> TrapezoidalSpeed:
    """Return the trapezoidal speed, the same for all lines, with the least total duration.

    It keeps the limits of velocity, acceleration and effort. Limits of jerk are left out, since the
    acceleration jumps.

    Raises:
        Infeasible: Gravity exceeds a motor's effort, or the scheme cannot run a line.
    """
    longest = max(line.curve.length for line in lines)
    speeds = []
    for ratio in _RAMP_FRACTIONS:
        shape = TrapezoidalSpeed(float(np.sqrt(ratio * longest)), 1.0)
        trajectory = conventional_trajectory(problem.robot, lines, shape)
        faster = trajectory.duration / minimum_duration(problem, trajectory, with_jerk=False)
        speeds.append(TrapezoidalSpeed(faster * shape.speed, faster**2))
    return min(speeds, key=lambda speed: sum(speed.duration(line.curve.length) for line in lines))


def conventional_trajectory(
    robot: RobotModel, lines: list[ToolPath], speed: TrapezoidalSpeed
) -> JointTrajectory:
    """Return the trajectory along lines at trapezoidal speed, with stops between lines.

    Cubic splines over time, C2 while the acceleration of the tool is constant. Midway between the
    splines' points the tool is within 2e-6 m of its position by the timing.

    Raises:
        Infeasible: Status no_trajectory: the joints cannot follow the tool.
    """
    return concatenate([_run(robot, line, speed.timing(line.curve.length)) for line in lines])


def _run(robot: RobotModel, line: ToolPath, timing: JointTrajectory) -> JointTrajectory:
    """Return the trajectory along a line, in phases of constant acceleration."""
    phases = []
    for begin, end in zip(timing.breakpoints[:-1], timing.breakpoints[1:], strict=True):
        nodes, off = _MIN_NODES, np.inf
        while off > _TOLERANCE:
            if nodes > _MAX_NODES:
                raise Infeasible(
                    PlanStatus.NO_TRAJECTORY,
                    f"segment {line.segment}: at trapezoidal speed, a spline of {_MAX_NODES} "
                    f"pieces leaves the tool's place by {off:.3g} m: a singular configuration is "
                    "in the way; move the reference points",
                    Location(segment=line.segment),
                )
            phase = _phase(robot, line, timing, np.linspace(begin, end, nodes + 1))
            between = (phase.breakpoints[:-1] + phase.breakpoints[1:]) / 2
            target = line.curve.point(timing.position(begin + between)[:, 0])
            tool = robot.tool_position(phase.position(between))
            off = float(np.linalg.norm(tool - target, axis=1).max())
            nodes *= 2
        phases.append(phase)
    return concatenate(phases)


def _phase(
    robot: RobotModel, line: ToolPath, timing: JointTrajectory, times: FloatArray
) -> JointTrajectory:
    """Return a cubic spline through the configurations at times (N,) [s], its time from zero."""
    arc_length = arc_lengths_on_line(robot, line, timing.position(times)[:, 0])
    q, slope = line.joints.position(arc_length), line.joints.velocity(arc_length)[[0, -1]]
    jacobian = robot.tool_jacobian(q[[0, -1]])[1][:, :3]
    gain = np.einsum("nij,nj,i->n", jacobian, slope, line.curve.direction[0])
    speed = timing.velocity(times[[0, -1]])[:, 0]
    # Where the arm is singular, joints need not stop with the tool: the spline gives their speed.
    ends = [
        (1, a * v / g) if g > _MIN_GAIN else "not-a-knot"
        for a, v, g in zip(slope, speed, gain, strict=True)
    ]
    spline = CubicSpline(times - times[0], q, bc_type=tuple(ends))
    return JointTrajectory(robot.joint_names, spline.x, spline.c)


# ---- Taylor's bounded deviation: lines in joint space whose tool stays near the lines of the tool.
#
# Knots are added at the middle of the tool's arc length between two knots until the joint line
# between them deviates by no more than the tolerance; the arm runs from knot to knot at constant
# joint velocities, with a transition of constant acceleration around each of them. (Taylor,
# "Planning and execution of straight line manipulator trajectories", IBM J. Research and
# Development 23(4), 1979.)

_MAX_ROUNDS = 10  # of adding knots
_PROBES = np.linspace(0.0, 1.0, 9)[1:-1]  # of every joint line
# Half of a transition as a fraction of the shorter neighbour: the fastest counts.
_TRANSITION_FRACTIONS = (0.49, 0.4, 0.3, 0.2, 0.1)
# Rounds in which every interval is shortened as far as its own limits allow.
_TIMING_ROUNDS, _TIMING_POWER, _SAMPLES_PER_PIECE = 40, 0.5, 8


def bounded_deviation(
    problem: PlanningProblem, lines: list[ToolPath]
) -> tuple[JointTrajectory, int]:
    """Return the fastest trajectory by Taylor's scheme, and its number of knots.

    It is one in the tube if there is any: parabolas and lines, C1, at all limits except jerk.

    His time for an interval comes from velocity limits alone; here each interval lasts as long as
    the limits of effort, velocity and acceleration require around it. The radii of the problem are
    the tolerances.

    Raises:
        Infeasible: Gravity exceeds a motor's effort, or knots do not end the deviation.
    """
    robot, tube = problem.robot, problem.tube
    parts = [lines[0].joints.position(0.0)[None]]
    for line in lines:
        radius = float(tube.effective_radius[tube.segment_index(line.segment)])
        parts.append(_knots(robot, line, radius)[1:])
    knots = np.concatenate(parts)
    trajectories = [_fastest(problem, knots, ratio) for ratio in _TRANSITION_FRACTIONS]
    inside = [
        each for each in trajectories if first_departure(problem, each, MARGIN_TOLERANCE) is None
    ]
    fastest = min(inside or trajectories, key=lambda trajectory: trajectory.duration)
    return fastest, len(knots)


def _knots(robot: RobotModel, line: ToolPath, tolerance: float) -> FloatArray:
    """Return knots (K, n) on a line of the tool with joint lines near that line."""
    distances, direction = np.array([0.0, line.curve.length]), line.curve.direction[0]
    for _ in range(_MAX_ROUNDS):
        knots = line.joints.position(arc_lengths_on_line(robot, line, distances))
        steps = np.diff(knots, axis=0)
        probes = knots[:-1, None] + _PROBES[:, None] * steps[:, None]
        offset = robot.tool_position(probes.reshape(-1, knots.shape[1])) - line.curve.start[0]
        arc_length = np.clip(offset @ direction, 0.0, line.curve.length)
        deviation = np.linalg.norm(offset - arc_length[:, None] * direction, axis=1)
        off = np.flatnonzero(deviation.reshape(len(steps), -1).max(axis=1) > tolerance)
        if len(off) == 0:
            return knots
        middle = (distances[off] + distances[off + 1]) / 2
        distances = np.insert(distances, off + 1, middle)
    raise Infeasible(
        PlanStatus.NO_TRAJECTORY,
        f"segment {line.segment}: joint lines between {len(knots)} knots still leave the tool's "
        f"line by more than {tolerance:g} m: a singular configuration is in the way; move the "
        "reference points",
        Location(segment=line.segment),
    )


def _fastest(problem: PlanningProblem, knots: FloatArray, fraction: float) -> JointTrajectory:
    """Return the fastest trajectory of all timing rounds, scaled to the limits."""
    names, times = problem.robot.joint_names, np.linalg.norm(np.diff(knots, axis=0), axis=1)
    best, shortest = times, np.inf
    for _ in range(_TIMING_ROUNDS):
        trajectory = _trajectory(names, knots, times, fraction)
        samples = trajectory.per_piece(_SAMPLES_PER_PIECE)
        factor = scaling_factor(problem, samples.position, samples.velocity, samples.acceleration)
        pieces = factor.reshape(-1, _SAMPLES_PER_PIECE).min(axis=1)
        # Pieces alternate: a transition, the line after it, the next transition.
        speed_factor = np.minimum(np.minimum(pieces[:-2:2], pieces[1:-1:2]), pieces[2::2])
        if (speed_factor == 0).any():  # scaling to the limits says why
            break
        if times.sum() / speed_factor.min() < shortest:
            best, shortest = times / speed_factor.min(), times.sum() / speed_factor.min()
        times = times / speed_factor**_TIMING_POWER
    trajectory = _trajectory(names, knots, best, fraction)
    return scaled_to_limits(problem, trajectory, with_jerk=False)


def _trajectory(
    joint_names: tuple[str, ...], knots: FloatArray, times: FloatArray, fraction: float
) -> JointTrajectory:
    """Return the trajectory from knot to knot (K, n) in times (K-1,) [s]."""
    still = np.zeros((1, knots.shape[1]))
    velocity = np.concatenate([still, np.diff(knots, axis=0) / times[:, None], still])
    before, after = np.append(np.inf, times), np.append(times, np.inf)
    half = fraction * np.minimum(before, after)  # duration of half of each transition
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
