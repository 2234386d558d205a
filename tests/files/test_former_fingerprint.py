"""Files made before hashes came from contents alone are still recognised."""

import shutil
from dataclasses import replace

import pytest

from tubeplanner import Obstacle, placement_of
from tubeplanner.files.file_notes import notes_on_file
from tubeplanner.files.fingerprint import problem_hash, robot_hash
from tubeplanner.files.former_fingerprint import former_problem_hash, is_former_hash
from tubeplanner.resources import bundled_folder
from tubeplanner.trajectory.trajectory_file import TrajectoryFile

PART = bundled_folder() / "ur5" / "part.stl"
# What files of these problems stated.
FORMER = {
    "panda/between_shelves": "a20fe9cb76440e70",
    "two_link/around_a_post": "7b04bfdadbdc6b2f",
    "two_link/paper_1_30mm": "1f510a393e8ee9d0",
    "ur10/onto_a_conveyor": "4af6674d06ec8cec",
    "ur5/over_the_wall": "9c4cfded44a2d088",
    "xarm7/from_crate_to_crate": "e788c653c5d9322c",
}


@pytest.mark.parametrize("name", FORMER)
def test_former_hashes_are_made_as_they_were(name, bundled):
    """Whatever covers links and chooses pairs today."""
    problem = bundled(name)
    assert former_problem_hash(problem) == FORMER[name]
    assert is_former_hash(FORMER[name])
    assert not is_former_hash(problem_hash(problem))


def test_a_file_of_an_earlier_version_is_told_from_one_of_another_problem(stored):
    problem, trajectory = stored("two_link/around_a_post")
    made = {"robot_hash": robot_hash(problem.robot)}
    earlier = TrajectoryFile(trajectory, problem_hash=FORMER["two_link/around_a_post"], **made)
    assert notes_on_file(problem, earlier, failed=False) == [
        "the trajectory was made by an earlier version of tubeplanner for the same problem"
    ]
    assert notes_on_file(replace(problem, clearance=0.001), earlier, failed=False) == [
        "the trajectory was made for another problem with this robot"
    ]


def test_without_its_meshes_nobody_can_tell(stored, tmp_path):
    problem, trajectory = stored("two_link/around_a_post")
    path = shutil.copy(PART, tmp_path)
    problem = replace(problem, obstacles=[Obstacle.mesh("part", path, placement_of([3, 0, 0]))])
    made = {"robot_hash": robot_hash(problem.robot)}
    earlier = TrajectoryFile(trajectory, problem_hash=former_problem_hash(problem), **made)
    (note,) = notes_on_file(problem, earlier, failed=False)
    assert note.endswith("for the same problem")
    (tmp_path / "part.stl").unlink()
    (note,) = notes_on_file(problem, earlier, failed=False)
    assert note.startswith("the trajectory was made by an earlier version of tubeplanner; whether")
