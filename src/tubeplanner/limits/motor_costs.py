"""Motor costs of a motion: efforts, heat, work, effort variation."""

from functools import cached_property

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.robot.model import RobotModel
from tubeplanner.trajectory.joint_trajectory import JointTrajectory, TrajectorySamples
from tubeplanner.trajectory.parts import STILL_FRACTION, monotone_intervals


def motor_effort(
    robot: RobotModel, trajectory: JointTrajectory, samples: TrajectorySamples
) -> FloatArray:
    """Return the efforts of the motors, friction included, shape (N, n) [N m or N].

    Args:
        robot: The arm.
        trajectory: Of its joints, in their order.
        samples: Of the trajectory.
    """
    smooth = robot.inverse_dynamics(samples.position, samples.velocity, samples.acceleration)
    return smooth + coulomb_effort(robot, trajectory, samples)


def coulomb_effort(
    robot: RobotModel, trajectory: JointTrajectory, samples: TrajectorySamples
) -> FloatArray:
    """Return the efforts of the motors against Coulomb friction, shape (N, n) [N m or N].

    Arguments as of `motor_effort`. Where a joint reverses, friction is of the direction that it
    takes; at the goal, of its approach.
    """
    velocity = samples.velocity
    if not robot.motors.has_coulomb_friction:
        return np.zeros_like(velocity)
    starts, widths = trajectory.breakpoints, trajectory.widths
    piece = np.searchsorted(starts[1:-1], samples.time, side="right")
    fraction = (samples.time - starts[piece]) / widths[piece]
    beside = monotone_intervals(trajectory).at(piece, fraction)
    moves = abs(velocity) > STILL_FRACTION * abs(velocity).max()
    return robot.motors.coulomb_effort(np.where(moves, velocity, beside))


_SAMPLES_PER_PIECE = 41


class EffortCosts:
    """Heat and mechanical work of one motion in any duration, from 41 samples per piece."""

    def __init__(self, robot: RobotModel, trajectory: JointTrajectory) -> None:
        """Take the motion of an arm's joints, in their order."""
        self._robot, self._trajectory = robot, trajectory
        self._samples = trajectory.per_piece(_SAMPLES_PER_PIECE)

    def energy(self, weights: FloatArray, duration: float | None = None) -> float:
        """Return the integral of the weighted squared efforts, summed over the joints.

        Args:
            weights: Of the squared efforts, shape (n,).
            duration: Of the motion [s]; None: its own.

        Returns:
            In the weights' unit, times (N m)^2 s or N^2 s.
        """
        slower = self._slower(duration)
        return self._integral(self._effort(slower) ** 2 @ weights) * slower

    def work(self, duration: float | None = None) -> float:
        """Return the integral of the joints' positive power, summed over the joints [J].

        Braking recovers no energy.

        Args:
            duration: Of the motion [s]; None: its own.
        """
        power = self._effort(self._slower(duration)) * self._samples.velocity
        return self._integral(np.maximum(power, 0.0).sum(axis=1))

    def _slower(self, duration: float | None) -> float:
        return 1.0 if duration is None else duration / self._trajectory.duration

    def _effort(self, slower: float) -> FloatArray:
        static, viscous, inertial = self._efforts
        return static + viscous / slower + inertial / slower**2

    @cached_property
    def _efforts(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Efforts against gravity and Coulomb friction, viscous friction, and all inertia."""
        at, robot = self._samples, self._robot
        gravity = robot.gravity_effort(at.position)
        viscous = robot.motors.viscous_friction * at.velocity
        smooth = robot.inverse_dynamics(at.position, at.velocity, at.acceleration)
        static = gravity + coulomb_effort(robot, self._trajectory, at)
        return static, viscous, smooth - viscous - gravity

    def _integral(self, values: FloatArray) -> float:
        return float(np.trapezoid(values, self._samples.time))


_VARIATION_SAMPLES = 20


def effort_variation(
    robot: RobotModel, trajectory: JointTrajectory, beside: JointTrajectory | None = None
) -> FloatArray:
    """Return the total variation of each joint's effort, the sum of its ups and downs, shape (n,).

    From 20 samples per polynomial piece. Coulomb friction is left out: no motion spares the joints
    its jumps where they reverse. The efforts of start and end count, but not the hold before and
    after.

    Args:
        robot: The arm.
        trajectory: Of its joints, in their order.
        beside: The motion that it is compared with; None: itself.

    Returns:
        In effort limits; of joints without an effort limit, in their largest efforts of the motion
        compared with.
    """
    effort = _efforts(robot, trajectory)
    most = abs(effort if beside is None else _efforts(robot, beside)).max(axis=0)
    limit = robot.limits.effort
    nominal = np.where(np.isfinite(limit), limit, np.maximum(most, np.finfo(float).tiny))
    variation: FloatArray = abs(np.diff(effort, axis=0)).sum(axis=0) / nominal
    return variation


def _efforts(robot: RobotModel, trajectory: JointTrajectory) -> FloatArray:
    samples = trajectory.per_piece(_VARIATION_SAMPLES)
    return robot.inverse_dynamics(samples.position, samples.velocity, samples.acceleration)
