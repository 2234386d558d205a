"""`study`: table, journal, figure."""

import re
import time
from pathlib import Path

import click
from rich.markup import escape

from tubeplanner.checks import in_figures, is_number
from tubeplanner.cli import console
from tubeplanner.cli.report import new_table, rendered
from tubeplanner.output.figures.study_figures import plot_study
from tubeplanner.studies.study import StudyResult, StudyRow, run_study
from tubeplanner.studies.study_file import load_study
from tubeplanner.task.field_changes import factor_of
from tubeplanner.text import value_text

_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
_MAX_REASONS = 12


@click.command()
@click.argument("study")
@click.option(
    "-o",
    "--output",
    type=console.PATH,
    help="Write the table (CSV or JSON), and a journal (.jsonl) beside it.",
)
@click.option("--plot", "figure", type=console.PATH, help="Draw the figure (PNG, PDF or SVG).")
@console.processes_option("one per processor")
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Plan on the workers of a Dask scheduler, such as tcp://10.0.0.1:8786.",
)
@console.AS_JSON
def study(
    study: str,
    output: Path | None,
    figure: Path | None,
    processes: int | None,
    scheduler: str | None,
    as_json: bool,
) -> int:
    """Plan every point of STUDY, a file of problems, fields and their values.

    With -o a journal keeps every answer at once: after Ctrl-C, a crash or a power failure, the same
    command continues from the journal. Exit status 0 if any point has a certified motion; the other
    rows have the reason.
    """
    journal = None if output is None else output.with_suffix(".jsonl")
    files = console.TableFiles(output, figure, study, journal)
    with console.shown_progress() as enter:
        begin = time.perf_counter()
        enter("reading the study")
        loaded = load_study(study)
        files.spare(loaded.files)
        loading_time = time.perf_counter() - begin
        with console.workers_of(processes, scheduler) as workers:
            result = run_study(loaded, journal=journal, executor=workers, progress=enter)
        files.write_result(result, plot_study)
    planned = sum(row.duration is not None for row in result.rows)
    done, count = len(result.rows), len(result.study.points)
    message = f"{planned} of {done} points have a certified motion"
    if result.stopped_by is not None:
        remedy = "run the same command again to go on" if journal else "nothing is kept without -o"
        message += f"; interrupted, {count - done} of {count} are left: {remedy}"
    return files.answer(
        result, message, loading_time, None if as_json else lambda: study_text(result)
    )


def study_text(result: StudyResult) -> str:
    """Return a table of statuses and reasons with their counts, and the shortest motion."""
    name, count = result.study.name, len(result.study.points)
    table = new_table(f"{name}: {count} points", "status", ">points", "for example")
    by_reason: dict[tuple[str, str], list[StudyRow]] = {}  # that differ in numbers at most
    for row in result.rows:
        reason = "" if row.duration is not None else _NUMBER.sub("#", row.message)
        by_reason.setdefault((str(row.status), reason), []).append(row)
    pairs = sorted(by_reason.items(), key=lambda pair: (pair[0][0] != "success", -len(pair[1])))
    groups = [(status, _example(rows), len(rows)) for (status, _), rows in pairs]
    for status, example, points in groups[:_MAX_REASONS]:
        table.add_row(status, str(points), escape(example))
    lines = [rendered(table)]
    if hidden := groups[_MAX_REASONS:]:
        points = sum(points for *_, points in hidden)
        lines.append(f"and {points} points for {len(hidden)} other reasons")
    if (shortest := result.shortest) is not None:
        lines.append(f"shortest: {shortest.duration:.4f} s at {_values_of(shortest)}")
    return "\n".join(lines)


def _example(rows: list[StudyRow]) -> str:
    durations = [row.duration for row in rows if row.duration is not None]
    if durations:
        return f"{min(durations):.4f} to {max(durations):.4f} s"
    return f"{_values_of(rows[0])}: {rows[0].message}"


def _values_of(row: StudyRow) -> str:
    texts = []
    for path, value in row.values.items():  # numbers and factors in six digits
        text = in_figures(value) if is_number(value) else value_text(value)
        factor = factor_of(value)
        texts.append(f"{path} = {text if factor is None else f'x{factor:g}'}")
    return ", ".join(texts)
