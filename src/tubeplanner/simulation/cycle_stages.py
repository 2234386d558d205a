"""The arms that execute a cycle: drawn once, with what they carry from step to step."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from tubeplanner.cycle.cycle import Cycle
from tubeplanner.cycle.cycle_motion import CycleMotion
from tubeplanner.cycle.leg import RestStep
from tubeplanner.cycle.steps import Attach, Detach
from tubeplanner.problem.robustness import Robustness
from tubeplanner.robot.pinocchio_model import Payload
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.simulation.plant import Draw, Plant, drawn_plants, payload_body
from tubeplanner.simulation.stage import Stage
from tubeplanner.trajectory.marks import MOVE


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
