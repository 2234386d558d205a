"""`init`: starter problem file."""

from pathlib import Path

import click

from tubeplanner.cli.console import (
    AS_JSON,
    PACKAGE_DIR,
    PATH,
    TOOL_FRAME,
    empty_report,
    nowhere,
    print_json,
    require_ending,
    say,
    shown_progress,
    write_answer,
)
from tubeplanner.cli.interrupts import hold_interrupts
from tubeplanner.output.files.new_problem_files import starter_text
from tubeplanner.studies.tubes.starter_problem import starter_problem
from tubeplanner.writing import require_writable


@click.command()
@click.argument("robot")
@click.option("-o", "--output", type=PATH, help="Problem file (YAML).")
@TOOL_FRAME
@PACKAGE_DIR
@AS_JSON
def init(
    robot: str,
    output: Path | None,
    tool_frame: str | None,
    package_dirs: tuple[str, ...],
    as_json: bool,
) -> None:
    """Print or write a problem file that plans as it stands, for ROBOT, a URDF or example:NAME.

    It has a start, a short tube that was planned, placeholders for limits that the URDF lacks, and
    commented examples of other fields.
    """
    require_ending(output, "-o", (".yaml", ".yml"))
    if output is not None:
        require_writable([output], [Path(robot)])
    with shown_progress() as enter:
        enter("reading robot")
        found = starter_problem(robot, tool_frame, package_dirs=package_dirs, progress=enter)
    hold_interrupts()
    text = starter_text(found, robot, package_dirs, Path() if output is None else output.parent)
    if output is not None:
        write_answer({output: text.encode()})
    if as_json:
        fields = empty_report("success", found.result.message, nowhere())
        fields |= {"duration": found.result.duration, "placeholders": list(found.placeholders)}
        print_json({**fields, "problem": None if output is None else str(output), "text": text})
        return
    if output is None:
        say(text, end="")
        return
    say(f"problem: {output}")
    if found.placeholders:
        say(f"placeholders to be replaced by the maker's limits: {', '.join(found.placeholders)}")
    say(f"to plan it: tubeplanner plan {output}")
