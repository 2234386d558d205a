"""The command that runs a study: its table, its journal, its figure."""

import time
from pathlib import Path

import click

from tubeplanner.commands.answer_files import table_bytes, write_answer
from tubeplanner.commands.console import (
    AS_JSON,
    INFEASIBLE,
    PATH,
    SUCCESS,
    empty_report,
    nowhere,
    print_json,
    require_ending,
    say,
    say_unwritten,
    shown_progress,
)
from tubeplanner.commands.interrupts import hold_interrupts
from tubeplanner.commands.study_report import study_text
from tubeplanner.commands.workers import processes_option, workers_of
from tubeplanner.files.output_files import require_writable
from tubeplanner.studies.study_reader import load_study
from tubeplanner.studies.study_result import StudyResult
from tubeplanner.studies.study_run import run_study
from tubeplanner.views.figure_files import figure_file, require_figure
from tubeplanner.views.study_figure import plot_study


@click.command()
@click.argument("study")
@click.option(
    "-o",
    "--output",
    type=PATH,
    help="Table (CSV or JSON, by its ending); beside it, with .jsonl, the journal.",
)
@click.option("--plot", "figure", type=PATH, help="Figure (PNG, PDF or SVG).")
@processes_option("one per processor")
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Plan by the workers of a Dask scheduler, such as tcp://10.0.0.1:8786.",
)
@AS_JSON
def study(
    study: str,
    output: Path | None,
    figure: Path | None,
    processes: int | None,
    scheduler: str | None,
    as_json: bool,
) -> int:
    """Plan every point of STUDY, a file that says which fields of which problems take which values.

    With -o every answer is kept in a journal as soon as it is there: run the same command again
    after Ctrl-C, a crash or a power failure, and it goes on. Exit status 0 if any point has a
    certified motion; the other rows say why not.
    """
    require_ending(output, "-o", (".csv", ".json"))
    require_figure(figure, "--plot")
    journal = None if output is None else output.with_suffix(".jsonl")
    outputs = [path for path in (output, journal, figure) if path is not None]
    require_writable(outputs, [Path(study)])
    with shown_progress() as enter:
        begin = time.perf_counter()
        enter("reading the study")
        loaded = load_study(study)
        require_writable(outputs, loaded.files)
        loading_time = time.perf_counter() - begin
        with workers_of(processes, scheduler) as workers:
            result = run_study(loaded, journal=journal, executor=workers, progress=enter)
        _write(result, output, figure)
    message = _message(result, journal)
    if as_json:
        status = "success" if result.succeeded else "no_trajectory"
        report = {**empty_report(status, message, nowhere()), "loading_time": loading_time}
        print_json({**report, **result.as_dict()})
    else:
        say(study_text(result), message, sep="\n")
        say(*outputs, sep="\n") if outputs else say_unwritten("-o TABLE.csv", "--plot")
    return SUCCESS if result.succeeded else INFEASIBLE


def _write(result: StudyResult, output: Path | None, figure: Path | None) -> None:
    """Write the table and the figure, or neither."""
    hold_interrupts()
    contents: dict[Path, bytes] = {}
    if output is not None:
        contents[output] = table_bytes(result, output)
    if figure is not None:
        contents[figure] = figure_file(plot_study(result), figure)
    write_answer(contents)


def _message(result: StudyResult, journal: Path | None) -> str:
    planned = sum(row.duration is not None for row in result.rows)
    done, count = len(result.rows), len(result.study.points)
    message = f"{planned} of {done} points have a certified motion"
    if result.stopped_by is None:
        return message
    go_on = "run the same command again to go on" if journal else "nothing is kept without -o"
    return f"{message}; interrupted, {count - done} of {count} are left: {go_on}"
