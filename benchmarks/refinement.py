"""How long do bundled problems' motions last, and how long does each take to plan, by method?

    python benchmarks/refinement.py [--repeats 3] [--only SUBSTRING]

The paper's fifteen cases, the bundled arms and the level tray, by stopping at corners, branch and
bound, and every quality of refinement: durations, and medians of the planning time without its
certificate. What the paper printed stands beside its cases in what `tubeplanner reproduce` writes.
"""

import argparse

import numpy as np

from shared import ARMS, EXAMPLES, RADII, paper_example
from tubeplanner import PlanningProblem, PlanOptions, load_problem, plan
from tubeplanner.planning.options import QUALITIES

NAMES = (*(paper_example(e, r) for e in EXAMPLES for r in RADII), *ARMS, "ur5/level_tray")
METHODS = {name: PlanOptions(name).shortest for name in ("stop-at-corners", "branch-and-bound")}
METHODS |= {quality: PlanOptions(quality=quality, slack=0.0) for quality in QUALITIES}


def cell(problem: PlanningProblem, options: PlanOptions, repeats: int) -> str:
    """Return duration [s] / time [s] of a plan, and its method if it is another."""
    results = [plan(problem, options) for _ in range(repeats)]
    seconds = np.median([result.planning_time - result.certificate_time for result in results])
    result = results[0]
    if result.duration is None:
        return str(result.status)
    other = "" if result.method == options.method else f" ({result.method})"
    return f"{result.duration:.4f} / {seconds:.2f}{other}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=3, help="of each plan")
    parser.add_argument("--only", default="", help="problems whose name contains this")
    options = parser.parse_args()
    print(f"| problem | {' | '.join(METHODS)} |")
    print("|---" * (1 + len(METHODS)) + "|")
    for name in (name for name in NAMES if options.only in name):
        problem = load_problem(f"example:{name}")
        _ = problem.collision  # geometry is built before planning begins
        cells = [cell(problem, method, options.repeats) for method in METHODS.values()]
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
