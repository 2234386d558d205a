"""Would a general solver (IPOPT, direct transcription, many starts) find faster motions?

    pip install '.[bench]'
    OMP_NUM_THREADS=1 python benchmarks/direct_transcription.py [--problems NAME ...]
        [--intervals 80] [--starts 6] [--time-per-problem 300] [--grids clustered uniform]

An independent yardstick, of the same problem without obstacles: one phase per tube segment with
free durations, cubic splines (constant jerk in every interval), start and goal where the default
plan has them, at rest. Every start is solved on a coarse grid; the best of them are solved again on
two fine grids, uniform and clustered at both ends. Where a limit or the tube is broken between
samples, samples are added; what is left is taken out by scaling the time. All trajectories are
judged by the certificate.
"""

import argparse
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import make_interp_spline

from shared import ARMS, EXAMPLES, RADII, paper_example
from transcription_program import (
    PhasedTrajectory,
    Solution,
    Transcription,
    phase_grid,
    regular_samples,
)
from tubeplanner import (
    JointTrajectory,
    PlanningProblem,
    PlanOptions,
    PlanResult,
    load_problem,
    plan,
    verify,
)
from tubeplanner.first_guess.branches import redundancy_rules, reference_branch
from tubeplanner.limits.speed_limits import scaled_to_limits
from tubeplanner.optimizer.starts import starting_spline
from tubeplanner.outcome import Infeasible
from tubeplanner.trajectory.joint_trajectory import from_spline
from tubeplanner.trajectory.polynomials import BSpline

PROBLEMS = (*(paper_example(e, r) for e in EXAMPLES for r in RADII), *ARMS)
START_KNOTS = 24  # of the spline along the reference branch
GRIDS = ("clustered", "uniform")
COARSE_INTERVALS, COARSE_FRACTION = 1 / 3, 0.5  # of the fine grids, and of the time
FINALISTS = 3  # different local optima of the coarse grid that are solved on fine ones
SAME = 2e-3  # durations nearer to each other (relative) are of the same local optimum
MAX_ROUNDS = 5  # of adding samples
BETWEEN_SAMPLES = 3e-4  # what scaling may still cost, relative
GUESS_POINTS = 60  # of a start that is mixed or perturbed
WAVES, WAVE = 3, 0.15  # of a perturbed start: number per joint and amplitude [rad or m]
SOLVER = {
    "print_level": 0,
    "sb": "yes",
    "tol": 1e-7,
    "constr_viol_tol": 1e-9,
    "max_iter": 1000,
    # Larger, the barrier pulls a start to the middle of all limits, away from where it was.
    "mu_init": 1e-3,
    "alpha_for_y": "safer-min-dual-infeas",
}
AGAIN = {**SOLVER, "mu_init": 1e-5}  # from a solution on another grid or with fewer samples


@dataclass(frozen=True, eq=False)
class Attempt:
    """A trajectory within all limits.

    Attributes:
        trajectory: The trajectory, scaled to the limits.
        certified: Whether the certificate passes.
        origin: Which start and grid.
    """

    trajectory: JointTrajectory
    certified: bool
    origin: str


@dataclass(frozen=True, eq=False)
class Study:
    """What came of one problem.

    Attributes:
        best: The fastest certified trajectory, or any; None if there is none.
        converged: How many starts converged on the coarse grid.
        starts: How many there were.
        seconds: Wall time.
        optima: How many of different durations they found.
    """

    best: Attempt | None
    converged: int
    starts: int
    seconds: float
    optima: int


class MultiStart:
    """Direct transcription of one problem from many starts."""

    def __init__(
        self,
        problem: PlanningProblem,
        ends: np.ndarray,
        intervals: int,
        grids: Sequence[str],
        seconds: float,
    ) -> None:
        """Set the search up; its time begins to run.

        Args:
            problem: The planning problem.
            ends: First and last configuration, shape (2, n).
            intervals: Of the fine grids.
            grids: Kinds of fine grids, of `GRIDS`.
            seconds: After how long it ends.
        """
        self._problem, self._ends, self._intervals = problem, ends, intervals
        self._grids, self._end = grids, time.perf_counter() + seconds

    def run(self, starts: list[tuple[str, PhasedTrajectory]]) -> Study:
        """Return the best of all starts, given with their names."""
        begin = time.perf_counter()
        coarse_end = begin + COARSE_FRACTION * (self._end - begin)
        found: list[tuple[str, Solution]] = []
        used = 0
        for name, start in starts:
            if used and time.perf_counter() > coarse_end:
                break
            used += 1
            found.append((name, self._coarsely(start)))
        good = [(name, solution) for name, solution in found if solution.converged]
        good.sort(key=lambda item: item[1].phased.trajectory.duration)
        different = _different(good)
        attempts = [
            attempt
            for name, solution in different[:FINALISTS]
            for attempt in self._finely(name, solution.phased)
        ]
        best = min(attempts, key=_rank, default=None)
        return Study(best, len(good), used, time.perf_counter() - begin, len(different))

    def _finely(self, name: str, phased: PhasedTrajectory) -> Iterator[Attempt]:
        """Yield the trajectories that a coarse one becomes on fine grids."""
        for kind in self._grids:
            yield from self._exchanged(f"{name}, {kind}", phased, kind == "clustered")

    def _exchanged(self, name: str, phased: PhasedTrajectory, clustered: bool) -> Iterator[Attempt]:
        """Yield a trajectory on the finest grid, and again with more samples."""
        grid = phase_grid(
            phased.switching_times / phased.switching_times[-1],
            self._intervals,
            clustered=clustered,
        )
        samples, options = regular_samples(grid), SOLVER
        for _ in range(MAX_ROUNDS):
            if self._remaining <= 0:
                return
            program = Transcription(
                self._problem, self._ends, grid, phased.switching_times[-1], samples
            )
            solution = program.solved(phased, self._remaining, options)
            if not solution.converged:
                return
            phased, options = solution.phased, AGAIN
            attempt = self._judged(phased, name)
            yield attempt
            near = attempt.trajectory.duration <= (1 + BETWEEN_SAMPLES) * phased.switching_times[-1]
            missing = program.broken_between_samples(phased)
            if missing.count == 0 or (near and attempt.certified):
                return
            samples = samples.and_also(missing)

    def _coarsely(self, start: PhasedTrajectory) -> Solution:
        intervals = round(self._intervals * COARSE_INTERVALS)
        grid = phase_grid(
            start.switching_times / start.switching_times[-1], intervals, clustered=True
        )
        samples = regular_samples(grid)
        program = Transcription(self._problem, self._ends, grid, start.switching_times[-1], samples)
        return program.solved(start, self._remaining, SOLVER)

    def _judged(self, phased: PhasedTrajectory, name: str) -> Attempt:
        trajectory = scaled_to_limits(self._problem, phased.trajectory)
        return Attempt(trajectory, verify(self._problem, trajectory).passed, name)

    @property
    def _remaining(self) -> float:
        return self._end - time.perf_counter()


def _rank(attempt: Attempt) -> tuple[bool, float]:
    return not attempt.certified, attempt.trajectory.duration


def _different(found: list[tuple[str, Solution]]) -> list[tuple[str, Solution]]:
    """Return the solutions, sorted by duration, without those as long as the one before."""
    chosen: list[tuple[str, Solution]] = []
    longest = 0.0
    for name, solution in found:
        duration = solution.phased.trajectory.duration
        if duration > (1 + SAME) * longest:
            chosen.append((name, solution))
            longest = duration
    return chosen


def starts_of(
    problem: PlanningProblem, ends: np.ndarray, count: int
) -> list[tuple[str, PhasedTrajectory]]:
    """Return starts: along the branches, along the joint line, between both, and perturbed."""
    fixed = replace(problem, goal=ends[1])
    along = []
    for rule in redundancy_rules(fixed):
        try:
            branch = reference_branch(fixed, rule)
        except Infeasible:
            continue
        phased = starting_spline(fixed, branch, START_KNOTS)
        spline = from_spline(problem.robot.joint_names, phased.bspline())
        trajectory = scaled_to_limits(problem, spline)
        start = PhasedTrajectory(trajectory, phased.switching_times * trajectory.duration)
        along.append((f"branch {rule.name.lower()}", start))
    if problem.robot.joint_count <= 3:  # the tool's position leaves nothing free
        along = along[:1]
    first = along[0][1]
    chosen = [along[0], ("joint line", _mixed(first, 1.0)), ("half-way", _mixed(first, 0.5))]
    chosen += along[1:]
    for seed in range(max(0, count - len(chosen))):
        base = along[seed % len(along)][1]
        chosen.append((f"perturbed {seed}", _perturbed(base, seed)))
    return chosen[:count]


def _mixed(start: PhasedTrajectory, line_fraction: float) -> PhasedTrajectory:
    """Return a start drawn to the straight joint line between its ends."""
    x = np.linspace(0, 1, GUESS_POINTS)
    q = start.trajectory.position(x * start.switching_times[-1])
    line = q[0] + (x**3 * (10 - 15 * x + 6 * x**2))[:, None] * (q[-1] - q[0])
    return _through(start, (1 - line_fraction) * q + line_fraction * line)


def _perturbed(start: PhasedTrajectory, seed: int) -> PhasedTrajectory:
    """Return a start with waves on all joints, also on those that the tool does not need."""
    rng = np.random.default_rng(seed)
    x = np.linspace(0, 1, GUESS_POINTS)
    q = start.trajectory.position(x * start.switching_times[-1])
    waves = np.sin(np.pi * np.outer(x, 1 + np.arange(WAVES))) * np.sin(np.pi * x)[:, None] ** 2
    return _through(start, q + WAVE * waves @ rng.standard_normal((WAVES, q.shape[1])))


def _through(start: PhasedTrajectory, q: np.ndarray) -> PhasedTrajectory:
    times = np.linspace(0, start.switching_times[-1], len(q))
    fitted = make_interp_spline(times, q, k=3, bc_type="clamped")
    spline = BSpline(fitted.t, fitted.c, fitted.k)
    trajectory = from_spline(start.trajectory.joint_names, spline)
    return PhasedTrajectory(trajectory, start.switching_times)


def studied(name: str, options: argparse.Namespace) -> tuple[Study, PlanResult]:
    """Return what direct transcription and the default plan make of a problem."""
    loaded = load_problem(f"example:{name}")
    # Pairs that may touch name obstacles, too.
    problem = replace(loaded, obstacles=(), ignore_collisions=_without_obstacles(loaded))
    ours = plan(problem, PlanOptions(slack=0.0))
    if ours.trajectory is None:
        raise SystemExit(f"{name}: {ours.message}")
    ends = ours.trajectory.position([0.0, ours.trajectory.duration])
    search = MultiStart(problem, ends, options.intervals, options.grids, options.time_per_problem)
    return search.run(starts_of(problem, ends, options.starts)), ours


def _without_obstacles(problem: PlanningProblem) -> tuple[tuple[str, str], ...]:
    names = {obstacle.name for obstacle in problem.obstacles}
    return tuple(pair for pair in problem.ignore_collisions if not names & set(pair))


def row(name: str, study: Study, ours: PlanResult) -> tuple[str, float]:
    """Return a row of the table, and the ratio of both durations."""
    duration, best, ratio = ours.duration or math.nan, "none", math.nan
    if study.best is not None:
        theirs = study.best.trajectory.duration
        ratio = duration / theirs
        best = f"{theirs:.4f}{'' if study.best.certified else ' (not certified)'}"
    other = "" if ours.method == PlanOptions().method else f" ({ours.method})"
    origin = study.best.origin if study.best else ""
    planning = ours.planning_time - ours.certificate_time
    text = (
        f"| {name} | {best} | {duration:.4f}{other} | "
        f"{ratio:.4f} | {study.seconds:.0f} | {planning:.2f} | "
        f"{study.converged} of {study.starts} | {study.optima} | {origin} |"
    )
    return text, ratio


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--problems", nargs="+", default=PROBLEMS, metavar="NAME")
    parser.add_argument("--intervals", type=int, default=80)
    parser.add_argument("--starts", type=int, default=6)
    parser.add_argument("--time-per-problem", type=float, default=300.0, metavar="S")
    parser.add_argument("--grids", nargs="+", default=GRIDS, choices=GRIDS)
    options = parser.parse_args()
    print(
        "| problem | direct transcription [s] | default plan [s] | ratio | its time [s] | "
        "planning [s] | converged | local optima | best start |"
    )
    print("|---" * 9 + "|")
    ratios = []
    for name in options.problems:
        text, ratio = row(name, *studied(name, options))
        ratios.append(ratio)
        print(text, flush=True)
    print(f"\nRatio mean {np.nanmean(ratios):.4f}, worst {np.nanmax(ratios):.4f}.")
    print("All trajectories are certified unless said otherwise; obstacles are left out.")


if __name__ == "__main__":
    main()
