"""Plans and certificates as text for a terminal."""

import sys
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from tubeplanner.baselines.fastest_parameterization import NOT_PROVED
from tubeplanner.collision.collision_checker import ALWAYS_TOUCHING
from tubeplanner.constraints.trajectory_peaks import TrajectoryPeaks
from tubeplanner.problem.fitting_presets import fitting_presets
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.verification.certificate import Certificate
from tubeplanner.verification.judged_condition import RELATIVE, JudgedCondition, Tolerance

if TYPE_CHECKING:  # the planner loads SciPy, and `check` does not need it
    from tubeplanner.planning.plan_result import PlanResult

_WIDTH_OF_A_FILE, _VERY_WIDE = 160, 10_000  # [characters]
# Rounding errors of the machine are shown as zero.
_NOTHING = 1e-10
_SENSITIVITIES_SHOWN = 3


def plan_text(
    problem: PlanningProblem,
    result: "PlanResult",
    loading_time: float,
    *,
    with_minimum: bool = False,
) -> str:
    """Return the result of planning as text.

    Args:
        problem: The planning problem.
        result: Its result.
        loading_time: [s].
        with_minimum: Whether to report the least time for the path, if motors switch instantly.
    """
    robot = problem.robot
    lines = [
        f"{problem.name}: {robot.name}, {robot.joint_count} joints to {robot.tool_frame}",
        *([] if result.peaks is None else peaks_lines(robot, result.peaks)),
        f"loaded in {loading_time:.2f} s, planned in {result.planning_time:.2f} s "
        f"(certificate {result.certificate_time:.2f} s), method {result.method}",
    ]
    if result.search is not None:
        lines.append(f"branch and bound: {result.search}")
    if result.phase_two is not None:
        lines.append(f"phase 2, from {result.phase1_duration:.4f} s: {result.phase_two}")
    if result.certificate is not None:
        lines.append(certificate_text(result.certificate))
        lines += left_out_lines(result.certificate)
    lines.append(f"{result.status}: {result.message}")
    dearest = [
        str(sensitivity)
        for sensitivity in result.sensitivities[:_SENSITIVITIES_SHOWN]
        if sensitivity.saved > 0
    ]
    if dearest:
        lines.append(f"10 % more would save: {'; '.join(dearest)}")
    if with_minimum:
        lines += _minimum_lines(problem, result)
    lines += [f"note: {note}" for note in result.notes]
    place = str(result.place)
    if place:
        lines.append(f"where: {place}")
    if result.proved is not None:
        lines.append("`tubeplanner explain` looks for the smallest changes that make it possible")
    if result.stopped_by is not None:
        lines.append(f"stopped by {result.stopped_by.replace('_', ' ')}: there may be better")
    if problem.obstacles and not problem.collision.has_link_geometry:
        lines.append(
            "note: the robot has no collision geometry; the obstacles were NOT checked against it"
        )
    return "\n".join(lines)


def _minimum_lines(problem: PlanningProblem, result: "PlanResult") -> list[str]:
    """Return a line on what motors that switch instantly would save on the path, if it is known."""
    if result.path_minimum is None or not result.duration:
        return []
    left = 100 * max(1 - result.path_minimum / result.duration, 0.0)
    line = "time left on this path: motors that switch instantly would take"
    if not problem.robot.motors.has_less_at_speed:
        return [f"{line} {result.path_minimum:.4f} s, {left:.1f} % less"]
    return [
        f"{line} at most {result.path_minimum:.4f} s, at least {left:.1f} % less ({NOT_PROVED})"
    ]


def peaks_lines(robot: RobotModel, peaks: TrajectoryPeaks) -> list[str]:
    """Return a trajectory's peaks, and which limits to give where nothing bounds them.

    Args:
        robot: The arm.
        peaks: Of a trajectory.
    """
    lines = [f"peaks: {peaks}"]
    free = {quantity: robot.limits.unlimited(quantity) for quantity in ("acceleration", "jerk")}
    named = [quantity for quantity, joints in free.items() if len(joints) > 0]
    if named:
        joints = np.union1d(free["acceleration"], free["jerk"])
        whose = ", ".join(robot.joint_names[joint] for joint in joints)
        of_some = f" of {whose}" if len(joints) < robot.joint_count else ""
        lines.append(
            f"nothing limits {' or '.join(named)}{of_some}; for a motion that a machine can "
            "follow, give the robot's own as "
            + " and ".join(f"robot.limits.{quantity}" for quantity in named)
            + "".join(f", or robot.preset: {name}" for name in fitting_presets(robot))
        )
    return lines


def certificate_text(certificate: Certificate) -> str:
    """Return a certificate as a table, as wide as the terminal."""
    table = Table(title="Certificate", title_justify="left")
    for heading in ("condition", "margin", "holds", "where", "coverage"):
        table.add_column(heading, justify="right" if heading == "margin" else "left")
    for name, condition in certificate.conditions.items():
        table.add_row(name, *condition_cells(condition, certificate.tolerance))
    return rendered(table)


def condition_cells(condition: JudgedCondition, tolerance: Tolerance) -> tuple[str, ...]:
    """Return margin, verdict, place and coverage of a condition as cells of a table."""
    if condition.margin is None:
        return "", "not required", "", condition.coverage
    shown = 0.0 if abs(condition.margin) < _NOTHING else condition.margin
    percent = condition.unit == RELATIVE
    margin = f"{100 * shown:.3g} %" if percent else f"{shown:.3g} {condition.unit}"
    verdict = "yes" if condition.holds(tolerance) else "NO"
    return margin, verdict, escape(str(condition.where)), condition.coverage


def other_speeds_line(certificate: Certificate) -> str:
    """Return one line on how soon the arm comes to rest, and on slower runs."""
    said = []
    braking = certificate.braking
    if braking is not None:
        said.append(
            f"brakes to rest within {braking.time:.3f} s and {1000 * braking.distance:.0f} mm of "
            f"the tool's path (longest from {braking.where})"
        )
    failure = certificate.slower_failure
    if failure is None:
        said.append("slower runs keep all limits")
    else:
        said.append(
            f"slower runs break limits: {failure.condition}, margin {100 * failure.margin:.3g} % "
            f"at {100 * failure.speed:.3g} % of the speed ({failure.where})"
        )
    return "; ".join(said)


def left_out_lines(certificate: Certificate) -> list[str]:
    """Return a note that names the pairs of links that always touch; none if there are none."""
    pairs = [pair for pair in certificate.left_out if pair.reason == ALWAYS_TOUCHING]
    named = "; ".join(" and ".join(pair.links) for pair in pairs)
    return [f"note: not checked, because they touch in every configuration: {named}"] * bool(pairs)


def rendered(table: Table) -> str:
    """Return a table as text, as wide as the terminal or a file allows."""
    console = terminal()
    with console.capture() as capture:
        console.print(table)
    return capture.get().rstrip("\n")


def fits(table: Table) -> bool:
    """Return whether a table's columns fit next to each other without breaking a line more."""
    return Console(width=_VERY_WIDE).measure(table).maximum <= terminal().width


def terminal() -> Console:
    """Return where text is printed, with its width; plain, as `say` prints codes as text."""
    width = None if sys.stdout.isatty() else _WIDTH_OF_A_FILE
    return Console(width=width, color_system=None)
