"""Processor times and durations of planning beside another checkout, plan by plan in turns.

    python benchmarks/quick.py OTHER_CHECKOUT [--random 40] [--repeats 1] [--only NAME ...]

Bundled problems, and random ones that have a solution (`random_problems.py`), are planned by both
checkouts in processes that live as long as the run, one plan at a time and in turns. What counts is
processor time without the certificate's. Exit status 1 if the geometric mean of the ratios is above
0.4, one is above 0.6, or durations are longer by more than 0.05 % on average.
"""

import argparse
import math
import sys
from collections.abc import Iterator
from pathlib import Path

from checkout import HERE, SHORTEST, Checkout

MAX_MEAN, MAX_WORST, MAX_LONGER = 0.4, 0.6, 1.0005
# Both checkouts run this, through names that do not change; the problems are made alike.
DRIVER = """
import json, sys, time
sys.path.insert(0, sys.argv[1])
from random_problems import ARMS, random_case
from tubeplanner import load_problem, plan
from tubeplanner.planning import plan_result

spent, judge = [0.0], plan_result.verify

def timed(*arguments):
    begin = time.process_time()
    try:
        return judge(*arguments)
    finally:
        spent[0] += time.process_time() - begin

plan_result.verify = timed

def problem_of(name):
    kind, key = name.split(":")
    if kind == "example":
        return load_problem(name)
    arm, seed = key.split("/")
    return random_case(arm, ARMS[arm](), int(seed)).problem

for line in sys.stdin:
    problem, spent[0] = problem_of(json.loads(line)), 0.0
    problem.collision
    begin = time.process_time()
    result = plan(problem, SHORTEST)
    seconds = time.process_time() - begin - spent[0]
    print(json.dumps([result.succeeded, result.duration, result.method, seconds]), flush=True)
"""


def names(random: int) -> Iterator[str]:
    """Yield what is planned."""
    for path in sorted((HERE / "robots").glob("*/*.yaml")):
        text = path.read_text()
        if "tube:" in text and "format: tubeplanner/cycle" not in text:
            yield f"example:{path.parent.name}/{path.stem}"
    arms = ("two_link", "ur5", "panda", "xarm7", "ur10")
    for k in range(random):
        yield f"random:{arms[k % len(arms)]}/{k // len(arms)}"


def geometric_mean(values: list[float]) -> float:
    """Return the geometric mean."""
    return math.exp(sum(map(math.log, values)) / len(values))


def main() -> int:
    """Print the table; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("other", type=Path)
    parser.add_argument("--random", type=int, default=40)
    parser.add_argument("--repeats", type=int, default=1)
    parser.add_argument("--only", nargs="*", default=[])
    arguments = parser.parse_args()
    folders, modules = (arguments.other.resolve(), HERE), str(HERE / "benchmarks")
    checkouts = [Checkout(folder, SHORTEST + DRIVER, modules) for folder in folders]
    for checkout in checkouts:
        checkout.ask("example:two_link/paper_1_30mm")
    ratios, durations = [], []
    print(
        f"{'problem':45s} {'T before':>9s} {'now':>9s} {'ratio':>8s} {'CPU':>7s} {'now':>7s} ratio"
    )
    for name in arguments.only or names(arguments.random):
        runs = [[checkout.ask(name) for checkout in checkouts] for _ in range(arguments.repeats)]
        before, now = runs[0]
        costs = [min(run[side][3] for run in runs) for side in (0, 1)]
        ratios.append(costs[1] / costs[0])
        texts = [f"{run[1]:.5f}" if run[0] and run[1] else "none" for run in (before, now)]
        longer = math.nan
        if before[0] and now[0] and before[1] and now[1]:
            longer = now[1] / before[1]
            durations.append(longer)
        methods = "" if before[2] == now[2] else f" {before[2]} -> {now[2]}"
        print(
            f"{name:45s} {texts[0]:>9s} {texts[1]:>9s} {longer:8.5f} "
            f"{costs[0]:7.3f} {costs[1]:7.3f} {ratios[-1]:.2f}{methods}",
            flush=True,
        )
    mean, worst, longer = geometric_mean(ratios), max(ratios), geometric_mean(durations)
    print(f"CPU ratio: geometric mean {mean:.3f}, worst {worst:.2f}, {len(ratios)} problems")
    print(f"duration ratio: geometric mean {longer:.5f}, worst {max(durations):.5f}")
    return int(mean > MAX_MEAN or worst > MAX_WORST or longer > MAX_LONGER)


if __name__ == "__main__":
    sys.exit(main())
