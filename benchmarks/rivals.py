"""How long do motions of the same problems take by other means? The table of the README.

    pip install '.[bench]'
    OMP_NUM_THREADS=1 python benchmarks/rivals.py [--problems NAME ...]

Ours at slack 0, TOPP-RA along the tool's lines with corners cut by arcs inside the tube, and one
start of a direct transcription with IPOPT, which ignores obstacles and begins where our reference
branch does. Prints one row per problem: durations, those of rivals as multiples of ours, with the
processor time of each; `*` where the certificate fails, and below the table why.
"""

import argparse
import time
from collections.abc import Callable
from typing import TypeVar

from direct_transcription import MultiStart, starts_of
from shared import ARMS
from tubeplanner import PlanOptions, load_problem, plan, verify
from tubeplanner.first_guess.baselines import judged_baseline

INTERVALS, SECONDS = 40, 300.0  # of IPOPT; wall time per problem
Result = TypeVar("Result")


def timed(work: Callable[[], Result]) -> tuple[Result, float]:
    """Return the result of a call, and its processor time [s]."""
    begun = time.process_time()
    result = work()
    return result, time.process_time() - begun


def row(name: str, remarks: list[str]) -> str:
    """Return a problem's row; add a remark for each rival whose certificate fails."""
    problem = load_problem(f"example:{name}")
    ours, planning = timed(lambda: plan(problem, PlanOptions(slack=0.0)))
    if ours.trajectory is None:
        raise SystemExit(f"{name}: {ours.message}")
    duration = ours.trajectory.duration
    cells = [f"{duration:.3f} s ({planning:.1f} s)"]
    (baseline, certificate), seconds = timed(lambda: judged_baseline(problem, "arc-corners"))
    rivals = [("TOPP-RA", baseline.trajectory, certificate, seconds)]
    ends = ours.trajectory.position([0.0, duration])
    search = MultiStart(problem, ends, INTERVALS, ("clustered",), SECONDS)
    study, seconds = timed(lambda: search.run(starts_of(problem, ends, 1)))
    if study.best is not None:
        best = study.best.trajectory
        rivals.append(("IPOPT", best, verify(problem, best), seconds))
    for rival, trajectory, verdict, spent in rivals:
        mark = "" if verdict.passed else "*"
        cells.append(f"{trajectory.duration / duration:.3f}{mark} ({spent:.1f} s)")
        if mark:
            remarks.append(f"{name}, {rival}: {verdict.describe(verdict.failures()[0])}")
    return f"| {name} | " + " | ".join(cells) + " |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--problems", nargs="+", default=ARMS, metavar="NAME")
    options = parser.parse_args()
    print("| problem | ours | TOPP-RA, arcs | IPOPT, blind to obstacles |\n|---|---|---|---|")
    remarks: list[str] = []
    for name in options.problems:
        print(row(name, remarks), flush=True)
    print("", *remarks, sep="\n")


if __name__ == "__main__":
    main()
