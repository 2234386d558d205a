"""`measure`: widths of a tube, sign patterns."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import click
from rich.markup import escape
from rich.table import Table

from tubeplanner.cli import console
from tubeplanner.cli.interrupts import hold_interrupts
from tubeplanner.cli.report import rendered
from tubeplanner.errors import OptionError
from tubeplanner.output.files.problem_file import with_other_tube
from tubeplanner.resources import find_problem
from tubeplanner.studies.tubes.measurement import PatternSurvey, measure_tube, survey_patterns
from tubeplanner.studies.tubes.measurement_result import (
    MeasureOptions,
    SegmentMeasurement,
    TubeMeasurement,
)
from tubeplanner.task.includes import ProblemLayers
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.writing import require_writable


@click.command()
@click.argument("problem")
@click.option("-o", "--output", type=console.PATH, help="Problem file with the measured tube.")
@click.option(
    "--max-radius", type=float, default=0.2, show_default=True, help="Largest radius [m]."
)
@click.option(
    "--configurations", is_flag=True, help="Only list the reachable, free joint signs per segment."
)
@click.option("--seed", type=int, default=0, show_default=True, help="Seed of the random numbers.")
@click.option(
    "--max-segments",
    type=int,
    default=20,
    show_default=True,
    help="Largest number of segments; each takes one to two seconds.",
)
@console.SET
@console.AS_JSON
def measure(
    problem: str,
    output: Path | None,
    max_radius: float,
    configurations: bool,
    seed: int,
    max_segments: int,
    changes: dict[str, Any],
    as_json: bool,
) -> int:
    """Measure the largest collision-free radii [m] and joint ranges of PROBLEM's tube.

    The radii of the file are ignored. Its joint signs and its start select the configuration.
    """
    options = MeasureOptions(max_radius, seed=seed, max_segments=max_segments)
    if configurations and output is not None:
        raise OptionError("--configurations compares and writes no file; leave out one of them")
    if configurations:
        return _compare(problem, options, changes, as_json)
    outputs = [] if output is None else [output]
    require_writable(outputs, [Path(problem)])
    with console.shown_progress() as enter:
        loaded, loading_time = console.load_timed(problem, enter, changes)
        source = find_problem(problem, Path())
        require_writable(outputs, [*ProblemLayers.read(source).files, loaded.robot.urdf.path])
        result = measure_tube(loaded, options, enter)
    if output is not None and result.problem is not None:
        hold_interrupts()
        tube = result.problem.tube
        console.write_answer(
            console.Output("problem", output, lambda to: with_other_tube(source, to, tube, changes))
        )
    if as_json:
        fields = {**console.empty_report("", ""), **result.as_dict()}
        console.print_json({**fields, "loading_time": loading_time})
    else:
        console.say(measurement_text(loaded, result, loading_time))
        if console.unless_failed(output) and result.succeeded:
            console.say(f"problem: {output}")
        elif result.succeeded:
            console.say_unwritten("-o PROBLEM.yaml")
    return console.SUCCESS if result.succeeded else console.INFEASIBLE


def _compare(problem: str, options: MeasureOptions, changes: dict[str, Any], as_json: bool) -> int:
    with console.shown_progress() as enter:
        loaded, loading_time = console.load_timed(problem, enter, changes)
        survey = survey_patterns(loaded, options, enter)
    if as_json:
        fields = {**console.empty_report("", ""), **survey.as_dict()}
        console.print_json({**fields, "loading_time": loading_time})
    else:
        console.say(patterns_text(loaded, survey))
    return console.SUCCESS if survey.suggested is not None else console.INFEASIBLE


def measurement_text(problem: PlanningProblem, result: TubeMeasurement, loading_time: float) -> str:
    """Return a measured tube as a table of its bounds and their causes, and the sample counts."""
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
    location = str(result.location)
    return "\n".join([*lines, f"where: {location}"] if location else lines)


def _measured_rows(segment: SegmentMeasurement) -> list[tuple[str, str, str]]:
    """Return rows of a bound, its value and its causes; the radius, then the joint ranges."""
    causes: dict[str | None, list[str]] = {}
    for binding in segment.bindings:
        side = "" if binding.bound == "radius" else f"{binding.bound}: "
        location = replace(binding.location, joint=None, segment=None)
        causes.setdefault(binding.location.joint, []).append(f"{side}{location}")
    rows = [("radius", f"{1000 * segment.radius:.1f} mm", "; ".join(causes.get(None, [])))]
    for name, (lower, upper) in segment.joint_ranges.items():
        rows.append((name, f"[{lower:.3f}, {upper:.3f}]", "; ".join(causes.get(name, []))))
    return rows


def patterns_text(problem: PlanningProblem, survey: PatternSurvey) -> str:
    """Return sign patterns as a table, and the suggested pattern."""
    table = Table(title=f"{problem.name}: configurations by segment", title_justify="left")
    for heading in ("segment", "signs", "reachable", "free", "radius up to", "why not"):
        table.add_column(heading)
    for row in survey.rows:
        signs = ", ".join(f"{name} {sign}" for name, sign in row.signs.items())
        radius = "" if row.radius is None else f"{1000 * row.radius:.0f} mm"
        verdicts = ["yes" if holds else "no" for holds in (row.reachable, row.free)]
        table.add_row(str(row.segment), signs, *verdicts, radius, escape(row.message))
    return f"{rendered(table)}\n{survey.message}"
