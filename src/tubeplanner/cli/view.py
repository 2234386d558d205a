"""`view`, `plot`: page or figure of a motion."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from tubeplanner.certificate.verification import Certificate, CycleCertificate
from tubeplanner.cli import console
from tubeplanner.cli.interrupts import hold_interrupts
from tubeplanner.output.figures.figure_files import FIGURE_ENDINGS, figure_file
from tubeplanner.output.figures.trajectory_figures import plot_motion
from tubeplanner.output.files.file_notes import has_other_part, motion_notes, notes_on_file
from tubeplanner.output.page.viewer import View, names_of_files, view_motions
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.motion import Motion, Task, motion_of_file
from tubeplanner.trajectory.reader import read_trajectory_file
from tubeplanner.writing import write_files


@click.command()
@click.argument("problem")
@click.argument("trajectories", type=console.INPUT, nargs=-1, metavar="[TRAJECTORY]...")
@click.option("--html", type=console.PATH, help="Write a page (HTML, offline); open nothing.")
@console.SET
@console.AS_JSON
def view(
    problem: str,
    trajectories: tuple[Path, ...],
    html: Path | None,
    changes: dict[str, Any],
    as_json: bool,
) -> None:
    """Show PROBLEM or a cycle in 3D, with TRAJECTORY files side by side.

    Notes tell whether each motion passes the conditions of PROBLEM, and list the differences if the
    motion was made for another problem. PROBLEM needs no tube: the arm is shown at its start, in
    its cell. All moves of a cycle are on one time line, with the events between moves.
    """
    request = console.Request("view", html, "--html", console.PAGE_ENDINGS)
    console.OutputFiles(request, inputs=[problem, *trajectories])
    with console.shown_progress() as enter:
        loaded, _ = console.load_task_timed(problem, enter, changes, reads_tube=None)
        motion_view, verdicts = _shown(loaded, trajectories, enter)
        page = motion_view.html.encode()
        enter("writing")
        if html is None:
            hold_interrupts()
            path, opened = motion_view.open()
        else:
            hold_interrupts()
            write_files({html: page})
            path, opened = html, True
    message, notes = f"view: {path}", [*verdicts, *motion_view.scene.notes]
    if not opened:
        message += " (no browser could be opened; open this file in one)"
    if as_json:
        report = console.empty_report("success", message)
        console.print_json({**report, "html": str(path), "notes": notes})
        return
    console.say(*(f"note: {note}" for note in notes), message, sep="\n")


def _shown(
    loaded: Task, paths: tuple[Path, ...], enter: Callable[[object], None]
) -> tuple[View, list[str]]:
    """Return the view of a problem or cycle and the motions of files, and the verdicts on these."""
    files = [read_trajectory_file(path, loaded.robot.joint_names) for path in paths]
    names, notes, verdicts = names_of_files(paths), list[str](), list[str]()
    motions, judged = dict[str, Motion](), list[Certificate | CycleCertificate]()
    if not isinstance(loaded, Cycle) and loaded.tube.is_anywhere:
        notes = ["there is no tube: the tool may be anywhere"]
        if loaded.tube.route is None:
            notes[0] += "; `tubeplanner route` finds a motion from start, goal and obstacles"
    for k, (path, name, file) in enumerate(zip(paths, names, files, strict=True)):
        enter(f"certificate {k + 1} of {len(files)}")
        motions[name], certificate, messages = motion_notes(loaded, path, name, file)
        verdict, *others = messages
        judged.append(certificate)
        verdicts.append(verdict)
        notes += others
    enter("scene")
    pairs = zip(names, files, strict=True)
    empty_handed = [name for name, file in pairs if has_other_part(loaded, file)]
    about: dict[str, Any] = {"notes": notes, "empty_handed": empty_handed}
    return view_motions(loaded, motions, certificates=judged, **about), verdicts


@click.command()
@click.argument("problem")
@click.argument("trajectory", type=console.INPUT)
@click.option(
    "-o",
    "--output",
    type=console.PATH,
    help="Draw the figure (PNG, PDF or SVG) [default: beside TRAJECTORY].",
)
@console.SET
@console.AS_JSON
def plot(
    problem: str, trajectory: Path, output: Path | None, changes: dict[str, Any], as_json: bool
) -> int:
    """Draw the TRAJECTORY file against the limits and the tube of PROBLEM or of a cycle.

    Without -o the figure is written next to TRAJECTORY, with the same name and the ending .png.
    """
    target = output or trajectory.with_suffix(".png")
    request = console.Request("plot", target, "-o", FIGURE_ENDINGS)
    files = console.OutputFiles(request, inputs=[trajectory, problem])
    with console.shown_progress() as enter:
        loaded, loading_time = console.load_task_timed(problem, enter, changes)
        files.spare([loaded.robot.urdf.path])
        read = read_trajectory_file(trajectory, loaded.robot.joint_names)
        enter("drawing")
        figure = plot_motion(motion_of_file(loaded, trajectory, read))
        notes = notes_on_file(loaded, read)
        picture = figure_file(figure, target)
        enter("writing")
        hold_interrupts()
        write_files({target: picture})
    duration = read.trajectory.duration
    if as_json:
        report = console.empty_report("success", "drawn, not judged")
        more = {"duration": duration, "loading_time": loading_time, "notes": notes}
        console.print_json({**report, **more, "plot": str(target)})
    else:
        console.say(*(f"note: {note}" for note in notes), sep="\n", end="\n" if notes else "")
        console.say(f"plot: {target} ({duration:.4f} s)")
    return console.SUCCESS
