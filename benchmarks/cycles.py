"""What do shared configurations and passing through save in cycles, and at what price?

    python benchmarks/cycles.py [--only SUBSTRING]

Plans every bundled cycle with its moves alone, each from where the last ended; with shared
configurations; both also with a stop after every move; and beside them TOPP-RA's scheme, exactly
solved, along the tool's straight lines with a stop at every point, between the same configurations.
All at slack 0. Prints one table: seconds in motion, gains, and the processor time of sharing as a
multiple of that of the moves alone. Exit status 1 if sharing is slower than moves alone, or takes
more than twice their time.
"""

import argparse
import time
from dataclasses import replace

import numpy as np

from tubeplanner import Cycle, CycleResult, Move, PlanOptions, load_cycle, plan, plan_cycle
from tubeplanner.first_guess.baselines import judged_baseline
from tubeplanner.outcome import Infeasible
from tubeplanner.resources import bundled_cycles

SHORTEST = PlanOptions(slack=0.0)
MAX_TIME = 2.0


def with_stops(cycle: Cycle) -> Cycle:
    """Return a cycle that stops after every move."""
    steps = [
        replace(step, passes_through=False) if isinstance(step, Move) else step
        for step in cycle.steps
    ]
    return replace(cycle, steps=steps)


def timed(cycle: Cycle, *, fractions: bool) -> tuple[CycleResult, float]:
    """Return the plan of a cycle, and its processor time [s]."""
    begun = time.process_time()
    result = plan_cycle(cycle, SHORTEST, shares_configurations=fractions)
    return result, time.process_time() - begun


def moving(result: CycleResult) -> float:
    """Return how long a cycle moves [s], nan if there is no answer."""
    return sum(leg.duration for leg in result.legs) if result.succeeded else np.nan


def stopping(cycle: Cycle, result: CycleResult) -> str:
    """Return how long TOPP-RA's scheme takes between an answer's seams [s].

    Along a leg's straight lines where it finds no speed, stopping at corners may turn the tool
    otherwise: so many legs follow after a +; one that this does not run either makes it a dash.
    """
    total, others = 0.0, 0
    for problem in cycle.problems(result.motion.junctions):
        try:
            total += judged_baseline(problem, "bang-bang")[0].trajectory.duration
        except Infeasible:
            corners = plan(problem, PlanOptions(method="stop-at-corners", slack=0.0))
            if corners.duration is None:
                return "-"
            total, others = total + corners.duration, others + 1
    return f"{total:.4f}" + (f" (+{others})" if others else "")


def row(name: str) -> tuple[str, bool]:
    """Return a bundled cycle's row, and whether it keeps what it must."""
    cycle = load_cycle(name)
    alone, alone_time = timed(cycle, fractions=False)
    shared, shared_time = timed(cycle, fractions=True)
    if not (alone.succeeded and shared.succeeded):
        return f"| {name} | {alone.message} / {shared.message} |", False
    stops = with_stops(cycle)
    stops_alone = moving(timed(stops, fractions=False)[0])
    stops_shared, _ = timed(stops, fractions=True)
    baseline = stopping(stops, stops_shared) if stops_shared.succeeded else "-"
    gain = 1 - moving(shared) / moving(alone)
    ratio = shared_time / alone_time
    cells = (
        *(name, f"{len(cycle.legs)}", baseline, f"{stops_alone:.4f}"),
        *(f"{moving(stops_shared):.4f}", f"{moving(alone):.4f}", f"{moving(shared):.4f}"),
        *(f"{100 * gain:.2f} %", f"{alone_time:.1f}", f"{ratio:.2f}"),
    )
    return "| " + " | ".join(cells) + " |", gain >= 0 and ratio <= MAX_TIME


def main() -> int:
    """Plan and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="cycles whose name contains this")
    given = parser.parse_args()
    print(
        "| cycle | legs | TOPP-RA, stops [s] | stops, alone [s] | stops, shared [s] "
        "| alone [s] | shared [s] | gain | alone: processor [s] | ratio |"
    )
    print("|" + "---|" * 10)
    is_good = []
    for name in bundled_cycles():
        if given.only in name:
            text, good = row(f"example:{name}")
            print(text, flush=True)
            is_good.append(good)
    return 0 if all(is_good) else 1


if __name__ == "__main__":
    raise SystemExit(main())
