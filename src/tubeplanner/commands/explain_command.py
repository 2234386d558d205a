"""The command that says what makes a problem impossible, or how much room it has."""

import time
from typing import TYPE_CHECKING, Any

import click

from tubeplanner.commands.console import (
    AS_JSON,
    BAD_INPUT,
    INFEASIBLE,
    SET,
    SUCCESS,
    empty_report,
    nowhere,
    print_json,
    say,
    shown_progress,
)
from tubeplanner.commands.workers import processes_option, workers_of

if TYPE_CHECKING:
    from tubeplanner.explanation.explanation import Explanation


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
@SET
@AS_JSON
def explain(
    problem: str,
    time_limit: float,
    quality: str,
    processes: int | None,
    changes: dict[str, Any],
    as_json: bool,
) -> int:
    """Say what makes PROBLEM impossible, and which smallest single changes make it possible.

    Each change is planned with and certified, and narrowed down to 5 %. Of a problem that can be
    solved, say what limits it most, and how much worse each condition may become. Exit status 0 if
    the problem can be solved, as it is or with a change; else that of plan.
    """
    from tubeplanner.explanation.explain import explain as search
    from tubeplanner.planning.plan_options import PlanOptions

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
    _answer(found, time.perf_counter() - begin, as_json)
    if found.succeeded:
        return SUCCESS
    return BAD_INPUT if found.problem is None else INFEASIBLE


def _answer(found: "Explanation", search_time: float, as_json: bool) -> None:
    """Print what was found."""
    from tubeplanner.commands.explanation_report import explanation_text

    if as_json:
        report = {**empty_report("", "", nowhere()), **found.as_dict()}
        print_json({**report, "search_time": search_time})
        return
    say(explanation_text(found, search_time))
