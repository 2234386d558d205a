"""Torque-speed lines: what effort motors have left at speed."""

from collections.abc import Mapping

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.constraints.effort_refusal import effort_refusal
from tubeplanner.constraints.path_samples import PathSamples
from tubeplanner.constraints.sided_effort import SidedEffort
from tubeplanner.constraints.speed_limit import LimitKey
from tubeplanner.constraints.speed_polynomial import SpeedPolynomial
from tubeplanner.outcome import Infeasible
from tubeplanner.robot.joint_motors import JointMotors


class MotorCurve:
    """A `SpeedLimit` on the efforts of some joints at their velocities: 2 I quantities.

    An effort tau at the velocity v uses tau / S + v / v0 forwards, S the saturation effort and v0
    the no-load velocity, and minus that backwards. A key stands for both, raised together.

    Attributes:
        joints: Those that have such a line, twice, shape (2 I,).
    """

    kind = "motor_curve"
    order = 2
    signs = (1.0,)

    def __init__(self, motors: JointMotors) -> None:
        """Take the joints that have a line."""
        joints = np.flatnonzero(motors.has_curve)
        self._effort = SidedEffort(joints)
        self.joints, self._way = self._effort.joints, self._effort.way
        self._stall = motors.saturation_effort[self.joints]
        self._no_load = motors.no_load_velocity[self.joints]
        self.keys = tuple(LimitKey(self.kind, joint=j) for j in joints.tolist())

    def used(self, at: PathSamples) -> SpeedPolynomial:
        """Return what efforts and velocities use together."""
        terms = {k: term / self._stall for k, term in self._effort.terms(at).items()}
        terms[1] = terms[1] + self._way * at.by_path[1][:, self.joints] / self._no_load
        return SpeedPolynomial(terms)

    def by_path(self, at: PathSamples, speed: float) -> Mapping[int, FloatArray]:
        """Return how that changes with the path."""
        change = {k: by / self._stall[:, None] for k, by in self._effort.by_path(at, speed).items()}
        every = np.arange(len(self.joints))
        change[1][:, every, self.joints] += self._way * speed / self._no_load
        return change

    def key_of(self, at: PathSamples) -> IntArray:
        """Return one key per joint."""
        return np.tile(np.arange(len(self.keys)), 2)[None]

    def refusal(self, at: PathSamples) -> Infeasible:
        """Return which motor stalls under gravity and friction."""
        held = self.used(at).terms[0]
        sample, column = np.unravel_index(int(held.argmax()), held.shape)
        stall = float(self._stall[column])
        needed = float(held[sample, column]) * stall
        return effort_refusal(at, int(sample), int(self.joints[column]), needed, stall)
