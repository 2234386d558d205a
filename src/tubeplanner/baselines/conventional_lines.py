"""The conventional scheme: straight lines of the tool at trapezoidal speed, a stop at every corner.

The tool speeds up at constant acceleration, cruises, and slows down at the same rate, on every line
of the reference path (Suh & Bishop 1988, their standard of comparison).
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from tubeplanner.arrays import FloatArray
from tubeplanner.baselines.tool_path import ToolPath, arc_lengths_on_line
from tubeplanner.constraints.time_scaling import minimum_duration
from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.trajectory.joint_trajectory import JointTrajectory, concatenate

PAPER_SPEED, PAPER_ACCELERATION = 0.75, 1.2  # [m/s], [m/s^2]
_TOLERANCE = 2e-6  # [m] between the tool and where it should be at that time
_MIN_NODES, _MAX_NODES = 16, 2048  # per phase of constant acceleration
# Shares of the longest line for speeding up and slowing down: the fastest is taken.
_RAMP_SHARES = np.geomspace(1.0, 0.02, 12)
# A tool that moves less per joint-space arc length [m/rad] stands still: the arm is singular there.
_MIN_GAIN = 1e-3


@dataclass(frozen=True)
class TrapezoidalSpeed:
    """How fast the tool runs its lines.

    Attributes:
        speed: The fastest [m/s].
        acceleration: While speeding up, and while slowing down [m/s^2].
    """

    speed: float
    acceleration: float

    def duration(self, distance: float) -> float:
        """Return how long a line of a length [m] takes, from stop to stop [s]."""
        if distance >= self.speed**2 / self.acceleration:
            return distance / self.speed + self.speed / self.acceleration
        return 2 * float(np.sqrt(distance / self.acceleration))

    def timing(self, distance: float) -> JointTrajectory:
        """Return the tool's arc length over time on a line of a length [m]: 2 or 3 parabolas."""
        ramp = min(self.speed**2 / self.acceleration, distance) / 2  # the arc length of one
        top = np.sqrt(2 * ramp * self.acceleration)
        cruise = (distance - 2 * ramp) / top
        half = self.acceleration / 2
        parabolas = [(half, 0.0, 0.0), (0.0, top, ramp), (-half, top, distance - ramp)]
        durations = [top / self.acceleration, cruise, top / self.acceleration]
        if cruise <= _TOLERANCE * self.duration(distance):
            del parabolas[1], durations[1]
        times = np.concatenate([[0.0], np.cumsum(durations)])
        return JointTrajectory(("tool",), times, np.array(parabolas).T[:, :, None])


PAPER = TrapezoidalSpeed(PAPER_SPEED, PAPER_ACCELERATION)


def largest_trapezoidal_speed(problem: PlanningProblem, lines: list[ToolPath]) -> TrapezoidalSpeed:
    """Return the speed and acceleration, the same for all lines, that take the least time.

    Under the limits of velocity, acceleration and effort; limits of jerk are left out, since the
    acceleration jumps.

    Args:
        problem: The planning problem.
        lines: From stop to stop.

    Raises:
        Infeasible: Gravity exceeds a motor's effort, or the scheme cannot run a line.
    """
    longest = max(line.curve.length for line in lines)
    found = [_scaled_speed(problem, lines, share * longest) for share in _RAMP_SHARES]
    return min(found, key=lambda speed: sum(speed.duration(line.curve.length) for line in lines))


def conventional_trajectory(
    robot: RobotModel, lines: list[ToolPath], speed: TrapezoidalSpeed
) -> JointTrajectory:
    """Return the trajectory that runs lines at trapezoidal speed and stops between them.

    Cubic splines over time, C2 while the acceleration of the tool is constant; the tool is within
    2e-6 m of where it should be at any time.

    Raises:
        Infeasible: Status no_trajectory: the joints cannot follow the tool.
    """
    return concatenate([_run(robot, line, speed.timing(line.curve.length)) for line in lines])


def _scaled_speed(
    problem: PlanningProblem, lines: list[ToolPath], ramps: float
) -> TrapezoidalSpeed:
    """Return the largest speed whose ramps take a given length of the line [m]."""
    shape = TrapezoidalSpeed(float(np.sqrt(ramps)), 1.0)
    trajectory = conventional_trajectory(problem.robot, lines, shape)
    faster = trajectory.duration / minimum_duration(problem, trajectory, with_jerk=False)
    return TrapezoidalSpeed(faster * shape.speed, faster**2)


def _run(robot: RobotModel, line: ToolPath, timing: JointTrajectory) -> JointTrajectory:
    """Return the trajectory along one line, in phases of constant acceleration."""
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
                    Place(segment=line.segment),
                )
            phase = _phase(robot, line, timing, np.linspace(begin, end, nodes + 1))
            off = _off(robot, line, timing, phase, begin)
            nodes *= 2
        phases.append(phase)
    return concatenate(phases)


def _phase(
    robot: RobotModel, line: ToolPath, timing: JointTrajectory, times: FloatArray
) -> JointTrajectory:
    """Return a cubic spline through the configurations at times (N,), its own time from zero."""
    arc_length = arc_lengths_on_line(robot, line, timing.position(times)[:, 0])
    q, slope = line.joints.position(arc_length), line.joints.velocity(arc_length)[[0, -1]]
    jacobian = robot.tool_jacobian(q[[0, -1]])[1][:, :3]
    gain = np.einsum("nij,nj,i->n", jacobian, slope, line.curve.direction[0])
    speed = timing.velocity(times[[0, -1]])[:, 0]
    # Where the arm is singular, joints need not stop with the tool: their speed is the spline's.
    ends = [
        (1, a * v / g) if g > _MIN_GAIN else "not-a-knot"
        for a, v, g in zip(slope, speed, gain, strict=True)
    ]
    spline = CubicSpline(times - times[0], q, bc_type=tuple(ends))
    return JointTrajectory(robot.joint_names, spline.x, spline.c)


def _off(
    robot: RobotModel,
    line: ToolPath,
    timing: JointTrajectory,
    phase: JointTrajectory,
    begin: float,
) -> float:
    """Return how far from its place a phase has the tool between the spline's points [m]."""
    times = (phase.breakpoints[:-1] + phase.breakpoints[1:]) / 2
    wanted = line.curve.point(timing.position(begin + times)[:, 0])
    tool = robot.tool_position(phase.position(times))
    return float(np.linalg.norm(tool - wanted, axis=1).max())
