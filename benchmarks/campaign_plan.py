"""Plan one problem file by the public API, for `campaign.py`, in a process that may be ended.

    python benchmarks/campaign_plan.py PROBLEM.yaml TRAJECTORY.json [--time-limit SECONDS]

Prints one JSON object: status, message, duration, planning_time.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import tubeplanner


def answer(problem: Path, trajectory: Path, time_limit: float | None) -> dict[str, Any]:
    """Plan a problem, write the trajectory if there is one, and return what came of it."""
    try:
        loaded = tubeplanner.load_problem(problem)
    except tubeplanner.TubePlannerError as error:
        return {"status": "bad_input", "message": str(error)}
    result = tubeplanner.plan(loaded, tubeplanner.PlanOptions(time_limit=time_limit))
    if result.trajectory is not None:
        trajectory.write_text(json.dumps(_fields(result.trajectory), allow_nan=False))
    return {
        "status": str(result.status),
        "message": result.message,
        "duration": result.duration,
        "planning_time": result.planning_time,
    }


def _fields(trajectory: tubeplanner.JointTrajectory) -> dict[str, Any]:
    return {
        "format": "tubeplanner/trajectory",
        "version": 1,
        "joint_names": list(trajectory.joint_names),
        "duration": trajectory.duration,
        "breakpoints": trajectory.breakpoints.tolist(),
        "coefficients": trajectory.coefficients.tolist(),
    }


def main() -> None:
    """Print the answer."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("problem", type=Path)
    parser.add_argument("trajectory", type=Path)
    parser.add_argument("--time-limit", type=float)
    options = parser.parse_args()
    print(json.dumps(answer(options.problem, options.trajectory, options.time_limit)))


if __name__ == "__main__":
    main()
