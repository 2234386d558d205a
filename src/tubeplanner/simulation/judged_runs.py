"""What becomes of a plan's promises when it is executed: seen in n runs, not proved."""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.outcome import Place
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.simulation.executed_clearance import least_clearances
from tubeplanner.simulation.executed_tube import Extreme, tube_excursions
from tubeplanner.simulation.execution import Execution
from tubeplanner.trajectory.joint_trajectory import JointTrajectory


@dataclass(frozen=True)
class JudgedRun:
    """One executed motion, at every control period.

    Attributes:
        tube: Largest excursion of the tool beyond the tube [m]; below zero: inside by as much.
        rotation: Likewise beyond the rotation tolerance [rad]; None where the tube has none.
        points: Likewise of the compulsory point that is passed the farthest [m]; None: none.
        tracking: Largest distance of a joint from the plan [rad or m].
        tool_tracking: Largest distance of the tool from the plan [m].
        saturated: Share of the control periods in which a motor was asked for more than it has.
        obstacles: Least distance of a link from an obstacle [m]; None where none is judged.
        self_collision: Least distance of links from each other [m]; None likewise.
    """

    tube: Extreme
    rotation: Extreme | None
    points: Extreme | None
    tracking: Extreme
    tool_tracking: Extreme
    saturated: float
    obstacles: Extreme | None
    self_collision: Extreme | None

    @property
    def stays_inside(self) -> bool:
        """Whether the tool keeps tube, rotation tolerance and compulsory points."""
        asked = (self.tube, self.rotation, self.points)
        return all(extreme is None or extreme.value <= 0 for extreme in asked)

    @property
    def collides(self) -> bool:
        """Whether a link meets an obstacle or another link."""
        met = (self.obstacles, self.self_collision)
        return any(extreme is not None and extreme.value <= 0 for extreme in met)


def judged_runs(
    problem: PlanningProblem, trajectory: JointTrajectory, execution: Execution
) -> list[JudgedRun]:
    """Judge executed motions, one after the other.

    The tube is the problem's, in the frame of the cell: errors of tool and base count.

    Args:
        problem: The planning problem.
        trajectory: What was to be executed.
        execution: What was.
    """
    trajectory = trajectory.reordered(problem.robot.joint_names)
    planned = trajectory.position(np.minimum(execution.time, trajectory.duration))
    aim = problem.robot.tool_position(planned)
    runs = range(len(execution.plants))
    return [_judged(problem, execution, run, planned, aim) for run in runs]


def _judged(
    problem: PlanningProblem, execution: Execution, run: int, planned: FloatArray, aim: FloatArray
) -> JudgedRun:
    time, q, plant = execution.time, execution.position[run], execution.plants[run]
    rotation, position = problem.robot.tool_pose(q)
    tool = position + rotation @ plant.tool + plant.base
    excursions = tube_excursions(problem, time, q, rotation, tool)
    obstacles, self_collision = least_clearances(problem, time, q, plant.base)
    away = np.linalg.norm(tool - aim, axis=1)
    farthest = int(away.argmax())
    behind = abs(q - planned)
    late, joint = np.unravel_index(int(behind.argmax()), behind.shape)
    where = Place(time=float(time[late]), joint=problem.robot.joint_names[joint])
    return JudgedRun(
        excursions.tube,
        excursions.rotation,
        excursions.points,
        Extreme(float(behind[late, joint]), where),
        Extreme(float(away[farthest]), Place(time=float(time[farthest]))),
        float(execution.is_saturated[run].any(axis=1).mean()),
        obstacles,
        self_collision,
    )
