"""Plan problem and cycle files by the public API, in a process that may be ended; for the campaign.

    python benchmarks/campaign_plan.py

Reads lines of JSON: problem, trajectory, time_limit, slack, baselines. Prints a line of JSON for
each: status, message, duration, planning_time, cpu [s] of the plan, memory (resident) [MB], and
with baselines the duration of the fastest smoothed scheme that passes the certificate.
"""

import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import tubeplanner

BASELINES = ("smoothed-arc-corners", "smoothed-bang-bang")
CYCLE = "format: tubeplanner/cycle"
PAGE = os.sysconf("SC_PAGE_SIZE")


def answer(asked: dict[str, Any]) -> dict[str, Any]:
    """Plan a file, write the motion if there is one, and return what came of it."""
    path, output = Path(asked["problem"]), Path(asked["trajectory"])
    options = tubeplanner.PlanOptions(time_limit=asked["time_limit"], slack=asked["slack"])
    is_cycle = path.exists() and path.read_text().startswith(CYCLE)
    try:
        loaded: Any = (tubeplanner.load_cycle if is_cycle else tubeplanner.load_problem)(path)
    except tubeplanner.TubePlannerError as error:
        return {"status": "bad_input", "message": str(error)}
    begin = time.process_time()
    planner: Any = tubeplanner.plan_cycle if is_cycle else tubeplanner.plan
    result = planner(loaded, options)
    cpu = time.process_time() - begin
    if result.succeeded and is_cycle:
        tubeplanner.write_cycle_motion(output, result.motion)
    elif result.succeeded:
        output.write_text(json.dumps(_fields(result.trajectory), allow_nan=False))
    line = {
        "status": str(result.status),
        "message": result.message,
        "duration": result.duration,
        "planning_time": result.planning_time,
        "cpu": cpu,
        "memory": resident(),
    }
    if asked["baselines"]:
        rows = tubeplanner.compare(loaded, methods=BASELINES).rows
        line["baseline"] = min((row.duration for row in rows if row.certified), default=None)
    return line


def resident() -> float:
    """Return the resident memory of this process [MB]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE / 1e6


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
    """Answer line by line."""
    for line in sys.stdin:
        print(json.dumps(answer(json.loads(line))), flush=True)


if __name__ == "__main__":
    main()
