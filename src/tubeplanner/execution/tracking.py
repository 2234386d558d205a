"""Tracking controllers, planned feedforward, bounds and lag of drives."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray
from tubeplanner.errors import OptionError, unknown_name
from tubeplanner.execution.plants import Plant
from tubeplanner.limits.peaks import coulomb_effort
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.demands import COMPUTED_TORQUE, FEEDFORWARD_PD, PD
from tubeplanner.trajectory.joint_trajectory import JointTrajectory, TrajectorySamples

# ---- Feedback: that of drives, with a least stiffness and with integral action.
#
# The feedback acceleration of a joint is that of an oscillator with three equal poles. Gains scaled
# by the inertia of the links alone would leave a wrist of 1e-4 kg m^2 without stiffness against
# friction, which no drive does. So a joint has at least the stiffness of a maker's joint impedance
# controller, as far as the largest bandwidth allows: the effort limit within a tenth of a radian.
# libfranka 0.21 (examples/joint_impedance_control.cpp) has 600, 250, 150 and 50 N m/rad for limits
# of 87 and 12 N m: the limit within 0.05 to 0.24 rad. A loop with lag and delay of a millisecond
# each and a control period of 1 ms has a phase margin of 37 degrees at 80 rad/s. Integral action is
# bounded as in ros2_control (control_toolbox 4, parameter i_clamp).

STIFFNESS_TRAVEL = 0.1  # [rad]: error of a turning joint that is answered by its effort limit
LENGTH_PER_ANGLE = 0.1  # [m/rad]: a sliding joint's error is compared with a turning joint's so
MAX_BANDWIDTH = 80.0  # [rad/s]
MAX_ANGLE = 0.4  # [rad]: bandwidth times control period
INTEGRAL_FRACTION = 0.1  # of the effort limit
_FREEDOMS = 2.0  # times a joint's freedom: fraction of the integral action that it has at most


# ---- The controller's knowledge of a plan.


@dataclass(frozen=True, eq=False)
class PlannedMotion:
    """A plan at K instants, one control period apart, with the goal held beyond its end.

    An effort is held for one period, so its target is the motion in the middle of the period.
    """

    start: TrajectorySamples  # samples at the instants
    middle: TrajectorySamples  # samples in the middles of the periods that begin there
    acceleration: FloatArray  # mean over the periods, shape (K, n) [rad/s^2 or m/s^2]
    friction: FloatArray  # Coulomb friction in the middles, shape (K, n) [N m or N]
    # efforts of the motors in the middles, by the plan's model, shape (K, n) [N m or N]
    effort: FloatArray
    # inertia that each motor alone accelerates in the middles, rotor included: one over the
    # diagonal of the inverse of the mass matrix, shape (K, n) [kg m^2 or kg]
    inertia: FloatArray
    # `inertia` over the inertia with all other joints at rest: 1 for a joint that no other joint
    # moves, near 0 for joints with nearly one axis, shape (K, n)
    freedom: FloatArray
    stiff: FloatArray  # bandwidth of each joint with its least stiffness, shape (K, n) [rad/s]
    integral_limit: FloatArray  # largest effort of the integral action, shape (n,) [N m or N]


def planned_motion(
    robot: RobotModel, trajectory: JointTrajectory, time: FloatArray, period: float
) -> PlannedMotion:
    """Return the plan at instants (K,) [s] and in the middles of the control periods [s]."""
    start, middle = _held(trajectory, time), _held(trajectory, time + period / 2)
    moving = middle.time <= trajectory.duration
    friction = np.where(moving[:, None], coulomb_effort(robot, trajectory, middle), 0.0)
    # Not the acceleration in the middle: it may jump within the period.
    mean = np.diff(_held(trajectory, np.append(time, time[-1] + period)).velocity, axis=0) / period
    smooth = robot.inverse_dynamics(middle.position, middle.velocity, mean)
    # Column j of the mass matrix, rotors included: inverse dynamics at rest under a unit
    # acceleration of joint j, less gravity.
    q, rest = middle.position, np.zeros_like(middle.position)
    gravity = robot.gravity_effort(q)
    columns = [robot.inverse_dynamics(q, rest, rest + unit) for unit in np.eye(q.shape[1])]
    mass_matrix = np.stack(columns, axis=2) - gravity[:, :, None]
    inertia = 1 / np.einsum("kjj->kj", np.linalg.inv(mass_matrix))
    freedom = inertia / np.einsum("kjj->kj", mass_matrix)
    travel = STIFFNESS_TRAVEL * np.where(robot.revolute, 1.0, LENGTH_PER_ANGLE)
    stiffness = np.where(np.isfinite(robot.limits.effort), robot.limits.effort, 0.0) / travel
    stiff = np.minimum(np.sqrt(stiffness / (3 * inertia)), _max_bandwidth(period))
    limit = INTEGRAL_FRACTION * robot.limits.effort
    effort = smooth + friction
    return PlannedMotion(start, middle, mean, friction, effort, inertia, freedom, stiff, limit)


def _max_bandwidth(period: float) -> float:
    """Return the largest bandwidth of a loop with a control period [s], in rad/s."""
    return min(MAX_BANDWIDTH, MAX_ANGLE / period)


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


# ---- Controllers: from measured states to requested efforts.


class Feedback:
    """Feedback accelerations of the joints of R arms, with integral action.

    The integral goes on from plan to plan.
    """

    def __init__(self, bandwidth: float, period: float) -> None:
        """Start without an integral.

        Args:
            bandwidth: Least bandwidth [rad/s].
            period: Control period [s].
        """
        self.bandwidth, self._period = min(bandwidth, _max_bandwidth(period)), period
        self._integral: FloatArray | float = 0.0  # [N m or N]

    def acceleration(
        self, plan: PlannedMotion, bandwidth: FloatArray, k: int, q: FloatArray, v: FloatArray
    ) -> FloatArray:
        """Return the feedback acceleration in period k, shape (R, n) [rad/s^2 or m/s^2].

        The bandwidths (K, n) [rad/s] are those of each joint at the plan's instants, the states as
        for `TrackingController.effort`.
        """
        w, inertia = bandwidth[k], plan.inertia[k]
        q_error, v_error = plan.start.position[k] - q, plan.start.velocity[k] - v
        # Joints with nearly one axis are moved by their loops together: a swing of one against the
        # other meets little inertia, the swing of both more than `inertia` of each. With integral
        # action such a loop is stable only for a gain above a ninth of that of a single joint.
        fraction = np.minimum(_FREEDOMS * plan.freedom[k], 1.0)
        more = fraction * inertia * w**3 * q_error * self._period
        self._integral = np.clip(self._integral + more, -plan.integral_limit, plan.integral_limit)
        return 3 * w * (w * q_error + v_error) + self._integral / inertia


class TrackingController(ABC):
    """A controller that follows one plan with the arms of R runs."""

    def __init__(self, robot: RobotModel, plan: PlannedMotion, feedback: Feedback) -> None:
        self._robot, self._plan, self._feedback = robot, plan, feedback
        self._bandwidth = np.maximum(plan.stiff, feedback.bandwidth)

    @abstractmethod
    def effort(self, k: int, q: FloatArray, v: FloatArray) -> FloatArray:
        """Return the requested efforts in period k, shape (R, n) [N m or N].

        Args:
            k: Index of the plan's instant at which the period begins.
            q: Measured positions at that instant, shape (R, n) [rad or m].
            v: Measured velocities at that instant, shape (R, n) [rad/s or m/s].
        """


def controller_maker(name: str) -> type[TrackingController]:
    """Return the maker of a controller by name.

    Raises:
        OptionError: No controller has the name.
    """
    if name not in _MAKERS:
        raise OptionError(f"controller: {unknown_name('controller', name, _MAKERS)}")
    return _MAKERS[name]


class ComputedTorque(TrackingController):
    """Inverse dynamics of planned acceleration and feedback at the measured state."""

    def effort(self, k: int, q: FloatArray, v: FloatArray) -> FloatArray:
        """Return inverse dynamics at the measured state, advanced to the middle of the period."""
        start, middle = self._plan.start, self._plan.middle
        position = q + (middle.position[k] - start.position[k])
        velocity = v + (middle.velocity[k] - start.velocity[k])
        feedback = self._feedback.acceleration(self._plan, self._bandwidth, k, q, v)
        acceleration = self._plan.acceleration[k] + feedback
        smooth = self._robot.inverse_dynamics(position, velocity, acceleration)
        return smooth + self._plan.friction[k]


class FeedforwardPd(TrackingController):
    """A joint position loop with the plan's efforts, as of UR arms and of ros2_control.

    The stiffness grows with each joint's inertia.
    """

    def effort(self, k: int, q: FloatArray, v: FloatArray) -> FloatArray:
        """Return the plan's efforts in the middle of the period, and feedback."""
        feedback = self._feedback.acceleration(self._plan, self._bandwidth, k, q, v)
        return self._plan.effort[k] + self._plan.inertia[k] * feedback


class Pd(FeedforwardPd):
    """A joint impedance with the plan's efforts, as of Franka arms: the stiffness is constant.

    Without the plan's efforts such a loop is 0.05 to 0.7 rad behind motions at the effort limits.
    """

    def __init__(self, robot: RobotModel, plan: PlannedMotion, feedback: Feedback) -> None:
        super().__init__(robot, plan, feedback)
        has_effort = np.isfinite(robot.limits.effort)
        self._bandwidth = np.where(has_effort, plan.stiff, self._bandwidth)


_MAKERS: Mapping[str, type[TrackingController]] = {
    COMPUTED_TORQUE: ComputedTorque,
    FEEDFORWARD_PD: FeedforwardPd,
    PD: Pd,
}


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
