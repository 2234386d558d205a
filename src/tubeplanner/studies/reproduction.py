"""The tables of Suh & Bishop (1988), printed and from our code; the page of both.

J. Robotic Systems 5(6), 497-525; Tables II to IV. Durations are in seconds, tolerances in metres;
`NO_TUBE` means an unbounded tool.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from tubeplanner.first_guess.baselines import BASELINES, judged_baseline
from tubeplanner.first_guess.branches import KnownBranches, redundancy_rules
from tubeplanner.first_guess.line_schemes import PAPER, conventional_trajectory
from tubeplanner.first_guess.tool_paths import tool_paths
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.outcome import Infeasible, PlanningClock
from tubeplanner.planning.options import REFINEMENT, SUH_BISHOP, PlanOptions
from tubeplanner.planning.result import PlanResult
from tubeplanner.studies.rows import finished_plan
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.problem_reader import load_problem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

# ---- The printed results of Suh & Bishop (1988), and the errors in them.

NO_TUBE = math.inf


@dataclass(frozen=True)
class PrintedExample:
    """One of the five paths of Table II."""

    conventional: float  # duration of straight lines with stops [s]
    # durations after phase 1 and after phase 2 [s], by tolerance [m]
    phases: MappingProxyType[float, tuple[float, float]]
    remark: str = ""  # remark on the printed numbers; empty: none


@dataclass(frozen=True)
class PrintedLine:
    """A path of Table III or IV, each about one line."""

    example: int  # the example of Table II with the same line
    bang_bang: float  # least time on the line, if motors switch instantly [s]
    smoothed: float  # `bang_bang` with the paper's cost of smoothness, 26 % [s]
    durations: MappingProxyType[float, float]  # durations [s], by tolerance [m]
    shown: tuple[float, ...]  # tolerances of its figures [m]
    remark: str  # remark on the printed numbers


def _phases(*durations: tuple[float, float]) -> MappingProxyType[float, tuple[float, float]]:
    return MappingProxyType(dict(zip((0.01, 0.03, 0.05), durations, strict=True)))


_OTHER_SUM = "1.93 s is printed where the formula gives 1.82 s for the printed points"

TABLE_TWO = MappingProxyType(
    {
        1: PrintedExample(1.96, _phases((1.08, 0.90), (1.04, 0.75), (1.04, 0.73))),
        2: PrintedExample(
            1.00,
            _phases((0.44, 0.40), (0.44, 0.39), (0.44, 0.39)),
            "the goal is printed as (0.6, 0.3), out of reach at 0.67 m; the conventional time "
            "is for 0.3 m, so the goal is taken as (0.6, 0)",
        ),
        3: PrintedExample(1.93, _phases((1.04, 0.92), (0.95, 0.83), (0.95, 0.80)), _OTHER_SUM),
        4: PrintedExample(1.93, _phases((0.91, 0.80), (0.91, 0.77), (0.88, 0.72)), _OTHER_SUM),
        5: PrintedExample(3.74, _phases((1.91, 1.52), (1.44, 1.26), (1.44, 1.03))),
    }
)

TABLE_THREE = PrintedLine(
    example=1,
    bang_bang=0.72,
    smoothed=0.91,
    durations=MappingProxyType(
        {0.005: 1.18, 0.010: 1.00, 0.020: 0.86, 0.030: 0.84, 0.040: 0.83, 0.050: 0.83}
    ),
    shown=(0.005, 0.010, 0.050),
    remark=(
        "The end points are lost with figure 8(a). Two lines fit the bang-bang time of 0.72 s: "
        "that of example 1, and the chord from (0, 0.6) to (0.6, 0) m. Example 1's line is "
        "taken. For that line, Table II prints 0.90, 0.75 and 0.73 s where this table has 1.00, "
        "0.84 and 0.83 s."
    ),
)

TABLE_FOUR = PrintedLine(
    example=3,
    bang_bang=0.70,
    smoothed=0.88,
    durations=MappingProxyType(
        {
            **{0.005: 0.98, 0.010: 0.95, 0.020: 0.89, 0.030: 0.85, 0.040: 0.82, 0.050: 0.77},
            **{0.060: 0.68, 0.070: 0.62, NO_TUBE: 0.42},
        }
    ),
    shown=(0.005, 0.030, 0.070),
    remark=(
        "The end points are lost with figure 9(a). Example 3's line fits the bang-bang time of "
        "0.70 s. But the arm of Table I needs 0.617 s even without a tube and with its elbow on "
        "the better side. So the printed 0.62 s at 70 mm and 0.42 s without a tube belong to "
        "another line or arm."
    ),
)

# The tolerances of figure 7, which is captioned example 2 and shows example 1.
FIGURE_SEVEN = MappingProxyType({0.01: 0.90, 0.02: 0.85, 0.03: 0.75})


# ---- The same tables from our code: the published method, and the default one.

_METHODS = (SUH_BISHOP, REFINEMENT)
CONVENTIONAL = "by the paper's constants"
PATH_RADIUS = 0.03  # [m]: for the schemes that cut corners
_EVERYWHERE = 10.0  # [m]: a tube that the arm cannot leave


@dataclass(frozen=True, eq=False)
class ReproducedCell:
    """A path at one tolerance, planned by the published method and by the default one."""

    example: int  # number of the example of Table II
    radius: float  # tolerance [m]; infinite: no tube, and free joint signs
    problem: PlanningProblem  # the planned problem
    published: PlanResult  # result of the method as published
    default: PlanResult  # result of refinement

    def result(self, method: str) -> PlanResult:
        """Return the result of a method."""
        return self.published if method == SUH_BISHOP else self.default

    def as_dict(self) -> dict[str, Any]:
        """Return the durations as JSON values [s]; the radius is null where there is no tube."""
        return {
            "example": self.example,
            "radius": None if self.radius == NO_TUBE else self.radius,
            "phase_one": self.published.phase1_duration,
            "suh_bishop": self.published.duration,
            "default": self.default.duration,
            "planning_time": {
                SUH_BISHOP: self.published.planning_time,
                REFINEMENT: self.default.planning_time,
            },
        }


@dataclass(frozen=True, eq=False)
class Reproduction:
    """Tables II to IV from our code."""

    cells: dict[tuple[int, float], ReproducedCell]  # the cells by example and tolerance [m]
    # trajectories on an example's path, or the reason for their absence, by example and scheme;
    # `CONVENTIONAL` has straight lines with stops, at the speed and acceleration of Table I
    paths: dict[int, dict[str, JointTrajectory | str]]

    def durations(self, example: int) -> dict[str, float | None]:
        """Return the durations on an example's path by scheme [s]; None without a trajectory."""
        return {
            scheme: None if isinstance(each, str) else each.duration
            for scheme, each in self.paths[example].items()
        }

    def as_dict(self) -> dict[str, Any]:
        """Return all durations as JSON values [s]."""
        return {
            "cells": [cell.as_dict() for cell in self.cells.values()],
            "paths": {str(example): self.durations(example) for example in self.paths},
        }


def reproduce(progress: Callable[[object], None] | None = None) -> Reproduction:
    """Plan all tabulated cells of Suh & Bishop (1988) by their method and by the default.

    Raises:
        KeyboardInterrupt: Ctrl-C.
    """
    report = progress or (lambda what: None)
    tabulated = [(number, radius) for number, row in TABLE_TWO.items() for radius in row.phases]
    for table in (TABLE_THREE, TABLE_FOUR):
        tabulated += [(table.example, radius) for radius in table.durations]
    tabulated += [(1, radius) for radius in FIGURE_SEVEN]
    tabulated = sorted(set(tabulated))
    cells = {}
    for number, (example, radius) in enumerate(tabulated, start=1):
        tolerance = "no tube" if radius == NO_TUBE else f"{1000 * radius:.0f} mm"
        stage = f"example {example}, {tolerance} ({number} of {len(tabulated)})"
        cells[example, radius] = _cell(example, radius, stage, report)
    paths = {}
    for example in TABLE_TWO:
        report(f"example {example}, schemes without a tube")
        problem = paper_problem(example, PATH_RADIUS)
        branches = KnownBranches(problem, PlanningClock(None, None))
        lines = tool_paths(problem, branches.by_rule(redundancy_rules(problem)[0]), arcs=False)
        conventional = conventional_trajectory(problem.robot, lines, PAPER)
        trajectories: dict[str, JointTrajectory | str] = {CONVENTIONAL: conventional}
        for name in BASELINES:
            try:
                trajectories[name] = judged_baseline(problem, name)[0].trajectory
            except Infeasible as reason:
                trajectories[name] = str(reason)
        paths[example] = trajectories
    return Reproduction(cells, paths)


def paper_problem(example: int, radius: float) -> PlanningProblem:
    """Return an example of Table II with a tolerance [m]; infinite: with free joint signs."""
    problem = load_problem(f"example:two_link/paper_{example}_30mm")
    if radius == NO_TUBE:
        return problem.with_tube(Tube(problem.tube.points, _EVERYWHERE))
    return problem.with_tube(problem.tube.with_radius(radius))


def _cell(
    example: int, radius: float, stage: str, report: Callable[[object], None]
) -> ReproducedCell:
    problem = paper_problem(example, radius)
    results: list[Any] = []
    for method in _METHODS:
        options = PlanOptions(method, slack=0.0)
        results.append(finished_plan(problem, options, lambda what: report(f"{stage}: {what}")))
    return ReproducedCell(example, radius, problem, *results)


_INTRODUCTION = """\
# Suh & Bishop (1988), from our code

This page puts the tables and figures of the paper beside ours: "Collision-avoidance trajectory
planning using tube concept: analysis and simulation", J. Robotic Systems 5(6), 497-525.
`tubeplanner reproduce` makes it. Durations are in seconds.

The arm is the two-link arm of the paper's Table I: horizontal plane, motors of 95 and 27 N m, elbow
kept on one side. The paper does not say where the masses are. With each mass at the end of its
link, our bang-bang times match the printed ones.

The paper plans in two phases. Phase 1 takes points of the reference path as knots of a joint
polynomial and finds the fastest choice by branch and bound. Phase 2 moves the knots within the tube
and doubles their number.

- **Published** is `--method suh-bishop`, the algorithm as printed. The paper does not give the
  increments, the line search and the rule for the end; these are ours.
- **Default** is `refinement`.
- **Ratio** is our value divided by the printed one.

All trajectories of both methods are certified.
"""

_NOT_MONOTONE = """\
- A wider tube may give a slower published trajectory. Its search then ended in another local
  optimum: the trajectory of the narrower tube lies in the wider tube too.
"""

_SCHEMES = f"""\
The paper compares with these schemes:

- **Conventional**: straight lines with stops at trapezoidal speed, by the constants of Table I or
  as fast as the limits allow.
- **Bang-bang**: the least time on the lines if motors switch instantly. The smoothed form has a
  continuous acceleration.
- **Arc corners** and Taylor's **bounded deviation** cut corners, within
  {1000 * PATH_RADIUS:.0f} mm.

The acceleration of all but the smoothed schemes jumps.
"""

# The quantities with a ratio, and their columns in Table II.
_PHASE_ONE, _PUBLISHED, _DEFAULT = "phase 1", "phase 2, published", "default"


def reproduction_page(reproduction: Reproduction, figures: Mapping[str, str]) -> str:
    """Return the page of Markdown.

    Args:
        reproduction: The results.
        figures: The file of each figure, by its caption.
    """
    schemes = list(next(iter(reproduction.paths.values())))
    without_tube = [
        [
            *(str(number), f"{TABLE_TWO[number].conventional:.2f}"),
            *map(_seconds, reproduction.durations(number).values()),
        ]
        for number in reproduction.paths
    ]
    examples: dict[str, list[int]] = {}  # by remark: some have the same
    for number, row in TABLE_TWO.items():
        if row.remark:
            examples.setdefault(row.remark, []).append(number)
    remarks = [
        f"Example{'s' * (len(numbers) > 1)} {' and '.join(map(str, numbers))}: {remark}."
        for remark, numbers in examples.items()
    ]
    radii = ", ".join(f"{1000 * radius:.0f}" for radius in FIGURE_SEVEN)
    durations = ", ".join(
        f"{_seconds(reproduction.cells[1, radius].published.duration)} ({printed:.2f})"
        for radius, printed in FIGURE_SEVEN.items()
    )
    figure_seven = (
        "The caption of figure 7 says example 2, but the figure shows example 1. Our published "
        f"durations at {radii} mm, with the printed ones in brackets: {durations} s."
    )
    parts = [
        _INTRODUCTION,
        "## Table II: five examples\n",
        _table_two(reproduction),
        _summary(reproduction),
        _NOT_MONOTONE + _remarks(remarks),
        "## The reference path itself\n",
        _SCHEMES,
        _table(("example", "conventional, printed", *schemes), without_tube),
        "## Table III: the line of figure 8(a)\n",
        _table_of_line(reproduction, TABLE_THREE),
        _remarks([TABLE_THREE.remark, _line_itself(reproduction, TABLE_THREE)]),
        "## Table IV: the line of figure 9(a)\n",
        _table_of_line(reproduction, TABLE_FOUR),
        _remarks([TABLE_FOUR.remark, _line_itself(reproduction, TABLE_FOUR)]),
        "## Figures\n",
        _remarks([figure_seven]),
        *(f"![{caption}]({file})\n" for caption, file in figures.items()),
    ]
    return "\n".join(parts)


def _table_two(reproduction: Reproduction) -> str:
    head = ["example", "tolerance [mm]"]
    for name in (_PHASE_ONE, _PUBLISHED):
        head += [name, "printed", "ratio"]
    rows = []
    for number, row in TABLE_TWO.items():
        for radius in row.phases:
            pairs = _pairs(reproduction, number, radius)
            line = [str(number), f"{1000 * radius:.0f}"]
            for name in (_PHASE_ONE, _PUBLISHED):
                ours, printed = pairs[name]
                line += [_seconds(ours), f"{printed:.2f}", _ratio(ours, printed)]
            ours, printed = pairs[_DEFAULT]
            rows.append([*line, _seconds(ours), _ratio(ours, printed)])
    return _table([*head, _DEFAULT, "ratio"], rows)


def _summary(reproduction: Reproduction) -> str:
    """Return the mean, least and largest ratio to the printed durations."""
    rows = []
    for name in (_PHASE_ONE, _PUBLISHED, _DEFAULT):
        pairs = [
            _pairs(reproduction, number, radius)[name]
            for number, row in TABLE_TWO.items()
            for radius in row.phases
        ]
        ratios = [ours / printed for ours, printed in pairs if ours is not None]
        summary = ["-"] * 3
        if ratios:
            summary = [f"{value:.3f}" for value in (np.mean(ratios), min(ratios), max(ratios))]
        rows.append([name, f"{len(ratios)} of {len(pairs)}", *summary])
    return _table(("ratio", "cells", "mean", "least", "largest"), rows)


def _pairs(
    reproduction: Reproduction, example: int, radius: float
) -> dict[str, tuple[float | None, float]]:
    """Return our duration and the printed duration, by name."""
    cell = reproduction.cells[example, radius]
    phase_one, phase_two = TABLE_TWO[example].phases[radius]
    return {
        _PHASE_ONE: (cell.published.phase1_duration, phase_one),
        _PUBLISHED: (cell.published.duration, phase_two),
        _DEFAULT: (cell.default.duration, phase_two),
    }


def _table_of_line(reproduction: Reproduction, table: PrintedLine) -> str:
    rows = []
    for radius, printed in table.durations.items():
        cell = reproduction.cells[table.example, radius]
        row = ["none" if radius == NO_TUBE else f"{1000 * radius:.0f}", f"{printed:.2f}"]
        for duration in (cell.published.duration, cell.default.duration):
            row += [_seconds(duration), _ratio(duration, printed)]
        rows.append(row)
    return _table(("tolerance [mm]", "printed", "published", "ratio", "default", "ratio"), rows)


def _line_itself(reproduction: Reproduction, table: PrintedLine) -> str:
    """Return a sentence on instantly switching motors and the cost of smoothness."""
    durations = reproduction.durations(table.example)
    bang_bang, smoothed = durations["bang-bang"], durations["smoothed-bang-bang"]
    return (
        f"Bang-bang on the line itself takes {_seconds(bang_bang)} s (printed: "
        f"{table.bang_bang:.2f} s), smoothed {_seconds(smoothed)} s (printed: {table.smoothed:.2f} "
        "s, with 26 % as an estimate of the cost of smoothness)."
    )


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def _remarks(sentences: Iterable[str]) -> str:
    return "\n".join(f"- {sentence}" for sentence in sentences) + "\n"


def _seconds(duration: float | None) -> str:
    return "-" if duration is None else f"{duration:.3f}"


def _ratio(ours: float | None, printed: float) -> str:
    return "-" if ours is None else f"{ours / printed:.2f}"
