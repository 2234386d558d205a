"""`init`, `import`: starter problem file, problem file of MoveIt's messages."""

from functools import partial
from pathlib import Path
from typing import Any

import click

from tubeplanner.cli import console
from tubeplanner.cli.interrupts import hold_interrupts
from tubeplanner.errors import OptionError
from tubeplanner.output.files.new_problem_files import (
    imported_contents,
    imported_problem,
    read_cell,
    scene_and_request,
    starter_text,
    tool_frame_of,
)
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


@click.command("import")
@click.argument("messages", metavar="SCENE [REQUEST]", type=console.INPUT, nargs=-1, required=True)
@click.option("--urdf", help="Robot description: a path, package://PKG/... or example:NAME.")
@click.option("--srdf", help="SRDF of the robot: its pairs that may touch, its groups.")
@click.option(
    "--tool-frame", help="Link of the tool [default: that of the request's goal or group]."
)
@click.option("--problem", "template", help="Problem file with the robot and its limits.")
@click.option("-o", "--output", type=console.PATH, help="Write the problem file.")
@console.SET
@console.AS_JSON
def import_(
    messages: tuple[Path, ...],
    urdf: str | None,
    srdf: str | None,
    tool_frame: str | None,
    template: str | None,
    output: Path | None,
    changes: dict[str, Any],
    as_json: bool,
) -> None:
    """Print or write the problem file of MoveIt's planning scene SCENE and motion plan REQUEST.

    Both are YAML of the messages, in any order; either may be left out. Solids, attached solids
    and allowed collisions are the scene's; start, goal and scaling factors are the request's, or
    the start is the scene's state. The tube is open: `route` finds one. Notes name what was not
    read.
    """
    if (template is None) == (urdf is None):
        raise OptionError("import takes either --urdf (and --srdf, --tool-frame) or --problem")
    if template is not None and (srdf or tool_frame):
        raise OptionError("--problem has the robot; leave out --srdf and --tool-frame")
    if template is None and changes:
        raise OptionError("--set changes the file of --problem; give one")
    request_file = console.Request("problem", output, "-o PROBLEM.yaml", (".yaml", ".yml", ".json"))
    inputs = [name for name in (*messages, urdf, srdf, template) if name is not None]
    files = console.OutputFiles(request_file, inputs=inputs)
    with console.shown_progress() as enter:
        enter("reading messages and robot")
        scene, request = scene_and_request(messages)
        if template is None and tool_frame is None:
            tool_frame = tool_frame_of(request, srdf)
            if tool_frame is None:
                raise OptionError("--tool-frame is required: no request or SRDF names the link")
        cell = read_cell(urdf, tool_frame, None, template, changes, srdf)
        problem, notes = imported_problem(cell, scene, request, messages[0].stem)
    notes += [note for note in problem_doubts(problem) if note not in notes]
    content = partial(imported_contents, cell, notes)
    files.write({"problem": content})
    text = content(output or Path("problem.yaml")).decode()
    if as_json:
        report = console.empty_report("success", "the problem is complete; `route` plans it")
        path = files.path_text("problem")
        console.print_json({**report, "notes": notes, "problem": path, "text": text})
        return
    if output is None:
        console.say(text, end="")
        return
    console.say(*(f"note: {note}" for note in notes), sep="\n", end="\n" * bool(notes))
    files.say()
    console.say(f"to plan it: tubeplanner route {output}")
