"""The command that says what makes a problem impossible, or how much room it has."""

import time
from pathlib import Path
from typing import Any

import click

from tubeplanner.commands.answer_files import write_answer
from tubeplanner.commands.console import (
    AS_JSON,
    BAD_INPUT,
    INFEASIBLE,
    PATH,
    SET,
    SUCCESS,
    empty_report,
    nowhere,
    print_json,
    require_page,
    say,
    shown_progress,
)
from tubeplanner.commands.explanation_report import explanation_text
from tubeplanner.commands.interrupts import hold_interrupts
from tubeplanner.commands.workers import processes_option, workers_of
from tubeplanner.explanation.explain import explain as search
from tubeplanner.explanation.explanation import Explanation
from tubeplanner.files.output_files import require_writable
from tubeplanner.planning.plan_options import PlanOptions
from tubeplanner.views.explanation_view import view_explanation


@click.command()
@click.argument("problem")
@click.option(
    "--time-limit",
    type=float,
    default=60.0,
    show_default=True,
    help="End after so many seconds with what was found.",
)
@click.option("--quality", default="balanced", show_default=True, help="fast, balanced or best.")
@processes_option("one per processor")
@click.option("--html", type=PATH, help="Write a page that shows what blocks and where, offline.")
@SET
@AS_JSON
def explain(
    problem: str,
    time_limit: float,
    quality: str,
    processes: int | None,
    html: Path | None,
    changes: dict[str, Any],
    as_json: bool,
) -> int:
    """Say what makes PROBLEM impossible, and which smallest single changes make it possible.

    Each change is planned with and certified, and narrowed down to 5 %. Of a problem that can be
    solved, say what limits it most, and how much worse each condition may become. Exit status 0 if
    the problem can be solved, as it is or with a change; else that of plan.
    """
    require_page(html)
    if html is not None:
        require_writable([html], [Path(problem)])
    options = PlanOptions(quality=quality)
    begin = time.perf_counter()
    with shown_progress() as enter, workers_of(processes) as workers:
        found = search(
            problem,
            changes=changes,
            options=options,
            time_limit=time_limit,
            executor=workers,
            progress=enter,
        )
    search_time = time.perf_counter() - begin
    notes = [] if html is None else _write_page(found, html)
    _answer(found, search_time, notes, as_json)
    if found.succeeded:
        return SUCCESS
    return BAD_INPUT if found.problem is None else INFEASIBLE


def _write_page(found: Explanation, path: Path) -> list[str]:
    """Write the page; return what is to be said of it."""
    if found.drawn is None:
        return [f"{path} was not written: the tube cannot be drawn"]
    hold_interrupts()
    write_answer({path: view_explanation(found).html.encode()})
    return [f"page: {path}"]


def _answer(found: Explanation, search_time: float, notes: list[str], as_json: bool) -> None:
    """Print what was found."""
    if as_json:
        report = {**empty_report("", "", nowhere()), **found.as_dict()}
        print_json({**report, "search_time": search_time, "notes": notes})
        return
    say(explanation_text(found, search_time), *notes, sep="\n")
