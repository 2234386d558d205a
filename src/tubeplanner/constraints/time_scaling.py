"""The shortest duration of a fixed shape.

A shape run `b` times as fast has `b` times the velocity, `b^2` the acceleration and `b^3` the jerk,
and needs the efforts `tau(b) = g + b^2 (tau - g)`, g being gravity's share (Suh & Bishop 1988,
property 2; Hollerbach, "Dynamic scaling of manipulator trajectories", 1984).
"""

from collections.abc import Callable, Sequence

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.constraints.peaks import refined_maximum
from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.trajectory.bernstein import bernstein_coefficients, peak_magnitudes
from tubeplanner.trajectory.joint_trajectory import JointTrajectory, TrajectorySamples

_SAMPLES_PER_PIECE = 24
# Valleys of the factor this near the smallest sample (relative) are refined.
_VALLEY_SHARE = 0.02
# Rounding must not put a trajectory outside a limit it is scaled to meet exactly.
_SAFETY = 1e-8


def scaling_factor(robot: RobotModel, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
    """Return how many times faster the limits allow a trajectory to run at each sample: b(t).

    Args:
        robot: The arm.
        q: Positions, shape (N, n) [rad or m].
        v: Velocities, shape (N, n) [rad/s or m/s].
        a: Accelerations, shape (N, n) [rad/s^2 or m/s^2].

    Returns:
        Shape (N, n), the least of `v_limit / |v|`, `sqrt(a_limit / |a|)` and
        `sqrt((tau_limit - g) / (tau - g))`, the effort limit taken with the sign of `tau - g`; inf
        where nothing limits, 0 where gravity alone needs a motor's whole effort. (Suh & Bishop
        1988, property 2: b_ij; they have no acceleration limits.)
    """
    velocity = _ratio(robot.limits.velocity, abs(v))
    acceleration = np.sqrt(_ratio(robot.limits.acceleration, abs(a)))
    return np.minimum(np.minimum(velocity, acceleration), effort_factor(robot, q, v, a))


def effort_factor(robot: RobotModel, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
    """Return the part of `scaling_factor` that the efforts give, shape (N, n)."""
    tau, gravity = robot.inverse_dynamics(q, v, a), robot.gravity_effort(q)
    return effort_factor_of(robot.limits.effort, tau, gravity)


def effort_factor_of(limit: FloatArray, tau: FloatArray, gravity: FloatArray) -> FloatArray:
    """Return `effort_factor` where efforts, and those against gravity alone, are known."""
    inertial = tau - gravity
    available = np.where(inertial >= 0, limit - gravity, limit + gravity)
    holds = abs(gravity) < limit
    return np.sqrt(_ratio(available, abs(inertial)), out=np.zeros_like(tau), where=holds)


def minimum_duration(
    robot: RobotModel, trajectory: JointTrajectory, *, with_jerk: bool = True
) -> float:
    """Return the shortest duration [s] of a trajectory's shape under all limits of the robot.

    Velocity, acceleration and jerk are exact for all t; effort is the highest of its peaks, found
    from 24 samples per polynomial piece and refined around the highest ones.

    Args:
        robot: The arm.
        trajectory: The shape.
        with_jerk: Whether limits of jerk count; False where the acceleration jumps anyway.

    Raises:
        Infeasible: Status gravity_exceeds_effort.
    """
    polynomial = _polynomial_factor(robot, trajectory, _exact_peaks, with_jerk=with_jerk)
    factor = min(polynomial, _least_effort_factor(robot, trajectory))
    return trajectory.duration / factor * (1 + _SAFETY)


def estimated_duration(robot: RobotModel, trajectory: JointTrajectory) -> float:
    """Return a quick estimate of `minimum_duration` [s], as `estimated_durations`."""
    return float(estimated_durations(robot, [trajectory])[0])


def estimated_durations(robot: RobotModel, shapes: Sequence[JointTrajectory]) -> FloatArray:
    """Return quick estimates of the `minimum_duration` of S shapes, to choose from: (S,) [s].

    Effort is not refined between samples; velocity, acceleration and jerk are bounded from above.

    Raises:
        Infeasible: Status gravity_exceeds_effort.
    """
    parts = [shape.per_piece(_SAMPLES_PER_PIECE // 2) for shape in shapes]
    first = np.cumsum([0, *(len(part.time) for part in parts[:-1])])
    q, v, a = (
        np.concatenate([getattr(part, name) for part in parts])
        for name in ("position", "velocity", "acceleration")
    )
    effort = np.minimum.reduceat(_held_effort_factor(robot, q, v, a), first)
    polynomial = [_polynomial_factor(robot, shape, _hull_peaks) for shape in shapes]
    duration = np.array([shape.duration for shape in shapes])
    return duration / np.minimum(polynomial, effort)


def scaled_to_limits(
    robot: RobotModel, trajectory: JointTrajectory, *, with_jerk: bool = True
) -> JointTrajectory:
    """Return the trajectory's shape, run in its `minimum_duration`.

    Raises:
        Infeasible: Status gravity_exceeds_effort.
    """
    duration = minimum_duration(robot, trajectory, with_jerk=with_jerk)
    return trajectory.scaled(duration / trajectory.duration)


def _polynomial_factor(
    robot: RobotModel,
    trajectory: JointTrajectory,
    peaks: Callable[[FloatArray, FloatArray], FloatArray],
    *,
    with_jerk: bool = True,
) -> float:
    """Return the largest b that velocity, acceleration and jerk limits allow."""
    limits = robot.limits
    factor, asked = np.inf, [(1, limits.velocity), (2, limits.acceleration)]
    if with_jerk:
        asked.append((3, limits.jerk))
    for order, limit in asked:
        bounded = np.isfinite(limit)
        if not bounded.any():
            continue
        coefficients = trajectory.derivative_coefficients(order)[:, :, bounded]
        peak = peaks(coefficients, trajectory.widths)
        factor = min(factor, float(_ratio(limit[bounded], peak).min()) ** (1 / order))
    return factor


def _exact_peaks(coefficients: FloatArray, widths: FloatArray) -> FloatArray:
    """Return the largest magnitudes of piecewise polynomials, shape (n,)."""
    return peak_magnitudes(coefficients, widths).value


def _hull_peaks(coefficients: FloatArray, widths: FloatArray) -> FloatArray:
    """Return upper bounds on the largest magnitudes, from Bernstein coefficients."""
    hull = bernstein_coefficients(coefficients, np.zeros_like(widths), widths)
    return abs(hull).max(axis=(0, 1))


def _least_effort_factor(robot: RobotModel, trajectory: JointTrajectory) -> float:
    """Return the smallest effort factor over time, its valleys refined between samples."""
    samples = trajectory.per_piece(_SAMPLES_PER_PIECE)
    factor = _held_effort_factor(robot, *_state(samples))
    least = float(factor.min())
    if not np.isfinite(least):
        return least

    def negative(time: FloatArray) -> FloatArray:
        return -_held_effort_factor(robot, *_state(trajectory.at(time)))

    highest, _ = refined_maximum(negative, samples.time, -factor, band=_VALLEY_SHARE * least)
    return -highest


def _held_effort_factor(
    robot: RobotModel, q: FloatArray, v: FloatArray, a: FloatArray
) -> FloatArray:
    """Return the smallest effort factor of each sample, (N,), each of which the motors can hold."""
    factor = effort_factor(robot, q, v, a).min(axis=1)
    if (factor == 0).any():
        raise _gravity_exceeds_effort(robot, q[int(factor.argmin())])
    return factor


def _state(samples: TrajectorySamples) -> tuple[FloatArray, FloatArray, FloatArray]:
    return samples.position, samples.velocity, samples.acceleration


def _ratio(available: FloatArray, use: FloatArray) -> FloatArray:
    """Return available / use, inf where nothing is used or nothing limits."""
    available, use = np.broadcast_arrays(available, use)
    return np.divide(
        available, use, out=np.full(use.shape, np.inf), where=(use > 0) & np.isfinite(available)
    )


def _gravity_exceeds_effort(robot: RobotModel, q: FloatArray) -> Infeasible:
    gravity, limit = abs(robot.gravity_effort(q[None])[0]), robot.limits.effort
    joint = int((limit - gravity).argmin())
    name = robot.joint_names[joint]
    unit = "N m" if robot.revolute[joint] else "N"
    return Infeasible(
        PlanStatus.GRAVITY_EXCEEDS_EFFORT,
        f"joint '{name}' needs {gravity[joint]:.2f} {unit} against gravity alone, its effort limit "
        f"is {limit[joint]:.2f}; lighten the payload, choose another configuration or a stronger "
        "motor",
        Place(joint=name).at(robot.tool_position(q[None])[0]),
    )
