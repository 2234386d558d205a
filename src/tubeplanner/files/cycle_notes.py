"""Notes about the trajectory file of a cycle, besides its certificate."""

from tubeplanner.cycle.cycle import Cycle
from tubeplanner.files.cycle_fingerprint import cycle_hash, differing_cycle_parts
from tubeplanner.files.fingerprint import robot_hash
from tubeplanner.trajectory.trajectory_file import TrajectoryFile


def notes_on_cycle_file(cycle: Cycle, file: TrajectoryFile) -> list[str]:
    """Return a sentence if a trajectory was not made for the cycle; none if it does not say."""
    is_other_robot = file.robot_hash not in (None, robot_hash(cycle.robot))
    if not is_other_robot and file.problem_hash in (None, cycle_hash(cycle)):
        return []
    if differing := differing_cycle_parts(cycle, file.part_hashes):
        return [f"the trajectory was made for another cycle; what differs: {', '.join(differing)}"]
    if is_other_robot:
        return ["the trajectory was made for another robot, payload, limits or motors"]
    return ["the trajectory was made for another cycle with this robot"]
