"""The command that says what is in a robot or a problem, and what it lacks."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from tubeplanner.commands.answer_files import write_answer
from tubeplanner.commands.console import (
    AS_JSON,
    PACKAGE_DIR,
    PATH,
    SET,
    TOOL_FRAME,
    empty_report,
    nowhere,
    print_json,
    say,
    shown_progress,
)
from tubeplanner.commands.cycle_info_text import cycle_text
from tubeplanner.commands.info_text import problem_text, robot_text
from tubeplanner.cycle.cycle_info import CycleInfo, cycle_info
from tubeplanner.cycle.problem_or_cycle import is_cycle_file
from tubeplanner.errors import OptionError
from tubeplanner.files.output_files import require_writable
from tubeplanner.problem.problem_info import ProblemInfo, problem_info
from tubeplanner.resources import EXAMPLE_PREFIX
from tubeplanner.robot.robot_info import RobotInfo, robot_info
from tubeplanner.tube_sources.shown_configuration import shown_configuration
from tubeplanner.views.figure_files import figure_file, require_figure
from tubeplanner.views.robot_plot import plot_robot

_PROBLEM_ENDINGS = (".yaml", ".yml", ".json")


@click.command()
@click.argument("robot", metavar="ROBOT|PROBLEM")
@TOOL_FRAME
@PACKAGE_DIR
@click.option("--plot", type=PATH, help="Arm with its frames named (PNG, PDF or SVG).")
@SET
@AS_JSON
def info(
    robot: str,
    tool_frame: str | None,
    package_dirs: tuple[str, ...],
    plot: Path | None,
    changes: dict[str, Any],
    as_json: bool,
) -> None:
    """Say what is in ROBOT, a URDF or example:NAME, or in PROBLEM, and what is missing.

    Joints and their limits with where each comes from, motors, links, masses, geometry, frames; of
    a problem also start, tube, obstacles and payload, of a cycle moves, rests and what is carried.
    Missing limits are no error here.
    """
    require_figure(plot, "--plot")
    if plot is not None:
        require_writable([plot], [Path(robot)])
    with shown_progress() as enter:
        enter("reading robot")
        if is_problem(robot):
            if package_dirs:
                raise OptionError("--package-dir is for a URDF; a problem has robot.package_dirs")
            frame = {} if tool_frame is None else {"robot.tool_frame": tool_frame}
            read = cycle_info if is_cycle_file(robot) else problem_info
            found: RobotInfo | ProblemInfo | CycleInfo = read(robot, changes | frame)
        else:
            if changes:
                raise OptionError(f"--set changes a problem file; {robot} is a robot")
            found = robot_info(robot, tool_frame, package_dirs=package_dirs)
        if plot is not None:
            enter("picture")
            picture = _picture(found, plot)
            enter("writing")
            write_answer({plot: picture})
    if as_json:
        fields = _finite(found.as_dict())
        message = f"{fields['name']}: {len(fields['missing'])} things missing"
        report = empty_report("success", message, nowhere())
        print_json({**report, **fields, "plot": None if plot is None else str(plot)})
        return
    say(_as_text(found))
    if plot is not None:
        say(f"plot: {plot}")


def is_problem(name: str) -> bool:
    """Return whether a name is that of a problem rather than of a robot."""
    if name.startswith(EXAMPLE_PREFIX):
        return "/" in name
    return Path(name).suffix.lower() in _PROBLEM_ENDINGS


def _picture(found: RobotInfo | ProblemInfo | CycleInfo, path: Path) -> bytes:
    problem = None if isinstance(found, RobotInfo) else found.problem
    arm = found.arm if isinstance(found, RobotInfo) else found.robot.arm
    return figure_file(plot_robot(arm, shown_configuration(arm, problem)), path)


def _finite(value: Any) -> Any:
    """Return JSON values, null for what is infinite."""
    if isinstance(value, Mapping):
        return {str(key): _finite(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _as_text(found: RobotInfo | ProblemInfo | CycleInfo) -> str:
    if isinstance(found, CycleInfo):
        return cycle_text(found)
    return problem_text(found) if isinstance(found, ProblemInfo) else robot_text(found)
