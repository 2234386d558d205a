"""Tracking controllers, planned feedforward, bounds and lag of drives."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray
from tubeplanner.errors import OptionError, unknown_name
from tubeplanner.execution.plants import Plant
from tubeplanner.limits.motor_costs import coulomb_effort
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.demands import COMPUTED_TORQUE, FEEDFORWARD_PD, PD
from tubeplanner.trajectory.joint_trajectory import JointTrajectory, TrajectorySamples

# ---- What a controller knows of a plan: where joints are to be, and efforts by the plan's model.


@dataclass(frozen=True, eq=False)
class PlannedMotion:
    """A plan at K instants, one control period apart, the goal held beyond its end.

    An effort is held for one period: what it is to achieve is taken in the middle of that.

    Attributes:
        start: At the instants.
        middle: In the middles of the periods that begin there.
        acceleration: Mean over the periods, shape (K, n) [rad/s^2 or m/s^2].
        friction: Coulomb friction in the middles, shape (K, n) [N m or N].
        effort: Of the motors in the middles, by the plan's model, shape (K, n) [N m or N].
        inertia: What each motor alone accelerates in the middles, rotor included: one over the
            diagonal of the inverse of the mass matrix, shape (K, n) [kg m^2 or kg].
    """

    start: TrajectorySamples
    middle: TrajectorySamples
    acceleration: FloatArray
    friction: FloatArray
    effort: FloatArray
    inertia: FloatArray


def planned_motion(
    robot: RobotModel, trajectory: JointTrajectory, time: FloatArray, period: float
) -> PlannedMotion:
    """Return what a controller knows.

    Args:
        robot: The model.
        trajectory: Of its joints, in their order.
        time: The instants, shape (K,) [s].
        period: Of the control [s].
    """
    start, middle = _held(trajectory, time), _held(trajectory, time + period / 2)
    moving = middle.time <= trajectory.duration
    friction = np.where(moving[:, None], coulomb_effort(robot, trajectory, middle), 0.0)
    # Not the acceleration in the middle: it may jump in between.
    mean = np.diff(_held(trajectory, np.append(time, time[-1] + period)).velocity, axis=0) / period
    smooth = robot.inverse_dynamics(middle.position, middle.velocity, mean)
    return PlannedMotion(start, middle, mean, friction, smooth + friction, _inertia(robot, middle))


def _held(trajectory: JointTrajectory, time: FloatArray) -> TrajectorySamples:
    """Return samples at times (K,) [s], at rest from the end on."""
    samples = trajectory.at(np.minimum(time, trajectory.duration))
    moving = (time < trajectory.duration)[:, None]
    return TrajectorySamples(
        time,
        samples.position,
        np.where(moving, samples.velocity, 0.0),
        np.where(moving, samples.acceleration, 0.0),
    )


def _inertia(robot: RobotModel, samples: TrajectorySamples) -> FloatArray:
    q, still = samples.position, np.zeros_like(samples.position)
    weight = robot.gravity_effort(q)
    pushed = [robot.inverse_dynamics(q, still, still + unit) for unit in np.eye(q.shape[1])]
    mass_matrix = np.stack(pushed, axis=2) - weight[:, :, None]
    inverse = np.linalg.inv(mass_matrix)
    found: FloatArray = 1 / np.einsum("kjj->kj", inverse)
    return found


# ---- Controllers that follow a plan: from measured states to the efforts that motors are asked
# for.
#
# Each answers an error of position by an acceleration back, as a critically damped oscillator of 30
# rad/s would.

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


# ---- What motors make of the efforts that they are asked for: bounds, delay and lag.

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
