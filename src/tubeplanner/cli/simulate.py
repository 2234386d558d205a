"""`simulate`: runs by plants, report."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import count
from math import ceil
from pathlib import Path
from typing import Any

import click

from tubeplanner.cli import console
from tubeplanner.execution.mujoco_model import require_mujoco
from tubeplanner.execution.plants import Draw
from tubeplanner.execution.run_verdict import (
    BOUNDS,
    JudgedCycle,
    JudgedRun,
    judged_cycle,
    run_verdict,
    summaries,
)
from tubeplanner.execution.simulation import executed_cycle
from tubeplanner.output.figures.execution_figures import plot_executed_motion
from tubeplanner.output.figures.figure_files import FIGURE_ENDINGS, figure_file
from tubeplanner.output.files.file_notes import notes_on_file
from tubeplanner.output.page.viewer import view_motions
from tubeplanner.task.demands import Robustness
from tubeplanner.task.motion import Motion, motion_of_file
from tubeplanner.trajectory.reader import read_trajectory_file

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
    "holding": "of what contacts carry, fraction",
    "part": "held part moved in the tool [m]",
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
        loaded, loading_time = console.load_task_timed(problem, enter, changes)
        files.spare([loaded.robot.urdf.path])
        file = read_trajectory_file(trajectory, loaded.robot.joint_names)
        motion = motion_of_file(loaded, trajectory, file)
        robustness = replace(loaded.robustness or Robustness(), **options)
        notes = notes_on_file(loaded, file)
        enter(f"{runs} runs")
        periods = ceil(motion.trajectory.duration / robustness.control_period)
        moving = _counter(enter, f"{runs} runs, control period", periods)
        execution = executed_cycle(motion, robustness, draw, moving)
        total = runs * len(motion.sections)
        judging = _counter(enter, "tolerances and clearance, run", total)
        judged = judged_cycle(motion, execution, judging, robustness, follow_parts=True)
        if files.paths:
            enter("pictures")

            def figure(path: Path) -> bytes:
                return figure_file(plot_executed_motion(motion, execution, judged.runs), path)

            def page(_: Path) -> bytes:
                return view_motions(loaded, {"plan": motion}, execution).html.encode()

            files.write({"plot": figure, "view": page})
    notes += [_PLANNED] * bool(judged.handovers)
    if as_json:
        more: dict[str, Any] = {"duration": file.trajectory.duration}
        more |= {"loading_time": loading_time, "notes": notes}
        more |= {"plot": files.path_text("plot"), "html": files.path_text("view")}
        console.print_json(execution_report(motion, judged, robustness) | more)
    else:
        lines = execution_lines(motion, judged, robustness)
        console.say(*lines, *(f"note: {note}" for note in notes), sep="\n")
        files.say()


def _counter(enter: Callable[[object], None], stage: str, total: int) -> Callable[[], None]:
    """Return a callback that enters a stage with its number of calls."""
    numbers = count(1)
    return lambda: enter(f"{stage} {min(next(numbers), total)} of {total}")


# ---- The runs of a motion, as text for a terminal and as JSON values.


def execution_report(motion: Motion, judged: JudgedCycle, errors: Robustness) -> dict[str, Any]:
    """Return the JSON object of some runs, times still absent.

    Moves of a cycle that run without a stop have the same under each of their names.
    """
    seen = _seen_fields(judged.runs)
    message, where = run_verdict(judged.runs).survived(errors), seen["seen"]["tube"]["worst"]
    report = {**console.empty_report("success", message, where["place"]), **seen}
    if motion.marks:
        legs = judged.legs.items()
        report["moves"] = {name: _seen_fields(runs) for names, runs in legs for name in names}
        report["handovers"] = [each.as_dict() for each in judged.handovers]
    return report


def _seen_fields(judged: Sequence[JudgedRun]) -> dict[str, Any]:
    """Return the verdict and the summaries of some runs, as JSON values."""
    return {
        "verdict": run_verdict(judged).as_dict(),
        "saturated": [run.saturated for run in judged],
        "excursions": [run.tube.value for run in judged],
        "part_moved": [run.part and run.part.value for run in judged],
        "part_lost": [run.part and run.loses_part for run in judged],
        "seen": {
            name: None if summary is None else summary.as_dict()
            for name, summary in summaries(judged).items()
        },
    }


def execution_lines(motion: Motion, judged: JudgedCycle, errors: Robustness) -> list[str]:
    """Return the summaries of some runs, line by line, the verdict last.

    Of a cycle also the worst of each move, and of the tool at each handover.
    """
    runs, head = judged.runs, f"{'worst':>12}{'median':>12}{'required':>12}"
    lines = [f"{'seen in ' + str(len(runs)) + ' runs':38}{head}  where"]
    for name, summary in summaries(runs).items():
        if summary is not None:
            worst = f"{summary.worst.value:12.4g}{summary.median:12.4g}"
            bound = _bound(runs[summary.run], name)
            lines.append(
                f"{_NAMES[name]:38}{worst}{bound:>12}  run {summary.run}, {summary.worst.location}"
            )
    saturated = [100 * run.saturated for run in runs]
    fraction = f"{max(saturated):12.3g}{sorted(saturated)[len(saturated) // 2]:12.3g}"
    lines.append(f"{'time with a motor at its limit [%]':38}{fraction}")
    moved = [
        "lost" if run.loses_part else f"{1000 * run.part.value:.3g}" for run in runs if run.part
    ]
    if moved:
        lines.append(f"held part moved, by run [mm]: {', '.join(moved)}")
    if motion.marks:
        lines += ["", *_move_lines(judged), ""]
    return [*lines, run_verdict(runs).survived(errors)]


def _bound(run: JudgedRun, name: str) -> str:
    """Return the bound that a run must keep, or a dash where the quantity is only told."""
    if name in run.stops:
        return f"<= {run.stops[name]:.4g}"
    if name in ("velocity", "tracking", "tool_tracking"):
        return "-"
    least = {"obstacles": run.clearance, "self_collision": 0.0}
    return f">= {least[name]:.4g}" if name in least else f"<= {BOUNDS.get(name, 0.0):.4g}"


def _move_lines(judged: JudgedCycle) -> list[str]:
    """Return the worst of each move of a cycle, and of the tool at each handover."""
    lines = [_row("move, the worst of it", ["failed", *_QUANTITIES, _LIMIT])]
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
    return lines


def _row(name: str, cells: Sequence[str]) -> str:
    return f"{name:38}" + "".join(f"{cell:>16}" for cell in cells)
