"""`explain`: reason, remedies, headroom."""

import time
from pathlib import Path
from typing import Any

import click
from rich.markup import escape
from rich.table import Table

from tubeplanner.cli.console import (
    AS_JSON,
    BAD_INPUT,
    INFEASIBLE,
    PATH,
    SET,
    SUCCESS,
    empty_report,
    nowhere,
    print_json,
    processes_option,
    require_page,
    say,
    shown_progress,
    workers_of,
    write_answer,
)
from tubeplanner.cli.interrupts import hold_interrupts
from tubeplanner.cli.report import certificate_text, rendered
from tubeplanner.output.page.explanation_page import view_explanation
from tubeplanner.planning.options import PlanOptions
from tubeplanner.studies.explanation import Explanation, in_vain_text, setting_text, tried_text
from tubeplanner.studies.explanation import explain as search
from tubeplanner.studies.remedies import Remedy, Room
from tubeplanner.writing import require_writable

# ---- The command that says what makes a problem impossible, or how much room it has.


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


# ---- What makes a problem impossible and what helps, or how much room it has, as text.

_SENSITIVITIES_SHOWN = 10
_SCALES = "the smallest first: the scale of a place is 0.1 m, of an angle 0.1 rad, else the value"


def explanation_text(found: Explanation, search_time: float) -> str:
    """Return what was found out about a problem as text.

    Args:
        found: It.
        search_time: How long that took [s].
    """
    place = str(found.place)
    lines = [
        f"{found.name}: {found.status}: {found.message}",
        *([f"where: {place}"] if place else []),
        *(_room_lines(found) if found.is_possible else _remedy_lines(found)),
        _search_line(found, search_time),
    ]
    return "\n".join(lines)


def _search_line(found: Explanation, search_time: float) -> str:
    ended = {
        None: "all changes were tried",
        "time_limit": "the time limit passed: with a larger --time-limit there may be more",
        "interrupt": "interrupted: there may be more",
    }[found.stopped_by]
    return f"{found.tried} plans with a change in {search_time:.1f} s; {ended}"


def _remedy_lines(found: Explanation) -> list[str]:
    """Return a table of remedies, and what helps nothing."""
    if not found.remedies:
        lines = ["no single change was found that makes it possible"]
    else:
        lines = [_remedy_table(found.remedies), *_setting_lines(found.remedies[0])]
    if found.in_vain:
        lines.append(f"by itself none of these helps: {in_vain_text(found.in_vain)}")
    return lines


def _remedy_table(remedies: tuple[Remedy, ...]) -> str:
    table = Table(
        title="any one of these makes it possible (planned with it and certified)",
        title_justify="left",
    )
    table.add_column("change")
    table.add_column("not enough")
    table.add_column("of its scale", justify="right")
    table.add_column("duration", justify="right")
    table.add_column("field")
    for remedy in remedies:
        table.add_row(
            escape(remedy.text),
            escape(tried_text(remedy.too_little_text, remedy.is_smallest)),
            f"{remedy.cost:.2g}",
            f"{remedy.duration:.3f} s",
            escape(remedy.field),
        )
    return f"{rendered(table)}\n{_SCALES}"


def _setting_lines(remedy: Remedy) -> list[str]:
    """Return how the first remedy is given to a command."""
    return [f"the first one: {setting_text(remedy.changes)}"]


def _room_lines(found: Explanation) -> list[str]:
    """Return prices, margins and room of a problem that was planned."""
    result = found.result
    assert result is not None
    lines = []
    dearest = [each for each in result.sensitivities[:_SENSITIVITIES_SHOWN] if each.saved > 0]
    if dearest:
        lines.append("what limits it most; 10 % more would save:")
        lines += [f"  {each}" for each in dearest]
    if result.certificate is not None:
        lines.append(certificate_text(result.certificate))
    if found.rooms:
        lines.append(_room_table(found.rooms))
    return lines


def _room_table(rooms: tuple[Room, ...]) -> str:
    table = Table(title="how much worse one of these may become", title_justify="left")
    table.add_column("still possible")
    table.add_column("duration", justify="right")
    table.add_column("nothing found with")
    table.add_column("field")
    for room in rooms:
        table.add_row(
            escape(room.text),
            "" if room.duration is None else f"{room.duration:.3f} s",
            escape(tried_text(room.too_much_text, room.is_exact)),
            escape(room.field),
        )
    return rendered(table)
