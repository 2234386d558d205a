"""Trajectories that tests only look at: planned once, stored, judged against their problems.

Run as a program, it plans them again, or those whose problems are named: needed when a bundled
problem changes; `test_stored_trajectories` says so. From the checkout:
python tests/helpers/stored_trajectories.py [ur5/level_tray ...]
"""

import sys
from functools import cache
from pathlib import Path

from cases import PROBLEMS

from tubeplanner import PlanningProblem, PlanOptions, load_problem, plan
from tubeplanner.output.files.fingerprint import origin
from tubeplanner.output.files.trajectory_writer import trajectory_json
from tubeplanner.trajectory.reader import TrajectoryFile, read_trajectory_file

STOP, SEARCH, REFINEMENT = "stop-at-corners", "branch-and-bound", "refinement"
ROBUST = "robust"  # refinement that survives the usual errors
SURVIVORS = (
    *PROBLEMS,
    *(f"two_link/paper_{number}_{radius}mm" for number in (1, 3, 5) for radius in (10, 50)),
)
FOLDER = Path(__file__).parents[1] / "data/trajectories"
REFRESH = "make trajectories"
STORED = (
    *((name, STOP) for name in PROBLEMS),
    *((name, REFINEMENT) for name in PROBLEMS),
    ("two_link/paper_1_10mm", STOP),
    ("two_link/paper_1_30mm", REFINEMENT),
    ("two_link/around_a_post", SEARCH),
    ("two_link/paper_1_30mm", SEARCH),
    ("ur5/over_the_wall", SEARCH),
    ("ur10/onto_a_conveyor", SEARCH),
    *((name, ROBUST) for name in SURVIVORS),
)


def stored_problem(name: str, method: str) -> PlanningProblem:
    """Return the problem of a stored trajectory."""
    return load_problem(f"example:{name}", changes={"robustness": {}} if method == ROBUST else {})


def stored_path(name: str, method: str) -> Path:
    """Return where a trajectory is stored."""
    return FOLDER / f"{name.replace('/', '.')}.{method}.json"


@cache
def stored_trajectory(name: str, method: str) -> TrajectoryFile:
    """Return the stored trajectory of a bundled problem."""
    assert (name, method) in STORED, f"{name} by {method} is not stored: add it to STORED"
    path = stored_path(name, method)
    assert path.exists(), f"{path} is missing: run `{REFRESH}`"
    return read_trajectory_file(path)


def refresh(names: list[str]) -> None:
    FOLDER.mkdir(exist_ok=True)
    for name, method in STORED:
        if names and name not in names:
            continue
        problem = stored_problem(name, method)
        options = PlanOptions() if method == ROBUST else PlanOptions(method, slack=0.0)
        result = plan(problem, options)
        assert result.trajectory is not None, f"{name} by {method}: {result.message}"
        path = stored_path(name, method)
        path.write_text(trajectory_json(result.trajectory, **origin(problem, method)))
        print(f"{path.name}: {result.message}")


if __name__ == "__main__":
    refresh(sys.argv[1:])
