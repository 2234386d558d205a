"""`plan`: problem or cycle, output files.

Figures and pages are imported only on request: they load parts of SciPy that plans do not need.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import click

from tubeplanner.cli import console
from tubeplanner.cli.interrupts import hold_interrupts
from tubeplanner.cli.report import plan_text
from tubeplanner.limits.peaks import peaks_as_dict, trajectory_peaks
from tubeplanner.output.figures.figure_files import FIGURE_ENDINGS, figure_file
from tubeplanner.output.files.trajectory_writer import FORMATS, ExportedMotion, require_rate
from tubeplanner.planning.options import METHODS, PlanOptions
from tubeplanner.planning.strategy import plan as plan_problem
from tubeplanner.planning.strategy import plan_cycle
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.motion import Motion, ProblemMotion, Task


def _format_options(command: Callable[..., Any]) -> Callable[..., Any]:
    for each in reversed(FORMATS):
        command = click.option(*each.options, type=console.PATH, help=each.help)(command)
    return command


@click.command()
@click.argument("problem")
@_format_options
@click.option("--rate", type=float, help="Sampling rate [Hz] [default: 1/period, or 500].")
@click.option("--plot", type=console.PATH, help="Draw the figure (PNG, PDF or SVG).")
@click.option(
    "--html", type=console.PATH, help="Write a page (HTML, offline) with the trajectory in 3D."
)
@click.option(
    "--method", help="refinement (default), branch-and-bound, stop-at-corners, suh-bishop."
)
@click.option("--quality", default="balanced", show_default=True, help="fast, balanced or best.")
@click.option("--time-limit", type=float, help="Stop after this time [s], with the best so far.")
@console.SLACK
@click.option("--time-left", is_flag=True, help="Report the least duration of the path [s].")
@console.SET
@console.AS_JSON
def plan(
    problem: str,
    rate: float | None,
    plot: Path | None,
    html: Path | None,
    method: str | None,
    quality: str,
    time_limit: float | None,
    slack: float | None,
    time_left: bool,
    changes: dict[str, Any],
    as_json: bool,
    **paths: Path | None,
) -> int:
    """Plan PROBLEM, or a cycle, certify the trajectory, and write the requested files.

    No file is written unless the certificate passes.
    """
    options = PlanOptions(method or METHODS[0], quality, time_limit=time_limit, slack=slack)
    require_rate(rate)
    formats = [each for each in FORMATS if paths[each.parameter] is not None]
    files = console.OutputFiles(
        *(console.Request(each.kind, paths[each.parameter], each.example) for each in FORMATS),
        console.Request("plot", plot, "--plot", FIGURE_ENDINGS),
        console.Request("view", html, "--html", console.PAGE_ENDINGS),
        inputs=[problem],
    )
    interrupted = False
    with console.shown_progress() as enter:
        loaded, loading_time = console.load_task_timed(problem, enter, changes)
        files.spare([loaded.robot.urdf.path])
        for each in formats:
            each.require_names(loaded.robot.joint_names)
        plan_task: Any = plan_cycle if isinstance(loaded, Cycle) else plan_problem
        result = plan_task(loaded, options, enter)
        if result.succeeded:
            held = hold_interrupts()
            result = _written(files, loaded, result, rate)
            interrupted = bool(held)
    if as_json:
        fields = result.as_dict()
        if isinstance(loaded, Cycle):
            motion = result.motion
            peaks = motion and trajectory_peaks(loaded.robot, motion.trajectory)
            fields |= peaks_as_dict(peaks)
        fields["path_minimum"] = result.path_minimum if time_left else None
        stopped = {"stopped_by": "interrupt"} if interrupted else {}
        console.print_json({**fields, "loading_time": loading_time, **stopped})
    else:
        console.say(plan_text(loaded, result, loading_time, with_minimum=time_left))
        if result.succeeded:
            files.say()
    return console.SUCCESS if result.succeeded else console.INFEASIBLE


def _written(files: console.OutputFiles, loaded: Task, result: Any, rate: float | None) -> Any:
    """Write the files of an answer; return the answer with notes on the samples."""
    motion: Motion = (
        result.motion if isinstance(loaded, Cycle) else ProblemMotion(loaded, result.trajectory)
    )
    exported = ExportedMotion(motion, result.method, rate)

    def figure(path: Path) -> bytes:
        from tubeplanner.output.figures.trajectory_figures import plot_motion

        return figure_file(plot_motion(motion), path)

    def page(_: Path) -> bytes:
        from tubeplanner.output.page.viewer import view_motions

        judged = {"certificates": [result.certificate], "sensitivities": result.sensitivities}
        return view_motions(loaded, {"planned motion": motion}, **judged).html.encode()

    texts = {each.kind: partial(each.content, exported) for each in FORMATS}
    files.write({**texts, "plot": figure, "view": page})
    return replace(result, notes=(*result.notes, *exported.notes))
