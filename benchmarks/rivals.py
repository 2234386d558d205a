"""The default plan beside what else one could use, on the bundled problems.

    pip install '.[bench]'
    OMP_NUM_THREADS=1 python benchmarks/rivals.py [--problems NAME ...] [--markdown FILE]

- TOPP-RA on the tool's straight lines with stops, and on arcs that use the tube at the corners
  (`tubeplanner.baselines.baselines`): the fastest there is on these paths; the acceleration jumps.
- Drake's KinematicTrajectoryOptimization (`drake_rival.py`), started from both the TOPP-RA
trajectory
  and the reference branch.
- Direct transcription with IPOPT (`transcription_program.py`) from the reference branch alone, 40
  intervals, samples added where limits are broken, for a minute at most; it does not know of links
  and obstacles.

All get our goal where the problem leaves it open. All trajectories are scaled to the limits, judged
by the certificate and, apart from it, at dense samples by Pinocchio and coal (`dense_check.py`).
Ours is planned again before every rival; its time is the median.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dense_check import broken
from direct_transcription import MultiStart, starts_of
from drake_rival import drake_trajectory, switching_times_of
from transcription_program import PhasedTrajectory
from tubeplanner import (
    JointTrajectory,
    PlanningProblem,
    PlanOptions,
    load_problem,
    plan,
    verify,
)
from tubeplanner.baselines.baselines import judged_baseline
from tubeplanner.outcome import Infeasible

PROBLEMS = (
    "two_link/paper_1_30mm",
    "two_link/paper_5_30mm",
    "two_link/around_a_post",
    "ur5/over_the_wall",
    "ur10/onto_a_conveyor",
    "panda/between_shelves",
    "xarm7/from_crate_to_crate",
)
INTERVALS, IPOPT_SECONDS = 40, 60.0
MARKS = {
    frozenset({"rest", "continuity", "jerk"}): "a",
    frozenset({"tube", "joint_signs", "rotation"}): "t",
    frozenset({"obstacles", "self_collision"}): "c",
    frozenset({"position", "velocity", "acceleration", "effort", "start", "goal"}): "l",
}
LEGEND = (
    "Ratios of durations to ours, and planning times. What the certificate objects to: a the "
    "acceleration jumps, t the tool leaves the tube, c a collision or too little clearance, "
    "l a limit."
)


@dataclass(frozen=True, eq=False)
class Answer:
    """What a rival makes of a problem.

    Attributes:
        trajectory: None if there is none.
        seconds: Wall time.
    """

    trajectory: JointTrajectory | None
    seconds: float


def with_stops(problem: PlanningProblem, ends: np.ndarray) -> JointTrajectory:
    """Return TOPP-RA's trajectory along the tool's lines, with stops."""
    return judged_baseline(problem, "bang-bang")[0].trajectory


def with_arcs(problem: PlanningProblem, ends: np.ndarray) -> JointTrajectory:
    """Return TOPP-RA's trajectory along lines and arcs."""
    return judged_baseline(problem, "arc-corners")[0].trajectory


def drake(problem: PlanningProblem, ends: np.ndarray) -> JointTrajectory | None:
    """Return Drake's best trajectory."""
    arcs = with_arcs(problem, ends)
    branch = starts_of(problem, ends, 1)[0][1]
    return drake_trajectory(
        problem, [PhasedTrajectory(arcs, switching_times_of(problem, arcs)), branch]
    )


def ipopt(problem: PlanningProblem, ends: np.ndarray) -> JointTrajectory | None:
    """Return IPOPT's trajectory from one start."""
    start = starts_of(problem, ends, 1)[0][1]
    search = MultiStart(problem, ends, INTERVALS, ("clustered",), IPOPT_SECONDS)
    found = search.run_finely("branch", start)
    return found.best.trajectory if found.best else None


RIVALS: dict[str, Callable[[PlanningProblem, np.ndarray], JointTrajectory | None]] = {
    "TOPP-RA, stops": with_stops,
    "TOPP-RA, arcs": with_arcs,
    "Drake": drake,
    "IPOPT, one start": ipopt,
}


def answered(
    rival: Callable[[PlanningProblem, np.ndarray], JointTrajectory | None],
    problem: PlanningProblem,
    ends: np.ndarray,
) -> Answer:
    """Return a rival's answer; what goes wrong inside it is no answer."""
    begin = time.perf_counter()
    try:
        trajectory = rival(problem, ends)
    except (Infeasible, RuntimeError, ValueError) as error:
        print(f"  {rival.__name__}: {error}", flush=True)
        trajectory = None
    return Answer(trajectory, time.perf_counter() - begin)


def cell(problem: PlanningProblem, answer: Answer, ours: float) -> str:
    """Return what the table says of an answer, and print what both judges say."""
    if answer.trajectory is None:
        return f"none ({answer.seconds:.1f} s)"
    ratio = answer.trajectory.duration / ours
    failures = verify(problem, answer.trajectory).failures()
    print(
        f"  {ratio:.3f} in {answer.seconds:.2f} s; certificate: {', '.join(failures) or 'passed'}; "
        f"at samples: {broken(problem, answer.trajectory) or 'all kept'}",
        flush=True,
    )
    marks = "".join(mark for names, mark in MARKS.items() if names & set(failures))
    return f"{ratio:.2f}{' ' + marks if marks else ''} ({answer.seconds:.1f} s)"


def row(name: str) -> str:
    """Return one row of the table."""
    problem = load_problem(f"example:{name}")
    result = plan(problem, PlanOptions().shortest)
    if result.trajectory is None or result.certificate is None or not result.certificate.passed:
        raise SystemExit(f"{name}: {result.message}")
    ends = result.trajectory.position([0.0, result.trajectory.duration])
    fixed = replace(problem, goal=ends[1])
    print(
        f"{name}: ours {result.trajectory.duration:.4f} s; at samples: "
        f"{broken(problem, result.trajectory) or 'all kept'}",
        flush=True,
    )
    seconds, cells = [], []
    for title, rival in RIVALS.items():
        again = plan(load_problem(f"example:{name}"), PlanOptions().shortest)
        seconds.append(again.planning_time - again.certificate_time)
        print(f"  {title}:", flush=True)
        cells.append(cell(fixed, answered(rival, fixed, ends), result.trajectory.duration))
    ours = f"{result.trajectory.duration:.3f} s ({np.median(seconds):.1f} s)"
    return f"| {name} | {ours} | {' | '.join(cells)} |"


def main() -> None:
    """Print the table, and write it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--problems", nargs="+", default=PROBLEMS, metavar="NAME")
    parser.add_argument("--markdown", type=Path, metavar="FILE")
    options = parser.parse_args()
    lines = [
        f"| problem | ours | {' | '.join(RIVALS)} |",
        "|---" * (2 + len(RIVALS)) + "|",
        *(row(name) for name in options.problems),
    ]
    table = "\n".join([*lines, "", LEGEND, ""])
    print(f"\n{table}")
    if options.markdown:
        options.markdown.write_text(table)


if __name__ == "__main__":
    main()
