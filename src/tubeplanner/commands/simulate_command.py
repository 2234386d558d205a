"""The command `simulate`: execute a trajectory with arms that differ from the model."""

from dataclasses import dataclass, replace
from itertools import count
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tubeplanner.commands.console import (
    AS_JSON,
    PATH,
    SET,
    empty_report,
    load_timed,
    print_json,
    require_ending,
    say,
    say_unwritten,
    shown_progress,
)
from tubeplanner.commands.view_command import require_page

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tubeplanner.problem.problem import PlanningProblem
    from tubeplanner.simulation.execution import Execution
    from tubeplanner.simulation.judged_runs import JudgedRun
    from tubeplanner.trajectory.joint_trajectory import JointTrajectory

_ERRORS = {
    "mass": "Relative error of masses.",
    "com": "Of centres of mass [m].",
    "payload": "Relative error of the payload.",
    "friction": "Relative error of modelled frictions.",
    "unmodelled_friction": "Viscous friction beside it, share of the effort limit at full speed.",
    "lag": "Of the motors [s].",
    "delay": "Of the control [s].",
    "noise": "Of measured positions [rad or m].",
    "tool": "Of the tool centre point [m].",
    "base": "Of the robot's base [m].",
    "control_period": "Of the control [s].",
}
_NAMES = {
    "tube": "beyond the tube [m]",
    "rotation": "beyond the rotation tolerance [rad]",
    "points": "beyond compulsory points [m]",
    "tracking": "a joint from the plan [rad or m]",
    "tool_tracking": "the tool from the plan [m]",
    "position": "beyond position limits [rad or m]",
    "velocity": "velocity, share of its limit",
    "obstacles": "distance from obstacles [m]",
    "self_collision": "distance between links [m]",
}


def _error_options(command: "Callable[..., Any]") -> "Callable[..., Any]":
    for name, text in reversed(_ERRORS.items()):
        command = click.option(f"--{name.replace('_', '-')}", type=float, help=text)(command)
    return command


@click.command()
@click.argument("problem")
@click.argument("trajectory", type=PATH)
@click.option("--runs", type=int, default=50, show_default=True, help="How many arms.")
@click.option("--seed", type=int, default=0, show_default=True, help="Which ones.")
@click.option("--controller", help="computed-torque (the default), feedforward-pd or pd.")
@_error_options
@click.option("--plot", type=PATH, help="Figure (PNG).")
@click.option("--html", type=PATH, help="The runs in 3D, one page that works offline.")
@SET
@AS_JSON
def simulate(
    problem: str,
    trajectory: Path,
    runs: int,
    seed: int,
    controller: str | None,
    plot: Path | None,
    html: Path | None,
    changes: dict[str, Any],
    as_json: bool,
    **errors: float | None,
) -> None:
    """Execute the TRAJECTORY file with arms that differ from PROBLEM's model, in MuJoCo.

    What is seen in some runs is not proved for others. An error that is not given is that of
    PROBLEM's robustness, or the usual one. Exit status 0 also if runs fail.
    """
    from tubeplanner.files.file_notes import notes_on_file
    from tubeplanner.problem.robustness import Robustness
    from tubeplanner.simulation.execution import executed
    from tubeplanner.simulation.judged_runs import judged_runs
    from tubeplanner.simulation.mujoco_model import require_mujoco
    from tubeplanner.simulation.plant import Draw, drawn_plants
    from tubeplanner.trajectory.trajectory_file import read_trajectory_file

    pictures = _Pictures(plot, html)
    pictures.require_usable(problem, trajectory)
    require_mujoco()
    given: dict[str, Any] = {**errors, "controller": controller}
    given = {name: value for name, value in given.items() if value is not None}
    _ = Robustness(**given)  # wrong ones are refused before anything is loaded
    draw = Draw(runs, seed)
    with shown_progress() as enter:
        loaded, loading_time = load_timed(problem, enter, changes)
        pictures.require_usable(problem, trajectory, loaded.robot.urdf.path)
        file = read_trajectory_file(trajectory, loaded.robot.joint_names)
        read, notes = file.trajectory, notes_on_file(loaded, file, failed=False)
        asked = replace(loaded.robustness or Robustness(), **given)
        enter(f"{runs} runs")
        plants = drawn_plants(loaded.robot, asked, draw)
        control = (asked.controller, asked.control_period)
        periods = ceil(read.duration / asked.control_period)
        moving = _counted(enter, f"{runs} runs, control period", periods)
        execution = executed(loaded, read, plants, *control, moving)
        judging = _counted(enter, "tolerances and clearance, run", runs)
        judged = judged_runs(loaded, read, execution, judging)
        if pictures.paths:
            enter("pictures")
            pictures.write(loaded, read, execution, judged)
    if as_json:
        more = {"duration": read.duration, "loading_time": loading_time, "notes": notes}
        print_json(_report(judged) | more | pictures.as_dict())
    else:
        said = [f"note: {note}" for note in notes]
        say(*_lines(judged), *said, *(f"{kind}: {path}" for kind, path in pictures.paths), sep="\n")
        if not pictures.paths:
            say_unwritten("--plot", "--html")


def _counted(enter: "Callable[[object], None]", stage: str, most: int) -> "Callable[[], None]":
    """Return what enters a stage with how often it was called, of so many times."""
    done = count(1)
    return lambda: enter(f"{stage} {min(next(done), most)} of {most}")


@dataclass(frozen=True)
class _Pictures:
    """The files that are asked for."""

    plot: Path | None
    html: Path | None

    @property
    def paths(self) -> list[tuple[str, Path]]:
        """Kinds and paths."""
        asked = {"plot": self.plot, "view": self.html}
        return [(kind, path) for kind, path in asked.items() if path is not None]

    def as_dict(self) -> dict[str, str | None]:
        """Return the fields as JSON values."""
        return {name: None if path is None else str(path) for name, path in vars(self).items()}

    def require_usable(self, *inputs: str | Path) -> None:
        """Raise if a file could not be written, before any work is done."""
        from tubeplanner.files.output_files import require_writable

        require_ending(self.plot, "--plot", (".png",))
        require_page(self.html)
        require_writable([path for _, path in self.paths], [Path(path) for path in inputs])

    def write(
        self,
        problem: "PlanningProblem",
        trajectory: "JointTrajectory",
        execution: "Execution",
        judged: "Sequence[JudgedRun]",
    ) -> None:
        """Write all files, or none of them."""
        from tubeplanner.files.output_files import write_files

        contents: dict[Path, bytes] = {}
        if self.plot is not None:
            from tubeplanner.views.execution_plot import plot_execution
            from tubeplanner.views.figure_files import figure_png

            contents[self.plot] = figure_png(plot_execution(problem, trajectory, execution, judged))
        if self.html is not None:
            from tubeplanner.views.viewer import view

            page = view(problem, trajectory, names=["plan"], execution=execution)
            contents[self.html] = page.html.encode()
        write_files(contents)


def _report(judged: "Sequence[JudgedRun]") -> dict[str, Any]:
    """Return the JSON object, times still absent."""
    from tubeplanner.simulation.run_summary import summaries
    from tubeplanner.simulation.run_verdict import run_verdict

    found, verdict = summaries(judged), run_verdict(judged)
    worst = found["tube"]
    assert worst is not None
    return {
        **empty_report("success", str(verdict), worst.worst.place.as_dict()),
        "verdict": verdict.as_dict(),
        "saturated": [run.saturated for run in judged],
        "excursions": [run.tube.value for run in judged],
        "seen": {name: None if one is None else one.as_dict() for name, one in found.items()},
    }


def _lines(judged: "Sequence[JudgedRun]") -> list[str]:
    from tubeplanner.simulation.run_summary import summaries
    from tubeplanner.simulation.run_verdict import run_verdict

    lines = [f"{'seen in ' + str(len(judged)) + ' runs':38}{'worst':>12}{'median':>12}  where"]
    for name, summary in summaries(judged).items():
        if summary is not None:
            worst = f"{summary.worst.value:12.4g}{summary.median:12.4g}"
            lines.append(f"{_NAMES[name]:38}{worst}  run {summary.run}, {summary.worst.place}")
    saturated = [100 * run.saturated for run in judged]
    share = f"{max(saturated):12.3g}{sorted(saturated)[len(saturated) // 2]:12.3g}"
    return [*lines, f"{'time with a motor at its limit [%]':38}{share}", f"{run_verdict(judged)}"]
