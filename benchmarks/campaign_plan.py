"""Plan one problem file by the public API, for `campaign.py`, in a process that may be ended.

    python benchmarks/campaign_plan.py PROBLEM.yaml TRAJECTORY.json [--time-limit SECONDS]
    [--slack SHARE] [--baselines]

Prints one JSON object: status, message, duration, planning_time, and with --baselines the duration
of the fastest smoothed scheme that passes the certificate.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import tubeplanner

BASELINES = ("smoothed-arc-corners", "smoothed-bang-bang")


def answer(
    problem: Path, trajectory: Path, options: tubeplanner.PlanOptions, baselines: bool
) -> dict[str, Any]:
    """Plan a problem, write the trajectory if there is one, and return what came of it."""
    try:
        loaded = tubeplanner.load_problem(problem)
    except tubeplanner.TubePlannerError as error:
        return {"status": "bad_input", "message": str(error)}
    result = tubeplanner.plan(loaded, options)
    if result.trajectory is not None:
        trajectory.write_text(json.dumps(_fields(result.trajectory), allow_nan=False))
    line = {
        "status": str(result.status),
        "message": result.message,
        "duration": result.duration,
        "planning_time": result.planning_time,
    }
    if baselines:
        rows = tubeplanner.compare(loaded, methods=BASELINES).rows
        line["baseline"] = min((row.duration for row in rows if row.certified), default=None)
    return line


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
    parser.add_argument("--slack", type=float, default=0.0)
    parser.add_argument("--baselines", action="store_true")
    asked = parser.parse_args()
    options = tubeplanner.PlanOptions(time_limit=asked.time_limit, slack=asked.slack)
    found = answer(asked.problem, asked.trajectory, options, asked.baselines)
    print(json.dumps(found))


if __name__ == "__main__":
    main()
