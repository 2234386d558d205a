"""Trajectories executed by simulated arms under control."""

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray
from tubeplanner.errors import OptionError
from tubeplanner.options import in_figures, is_number
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.problem.robustness import COMPUTED_TORQUE
from tubeplanner.short_repr import short_repr
from tubeplanner.simulation.drives import Drives
from tubeplanner.simulation.mujoco_model import ArmsTogether, mujoco_arms
from tubeplanner.simulation.planned_motion import planned_motion
from tubeplanner.simulation.plant import Plant
from tubeplanner.simulation.tracking_controllers import TrackingController, controller_maker
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

AFTERWARDS = 0.2  # [s], for which the goal is held
_STEPS = 4  # of the integration, in a control period
_LEAST_PERIOD, _MAX_PERIOD = 1e-4, 0.1  # [s]
_LOST = 1e3  # [rad/s or m/s]: an arm as fast as that is left where it is


@dataclass(frozen=True, eq=False)
class Execution:
    """What R arms did, at K instants one control period apart.

    Attributes:
        plants: What they are.
        time: From 0 to the duration and 0.2 s more, shape (K,) [s].
        position: Of the joints, shape (R, K, n) [rad or m].
        velocity: Likewise [rad/s or m/s].
        effort: That motors were asked for in the period that begins there, cut to what they have,
            shape (R, K, n) [N m or N].
        is_saturated: Where it was cut, shape (R, K, n).
    """

    plants: Sequence[Plant]
    time: FloatArray
    position: FloatArray
    velocity: FloatArray
    effort: FloatArray
    is_saturated: BoolArray

    __repr__ = short_repr


def executed(
    problem: PlanningProblem,
    trajectory: JointTrajectory,
    plants: Sequence[Plant],
    controller: str = COMPUTED_TORQUE,
    control_period: float = 0.001,
    checkpoint: Callable[[], None] = lambda: None,
) -> Execution:
    """Return what arms do that a controller moves along a trajectory; the same every time.

    They begin at rest where it begins. Measured velocities have the noise that differences of
    noisy positions have. An arm that gets out of control is left where it is.

    Args:
        problem: Whose robot is the controller's model.
        trajectory: Of the problem's joints, in any order.
        plants: The arms; at least one.
        controller: "computed-torque", "feedforward-pd" or "pd".
        control_period: [s].
        checkpoint: Called in every control period; may raise to end the work.

    Raises:
        OptionError: MuJoCo is not installed, there is no plant, or the controller or the period is
            none.
        RobotError: Joints of the robot follow others.
        TrajectoryError: The trajectory moves other joints than the problem's.
    """
    robot, step = problem.robot, control_period / _STEPS if is_number(control_period) else np.nan
    if not _LEAST_PERIOD <= step * _STEPS <= _MAX_PERIOD:
        raise OptionError(
            f"control_period is {in_figures(control_period)} s; give a number from "
            f"{_LEAST_PERIOD:g} to {_MAX_PERIOD:g} s"
        )
    if len(plants) == 0:
        raise OptionError("plants is empty; give at least one, as drawn_plants returns")
    make = controller_maker(controller)
    trajectory = trajectory.reordered(robot.joint_names)
    arms = mujoco_arms(robot, plants, step)
    periods = int(np.ceil((trajectory.duration + AFTERWARDS) / control_period))
    time = np.arange(periods + 1, dtype=np.float64) * float(control_period)
    plan = planned_motion(robot, trajectory, time, control_period)
    start = plan.start.position[:1]
    for arm in arms:
        arm.place(start[0], np.zeros(robot.joint_count))
    drives = Drives(robot, plants, robot.gravity_effort(start)[0], step)
    with closing(ArmsTogether(arms)) as together:
        return _run(together, plants, time, make(robot, plan), drives, checkpoint)


def _run(
    arms: ArmsTogether,
    plants: Sequence[Plant],
    time: FloatArray,
    controller: TrackingController,
    drives: Drives,
    checkpoint: Callable[[], None],
) -> Execution:
    noise = _noise(plants, len(time) + 1, arms.position.shape[1])
    shape = noise[:, 1:].shape
    position, velocity, effort = np.empty((3, *shape))
    is_saturated = np.zeros(shape, dtype=bool)
    for k in range(len(time)):
        checkpoint()
        position[:, k] = q = arms.position
        velocity[:, k] = v = arms.velocity
        jitter = (noise[:, k + 1] - noise[:, k]) / (time[1] - time[0])
        asked = controller.effort(k, q + noise[:, k + 1], v + jitter)
        effort[:, k], is_saturated[:, k] = drives.bounded(asked, q, v)
        given = np.array([drives.stepped(effort[:, k]) for _ in range(_STEPS)])
        arms.move(given, np.flatnonzero((abs(v) < _LOST).all(axis=1)))
    return Execution(plants, time, position, velocity, effort, is_saturated)


def _noise(plants: Sequence[Plant], instants: int, joints: int) -> FloatArray:
    """Return the errors of measured positions, shape (R, instants, n)."""
    generators = (np.random.default_rng(plant.noise_seed) for plant in plants)
    drawn = [
        plant.noise * random.normal(size=(instants, joints))
        for plant, random in zip(plants, generators, strict=True)
    ]
    return np.array(drawn)
