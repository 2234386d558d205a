"""The command that shows a problem or a cycle and its trajectories in 3D."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tubeplanner.commands.answer_files import write_answer
from tubeplanner.commands.console import (
    AS_JSON,
    INPUT,
    PATH,
    SET,
    empty_report,
    load_either_timed,
    nowhere,
    print_json,
    say,
    shown_progress,
)
from tubeplanner.commands.interrupts import hold_interrupts
from tubeplanner.errors import OptionError

if TYPE_CHECKING:
    from tubeplanner.cycle.cycle import Cycle
    from tubeplanner.problem.problem import PlanningProblem
    from tubeplanner.views.viewer import View


@click.command()
@click.argument("problem")
@click.argument("trajectories", type=INPUT, nargs=-1, metavar="[TRAJECTORY]...")
@click.option("--html", type=PATH, help="Write one page that works offline; open nothing.")
@SET
@AS_JSON
def view(
    problem: str,
    trajectories: tuple[Path, ...],
    html: Path | None,
    changes: dict[str, Any],
    as_json: bool,
) -> None:
    """Show PROBLEM, or a cycle, and TRAJECTORY files, side by side, in 3D.

    Notes say whether each motion passes under PROBLEM, and what differs if it was made for another.
    Of a cycle all moves are on one time line, with what happens between them.
    """
    from tubeplanner.cycle.cycle import Cycle
    from tubeplanner.files.output_files import require_writable

    require_page(html)
    if html is not None:
        require_writable([html], [Path(problem), *trajectories])
    with shown_progress() as enter:
        loaded, _ = load_either_timed(problem, enter, changes)
        if isinstance(loaded, Cycle):
            shown = _shown_cycle(loaded, trajectories, enter)
        else:
            shown = _shown(loaded, trajectories, enter)
        page = shown.html.encode()
        enter("writing")
        if html is None:
            hold_interrupts()
            path, opened = shown.open()
        else:
            write_answer({html: page})
            path, opened = html, True
    message = f"view: {path}"
    if not opened:
        message += " (no browser could be opened; open this file in one)"
    if as_json:
        print_json(
            {
                **empty_report("success", message, nowhere()),
                "html": str(path),
                "notes": shown.scene.notes,
            }
        )
        return
    say(*(f"note: {note}" for note in shown.scene.notes), message, sep="\n")


def _shown(
    problem: "PlanningProblem", paths: tuple[Path, ...], enter: Callable[[object], None]
) -> "View":
    """Return the view of a problem and the motions of files, each judged."""
    from tubeplanner.files.motion_notes import has_other_part, motion_notes
    from tubeplanner.trajectory.trajectory_file import read_trajectory_file
    from tubeplanner.views.viewer import names_of_files, view

    files = [read_trajectory_file(path, problem.robot.joint_names) for path in paths]
    named, notes = dict(zip(names_of_files(paths), files, strict=True)), []
    for k, (name, file) in enumerate(named.items()):
        enter(f"certificate {k + 1} of {len(files)}")
        notes += motion_notes(problem, name, file)
    enter("scene")
    other = [name for name, file in named.items() if has_other_part(problem, file)]
    motions = (file.trajectory for file in files)
    return view(problem, *motions, names=list(named), notes=notes, empty_handed=other)


def _shown_cycle(
    cycle: "Cycle", paths: tuple[Path, ...], enter: Callable[[object], None]
) -> "View":
    """Return the view of a cycle and its motions of files, each judged."""
    from tubeplanner.cycle.motion_of_file import motion_of_file
    from tubeplanner.files.cycle_motion_notes import cycle_motion_notes
    from tubeplanner.trajectory.trajectory_file import read_trajectory_file
    from tubeplanner.views.cycle_view import view_cycle
    from tubeplanner.views.viewer import names_of_files

    files = [read_trajectory_file(path, cycle.robot.joint_names) for path in paths]
    motions = [motion_of_file(cycle, *pair) for pair in zip(paths, files, strict=True)]
    names, notes = names_of_files(paths), []
    for k, each in enumerate(zip(motions, names, files, strict=True)):
        enter(f"certificate {k + 1} of {len(files)}")
        notes += cycle_motion_notes(*each)
    enter("scene")
    return view_cycle(cycle, motions, names, notes)


def require_page(path: Path | None) -> None:
    """Check that the name of a page ends like one.

    Raises:
        OptionError: It is not.
    """
    if path is not None and path.suffix.lower() not in (".html", ".htm"):
        raise OptionError(f"--html {path}: a page is written; name a file that ends in .html")
