"""How good is planning again after a change, and how much quicker than a fresh plan?

    python benchmarks/replanning.py [--repeats 3] [--far] [--only NAME ...]

Every problem is planned once; then each change is planned afresh and from the last motion. Exit
status 1 if an answer is lost or slower than the fresh one by more than 0.3 %, or if the processor
time without the certificate's is not less by a factor of 1.3 in the geometric mean. `--far` looks
at changes that are not small as well, which do not count.
"""

import argparse
import copy
import gc
import math
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from ruamel.yaml import YAML

from shared import ARMS, HERE, geometric_mean, paper_example
from tubeplanner import Planner, PlanningProblem, PlanOptions, PlanResult, parse_problem, plan
from tubeplanner.planning import result as plan_result

MAX_LONGER, MIN_GAIN = 1.003, 1.3
SHORTEST = PlanOptions().shortest
HELD = ("ur5/waiter", "ur10/suction_cup")
NAMES = (*ARMS, *HELD, *(paper_example(k, radius) for k in range(1, 6) for radius in (10, 50)))
Document = dict[str, Any]
judge, spent = plan_result.verify, [0.0]


def timed(*arguments: Any) -> Any:
    """Judge, and count the processor time [s] that it takes."""
    begin = time.process_time()
    try:
        return judge(*arguments)
    finally:
        spent[0] += time.process_time() - begin


def scaled_radius(factor: float) -> Callable[[Document], None]:
    """Return a change of all radii."""

    def change(data: Document) -> None:
        data["tube"]["radius"] = (factor * np.array(data["tube"]["radius"])).tolist()

    return change


def moved_goal(length: float) -> Callable[[Document], None]:
    """Return a change of the last reference point, the goal beside the one before."""

    def change(data: Document) -> None:
        points = np.array(data["tube"]["points"], dtype=float)
        away = np.append(points[-2, :2] - points[-1, :2], 0.0)
        if np.linalg.norm(away) < 1e-6:
            away = np.array([1.0, 0.0, 0.0])
        points[-1] += length * away / np.linalg.norm(away)
        data["tube"]["points"] = points.tolist()
        if "joints" in data.get("goal", {}):
            data["goal"] = {"seed": data["goal"]["joints"]}

    return change


def moved_obstacle(data: Document) -> None:
    """Move the first obstacle by 1 cm."""
    data["obstacles"][0]["position"] = [
        x + step for x, step in zip(data["obstacles"][0]["position"], (0.0, 0.01, 0.0), strict=True)
    ]


def heavier(mass: float) -> Callable[[Document], None]:
    """Return a change of the payload."""

    def change(data: Document) -> None:
        payload = data["robot"].setdefault("payload", {"mass": 0.0})
        payload["mass"] += mass

    return change


def scaled_limit(quantity: str, factor: float) -> Callable[[Document], None]:
    """Return a change of the limits of all joints."""

    def change(data: Document) -> None:
        scale = data["robot"].setdefault("limits", {}).setdefault("scale", {})
        scale[quantity] = factor * scale.get(quantity, 1.0)

    return change


def scaled_tilt(factor: float) -> Callable[[Document], None]:
    """Return a change of all rotation tolerances; KeyError without some."""

    def change(data: Document) -> None:
        data["tube"]["rotation_tolerance"] = (
            factor * np.array(data["tube"]["rotation_tolerance"])
        ).tolist()

    return change


def scaled_hold(factor: float) -> Callable[[Document], None]:
    """Return a change of a cup's force or a tray's friction; KeyError without a held part."""

    def change(data: Document) -> None:
        contact, name = ("cup", "force") if "cup" in data["holding"] else ("tray", "friction")
        data["holding"][contact][name] *= factor

    return change


NEAR = {
    "none": lambda data: None,
    "radius +10 %": scaled_radius(1.1),
    "radius -10 %": scaled_radius(0.9),
    "goal by 1 cm": moved_goal(0.01),
    "obstacle by 1 cm": moved_obstacle,
    "payload +0.5 kg": heavier(0.5),
    "velocity -20 %": scaled_limit("velocity", 0.8),
    "effort -20 %": scaled_limit("effort", 0.8),
    "tilt +50 %": scaled_tilt(1.5),
    "hold -10 %": scaled_hold(0.9),
    "hold +10 %": scaled_hold(1.1),
}
FAR = {
    "radius x 2": scaled_radius(2.0),
    "radius / 2": scaled_radius(0.5),
    "goal by 5 cm": moved_goal(0.05),
    "goal by 10 cm": moved_goal(0.1),
    "effort / 2": scaled_limit("effort", 0.5),
    "payload +2 kg": heavier(2.0),
    "tilt x 10": scaled_tilt(10.0),
}


def document(name: str) -> Document:
    """Return what a bundled problem's file holds."""
    path = HERE / "robots" / f"{name}.yaml"
    return YAML(typ="safe", pure=True).load(path.read_text())


def changed(data: Document, change: Callable[[Document], None]) -> PlanningProblem:
    """Return the problem after a change, its collision geometry ready."""
    other = copy.deepcopy(data)
    change(other)
    problem = parse_problem(other)
    _ = problem.collision
    return problem


def measured(work: Callable[[], PlanResult]) -> tuple[PlanResult, float, float]:
    """Return a result, and the processor time without and with the certificate's [s]."""
    gc.collect()
    spent[0], begin = 0.0, time.process_time()
    result = work()
    seconds = time.process_time() - begin
    return result, seconds - spent[0], seconds


def is_continued(result: PlanResult) -> bool:
    """Return whether a result was planned from the last motion."""
    return any("last motion" in note for note in result.notes)


def in_turns(
    first: PlanningProblem, problem: PlanningProblem, repeats: int
) -> tuple[float, list[float], PlanResult]:
    """Return the ratio of durations, factors of processor times, and the result of replanning."""
    runs = []
    for _ in range(repeats):
        planner = Planner(first, SHORTEST)
        planner.plan()
        runs.append(
            (measured(partial(plan, problem, SHORTEST)), measured(partial(planner.replan, problem)))
        )
    fresh, again = runs[0][0][0], runs[0][1][0]
    longer = 1.0 if fresh.succeeded == again.succeeded else math.nan
    if fresh.duration and again.duration:
        longer = again.duration / fresh.duration
    costs = [min(run[side][k] for run in runs) for k in (1, 2) for side in (0, 1)]
    return longer, costs, again


def compared(
    name: str, changes: dict[str, Callable[[Document], None]], repeats: int
) -> Iterator[tuple[float, float, float]]:
    """Print a line for every change; yield ratios of durations and factors of processor times."""
    data = document(name)
    first = changed(data, NEAR["none"])
    for what, change in changes.items():
        try:
            other = changed(data, change)
        except KeyError:  # nothing to change
            continue
        longer, costs, again = in_turns(first, other, repeats)
        gains = costs[0] / costs[1], costs[2] / costs[3]
        how = "" if is_continued(again) else f"afresh: {again.status}"
        times = " ".join(f"{1e3 * cost:7.0f}" for cost in costs[:2])
        print(
            f"{name:30s} {what:17s} {longer:8.5f} {times} {gains[0]:6.2f} {gains[1]:6.2f} {how}",
            flush=True,
        )
        yield longer, *gains


def summed_up(what: str, rows: list[tuple[float, float, float]]) -> tuple[float, float]:
    """Print and return the longest duration and the mean gain."""
    longer, gains, whole = zip(*rows, strict=True)
    longest, gain = max(longer), geometric_mean(gains)
    with_certificate = geometric_mean(whole)
    print(f"{what}longest {longest:.5f}; gain {gain:.2f}, with certificate {with_certificate:.2f}")
    return longest, gain


def main() -> int:
    """Print the tables; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--far", action="store_true")
    parser.add_argument("--only", nargs="*", default=[])
    arguments = parser.parse_args()
    plan_result.verify = timed
    names = arguments.only or NAMES
    title = "T ratio   fresh   again   gain with certificate [ms of processor time]"
    print(f"{'problem':30s} {'change':17s} {title}")
    rows = [row for name in names for row in compared(name, NEAR, arguments.repeats)]
    longest, gain = summed_up("", rows)
    is_lost = any(math.isnan(row[0]) for row in rows)
    if arguments.far:
        summed_up("far: ", [row for name in names for row in compared(name, FAR, 1)])
    return int(is_lost or longest > MAX_LONGER or gain < MIN_GAIN)


if __name__ == "__main__":
    sys.exit(main())
