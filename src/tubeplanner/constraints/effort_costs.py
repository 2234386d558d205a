"""What a motion takes from its motors, in any duration: heat, and mechanical work."""

from functools import cached_property

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.constraints.motor_effort import coulomb_effort
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

_SAMPLES_PER_PIECE = 41


class EffortCosts:
    """The costs of one motion, from 41 samples of each of its polynomial pieces."""

    def __init__(self, robot: RobotModel, trajectory: JointTrajectory) -> None:
        """Take the motion of an arm's joints, in their order."""
        self._robot, self._trajectory = robot, trajectory
        self._samples = trajectory.per_piece(_SAMPLES_PER_PIECE)

    def energy(self, weights: FloatArray, duration: float | None = None) -> float:
        """Return the integral of the weighted squared efforts, summed over the joints.

        Args:
            weights: Of the squared efforts, shape (n,).
            duration: In which the motion is run [s]; None: its own.

        Returns:
            In the weights' unit, times (N m)^2 s or N^2 s.
        """
        slower = self._slower(duration)
        return self._integral(self._effort(slower) ** 2 @ weights) * slower

    def work(self, duration: float | None = None) -> float:
        """Return the integral of the joints' power where it is positive, summed over them [J].

        Braking gives nothing back.

        Args:
            duration: In which the motion is run [s]; None: its own.
        """
        power = self._effort(self._slower(duration)) * self._samples.velocity
        return self._integral(np.maximum(power, 0.0).sum(axis=1))

    def _slower(self, duration: float | None) -> float:
        return 1.0 if duration is None else duration / self._trajectory.duration

    def _effort(self, slower: float) -> FloatArray:
        held, viscous, moved = self._efforts
        return held + viscous / slower + moved / slower**2

    @cached_property
    def _efforts(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Efforts against gravity and Coulomb friction, viscous friction, and all inertia."""
        at, robot = self._samples, self._robot
        gravity = robot.gravity_effort(at.position)
        viscous = robot.motors.viscous_friction * at.velocity
        smooth = robot.inverse_dynamics(at.position, at.velocity, at.acceleration)
        held = gravity + coulomb_effort(robot, self._trajectory, at)
        return held, viscous, smooth - viscous - gravity

    def _integral(self, values: FloatArray) -> float:
        return float(np.trapezoid(values, self._samples.time))
