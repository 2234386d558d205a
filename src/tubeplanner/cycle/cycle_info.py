"""What is in a cycle file: its robot, whatever limits are missing, and its moves if it loads."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tubeplanner.cycle.cycle import Cycle
from tubeplanner.cycle.cycle_format import CycleFields, check_cycle_fields
from tubeplanner.cycle.cycle_reader import load_cycle
from tubeplanner.cycle.leg import Leg
from tubeplanner.cycle.step_text import step_text
from tubeplanner.errors import ProblemError, RobotError
from tubeplanner.problem.problem import PlanningProblem, end_kind
from tubeplanner.problem.problem_fields import changed_problem
from tubeplanner.problem.problem_info import SrdfInfo, srdf_info
from tubeplanner.problem.problem_layers import ProblemLayers
from tubeplanner.problem.problem_reader import robot_arguments
from tubeplanner.resources import find_problem
from tubeplanner.robot.robot_info import RobotInfo, robot_info


@dataclass(frozen=True)
class CycleInfo:
    """What is in a cycle file.

    Attributes:
        robot: Its robot.
        srdf: What its SRDF has; None without one.
        cycle: The cycle; None if it does not load.
        refused: Why it does not load; None if it does.
    """

    robot: RobotInfo
    srdf: SrdfInfo | None
    cycle: Cycle | None
    refused: str | None

    @property
    def problem(self) -> PlanningProblem | None:
        """The planning problem of its first leg; None if it does not load."""
        return None if self.cycle is None else self.cycle.problem_from_anywhere(0)

    def as_dict(self) -> dict[str, Any]:
        """Return all of it as JSON values."""
        srdf = None if self.srdf is None else self.srdf.as_dict()
        task = None if self.cycle is None else _task(self.cycle)
        return {**self.robot.as_dict(), "srdf": srdf, "refused": self.refused, "cycle": task}


def cycle_info(name: str | Path, changes: Mapping[str, Any] | None = None) -> CycleInfo:
    """Return what is in a cycle file.

    Args:
        name: A path, or `example:ROBOT/NAME`.
        changes: Other values, by field path.

    Raises:
        ProblemError: The file cannot be read or contradicts its format.
        RobotError: Its URDF, its SRDF or a file of limits cannot be read.
    """
    path = find_problem(name, Path())
    layers = ProblemLayers.read(path)
    data = changed_problem(layers.merged, changes, CycleFields)
    fields = check_cycle_fields(data, layers.sources[-1], layers.source_of)
    robot = robot_info(**robot_arguments(fields.robot, path.parent))
    srdf = srdf_info(fields.robot, path.parent)
    try:
        cycle = load_cycle(name, changes=changes)
    except (ProblemError, RobotError) as error:
        return CycleInfo(robot, srdf, None, str(error))
    return CycleInfo(robot, srdf, cycle, None)


def _task(cycle: Cycle) -> dict[str, Any]:
    """Return start, moves and rests, and solids of a cycle as JSON values."""
    return {
        "name": cycle.name,
        "start": end_kind(cycle.start),
        "closed": cycle.closed,
        "period": cycle.period,
        "obstacles": [str(obstacle) for obstacle in cycle.obstacles],
        "attached": [str(solid) for solid in cycle.attached],
        "legs": [_leg(cycle, k, leg) for k, leg in enumerate(cycle.legs)],
        "after": [step_text(step) for step in cycle.after.steps],
    }


def _leg(cycle: Cycle, k: int, leg: Leg) -> dict[str, Any]:
    """Return what happens before a leg, its moves, and what is carried in it."""
    payload = leg.robot.payload
    return {
        "before": [step_text(step) for step in leg.before.steps],
        "moves": [
            {
                "name": move.name,
                "points": move.tube.points.tolist(),
                "length": float(np.linalg.norm(np.diff(move.tube.points, axis=0), axis=1).sum()),
                "goal": None if move.goal is None else end_kind(move.goal),
            }
            for move in leg.moves
        ],
        "payload": None if payload is None else {"mass": payload.mass, "com": list(payload.com)},
        "attached": [solid.name for solid in cycle.problem_from_anywhere(k).attached],
    }
