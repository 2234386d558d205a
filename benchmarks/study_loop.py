"""A plain loop over `plan`, for `studies.py`: one of the processes that a user would start by hand.

    python benchmarks/study_loop.py

Reads a JSON list of points from every line, plans them one after the other and prints one JSON
object: how long that took, and how long the motions are.
"""

import json
import sys
import time
from dataclasses import replace
from functools import cache

from tubeplanner import PlanningProblem, PlanOptions, load_problem, plan

OPTIONS = PlanOptions(quality="fast", slack=0.0)
load = cache(load_problem)


def problem_of(name: str, share: float) -> PlanningProblem:
    """Return a bundled problem, loaded once, with another width of its tube."""
    problem = load(name)
    return problem.with_tube(replace(problem.tube, radius=share * problem.tube.radius))


def main() -> None:
    """Answer line by line."""
    for line in sys.stdin:
        begin = time.perf_counter()
        points = json.loads(line)
        durations = [plan(problem_of(*point), OPTIONS).duration for point in points]
        seconds = time.perf_counter() - begin
        print(json.dumps({"seconds": seconds, "durations": durations}), flush=True)


if __name__ == "__main__":
    main()
