"""`place`: base pose in the cell."""

import time
from math import degrees
from pathlib import Path
from typing import Any

import click
from rich.markup import escape

from tubeplanner.cli import console
from tubeplanner.cli.report import new_table, rendered
from tubeplanner.errors import OptionError
from tubeplanner.output.figures.figure_files import FIGURE_ENDINGS, figure_file
from tubeplanner.output.figures.placement_map import plot_placement
from tubeplanner.output.files.problem_file import with_placement
from tubeplanner.resources import find_problem
from tubeplanner.studies.base_regions import BasePlacement
from tubeplanner.studies.placement import Placement, PlaceOptions
from tubeplanner.studies.placement import place as search
from tubeplanner.task.includes import ProblemLayers

_NONE = "none"  # a value of --stands-on
_MAX_REASONS = 12


@click.command()
@click.argument("problem")
@click.option(
    "--region",
    required=True,
    metavar="X0,X1,Y0,Y1[,Z0,Z1]",
    help="Region of the root link's origin in the cell [m].",
)
@click.option(
    "--stands-on",
    metavar="NAME",
    multiple=True,
    help="Obstacle under the robot, which links that no joint moves may touch, or `none`; "
    "repeatable. Required if there are obstacles.",
)
@click.option(
    "-o",
    "--output",
    type=console.PATH,
    help="Write the problem file with the best place, and a journal (.jsonl) beside it.",
)
@click.option("--plot", "figure", type=console.PATH, help="Draw a map of places (PNG, PDF or SVG).")
@click.option(
    "--quality",
    default="balanced",
    show_default=True,
    help="Quality of the answer: fast, balanced or best; the search is fast.",
)
@click.option(
    "--points",
    type=int,
    default=300,
    show_default=True,
    help="Number of places of the grid, roughly: positions times angles (at most eight).",
)
@console.processes_option("one per processor")
@console.SLACK
@console.SET
@console.AS_JSON
def place(
    problem: str,
    region: str,
    stands_on: tuple[str, ...],
    output: Path | None,
    figure: Path | None,
    quality: str,
    points: int,
    processes: int | None,
    slack: float | None,
    changes: dict[str, Any],
    as_json: bool,
) -> int:
    """Find the place for PROBLEM's robot, in a region of its cell, with the shortest motion.

    A place is a position and an angle about the vertical. A grid of places is tried, then a pattern
    search starts from the five best. Tube and obstacles stay. Joints given as start or goal become
    seeds. Links that no joint moves are checked against all obstacles but those of --stands-on.
    With -o a journal keeps every answer: the same command, run again, continues from the journal.
    """
    options = PlaceOptions(points, quality, slack)
    try:
        bounds = [float(word) for word in region.split(",")]
    except ValueError:
        raise OptionError(
            f"--region '{region}' is no list of numbers with commas between"
        ) from None
    supports = () if stands_on == (_NONE,) else stands_on or None
    source = find_problem(problem, Path())
    journal = None if output is None else output.with_suffix(".jsonl")
    requests = [
        console.Request("problem", output, "-o BEST.yaml", (".yaml", ".yml", ".json")),
        console.Request("journal", journal),
        console.Request("map", figure, "--plot", FIGURE_ENDINGS),
    ]
    files = console.OutputFiles(*requests, inputs=ProblemLayers.read(source).files)
    begin = time.perf_counter()
    with console.shown_progress() as enter, console.workers_of(processes) as workers:
        placement = search(
            problem,
            bounds,
            stands_on=supports,
            changes=changes,
            options=options,
            executor=workers,
            journal=journal,
            progress=enter,
        )
    contents = {"map": lambda path: figure_file(plot_placement(placement), path)}
    if placement.succeeded:
        best = placement.changes
        contents = {"problem": lambda path: with_placement(source, path, best, changes), **contents}
    files.write(contents)
    files.written |= {} if journal is None else {"journal": journal}
    search_time = time.perf_counter() - begin
    if as_json:
        status = "success" if placement.succeeded else "no_trajectory"
        result = {} if placement.result is None else placement.result.as_dict()
        report = {**console.empty_report(status, ""), **result, **placement.as_dict()}
        paths = {kind: str(path) for kind, path in files.written.items()}
        console.print_json({**report, "search_time": search_time, "files": paths})
    else:
        console.say(placement_text(placement))
        files.say()
    return console.SUCCESS if placement.succeeded else console.INFEASIBLE


def placement_text(result: Placement) -> str:
    """Return counts of the places, reasons of places without motion, the given and best place."""
    grid = set(result.grid.base_placements)
    on_grid = sum(row.base_placement in grid for row in result.rows)
    positions = len({base_placement[:3] for base_placement in grid})
    restored = f"; {result.restored} of them from the journal" if result.restored else ""
    duration = result.given.duration
    outcome = result.given.message if duration is None else f"{duration:.4f} s"
    lines = [
        f"{result.problem.name}: {len(result.rows)} places tried, {on_grid} on the grid "
        f"(positions: {positions}, angles at each: {len(grid) // positions}){restored}; "
        f"{result.feasible_count} have a motion",
        *_reason_lines(result),
        f"as given: {_pose_words(result.given.base_placement)}: {outcome}",
    ]
    if result.best is None or result.duration is None:
        lines.append(result.message)
    else:
        gain, comparison = result.gain, ""
        if gain is not None:
            comparison = f", {abs(gain):.1%} {'less' if gain >= 0 else 'more'} than as given"
        best = _pose_words(result.best.base_placement)
        lines.append(f"best: {best}: {result.duration:.4f} s{comparison}")
    if result.stopped_by is not None:
        lines.append("interrupted: the best so far")
    return "\n".join(lines)


def _reason_lines(placement: Placement) -> list[str]:
    """Return a table of reasons of places without motion, the most frequent first."""
    if not placement.reasons:
        return []
    table = new_table("places without a motion", ">places", "reason", "for example")
    for reason, count, example in placement.reasons[:_MAX_REASONS]:
        table.add_row(str(count), escape(reason), escape(example))
    lines = [rendered(table)]
    if hidden := placement.reasons[_MAX_REASONS:]:
        places = sum(count for _, count, _ in hidden)
        lines.append(f"and {places} places for {len(hidden)} other reasons")
    return lines


def _pose_words(base_placement: BasePlacement) -> str:
    x, y, z = (f"{value:.4g}" for value in base_placement[:3])
    yaw = base_placement.yaw
    return f"[{x}, {y}, {z}] m, yaw {yaw:.4g} rad ({degrees(yaw):.1f} deg)"
