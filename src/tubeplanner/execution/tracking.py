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

# ---- The controller's knowledge of a plan.


@dataclass(frozen=True, eq=False)
class PlannedMotion:
    """A plan at K instants, one control period apart, with the goal held beyond its end.

    An effort is held for one period, so its target is the motion in the middle of the period.

    Attributes:
        start: Samples at the instants.
        middle: Samples in the middles of the periods that begin there.
        acceleration: Mean over the periods, shape (K, n) [rad/s^2 or m/s^2].
        friction: Coulomb friction in the middles, shape (K, n) [N m or N].
        effort: Efforts of the motors in the middles, by the plan's model, shape (K, n) [N m or N].
        inertia: Inertia that each motor alone accelerates in the middles, rotor included: one over
            the diagonal of the inverse of the mass matrix, shape (K, n) [kg m^2 or kg].
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
    """Return the plan at the instants and in the middles of the control periods.

    Args:
        robot: The controller's model.
        trajectory: The plan, its joints in the model's order.
        time: The instants, shape (K,) [s].
        period: Control period [s].
    """
    start, middle = _held(trajectory, time), _held(trajectory, time + period / 2)
    moving = middle.time <= trajectory.duration
    friction = np.where(moving[:, None], coulomb_effort(robot, trajectory, middle), 0.0)
    # Not the acceleration in the middle: it may jump within the period.
    mean = np.diff(_held(trajectory, np.append(time, time[-1] + period)).velocity, axis=0) / period
    smooth = robot.inverse_dynamics(middle.position, middle.velocity, mean)
    return PlannedMotion(start, middle, mean, friction, smooth + friction, _inertia(robot, middle))


def _held(trajectory: JointTrajectory, time: FloatArray) -> TrajectorySamples:
    """Return samples at times (K,) [s], at rest from the trajectory's end on."""
    samples = trajectory.at(np.minimum(time, trajectory.duration))
    moving = (time < trajectory.duration)[:, None]
    return TrajectorySamples(
        time,
        samples.position,
        np.where(moving, samples.velocity, 0.0),
        np.where(moving, samples.acceleration, 0.0),
    )


def _inertia(robot: RobotModel, samples: TrajectorySamples) -> FloatArray:
    # Column j of the mass matrix: inverse dynamics at rest under a unit acceleration of joint j,
    # less gravity.
    q, rest = samples.position, np.zeros_like(samples.position)
    gravity = robot.gravity_effort(q)
    columns = [robot.inverse_dynamics(q, rest, rest + unit) for unit in np.eye(q.shape[1])]
    mass_matrix = np.stack(columns, axis=2) - gravity[:, :, None]
    inertia: FloatArray = 1 / np.einsum("kjj->kj", np.linalg.inv(mass_matrix))
    return inertia


# ---- Controllers: from measured states to requested efforts.
#
# The feedback acceleration is that of a critically damped oscillator of 30 rad/s.

BANDWIDTH = 30.0  # [rad/s]


class TrackingController(Protocol):
    """A controller that follows one plan with the arms of R runs."""

    def effort(self, k: int, q: FloatArray, v: FloatArray) -> FloatArray:
        """Return the requested efforts in period k, shape (R, n) [N m or N].

        Args:
            k: Index of the plan's instant at which the period begins.
            q: Measured positions at that instant, shape (R, n) [rad or m].
            v: Measured velocities at that instant, shape (R, n) [rad/s or m/s].
        """
        ...


ControllerMaker: TypeAlias = Callable[[RobotModel, PlannedMotion], TrackingController]


def controller_maker(name: str) -> ControllerMaker:
    """Return the maker of a controller by name.

    Raises:
        OptionError: No controller has the name.
    """
    if name not in _MAKERS:
        raise OptionError(f"controller: {unknown_name('controller', name, _MAKERS)}")
    return _MAKERS[name]


class ComputedTorque:
    """Inverse dynamics of planned acceleration and feedback at the measured state."""

    def __init__(self, robot: RobotModel, plan: PlannedMotion) -> None:
        self._robot, self._plan = robot, plan

    def effort(self, k: int, q: FloatArray, v: FloatArray) -> FloatArray:
        """Return inverse dynamics at the measured state, advanced to the middle of the period."""
        start, middle = self._plan.start, self._plan.middle
        position = q + (middle.position[k] - start.position[k])
        velocity = v + (middle.velocity[k] - start.velocity[k])
        acceleration = self._plan.acceleration[k] + _feedback(self._plan, k, q, v)
        smooth = self._robot.inverse_dynamics(position, velocity, acceleration)
        return smooth + self._plan.friction[k]


class FeedforwardPd:
    """The plan's efforts, and feedback times each joint's inertia."""

    def __init__(self, robot: RobotModel, plan: PlannedMotion) -> None:
        self._plan = plan

    def effort(self, k: int, q: FloatArray, v: FloatArray) -> FloatArray:
        """Return the plan's efforts in the middle of the period, and feedback."""
        feedback = _feedback(self._plan, k, q, v)
        return self._plan.effort[k] + self._plan.inertia[k] * feedback


class Pd:
    """A position controller with velocity feedforward, without the plan's efforts.

    It adds the gravity effort of the start, as the integral part of a drive would.
    """

    def __init__(self, robot: RobotModel, plan: PlannedMotion) -> None:
        self._plan = plan
        self._weight = robot.gravity_effort(plan.start.position[:1])[0]

    def effort(self, k: int, q: FloatArray, v: FloatArray) -> FloatArray:
        """Return feedback times each joint's inertia, and the gravity effort of the start."""
        return self._weight + self._plan.inertia[k] * _feedback(self._plan, k, q, v)


_MAKERS: Mapping[str, ControllerMaker] = {
    COMPUTED_TORQUE: ComputedTorque,
    FEEDFORWARD_PD: FeedforwardPd,
    PD: Pd,
}


def _feedback(plan: PlannedMotion, k: int, q: FloatArray, v: FloatArray) -> FloatArray:
    """Return the feedback acceleration of joints (R, n) [rad/s^2 or m/s^2]."""
    q_error, v_error = plan.start.position[k] - q, plan.start.velocity[k] - v
    feedback: FloatArray = BANDWIDTH**2 * q_error + 2 * BANDWIDTH * v_error
    return np.asarray(feedback)


# ---- Drives: from requested to real efforts by bounds, delay and lag.

_ROUNDING = 1e-9  # relative, of efforts at their bounds


class Drives:
    """The motors of R arms in integration steps of one length.

    Before the first requested effort arrives, they have the efforts of the start.
    """

    def __init__(
        self, robot: RobotModel, plants: Sequence[Plant], effort: FloatArray, step: float
    ) -> None:
        """Start the motors; delays are rounded to whole steps.

        Args:
            robot: The model, for the limits.
            plants: The arms.
            effort: Efforts at the start, shape (n,) [N m or N].
            step: Integration step [s].
        """
        self._limits, self._motors = robot.limits, robot.motors
        lag = np.array([[plant.lag] for plant in plants])
        exponent = step / np.where(lag > 0, lag, 1.0)
        # Fraction of the lag error that remains after a step, and its mean during the step.
        self._remaining = np.where(lag > 0, np.exp(-exponent), 0.0)
        self._mean_remaining = np.where(lag > 0, (1 - self._remaining) / exponent, 0.0)
        self._delay = np.array([round(plant.delay / step) for plant in plants])
        self._effort = np.tile(effort, (len(plants), 1))
        # Delayed efforts, the newest last: (steps, R, n).
        self._sent = np.tile(self._effort, (int(self._delay.max()) + 1, 1, 1))

    def become(self, robot: RobotModel) -> None:
        """Change to another arm's limits; delayed efforts stay."""
        self._limits, self._motors = robot.limits, robot.motors

    def bounded(
        self, requested: FloatArray, q: FloatArray, v: FloatArray
    ) -> tuple[FloatArray, BoolArray]:
        """Return efforts (R, n) cut to the motors' bounds in states (R, n), and where cut.

        The bounds are the effort limits by direction and position, and the torque-speed lines.
        """
        stall, slowing = self._motors.saturation_effort, v / self._motors.no_load_velocity
        line = np.isfinite(stall)
        with_line = np.where(line, stall, 0.0) * np.array([1 - slowing, 1 + slowing])
        most, least = np.where(line, with_line, np.inf)
        most = np.minimum(self._limits.effort_at(q, 1.0), most)
        least = -np.minimum(self._limits.effort_at(q, -1.0), least)
        bounded = np.clip(requested, least, most)
        return bounded, abs(requested - bounded) > _ROUNDING * self._limits.effort

    def stepped(self, requested: FloatArray) -> FloatArray:
        """Return the mean efforts (R, n) of the next step under requested efforts (R, n)."""
        self._sent = np.concatenate([self._sent[1:], requested[None]])
        target = self._sent[len(self._sent) - 1 - self._delay, np.arange(len(requested))]
        error = self._effort - target
        self._effort = target + error * self._remaining
        mean: FloatArray = target + error * self._mean_remaining
        return mean
