"""Controllers that follow a plan: from measured states to the efforts that motors are asked for.

Each answers an error of position by an acceleration back, as a critically damped oscillator of
30 rad/s would.
"""

from collections.abc import Callable, Mapping
from typing import Protocol, TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import OptionError, unknown_name
from tubeplanner.problem.robustness import COMPUTED_TORQUE, FEEDFORWARD_PD, PD
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.simulation.planned_motion import PlannedMotion

BANDWIDTH = 30.0  # [rad/s]


class TrackingController(Protocol):
    """Follows one plan with the arms of R runs."""

    def effort(self, k: int, q: FloatArray, v: FloatArray) -> FloatArray:
        """Return the efforts asked for in period k, shape (R, n) [N m or N].

        Args:
            k: Of the plan's instants.
            q: Measured positions at its beginning, shape (R, n) [rad or m].
            v: Measured velocities, likewise.
        """
        ...


ControllerMaker: TypeAlias = Callable[[RobotModel, PlannedMotion], TrackingController]


def controller_maker(name: str) -> ControllerMaker:
    """Return what makes a controller, by its name.

    Raises:
        OptionError: There is none of that name.
    """
    if name not in _MAKERS:
        raise OptionError(f"controller: {unknown_name('controller', name, _MAKERS)}")
    return _MAKERS[name]


class ComputedTorque:
    """The plan's model turns planned acceleration and feedback into efforts, where the arm is."""

    def __init__(self, robot: RobotModel, plan: PlannedMotion) -> None:
        self._robot, self._plan = robot, plan

    def effort(self, k: int, q: FloatArray, v: FloatArray) -> FloatArray:
        """Return inverse dynamics at the measured state, moved on to the middle of the period."""
        start, middle = self._plan.start, self._plan.middle
        moved_on = q + (middle.position[k] - start.position[k])
        faster = v + (middle.velocity[k] - start.velocity[k])
        wanted = self._plan.acceleration[k] + _feedback(self._plan, k, q, v)
        return self._robot.inverse_dynamics(moved_on, faster, wanted) + self._plan.friction[k]


class FeedforwardPd:
    """The plan's own efforts, and feedback times each joint's inertia."""

    def __init__(self, robot: RobotModel, plan: PlannedMotion) -> None:
        self._plan = plan

    def effort(self, k: int, q: FloatArray, v: FloatArray) -> FloatArray:
        """Return the plan's efforts in the middle of the period, and feedback."""
        back = _feedback(self._plan, k, q, v)
        return self._plan.effort[k] + self._plan.inertia[k] * back


class Pd:
    """A position controller with velocity feedforward, which knows nothing of the plan's efforts.

    It holds the weight that it held at the start, as the integral part of a drive would.
    """

    def __init__(self, robot: RobotModel, plan: PlannedMotion) -> None:
        self._plan = plan
        self._weight = robot.gravity_effort(plan.start.position[:1])[0]

    def effort(self, k: int, q: FloatArray, v: FloatArray) -> FloatArray:
        """Return feedback times each joint's inertia, and the weight at the start."""
        return self._weight + self._plan.inertia[k] * _feedback(self._plan, k, q, v)


_MAKERS: Mapping[str, ControllerMaker] = {
    COMPUTED_TORQUE: ComputedTorque,
    FEEDFORWARD_PD: FeedforwardPd,
    PD: Pd,
}


def _feedback(plan: PlannedMotion, k: int, q: FloatArray, v: FloatArray) -> FloatArray:
    """Return the acceleration that takes joints (R, n) back to the plan."""
    behind, slower = plan.start.position[k] - q, plan.start.velocity[k] - v
    back: FloatArray = BANDWIDTH**2 * behind + 2 * BANDWIDTH * slower
    return np.asarray(back)
