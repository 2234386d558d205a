"""Plans the stored trajectories again: all of them, or those whose problems are named.

Needed when a bundled problem changes; `test_stored_trajectories` says so. Run from the checkout:
python tests/helpers/refresh_trajectories.py [ur5/level_tray ...]
"""

import sys

from stored_trajectories import FOLDER, STORED, stored_path

from tubeplanner import PlanOptions, load_problem, plan
from tubeplanner.files.export import trajectory_json
from tubeplanner.files.origin import origin


def refresh(names: list[str]) -> None:
    FOLDER.mkdir(exist_ok=True)
    for name, method in STORED:
        if names and name not in names:
            continue
        problem = load_problem(f"example:{name}")
        result = plan(problem, PlanOptions(method, slack=0.0))
        assert result.trajectory is not None, f"{name} by {method}: {result.message}"
        path = stored_path(name, method)
        path.write_text(trajectory_json(result.trajectory, **origin(problem, method)))
        print(f"{path.name}: {result.message}")


if __name__ == "__main__":
    refresh(sys.argv[1:])
