"""Phase 2 on the paper's examples and on the bundled arms: durations, times, where they go.

    python benchmarks/refinement.py [--repeats 3] [--plot docs/convergence.png]

The paper's fifteen cases beside what a direct transcription with a general solver reached (C2, zero
acceleration at both ends, 80 equal intervals; about 1 % above its own limit for fine grids), and
the bundled arm problems beside stopping at corners and branch and bound, for every quality. Then
the time against joints, segments and knots, and the share of its parts. Times are medians of
planning without its certificate.
"""

import argparse
import cProfile
import pstats
import time
from pathlib import Path

import numpy as np

from cases import ARMS, EXAMPLES, RADII, paper_example
from tubeplanner import (
    PlanningProblem,
    PlanOptions,
    PlanResult,
    Progress,
    Tube,
    load_problem,
    plan,
    plot_convergence,
)
from tubeplanner.branches.reference_branch import redundancy_rules, reference_branch
from tubeplanner.constraints.time_scaling import scaled_to_limits
from tubeplanner.planning.plan_options import QUALITIES
from tubeplanner.refinement.refinement import Refinement
from tubeplanner.refinement.spline_start import starting_spline

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
SEGMENTS = (1, 2, 3, 4, 6, 8)
KNOTS = ((8, (2,)), (8, (3,)), (8, (2, 2)), (8, (2, 3)), (8, (3, 3)), (12, (3, 3)), (16, (3, 3)))
# Functions that share out the planning time; none calls another.
SHARES = {
    "branch": ("known_branches", "along"),
    "linear programs": ("linear_program", "solve"),
    "again, corrected": ("linear_program", "solve_again"),
    "rows": ("motion_conditions", "rows"),
    "trials": ("motion_conditions", "at"),
    "looking at links": ("motion_conditions", "look_for_links"),
    "certificate": ("verification", "verify"),
}


def timed(problem: PlanningProblem, options: PlanOptions, repeats: int) -> tuple[PlanResult, float]:
    """Return a plan and the median time of making it, its certificate left out [s]."""
    results = [plan(problem, options.shortest) for _ in range(repeats)]
    return results[0], float(np.median([r.planning_time - r.certificate_time for r in results]))


def paper(repeats: int) -> None:
    """Print the paper's fifteen cases."""
    print("| example | radius [m] | printed [s] | possible [s] | here [s] | ratio | time [s] |")
    print("|---|---|---|---|---|---|---|")
    ratios, times = [], []
    for example in EXAMPLES:
        for radius, possible, printed in zip(
            RADII, POSSIBLE[example], PRINTED[example], strict=True
        ):
            problem = load_problem(f"example:{paper_example(example, radius)}")
            result, seconds = timed(problem, PlanOptions(), repeats)
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
        problem = load_problem(f"example:{name}")
        methods = [PlanOptions("stop-at-corners"), PlanOptions("branch-and-bound")]
        cells = []
        for options in [*methods, *(PlanOptions(quality=quality) for quality in QUALITIES)]:
            result, seconds = timed(problem, options, repeats)
            other = "" if result.method == options.method else f" ({result.method})"
            cells.append(f"{result.duration:.4f} / {seconds:.2f}{other}")
        print(f"| {name} | {' | '.join(cells)} |", flush=True)
    print()


def zigzag(name: str, segments: int) -> PlanningProblem:
    """Return a tube of right angles from the middle of a bundled problem's first segment."""
    base = load_problem(f"example:{name}")
    robot = base.robot
    first = reference_branch(base, redundancy_rules(base)[0]).segments[0]
    start = first[len(first) // 2]
    tool = robot.tool_position(start[None])[0]
    inwards = -np.array([tool[0], tool[1], 0.0]) / np.linalg.norm(tool[:2])
    sideways = np.array([-inwards[1], inwards[0], 0.0])
    steps = [0.10 * inwards, 0.08 * sideways, -0.10 * inwards, 0.08 * sideways]
    points = np.cumsum([tool, *(steps[k % 4] for k in range(segments))], axis=0)
    tube = Tube(points, 0.03, joint_signs=base.tube.joint_ranges[0])
    return PlanningProblem(robot, tube, start)


def sizes(repeats: int) -> None:
    """Print the time against the number of joints and segments."""
    print("Time [s] (duration [s]) of a zigzag of right angles, by joints and segments:\n")
    print(f"| arm | joints | {' | '.join(f'{count} segm.' for count in SEGMENTS)} |")
    print("|---" * (len(SEGMENTS) + 2) + "|")
    for name in ("two_link/paper_1_30mm", "ur5/over_the_wall", "panda/between_shelves"):
        cells = []
        for count in SEGMENTS:
            problem = zigzag(name, count)
            result, seconds = timed(problem, PlanOptions(), repeats)
            found = f"{result.duration:.3f}" if result.method == "refinement" else result.status
            cells.append(f"{seconds:.2f} ({found})")
        joints = problem.robot.joint_count
        print(f"| {name.split('/')[0]} | {joints} | {' | '.join(cells)} |", flush=True)
    print()


def knots(repeats: int) -> None:
    """Print what the number of knots changes: duration and time of refinement alone."""
    cells = [f"{first} x {' x '.join(map(str, parts))}" for first, parts in KNOTS]
    print("Duration [s] / time [s] of refinement alone, by knots and how they are divided:\n")
    print(f"| problem | {' | '.join(cells)} |")
    print("|---" * (len(KNOTS) + 1) + "|")
    for name in (paper_example(1, 10), paper_example(5, 10), *ARMS[1:]):
        problem = load_problem(f"example:{name}")
        branch = reference_branch(problem, redundancy_rules(problem)[0])
        cells = []
        for first, parts in KNOTS:
            times = []
            for _ in range(repeats):
                begin = time.perf_counter()
                refinement = Refinement(problem, starting_spline(problem, branch, first), parts)
                refinement.run()
                times.append(time.perf_counter() - begin)
            duration = scaled_to_limits(problem, refinement.trajectory).duration
            cells.append(f"{duration:.4f} / {np.median(times):.2f}")
        print(f"| {name} | {' | '.join(cells)} |", flush=True)
    print()


def where_the_time_goes() -> None:
    """Print the share of the planning time of several parts, measured under a profiler."""
    print("Share of the planning time (under a profiler, which favours compiled code):\n")
    print(f"| problem | {' | '.join(SHARES)} | rest |")
    print("|---" * (len(SHARES) + 2) + "|")
    for name in (paper_example(1, 30), paper_example(5, 10), *ARMS):
        problem = load_problem(f"example:{name}")
        profile = cProfile.Profile()
        profile.runcall(plan, problem)
        statistics = pstats.Stats(profile)
        seconds = {
            (Path(file).stem, function): found[3]
            for (file, _, function), found in statistics.stats.items()
        }
        shares = [seconds.get(place, 0.0) / statistics.total_tt for place in SHARES.values()]
        cells = " | ".join(f"{100 * share:.0f} %" for share in [*shares, 1 - sum(shares)])
        print(f"| {name} | {cells} |", flush=True)
    print()


def convergence(path: Path) -> None:
    """Draw how the duration falls while refining, step by step."""
    histories: dict[str, list[Progress]] = {}
    for name in (paper_example(1, 30), paper_example(5, 10), *ARMS[1:]):
        histories[name] = []
        plan(load_problem(f"example:{name}"), PlanOptions().shortest, histories[name].append)
    plot_convergence(histories, path)
    print(f"{path}")


def main() -> None:
    """Print the tables, and draw the picture if it is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=3, help="of each plan")
    parser.add_argument("--plot", type=Path, help="picture of the convergence")
    options = parser.parse_args()
    paper(options.repeats)
    arms(options.repeats)
    sizes(options.repeats)
    knots(options.repeats)
    where_the_time_goes()
    if options.plot:
        convergence(options.plot)


if __name__ == "__main__":
    main()
