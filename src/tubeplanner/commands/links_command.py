"""The command that lists the links of a robot: how closely they are covered, what is left out."""

from dataclasses import asdict
from typing import Any

import click

from tubeplanner.commands.console import (
    AS_JSON,
    SET,
    empty_report,
    load_timed,
    nowhere,
    print_json,
    say,
    shown_progress,
)


@click.command()
@click.argument("problem")
@SET
@AS_JSON
def links(problem: str, changes: dict[str, Any], as_json: bool) -> None:
    """List the links of PROBLEM's robot: how far their collision shapes stand off their geometry.

    Then the pairs of links and obstacles that are not checked against each other, and why.
    """
    from tubeplanner.collision.link_covers import link_covers

    with shown_progress() as enter:
        loaded, loading_time = load_timed(problem, enter, changes)
        enter("covers of links")
        covers = link_covers(loaded.collision)
    left_out = loaded.collision.left_out
    if as_json:
        message = f"{len(covers)} links, {len(left_out)} pairs left out"
        fields = empty_report("success", message, nowhere()) | {"loading_time": loading_time}
        listed = {"links": [asdict(each) for each in covers]}
        print_json({**fields, **listed, "left_out": [asdict(pair) for pair in left_out]})
        return
    from tubeplanner.commands.report import links_text

    say(links_text(loaded, covers))
