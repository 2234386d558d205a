"""`plan`: problem or cycle, output files.

Figures and pages are imported only on request: they load parts of SciPy that plans do not need.
"""

from collections.abc import Callable, Sequence
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
from tubeplanner.outcome import ProgressCallback
from tubeplanner.output.figures.figure_files import figure_file, require_figure
from tubeplanner.output.files.trajectory_writer import (
    TrajectoryFiles,
    cycle_contents,
    require_no_formula,
)
from tubeplanner.planning.cycle_result import CycleResult
from tubeplanner.planning.cycle_strategy import plan_cycle
from tubeplanner.planning.options import METHODS, PlanOptions
from tubeplanner.planning.result import PlanResult
from tubeplanner.planning.strategy import plan as plan_problem
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.cycle_motion import CycleMotion
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.writing import require_writable


@click.command()
@click.argument("problem")
@click.option("-o", "--output", type=console.PATH, help="Trajectory file (JSON).")
@click.option("--csv", type=console.PATH, help="Samples as CSV.")
@click.option("--ros", type=console.PATH, help="Samples as trajectory_msgs/JointTrajectory, YAML.")
@click.option("--rate", type=float, help="Samples per second [1/period, or else 500].")
@click.option("--plot", type=console.PATH, help="Figure (PNG, PDF or SVG).")
@click.option(
    "--html", type=console.PATH, help="The trajectory in 3D, one page that works offline."
)
@click.option(
    "--method", help="refinement [default], branch-and-bound, stop-at-corners or suh-bishop."
)
@click.option("--quality", default="balanced", show_default=True, help="fast, balanced or best.")
@click.option("--time-limit", type=float, help="End after so many seconds with the best so far.")
@console.SLACK
@click.option("--time-left", is_flag=True, help="Report the path's least time, bang-bang.")
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
    """Plan PROBLEM, or a whole cycle, certify the answer, and write the requested files.

    Writes nothing unless the certificate passes.
    """
    options = PlanOptions(method or METHODS[0], quality, time_limit=time_limit, slack=slack)
    outputs = PlanOutputs(TrajectoryFiles(output, csv, ros, rate), plot, html)
    outputs.require_usable(problem)
    interrupted = False
    with console.shown_progress() as enter:
        loaded, loading_time = console.load_either_timed(problem, enter, changes)
        outputs.require_usable(problem, loaded.robot.urdf.path)
        outputs.require_names(loaded.robot.joint_names)
        answer = planned(loaded, options, enter, with_minimum=time_left)
        succeeded = answer.result.succeeded
        if succeeded:
            held = hold_interrupts()
            answer = answer.written(outputs)
            interrupted = bool(held)
    if as_json:
        fields = {**answer.as_dict(), "loading_time": loading_time}
        console.print_json(fields | ({"stopped_by": "interrupt"} if interrupted else {}))
    else:
        console.say(answer.text(loading_time))
        for kind, path in outputs.paths() if succeeded else ():
            if console.unless_failed(path):
                console.say(f"{kind}: {path}")
        if succeeded and not outputs.paths():
            console.say_unwritten("-o T.json", "--csv", "--ros", "--plot", "--html")
    return console.SUCCESS if succeeded else console.INFEASIBLE


def planned(
    loaded: PlanningProblem | Cycle,
    options: PlanOptions,
    enter: ProgressCallback,
    *,
    with_minimum: bool,
) -> "PlannedProblem | PlannedCycle":
    """Plan a problem or a cycle.

    Args:
        loaded: The problem or cycle.
        options: Options of the plan.
        enter: Progress callback, as of `plan`.
        with_minimum: True to report the least time for the path, of a problem.

    Raises:
        OptionError: `with_minimum` for a cycle.
    """
    if not isinstance(loaded, Cycle):
        return PlannedProblem(loaded, plan_problem(loaded, options, enter), with_minimum)
    if with_minimum:
        raise OptionError(
            "--time-left is about the path of one motion, and a cycle has several; leave it out, "
            "or plan a move as a problem of its own"
        )
    return PlannedCycle(loaded, plan_cycle(loaded, options, enter))


@dataclass(frozen=True, eq=False)
class PlannedProblem:
    """A problem and the result of planning it.

    Attributes:
        problem: The problem.
        result: Its result.
        with_minimum: True to report the least time for the path.
    """

    problem: PlanningProblem
    result: PlanResult
    with_minimum: bool

    def written(self, outputs: "PlanOutputs") -> "PlannedProblem":
        """Write the answer to files; return the answer with notes on the files."""
        assert self.result.trajectory is not None
        notes = outputs.write(self.problem, self.result.method, self.result.trajectory)
        return replace(self, result=replace(self.result, notes=(*self.result.notes, *notes)))

    def as_dict(self) -> dict[str, Any]:
        """Return the JSON object, loading_time still absent."""
        minimum = self.result.path_minimum if self.with_minimum else None
        return {**self.result.as_dict(), "path_minimum": minimum}

    def text(self, loading_time: float) -> str:
        """Return the printed text, with the loading time [s]."""
        return plan_text(self.problem, self.result, loading_time, with_minimum=self.with_minimum)


@dataclass(frozen=True, eq=False)
class PlannedCycle:
    """A cycle and the result of planning it.

    Attributes:
        cycle: The cycle.
        result: Its result.
    """

    cycle: Cycle
    result: CycleResult

    def written(self, outputs: "PlanOutputs") -> "PlannedCycle":
        """Write the answer to files; return the answer with notes on the files."""
        assert self.result.motion is not None
        notes = outputs.write_cycle(self.result.method, self.result.motion)
        return replace(self, result=replace(self.result, notes=(*self.result.notes, *notes)))

    def as_dict(self) -> dict[str, Any]:
        """Return the JSON object, loading_time still absent."""
        motion = self.result.motion
        peaks = None if motion is None else trajectory_peaks(self.cycle.robot, motion.trajectory)
        return {**self.result.as_dict(), **peaks_as_dict(peaks), "path_minimum": None}

    def text(self, loading_time: float) -> str:
        """Return the printed text, with the loading time [s]."""
        return cycle_plan_text(self.cycle, self.result, loading_time)


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
        paths = {
            "trajectory": self.files.json,
            "CSV": self.files.csv,
            "ROS": self.files.ros,
            "plot": self.plot,
            "view": self.html,
        }
        return [(kind, path) for kind, path in paths.items() if path is not None]

    def require_usable(self, *inputs: str | Path) -> None:
        """Raise if a file cannot be written, before any work is done."""
        require_figure(self.plot, "--plot")
        console.require_page(self.html)
        require_writable([path for _, path in self.paths()], [Path(path) for path in inputs])

    def require_names(self, joint_names: Sequence[str]) -> None:
        """Raise if a file cannot hold the names of the joints, before any work is done."""
        if self.files.csv is not None:
            require_no_formula(joint_names)

    def write(
        self, problem: PlanningProblem, method: str, trajectory: JointTrajectory
    ) -> tuple[str, ...]:
        """Write the files of a trajectory; return notes on the files."""

        def figure(path: Path) -> bytes:
            from tubeplanner.output.figures.trajectory_figures import plot_trajectory

            return figure_file(plot_trajectory(problem, trajectory), path)

        def page(_: Path) -> bytes:
            from tubeplanner.output.page.viewer import view as view_scene

            return view_scene(problem, trajectory, names=[method]).html.encode()

        return self._write(lambda files: files.contents(trajectory, problem, method), figure, page)

    def write_cycle(self, method: str, motion: CycleMotion) -> tuple[str, ...]:
        """Write the files of a cycle's motion; return notes on the files."""

        def figure(path: Path) -> bytes:
            from tubeplanner.output.figures.trajectory_figures import plot_cycle

            return figure_file(plot_cycle(motion.cycle, motion), path)

        def page(_: Path) -> bytes:
            from tubeplanner.output.page.cycle_page import view_cycle

            return view_cycle(motion.cycle, [motion], [method]).html.encode()

        return self._write(lambda files: cycle_contents(files, motion, method), figure, page)

    def _write(
        self,
        contents: Callable[[TrajectoryFiles], tuple[dict[Path, bytes], tuple[str, ...]]],
        figure: Callable[[Path], bytes],
        page: Callable[[Path], bytes],
    ) -> tuple[str, ...]:
        """Write the trajectory, its samples, the figure, the page; return notes on the samples."""
        notes: list[str] = []

        @cache
        def samples() -> dict[Path, bytes]:
            texts, more = contents(replace(self.files, json=None))
            notes.extend(more)
            return texts

        own = replace(self.files, csv=None, ros=None)
        console.write_answer(
            console.Output("trajectory", self.files.json, lambda path: contents(own)[0][path]),
            console.Output("CSV", self.files.csv, lambda path: samples()[path]),
            console.Output("ROS", self.files.ros, lambda path: samples()[path]),
            console.Output("plot", self.plot, figure),
            console.Output("view", self.html, page),
        )
        return tuple(notes)
