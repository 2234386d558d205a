"""Plan problem and cycle files in a process that may be ended.

    python benchmarks/campaign_planner.py

The process reads lines of JSON: problem, trajectory, time_limit, slack, baselines, and, if other
than usual, quality and cpu_limit [s], after which it ends itself. It prints a line of JSON for
each: status, message, duration, planning_time, cpu [s] of the plan, memory (resident) [MB], and
with baselines the duration of the fastest smoothed scheme that passes the certificate.
"""

import atexit
import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from select import select
from typing import Any

import tubeplanner
from shared import environment

BASELINES = ("smoothed-arc-corners", "smoothed-bang-bang")
CYCLE = "format: tubeplanner/cycle"
PAGE = os.sysconf("SC_PAGE_SIZE")


class PlannerProcess:
    """Plans files one after the other in a process of its own."""

    def __init__(self, checkout: Path | None = None) -> None:
        """Begin no process yet; one that was begun ends with this one at the latest.

        Args:
            checkout: Whose package plans; None: that of this process.
        """
        usual = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
        self._environment = usual if checkout is None else environment(checkout)
        self._process: subprocess.Popen[str] | None = None
        atexit.register(self.end)

    def plan(self, asked: dict[str, Any], timeout: float) -> dict[str, Any]:
        """Return what `campaign_planner.py` answers, or status crash or timeout.

        Args:
            asked: What it reads.
            timeout: After how long the process is ended [s].
        """
        process = self._process = self._process or self._begun()
        assert process.stdin is not None and process.stdout is not None
        try:
            process.stdin.write(json.dumps(asked) + "\n")
            process.stdin.flush()
            if not select([process.stdout], [], [], timeout)[0]:
                self.end()
                return {"status": "timeout", "message": f"ended after {timeout:g} s"}
            line = process.stdout.readline()
        except BrokenPipeError:
            line = ""
        if not line:
            code = process.wait()
            self.end()
            if code == -signal.SIGPROF:
                limit = f"{asked['cpu_limit']:g} s of processor time"
                return {"status": "timeout", "message": f"ended after {limit}"}
            return {"status": "crash", "message": f"the process ended with {code}"}
        return json.loads(line)

    def end(self) -> None:
        """End the process; the next plan begins another."""
        if self._process is not None:
            with suppress(BrokenPipeError), self._process:  # what it did not read
                self._process.kill()
        self._process = None

    def _begun(self) -> "subprocess.Popen[str]":
        return subprocess.Popen(
            [sys.executable, __file__],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=self._environment,
            text=True,
        )


def answer(asked: dict[str, Any]) -> dict[str, Any]:
    """Plan a file, write the motion if there is one, and return what came of it."""
    path, output = Path(asked["problem"]), Path(asked["trajectory"])
    quality = asked.get("quality", "balanced")
    known = {key: asked[key] for key in ("time_limit", "slack")}
    options = tubeplanner.PlanOptions(quality=quality, **known)
    is_cycle = path.exists() and path.read_text().startswith(CYCLE)
    try:
        loaded: Any = (tubeplanner.load_cycle if is_cycle else tubeplanner.load_problem)(path)
    except tubeplanner.TubePlannerError as error:
        return {"status": "bad_input", "message": str(error)}
    signal.setitimer(signal.ITIMER_PROF, asked.get("cpu_limit", 0.0))
    begin = time.process_time()
    planner: Any = tubeplanner.plan_cycle if is_cycle else tubeplanner.plan
    result = planner(loaded, options)
    cpu = time.process_time() - begin
    signal.setitimer(signal.ITIMER_PROF, 0.0)
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


def main() -> None:
    """Answer line by line."""
    for line in sys.stdin:
        print(json.dumps(answer(json.loads(line))), flush=True)


def _fields(trajectory: tubeplanner.JointTrajectory) -> dict[str, Any]:
    return {
        "format": "tubeplanner/trajectory",
        "version": 1,
        "joint_names": list(trajectory.joint_names),
        "duration": trajectory.duration,
        "breakpoints": trajectory.breakpoints.tolist(),
        "coefficients": trajectory.coefficients.tolist(),
    }


if __name__ == "__main__":
    main()
