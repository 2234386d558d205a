"""`sweep`: durations over a tolerance or field."""

from collections.abc import Callable
from concurrent.futures import Executor
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from pathlib import Path
from typing import Any

import click
from rich.markup import escape

from tubeplanner.cli import console
from tubeplanner.cli.report import new_table, rendered
from tubeplanner.errors import OptionError
from tubeplanner.output.figures.sweep_figures import plot_field_sweep, plot_sweep
from tubeplanner.planning.options import PlanOptions
from tubeplanner.studies.sweeps import FieldSweep, SweepResult, sweep_field
from tubeplanner.studies.sweeps import sweep as sweep_problem
from tubeplanner.task.field_changes import is_of_objective, parse_variation
from tubeplanner.text import in_milliseconds, value_text


@click.command()
@click.argument("problem")
@click.option("--radius", help="Radii for all segments [m], such as 0.005,0.01,0.02.")
@click.option("--radius-scale", help="Factors for the problem's radii and boxes, such as 0.5,1,2.")
@click.option(
    "--vary",
    "variations",
    metavar="FIELD.PATH=V1,V2,...",
    multiple=True,
    help="Values of any field, such as robot.payload.mass=0,2,5 or tube.radius=x0.5,x1.",
)
@click.option("-o", "--output", type=console.PATH, help="Write the table (CSV or JSON).")
@click.option("--plot", "figure", type=console.PATH, help="Draw the figure (PNG, PDF or SVG).")
@click.option("--quality", default="balanced", show_default=True, help="fast, balanced or best.")
@console.processes_option("this one, value by value")
@console.SLACK
@console.SET
@console.AS_JSON
def sweep(
    problem: str,
    radius: str | None,
    radius_scale: str | None,
    variations: tuple[str, ...],
    output: Path | None,
    figure: Path | None,
    quality: str,
    processes: int | None,
    slack: float | None,
    changes: dict[str, Any],
    as_json: bool,
) -> int:
    """Plan PROBLEM at several tolerances, or values of a field, and compare the durations [s].

    The motions are the shortest, unless --slack or --vary objective.... says otherwise. Exit status
    0 if any value has a certified trajectory; the other rows have the reason.
    """
    if (radius is not None) + (radius_scale is not None) + bool(variations) != 1:
        raise OptionError("sweep takes either --radius or --radius-scale or --vary")
    options = PlanOptions(quality=quality, slack=slack)
    files = console.TableFiles(output, figure, problem)
    result: SweepResult | FieldSweep
    # By default this process plans.
    executor: AbstractContextManager[Executor | None]
    executor = nullcontext() if processes is None else console.workers_of(processes)
    with console.shown_progress() as enter, executor as workers:
        if variations:
            result = _swept_field(problem, variations, changes, options, workers, enter)
            loading_time = sum(row.loading_time for row in result.rows)
        else:
            console.require_used(changes, slack)
            radii, scales = _numbers("--radius", radius), _numbers("--radius-scale", radius_scale)
            loaded, loading_time = console.load_timed(problem, enter, changes)
            files.spare([loaded.robot.urdf.path])
            result = sweep_problem(
                *(loaded, radii), scales=scales, options=options, executor=workers, progress=enter
            )
        files.write_result(result, plot_field_sweep if variations else plot_sweep)
    planned = sum(row.duration is not None for row in result.rows)
    message = f"{planned} of {len(result.rows)} planned"
    message += console.OTHERS_NOT_TRIED if result.stopped_by else ""
    text = field_sweep_text if variations else sweep_text
    printed = None if as_json else partial(text, result)  # type: ignore[arg-type]
    return files.answer(result, message, loading_time, printed)


def _swept_field(
    problem: str,
    variations: tuple[str, ...],
    changes: dict[str, Any],
    options: PlanOptions,
    executor: Executor | None,
    progress: Callable[[object], None],
) -> FieldSweep:
    """Return a sweep over the varied field."""
    if len(variations) > 1:
        raise OptionError(f"--vary {variations[1]}: a sweep varies one field; leave out the others")
    path, values = parse_variation("--vary", variations[0])
    if not is_of_objective(path):
        console.require_used(changes, options.slack)
    return sweep_field(
        *(problem, path, values),
        changes=changes,
        options=options,
        executor=executor,
        progress=progress,
    )


def _numbers(option: str, text: str | None) -> list[float] | None:
    if text is None:
        return None
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        raise OptionError(f"{option} '{text}' is no list of numbers with commas between") from None


def sweep_text(result: SweepResult) -> str:
    """Return a sweep as a table, as wide as the terminal, and the rows' messages."""
    scaled = result.quantity != "radius"
    headings = (">scale" if scaled else ">radius", ">duration", ">10 % more radius", ">planned in")
    table = new_table(f"{result.problem.name}: duration against tolerance", *headings, "answer")
    for row in result.rows:
        value = f"{row.value:g}" if scaled else f"{1000 * row.value:g} mm"
        if row.result is None or row.duration is None:
            table.add_row(value, "", "", "", f"{row.status}: {escape(row.message)}")
            continue
        saving = ""
        if row.elasticity is not None:
            saving = f"saves {in_milliseconds(0.1 * abs(row.elasticity) * row.duration)}"
        message = f"certified, {row.result.method}" + (f"; {row.note}" if row.note else "")
        times = (f"{row.duration:.4f} s", saving, f"{row.result.planning_time:.2f} s")
        table.add_row(value, *times, message)
    return rendered(table)


def field_sweep_text(result: FieldSweep) -> str:
    """Return a sweep over a field as a table, as wide as the terminal, and the answers' notes."""
    headings = ["duration", *["shortest"] * result.varies_objective]
    headings += [*["runs failed"] * result.is_simulated, "planned in"]
    columns = [f">{heading}" for heading in (escape(result.path), *headings)]
    table = new_table(f"{result.name}: duration against {result.path}", *columns, "answer")
    for row in result.rows:
        value = escape(value_text(row.value))
        if row.result is None or row.duration is None:
            gaps = [""] * len(headings)
            table.add_row(value, *gaps, f"{row.status}: {escape(row.message)}")
            continue
        durations = [row.duration, *[row.shortest_duration] * result.varies_objective]
        cells = [f"{duration:.4f} s" for duration in durations]
        failures = "" if row.verdict is None else f"{row.verdict.failed} of {row.verdict.runs}"
        cells += [*[failures] * result.is_simulated, f"{row.result.planning_time:.2f} s"]
        table.add_row(value, *cells, f"certified, {row.result.method}")
    by_note: dict[str, list[str]] = {}
    for row in result.rows:
        for note in row.notes:
            by_note.setdefault(note, []).append(value_text(row.value))
    notes = [f"note ({', '.join(values)}): {note}" for note, values in by_note.items()]
    return "\n".join([rendered(table), *notes])
