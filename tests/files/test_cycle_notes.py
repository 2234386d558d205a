"""What is said of a cycle's file that was made for another."""

import pytest

from small_cycle import planned_cycle, small_cycle
from tubeplanner.files.cycle_notes import notes_on_cycle_file
from tubeplanner.files.cycle_writer import cycle_contents
from tubeplanner.files.trajectory_writer import TrajectoryFiles
from tubeplanner.trajectory.trajectory_file import TrajectoryFile, read_trajectory_file


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("files") / "t.json"
    contents, _ = cycle_contents(TrajectoryFiles(path), planned_cycle().motion, "refinement")
    path.write_bytes(contents[path])
    return read_trajectory_file(path)


def test_nothing_is_said_of_what_was_made_for_it_or_does_not_say(file):
    assert notes_on_cycle_file(small_cycle(), file) == []
    assert notes_on_cycle_file(small_cycle(), TrajectoryFile(file.trajectory)) == []


def test_what_differs_is_named(file):
    (note,) = notes_on_cycle_file(small_cycle(moves__back__tube__radius=0.2), file)
    assert note == "the trajectory was made for another cycle; what differs: tube of move 'back'"


def test_without_hashes_of_parts_it_is_known_that_it_differs(file):
    alone = TrajectoryFile(file.trajectory, None, file.problem_hash, file.robot_hash)
    (note,) = notes_on_cycle_file(small_cycle(closed=False), alone)
    assert note == "the trajectory was made for another cycle with this robot"
    (note,) = notes_on_cycle_file(small_cycle(robot__limits__acceleration=500.0), alone)
    assert note.startswith("the trajectory was made for another robot, payload")
