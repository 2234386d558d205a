"""Curves of executed runs: tool paths inside and outside the tube, quantities over time."""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.execution.cycle_verdict import executed_legs
from tubeplanner.execution.excursions import (
    TubeMargins,
    additional_distances,
    obstacle_distances,
    tube_margins,
)
from tubeplanner.execution.simulation import Execution
from tubeplanner.task.cycle_motion import CycleMotion
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

# ---- What there is to draw of an execution: the tool's paths, and quantities of all runs over
# time.

_DISTANCES = 200  # instants at which obstacles are measured


@dataclass(frozen=True, eq=False)
class Band:
    """A quantity of the plan and of R runs, at K instants.

    Attributes:
        time: Shape (K,) [s].
        plan: Shape (K,).
        runs: Shape (R, K).
    """

    time: FloatArray
    plan: FloatArray
    runs: FloatArray


@dataclass(frozen=True, eq=False)
class ToolRuns:
    """Where the tool is in R runs, at K instants.

    Attributes:
        plan: Where it was to be, shape (K, 3) [m].
        runs: Where it is, shape (R, K, 3) [m].
        tube: How far inside the tube that is [m].
        rotation: How far inside the rotation tolerance it is turned [rad], NaN where that is free;
            None where it always is.
    """

    plan: FloatArray
    runs: FloatArray
    tube: Band
    rotation: Band | None

    @property
    def worst(self) -> tuple[int, int]:
        """In which run the tool is farthest out, or least inside, and at which instant."""
        run, instant = np.unravel_index(int(self.tube.runs.argmin()), self.tube.runs.shape)
        return int(run), int(instant)


def tool_runs(
    problem: PlanningProblem, trajectory: JointTrajectory, execution: Execution
) -> ToolRuns:
    """Return where the tool is in all runs, in the frame of the cell."""
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
    found = [tube_margins(problem, time, q, *pose) for q, pose in zip(joints, poses, strict=True)]
    tool = np.array([position for _, position in poses])
    tube = np.array([margins.tube for margins in found])
    return ToolRuns(tool[0], tool[1:], Band(time, tube[0], tube[1:]), _turned(time, found))


def obstacle_band(
    problem: PlanningProblem, trajectory: JointTrajectory, execution: Execution
) -> Band | None:
    """Return how far links are from obstacles [m], at fewer instants; None if none is judged.

    Less what their pair or segment asks beyond `clearance`; NaN while all may be in contact.
    """
    if len(problem.collision.obstacle_pairs) == 0:
        return None
    step = -(-len(execution.time) // _DISTANCES)
    time = execution.time[::step]
    more = additional_distances(problem, trajectory.reordered(problem.robot.joint_names), time)
    joints = [_planned(problem, trajectory, time), *(q[::step] for q in execution.position)]
    bases = [np.zeros(3), *(plant.base for plant in execution.plants)]
    found = np.array(
        [obstacle_distances(problem, q, base, more) for q, base in zip(joints, bases, strict=True)]
    )
    found[np.isinf(found)] = np.nan  # not drawn
    return Band(time, found[0], found[1:])


def _planned(problem: PlanningProblem, trajectory: JointTrajectory, time: FloatArray) -> FloatArray:
    """Return where the joints were to be at times (K,), (K, n): at the goal after the end."""
    ordered = trajectory.reordered(problem.robot.joint_names)
    return ordered.position(np.minimum(time, ordered.duration))


def _turned(time: FloatArray, found: list[TubeMargins]) -> Band | None:
    """Return the margins to the rotation tolerance of the plan, first, and of all runs."""
    bounded = [margins.rotation for margins in found if margins.rotation is not None]
    if not bounded:
        return None
    turned = np.array(bounded)
    turned[np.isinf(turned)] = np.nan  # not drawn
    return Band(time, turned[0], turned[1:])


# ---- The tool's executed paths as short straight lines, those inside the tube and those outside.

_MAX_PATHS = 200
EXECUTED_STEPS = 240  # lines of an executed path
BESIDE_EXECUTED = 0.3  # of its usual thickness: the planned path among executed ones


@dataclass(frozen=True, eq=False)
class ExecutedPaths:
    """The paths of some runs.

    Attributes:
        inside: Lines all in the tube, shape (A, 2, 3) [m].
        outside: The others, shape (B, 2, 3) [m].
        shown: How many runs they are of.
        total: How many runs there were.
    """

    inside: FloatArray
    outside: FloatArray
    shown: int
    total: int


def executed_paths(tools: ToolRuns, steps: int) -> ExecutedPaths:
    """Return the paths of the runs that go farthest out: of all, unless there are very many.

    Args:
        tools: Where the tool is.
        steps: Of how many lines each path is made, at least, if there are as many samples.
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


# ---- The tool's executed paths through a whole cycle.


def cycle_executed_paths(motion: CycleMotion, execution: Execution) -> ExecutedPaths:
    """Return the paths of the runs, outside where they leave the tube of the move that runs."""
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
    return executed_paths(ToolRuns(plan, runs, tube, None), EXECUTED_STEPS * len(legs))
