"""Phase 2 on the paper's examples and on the bundled arms: durations and times.

    python benchmarks/refinement.py [--repeats 3]

The paper's fifteen cases beside what a direct transcription with a general solver reached (C2, zero
acceleration at both ends, 80 intervals; about 1 % above its own limit for fine grids), and the
bundled arm problems beside stopping at corners and branch and bound, for every quality. Times are
medians of planning without its certificate.
"""

import argparse

import numpy as np

from tubeplanner import PlanOptions, PlanResult, load_problem, plan

# What is possible [s] at 10, 30 and 50 mm, by example; what the paper printed after its phase 2.
POSSIBLE = {
    1: (0.706, 0.688, 0.671),
    2: (0.357, 0.353, 0.353),
    3: (0.693, 0.678, 0.665),
    4: (0.666, 0.651, 0.636),
    5: (1.057, 0.974, 0.956),
}
PRINTED = {
    1: (0.90, 0.75, 0.73),
    2: (0.40, 0.39, 0.39),
    3: (0.92, 0.83, 0.80),
    4: (0.80, 0.77, 0.72),
    5: (1.52, 1.26, 1.03),
}
RADII = (10, 30, 50)  # [mm]
ARMS = (
    "two_link/around_a_post",
    "ur5/over_the_wall",
    "ur10/onto_a_conveyor",
    "panda/between_shelves",
    "xarm7/from_crate_to_crate",
)
QUALITIES = ("fast", "balanced", "best")


def timed(name: str, options: PlanOptions, repeats: int) -> tuple[PlanResult, float]:
    """Return a plan and the median time of making it, its certificate left out [s]."""
    problem = load_problem(f"example:{name}")
    results = [plan(problem, options) for _ in range(repeats)]
    return results[0], float(np.median([r.planning_time - r.certificate_time for r in results]))


def paper(repeats: int) -> None:
    """Print the paper's fifteen cases."""
    print("| example | radius [m] | printed [s] | possible [s] | here [s] | ratio | time [s] |")
    print("|---|---|---|---|---|---|---|")
    ratios, times = [], []
    for example, row in POSSIBLE.items():
        for radius, possible, printed in zip(RADII, row, PRINTED[example], strict=True):
            result, seconds = timed(f"two_link/paper_{example}_{radius}mm", PlanOptions(), repeats)
            ratios.append(result.duration / possible)
            times.append(seconds)
            print(
                f"| {example} | {radius / 1000:.2f} | {printed:.2f} | {possible:.3f} | "
                f"{result.duration:.4f} | {ratios[-1]:.4f} | {seconds:.3f} |",
                flush=True,
            )
    print(
        f"\nRatio mean {np.mean(ratios):.4f}, worst {max(ratios):.4f}; time median "
        f"{np.median(times):.3f} s, longest {max(times):.3f} s.\n"
    )


def arms(repeats: int) -> None:
    """Print the bundled arm problems: duration [s] / time [s] by method and quality."""
    print(f"| problem | stop at corners | branch and bound | {' | '.join(QUALITIES)} |")
    print("|---" * (3 + len(QUALITIES)) + "|")
    for name in ARMS:
        methods = [PlanOptions("stop-at-corners"), PlanOptions("branch-and-bound")]
        cells = []
        for options in [*methods, *(PlanOptions(quality=quality) for quality in QUALITIES)]:
            result, seconds = timed(name, options, repeats)
            other = "" if result.method == options.method else f" ({result.method})"
            cells.append(f"{result.duration:.4f} / {seconds:.2f}{other}")
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=3, help="of each plan")
    options = parser.parse_args()
    paper(options.repeats)
    arms(options.repeats)


if __name__ == "__main__":
    main()
