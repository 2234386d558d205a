"""`import`: problem files of MoveIt's messages, and of beads in G-code, DXF drawings, CSV files."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import click

from tubeplanner.cli import console
from tubeplanner.errors import OptionError
from tubeplanner.output.files.new_problem_files import (
    Cell,
    bead_problem,
    imported_contents,
    imported_problem,
    read_cell,
    scene_and_request,
    tool_frame_of,
)
from tubeplanner.task.beads import DRAWING_ENDINGS, BeadOptions, frame_of, read_drawing
from tubeplanner.task.info import problem_doubts
from tubeplanner.task.problem import PlanningProblem

_OF_DRAWINGS = {
    "speed": "Speed along beads, in place of the feeds of G-code [m/s].",
    "tolerance": "Fraction of the speed by which the tool may be slower [default: 0.05]; 0: any.",
    "radius": "Radius of the tube along beads, unless a file of points has it [m, default: 0.001].",
    "free-radius": "Largest radius of ways between beads [m, default: 0.01].",
    "lift": "Length of approach and retract, height between beads [m, default: 0.02].",
    "tilt": "How far the tool may lean about its x and y axes [rad, default: 0.1].",
    "run-in": "Length of the way before and after each bead at its speed [m, default: 0].",
}


def _bead_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Return a command with the options of drawings."""
    layers = click.option(
        "--layer", "layers", multiple=True, help="Layer of a DXF drawing; repeatable."
    )
    command = layers(command)
    for name, text in reversed(_OF_DRAWINGS.items()):
        command = click.option(f"--{name}", type=float, help=text)(command)
    return click.option(
        "--frame",
        metavar="X,Y,Z[,...]",
        help="Place of the drawing in the base frame [m]; with roll, pitch, yaw [rad] or a "
        "quaternion x, y, z, w after it.",
    )(command)


@click.command("import")
@click.argument("sources", metavar="FILE...", type=console.INPUT, nargs=-1, required=True)
@click.option("--urdf", help="Robot description: a path, package://PKG/... or example:NAME.")
@click.option("--srdf", help="SRDF of the robot: its pairs that may touch, its groups.")
@click.option(
    "--tool-frame", help="Link of the tool [default: that of the request's goal or group]."
)
@click.option("--problem", "template", help="Problem file with the robot and its limits.")
@click.option("-o", "--output", type=console.PATH, help="Write the problem file.")
@_bead_options
@console.SET
@console.AS_JSON
def import_(
    sources: tuple[Path, ...],
    urdf: str | None,
    srdf: str | None,
    tool_frame: str | None,
    template: str | None,
    output: Path | None,
    frame: str | None,
    layers: tuple[str, ...],
    changes: dict[str, Any],
    as_json: bool,
    **bead_options: float | None,
) -> None:
    """Print or write the problem file of a drawing of beads, or of MoveIt's messages.

    FILE is G-code (.gcode, .nc, .ngc), a DXF drawing (.dxf) or a file of points (.csv): lines and
    arcs become a tube, with approach, ways between beads and retract; the tool points into the
    drawing and may turn about its axis. `plan` plans it.

    Or FILE is MoveIt's planning scene, a motion plan request, or both, as YAML. Solids, attached
    solids and allowed collisions are the scene's; start, goal and scaling factors are the
    request's, or the start is the scene's state. The tube is open: `route` finds one.

    Notes name what was not read.
    """
    if (template is None) == (urdf is None):
        raise OptionError("import takes either --urdf (and --srdf, --tool-frame) or --problem")
    if template is not None and (srdf or tool_frame):
        raise OptionError("--problem has the robot; leave out --srdf and --tool-frame")
    if template is None and changes:
        raise OptionError("--set changes the file of --problem; give one")
    values: dict[str, Any] = {k: value for k, value in bead_options.items() if value is not None}
    if frame is not None:
        values["frame"] = frame_of(frame)
    drawings = [each for each in sources if each.suffix.lower() in DRAWING_ENDINGS]
    if drawings and len(sources) > 1:
        raise OptionError(f"{drawings[0]} is a drawing; give it alone")
    own = [*values, *["layer"] * len(layers)]
    if own and not drawings:
        name = own[0].replace("_", "-")
        raise OptionError(f"--{name} is for drawings: a file {', '.join(DRAWING_ENDINGS)}")
    if layers and drawings[0].suffix.lower() != ".dxf":
        raise OptionError(f"--layer is for DXF drawings; {drawings[0]} is none")
    request_file = console.Request("problem", output, "-o PROBLEM.yaml", (".yaml", ".yml", ".json"))
    inputs = [name for name in (*sources, urdf, srdf, template) if name is not None]
    files = console.OutputFiles(request_file, inputs=inputs)
    with console.shown_progress() as enter:
        enter("reading files and robot")
        if drawings:
            if template is None and tool_frame is None:
                raise OptionError("--tool-frame is required: a drawing has none")
            options = BeadOptions(**values)
            drawing = read_drawing(drawings[0], options, layers)
            cell = read_cell(urdf, tool_frame, None, template, changes, srdf)
            problem, notes = bead_problem(cell, drawing, options, drawings[0].stem)
        else:
            cell, problem, notes = _of_messages(sources, urdf, srdf, tool_frame, template, changes)
    notes += [note for note in problem_doubts(problem) if note not in notes]
    content = partial(imported_contents, cell, notes)
    files.write({"problem": content})
    text = content(output or Path("problem.yaml")).decode()
    verb = "plan" if drawings else "route"
    if as_json:
        report = console.empty_report("success", f"the problem is complete; `{verb}` plans it")
        path = files.path_text("problem")
        console.print_json({**report, "notes": notes, "problem": path, "text": text})
        return
    if output is None:
        console.say(text, end="")
        return
    console.say(*(f"note: {note}" for note in notes), sep="\n", end="\n" * bool(notes))
    files.say()
    console.say(f"to plan it: tubeplanner {verb} {output}")


def _of_messages(
    sources: tuple[Path, ...],
    urdf: str | None,
    srdf: str | None,
    tool_frame: str | None,
    template: str | None,
    changes: dict[str, Any],
) -> tuple[Cell, PlanningProblem, list[str]]:
    """Return the completed cell of MoveIt's messages, its problem, and notes."""
    scene, request = scene_and_request(sources)
    if template is None and tool_frame is None:
        tool_frame = tool_frame_of(request, srdf)
        if tool_frame is None:
            raise OptionError("--tool-frame is required: no request or SRDF names the link")
    cell = read_cell(urdf, tool_frame, None, template, changes, srdf)
    return cell, *imported_problem(cell, scene, request, sources[0].stem)
