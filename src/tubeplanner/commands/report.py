"""Plans and certificates as text for a terminal."""

import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from tubeplanner.collision.collision_checker import ALWAYS_TOUCHING
from tubeplanner.problem.fitting_presets import fitting_presets
from tubeplanner.verification.judged_condition import RELATIVE

if TYPE_CHECKING:
    from tubeplanner.collision.link_covers import LinkCover
    from tubeplanner.constraints.trajectory_peaks import TrajectoryPeaks
    from tubeplanner.measurement.measured_tube import SegmentMeasurement, TubeMeasurement
    from tubeplanner.measurement.sign_patterns import PatternSurvey
    from tubeplanner.planning.plan_result import PlanResult
    from tubeplanner.problem.problem import PlanningProblem
    from tubeplanner.robot.robot_model import RobotModel
    from tubeplanner.studies.field_sweep import FieldSweep
    from tubeplanner.studies.tolerance_sweep import SweepResult
    from tubeplanner.tube_sources.tube_answer import TubeAnswer
    from tubeplanner.verification.certificate import Certificate
    from tubeplanner.verification.judged_condition import JudgedCondition, Tolerance

_WIDTH_OF_A_FILE, _VERY_WIDE = 160, 10_000  # [characters]
# Rounding errors of the machine are shown as zero.
_NOTHING = 1e-10
_SENSITIVITIES_SHOWN = 3


def plan_text(
    problem: "PlanningProblem",
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


def _minimum_lines(problem: "PlanningProblem", result: "PlanResult") -> list[str]:
    """Return a line on what motors that switch instantly would save on the path, if it is known."""
    from tubeplanner.baselines.fastest_parameterization import NOT_PROVED

    if result.path_minimum is None or not result.duration:
        return []
    left = 100 * max(1 - result.path_minimum / result.duration, 0.0)
    line = "time left on this path: motors that switch instantly would take"
    if not problem.robot.motors.has_less_at_speed:
        return [f"{line} {result.path_minimum:.4f} s, {left:.1f} % less"]
    return [
        f"{line} at most {result.path_minimum:.4f} s, at least {left:.1f} % less ({NOT_PROVED})"
    ]


def peaks_lines(robot: "RobotModel", peaks: "TrajectoryPeaks") -> list[str]:
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


def sweep_text(result: "SweepResult") -> str:
    """Return a sweep as a table, as wide as the terminal, and the rows' messages."""
    scaled = result.quantity != "radius"
    table = Table(title=f"{result.problem.name}: duration against tolerance", title_justify="left")
    for heading in ("scale" if scaled else "radius", "duration", "10 % more radius", "planned in"):
        table.add_column(heading, justify="right")
    table.add_column("answer")
    for row in result.rows:
        value = f"{row.value:g}" if scaled else f"{1000 * row.value:g} mm"
        if row.result is None or row.duration is None:
            table.add_row(value, "", "", "", f"{row.status}: {escape(row.message)}")
            continue
        saved = (
            "" if row.elasticity is None else f"{abs(100 * row.elasticity * row.duration):.2g} ms"
        )
        message = f"certified, {row.result.method}" + (f"; {row.note}" if row.note else "")
        times = (f"{row.duration:.4f} s", saved and f"saves {saved}")
        table.add_row(value, *times, f"{row.result.planning_time:.2f} s", message)
    return rendered(table)


def field_sweep_text(result: "FieldSweep") -> str:
    """Return a sweep over a field as a table, as wide as the terminal, and the answers' notes."""
    from tubeplanner.studies.json_values import value_text

    table = Table(title=f"{result.name}: duration against {result.path}", title_justify="left")
    headings = ["duration", *["shortest"] * result.varies_objective]
    headings += [*["runs failed"] * result.is_simulated, "planned in"]
    table.add_column(escape(result.path), justify="right")
    for heading in headings:
        table.add_column(heading, justify="right")
    table.add_column("answer")
    for row in result.rows:
        value = escape(value_text(row.value))
        if row.result is None or row.duration is None:
            gaps = [""] * len(headings)
            table.add_row(value, *gaps, f"{row.status}: {escape(row.message)}")
            continue
        durations = [row.duration, *[row.shortest_duration] * result.varies_objective]
        cells = [f"{duration:.4f} s" for duration in durations]
        seen = "" if row.verdict is None else f"{row.verdict.failed} of {row.verdict.runs}"
        cells += [*[seen] * result.is_simulated, f"{row.result.planning_time:.2f} s"]
        table.add_row(value, *cells, f"certified, {row.result.method}")
    whose: dict[str, list[str]] = {}
    for row in result.rows:
        for note in row.notes:
            whose.setdefault(note, []).append(value_text(row.value))
    notes = [f"note ({', '.join(values)}): {note}" for note, values in whose.items()]
    return "\n".join([rendered(table), *notes])


def measurement_text(
    problem: "PlanningProblem", result: "TubeMeasurement", loading_time: float
) -> str:
    """Return a measured tube as a table of what limits each radius and range, and the counts."""
    lines = [
        f"{problem.name}: {problem.robot.name}, loaded in {loading_time:.2f} s, measured in "
        f"{result.measuring_time:.1f} s"
    ]
    if result.succeeded:
        table = Table(title="Measured tube", title_justify="left")
        for heading in ("segment", "bound", "largest", "ended by"):
            table.add_column(heading)
        for k, segment in enumerate(result.segments):
            for row in _measured_rows(segment):
                table.add_row(str(k), *map(escape, row))
            table.add_section()
        lines.append(rendered(table))
        for k, segment in enumerate(result.segments):
            lines.append(
                f"segment {k}: tested with {segment.samples} random configurations, no collision "
                f"(the {segment.collisions} found before lie outside)"
            )
    lines.append(f"{result.status}: {result.message}")
    place = str(result.place)
    return "\n".join([*lines, f"where: {place}"] if place else lines)


def links_text(problem: "PlanningProblem", covers: "Sequence[LinkCover]") -> str:
    """Return how closely links are covered as a table, and the pairs that are left out."""
    table = Table(title=f"{problem.name}: links and their convex covers", title_justify="left")
    table.add_column("link")
    for heading in ("shapes", "stand off by", "where others come near", "by"):
        table.add_column(heading, justify="right")
    for each in covers:
        closer = ("", "")
        if each.closer_error is not None:
            closer = (str(each.closer_shapes), f"{1000 * each.closer_error:.2f} mm")
        error = f"{1000 * each.outer_error:.2f} mm"
        table.add_row(escape(each.link), str(each.shapes), error, *closer)
    pairs = [
        f"not checked: {' and '.join(pair.links)} ({pair.reason})"
        for pair in problem.collision.left_out
    ]
    return "\n".join([rendered(table), *pairs])


def patterns_text(problem: "PlanningProblem", survey: "PatternSurvey") -> str:
    """Return sign patterns as a table, and the suggested one."""
    table = Table(title=f"{problem.name}: configurations by segment", title_justify="left")
    for heading in ("segment", "signs", "reachable", "free", "radius up to", "why not"):
        table.add_column(heading)
    for row in survey.rows:
        signs = ", ".join(f"{name} {sign}" for name, sign in row.signs.items())
        radius = "" if row.radius is None else f"{1000 * row.radius:.0f} mm"
        verdicts = ["yes" if holds else "no" for holds in (row.reachable, row.free)]
        table.add_row(str(row.segment), signs, *verdicts, radius, escape(row.message))
    return f"{rendered(table)}\n{survey.message}"


def _measured_rows(segment: "SegmentMeasurement") -> list[tuple[str, str, str]]:
    """Return what is bounded, by how much, and what limits it there."""
    ended: dict[str | None, list[str]] = {}
    for binding in segment.bindings:
        side = "" if binding.bound == "radius" else f"{binding.bound}: "
        place = replace(binding.place, joint=None, segment=None)
        ended.setdefault(binding.place.joint, []).append(f"{side}{place}")
    rows = [("radius", f"{1000 * segment.radius:.1f} mm", "; ".join(ended.get(None, [])))]
    for name, (lower, upper) in segment.joint_ranges.items():
        rows.append((name, f"[{lower:.3f}, {upper:.3f}]", "; ".join(ended.get(name, []))))
    return rows


def tube_text(name: str, answer: "TubeAnswer") -> str:
    """Return the result of a search for a tube as text.

    Args:
        name: Of the problem.
        answer: Its result.
    """
    lines = [f"{name}: searched for {answer.search_time:.1f} s"]
    if answer.compared:
        listed = ", ".join("none" if one is None else f"{one:.3f} s" for one in answer.compared)
        lines.append(f"trajectories along the routes compared: {listed}")
    if answer.found is not None:
        tube = answer.found.problem.tube
        for k, (point, radius) in enumerate(zip(tube.points, [*tube.radius, None], strict=True)):
            place = ", ".join(f"{x:.4f}" for x in point)
            width = "" if radius is None else f", then a radius of {1000 * radius:.1f} mm"
            lines.append(f"point {k}: [{place}] m{width}")
    if answer.measured is not None and answer.measured is not answer.found:
        radii = ", ".join(f"{1000 * radius:.1f}" for radius in answer.measured.problem.tube.radius)
        lines.append(
            f"measured tube, in which nothing collides: {answer.measured.duration:.4f} s within "
            f"radii of {radii} mm"
        )
    lines += [f"note: {note}" for note in answer.notes]
    lines.append(f"{answer.status}: {answer.message}")
    place = str(answer.place)
    return "\n".join([*lines, f"where: {place}"] if place else lines)


def certificate_text(certificate: "Certificate") -> str:
    """Return a certificate as a table, as wide as the terminal."""
    table = Table(title="Certificate", title_justify="left")
    for heading in ("condition", "margin", "holds", "where", "coverage"):
        table.add_column(heading, justify="right" if heading == "margin" else "left")
    for name, condition in certificate.conditions.items():
        table.add_row(name, *condition_cells(condition, certificate.tolerance))
    return rendered(table)


def condition_cells(condition: "JudgedCondition", tolerance: "Tolerance") -> tuple[str, ...]:
    """Return margin, verdict, place and coverage of a condition as cells of a table."""
    if condition.margin is None:
        return "", "not required", "", condition.coverage
    shown = 0.0 if abs(condition.margin) < _NOTHING else condition.margin
    percent = condition.unit == RELATIVE
    margin = f"{100 * shown:.3g} %" if percent else f"{shown:.3g} {condition.unit}"
    verdict = "yes" if condition.holds(tolerance) else "NO"
    return margin, verdict, escape(str(condition.where)), condition.coverage


def other_speeds_line(certificate: "Certificate") -> str:
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


def left_out_lines(certificate: "Certificate") -> list[str]:
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
