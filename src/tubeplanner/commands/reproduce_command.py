"""The command that remakes the tables and figures of the paper."""

from pathlib import Path

import click

from tubeplanner.commands.answer_files import write_answer
from tubeplanner.commands.console import (
    AS_JSON,
    FOLDER,
    SUCCESS,
    empty_report,
    nowhere,
    print_json,
    say,
    shown_progress,
)
from tubeplanner.commands.interrupts import hold_interrupts
from tubeplanner.files.output_files import require_writable
from tubeplanner.studies.reproduction import reproduce as reproduce_tables
from tubeplanner.studies.reproduction_page import reproduction_page
from tubeplanner.views.figure_files import figure_file
from tubeplanner.views.reproduction_figures import FIGURES

PAGE = "the_paper.md"


@click.command()
@click.option(
    "-o",
    "--output",
    type=FOLDER,
    default=Path("the_paper"),
    show_default=True,
    help="Folder for the page and its figures.",
)
@AS_JSON
def reproduce(output: Path, as_json: bool) -> int:
    """Plan what Suh & Bishop (1988) tabulate: their tables and figures beside the printed values.

    Uses the published method and the default one. It takes some minutes.
    """
    files = {caption: f"{name}.png" for name, (caption, _) in FIGURES.items()}
    page = output / PAGE
    written = [page, *(output / file for file in files.values())]
    require_writable(written if output.is_dir() else [output])
    with shown_progress() as enter:
        reproduction = reproduce_tables(enter)
        enter("drawing")
        hold_interrupts()
        contents = {page: reproduction_page(reproduction, files).encode()}
        for name, (_, draw) in FIGURES.items():
            path = output / f"{name}.png"
            contents[path] = figure_file(draw(reproduction), path)
        write_answer(contents, output)
    if as_json:
        report = empty_report("success", f"{len(reproduction.cells)} cases", nowhere())
        print_json({**report, **reproduction.as_dict(), "page": str(page)})
    else:
        say(*contents, sep="\n")
    return SUCCESS
