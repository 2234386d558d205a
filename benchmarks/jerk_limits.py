"""Whether a looser jerk limit ever gives a slower motion, or an open goal slower than a fixed one.

    python benchmarks/jerk_limits.py [--only SUBSTRING]

Plans bundled problems with every joint's jerk limited to a series of values, and without limits:
with the goal as the file has it, with the goal that this led to fixed, and with more clearance.
Prints durations, and the processor time of limited plans beside those without. Exit status 1 if a
looser limit is more than 1 % slower than a tighter one, or an open goal 0.5 % slower than a fixed.
"""

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tubeplanner import PlanOptions, PlanResult, parse_problem, plan

ROBOTS = Path(__file__).resolve().parent.parent / "robots"
PROBLEMS = (
    "ur5/over_the_wall",
    "panda/between_shelves",
    "ur10/onto_a_conveyor",
    "xarm7/from_crate_to_crate",
    "ur5/level_tray",
)
JERKS = (500, 1000, 2000, 4000, 8000, 16000, 32000, 100000, None)  # [rad/s^3]
SLOWER, SLOWER_OPEN = 1.01, 1.005


def planned(fields: dict[str, Any], folder: Path, jerk: float | None) -> tuple[PlanResult, float]:
    """Return the plan with a jerk limit, and its processor time [s]."""
    limits = dict(fields["robot"].get("limits", {}))
    problem = parse_problem(fields, folder)
    if jerk is not None:
        limits["jerk"] = dict.fromkeys(problem.robot.joint_names, float(jerk))
        problem = parse_problem(fields | {"robot": fields["robot"] | {"limits": limits}}, folder)
    begun = time.process_time()
    return plan(problem, PlanOptions().shortest), time.process_time() - begun


def variants(name: str) -> dict[str, tuple[dict[str, Any], Path]]:
    """Return the problem as it is, with its goal fixed, and with more clearance."""
    path = ROBOTS / f"{name}.yaml"
    fields = yaml.safe_load(path.read_text())
    found = {"": (fields, path.parent), " +3 mm": (fields | {"clearance": 0.003}, path.parent)}
    if "goal" not in fields:
        answer, _ = planned(fields, path.parent, None)
        goal = {"joints": answer.trajectory.position(answer.duration).tolist()}
        found[" fixed"] = (fields | {"goal": goal}, path.parent)
    return found


def main() -> int:
    """Plan and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="problems whose name contains this")
    only = parser.parse_args().only
    print(f"{'problem':34}" + "".join(f"{jerk or 'none':>8}" for jerk in JERKS) + "   CPU ratio")
    faults = 0
    for name in (name for name in PROBLEMS if only in name):
        table: dict[str, list[float]] = {}
        for variant, (fields, folder) in variants(name).items():
            rows = [planned(fields, folder, jerk) for jerk in JERKS]
            durations = [result.duration or np.inf for result, _ in rows]
            table[variant] = durations
            slower = [i for i in range(1, len(JERKS)) if durations[i] > SLOWER * min(durations[:i])]
            ratio = float(np.median([cpu for _, cpu in rows[:-1]])) / rows[-1][1]
            faults += len(slower)
            print(
                f"{name + variant:34}" + "".join(f"{each:8.4f}" for each in durations),
                f"{ratio:8.2f}",
                *(f"slower at {JERKS[i] or 'none'}" for i in slower),
                flush=True,
            )
        pairs = zip(table[""], table.get(" fixed", table[""]), strict=True)
        faults += sum(opened > SLOWER_OPEN * fixed for opened, fixed in pairs)
    return 1 if faults else 0


if __name__ == "__main__":
    raise SystemExit(main())
