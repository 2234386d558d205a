"""Phase 1 on the paper's examples and on the bundled arms: durations, nodes, times.

    python benchmarks/phase_one.py [--candidates 10 20 30 40]

Prints the durations beside the phase-1 column of Table II (Suh & Bishop 1988), the bundled arms
beside stopping at corners, where the time goes, and what the number of candidate points changes.
Every trajectory is certified, or the table says so.
"""

import argparse
import cProfile
import pstats

import numpy as np

from cases import ARMS, RADII, paper_example
from tubeplanner import PlanningProblem, PlanOptions, PlanResult, load_problem, plan

METHOD = "branch-and-bound"
PHASE_ONE = PlanOptions(METHOD)
# Suh & Bishop 1988, Table II: duration after phase 1 [s] at these radii, by example.
PRINTED = {
    1: (1.08, 1.04, 1.04),
    2: (0.44, 0.44, 0.44),
    3: (1.04, 0.95, 0.95),
    4: (0.91, 0.91, 0.88),
    5: (1.91, 1.44, 1.44),
}
# Functions that share out the planning time; none calls another.
SHARES = {
    "branch, stop at corners, its certificate": "stopping_plan",
    "rule duration": "_sampled_factor",
    "rule tube": "_inside",
    "rule collision": "_free",
    "tests between samples": "_try_trajectory",
}


def certified(result: PlanResult) -> str:
    """Say whether the answer is certified, and by which method it was found."""
    if not result.succeeded:
        return f"NO ({result.status})"
    return "yes" if result.method == METHOD else f"yes ({result.method})"


def table_two() -> None:
    """Print the paper's examples beside its figures."""
    print("| example | radius [m] | printed [s] | here [s] | difference | certified | nodes |")
    print("|---|---|---|---|---|---|---|")
    differences, times, nodes = [], [], []
    for example, row in PRINTED.items():
        for radius, printed in zip(RADII, row, strict=True):
            result = plan(load_problem(f"example:{paper_example(example, radius)}"), PHASE_ONE)
            difference = result.duration / printed - 1
            differences.append(abs(difference))
            times.append(result.planning_time)
            nodes.append(result.search.nodes)
            print(
                f"| {example} | {radius / 1000:.2f} | {printed:.2f} | {result.duration:.4f} | "
                f"{100 * difference:+.1f} % | {certified(result)} | {result.search.nodes} |"
            )
    print(
        f"\nMean difference {100 * np.mean(differences):.1f} %, worst "
        f"{100 * np.max(differences):.1f} %; planning time median {np.median(times):.2f} s, "
        f"longest {np.max(times):.2f} s; nodes {np.min(nodes)} to {np.max(nodes)}.\n"
    )


def arms() -> None:
    """Print the bundled arm problems beside stopping at corners."""
    print("| problem | joints | stop at corners [s] | phase 1 [s] | planning [s] | nodes | cuts |")
    print("|---|---|---|---|---|---|---|")
    for name in ARMS:
        problem = load_problem(f"example:{name}")
        stopping = plan(problem, PlanOptions("stop-at-corners"))
        result = plan(problem, PHASE_ONE)
        found = "-" if result.phase1_duration is None else f"{result.phase1_duration:.4f}"
        cuts = ", ".join(f"{rule} {count}" for rule, count in result.search.cuts.items())
        print(
            f"| {name} | {problem.robot.joint_count} | {stopping.duration:.4f} | {found} | "
            f"{result.planning_time:.2f} | {result.search.nodes} | {cuts} |",
            flush=True,
        )
    print()


def candidates(counts: list[int]) -> None:
    """Print what the number of candidate points changes: duration, planning time, nodes."""
    print("Duration [s] / planning time [s] / nodes by number of candidate points M:\n")
    print(f"| problem | {' | '.join(f'M = {count}' for count in counts)} |")
    print("|---" * (len(counts) + 1) + "|")
    names = [paper_example(example, 10) for example in PRINTED]
    for name in [*names, paper_example(5, 30), *ARMS]:
        problem = load_problem(f"example:{name}")
        cells = [
            _cell(plan(problem, PlanOptions(METHOD, candidate_points=count))) for count in counts
        ]
        print(f"| {name} | {' | '.join(cells)} |", flush=True)
    print("\n`-`: nothing faster than stopping at corners; `*`: the node budget was reached.\n")


def _cell(result: PlanResult) -> str:
    found = "-" if result.phase1_duration is None else f"{result.phase1_duration:.3f}"
    star = "*" if result.search.budget_reached else ""
    return f"{found} / {result.planning_time:.2f} / {result.search.nodes}{star}"


def where_the_time_goes() -> None:
    """Print the share of the planning time of several parts, measured under a profiler."""
    print("Share of the planning time (under a profiler, which favours compiled code):\n")
    print(f"| problem | {' | '.join(SHARES)} | rest |")
    print("|---" * (len(SHARES) + 2) + "|")
    for name in (paper_example(1, 30), paper_example(5, 50), *ARMS):
        shares = _shares(load_problem(f"example:{name}"))
        shares.append(1 - sum(shares))
        cells = " | ".join(f"{100 * share:.0f} %" for share in shares)
        print(f"| {name} | {cells} |")


def _shares(problem: PlanningProblem) -> list[float]:
    profile = cProfile.Profile()
    profile.enable()
    plan(problem, PHASE_ONE)
    profile.disable()
    statistics = pstats.Stats(profile)
    seconds = {name: times[3] for (_, _, name), times in statistics.stats.items()}
    return [seconds[function] / statistics.total_tt for function in SHARES.values()]


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--candidates", nargs="*", type=int, default=[10, 20, 30, 40])
    options = parser.parse_args()
    table_two()
    arms()
    where_the_time_goes()
    print()
    if options.candidates:
        candidates(options.candidates)


if __name__ == "__main__":
    main()
