"""How smooth do motions become within a slack, what does that cost, and what do they keep?

    python benchmarks/smooth.py [--slack 0.005] [--repeats 1] [--only SUBSTRING]

Plans bundled problems as `plan` does by default, and prints of every one the shortest motion and
the smooth one that is written instead: durations, how far the effort that swings most moves (in
limits), largest effort rate (in limits per second), jerk, acceleration of a joint and of the tool,
the tool's least room in its tube, and how much less room than before it has in some segment, as a
share of the tolerance. CPU is the processor time of the second stage with its
certificate, as a fraction of the first stage's with its own, both of the same plan; of repeated
plans the least of each. Exit status 1 if one of six problems misses a goal of `_faults`.
"""

import argparse
import sys
import time
from dataclasses import asdict, dataclass

import numpy as np

from shared import ARMS, geometric_mean
from tubeplanner import PlanningProblem, PlanOptions, Progress, load_problem, plan, verify
from tubeplanner.arrays import FloatArray
from tubeplanner.limits.peaks import effort_variation, trajectory_peaks
from tubeplanner.limits.tube_membership import current_segments, tube_use
from tubeplanner.planning.result import PlanResult
from tubeplanner.planning.second_stage import largest_jerk
from tubeplanner.robot.model import effort_rate
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

# Goals are about these; the others are shown beside them.
JUDGED = (*ARMS[1:], "ur5/level_tray", "two_link/paper_5_10mm")
OTHERS = (
    ARMS[0],
    "two_link/paper_1_10mm",
    "two_link/paper_1_50mm",
    "two_link/paper_2_30mm",
    "two_link/paper_3_10mm",
    "two_link/paper_4_50mm",
    "two_link/paper_5_50mm",
)
MAX_VARIATION, MAX_MEAN_VARIATION, MAX_RATE, MAX_JERK_FRACTION = 0.8, 0.55, 0.2, 0.06
MAX_LESS_ROOM, MAX_CPU = 0.1, 1.2  # of the radius, and of the first stage
_SAMPLES_PER_PIECE = 20


@dataclass(frozen=True)
class Measures:
    """What a machine feels of a motion.

    Attributes:
        variation: How far the effort that swings most moves, in limits.
        rate: The largest effort rate [limits/s].
        jerk: The largest [rad/s^3, m/s^3].
        acceleration: The largest of a joint [rad/s^2, m/s^2].
        tool: The tool's largest acceleration [m/s^2].
    """

    variation: float
    rate: float
    jerk: float
    acceleration: float
    tool: float


@dataclass(frozen=True)
class Row:
    """A problem's shortest motion and its smooth one: durations [s], measures, room [m], CPU.

    `less` is the largest fraction of its tolerance that a segment has less of room than before.
    """

    name: str
    durations: tuple[float, float]
    measures: tuple[Measures, Measures]
    slack: tuple[float, float]
    radius: float
    less: float
    cpu: float

    @property
    def ratios(self) -> dict[str, float]:
        """The measures of the smooth motion as shares of the shortest one's."""
        before, after = map(asdict, self.measures)
        return {name: after[name] / before[name] for name in before}


def measures(problem: PlanningProblem, trajectory: JointTrajectory) -> Measures:
    """Return what a machine feels of a motion."""
    robot, at = problem.robot, trajectory.per_piece(_SAMPLES_PER_PIECE)
    jerk = trajectory.jerk_per_piece(_SAMPLES_PER_PIECE)
    rates = effort_rate(robot, at.position, at.velocity, at.acceleration, jerk)
    peaks = trajectory_peaks(robot, trajectory)
    return Measures(
        float(effort_variation(robot, trajectory).max()),
        float((abs(rates) / robot.limits.effort).max()),
        largest_jerk(robot, trajectory)[0],
        peaks.peak_acceleration.value,
        peaks.tool_acceleration.value,
    )


def segment_room(problem: PlanningProblem, trajectory: JointTrajectory) -> FloatArray:
    """Return the fraction of its tolerance that the tool leaves free in each segment, (m,)."""
    samples = trajectory.per_piece(_SAMPLES_PER_PIECE)
    segment = current_segments(problem, trajectory, samples)
    slack = np.ones(problem.tube.segment_count)
    use = tube_use(problem, problem.robot.tool_position(samples.position), segment)
    np.minimum.at(slack, segment, 1 - use)
    return slack


def timed_plan(problem: PlanningProblem, slack: float) -> tuple[PlanResult, float, float]:
    """Return a plan and the processor times of its two stages, certificates included [s]."""
    begun = time.process_time()
    smoothing: list[float] = []

    def note(progress: Progress) -> None:
        if progress.stage == "smoothing" and not smoothing:
            smoothing.append(time.process_time())

    result = plan(problem, PlanOptions(slack=slack), note)
    return result, smoothing[0] - begun, time.process_time() - smoothing[0]


def planned(name: str, slack: float, repeats: int) -> Row | str:
    """Return what both motions of a problem are, or why there is no smooth one."""
    problem = load_problem(f"example:{name}")
    assert problem.collision is not None  # made when first asked for
    runs = [timed_plan(problem, slack) for _ in range(repeats)]
    result = runs[0][0]
    shortest, smooth = result.shortest, result.trajectory
    if shortest is None or smooth is None or result.certificate is None:
        return "; ".join((result.message, *result.notes))
    certificates = (verify(problem, shortest), result.certificate)
    before, after = (one.conditions["tube"].margin or 0.0 for one in certificates)
    first, second = (min(run[stage] for run in runs) for stage in (1, 2))
    return Row(
        name,
        (shortest.duration, smooth.duration),
        (measures(problem, shortest), measures(problem, smooth)),
        (before, after),
        float(problem.tube.effective_radius.min()),
        float((segment_room(problem, shortest) - segment_room(problem, smooth)).max()),
        second / first,
    )


def _print_head() -> None:
    columns = ("T*", "T", "effort swings", "rate [1/s]", "jerk", "joint acc.", "tool acc.")
    widths = (7, 7, 18, 20, 24, 19, 19)
    cells = (f"{name:>{width}}" for name, width in zip(columns, widths, strict=True))
    print(f"{'problem':28}", *cells, f"{'room [mm]':>14}   less   CPU")


def _print_row(row: Row) -> None:
    before, after = map(asdict, row.measures)
    cells = []
    for name, shape in zip(before, ("5.1f", "6.0f", "8.1e", "6.0f", "6.1f"), strict=True):
        fraction = row.ratios[name]
        cells.append(f"{before[name]:{shape}} {after[name]:{shape}} {fraction:5.3f}")
    durations, slack = row.durations, [1000 * value for value in row.slack]
    print(
        f"{row.name:28} {durations[0]:7.4f} {durations[1]:7.4f} ",
        "  ".join(cells),
        f" {slack[0]:6.2f} {slack[1]:6.2f} {row.less:6.3f}  {row.cpu:5.2f}",
        flush=True,
    )


def _print_means(title: str, rows: list[Row]) -> None:
    if not rows:
        return
    means = {name: geometric_mean([row.ratios[name] for row in rows]) for name in rows[0].ratios}
    jerk = geometric_mean([row.measures[1].jerk for row in rows])
    shown = ", ".join(f"{name} {mean:.3f}" for name, mean in means.items())
    cpu = geometric_mean([row.cpu for row in rows])
    print(f"geometric means, {title}: {shown}; jerk {jerk:.2g}, CPU {cpu:.2f}")


def _faults(rows: list[Row]) -> list[str]:
    """Return the goals that are missed, in words."""
    faults = []
    for row in rows:
        less = (row.slack[0] - row.slack[1]) / row.radius
        for what, value, most in (
            ("share of variation", row.ratios["variation"], MAX_VARIATION),
            ("fraction of effort rate", row.ratios["rate"], MAX_RATE),
            ("share of jerk", row.ratios["jerk"], MAX_JERK_FRACTION),
            ("fraction of the radius less room", less, MAX_LESS_ROOM),
            ("fraction of a segment's tolerance less room", row.less, MAX_LESS_ROOM),
            ("share of CPU", row.cpu, MAX_CPU),
        ):
            if value > most:
                faults.append(f"{row.name}: {what} {value:.3g} is above {most:g}")
    mean = geometric_mean(row.ratios["variation"] for row in rows)
    if len(rows) == len(JUDGED) and mean > MAX_MEAN_VARIATION:
        faults.append(f"geometric mean: variation {mean:.3g} is above {MAX_MEAN_VARIATION:g}")
    return faults


def main() -> int:
    """Plan and print the table; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--slack", type=float, default=0.005, help="fraction of the duration")
    parser.add_argument("--repeats", type=int, default=1, help="plans of every problem")
    parser.add_argument("--only", default="", help="problems whose name contains this")
    asked = parser.parse_args()
    if not asked.slack > 0:
        parser.error(f"--slack {asked.slack:g}: must be positive")
    rows, faults = [], []
    _print_head()
    for name in (name for name in (*JUDGED, *OTHERS) if asked.only in name):
        row = planned(name, asked.slack, asked.repeats)
        if isinstance(row, str):
            print(f"{name:28} {row}", flush=True)
            faults += [f"{name}: {row}"]
            continue
        _print_row(row)
        rows.append(row)
    judged = [row for row in rows if row.name in JUDGED]
    _print_means("six problems", judged)
    _print_means("all", rows)
    faults += _faults(judged)
    print("\n".join(faults) or "all goals met")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
