"""What there is to draw of an execution: the tool's paths, and quantities of all runs over time."""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.simulation.executed_clearance import additional_distances, obstacle_distances
from tubeplanner.simulation.executed_tube import TubeMargins, tube_margins
from tubeplanner.simulation.execution import Execution
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

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
        robot.tool_pose(planned),
        *(
            plant.tool_pose(robot, q)
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
