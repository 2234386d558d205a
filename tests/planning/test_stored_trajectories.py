"""Stored trajectories belong to today's bundled problems; what is stored is listed."""

from dataclasses import replace

import pytest
from cases import study_but
from stored_trajectories import (
    FOLDER,
    REFRESH,
    ROBUST,
    STORED,
    SURVIVORS,
    stored_path,
    stored_problem,
    stored_trajectory,
)

from tubeplanner.execution.error_contributions import simulated_runs
from tubeplanner.execution.plants import Draw
from tubeplanner.execution.run_verdict import run_verdict
from tubeplanner.output.files.fingerprint import problem_hash, robot_hash
from tubeplanner.task.demands import ERRORS


@pytest.mark.parametrize(("name", "method"), STORED)
def test_a_stored_trajectory_belongs_to_its_problem(name, method):
    file, problem = stored_trajectory(name, method), stored_problem(name, method)
    hashes = robot_hash(problem.robot), problem_hash(problem)
    assert (file.robot_hash, file.problem_hash) == hashes, (
        f"{stored_path(name, method)} was planned for another {name}: run `{REFRESH}`"
    )


def test_what_is_stored_is_listed():
    assert set(FOLDER.iterdir()) == {stored_path(name, method) for name, method in STORED}


# Hundreds of motions are simulated: 10 s each.
@pytest.mark.parametrize("name", study_but(["two_link/around_a_post"], SURVIVORS))
def test_a_plan_that_survives_bounds_of_errors_survives_smaller_errors(name):
    """Arms of a fresh seed have nothing, a half and all of every error."""
    problem = stored_problem(name, ROBUST)
    motion, errors = stored_trajectory(name, ROBUST).trajectory, problem.robustness
    for fraction in (0.0, 0.5, 1.0):
        smaller = {error: fraction * getattr(errors, error) for error in ERRORS}
        draw = Draw(100 if fraction else 2, seed=1951)
        runs = simulated_runs(problem, motion, replace(errors, **smaller), draw)
        assert not run_verdict(runs).failed, f"{fraction}: {run_verdict(runs)}"
