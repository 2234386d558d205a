"""Resident memory over thousands of plans in one process.

    python benchmarks/memory.py [--count 2000] [--from 200] [--plot FIGURE.png] [--csv TABLE.csv]

Every plan loads a bundled problem anew, most of them of the two-link arm, every tenth of the UR5 or
the Panda, with another radius each time; every seventh has an obstacle in its way and is refused.
Prints the memory as it goes, and by how much it grew from the plan --from to the last. Exit status
1 if that is 5 MB or more.
"""

import argparse
import ctypes
import gc
import sys
from pathlib import Path

from campaign_plan import resident
from tubeplanner import PlanOptions, load_problem, plan

MOST = 5.0  # [MB]
SMALL = ("two_link/around_a_post", "two_link/paper_1_30mm")
LARGE = ("ur5/over_the_wall", "panda/between_shelves")
BLOCK = {"name": "block", "sphere": 0.1, "position": [0.45, -0.3, 0.0]}


def plan_one(k: int) -> str:
    """Plan the k-th problem; return how that ended."""
    names = LARGE if k % 10 == 0 else SMALL
    changes: dict = {"tube.radius": f"x{1 - 0.3 * (k % 31) / 31:.4f}"}
    if k % 7 == 0 and names is SMALL:
        changes["obstacles"] = [BLOCK]
    problem = load_problem(f"example:{names[k // 10 % 2]}", changes=changes)
    return str(plan(problem, PlanOptions(quality="fast", slack=0.0)).status)


def settled() -> float:
    """Return the resident memory once what is free was given back to the system [MB]."""
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    return resident()


def curve(count: int, every: int) -> list[tuple[int, float]]:
    """Return pairs of plans made and memory then [MB]."""
    points = [(0, settled())]
    ended: dict[str, int] = {}
    for k in range(1, count + 1):
        status = plan_one(k)
        ended[status] = ended.get(status, 0) + 1
        if k % every == 0 or k == count:
            points.append((k, settled()))
            print(f"{k:6} plans {points[-1][1]:9.2f} MB", flush=True)
    print(", ".join(f"{number} {status}" for status, number in ended.items()))
    return points


def draw(points: list[tuple[int, float]], path: Path) -> None:
    """Write a figure of the curve."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(7, 3.5), layout="constrained")
    axes.plot(*zip(*points, strict=True), marker=".")
    axes.set(xlabel="plans", ylabel="resident memory [MB]", ylim=(0, None))
    axes.grid(alpha=0.3)
    figure.savefig(path, dpi=130)


def main() -> int:
    """Print the curve and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--from", dest="begin", type=int, default=200)
    parser.add_argument("--plot", type=Path)
    parser.add_argument("--csv", type=Path)
    options = parser.parse_args()
    points = curve(options.count, every=max(options.begin // 4, 1))
    known = dict(points)
    grown = points[-1][1] - known[options.begin]
    print(f"from plan {options.begin} to {options.count}: {grown:+.2f} MB (mark below {MOST:g})")
    if options.plot is not None:
        draw(points, options.plot)
    if options.csv is not None:
        rows = "".join(f"{k},{memory:.3f}\n" for k, memory in points)
        options.csv.write_text("plans,resident_MB\n" + rows)
    return int(grown >= MOST)


if __name__ == "__main__":
    sys.exit(main())
