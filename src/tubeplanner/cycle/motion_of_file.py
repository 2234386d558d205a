"""The motion of a cycle from a trajectory file."""

from pathlib import Path

from tubeplanner.cycle.cycle import Cycle
from tubeplanner.cycle.cycle_motion import CycleMotion
from tubeplanner.errors import TrajectoryError
from tubeplanner.trajectory.trajectory_file import TrajectoryFile, read_trajectory_file


def read_cycle_motion(path: str | Path, cycle: Cycle) -> CycleMotion:
    """Read the motion of a cycle from a trajectory file that has marks.

    Args:
        path: The file, JSON as `write_cycle_motion` or `plan -o` writes it.
        cycle: What it is a motion of.

    Raises:
        TrajectoryError: It cannot be read; or as `motion_of_file`.
    """
    Cycle.require(cycle)
    file = read_trajectory_file(path, cycle.robot.joint_names)
    return motion_of_file(cycle, Path(path), file)


def motion_of_file(cycle: Cycle, path: Path, file: TrajectoryFile) -> CycleMotion:
    """Return the motion that a file holds.

    Args:
        cycle: The cycle.
        path: The file; messages name it.
        file: What it holds.

    Raises:
        TrajectoryError: It has no marks, or others than the cycle's steps, or other joints.
    """
    if not file.marks:
        raise TrajectoryError(
            f"{path} has no marks, which say when the moves of a cycle begin and what the tool "
            "takes and lets go; CSV and ROS files have none: give the JSON that plan -o writes"
        )
    try:
        return CycleMotion(cycle, file.trajectory, file.marks)
    except TrajectoryError as error:
        raise TrajectoryError(f"{path}: {error}") from None
