"""`init`: starter problem file."""

from pathlib import Path
from typing import Any

import click

from tubeplanner.cli import console
from tubeplanner.cli.interrupts import hold_interrupts
from tubeplanner.output.files.new_problem_files import starter_text
from tubeplanner.studies.tubes.starter_problem import starter_problem
from tubeplanner.task.info import problem_doubts
from tubeplanner.writing import write_files


@click.command()
@click.argument("robot")
@click.option("-o", "--output", type=console.PATH, help="Write the problem file (YAML).")
@console.TOOL_FRAME
@console.PACKAGE_DIR
@console.XACRO_ARG
@console.AS_JSON
def init(
    robot: str,
    output: Path | None,
    tool_frame: str | None,
    package_dirs: tuple[str, ...],
    xacro_args: dict[str, str],
    as_json: bool,
) -> None:
    """Print or write a first problem file that plans, for ROBOT (a URDF or example:NAME).

    The file has a start, a short tube that was planned, placeholders for limits that the URDF
    lacks, and commented examples of other fields.
    """
    request = console.Request("problem", output, "-o", (".yaml", ".yml"))
    console.OutputFiles(request, inputs=[robot])
    with console.shown_progress() as enter:
        enter("reading robot")
        files: dict[str, Any] = {"package_dirs": package_dirs, "xacro_args": xacro_args}
        starter = starter_problem(robot, tool_frame, **files, progress=enter)
    hold_interrupts()
    folder = Path() if output is None else output.parent
    text = starter_text(starter, robot, package_dirs, folder, xacro_args)
    if output is not None:
        write_files({output: text.encode()})
    if as_json:
        fields = console.empty_report("success", starter.result.message)
        fields |= {"duration": starter.result.duration, "placeholders": list(starter.placeholders)}
        console.print_json(
            {**fields, "problem": None if output is None else str(output), "text": text}
        )
        return
    if output is None:
        console.say(text, end="")
        return
    notes = (f"note: {note}" for note in problem_doubts(starter.problem))
    console.say(*notes, f"problem: {output}", sep="\n")
    if starter.placeholders:
        console.say(
            f"placeholders to be replaced by the maker's limits: {', '.join(starter.placeholders)}"
        )
    console.say(f"to plan it: tubeplanner plan {output}")
