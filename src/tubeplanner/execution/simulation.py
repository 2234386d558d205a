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
    Draw,
    Plant,
    Stage,
    drawn_plants,
    last_instant,
    payload_body,
)
from tubeplanner.execution.tracking import (
    Drives,
    TrackingController,
    controller_maker,
    planned_motion,
)
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.pinocchio_model import Payload
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.cycle_motion import CycleMotion
from tubeplanner.task.demands import COMPUTED_TORQUE, Robustness
from tubeplanner.task.legs import RestStep
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.steps import Attach, Detach
from tubeplanner.text import short_repr
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.parts import MOVE

# ---- Trajectories executed by simulated arms under control.

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
    stages = [Stage(0.0, problem.robot, plants)]
    return executed_stages(stages, trajectory, controller, control_period, checkpoint)


def executed_stages(
    stages: Sequence[Stage],
    trajectory: JointTrajectory,
    controller: str = COMPUTED_TORQUE,
    control_period: float = 0.001,
    checkpoint: Callable[[], None] = lambda: None,
) -> Execution:
    """Return what `executed` does, of arms that become others on their way.

    A stage begins with the control period in which its time lies; of stages that begin in one, the
    last. Positions, velocities, and what is on its way to the motors stay.

    Args:
        stages: One after the other, the first from zero on; its plants are those of the execution.
        trajectory: As for `executed`.
        controller: As for `executed`; it knows what the stages' robots carry.
        control_period: As for `executed`.
        checkpoint: As for `executed`.

    Raises:
        OptionError: As `executed`.
        RobotError: As `executed`.
        TrajectoryError: As `executed`.
    """
    step = control_period / _STEPS if is_number(control_period) else np.nan
    if not _LEAST_PERIOD <= step * _STEPS <= _MAX_PERIOD:
        raise OptionError(
            f"control_period is {in_figures(control_period)} s; give a number from "
            f"{_LEAST_PERIOD:g} to {_MAX_PERIOD:g} s"
        )
    if any(len(stage.plants) == 0 for stage in stages):
        raise OptionError("plants is empty; give at least one, as drawn_plants returns")
    make = controller_maker(controller)
    trajectory = trajectory.reordered(stages[0].robot.joint_names)
    periods = int(np.ceil((trajectory.duration + AFTERWARDS) / control_period))
    time = np.arange(periods + 1, dtype=np.float64) * float(control_period)
    lasting = _lasting(stages, time)
    run = _begun(lasting[0][0], time, trajectory.position(time[:1]), step)
    with closing(run):
        for stage, first, stop in lasting:
            if first > 0:
                run.become(stage)
            plan = planned_motion(stage.robot, trajectory, time[first:stop], control_period)
            run.through(range(first, stop), make(stage.robot, plan), checkpoint)
    return run.execution


def _lasting(stages: Sequence[Stage], time: FloatArray) -> list[tuple[Stage, int, int]]:
    """Return stages that last, each with its first control period and the one after its last."""
    begins = [last_instant(time, stage.begin) for stage in stages]
    ends = [*begins[1:], len(time)]
    found = zip(stages, begins, ends, strict=True)
    return [(stage, first, stop) for stage, first, stop in found if first < stop]


def _begun(stage: Stage, time: FloatArray, start: FloatArray, step: float) -> "_Run":
    """Return a run at rest in a configuration (1, n), integration steps [s] being so long."""
    arms = mujoco_arms(stage.robot, stage.plants, step)
    for arm in arms:
        arm.place(start[0], np.zeros(stage.robot.joint_count))
    held = stage.robot.gravity_effort(start)[0]
    drives = Drives(stage.robot, stage.plants, held, step)
    return _Run(stage.plants, time, ArmsTogether(arms), drives, step)


class _Run:
    """What R arms do, from control period to control period.

    Attributes:
        execution: All of it, once all periods are over.
    """

    def __init__(
        self,
        plants: Sequence[Plant],
        time: FloatArray,
        arms: ArmsTogether,
        drives: Drives,
        step: float,
    ) -> None:
        self._arms, self._drives, self._step = arms, drives, step
        self._noise = _noise(plants, len(time) + 1, arms.position.shape[1])
        shape = self._noise[:, 1:].shape
        position, velocity, effort = np.empty((3, *shape))
        is_saturated = np.zeros(shape, dtype=bool)
        self.execution = Execution(plants, time, position, velocity, effort, is_saturated)

    def close(self) -> None:
        """End the arms' threads."""
        self._arms.close()

    def become(self, stage: Stage) -> None:
        """Go on with a stage."""
        self._arms.become(mujoco_arms(stage.robot, stage.plants, self._step))
        self._drives.become(stage.robot)

    def through(
        self, periods: range, controller: TrackingController, checkpoint: Callable[[], None]
    ) -> None:
        """Go through control periods, of which the controller knows the plan."""
        made, noise, drives = self.execution, self._noise, self._drives
        time = made.time
        for k in periods:
            checkpoint()
            made.position[:, k] = q = self._arms.position
            made.velocity[:, k] = v = self._arms.velocity
            jitter = (noise[:, k + 1] - noise[:, k]) / (time[1] - time[0])
            asked = controller.effort(k - periods.start, q + noise[:, k + 1], v + jitter)
            made.effort[:, k], made.is_saturated[:, k] = drives.bounded(asked, q, v)
            given = np.array([drives.stepped(made.effort[:, k]) for _ in range(_STEPS)])
            self._arms.move(given, np.flatnonzero((abs(v) < _LOST).all(axis=1)))


def _noise(plants: Sequence[Plant], instants: int, joints: int) -> FloatArray:
    """Return the errors of measured positions, shape (R, instants, n)."""
    generators = (np.random.default_rng(plant.noise_seed) for plant in plants)
    drawn = [
        plant.noise * random.normal(size=(instants, joints))
        for plant, random in zip(plants, generators, strict=True)
    ]
    return np.array(drawn)


# ---- The arms that execute a cycle: drawn once, with what they carry from step to step.


def cycle_stages(motion: CycleMotion, errors: Robustness, draw: Draw) -> list[Stage]:
    """Return the stages of the execution of a cycle: a new one where the arm becomes another.

    Every run is one arm all along. What it takes has an error of its own, the same whenever it is
    taken again.

    Args:
        motion: The planned motion.
        errors: Sizes of the errors.
        draw: How many arms, and which.
    """
    robot = _plain_arm(motion.cycle)
    plants = drawn_plants(robot, errors, draw)
    shares = _payload_shares(motion.cycle, errors, draw)
    loaded: dict[frozenset[tuple[str, Payload]], list[Plant]] = {}
    stages: list[Stage] = []
    for arm in _arms(motion):
        load = frozenset(arm.payloads.items())
        if load not in loaded:
            runs = range(draw.runs)
            factors = [{name: share[run] for name, share in shares.items()} for run in runs]
            loaded[load] = [
                _carrying(plants[run], robot, arm.payloads, factors[run]) for run in runs
            ]
        stage = Stage(arm.begin, arm.robot, loaded[load])
        if not stages or stages[-1].robot is not stage.robot:
            stages.append(stage)
    return stages


@dataclass(frozen=True, eq=False)
class _Arm:
    """The arm that is planned with, from some time on.

    Attributes:
        begin: From when on [s].
        robot: With what it carries.
        payloads: What steps have attached of it, by name.
    """

    begin: float
    robot: RobotModel
    payloads: Mapping[str, Payload]


def _arms(motion: CycleMotion) -> Iterator[_Arm]:
    """Yield the arm as it is at every seam, before all that happens there and after each step."""
    payloads: Mapping[str, Payload] = {}
    times = iter([mark.time for mark in motion.marks if mark.kind != MOVE])
    for seam, begin in enumerate([0.0, *(end for _, end in motion.leg_times)]):
        rest = motion.cycle.rest_at(seam)
        yield _Arm(begin, rest.arms[0], payloads)
        for step, robot in zip(rest.steps, rest.arms[1:], strict=True):
            payloads = _after(step, payloads)
            yield _Arm(next(times), robot, payloads)


def _after(step: RestStep, payloads: Mapping[str, Payload]) -> Mapping[str, Payload]:
    """Return what is carried after a step."""
    if isinstance(step, Attach) and step.payload is not None:
        return {**payloads, step.name: step.payload}
    if isinstance(step, Detach):
        return {name: load for name, load in payloads.items() if name != step.name}
    return payloads


def _plain_arm(cycle: Cycle) -> RobotModel:
    """Return the arm without what steps attach, with the widest limits of all moves.

    Friction that nobody gave is drawn in shares of limits: a slowed move is no other motor's.
    """
    robots = [move.robot for leg in cycle.legs for move in leg.moves]
    widest = {
        name: np.max([getattr(robot.limits, name) for robot in robots], axis=0)
        for name in ("effort", "velocity")
    }
    return robots[0].with_limits(replace(robots[0].limits, **widest), robots[0].motors)


def _payload_shares(cycle: Cycle, errors: Robustness, draw: Draw) -> dict[str, list[float]]:
    """Return how much of its mass everything that is taken has, in each run, by name."""
    names = [step.name for step in cycle.steps if isinstance(step, Attach)]
    return {
        name: [
            1 + np.random.default_rng([draw.seed, run, number]).uniform(-1, 1) * errors.payload
            for run in range(draw.runs)
        ]
        # From one on: zero at the end draws what draws the arm.
        for number, name in enumerate(dict.fromkeys(names), start=1)
    }


def _carrying(
    plant: Plant, robot: RobotModel, payloads: Mapping[str, Payload], shares: Mapping[str, float]
) -> Plant:
    """Return an arm that carries payloads, each times its share."""
    carrier, bodies = robot.link_body[robot.tool_frame], list(plant.bodies)
    for name, payload in payloads.items():
        load = payload_body(robot, payload).scaled(shares[name])
        bodies[carrier] = bodies[carrier].plus(load)
    return replace(plant, bodies=tuple(bodies))


# ---- Whole cycles executed by arms that are drawn at random.


def executed_cycle(
    motion: CycleMotion,
    errors: Robustness,
    draw: Draw | None = None,
    checkpoint: Callable[[], None] = lambda: None,
) -> Execution:
    """Return what arms do that a controller moves through a cycle without a break.

    What the tool takes is in it, and what it lets go is gone, from the beginning of the control
    period on in which that is planned; the controller knows of it, and not what it really weighs.

    Args:
        motion: The planned motion.
        errors: Sizes of the errors, and the controller.
        draw: How many arms, and which; None: 50, from seed 0.
        checkpoint: Called in every control period; may raise to end the work.

    Raises:
        OptionError: MuJoCo is not installed.
        RobotError: Joints of the robot follow others.
    """
    stages = cycle_stages(motion, errors, draw or Draw())
    controlled = (errors.controller, errors.control_period)
    return executed_stages(stages, motion.trajectory, *controlled, checkpoint)
