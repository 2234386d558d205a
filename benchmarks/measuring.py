"""Whether `measure` and `route` are quicker than in another checkout, and their tubes as good.

    python benchmarks/measuring.py OTHER_CHECKOUT [--only SUBSTRING] [--seeds COUNT]

Measures bundled problems and routes through others by both checkouts in turns, every run a process
of its own. Prints processor times, radii and durations side by side. Exit status 1 if all
measurements together take more than 0.4 of the other's processor time, or all routes more than a
tenth; if a width (the geometric mean of a tube's radii, over problems and seeds) is less than 0.95
of the other's; if the trajectories become more than 1 % longer on average, or a route's motion is
slower than the fastest that it compared.
"""

import argparse
import json
import math
import os
import statistics
import subprocess
import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent.parent
MEASURED = (
    "two_link/around_a_post",
    "ur5/over_the_wall",
    "panda/between_shelves",
    "xarm7/from_crate_to_crate",
    "ur5/level_tray",
    "ur10/onto_a_conveyor",
)
ROUTES = ("two_link/through_the_gap", "ur5/past_a_wall", "panda/shelf_to_shelf")
MOST_OF_MEASURE, MOST_OF_ROUTE = 0.4, 0.1
LEAST_WIDTH, MOST_DURATION = 0.95, 1.01
# By either checkout's own package, through names that do not change.
DRIVER = """
import json, sys, time
from tubeplanner import (
    MeasureOptions, PlanOptions, RouteOptions, find_route, load_problem, measure_tube, plan
)

# Older checkouts plan the shortest motion always.
options = getattr(PlanOptions(), "shortest", PlanOptions())

kind, name, seed = json.loads(sys.stdin.readline())
problem = load_problem("example:" + name, reads_tube=kind == "measure")
begun = time.process_time()
if kind == "measure":
    found = measure_tube(problem, MeasureOptions(seed=seed)).problem
else:
    answer = find_route(problem, RouteOptions(seed=seed + 1))
    found = answer.found and answer.found.problem
cpu = time.process_time() - begun
compared = [] if kind == "measure" else [one for one in answer.compared if one]
print(json.dumps({
    "cpu": cpu,
    "radius": None if found is None else found.tube.radius.tolist(),
    "duration": None if found is None else plan(found, options).duration,
    "compared": min(compared, default=None),
}))
"""


def main() -> int:
    """Run all cases by both checkouts; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("other", type=Path)
    parser.add_argument("--only", default="", help="Problems whose names contain this.")
    parser.add_argument("--seeds", type=int, default=1, help="Runs of every problem.")
    asked = parser.parse_args()
    cases = [("measure", name) for name in MEASURED] + [("route", name) for name in ROUTES]
    runs = []
    print(f"{'':42s} {'CPU [s]':>14s} ratio  {'duration [s]':>15s}  radii [mm]")
    for kind, name in cases:
        for seed in range(asked.seeds if asked.only in name else 0):
            own, other = (_run(root, kind, name, seed) for root in (HERE, asked.other))
            _print(kind, name, seed, own, other)
            runs.append((kind, own, other))
    return _judged(runs)


def _run(root: Path, kind: str, name: str, seed: int) -> dict[str, Any]:
    environment = {**os.environ, "PYTHONPATH": str(root / "src"), "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "-c", DRIVER],
        input=json.dumps([kind, name, seed]) + "\n",
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    answer: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return answer


def _print(kind: str, name: str, seed: int, own: dict[str, Any], other: dict[str, Any]) -> None:
    times = f"{other['cpu']:6.1f} {own['cpu']:7.1f} {own['cpu'] / other['cpu']:6.2f}"
    lasts = " ".join("   none" if one is None else f"{one:7.4f}" for one in _of(other, own))
    radii = " -> ".join(
        ", ".join(f"{1000 * radius:.0f}" for radius in each["radius"] or ())
        for each in (other, own)
    )
    print(f"{kind:8s} {name:26s} seed {seed} {times}  {lasts}  {radii}", flush=True)


def _of(*runs: dict[str, Any]) -> list[float | None]:
    return [run["duration"] for run in runs]


def _judged(runs: list[tuple[str, dict[str, Any], dict[str, Any]]]) -> int:
    faults = []
    for kind, most in (("measure", MOST_OF_MEASURE), ("route", MOST_OF_ROUTE)):
        pairs = [(own, other) for each, own, other in runs if each == kind]
        if not pairs:
            continue
        share = sum(own["cpu"] for own, _ in pairs) / sum(other["cpu"] for _, other in pairs)
        longer = _mean([own["duration"] / other["duration"] for own, other in pairs])
        print(f"{kind}: {share:.3f} of the processor time, durations times {longer:.4f}")
        faults += [f"{kind}: too slow"] * (share > most)
        faults += [f"{kind}: trajectories are longer"] * (longer > MOST_DURATION)
        if kind == "measure":
            width = _mean([_width(own) / _width(other) for own, other in pairs])
            print(f"measure: widths times {width:.3f}")
            faults += ["measure: narrower tubes"] * (width < LEAST_WIDTH)
    slower = [own for _, own, _ in runs if own["compared"] and own["duration"] > own["compared"]]
    faults += ["route: slower than a motion that it compared"] * bool(slower)
    print("; ".join(faults) or "all goals met")
    return 1 if faults else 0


def _width(run: dict[str, Any]) -> float:
    return _mean(run["radius"])


def _mean(values: list[float]) -> float:
    return math.exp(statistics.fmean(map(math.log, values)))


if __name__ == "__main__":
    sys.exit(main())
