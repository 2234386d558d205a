"""Measured tubes of the bundled problems: radii, an independent attack, and what they save.

    python benchmarks/measured_tubes.py [PROBLEM ...]

For every problem: time to measure, radii and what ends them, collisions among 10,000 fresh random
configurations (`random_attack.py`), and the planned durations, measured against as written.
"""

import sys

import numpy as np

from cases import ARMS
from random_attack import random_attack
from tubeplanner import PlanOptions, load_problem, measure_tube, plan

CONFIGURATIONS = 10_000
SEED = 1988


def main(names: list[str]) -> None:
    """Measure, attack and plan every problem named."""
    for name in names:
        problem = load_problem(f"example:{name}")
        result = measure_tube(problem)
        print(f"{name}: {result.status} in {result.measuring_time:.1f} s: {result.message}")
        if result.problem is None:
            continue
        for k, segment in enumerate(result.segments):
            ends = [str(each.place) for each in segment.bindings if each.bound == "radius"]
            print(f"  segment {k}: {1000 * segment.radius:.1f} mm, ended by {ends or 'nothing'}")
        rng = np.random.default_rng(SEED)
        count = problem.tube.segment_count
        share = [CONFIGURATIONS // count + (k < CONFIGURATIONS % count) for k in range(count)]
        attacks = [random_attack(result.problem, k, n, rng) for k, n in enumerate(share)]
        print(
            f"  attacked by {sum(attack.configurations for attack in attacks)} configurations: "
            f"{sum(attack.collisions for attack in attacks)} collisions, least clearance "
            f"{1000 * min(attack.least_clearance for attack in attacks):.2f} mm"
        )
        written, measured = (
            plan(each, PlanOptions().shortest) for each in (problem, result.problem)
        )
        print(f"  as written, radii {problem.tube.radius}: {written.message}")
        print(f"  measured: {measured.status}: {measured.message}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:] or [*ARMS, "ur5/level_tray"])
