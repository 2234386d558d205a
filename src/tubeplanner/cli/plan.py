"""`plan`: problem or cycle, output files.

Figures and pages are imported only on request: they load parts of SciPy that plans do not need.
"""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import click

from tubeplanner.cli import console
from tubeplanner.cli.interrupts import hold_interrupts
from tubeplanner.cli.report import cycle_plan_text, plan_text
from tubeplanner.errors import OptionError
from tubeplanner.limits.peaks import peaks_as_dict, trajectory_peaks
from tubeplanner.output.figures.figure_files import figure_file, require_figure
from tubeplanner.output.files.trajectory_writer import (
    TrajectoryFiles,
    cycle_contents,
    require_no_formula,
)
from tubeplanner.planning.options import METHODS, PlanOptions
from tubeplanner.planning.strategy import plan as plan_problem
from tubeplanner.planning.strategy import plan_cycle
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.writing import require_writable


@click.command()
@click.argument("problem")
@click.option("-o", "--output", type=console.PATH, help="Trajectory file (JSON).")
@click.option("--csv", type=console.PATH, help="Write samples (CSV).")
@click.option("--ros", type=console.PATH, help="Write samples (trajectory_msgs/JointTrajectory).")
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
    output: Path | None,
    csv: Path | None,
    ros: Path | None,
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
) -> int:
    """Plan PROBLEM, or a cycle, certify the trajectory, and write the requested files.

    No file is written unless the certificate passes.
    """
    options = PlanOptions(method or METHODS[0], quality, time_limit=time_limit, slack=slack)
    outputs = PlanOutputs(TrajectoryFiles(output, csv, ros, rate), plot, html)
    outputs.require_usable(problem)
    interrupted = False
    with console.shown_progress() as enter:
        loaded, loading_time = console.load_either_timed(problem, enter, changes)
        outputs.require_usable(problem, loaded.robot.urdf.path)
        if csv is not None:
            require_no_formula(loaded.robot.joint_names)
        if isinstance(loaded, Cycle) and time_left:
            raise OptionError(
                "--time-left is about the path of one motion, and a cycle has several; leave it "
                "out, or plan a move as a problem of its own"
            )
        plan_either: Any = plan_cycle if isinstance(loaded, Cycle) else plan_problem
        result = plan_either(loaded, options, enter)
        if result.succeeded:
            held = hold_interrupts()
            result = outputs.written(loaded, result)
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
        if isinstance(loaded, Cycle):
            text = cycle_plan_text(loaded, result, loading_time)
        else:
            text = plan_text(loaded, result, loading_time, with_minimum=time_left)
        console.say(text)
        for kind, path in outputs.paths() if result.succeeded else ():
            if console.unless_failed(path):
                console.say(f"{kind}: {path}")
        if result.succeeded and not outputs.paths():
            console.say_unwritten("-o T.json", "--csv", "--ros", "--plot", "--html")
    return console.SUCCESS if result.succeeded else console.INFEASIBLE


@dataclass(frozen=True)
class PlanOutputs:
    """The output files of a plan.

    Attributes:
        files: With the trajectory.
        plot: With a figure (PNG, PDF or SVG); None: none.
        html: With a page; None: none.
    """

    files: TrajectoryFiles
    plot: Path | None
    html: Path | None

    def paths(self) -> list[tuple[str, Path]]:
        """Return the requested files: kind and path."""
        files = self.files
        kinds = ("trajectory", "CSV", "ROS", "plot", "view")
        paths = zip(kinds, (files.json, files.csv, files.ros, self.plot, self.html), strict=True)
        return [(kind, path) for kind, path in paths if path is not None]

    def require_usable(self, *inputs: str | Path) -> None:
        """Raise if a file cannot be written, before any work is done."""
        require_figure(self.plot, "--plot")
        console.require_ending(self.html, "--html", console.PAGE_ENDINGS)
        require_writable([path for _, path in self.paths()], [Path(path) for path in inputs])

    def written(self, loaded: PlanningProblem | Cycle, result: Any) -> Any:
        """Write the files of an answer; return the answer with notes on the samples."""
        notes: list[str] = []

        def contents(files: TrajectoryFiles) -> tuple[dict[Path, bytes], tuple[str, ...]]:
            if isinstance(loaded, Cycle):
                return cycle_contents(files, result.motion, result.method)
            return files.contents(result.trajectory, loaded, result.method)

        @cache
        def samples() -> dict[Path, bytes]:
            texts, more = contents(replace(self.files, json=None))
            notes.extend(more)
            return texts

        def figure(path: Path) -> bytes:
            from tubeplanner.output.figures.trajectory_figures import plot_cycle, plot_trajectory

            if isinstance(loaded, Cycle):
                return figure_file(plot_cycle(loaded, result.motion), path)
            return figure_file(plot_trajectory(loaded, result.trajectory), path)

        def page(_: Path) -> bytes:
            from tubeplanner.output.page.cycle_page import view_cycle
            from tubeplanner.output.page.viewer import view

            judged = {"certificates": [result.certificate], "sensitivities": result.sensitivities}
            name = ["planned motion"]
            if isinstance(loaded, Cycle):
                return view_cycle(loaded, [result.motion], name, **judged).html.encode()
            return view(loaded, result.trajectory, names=name, **judged).html.encode()

        own = replace(self.files, csv=None, ros=None)
        console.write_answer(
            console.Output("trajectory", self.files.json, lambda path: contents(own)[0][path]),
            console.Output("CSV", self.files.csv, lambda path: samples()[path]),
            console.Output("ROS", self.files.ros, lambda path: samples()[path]),
            console.Output("plot", self.plot, figure),
            console.Output("view", self.html, page),
        )
        return replace(result, notes=(*result.notes, *notes))
