"""`simulate`: runs by plants, report."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import count
from math import ceil
from pathlib import Path
from typing import Any

import click

from tubeplanner.cli import console
from tubeplanner.execution.mujoco_model import require_mujoco
from tubeplanner.execution.plants import Draw, drawn_plants
from tubeplanner.execution.run_verdict import (
    JudgedCycle,
    JudgedRun,
    judged_cycle,
    judged_runs,
    run_verdict,
    summaries,
)
from tubeplanner.execution.simulation import executed, executed_cycle
from tubeplanner.output.figures.execution_figures import plot_cycle_execution, plot_execution
from tubeplanner.output.figures.figure_files import FIGURE_ENDINGS, figure_file
from tubeplanner.output.files.file_notes import notes_on_cycle_file, notes_on_file
from tubeplanner.output.page.cycle_page import view_cycle
from tubeplanner.output.page.viewer import View, view
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.demands import Robustness
from tubeplanner.task.motion import motion_of_file
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.reader import TrajectoryFile, read_trajectory_file

_ERRORS = {
    "mass": "Relative error of masses.",
    "com": "Error of centres of mass [m].",
    "payload": "Relative error of the payload.",
    "friction": "Relative error of modelled frictions.",
    "unmodelled_friction": "More viscous friction, fraction of the effort limit at full speed.",
    "lag": "Time constant of the motors [s].",
    "delay": "Delay from measurement to effort [s].",
    "noise": "Noise of measured positions [rad or m].",
    "tool": "Error of the tool centre point [m].",
    "base": "Error of the base position [m].",
    "control_period": "Period of the controller [s].",
    "bandwidth": "Least bandwidth of the feedback [rad/s].",
    "velocity_tolerance": "Fraction beyond a velocity limit at which the controller stops.",
    "path_tolerance": "Distance of a joint from the plan at which the controller stops [rad].",
    "tool_tolerance": "Distance of the tool from the plan at which the controller stops [m].",
}
_PLANNED = (
    "parts rest, and lie in the hand, where the planned motion has them; the error of the tool at "
    "each handover is listed"
)


_NAMES = {
    "tube": "beyond the tube [m]",
    "rotation": "beyond the rotation tolerance [rad]",
    "points": "beyond compulsory points [m]",
    "tracking": "a joint from the plan [rad or m]",
    "tool_tracking": "the tool from the plan [m]",
    "position": "beyond position limits [rad or m]",
    "velocity": "velocity, fraction of its limit",
    "obstacles": "distance from obstacles [m]",
    "self_collision": "distance between links [m]",
}
# Columns of the moves of a cycle, and their quantities.
_QUANTITIES = {
    "beyond tube [m]": "tube",
    "obstacles [m]": "obstacles",
    "tool off [m]": "tool_tracking",
}
_LIMIT = "at limit [%]"
_HANDOVERS = ("off, worst [m]", "median [m]", "rotation error [rad]", "speed [m/s]")


def _error_options(command: Callable[..., Any]) -> Callable[..., Any]:
    for name, text in reversed(_ERRORS.items()):
        command = click.option(f"--{name.replace('_', '-')}", type=float, help=text)(command)
    return command


@click.command()
@click.argument("problem")
@click.argument("trajectory", type=console.INPUT)
@click.option("--runs", type=int, default=50, show_default=True, help="Number of simulated arms.")
@click.option("--seed", type=int, default=0, show_default=True, help="Seed of the random errors.")
@click.option("--controller", help="computed-torque (default), feedforward-pd or pd.")
@_error_options
@click.option("--plot", type=console.PATH, help="Draw the figure (PNG, PDF or SVG).")
@click.option("--html", type=console.PATH, help="Write a page (HTML, offline) with the runs in 3D.")
@console.SET
@console.AS_JSON
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
    """Simulate the TRAJECTORY file in MuJoCo on arms that differ from PROBLEM's model.

    PROBLEM may be a cycle: all of its moves are simulated. A result of some runs is no proof for
    others. Errors without an option are those of PROBLEM's robustness, else the defaults. Exit
    status 0 also if runs fail.
    """
    files = console.OutputFiles(
        console.Request("plot", plot, "--plot", FIGURE_ENDINGS),
        console.Request("view", html, "--html", console.PAGE_ENDINGS),
        inputs=[problem, trajectory],
    )
    require_mujoco()
    options: dict[str, Any] = {**errors, "controller": controller}
    options = {name: value for name, value in options.items() if value is not None}
    robustness = Robustness(**options)  # wrong options are refused before anything is loaded
    draw = Draw(runs, seed)
    with console.shown_progress() as enter:
        loaded, loading_time = console.load_either_timed(problem, enter, changes)
        files.spare([loaded.robot.urdf.path])
        file = read_trajectory_file(trajectory, loaded.robot.joint_names)
        robustness = replace(loaded.robustness or Robustness(), **options)
        simulation = _Simulation(trajectory, file, robustness, draw, files, enter)
        if isinstance(loaded, Cycle):
            answer = simulation.of_cycle(loaded)
        else:
            answer = simulation.of_motion(loaded)
    if as_json:
        more: dict[str, Any] = {"duration": file.trajectory.duration}
        more |= {"loading_time": loading_time, "notes": answer.notes}
        more |= {"plot": files.path_text("plot"), "html": files.path_text("view")}
        console.print_json(answer.report | more)
    else:
        console.say(*answer.lines, *(f"note: {note}" for note in answer.notes), sep="\n")
        files.say()


@dataclass(frozen=True)
class _Answer:
    """The answer of a simulation: a JSON object, times still absent, lines, and notes."""

    report: dict[str, Any]
    lines: list[str]
    notes: list[str]


@dataclass(frozen=True)
class _Simulation:
    """Executes, judges and draws the motion of a trajectory file."""

    path: Path
    file: TrajectoryFile
    errors: Robustness
    draw: Draw
    files: console.OutputFiles
    enter: Callable[[object], None]

    def of_motion(self, problem: PlanningProblem) -> _Answer:
        """Simulate the motion of a problem."""
        motion, errors = self.file.trajectory, self.errors
        notes = notes_on_file(problem, self.file, failed=False)
        self.enter(f"{self.draw.runs} runs")
        plants = drawn_plants(problem.robot, errors, self.draw)
        control = (errors.controller, errors.control_period)
        execution = executed(problem, motion, plants, *control, self._moving(), errors.bandwidth)
        judged = judged_runs(problem, motion, execution, self._judging(1), errors)
        self._draw(
            lambda: plot_execution(problem, motion, execution, judged),
            lambda: view(problem, motion, names=["plan"], execution=execution),
        )
        return _Answer(execution_report(judged, errors), execution_lines(judged, errors), notes)

    def of_cycle(self, cycle: Cycle) -> _Answer:
        """Simulate the motion of a cycle."""
        motion = motion_of_file(cycle, self.path, self.file)
        notes = notes_on_cycle_file(cycle, self.file)
        self.enter(f"{self.draw.runs} runs")
        execution = executed_cycle(motion, self.errors, self.draw, self._moving())
        judged = judged_cycle(motion, execution, self._judging(len(cycle.legs)), self.errors)
        self._draw(
            lambda: plot_cycle_execution(motion, execution, judged),
            lambda: view_cycle(cycle, [motion], ["plan"], execution=execution),
        )
        lines = cycle_execution_lines(judged, self.errors)
        report = cycle_execution_report(judged, self.errors)
        return _Answer(report, lines, notes + [_PLANNED] * bool(judged.handovers))

    def _moving(self) -> Callable[[], None]:
        periods = ceil(self.file.trajectory.duration / self.errors.control_period)
        return self._counter(f"{self.draw.runs} runs, control period", periods)

    def _judging(self, legs: int) -> Callable[[], None]:
        return self._counter("tolerances and clearance, run", self.draw.runs * legs)

    def _counter(self, stage: str, total: int) -> Callable[[], None]:
        """Return a callback that enters a stage with its number of calls."""
        numbers = count(1)
        return lambda: self.enter(f"{stage} {min(next(numbers), total)} of {total}")

    def _draw(self, figure: Callable[[], Any], page: Callable[[], View]) -> None:
        if self.files.paths:
            self.enter("pictures")
            plot, view = lambda path: figure_file(figure(), path), lambda _: page().html.encode()
            self.files.write({"plot": plot, "view": view})


# ---- The runs of a motion, as text for a terminal and as JSON values.


def execution_report(judged: Sequence[JudgedRun], errors: Robustness) -> dict[str, Any]:
    """Return the JSON object of some runs, times still absent."""
    seen = seen_fields(judged)
    return {
        **console.empty_report(
            "success", run_verdict(judged).survived(errors), seen["seen"]["tube"]["worst"]["place"]
        ),
        **seen,
    }


def seen_fields(judged: Sequence[JudgedRun]) -> dict[str, Any]:
    """Return the verdict and the summaries of some runs, as JSON values."""
    return {
        "verdict": run_verdict(judged).as_dict(),
        "saturated": [run.saturated for run in judged],
        "excursions": [run.tube.value for run in judged],
        "seen": {
            name: None if summary is None else summary.as_dict()
            for name, summary in summaries(judged).items()
        },
    }


def execution_lines(judged: Sequence[JudgedRun], errors: Robustness) -> list[str]:
    """Return the summaries of some runs, line by line, the verdict last."""
    head = f"{'worst':>12}{'median':>12}{'required':>12}"
    lines = [f"{'seen in ' + str(len(judged)) + ' runs':38}{head}  where"]
    for name, summary in summaries(judged).items():
        if summary is not None:
            worst = f"{summary.worst.value:12.4g}{summary.median:12.4g}"
            bound = _bound(judged[summary.run], name)
            lines.append(
                f"{_NAMES[name]:38}{worst}{bound:>12}  run {summary.run}, {summary.worst.location}"
            )
    saturated = [100 * run.saturated for run in judged]
    fraction = f"{max(saturated):12.3g}{sorted(saturated)[len(saturated) // 2]:12.3g}"
    lines.append(f"{'time with a motor at its limit [%]':38}{fraction}")
    return [*lines, run_verdict(judged).survived(errors)]


def _bound(run: JudgedRun, name: str) -> str:
    """Return the bound that a run must keep, or a dash where the quantity is only told."""
    if name in run.stops:
        return f"<= {run.stops[name]:.4g}"
    if name in ("velocity", "tracking", "tool_tracking"):
        return "-"
    least = {"obstacles": run.clearance, "self_collision": 0.0}
    return f">= {least[name]:.4g}" if name in least else "<= 0"


# ---- The runs of a cycle, as text for a terminal and as JSON values.


def cycle_execution_report(judged: JudgedCycle, errors: Robustness) -> dict[str, Any]:
    """Return the JSON object of the runs of a cycle, times still absent.

    Moves that run without a stop have the same under each of their names.
    """
    moves = {name: seen_fields(runs) for names, runs in judged.legs.items() for name in names}
    handovers = [each.as_dict() for each in judged.handovers]
    return {**execution_report(judged.runs, errors), "moves": moves, "handovers": handovers}


def cycle_execution_lines(judged: JudgedCycle, errors: Robustness) -> list[str]:
    """Return the summaries of the runs of a cycle, line by line, the verdict last.

    First of the cycle, then the worst of each move, and of the tool at each handover.
    """
    *quantities, verdict = execution_lines(judged.runs, errors)
    lines = [*quantities, "", _row("move, the worst of it", ["failed", *_QUANTITIES, _LIMIT])]
    for names, runs in judged.legs.items():
        by_name, counts = summaries(runs), run_verdict(runs)
        columns = [by_name[name] for name in _QUANTITIES.values()]
        worst = ["-" if column is None else f"{column.worst.value:.4g}" for column in columns]
        saturated = f"{100 * max(run.saturated for run in runs):.3g}"
        cells = [f"{counts.failed} of {counts.runs}", *worst, saturated]
        lines.append(_row(", ".join(names), cells))
    if judged.handovers:
        lines += ["", _row("error of the tool at each handover", _HANDOVERS)]
    for each in judged.handovers:
        values = each.as_dict()
        distance, angle, speed = (
            f"{values[name]['worst']:.3g}" for name in ("distance", "angle", "speed")
        )
        cells = [distance, f"{values['distance']['median']:.3g}", angle, speed]
        lines.append(_row(str(each.mark), cells))
    return [*lines, "", verdict]


def _row(name: str, cells: Sequence[str]) -> str:
    return f"{name:38}" + "".join(f"{cell:>16}" for cell in cells)
