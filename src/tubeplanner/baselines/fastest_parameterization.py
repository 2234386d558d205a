"""How fast motors that switch instantly can run a path: bang-bang control.

Solved by TOPP-RA (Pham & Pham, "A new approach to time-optimal path parameterization based on
reachability analysis", IEEE T-RO 34(3), 2018); first by Bobrow et al. and Shin & McKay (1985).

A path is stored as the trajectory that runs it at unit speed: its times are the arc length in joint
space.
"""

from collections.abc import Callable

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.baselines.time_parameterization import run_along
from tubeplanner.constraints.path_samples import PathSamples
from tubeplanner.constraints.point_speed import PointSpeedLimit
from tubeplanner.constraints.speed_limit import SpeedLimit
from tubeplanner.constraints.speed_limits import largest_speeds, speed_limits
from tubeplanner.constraints.time_scaling import estimated_duration
from tubeplanner.constraints.tool_speed import ToolSpeed
from tubeplanner.constraints.velocity_by_position import VelocityByPositionLimit
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

# In place of a missing limit: this multiple of what a gentle run of the path uses.
_AMPLE, _SAMPLES_PER_PIECE = 1e3, 20
_INSIDE = 1e-4  # [m]: how far outside a capsule a point of the path still counts as in it
_FASTEST = 1e9  # [1/s]: where the tool stands still, its speed limits nothing


def fastest_parameterization(
    problem: PlanningProblem,
    path: JointTrajectory,
    arc_length: FloatArray,
    *,
    at_both_ends: bool = True,
) -> JointTrajectory | None:
    """Return a path's fastest time parameterization: arc length over time, from rest to rest.

    It keeps the limits of velocities, acceleration, effort and tool speed at points of the path and
    may exceed them in between; jerk is unlimited, so it is not smooth. Where the tool is in several
    segments, the loosest of their limits on its speed counts.

    Args:
        problem: The planning problem.
        path: Over the arc length, in the robot's group order.
        arc_length: Where the limits are judged, increasing from the path's start to its end, shape
            (N,).
        at_both_ends: Whether every step keeps the effort limits where it ends, too, not only where
            it begins. The time parameterization is up to 1 % slower then, but keeps them in
            between: what is left is worth less than 0.1 % of the time, rather than up to 19 % (two
            links round an arc).

    Returns:
        The arc length over time, N-1 parabolas; None if the solver finds none.

    Raises:
        Infeasible: Status gravity_exceeds_effort.
    """
    from toppra import algorithm  # takes a second

    constraints = _constraints(problem, path, at_both_ends)
    solver = algorithm.TOPPRA(
        constraints, _Path(path), gridpoints=arc_length, solver_wrapper="seidel"
    )
    _, speed, _ = solver.compute_parameterization(0.0, 0.0)
    if speed is None or not np.isfinite(speed).all() or (speed[1:] + speed[:-1] == 0).any():
        return None
    # At constant acceleration between two points, the mean speed is the mean of both.
    step = np.diff(arc_length)
    durations = 2 * step / (speed[1:] + speed[:-1])
    parabolas = np.array([(speed[1:] - speed[:-1]) / (2 * durations), speed[:-1], arc_length[:-1]])
    times = np.concatenate([[0.0], np.cumsum(durations)])
    return JointTrajectory(("arc_length",), times, parabolas[:, :, None])


def _constraints(
    problem: PlanningProblem, path: JointTrajectory, at_both_ends: bool
) -> list[object]:
    from toppra import constraint

    robot, kinds = problem.robot, constraint.DiscretizationType
    trial = _gentle_run(path)
    trial = trial.scaled(estimated_duration(problem, trial) / trial.duration)
    used = trial.per_piece(_SAMPLES_PER_PIECE)
    tau = robot.inverse_dynamics(used.position, used.velocity, used.acceleration)
    limits = robot.limits
    effort = _finite(limits.effort, tau)
    velocity = _finite(limits.velocity, used.velocity)
    return [
        constraint.JointVelocityConstraintVarying(_velocity_bounds(problem, path, velocity))
        if _further_limits(problem)
        else constraint.JointVelocityConstraint(velocity),
        constraint.JointAccelerationConstraint(_finite(limits.acceleration, used.acceleration)),
        constraint.JointTorqueConstraint(
            lambda q, v, a: robot.inverse_dynamics(q[None], v[None], a[None])[0],
            np.column_stack([-effort, effort]),
            np.zeros(robot.joint_count),
            kinds.Interpolation if at_both_ends else kinds.Collocation,
        ),
    ]


def _velocity_bounds(
    problem: PlanningProblem, path: JointTrajectory, velocity: FloatArray
) -> Callable[[float], FloatArray]:
    """Return a function from an arc length to bounds on the joints' velocities there, (n, 2).

    Their own, (n,), and those that they have at the largest speed that further limits allow.
    """
    limits, in_segment = _further_limits(problem), ToolSpeed(problem).limit

    def bounds(arc_length: float) -> FloatArray:
        s = np.array([arc_length])
        q, slope = path.position(s), path.velocity(s)

        def loosest() -> IntArray:
            inside = problem.tube.margin(at.tool_pose[1])[0]
            counts = inside >= min(-_INSIDE, inside.max())
            return np.array([np.where(counts, in_segment, -np.inf).argmax()])

        at = PathSamples(problem, np.stack([q, slope, np.zeros_like(q)]), loosest)
        rate = min(float(largest_speeds(at, limits)[0]), _FASTEST)
        most = np.minimum(velocity, abs(slope[0]) * rate)
        return np.column_stack([-most, most])

    return bounds


def _further_limits(problem: PlanningProblem) -> tuple[SpeedLimit, ...]:
    """Return the limits on velocities that change along a path."""
    kinds = ToolSpeed, PointSpeedLimit, VelocityByPositionLimit
    return tuple(limit for limit in speed_limits(problem) if isinstance(limit, kinds))


def _gentle_run(path: JointTrajectory) -> JointTrajectory:
    """Return the trajectory that runs a path from rest to rest by the smoothstep 3 u^2 - 2 u^3."""
    rows = path.duration * np.array([-2.0, 3.0, 0.0, 0.0])
    return run_along(path, JointTrajectory(("arc_length",), [0.0, 1.0], rows[:, None, None]))


def _finite(limit: FloatArray, used: FloatArray) -> FloatArray:
    """Return limits (n,); missing ones become ample for the values used, (N, n)."""
    most = np.maximum(abs(used).max(axis=0), 1e-6)
    return np.where(np.isfinite(limit), limit, _AMPLE * most)


class _Path:
    """A path with the interface that TOPP-RA requires."""

    waypoints = None

    def __init__(self, path: JointTrajectory) -> None:
        self._path = path
        self.dof = len(path.joint_names)
        self.path_interval = np.array([0.0, path.duration])

    def __call__(self, arc_length: FloatArray, order: int = 0) -> FloatArray:
        derivatives = (self._path.position, self._path.velocity, self._path.acceleration)
        return derivatives[order](arc_length)

    def eval(self, arc_length: FloatArray) -> FloatArray:
        return self(arc_length, 0)

    def evald(self, arc_length: FloatArray) -> FloatArray:
        return self(arc_length, 1)

    def evaldd(self, arc_length: FloatArray) -> FloatArray:
        return self(arc_length, 2)
