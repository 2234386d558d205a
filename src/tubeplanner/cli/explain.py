"""`explain`: reason, remedies, headroom."""

import time
from pathlib import Path
from typing import Any

import click
from rich.markup import escape

from tubeplanner.cli import console
from tubeplanner.cli.report import certificate_text, new_table, rendered
from tubeplanner.output.page.explanation_page import view_explanation
from tubeplanner.planning.options import PlanOptions
from tubeplanner.studies.explanation import Explanation, ineffective_text, setting_text, tried_text
from tubeplanner.studies.explanation import explain as search
from tubeplanner.studies.remedies import Headroom, Remedy
from tubeplanner.text import savings

_SENSITIVITIES_SHOWN = 10
_SCALES = "the smallest first: the scale of a place is 0.1 m, of an angle 0.1 rad, else the value"


@click.command()
@click.argument("problem")
@click.option(
    "--time-limit",
    type=float,
    default=60.0,
    show_default=True,
    help="Stop after this time [s], with the results so far.",
)
@click.option("--quality", default="balanced", show_default=True, help="fast, balanced or best.")
@console.processes_option("one per processor")
@click.option(
    "--html", type=console.PATH, help="Write a page (HTML, offline) that shows the blocking place."
)
@console.SET
@console.AS_JSON
def explain(
    problem: str,
    time_limit: float,
    quality: str,
    processes: int | None,
    html: Path | None,
    changes: dict[str, Any],
    as_json: bool,
) -> int:
    """Explain why PROBLEM is impossible, and list the smallest single changes that help.

    Each change is planned, certified and found to 5 %. For a possible problem: name its tightest
    limits, and how much worse each condition may become. The field robustness is ignored: plan
    names the error that no motion survives. Exit status 0 if the problem, or the problem with a
    change, can be planned; else the exit status of plan.
    """
    request = console.Request("page", html, "--html", console.PAGE_ENDINGS)
    files = console.OutputFiles(request, inputs=[problem])
    options = PlanOptions(quality=quality)
    begin = time.perf_counter()
    with console.shown_progress() as enter, console.workers_of(processes) as workers:
        explanation = search(
            problem,
            changes=changes,
            options=options,
            time_limit=time_limit,
            executor=workers,
            progress=enter,
        )
    search_time = time.perf_counter() - begin
    notes: list[str] = []
    if html is not None and explanation.drawn is None:
        notes = [f"{html} was not written: the tube cannot be drawn"]
    elif html is not None:
        files.write({"page": lambda _: view_explanation(explanation).html.encode()})
        notes = [f"page: {path}" for path in files.written.values()]
    if as_json:
        report = {**console.empty_report("", ""), **explanation.as_dict()}
        console.print_json({**report, "search_time": search_time, "notes": notes})
    else:
        console.say(explanation_text(explanation, search_time), *notes, sep="\n")
    if explanation.succeeded:
        return console.SUCCESS
    return console.BAD_INPUT if explanation.problem is None else console.INFEASIBLE


def explanation_text(explanation: Explanation, search_time: float) -> str:
    """Return an explanation as text.

    Args:
        explanation: The explanation.
        search_time: Wall time of the search [s].
    """
    location = str(explanation.location)
    end = {
        None: "all changes were tried",
        "time_limit": "the time limit passed: with a larger --time-limit there may be more",
        "interrupt": "interrupted: there may be more",
    }[explanation.stopped_by]
    lines = [
        f"{explanation.name}: {explanation.status}: {explanation.message}",
        *([f"where: {location}"] if location else []),
        *(_headroom_lines(explanation) if explanation.is_possible else _remedy_lines(explanation)),
        f"{explanation.tried} plans with a change in {search_time:.1f} s; {end}",
    ]
    return "\n".join(lines)


def _remedy_lines(explanation: Explanation) -> list[str]:
    """Return a table of remedies, and a line on ineffective changes."""
    lines = ["no single change was found that makes it possible"]
    if explanation.remedies:
        changes = explanation.remedies[0].changes
        lines = [_remedy_table(explanation.remedies), f"the first one: {setting_text(changes)}"]
    if explanation.ineffective:
        lines.append(f"by itself none of these helps: {ineffective_text(explanation.ineffective)}")
    return lines


def _remedy_table(remedies: tuple[Remedy, ...]) -> str:
    title = "any one of these makes it possible (planned with it and certified)"
    headings = ("change", "not enough", ">of its scale", ">duration", "field")
    table = new_table(title, *headings)
    for remedy in remedies:
        table.add_row(
            escape(remedy.text),
            escape(tried_text(remedy.too_little_text, remedy.is_smallest)),
            f"{remedy.cost:.2g}",
            f"{remedy.duration:.3f} s",
            escape(remedy.field),
        )
    return f"{rendered(table)}\n{_SCALES}"


def _headroom_lines(explanation: Explanation) -> list[str]:
    """Return sensitivities, margins and headroom of a problem that was planned."""
    result = explanation.result
    assert result is not None
    lines = []
    if largest := savings(result.sensitivities)[:_SENSITIVITIES_SHOWN]:
        lines += ["raising a limit by 10 % would save:", *(f"  {each}" for each in largest)]
    if result.certificate is not None:
        lines.append(certificate_text(result.certificate))
    if explanation.headrooms:
        lines.append(_headroom_table(explanation.headrooms))
    return lines


def _headroom_table(headrooms: tuple[Headroom, ...]) -> str:
    headings = ("still possible", ">duration", "nothing found with", "field")
    table = new_table("how much worse one of these may become", *headings)
    for headroom in headrooms:
        table.add_row(
            escape(headroom.text),
            "" if headroom.duration is None else f"{headroom.duration:.3f} s",
            escape(tried_text(headroom.too_much_text, headroom.is_exact)),
            escape(headroom.field),
        )
    return rendered(table)
