"""How many random problems of an arm are planned, how quickly, and how near the best of ten starts?

    python benchmarks/random_set.py [--arm NAME ...] [--count 10] [--seed 0] [--starts 20]
        [--time-limit SECONDS]

Every problem is one of the campaign's making for that arm (`campaign_problems.py`): it is built
round a trajectory that solves it by the outside judge's verdict. None is left out because planning
fails. In the end, for some of them, the default plan beside the best of ten starts of refinement.
Arms: the bundled ones by default, and those of `ARMS`, of other makers and on walls.
"""

import argparse
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from campaign_problems import build
from campaign_witness import BUNDLED, Unsuitable, bundled_arm
from tubeplanner import PlanningProblem, PlanOptions, PlanResult, load_problem, plan
from tubeplanner.first_guess.branches import ReferenceBranch, redundancy_rules, reference_branch
from tubeplanner.limits.speed_limits import scaled_to_limits
from tubeplanner.optimizer.stages import Refinement
from tubeplanner.optimizer.starts import starting_spline
from tubeplanner.outcome import Infeasible, PlanningClock
from tubeplanner.planning.options import REFINEMENT
from tubeplanner.planning.result import certified_result

STARTS = 10
STARTING_INTERVALS = (8, 12, 16, 10, 6, 14, 20, 9, 7, 18)
MAX_INTERVALS = 72  # about what a start's knots are divided to: the default quality's
MAX_OBJECTIONS = 5
# Sections `robot` of problem files.
ARMS: dict[str, dict[str, Any]] = {name: bundled_arm(name) for name in BUNDLED} | {
    "ur3": {"urdf": "example:ur3", "tool_frame": "tool0"},
    "ur10 on a wall": {**bundled_arm("ur10"), "gravity": [-9.81, 0, 0]},
    "ur10 with 5 kg": {**bundled_arm("ur10"), "payload": {"mass": 5.0, "com": [0, 0, 0.1]}},
    "z1": {"urdf": "example:z1", "tool_frame": "link06"},
    "kinova": {"urdf": "example:kinova", "tool_frame": "j2s6s200_end_effector"},
    "talos_arm": {"urdf": "example:talos_arm", "tool_frame": "arm_left_7_link"},
    "baxter": {"urdf": "example:baxter", "tool_frame": "left_gripper"},
    "so101": {"urdf": "example:so101", "tool_frame": "gripper_link"},
    "asr_twodof": {"urdf": "example:asr_twodof", "tool_frame": "Tip"},
    "double_pendulum": {
        "urdf": "example:double_pendulum",
        "tool_frame": "link2",
        "tool_offset": {"position": [0, 0, 0.2]},
        "limits": {
            "effort": {"joint1": 5.0, "joint2": 5.0},
            "velocity": {"joint1": 6.0, "joint2": 6.0},
            "position": {"joint1": [-3.0, 3.0], "joint2": [-3.0, 3.0]},
        },
    },
}


@dataclass(frozen=True, eq=False)
class Outcome:
    """A problem and its plan."""

    name: str
    problem: PlanningProblem
    result: PlanResult


def outcomes(arm: str, seeds: range, options: PlanOptions) -> Iterator[Outcome]:
    """Make and plan the problems of an arm, one after the other, and print a line for each."""
    for seed in seeds:
        with tempfile.TemporaryDirectory() as folder:
            try:
                problem = load_problem(build(seed, Path(folder), robot=ARMS[arm]).path)
            except Unsuitable as reason:
                print(f"  {arm}, seed {seed}: {reason}", flush=True)
                continue
        _ = problem.collision  # geometry is built before planning begins
        result = plan(problem, options)
        print(
            f"  {arm}, seed {seed}: {result.status} after {result.planning_time:.2f} s: "
            f"{result.message}",
            flush=True,
        )
        yield Outcome(f"{arm}, seed {seed}", problem, result)


def table(rows: dict[str, list[Outcome]]) -> None:
    """Print a row per arm and one for all."""
    print(
        "\n| arm | joints | planned | by refinement | planning [s]: median | 90 % | longest "
        "| certificate [s]: mean |"
    )
    print("|---" * 8 + "|")
    everything = [outcome for row in rows.values() for outcome in row]
    for arm, row in {**rows, "all": everything}.items():
        if not row:
            continue
        good = [outcome.result for outcome in row if outcome.result.succeeded]
        refined = sum(result.method == REFINEMENT for result in good)
        joints = sorted({outcome.problem.robot.joint_count for outcome in row})
        times = np.array([outcome.result.planning_time for outcome in row])
        certificate = np.mean([result.certificate_time for result in good] or [np.nan])
        print(
            f"| {arm} | {joints[0] if len(joints) == 1 else ''} | {len(good)} of {len(row)} "
            f"| {refined} | {np.median(times):.2f} | {np.quantile(times, 0.9):.2f} "
            f"| {times.max():.2f} | {certificate:.3f} |"
        )


def starts_of(problem: PlanningProblem) -> Iterator[tuple[ReferenceBranch, int]]:
    """Yield different starts of refinement: branches that differ, each with several knot counts."""
    branches: list[ReferenceBranch] = []
    for rule in redundancy_rules(problem):
        try:
            branch = reference_branch(problem, rule)
        except Infeasible:
            continue
        if not any(_is_same(branch, known) for known in branches):
            branches.append(branch)
    for intervals in STARTING_INTERVALS:
        for branch in branches:
            yield branch, intervals


def _is_same(one: ReferenceBranch, other: ReferenceBranch) -> bool:
    return all(
        len(a) == len(b) and np.allclose(a, b, atol=1e-3)
        for a, b in zip(one.segments, other.segments, strict=True)
    )


def certified_duration(
    problem: PlanningProblem, branch: ReferenceBranch, intervals: int
) -> float | None:
    """Return what refinement reaches from one start [s]; None if that is not certified."""
    try:
        start = starting_spline(problem, branch, intervals)
        parts = max(1, round((MAX_INTERVALS / start.grid.interval_count) ** 0.5))
        refinement = Refinement(problem, start, (parts, parts) if parts > 1 else ())
        refinement.run()
        for _ in range(MAX_OBJECTIONS):
            trajectory = scaled_to_limits(problem, refinement.trajectory)
            result = certified_result(problem, trajectory, REFINEMENT, PlanningClock(None, None))
            if result.succeeded or result.certificate is None:
                return result.duration
            if not refinement.answer(result.certificate, trajectory.duration):
                return None
    except Infeasible:
        return None
    return None


def best_of_starts(planned: list[Outcome], count: int) -> None:
    """Print how far the default plan is from the best of ten starts, for some of the problems."""
    chosen = [planned[k * len(planned) // count] for k in range(count)]
    print("\n| problem | default [s] | best of ten starts [s] | certified | gap |")
    print("|---|---|---|---|---|")
    gaps = []
    for outcome in chosen if len(planned) > count else planned:
        duration = outcome.result.duration or np.inf
        starts = islice(starts_of(outcome.problem), STARTS)
        tried = [certified_duration(outcome.problem, *start) for start in starts]
        good = [each for each in tried if each is not None]
        best = min([duration, *good])
        gaps.append(100 * (duration / best - 1))
        print(
            f"| {outcome.name} | {duration:.4f} | {best:.4f} | {len(good)} of {len(tried)} | "
            f"{gaps[-1]:.2f} % |",
            flush=True,
        )
    print(f"\nGap to the best: median {np.median(gaps):.2f} %, worst {max(gaps):.2f} %.")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    names = ", ".join(ARMS)
    parser.add_argument(
        "--arm", nargs="+", choices=ARMS, default=list(BUNDLED), metavar="NAME", help=f"of {names}"
    )
    parser.add_argument("--count", type=int, default=10, help="problems per arm")
    parser.add_argument("--seed", type=int, default=0, help="of the first problem")
    parser.add_argument("--time-limit", type=float, help="of every plan [s]")
    parser.add_argument("--starts", type=int, default=20, help="problems with ten starts")
    options = parser.parse_args()
    begin, seeds = time.perf_counter(), range(options.seed, options.seed + options.count)
    how = PlanOptions(time_limit=options.time_limit, slack=0.0)
    rows = {arm: list(outcomes(arm, seeds, how)) for arm in options.arm}
    table(rows)
    everything = [outcome for row in rows.values() for outcome in row]
    refined = [
        outcome
        for outcome in everything
        if outcome.result.succeeded and outcome.result.method == REFINEMENT
    ]
    if options.starts and refined:
        best_of_starts(refined, options.starts)
    print(f"\n{time.perf_counter() - begin:.0f} s in all.")


if __name__ == "__main__":
    main()
