"""Execution of trajectories and cycles by plants under control."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray
from tubeplanner.checks import in_figures, is_number
from tubeplanner.errors import OptionError
from tubeplanner.execution.mujoco_model import ArmsTogether, mujoco_arms
from tubeplanner.execution.plants import (
    CORNERS,
    Draw,
    Plant,
    Stage,
    drawn_plants,
    last_instant,
    payload_body,
)
from tubeplanner.execution.tracking import (
    Drives,
    Feedback,
    TrackingController,
    controller_maker,
    planned_motion,
)
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.pinocchio_model import Payload
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.demands import COMPUTED_TORQUE, Robustness
from tubeplanner.task.motion import CycleMotion, Motion, ProblemMotion
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.steps import Attach, Detach
from tubeplanner.text import short_repr
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.parts import MOVE

# ---- Execution of trajectories.

AFTERWARDS = 0.2  # [s], for which the goal is held
_STEPS = 4  # of the integration, in a control period
_MIN_PERIOD, _MAX_PERIOD = 1e-4, 0.1  # [s]
_LOST = 1e3  # [rad/s or m/s]: an arm as fast as that is not moved any more


@dataclass(frozen=True, eq=False)
class Execution:
    """The motion of R arms at K instants one control period apart.

    Attributes:
        plants: The arms.
        time: Instants from 0 to the duration and 0.2 s more, shape (K,) [s].
        position: Positions of the joints, shape (R, K, n) [rad or m].
        velocity: Velocities of the joints, shape (R, K, n) [rad/s or m/s].
        effort: Efforts requested for the period that begins at the instant, cut to the bounds of
            the motors, shape (R, K, n) [N m or N].
        is_saturated: True where the effort was cut, shape (R, K, n).
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
    bandwidth: float = Robustness.bandwidth,
) -> Execution:
    """Return the motion of arms that a controller moves along a trajectory; deterministic.

    The arms begin at rest at its start. Measured velocities have the noise of differences of noisy
    positions. An arm that gets out of control (1000 rad/s or m/s) is not moved any more.

    Args:
        problem: The planning problem; its robot is the controller's model.
        trajectory: The planned motion of the problem's joints, in any order.
        plants: The arms; at least one.
        controller: "computed-torque", "feedforward-pd" or "pd".
        control_period: Control period [s], 0.0001 to 0.1.
        checkpoint: Called in every control period; may raise to end the work.
        bandwidth: Least bandwidth of the controller's feedback [rad/s].

    Raises:
        OptionError: MuJoCo is not installed, there is no plant, or the controller or the period is
            invalid.
        RobotError: Joints of the robot follow others.
        TrajectoryError: The trajectory moves other joints than the problem's.
    """
    stages = [Stage(0.0, problem.robot, plants)]
    return executed_stages(stages, trajectory, controller, control_period, checkpoint, bandwidth)


def executed_stages(
    stages: Sequence[Stage],
    trajectory: JointTrajectory,
    controller: str = COMPUTED_TORQUE,
    control_period: float = 0.001,
    checkpoint: Callable[[], None] = lambda: None,
    bandwidth: float = Robustness.bandwidth,
) -> Execution:
    """Return the motion of arms that change from stage to stage, as `executed` does.

    A stage begins with the control period that contains its time; of stages in one period the last
    counts. Positions, velocities and delayed efforts stay.

    Args and errors are those of `executed`; the first stage begins at zero, and its plants are
    those of the execution.
    """
    step = control_period / _STEPS if is_number(control_period) else np.nan
    if not _MIN_PERIOD <= step * _STEPS <= _MAX_PERIOD:
        raise OptionError(
            f"control_period is {in_figures(control_period)} s; give a number from "
            f"{_MIN_PERIOD:g} to {_MAX_PERIOD:g} s"
        )
    if any(len(stage.plants) == 0 for stage in stages):
        raise OptionError("plants is empty; give at least one, as drawn_plants returns")
    make = controller_maker(controller)
    trajectory = trajectory.reordered(stages[0].robot.joint_names)
    periods = int(np.ceil((trajectory.duration + AFTERWARDS) / control_period))
    time = np.arange(periods + 1, dtype=np.float64) * float(control_period)
    begins = [last_instant(time, stage.begin) for stage in stages]
    spans = zip(stages, begins, [*begins[1:], len(time)], strict=True)
    lasting = [(stage, first, stop) for stage, first, stop in spans if first < stop]
    feedback = Feedback(bandwidth, control_period)
    run = _Run(lasting[0][0], time, trajectory.position(time[:1]), step)
    with closing(run):
        for stage, first, stop in lasting:
            if first > 0:
                run.become(stage)
            plan = planned_motion(stage.robot, trajectory, time[first:stop], control_period)
            tracking = make(stage.robot, plan, feedback)
            run.through(range(first, stop), tracking, checkpoint)
    return run.execution


class _Run:
    """The motion of R arms, integrated from control period to control period.

    Attributes:
        execution: The motion, complete after the last period.
    """

    def __init__(self, stage: Stage, time: FloatArray, start: FloatArray, step: float) -> None:
        """Start at rest in a configuration (1, n) with an integration step [s]."""
        arms = mujoco_arms(stage.robot, stage.plants, step)
        for arm in arms:
            arm.place(start[0], np.zeros(stage.robot.joint_count))
        gravity = stage.robot.gravity_effort(start)[0]
        self._drives = Drives(stage.robot, stage.plants, gravity, step)
        self._arms, self._step = ArmsTogether(arms), step
        instants = len(time) + 1, stage.robot.joint_count
        # Errors of measured positions, (R, instants, n), one before the first for its velocity.
        drawn = [
            plant.noise * np.random.default_rng(plant.noise_seed).normal(size=instants)
            for plant in stage.plants
        ]
        self._noise = np.array(drawn)
        shape = self._noise[:, 1:].shape
        position, velocity, effort = np.empty((3, *shape))
        is_saturated = np.zeros(shape, dtype=bool)
        self.execution = Execution(stage.plants, time, position, velocity, effort, is_saturated)

    def close(self) -> None:
        self._arms.close()

    def become(self, stage: Stage) -> None:
        """Change to the arms and the model of a stage."""
        self._arms.become(mujoco_arms(stage.robot, stage.plants, self._step))
        self._drives.become(stage.robot)

    def through(
        self, periods: range, controller: TrackingController, checkpoint: Callable[[], None]
    ) -> None:
        """Integrate control periods; the controller's plan begins with the first."""
        result, noise, drives = self.execution, self._noise, self._drives
        time = result.time
        for k in periods:
            checkpoint()
            result.position[:, k] = q = self._arms.position
            result.velocity[:, k] = v = self._arms.velocity
            jitter = (noise[:, k + 1] - noise[:, k]) / (time[1] - time[0])
            requested = controller.effort(k - periods.start, q + noise[:, k + 1], v + jitter)
            result.effort[:, k], result.is_saturated[:, k] = drives.bounded(requested, q, v)
            effort = np.array([drives.stepped(result.effort[:, k]) for _ in range(_STEPS)])
            self._arms.move(effort, np.flatnonzero((abs(v) < _LOST).all(axis=1)))


# ---- Execution of whole motions: the arms are drawn once, their loads change from step to step.


def executed_cycle(
    motion: Motion,
    errors: Robustness,
    draw: Draw | None = None,
    checkpoint: Callable[[], None] = lambda: None,
) -> Execution:
    """Return the motion of arms that a controller moves through a cycle without a break.

    Loads change at the beginning of the control period of the planned attach or detach. The
    controller knows the nominal payloads, not their errors.

    Args:
        motion: The planned motion, of a cycle or of a problem.
        errors: Sizes of the errors, and the controller.
        draw: Number and seed of the arms; None: 50, from seed 0.
        checkpoint: Called in every control period; may raise to end the work.

    Raises:
        OptionError: MuJoCo is not installed.
        RobotError: Joints of the robot follow others.
    """
    stages = motion_stages(motion, errors, draw or Draw())
    controlled = (errors.controller, errors.control_period)
    return executed_stages(stages, motion.trajectory, *controlled, checkpoint, errors.bandwidth)


def motion_stages(motion: Motion, errors: Robustness, draw: Draw) -> list[Stage]:
    """Return the stages of an execution: a new one where the controller's model changes.

    Every run is one arm all along. Every attached object has a mass error of its own in each run,
    the same each time it is attached.
    """
    if isinstance(motion, ProblemMotion):
        robot = motion.task.robot
        return [Stage(0.0, robot, drawn_plants(robot, errors, draw))]
    # Unmodelled friction is drawn relative to the limits. So the arm without attached payloads has
    # the widest limits of all moves: a move slowed by its limits has the same motors.
    robots = [move.robot for leg in motion.cycle.legs for move in leg.moves]
    widest = {
        name: np.max([getattr(robot.limits, name) for robot in robots], axis=0)
        for name in ("effort", "velocity")
    }
    robot = robots[0].with_limits(replace(robots[0].limits, **widest), robots[0].motors)
    plants, carrier = drawn_plants(robot, errors, draw), robot.link_body[robot.tool_frame]
    factors = _payload_factors(motion.cycle, errors, draw)
    loaded: dict[frozenset[tuple[str, Payload]], list[Plant]] = {}
    stages: list[Stage] = []
    for begin, model, payloads in _arms(motion):
        load = frozenset(payloads.items())
        if load not in loaded:
            loaded[load] = []
            for run, plant in enumerate(plants):
                bodies = list(plant.bodies)
                for name, payload in payloads.items():
                    body = payload_body(robot, payload).scaled(factors[name][run])
                    bodies[carrier] = bodies[carrier].plus(body)
                loaded[load].append(replace(plant, bodies=tuple(bodies)))
        if not stages or stages[-1].robot is not model:
            stages.append(Stage(begin, model, loaded[load]))
    return stages


def _arms(motion: CycleMotion) -> Iterator[tuple[float, RobotModel, Mapping[str, Payload]]]:
    """Yield begin [s], arm and attached payloads at every junction, before and after each step."""
    payloads: Mapping[str, Payload] = {}
    times = iter([mark.time for mark in motion.marks if mark.kind != MOVE])
    for junction, begin in enumerate([0.0, *(end for _, end in motion.leg_times)]):
        stop = motion.cycle.stop_at(junction)
        yield begin, stop.arms[0], payloads
        for step, robot in zip(stop.steps, stop.arms[1:], strict=True):
            if isinstance(step, Attach) and step.payload is not None:
                payloads = {**payloads, step.name: step.payload}
            elif isinstance(step, Detach):
                payloads = {name: load for name, load in payloads.items() if name != step.name}
            yield next(times), robot, payloads


def _payload_factors(cycle: Cycle, errors: Robustness, draw: Draw) -> dict[str, list[float]]:
    """Return the real over the nominal mass of each attached object in each run, by name."""
    names = dict.fromkeys(step.name for step in cycle.steps if isinstance(step, Attach))
    factors: dict[str, list[float]] = {name: [] for name in names}
    # From one on: a seed with zero appended draws the same numbers as the arm's seed.
    for number, name in enumerate(names, start=1):
        for run in range(draw.runs):
            drawn = np.random.default_rng([draw.seed, run, number]).uniform(-1, 1)
            fraction = CORNERS[run] * np.sign(drawn) if run in CORNERS else drawn
            factors[name].append(1 + errors.payload * fraction)
    return factors
