"""The published method on the paper's examples and on the bundled arms.

    python benchmarks/suh_bishop.py [--no-arms]

Prints the durations beside Table II (Suh & Bishop 1988), phase 1 and phase 2, and what phase 2 did
with the bundled arms. Every trajectory is certified, or the table says so.
"""

import argparse
import time

import numpy as np

from cases import ARMS, RADII, paper_example
from phase_one import PRINTED
from tubeplanner import PlanOptions, PlanResult, load_problem, plan

METHOD = PlanOptions("suh-bishop")
# Suh & Bishop 1988, Table II: duration after phase 2 [s] at these radii, by example.
PRINTED_PHASE_TWO = {
    1: (0.90, 0.75, 0.73),
    2: (0.40, 0.39, 0.39),
    3: (0.92, 0.83, 0.80),
    4: (0.80, 0.77, 0.72),
    5: (1.52, 1.26, 1.03),
}


def timed(name: str) -> tuple[PlanResult, float]:
    """Return the plan of a bundled problem and the processor time it took [s]."""
    problem = load_problem(f"example:{name}")
    begin = time.process_time()
    result = plan(problem, METHOD)
    return result, time.process_time() - begin


def table_two() -> None:
    """Print the paper's examples beside its figures."""
    print(
        "| example | radius [m] | phase 1 [s] | printed | ratio | phase 2 [s] | printed | ratio | "
        "knots | nodes | certified | processor [s] |"
    )
    print("|---" * 12 + "|")
    ratios, times = [], []
    for example in PRINTED:
        rows = zip(RADII, PRINTED[example], PRINTED_PHASE_TWO[example], strict=True)
        for radius, printed_one, printed_two in rows:
            result, seconds = timed(paper_example(example, radius))
            first, second = result.phase1_duration / printed_one, result.duration / printed_two
            ratios.append((first, second))
            times.append(seconds)
            work = result.phase_two
            budget = " (budget)" if work.budget_reached else ""
            print(
                f"| {example} | {radius / 1000:.2f} | {result.phase1_duration:.3f} | "
                f"{printed_one:.2f} | {first:.3f} | {result.duration:.3f} | {printed_two:.2f} | "
                f"{second:.3f} | {work.knots} | {work.nodes}{budget} | "
                f"{'yes' if result.certificate.passed else 'NO'} | {seconds:.1f} |",
                flush=True,
            )
    mean, worst = np.mean(ratios, axis=0), np.max(ratios, axis=0)
    print(
        f"\nTo the printed durations: phase 1 mean {mean[0]:.3f}, worst {worst[0]:.3f}; phase 2 "
        f"mean {mean[1]:.3f}, worst {worst[1]:.3f}. Processor time median {np.median(times):.1f} "
        f"s, longest {np.max(times):.1f} s.\n"
    )


def arms() -> None:
    """Print the bundled arm problems."""
    print("| problem | joints | phase 1 [s] | phase 2 [s] | processor [s] | what phase 2 did |")
    print("|---" * 6 + "|")
    for name in ARMS:
        result, seconds = timed(name)
        joints = load_problem(f"example:{name}").robot.joint_count
        durations = "- | -"
        if result.succeeded:
            durations = f"{result.phase1_duration:.4f} | {result.duration:.4f}"
        done = result.phase_two or result.message
        print(f"| {name} | {joints} | {durations} | {seconds:.1f} | {done} |", flush=True)


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--no-arms", action="store_true")
    options = parser.parse_args()
    table_two()
    if not options.no_arms:
        arms()


if __name__ == "__main__":
    main()
