"""Do plans survive wrong masses, friction and delay, and what does surviving cost?

    python benchmarks/executed.py [--only SUBSTRING] [--runs 200] [--output LINES.jsonl]

Plans every bundled problem with a tube as its file says, and with field robustness, whose errors
are its defaults. The default plan, the shortest motion, the robust plan and the default plan run
slower as a whole, until its runs survive, are executed by the same arms with these errors, none of
which planning knew. Prints of each the duration, how many runs failed, and the worst of them: how
far beyond the tube [mm], beyond the rotation tolerance [mrad], and nearer to obstacles than the
clearance [mm] (below zero: to spare; "-": nothing is asked); of the robust plan also what it costs
beside the default one, planning time and processor time [s]; of the slower default plan the factor
on its times and how much longer than the robust plan it takes. "!" marks a motion that is not
certified for the problem. Exit status 1 if one is not, or if a robust plan misses a goal of
`_faults`.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import yaml

from tubeplanner import PlanningProblem, Robustness, load_problem, plan, verify
from tubeplanner.execution.error_contributions import simulated_runs
from tubeplanner.execution.plants import Draw
from tubeplanner.execution.run_verdict import JudgedRun, run_verdict
from tubeplanner.planning.result import PlanResult
from tubeplanner.resources import bundled_problems
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

# First those that tell the most.
FIRST = (
    "two_link/paper_1_10mm",
    "two_link/paper_2_50mm",
    "two_link/paper_5_10mm",
    "two_link/around_a_post",
)
ROBOTS = ("ur5", "ur10", "panda", "xarm7", "two_link")
_SEED = 2  # planning draws its arms from 0 and 1
_SEARCH = (4, 50)
MAX_FAILED = 0.005  # share of the runs
MAX_COST, MAX_NEEDLESS_COST = 0.08, 0.005  # of the default plan's duration
MOST = 3.0
# Surviving need not go on as a motion gets slower: the first of these that survives counts.
_FACTORS = (1.02, 1.05, 1.1, 1.2, 1.35, 1.6, 2.0, 2.5, MOST)
_NEAR = 1.005  # as close to the least factor as bisection goes


@dataclass(frozen=True)
class Executed:
    """A motion, and what its runs show.

    Attributes:
        duration: [s].
        certified: Whether it is, for the problem itself.
        runs: How many.
        failed: How many of them.
        broken: How many did not keep what.
        tube: The worst excursion of the tool beyond the tube [m]; below zero: inside by as much.
        rotation: Likewise beyond the rotation tolerance [rad]; None where there is none.
        obstacles: By how much links come nearer to obstacles than the clearance [m]; likewise.
    """

    duration: float
    certified: bool
    runs: int
    failed: int
    broken: dict[str, int]
    tube: float
    rotation: float | None
    obstacles: float | None

    def __str__(self) -> str:
        worst = ((self.tube, 9, 2), (self.rotation, 7, 1), (self.obstacles, 8, 1))
        shown = "".join(_thousandths(value, width, figures) for value, width, figures in worst)
        mark = " " if self.certified else "!"
        return f"{self.duration:8.4f}{mark}{self.failed:4d}{shown}"


@dataclass(frozen=True)
class Row:
    """A problem's motions, executed.

    Attributes:
        name: Of the problem.
        default: The plan as the file says.
        shortest: With slack 0.
        robust: The plan that is to survive.
        planning_time: Of the robust plan, wall time [s].
        cpu: Likewise, processor time [s].
        blame: Which error does the most, in words; None where the robust plan costs little.
        factor: By which the default plan is slowed until it survives; None if that does not help.
        slowed: That motion.
    """

    name: str
    default: Executed
    shortest: Executed
    robust: Executed
    planning_time: float
    cpu: float
    blame: str | None
    factor: float | None
    slowed: Executed | None

    @property
    def cost(self) -> float:
        """By which share of the default plan's duration the robust one is longer."""
        return self.robust.duration / self.default.duration - 1

    @property
    def gain(self) -> float | None:
        """By which share of the robust plan's duration the slowed default plan is longer."""
        return None if self.slowed is None else self.slowed.duration / self.robust.duration - 1

    def as_dict(self) -> dict[str, Any]:
        """Return the fields, cost and gain as JSON values."""
        return asdict(self) | {"cost": self.cost, "gain": self.gain}


def judged(
    problem: PlanningProblem, trajectory: JointTrajectory, runs: Sequence[JudgedRun]
) -> Executed:
    """Return what the runs of a trajectory show, and whether it is certified."""
    verdict = run_verdict(runs)
    rotation = [run.rotation.value for run in runs if run.rotation is not None]
    near = [run.clearance - run.obstacles.value for run in runs if run.obstacles is not None]
    return Executed(
        trajectory.duration,
        verify(problem, trajectory).passed,
        verdict.runs,
        verdict.failed,
        {name: count for name, count in verdict.broken.items() if count},
        max(run.tube.value for run in runs),
        max(rotation, default=None),
        max(near, default=None),
    )


def executed_plans(name: str, runs: int) -> Row | str:
    """Return what becomes of a problem's motions, or why one of them is missing."""
    problem = load_problem(f"example:{name}")
    surviving = load_problem(f"example:{name}", changes={"robustness": {}})
    default = plan(problem)
    begun = time.process_time()
    robust = plan(surviving)
    cpu = time.process_time() - begun
    if default.trajectory is None or robust.trajectory is None:
        return f"default: {default.message}; robust: {robust.message}"

    def simulated(trajectory: JointTrajectory, count: int) -> list[JudgedRun]:
        return simulated_runs(problem.joined, trajectory, Robustness(), Draw(count, seed=_SEED))

    def executed(trajectory: JointTrajectory) -> Executed:
        return judged(problem, trajectory, simulated(trajectory, runs))

    def failed(factor: float, count: int) -> int:
        return run_verdict(simulated(motion.scaled(factor), count)).failed

    motion = default.trajectory
    factor = least_factor(failed, Arms(tuple(n for n in _SEARCH if n < runs), (runs,)))
    return Row(
        name,
        executed(motion),
        executed(default.shortest or motion),
        executed(robust.trajectory),
        robust.planning_time,
        cpu,
        _blame(robust),
        factor,
        None if factor is None else executed(motion.scaled(factor)),
    )


def main() -> int:
    """Plan, execute and print the table; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="problems whose name contains this")
    parser.add_argument("--runs", type=int, default=200, help="arms that execute every motion")
    parser.add_argument("--output", type=Path, help="one JSON line per problem, added to the file")
    asked = parser.parse_args()
    rows: list[Row] = []
    faults: list[str] = []
    _print_head()
    for name in _names(asked.only):
        row = executed_plans(name, asked.runs)
        if isinstance(row, str):
            print(f"{name:33}|{row}", flush=True)
            faults.append(f"{name}: {row}")
            continue
        _print_row(row)
        rows.append(row)
        faults += _faults(row)
        if asked.output:
            with asked.output.open("a") as lines:
                lines.write(json.dumps(row.as_dict()) + "\n")
    _print_summary(rows, faults)
    return 1 if faults else 0


@dataclass(frozen=True)
class Arms:
    """How many arms judge a factor, one stage after the other until one of them fails.

    Attributes:
        search: While the least factor is sought.
        found: The one that was found.
    """

    search: Sequence[int] = (4, 50)
    found: Sequence[int] = (200,)


def least_factor(failed: Callable[[float, int], int], arms: Arms) -> float | None:
    """Return the least factor on a motion's times with which none of its runs fails.

    Args:
        failed: How many runs fail, of the motion with a factor on its times, by so many arms.
        arms: How many arms judge it.

    Returns:
        From 1 to 3, to half a percent; None if none of nine factors survives.
    """

    def survives(factor: float, counts: Sequence[int]) -> bool:
        return all(failed(factor, count) == 0 for count in counts)

    below = 1.0
    if survives(below, (*arms.search, *arms.found)):
        return below
    for factor in _FACTORS:
        if survives(factor, arms.search):
            least = _bisected(lambda between: survives(between, arms.search), below, factor)
            return _raised(lambda raised: survives(raised, arms.found), least)
        below = factor
    return None


def _blame(robust: PlanResult) -> str | None:
    survival = robust.survival
    return None if survival is None or survival.blame is None else str(survival.blame)


def _print_head() -> None:
    one = f"{'T [s]':>8} fail{'tube':>9}{'turn':>7}{'near':>8}"
    more, slower = f" {'cost %':>7} {'wall s':>6} {'CPU s':>6}", "default plan run slower"
    robust = f"{'robust plan':{len(one + more)}}"
    print(f"{'':33}|{'default plan':{len(one)}}|{'slack 0':{len(one)}}|{robust}|{slower}")
    print(f"{'problem':33}|{one}|{one}|{one}{more}|factor {one} longer %", flush=True)


def _print_row(row: Row) -> None:
    slowed = f"{'none':>6}"
    if row.factor is not None and row.slowed is not None and row.gain is not None:
        slowed = f"{row.factor:6.3f} {row.slowed} {100 * row.gain:8.2f}"
    robust = f"{row.robust} {100 * row.cost:7.2f} {row.planning_time:6.1f} {row.cpu:6.1f}"
    print(f"{row.name:33}|{row.default}|{row.shortest}|{robust}|{slowed}", flush=True)


def _thousandths(value: float | None, width: int, figures: int) -> str:
    return f"{'-':>{width}}" if value is None else f"{1000 * value:{width}.{figures}f}"


def _faults(row: Row) -> list[str]:
    """Return the goals that a row misses, in words."""
    motions = {
        "default plan": row.default,
        "shortest motion": row.shortest,
        "robust plan": row.robust,
        "slowed default plan": row.slowed,
    }
    faults = [
        f"the {name} is not certified"
        for name, motion in motions.items()
        if motion is not None and not motion.certified
    ]
    failed, runs, cost = row.robust.failed, row.robust.runs, 100 * row.cost
    if failed > MAX_FAILED * runs:
        broken = ", ".join(f"{name} {count}" for name, count in row.robust.broken.items())
        faults.append(f"{failed} of {runs} runs of the robust plan failed ({broken})")
    if row.cost > MAX_COST:
        faults.append(f"surviving costs {cost:.2f} %")
    if row.default.failed == 0 and row.cost > MAX_NEEDLESS_COST:
        faults.append(f"the default plan survives; the robust one is {cost:.2f} % slower")
    elif row.gain is not None and row.factor != 1.0 and row.gain <= 0:
        faults.append(f"the default plan run slower takes {-100 * row.gain:.2f} % less")
    return [f"{row.name}: {fault}" for fault in faults]


def _print_summary(rows: Sequence[Row], faults: Sequence[str]) -> None:
    if rows:
        kept = sum(row.robust.failed == 0 for row in rows)
        dearest = max(rows, key=lambda row: row.cost)
        print(
            f"{kept} of {len(rows)} robust plans have no failed run of {rows[0].robust.runs}; "
            f"surviving costs at most {100 * dearest.cost:.2f} % ({dearest.name})"
        )
    for row in rows:
        if row.cost > MAX_COST:
            print(f"{row.name}, {100 * row.cost:.2f} %: {row.blame}")
    print("\n".join(faults) or "all goals met")


def _names(only: str) -> list[str]:
    """Return the bundled problems with a tube that are asked for, in the order they are run."""
    names = [name for name, path in bundled_problems().items() if only in name and _has_tube(path)]
    later = [name for robot in ROBOTS for name in names if name.startswith(f"{robot}/")]
    return list(dict.fromkeys([*(name for name in FIRST if name in names), *later, *names]))


def _has_tube(path: Path) -> bool:
    return "tube" in yaml.safe_load(path.read_text())


def _bisected(survives: Callable[[float], bool], below: float, above: float) -> float:
    """Return the least factor between one that does not survive and one that does."""
    while above > _NEAR * below:
        between = (below * above) ** 0.5
        if survives(between):
            above = between
        else:
            below = between
    return above


def _raised(survives: Callable[[float], bool], factor: float) -> float | None:
    """Return the least factor, at least a given one, with which more arms survive too."""
    if survives(factor):
        return factor
    step = _NEAR
    while factor * step <= MOST:
        if survives(factor * step):
            return _bisected(survives, factor, factor * step)
        factor, step = factor * step, step**2
    return None


if __name__ == "__main__":
    sys.exit(main())
