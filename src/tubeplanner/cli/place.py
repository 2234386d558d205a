"""`place`: base pose in the cell."""

import time
from math import degrees
from pathlib import Path
from typing import Any

import click
from rich.markup import escape
from rich.table import Table

from tubeplanner.cli.console import (
    AS_JSON,
    INFEASIBLE,
    PATH,
    SET,
    SLACK,
    SUCCESS,
    empty_report,
    nowhere,
    print_json,
    processes_option,
    require_ending,
    say,
    say_unwritten,
    shown_progress,
    workers_of,
    write_answer,
)
from tubeplanner.cli.interrupts import hold_interrupts
from tubeplanner.cli.report import rendered
from tubeplanner.errors import OptionError
from tubeplanner.output.figures.figure_files import figure_file, require_figure
from tubeplanner.output.figures.placement_map import plot_placement
from tubeplanner.output.files.problem_file import with_placement
from tubeplanner.resources import find_problem
from tubeplanner.studies.base_regions import Stand
from tubeplanner.studies.placement import PlaceOptions
from tubeplanner.studies.placement import place as search
from tubeplanner.studies.placement_rows import Placement
from tubeplanner.task.includes import ProblemLayers
from tubeplanner.writing import require_writable

# ---- The command that looks for the place of a robot in its cell.

_NONE = "none"


@click.command()
@click.argument("problem")
@click.option(
    "--region",
    required=True,
    metavar="X0,X1,Y0,Y1[,Z0,Z1]",
    help="Where the root link's origin may be, in the cell [m].",
)
@click.option(
    "--stands-on",
    metavar="NAME",
    multiple=True,
    help="An obstacle that links which no joint moves may touch; repeatable; `none` if it stands "
    "on none of them. Required if there are obstacles.",
)
@click.option(
    "-o",
    "--output",
    type=PATH,
    help="Problem file with the best place; beside it, with .jsonl, the journal.",
)
@click.option("--plot", "figure", type=PATH, help="Map of the places (PNG, PDF or SVG).")
@click.option(
    "--quality",
    default="balanced",
    show_default=True,
    help="Of the answer: fast, balanced or best; the search is fast.",
)
@click.option(
    "--points", type=int, default=300, show_default=True, help="About how many places the grid has."
)
@processes_option("one per processor")
@SLACK
@SET
@AS_JSON
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
    """Look for the place of PROBLEM's robot, in a region of its cell, where its motion is shortest.

    Tries a grid of places and angles about the vertical, then a pattern search from the five best.
    The tube and the obstacles stay; start and goal that are joints become seeds. Links that no
    joint moves are checked against obstacles, but for those that the robot stands on. With -o every
    answer is kept in a journal: run the same command again, and it goes on.
    """
    options = PlaceOptions(points, quality, slack)
    bounds, names = _bounds(region), _names(stands_on)
    source = find_problem(problem, Path())
    journal = None if output is None else output.with_suffix(".jsonl")
    _require_usable(source, output, journal, figure)
    begin = time.perf_counter()
    with shown_progress() as enter, workers_of(processes) as workers:
        found = search(
            problem,
            bounds,
            stands_on=names,
            changes=changes,
            options=options,
            executor=workers,
            journal=journal,
            progress=enter,
        )
    written = _write(found, source, output, figure, changes)
    if journal is not None:
        written["journal"] = journal
    _answer(found, written, time.perf_counter() - begin, as_json)
    return SUCCESS if found.succeeded else INFEASIBLE


def _require_usable(
    source: Path, output: Path | None, journal: Path | None, figure: Path | None
) -> None:
    """Raise unless the files can be written, and are none of those that are read."""
    require_ending(output, "-o", (".yaml", ".yml", ".json"))
    require_figure(figure, "--plot")
    outputs = [path for path in (output, journal, figure) if path is not None]
    require_writable(outputs, ProblemLayers.read(source).files)


def _answer(found: Placement, written: dict[str, Path], search_time: float, as_json: bool) -> None:
    """Print what was found and which files were written."""
    if as_json:
        status = "success" if found.succeeded else "no_trajectory"
        planned = {} if found.result is None else found.result.as_dict()
        report = {**empty_report(status, "", nowhere()), **planned, **found.as_dict()}
        files = {kind: str(path) for kind, path in written.items()}
        print_json({**report, "search_time": search_time, "files": files})
        return
    say(placement_text(found))
    for kind, path in written.items():
        say(f"{kind}: {path}")
    if not written:
        say_unwritten("-o BEST.yaml", "--plot")


def _bounds(text: str) -> list[float]:
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        raise OptionError(f"--region '{text}' is no list of numbers with commas between") from None


def _names(given: tuple[str, ...]) -> tuple[str, ...] | None:
    """Return names of obstacles; None: nothing is said of them."""
    if given == (_NONE,):
        return ()
    return given or None


def _write(
    found: Placement,
    source: Path,
    output: Path | None,
    figure: Path | None,
    changes: dict[str, Any],
) -> dict[str, Path]:
    """Write the requested files, or none; return them by what they are."""
    hold_interrupts()
    contents: dict[Path, bytes] = {}
    written = {}
    if output is not None and found.succeeded:
        contents[output] = with_placement(source, output, found.changes, changes)
        written["problem"] = output
    if figure is not None:
        contents[figure] = figure_file(plot_placement(found), figure)
        written["map"] = figure
    write_answer(contents)
    return written


# ---- Where a robot is to stand, as text for a terminal.

_MOST_REASONS = 12


def placement_text(found: Placement) -> str:
    """Return the places given and found, what was tried, and why places have no motion."""
    grid = set(found.grid.stands)
    on_grid = sum(row.stand in grid for row in found.rows)
    known = f", {found.restored} of them from the journal" if found.restored else ""
    lines = [
        f"{found.problem.name}: {len(found.rows)} places tried, {on_grid} on the grid{known}; "
        f"{found.feasible_count} have a motion",
        *_reason_lines(found),
        f"as given: {_stand_words(found.given.stand)}: {_given_words(found)}",
        _best_line(found),
    ]
    if found.stopped_by is not None:
        lines.append("interrupted: the best so far")
    return "\n".join(lines)


def _best_line(found: Placement) -> str:
    if found.best is None or found.duration is None:
        return found.message
    gain = found.gain
    words = ""
    if gain is not None:
        words = f", {abs(gain):.1%} {'less' if gain >= 0 else 'more'} than as given"
    return f"best: {_stand_words(found.best.stand)}: {found.duration:.4f} s{words}"


def _given_words(found: Placement) -> str:
    duration = found.given.duration
    return found.given.message if duration is None else f"{duration:.4f} s"


def _stand_words(stand: Stand) -> str:
    x, y, z = (f"{value:.4g}" for value in stand[:3])
    return f"[{x}, {y}, {z}] m, yaw {stand.yaw:.4g} rad ({degrees(stand.yaw):.1f} deg)"


def _reason_lines(found: Placement) -> list[str]:
    """Return a table of why places have no motion, the most frequent reason first."""
    if not found.reasons:
        return []
    table = Table(title="places without a motion", title_justify="left")
    table.add_column("places", justify="right")
    table.add_column("reason")
    table.add_column("for example")
    for reason, count, example in found.reasons[:_MOST_REASONS]:
        table.add_row(str(count), escape(reason), escape(example))
    lines = [rendered(table)]
    if hidden := found.reasons[_MOST_REASONS:]:
        places = sum(count for _, count, _ in hidden)
        lines.append(f"and {places} places for {len(hidden)} other reasons")
    return lines
