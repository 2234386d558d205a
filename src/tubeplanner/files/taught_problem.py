"""The problem that a recorded trail belongs to: a robot and its cell, from the trail's ends."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import TrajectoryError
from tubeplanner.files.problem_file import included_fields, new_fields, read_fields
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.problem.problem_format import check_problem_fields
from tubeplanner.problem.problem_reader import parse_problem, robot_of
from tubeplanner.resources import find_problem
from tubeplanner.trajectory.trajectory_file import TrajectoryFile
from tubeplanner.tube_sources.trail import joint_trail

_FOUND = ("tube", "start", "goal")  # by a trail
_SAMPLES_PER_PIECE = 20  # of a trail that is a trajectory of ours


@dataclass(frozen=True, eq=False)
class Cell:
    """A robot and its surroundings, as a problem file has them.

    Attributes:
        fields: What the problem file itself holds, without tube, start and goal.
        known: What it holds with the files that it includes, likewise.
        folder: Where its relative paths start.
        source: What messages call it.
    """

    fields: Any
    known: Any
    folder: Path
    source: str


def read_cell(
    urdf: str | None,
    tool_frame: str | None,
    obstacles: Path | None,
    template: str | None,
    changes: Mapping[str, Any] | None = None,
) -> Cell:
    """Return the cell of a problem file, or of a robot and a file of obstacles.

    Args:
        urdf: As `robot.urdf`; None if a template is given.
        tool_frame: As `robot.tool_frame`; likewise.
        obstacles: A file that holds obstacles; None: there are none.
        template: Problem file; None if a robot is given.
        changes: Other values of the problem file, by field path.

    Raises:
        ProblemError: A file cannot be read, or a path leads nowhere.
    """
    if template is not None:
        path = find_problem(template, Path())
        fields = read_fields(path, changes)
        for key in _FOUND:
            fields.pop(key, None)
        return _cell(fields, path.parent, str(path))
    assert urdf is not None and tool_frame is not None
    return _cell(new_fields(urdf, tool_frame, obstacles), Path(), "teach")


def _cell(fields: Any, folder: Path, source: str) -> Cell:
    merged = included_fields(fields, folder)
    known = {key: value for key, value in merged.items() if key not in _FOUND}
    return Cell(fields, known, folder, source)


def taught_problem(
    cell: Cell, read: TrajectoryFile, source: str
) -> tuple[PlanningProblem, FloatArray]:
    """Return the problem from a trail's start to its end, the tool anywhere, and the trail (N, n).

    Args:
        cell: The robot and its surroundings.
        read: The file of the trail.
        source: What messages call that file.

    Raises:
        ProblemError: The cell contradicts its format or itself.
        RobotError: The robot cannot be planned with.
        TrajectoryError: The trail is not of this robot.
    """
    ends: dict[str, Any] = {"start": {"joints": []}, "goal": {"joints": []}}
    robot = robot_of(check_problem_fields({**cell.known, **ends}, cell.source), cell.folder)
    trajectory = read.trajectory
    if read.interpolation is None:
        samples = trajectory.per_piece(_SAMPLES_PER_PIECE).position
    else:
        samples = trajectory.position(trajectory.breakpoints)
    try:
        trail = joint_trail(robot, trajectory.joint_names, samples)
    except TrajectoryError as error:
        raise TrajectoryError(f"{source}: {error}") from None
    ends = {"start": {"joints": trail[0].tolist()}, "goal": {"joints": trail[-1].tolist()}}
    name = Path(source).stem
    return parse_problem({**cell.known, **ends}, cell.folder, name, reads_tube=False), trail
