"""Trajectories that tests only look at: planned once, stored, judged against their problems."""

from functools import cache
from pathlib import Path

from cases import PROBLEMS

from tubeplanner.trajectory.trajectory_file import TrajectoryFile, read_trajectory_file

STOP, SEARCH, REFINEMENT = "stop-at-corners", "branch-and-bound", "refinement"
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
)


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
