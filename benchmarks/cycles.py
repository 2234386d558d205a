"""Bundled cycles: what shared configurations and passing through save, and at what price.

    python benchmarks/cycles.py [--only SUBSTRING] [--grid]

Plans every bundled cycle with its moves alone, each from where the last ended; with shared
configurations; both also with a stop after every move; and beside them TOPP-RA's scheme, exactly
solved, along the tool's straight lines with a stop at every point, between the same configurations.
All at slack 0. Prints one table: seconds in motion, gains, and the processor time of sharing as a
multiple of that of the moves alone. `--grid` also compares a cycle of the two-link arm with a grid
over all configurations in which its moves may end. Exit status 1 if sharing is slower than moves
alone, takes more than twice their time, or misses the grid by more than 0.5 %.
"""

import argparse
import time
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from tubeplanner import (
    Cycle,
    CycleResult,
    Move,
    PlanOptions,
    load_cycle,
    parse_cycle,
    plan,
    plan_cycle,
)
from tubeplanner.baselines.baselines import judged_baseline
from tubeplanner.cycle_planning.greedy_plan import BlockedLeg, planned_leg
from tubeplanner.outcome import Infeasible
from tubeplanner.progress import PlanningClock
from tubeplanner.resources import bundled_cycles

SHORTEST = PlanOptions(slack=0.0)
MOST_TIME, MOST_MISSED = 2.0, 0.005
TWO_LINK: dict[str, Any] = {
    "format": "tubeplanner/cycle",
    "robot": {"urdf": "example:two_link", "tool_frame": "hand", "gravity": [0, 0, 0]},
    "start": {"seed": [0.0, -1.0]},
    "moves": [
        {
            "name": "first",
            "tube": {"points": [[0.45, -0.3, 0], [0.45, 0.1, 0]], "radius": 0.05},
            "goal": {"position": [0.45, 0.1, 0], "tolerance": 0.05},
        },
        {
            "name": "second",
            "tube": {"points": [[0.45, 0.1, 0], [0.2, 0.25, 0]], "radius": 0.05},
            "goal": {"position": [0.2, 0.25, 0], "tolerance": 0.05},
        },
        {"name": "third", "tube": {"points": [[0.2, 0.25, 0], [0.2, 0.55, 0]], "radius": 0.05}},
    ],
}


def with_stops(cycle: Cycle) -> Cycle:
    """Return a cycle that stops after every move."""
    steps = [
        replace(step, passes_through=False) if isinstance(step, Move) else step
        for step in cycle.steps
    ]
    return replace(cycle, steps=steps)


def timed(cycle: Cycle, *, shares: bool) -> tuple[CycleResult, float]:
    """Return the plan of a cycle, and its processor time [s]."""
    begun = time.process_time()
    result = plan_cycle(cycle, SHORTEST, shares_configurations=shares)
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
    for problem in cycle.problems(result.motion.seams):
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
    alone, alone_time = timed(cycle, shares=False)
    shared, shared_time = timed(cycle, shares=True)
    if not (alone.succeeded and shared.succeeded):
        return f"| {name} | {alone.message} / {shared.message} |", False
    stops = with_stops(cycle)
    stops_alone = moving(timed(stops, shares=False)[0])
    stops_shared, _ = timed(stops, shares=True)
    baseline = stopping(stops, stops_shared) if stops_shared.succeeded else "-"
    gain = 1 - moving(shared) / moving(alone)
    ratio = shared_time / alone_time
    cells = (
        *(name, f"{len(cycle.legs)}", baseline, f"{stops_alone:.4f}"),
        *(f"{moving(stops_shared):.4f}", f"{moving(alone):.4f}", f"{moving(shared):.4f}"),
        *(f"{100 * gain:.2f} %", f"{alone_time:.1f}", f"{ratio:.2f}"),
    )
    return "| " + " | ".join(cells) + " |", gain >= 0 and ratio <= MOST_TIME


class Grid:
    """A cycle of three moves of the two-link arm, over a grid of the ends of the first two."""

    def __init__(self) -> None:
        self.cycle = parse_cycle(TWO_LINK, name="two_link/three_moves")
        self._clock = PlanningClock(None, None)
        self._known: dict[tuple[int, bytes, bytes], float] = {}
        self.start = plan_cycle(self.cycle, SHORTEST).motion.seams[0]

    def best(self, middles: list[np.ndarray], spacing: float) -> tuple[float, list[np.ndarray]]:
        """Return the least sum of durations, over points about two tool positions, and where."""
        steps = np.array(list(product((-2, -1, 0, 1, 2), repeat=2))) * spacing
        first, second = (self._configurations(k, middles[k], steps) for k in (0, 1))
        sums = {
            (i, j): self._duration(0, self.start, q)
            + self._duration(1, q, p)
            + self._duration(2, p, None)
            for (i, q), (j, p) in product(enumerate(first), enumerate(second))
        }
        i, j = min(sums, key=lambda pair: sums[pair])
        tools = [self.cycle.robot.tool_position(q[None])[0] for q in (first[i], second[j])]
        return sums[i, j], tools

    def _configurations(self, k: int, middle: np.ndarray, steps: np.ndarray) -> list[np.ndarray]:
        goal = self.cycle.legs[k].joined.goal
        places = [middle + np.append(step, 0.0) for step in steps]
        inside = [p for p in places if np.linalg.norm(p - goal.position) <= goal.tolerance]
        return [self._solved(p) for p in inside]

    def _solved(self, tool: np.ndarray) -> np.ndarray:
        """Return the configuration with the elbow bent as the start has it (closed form)."""
        a, b = self._lengths
        cosine = (tool[:2] @ tool[:2] - a * a - b * b) / (2 * a * b)
        elbow = np.sign(self.start[1]) * np.arccos(np.clip(cosine, -1, 1))
        shoulder = np.arctan2(tool[1], tool[0]) - np.arctan2(
            b * np.sin(elbow), a + b * np.cos(elbow)
        )
        return np.array([shoulder, elbow])

    @property
    def _lengths(self) -> tuple[float, float]:
        robot = self.cycle.robot
        out, folded = (
            float(np.linalg.norm(robot.tool_position(np.array([[0.0, q]]))[0]))
            for q in (0.0, np.pi)
        )
        return (out + folded) / 2, (out - folded) / 2

    def _duration(self, k: int, begin: np.ndarray, end: np.ndarray | None) -> float:
        key = (k, begin.tobytes(), b"" if end is None else end.tobytes())
        if key not in self._known:
            seams = [self.start] * k + [begin]
            try:
                problem = self.cycle.problem(k, seams, end)
                plan = planned_leg(self.cycle, k, problem, SHORTEST, self._clock)
                self._known[key] = plan.duration
            except BlockedLeg:
                self._known[key] = np.inf
        return self._known[key]


def grid_row() -> tuple[str, bool]:
    """Return how a cycle of the two-link arm compares with a grid, and whether it is as good."""
    grid = Grid()
    alone, shared = (moving(timed(grid.cycle, shares=flag)[0]) for flag in (False, True))
    middles = [np.array(grid.cycle.legs[k].joined.goal.position) for k in (0, 1)]
    spacing = 0.0249
    best = np.inf
    for _ in range(3):
        found, middles = grid.best(middles, spacing)
        best, spacing = min(best, found), spacing / 2.5
    missed = shared / best - 1
    text = (
        f"two-link arm, three moves: alone {alone:.4f} s, shared {shared:.4f} s, best of the grid "
        f"{best:.4f} s: {100 * missed:+.2f} %"
    )
    return text, missed <= MOST_MISSED


def main() -> int:
    """Plan and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="cycles whose name contains this")
    parser.add_argument("--grid", action="store_true", help="the two-link arm against a grid too")
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
    if given.grid:
        text, good = grid_row()
        print(text)
        is_good.append(good)
    return 0 if all(is_good) else 1


if __name__ == "__main__":
    raise SystemExit(main())
