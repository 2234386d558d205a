"""What motors make of the efforts that they are asked for: bounds, delay and lag."""

from collections.abc import Sequence

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.simulation.plant import Plant

_ROUNDING = 1e-9  # relative, of efforts at their bounds


class Drives:
    """The motors of R arms in integration steps of one length.

    Before the first effort that is asked for arrives, they hold the arm as the plan's model would.
    """

    def __init__(
        self, robot: RobotModel, plants: Sequence[Plant], held: FloatArray, step: float
    ) -> None:
        """Take the model, the arms, the efforts (n,) at the start and the step [s].

        Delays are rounded to whole steps.
        """
        self._limits, self._motors = robot.limits, robot.motors
        lag = np.array([[plant.lag] for plant in plants])
        share = step / np.where(lag > 0, lag, 1.0)
        # Of what an effort lacks: how much is left after a step, and on average during it.
        self._left = np.where(lag > 0, np.exp(-share), 0.0)
        self._mean_left = np.where(lag > 0, (1 - self._left) / share, 0.0)
        self._delay = np.array([round(plant.delay / step) for plant in plants])
        self._given = np.tile(held, (len(plants), 1))
        # What is on its way, the newest last: (steps, R, n).
        self._sent = np.tile(self._given, (int(self._delay.max()) + 1, 1, 1))

    def become(self, robot: RobotModel) -> None:
        """Go on with another arm's limits; what is on its way stays."""
        self._limits, self._motors = robot.limits, robot.motors

    def bounded(
        self, asked: FloatArray, q: FloatArray, v: FloatArray
    ) -> tuple[FloatArray, BoolArray]:
        """Return what motors have of efforts (R, n), and where that is less, in states (R, n).

        Effort limits by direction and position hold, and torque-speed lines.
        """
        stall, slowing = self._motors.saturation_effort, v / self._motors.no_load_velocity
        line = np.isfinite(stall)
        with_line = np.where(line, stall, 0.0) * np.array([1 - slowing, 1 + slowing])
        most, least = np.where(line, with_line, np.inf)
        most = np.minimum(self._limits.effort_at(q, 1.0), most)
        least = -np.minimum(self._limits.effort_at(q, -1.0), least)
        given = np.clip(asked, least, most)
        return given, abs(asked - given) > _ROUNDING * self._limits.effort

    def stepped(self, asked: FloatArray) -> FloatArray:
        """Return the mean efforts (R, n) during the next step, efforts (R, n) being asked."""
        self._sent = np.concatenate([self._sent[1:], asked[None]])
        target = self._sent[len(self._sent) - 1 - self._delay, np.arange(len(asked))]
        behind = self._given - target
        self._given = target + behind * self._left
        mean: FloatArray = target + behind * self._mean_left
        return mean
