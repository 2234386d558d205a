"""What a controller knows of a plan: where joints are to be, and efforts by the plan's model."""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.constraints.motor_effort import coulomb_effort
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.trajectory.joint_trajectory import JointTrajectory, TrajectorySamples


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
