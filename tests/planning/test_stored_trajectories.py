"""Stored trajectories belong to today's bundled problems; what is stored is listed."""

import pytest
from stored_trajectories import FOLDER, REFRESH, STORED, stored_path, stored_trajectory

from tubeplanner.output.files.fingerprint import problem_hash, robot_hash


@pytest.mark.parametrize(("name", "method"), STORED)
def test_a_stored_trajectory_belongs_to_its_problem(name, method, bundled):
    file, problem = stored_trajectory(name, method), bundled(name)
    hashes = robot_hash(problem.robot), problem_hash(problem)
    assert (file.robot_hash, file.problem_hash) == hashes, (
        f"{stored_path(name, method)} was planned for another {name}: run `{REFRESH}`"
    )


def test_what_is_stored_is_listed():
    assert set(FOLDER.iterdir()) == {stored_path(name, method) for name, method in STORED}
