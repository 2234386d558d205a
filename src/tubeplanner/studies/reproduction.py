"""The tables of Suh & Bishop (1988) from our code: the published method, and the default one."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from tubeplanner.baselines.baselines import BASELINES, judged_baseline
from tubeplanner.baselines.conventional_lines import PAPER, conventional_trajectory
from tubeplanner.baselines.tool_path import tool_paths
from tubeplanner.branches.known_branches import KnownBranches
from tubeplanner.branches.reference_branch import redundancy_rules
from tubeplanner.outcome import Infeasible
from tubeplanner.planning.plan_options import REFINEMENT, SUH_BISHOP, PlanOptions
from tubeplanner.planning.plan_result import PlanResult
from tubeplanner.planning.planner import plan
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.problem.problem_reader import load_problem
from tubeplanner.progress import PlanningClock, Progress
from tubeplanner.studies.printed_results import (
    FIGURE_SEVEN,
    NO_TUBE,
    TABLE_FOUR,
    TABLE_THREE,
    TABLE_TWO,
)
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.tube.tube import Tube

_METHODS = (SUH_BISHOP, REFINEMENT)
CONVENTIONAL = "by the paper's constants"
PATH_RADIUS = 0.03  # [m]: for the schemes that cut corners
_EVERYWHERE = 10.0  # [m]: a tube that the arm cannot leave


@dataclass(frozen=True, eq=False)
class ReproducedCell:
    """A path at one tolerance, planned by the published method and by the default one.

    Attributes:
        example: Of Table II, whose path it is.
        radius: The tolerance [m]; infinite: no tube, and the elbow may bend either way.
        problem: What was planned.
        published: By the method as published.
        default: By refinement.
    """

    example: int
    radius: float
    problem: PlanningProblem
    published: PlanResult
    default: PlanResult

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
class ReproducedPath:
    """The results of the schemes without a tube on an example's path.

    Attributes:
        example: Of Table II.
        trajectories: By scheme: the trajectory, or why there is none. "by the paper's constants":
            straight lines with stops, at the speed and acceleration of Table I.
    """

    example: int
    trajectories: dict[str, JointTrajectory | str]

    def duration(self, scheme: str) -> float | None:
        """Return how long a scheme takes [s]; None where it has no trajectory."""
        trajectory = self.trajectories[scheme]
        return None if isinstance(trajectory, str) else trajectory.duration


@dataclass(frozen=True, eq=False)
class Reproduction:
    """Tables II to IV from our code.

    Attributes:
        cells: By example and tolerance [m].
        paths: By example.
    """

    cells: dict[tuple[int, float], ReproducedCell]
    paths: dict[int, ReproducedPath]

    def cell(self, example: int, radius: float) -> ReproducedCell:
        """Return an example at a tolerance [m]."""
        return self.cells[example, radius]

    def as_dict(self) -> dict[str, Any]:
        """Return all durations as JSON values [s]."""
        return {
            "cells": [cell.as_dict() for cell in self.cells.values()],
            "paths": {
                str(number): {name: path.duration(name) for name in path.trajectories}
                for number, path in self.paths.items()
            },
        }


def reproduce(progress: Callable[[object], None] | None = None) -> Reproduction:
    """Plan all that Suh & Bishop (1988) tabulate, by their method and by the default one.

    Args:
        progress: Called with each stage.

    Raises:
        KeyboardInterrupt: Ctrl-C.
    """
    tell = progress or (lambda what: None)
    tabulated = _tabulated()
    cells = {}
    for number, (example, radius) in enumerate(tabulated, start=1):
        where = f"example {example}, {_tolerance(radius)} ({number} of {len(tabulated)})"
        cells[example, radius] = _cell(example, radius, _prefixed(tell, where))
    paths = {}
    for example in TABLE_TWO:
        tell(f"example {example}, schemes without a tube")
        paths[example] = _path(example)
    return Reproduction(cells, paths)


def paper_problem(example: int, radius: float) -> PlanningProblem:
    """Return an example of Table II with a tolerance [m]; infinite: signs are free too."""
    problem = load_problem(f"example:two_link/paper_{example}_30mm")
    if radius == NO_TUBE:
        return problem.with_tube(Tube(problem.tube.points, _EVERYWHERE))
    return problem.with_tube(problem.tube.with_radius(radius))


def _tabulated() -> list[tuple[int, float]]:
    """Return the examples and tolerances of all tables and figures, each once."""
    found = [(number, radius) for number, row in TABLE_TWO.items() for radius in row.phases]
    for table in (TABLE_THREE, TABLE_FOUR):
        found += [(table.example, radius) for radius in table.durations]
    found += [(1, radius) for radius in FIGURE_SEVEN]
    return sorted(set(found))


def _tolerance(radius: float) -> str:
    return "no tube" if radius == NO_TUBE else f"{1000 * radius:.0f} mm"


def _prefixed(tell: Callable[[object], None], where: str) -> Callable[[Progress], None]:
    return lambda what: tell(f"{where}: {what}")


def _cell(example: int, radius: float, progress: Callable[[Progress], None]) -> ReproducedCell:
    problem = paper_problem(example, radius)
    results = []
    for method in _METHODS:
        result = plan(problem, PlanOptions(method, slack=0.0), progress)
        if result.stopped_by == "interrupt":
            raise KeyboardInterrupt
        results.append(result)
    return ReproducedCell(example, radius, problem, *results)


def _path(example: int) -> ReproducedPath:
    problem = paper_problem(example, PATH_RADIUS)
    trajectories: dict[str, JointTrajectory | str] = {CONVENTIONAL: _conventional(problem)}
    for name in BASELINES:
        try:
            trajectories[name] = judged_baseline(problem, name)[0].trajectory
        except Infeasible as reason:
            trajectories[name] = str(reason)
    return ReproducedPath(example, trajectories)


def _conventional(problem: PlanningProblem) -> JointTrajectory:
    """Return straight lines with stops at the speed and acceleration of Table I."""
    branches = KnownBranches(problem, PlanningClock(None, None))
    lines = tool_paths(problem, branches.by_rule(redundancy_rules(problem)[0]), arcs=False)
    return conventional_trajectory(problem.robot, lines, PAPER)
