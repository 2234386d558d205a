"""`reproduce`: the paper's tables and figures."""

from pathlib import Path

import click

from tubeplanner.cli import console
from tubeplanner.cli.interrupts import hold_interrupts
from tubeplanner.output.figures.figure_files import figure_file
from tubeplanner.output.figures.paper_figures import FIGURES
from tubeplanner.studies.reproduction import reproduce as reproduce_tables
from tubeplanner.studies.reproduction import reproduction_page
from tubeplanner.writing import require_writable

PAGE = "the_paper.md"


@click.command()
@click.option(
    "-o",
    "--output",
    type=console.FOLDER,
    default=Path("the_paper"),
    show_default=True,
    help="Write the page and its figures to this folder.",
)
@console.AS_JSON
def reproduce(output: Path, as_json: bool) -> int:
    """Reproduce the tables and figures of Suh & Bishop (1988) beside the printed values.

    Both the published method and the default method are run. The run takes some minutes.
    """
    files = {caption: f"{name}.png" for name, (caption, _) in FIGURES.items()}
    page = output / PAGE
    written = [page, *(output / file for file in files.values())]
    require_writable(written if output.is_dir() else [output])
    with console.shown_progress() as enter:
        reproduction = reproduce_tables(enter)
        enter("drawing")
        hold_interrupts()

        def drawn(path: Path) -> bytes:
            return figure_file(FIGURES[path.stem][1](reproduction), path)

        tables = console.Output(
            "page", page, lambda _: reproduction_page(reproduction, files).encode()
        )
        figures = (console.Output("figure", path, drawn) for path in written[1:])
        console.write_answer(tables, *figures, folder=output)
    if as_json:
        report = console.empty_report("success", f"{len(reproduction.cells)} cases")
        console.print_json({**report, **reproduction.as_dict(), "page": str(page)})
    else:
        console.say_files(written)
    return console.SUCCESS
