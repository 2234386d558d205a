"""Whether narrow tubes are planned as well as wide ones, beside baselines and another checkout.

    python benchmarks/never_stuck.py [--against CHECKOUT] [--only SUBSTRING]

Plans every problem of `narrow_cases.py` with the default method and prints its duration beside the
mark that was once reached, the fastest baseline that passes the certificate and, plan by plan in
turns, another checkout's duration and processor time. Exit status 1 if a plan is not certified,
slower than a baseline, or more than 2 % above its mark.
"""

import argparse
from dataclasses import asdict
from pathlib import Path

import numpy as np

from checkout import HERE, Checkout
from narrow_cases import Case, cases

SMOOTHED = ("smoothed-arc-corners", "smoothed-bang-bang")
MOST_ABOVE_MARK = 1.02
# Planned by either checkout's own package, through names that do not change; the second of two
# plans counts, so that libraries are loaded and covers known.
DRIVER = """
import json, sys, time
from dataclasses import replace
from tubeplanner import PlanOptions, compare, load_problem, parse_problem, plan
# Older checkouts plan the shortest motion always.
options = getattr(PlanOptions(), "shortest", PlanOptions())
for line in sys.stdin:
    case = json.loads(line)
    bundled, baselines = case["bundled"], case["baselines"]
    problem = load_problem(f"example:{bundled}") if bundled else parse_problem(case["data"])
    if case["radius"] is not None:
        tube = problem.tube
        problem = replace(problem, tube=tube.with_radius(case["radius"] + tube.tool_radius))
    begun = time.process_time()
    result = plan(problem, options)
    answer = {"duration": result.duration, "status": result.status, "method": result.method}
    answer["cpu"] = time.process_time() - begun
    if baselines:
        rows = compare(problem, methods=baselines).rows
        fastest = [row.duration for row in rows if row.certified]
        answer["baseline"] = min(fastest, default=None)
    print(json.dumps(answer), flush=True)
"""


def planned(checkout: Checkout, case: Case, baselines: tuple[str, ...] = ()) -> dict:
    """Return what a checkout plans, and its fastest baseline."""
    return checkout.ask(asdict(case) | {"baselines": baselines})


def geometric_mean(ratios: list[float]) -> float:
    """Return the geometric mean; nan of none."""
    return float(np.exp(np.mean(np.log(ratios)))) if ratios else float("nan")


def figure(value: float | None, places: int = 4) -> str:
    """Return a number for the table."""
    return "-" if value is None else f"{value:.{places}f}"


def fault(case: Case, answer: dict) -> str:
    """Say what is wrong with an answer; empty if nothing."""
    if answer["status"] != "success":
        return str(answer["status"])
    if answer["baseline"] is not None and answer["duration"] > answer["baseline"]:
        return "slower than a baseline"
    if case.mark is not None and answer["duration"] > MOST_ABOVE_MARK * case.mark:
        return "above its mark"
    return ""


def main() -> int:
    """Plan and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--against", type=Path, help="another checkout")
    parser.add_argument("--only", default="", help="problems whose name contains this")
    arguments = parser.parse_args()
    here = Checkout(HERE, DRIVER)
    other = Checkout(arguments.against.resolve(), DRIVER) if arguments.against else None
    names = ("T [s]", "mark", "baseline", "other T", "CPU", "other")
    print(f"{'problem':32}" + "".join(f"{name:>10}" for name in names))
    faults, ratios = 0, {}
    for case in cases():
        if arguments.only not in case.name:
            continue
        answer = planned(here, case, SMOOTHED if case.is_narrow else ())
        answer.setdefault("baseline", None)
        before = {} if other is None else planned(other, case)
        wrong = fault(case, answer)
        faults += bool(wrong)
        print(
            f"{case.name:32}{figure(answer['duration']):>10}{figure(case.mark, 3):>10}"
            f"{figure(answer['baseline'], 3):>10}{figure(before.get('duration')):>10}"
            f"{figure(answer['cpu'], 2):>10}{figure(before.get('cpu'), 2):>10}  {wrong}",
            flush=True,
        )
        group = ratios.setdefault("narrow" if case.is_narrow else "wide", {})
        if case.mark is not None and answer["duration"]:
            group.setdefault("T / mark", []).append(answer["duration"] / case.mark)
        if answer["duration"] and before.get("duration"):
            group.setdefault("T / other", []).append(answer["duration"] / before["duration"])
            group.setdefault("CPU / other", []).append(answer["cpu"] / before["cpu"])
    for name, group in ratios.items():
        for what, found in group.items():
            mean = geometric_mean(found)
            print(f"{name}: {what}: geometric mean {mean:.4f}, largest {max(found):.4f}")
    return 1 if faults else 0


if __name__ == "__main__":
    raise SystemExit(main())
