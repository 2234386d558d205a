"""`links`: cover errors, ignored pairs."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import click
from rich.markup import escape
from rich.table import Table

from tubeplanner.cli import console
from tubeplanner.cli.report import rendered
from tubeplanner.geometry.collision_checker import LinkCover, link_covers
from tubeplanner.task.problem import PlanningProblem


@click.command()
@click.argument("problem")
@console.SET
@console.AS_JSON
def links(problem: str, changes: dict[str, Any], as_json: bool) -> None:
    """List each link's collision shapes and their distance from its geometry [mm].

    Then list the pairs of links and obstacles that are not checked, with the reasons.
    """
    with console.shown_progress() as enter:
        loaded, loading_time = console.load_timed(problem, enter, changes)
        enter("covers of links")
        covers = link_covers(loaded.collision)
    left_out = loaded.collision.left_out
    if as_json:
        message = f"{len(covers)} links, {len(left_out)} pairs left out"
        fields = console.empty_report("success", message) | {"loading_time": loading_time}
        listed = {"links": [asdict(each) for each in covers]}
        console.print_json({**fields, **listed, "left_out": [asdict(pair) for pair in left_out]})
        return
    console.say(links_text(loaded, covers))


def links_text(problem: PlanningProblem, covers: Sequence[LinkCover]) -> str:
    """Return the cover errors of links as a table, and the pairs that are not checked."""
    table = Table(title=f"{problem.name}: links and their convex covers", title_justify="left")
    table.add_column("link")
    for heading in ("shapes", "stand off by", "where others come near", "by"):
        table.add_column(heading, justify="right")
    for each in covers:
        closer = ("", "")
        if each.closer_error is not None:
            closer = (str(each.closer_shapes), f"{1000 * each.closer_error:.2f} mm")
        error = f"{1000 * each.outer_error:.2f} mm"
        table.add_row(escape(each.link), str(each.shapes), error, *closer)
    pairs = [
        f"not checked: {' and '.join(pair.links)} ({pair.reason})"
        for pair in problem.collision.left_out
    ]
    return "\n".join([rendered(table), *pairs])
