"""Plan 200 random problems that have a solution: shares planned, times, and every failure.

    python benchmarks/random_set.py [--robot NAME ...] [--count 40 | --seeds A..B]
        [--time-limit SECONDS] [--starts-subset 20]

Forty problems for each of five arms, made by `random_problems.py`: 1 to 5 segments, turns of up to
150 degrees, radii of 1 to 15 cm, half with obstacles, a quarter with a rotation tolerance, with and
without goal and joint signs. Each is built around a walk that solves it, and that walk is checked
again before the problem is planned. None is left out because planning fails. In the end, for some
of them, the default plan beside the best of ten starts of refinement.
"""

import argparse
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np

from random_problems import ARMS, RULES, random_case
from tubeplanner import PlanningProblem, PlanOptions, PlanResult, plan
from tubeplanner.branches.reference_branch import (
    ReferenceBranch,
    redundancy_rules,
    reference_branch,
)
from tubeplanner.constraints.time_scaling import scaled_to_limits
from tubeplanner.outcome import Infeasible
from tubeplanner.planning.plan_options import REFINEMENT
from tubeplanner.planning.plan_result import certified_result
from tubeplanner.progress import PlanningClock
from tubeplanner.refinement.refinement import Refinement
from tubeplanner.refinement.spline_start import starting_spline
from witness import RandomCase, witness_holds

COUNT = 40  # problems per arm
STARTS = 10
STARTING_INTERVALS = (8, 12, 16, 10, 6, 14, 20, 9, 7, 18)
MAX_INTERVALS = 72  # about what a start's knots are divided to: the default quality's
MAX_OBJECTIONS = 5


@dataclass(frozen=True, eq=False)
class Outcome:
    """A case and what planning made of it."""

    case: RandomCase
    result: PlanResult

    @property
    def is_certified(self) -> bool:
        """Whether there is a plan whose certificate has nothing to object to."""
        certificate = self.result.certificate
        return self.result.succeeded and certificate is not None and not certificate.failures()


def outcomes(
    arm: str, seeds: range, options: PlanOptions, rejections: Counter[str]
) -> Iterator[Outcome]:
    """Make and plan the problems of an arm, one after the other."""
    robot = ARMS[arm]()
    for seed in seeds:
        case = random_case(arm, robot, seed, rejections)
        if not witness_holds(case, parts=7):
            raise RuntimeError(f"{arm}, seed {seed}: the witness does not solve the problem")
        _ = case.problem.collision  # geometry is built before planning begins
        outcome = Outcome(case, plan(case.problem, options))
        print(_line(outcome), file=sys.stderr, flush=True)
        yield outcome


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


def certified_duration(
    problem: PlanningProblem, branch: ReferenceBranch, intervals: int
) -> float | None:
    """Return what refinement reaches from one start [s]; None if that is not certified."""
    start = starting_spline(problem, branch, intervals)
    parts = max(1, round((MAX_INTERVALS / start.grid.interval_count) ** 0.5))
    refinement = Refinement(problem, start, (parts, parts) if parts > 1 else ())
    try:
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


def _is_same(one: ReferenceBranch, other: ReferenceBranch) -> bool:
    return all(
        len(a) == len(b) and np.allclose(a, b, atol=1e-3)
        for a, b in zip(one.segments, other.segments, strict=True)
    )


def _line(outcome: Outcome) -> str:
    case, result = outcome.case, outcome.result
    duration = "" if result.duration is None else f" of {result.duration:.3f} s"
    return (
        f"{case.problem.name}: {result.status} by {result.method}{duration} "
        f"after {result.planning_time:.2f} s"
    )


def table(found: dict[str, list[Outcome]]) -> None:
    """Print a row per arm and one for all."""
    print(
        "| arm | problems | success | certified | by refinement | planning [s]: median | 90 % "
        "| longest | certificate [s]: mean |"
    )
    print("|---" * 9 + "|")
    rows = dict(found)
    if len(found) > 1:
        rows["all"] = [outcome for row in found.values() for outcome in row]
    for arm, row in rows.items():
        good = [outcome for outcome in row if outcome.result.succeeded]
        counts = (
            len(good),
            sum(outcome.is_certified for outcome in row),
            sum(outcome.result.method == REFINEMENT for outcome in good),
        )
        shares = " | ".join(f"{100 * count / len(row):.1f} %" for count in counts)
        times = np.array([outcome.result.planning_time for outcome in row])
        certificate = [outcome.result.certificate_time for outcome in good]
        print(
            f"| {arm} | {len(row)} | {shares} | {np.median(times):.2f} | "
            f"{np.quantile(times, 0.9):.2f} | {times.max():.2f} | "
            f"{np.mean(certificate) if certificate else np.nan:.3f} |"
        )


def mix(found: list[Outcome]) -> None:
    """Print what the problems are like."""
    tubes = [outcome.case.problem.tube for outcome in found]
    counts = {
        "with obstacles": sum(bool(outcome.case.problem.obstacles) for outcome in found),
        "with a rotation tolerance": sum(tube.rotation is not None for tube in tubes),
        "with a goal": sum(outcome.case.problem.goal is not None for outcome in found),
        "with joint signs": sum(any(tube.joint_ranges) for tube in tubes),
    }
    segments = Counter(tube.segment_count for tube in tubes)
    radii = np.concatenate([tube.radius for tube in tubes])
    print(f"\n{len(found)} problems, {', '.join(f'{n} {what}' for what, n in counts.items())};")
    print(
        f"segments {', '.join(f'{k}: {segments[k]}' for k in sorted(segments))}; radii "
        f"{radii.min():.3f} to {radii.max():.3f} m, median {np.median(radii):.3f} m; sharpest turn "
        f"{max(_sharpest_turn(tube.points) for tube in tubes):.0f} degrees."
    )


def _sharpest_turn(points: np.ndarray) -> float:
    lines = np.diff(points, axis=0)
    lines /= np.linalg.norm(lines, axis=1)[:, None]
    cosines = np.sum(lines[:-1] * lines[1:], axis=1)
    return float(np.degrees(np.arccos(np.clip(cosines.min(initial=1.0), -1, 1))))


def failures(found: list[Outcome]) -> None:
    """Print one line per failure, and those that refinement left to other methods."""
    print("\nNot planned:\n")
    for outcome in found:
        result = outcome.result
        if not result.succeeded:
            print(
                f"- {outcome.case.problem.name}: {result.status}: {result.message} "
                f"({result.place or 'no place'})"
            )
    if all(outcome.result.succeeded for outcome in found):
        print("none")
    others = [
        f"{outcome.case.problem.name} ({outcome.result.method})"
        for outcome in found
        if outcome.result.succeeded and outcome.result.method != REFINEMENT
    ]
    print(f"\nPlanned, but not by refinement: {'; '.join(others) or 'none'}.")


def starts(found: list[Outcome], count: int) -> None:
    """Print how far the default plan is from the best of ten starts, for some of the problems."""
    planned = [outcome for outcome in found if outcome.result.method == REFINEMENT]
    planned = [outcome for outcome in planned if outcome.result.succeeded]
    chosen = [planned[k * len(planned) // count] for k in range(min(count, len(planned)))]
    if len(planned) < count:
        chosen = planned
    print("\n| problem | default [s] | best of ten starts [s] | certified | gap |")
    print("|---|---|---|---|---|")
    gaps = []
    for outcome in chosen:
        problem, duration = outcome.case.problem, outcome.result.duration or np.inf
        tried = [certified_duration(problem, *s) for s in islice(starts_of(problem), STARTS)]
        good = [one for one in tried if one is not None]
        best = min([duration, *good])
        gaps.append(100 * (duration / best - 1))
        print(
            f"| {problem.name} | {duration:.4f} | {best:.4f} | {len(good)} of {len(tried)} | "
            f"{gaps[-1]:.2f} % |",
            flush=True,
        )
    if gaps:
        print(f"\nGap to the best: median {np.median(gaps):.2f} %, worst {max(gaps):.2f} %.")


def _seeds(text: str) -> range:
    first, _, last = text.partition("..")
    return range(int(first), int(last or first) + 1)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robot", nargs="+", choices=ARMS, default=list(ARMS), metavar="NAME")
    parser.add_argument("--count", type=int, default=COUNT, help="problems per arm")
    parser.add_argument("--seeds", type=_seeds, metavar="A..B", help="instead of the first ones")
    parser.add_argument("--time-limit", type=float, help="of every plan [s]")
    parser.add_argument("--starts-subset", type=int, default=20, help="problems with ten starts")
    options = parser.parse_args()
    seeds = options.seeds or range(options.count)
    rejections: Counter[str] = Counter()
    begin = time.perf_counter()
    found = {
        arm: list(
            outcomes(arm, seeds, PlanOptions(time_limit=options.time_limit, slack=0.0), rejections)
        )
        for arm in options.robot
    }
    table(found)
    everything = [outcome for row in found.values() for outcome in row]
    mix(everything)
    print(f"\nCandidates refused, {rejections.total()} in all:\n")
    print("\n".join(f"- {rule}: {rejections[rule]}" for rule in RULES))
    failures(everything)
    if options.starts_subset:
        starts(everything, options.starts_subset)
    print(f"\n{time.perf_counter() - begin:.0f} s in all.", file=sys.stderr)


if __name__ == "__main__":
    main()
