"""Curves of executed runs: tool paths inside and outside the tube, quantities over time."""

from dataclasses import dataclass, replace

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.execution.excursions import additional_distances, obstacle_distances, tube_margins
from tubeplanner.execution.held_parts import executed_uses
from tubeplanner.execution.run_verdict import executed_legs
from tubeplanner.execution.simulation import Execution
from tubeplanner.task.motion import Motion
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

_DISTANCES = 200  # instants at which obstacle distances are measured


@dataclass(frozen=True, eq=False)
class Band:
    """A quantity of the plan and of R runs, at K instants."""

    time: FloatArray  # shape (K,) [s]
    plan: FloatArray  # shape (K,)
    runs: FloatArray  # shape (R, K)


@dataclass(frozen=True, eq=False)
class ToolRuns:
    """Positions of the tool in R runs, at K instants."""

    plan: FloatArray  # planned position, shape (K, 3) [m]
    runs: FloatArray  # executed positions, shape (R, K, 3) [m]
    tube: Band  # margin inside the tube [m]
    # margin inside the rotation tolerance [rad], NaN where rotation is free; None: always free
    rotation: Band | None

    @property
    def worst(self) -> tuple[int, int]:
        """Run and instant of the least margin inside the tube."""
        run, instant = np.unravel_index(int(self.tube.runs.argmin()), self.tube.runs.shape)
        return int(run), int(instant)


def tool_runs(
    problem: PlanningProblem, trajectory: JointTrajectory, execution: Execution
) -> ToolRuns:
    """Return the positions and margins of the tool in all runs, in the frame of the cell."""
    robot, time = problem.robot, execution.time
    planned = _planned(problem, trajectory, time)
    poses = [
        problem.tube.tool_pose(robot, planned, time),
        *(
            plant.displaced(*problem.tube.tool_pose(robot, q, time))
            for plant, q in zip(execution.plants, execution.position, strict=True)
        ),
    ]
    joints = [planned, *execution.position]
    margins = [tube_margins(problem, time, q, *pose) for q, pose in zip(joints, poses, strict=True)]
    tool = np.array([position for _, position in poses])
    tube = np.array([inside for inside, _ in margins])
    bounded = [rotation for _, rotation in margins if rotation is not None]
    rotation = None
    if bounded:
        rows = np.array(bounded)
        rows[np.isinf(rows)] = np.nan  # not drawn
        rotation = Band(time, rows[0], rows[1:])
    return ToolRuns(tool[0], tool[1:], Band(time, tube[0], tube[1:]), rotation)


def obstacle_band(
    problem: PlanningProblem, trajectory: JointTrajectory, execution: Execution
) -> Band | None:
    """Return the distances of links from obstacles [m], at fewer instants; None if not judged.

    Distances that pairs or segments require beyond `clearance` are subtracted; NaN while every
    pair may be in contact.
    """
    if len(problem.collision.obstacle_pairs) == 0:
        return None
    step = -(-len(execution.time) // _DISTANCES)
    time = execution.time[::step]
    more = additional_distances(problem, trajectory.reordered(problem.robot.joint_names), time)
    joints = [_planned(problem, trajectory, time), *(q[::step] for q in execution.position)]
    bases = [np.zeros(3), *(plant.base for plant in execution.plants)]
    distance = np.array(
        [obstacle_distances(problem, q, base, more) for q, base in zip(joints, bases, strict=True)]
    )
    distance[np.isinf(distance)] = np.nan  # not drawn
    return Band(time, distance[0], distance[1:])


_LEAST_SPARE = -1.0  # twice of what a contact carries; beyond, curves would hide the others


def holding_band(
    problem: PlanningProblem, trajectory: JointTrajectory, execution: Execution
) -> Band | None:
    """Return the spare share of what contacts carry at safety 1; None: no part is held.

    Of several contacts the least; at least -1.
    """
    if not problem.holding:
        return None
    plant = replace(execution.plants[0], contact_friction=1.0, part_mass=1.0)
    ordered = trajectory.reordered(problem.robot.joint_names)
    time = np.minimum(execution.time, ordered.duration)
    speed = ordered.velocity(time) * (execution.time <= ordered.duration)[:, None]
    q = ordered.position(time)
    plan = replace(execution, plants=[plant], position=q[None], velocity=speed[None])
    runs = [(plan, 0), *((execution, run) for run in range(len(execution.plants)))]
    spare = np.array(
        [
            1 - np.max([use.share for use in executed_uses(problem, each, run)], axis=0)
            for each, run in runs
        ]
    ).clip(min=_LEAST_SPARE)
    return Band(execution.time, spare[0], spare[1:])


def _planned(problem: PlanningProblem, trajectory: JointTrajectory, time: FloatArray) -> FloatArray:
    """Return the planned positions at times (K,), (K, n): at the goal after the end."""
    ordered = trajectory.reordered(problem.robot.joint_names)
    return ordered.position(np.minimum(time, ordered.duration))


# ---- The tool's executed paths as short straight lines, inside and outside the tube.

_MAX_PATHS = 200
_EXECUTED_STEPS = 240  # lines of an executed path
BESIDE_EXECUTED = 0.3  # of its usual thickness: the planned path among executed ones


@dataclass(frozen=True, eq=False)
class ExecutedPaths:
    """The paths of some runs."""

    inside: FloatArray  # lines entirely in the tube, shape (A, 2, 3) [m]
    outside: FloatArray  # the others, shape (B, 2, 3) [m]
    shown: int  # number of runs that are drawn
    total: int  # number of runs


def executed_paths(tools: ToolRuns, steps: int) -> ExecutedPaths:
    """Return the paths of the runs that go farthest out, of at most 200 runs.

    Each has at least a number of lines, if there are as many samples.
    """
    order = np.argsort(tools.tube.runs.min(axis=1), kind="stable")[:_MAX_PATHS]
    count = tools.runs.shape[1] - 1
    step = max(1, count // steps)
    first = np.arange(0, count, step)
    ends = np.stack([first, np.minimum(first + step, count)], axis=1)
    margins = tools.tube.runs[order]
    least = np.minimum(margins[:, first], np.minimum.reduceat(margins[:, 1:], first, axis=1))
    lines = tools.runs[order][:, ends]
    return ExecutedPaths(lines[least >= 0], lines[least < 0], len(order), len(tools.runs))


def motion_paths(motion: Motion, execution: Execution) -> ExecutedPaths:
    """Return the paths of a motion's runs, outside where a run leaves the tube of its section."""
    legs = executed_legs(motion, execution)
    tools = [tool_runs(leg.problem, leg.trajectory, leg.execution) for leg in legs]
    tubes = [tool.tube for tool in tools]
    times = [leg.begin + tube.time for leg, tube in zip(legs, tubes, strict=True)]
    tube = Band(
        np.concatenate(times),
        np.concatenate([each.plan for each in tubes]),
        np.hstack([each.runs for each in tubes]),
    )
    plan = np.concatenate([tool.plan for tool in tools])
    runs = np.concatenate([tool.runs for tool in tools], axis=1)
    return executed_paths(ToolRuns(plan, runs, tube, None), _EXECUTED_STEPS * len(legs))
