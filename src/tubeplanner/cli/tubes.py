"""`measure`, `route`, `teach`: tubes from obstacles, from start and goal, or from a trail."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import click
from rich.markup import escape

from tubeplanner.cli import console
from tubeplanner.cli.report import bound_lines, new_table, rendered
from tubeplanner.errors import OptionError
from tubeplanner.output.files.new_problem_files import notes_on_dropped, read_cell, taught_problem
from tubeplanner.output.files.problem_file import (
    included_fields,
    read_fields,
    with_other_tube,
    with_problem,
)
from tubeplanner.output.files.trajectory_writer import FORMATS, ExportedMotion
from tubeplanner.resources import find_problem
from tubeplanner.robot.notes import unlimited_notes
from tubeplanner.studies.tubes.measurement import PatternSurvey, measure_tube, survey_patterns
from tubeplanner.studies.tubes.planned_tube import PlannedTube, TubeAnswer
from tubeplanner.studies.tubes.route import RouteOptions, find_route
from tubeplanner.studies.tubes.segment_measurement import (
    MeasureOptions,
    SegmentMeasurement,
    TubeMeasurement,
)
from tubeplanner.studies.tubes.teach import TeachOptions
from tubeplanner.studies.tubes.teach import teach as teach_tube
from tubeplanner.task.includes import ProblemLayers
from tubeplanner.task.info import problem_doubts
from tubeplanner.task.motion import ProblemMotion
from tubeplanner.task.problem import PlanningProblem

_OUTPUT = click.option("-o", "--output", type=console.PATH, help="Problem file with the tube.")
_MAX_RADIUS = click.option(
    "--max-radius", type=float, default=0.2, show_default=True, help="Largest radius [m]."
)
_SAMPLES = click.option(
    "--samples",
    type=int,
    default=2000,
    show_default=True,
    help="Number of random configurations per segment in the last test.",
)
_SEED = click.option("--seed", type=int, default=1, show_default=True, help="Random seed.")


@click.command()
@click.argument("problem")
@click.option("-o", "--output", type=console.PATH, help="Problem file with the measured tube.")
@_MAX_RADIUS
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
    files = console.OutputFiles(
        console.Request("problem", output, "-o PROBLEM.yaml"), inputs=[problem]
    )
    with console.shown_progress() as enter:
        loaded, loading_time = console.load_timed(problem, enter, changes)
        source = find_problem(problem, Path())
        files.spare([*ProblemLayers.read(source).files, loaded.robot.urdf.path])
        result = measure_tube(loaded, options, enter)
    if result.problem is not None:
        tube = result.problem.tube
        files.write({"problem": lambda target: with_other_tube(source, target, tube, changes)})
    if as_json:
        fields = {**console.empty_report("", ""), **result.as_dict()}
        console.print_json({**fields, "loading_time": loading_time})
    else:
        console.say(measurement_text(loaded, result, loading_time))
        if result.succeeded:
            files.say()
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


@click.command()
@click.argument("problem")
@click.option("-o", "--output", type=console.PATH, help="Problem file with the route.")
@click.option("--trajectory", type=console.PATH, help="Write the motion (JSON).")
@_SEED
@click.option(
    "--edges", type=int, default=300_000, show_default=True, help="Edges that the search tests."
)
@_MAX_RADIUS
@_SAMPLES
@click.option("--time-limit", type=float, help="Stop after this time [s], with the best so far.")
@click.option(
    "--measured",
    type=console.PATH,
    help="Write the problem file with the measured, collision-free tube.",
)
@console.SET
@console.AS_JSON
def route(
    problem: str,
    output: Path | None,
    trajectory: Path | None,
    seed: int,
    edges: int,
    max_radius: float,
    samples: int,
    time_limit: float | None,
    measured: Path | None,
    changes: dict[str, Any],
    as_json: bool,
) -> int:
    """Find the fastest motion for PROBLEM from start, goal and obstacles alone.

    PROBLEM needs no tube; its goal may be a pose or a position of the tool. --trajectory writes the
    motion; -o writes a problem file with a joint route, of which `plan` makes that motion.
    --measured measures a tube about the motion in which nothing collides, and writes its problem.
    """
    options = RouteOptions(
        seed,
        edges,
        max_radius=max_radius,
        samples=samples,
        time_limit=time_limit,
        measures=measured is not None,
    )
    _require_none_of(changes, ("tube",), "route")
    files = console.OutputFiles(
        console.Request("problem", output, "-o PROBLEM.yaml"),
        console.Request("measured", measured),
        console.Request("trajectory", trajectory),
        inputs=[problem],
    )
    with console.shown_progress() as enter:
        loaded, loading_time = console.load_timed(problem, enter, changes, reads_tube=False)
        source = find_problem(problem, Path())
        files.spare([*ProblemLayers.read(source).files, loaded.robot.urdf.path])
        answer = find_route(loaded, options, enter)
    fields = read_fields(source, changes)
    tube = included_fields(fields, source.parent, source).get("tube")
    replaced = {"tube": tube} if isinstance(tube, dict) else {}
    notes = notes_on_dropped(replaced, (), "the tube is a new one")
    answer = replace(answer, notes=(*answer.notes, *notes))
    own = {} if answer.answer is None else {"trajectory": _motion_content(answer.answer)}
    tubes = {"problem": answer.answer, "measured": answer.measured}
    _write(files, fields, source.parent, own, **tubes)
    if measured is not None and answer.succeeded and answer.measured is None:
        note = f"{measured} was not written: there is no measured tube"
        answer = replace(answer, notes=(*answer.notes, note))
    return _print_answer(loaded, answer, loading_time, files, as_json)


@click.command()
@click.argument("trail", type=console.INPUT)
@click.option("--urdf", help="Robot description: a path, package://PKG/... or example:NAME.")
@click.option("--tool-frame", help="Link that carries the tool.")
@click.option("--obstacles", type=console.PATH, help="File with obstacles, as in a problem file.")
@click.option("--problem", "template", help="Problem file: all but tube, start, goal.")
@_OUTPUT
@click.option(
    "--deviation",
    type=float,
    default=0.01,
    show_default=True,
    help="Largest distance of the trail from lines between reference points [m].",
)
@click.option(
    "--band", type=float, default=0.3, show_default=True, help="Margin beyond the trail [rad, m]."
)
@_MAX_RADIUS
@_SAMPLES
@_SEED
@console.SET
@console.AS_JSON
def teach(
    trail: Path,
    urdf: str | None,
    tool_frame: str | None,
    obstacles: Path | None,
    template: str | None,
    output: Path | None,
    deviation: float,
    band: float,
    max_radius: float,
    samples: int,
    seed: int,
    changes: dict[str, Any],
    as_json: bool,
) -> int:
    """Make a tube from TRAIL, a recorded motion of the joints, and plan through the tube.

    TRAIL is a file that `check` reads: CSV with time and JOINT.position, or a ROS
    JointTrajectory. --urdf and --tool-frame give the robot; --problem gives the robot, its limits
    and obstacles.
    """
    if (template is None) == (urdf is None or tool_frame is None):
        raise OptionError("teach takes either --urdf and --tool-frame, or --problem")
    if template is not None and (obstacles is not None or urdf or tool_frame):
        raise OptionError("--problem has robot and obstacles; leave out the other options for them")
    if template is None and changes:
        raise OptionError("--set changes the file of --problem; give one")
    _require_none_of(changes, ("tube", "start", "goal"), "TRAIL")
    options = TeachOptions(deviation, band, max_radius, samples, seed)
    inputs = [name for name in (trail, urdf, obstacles, template) if name is not None]
    files = console.OutputFiles(
        console.Request("problem", output, "-o PROBLEM.yaml"), inputs=inputs
    )
    cell = read_cell(urdf, tool_frame, obstacles, template, changes)
    with console.shown_progress() as enter:
        enter("loading robot and collision geometry")
        loaded, recorded, duration, notes = taught_problem(cell, trail)
        files.spare([loaded.robot.urdf.path])
        answer = teach_tube(loaded, recorded, options, enter)
    answer = replace(answer, notes=(*notes, *answer.notes), recorded_duration=duration)
    _write(files, cell.fields, cell.folder, {}, problem=answer.answer)
    return _print_answer(loaded, answer, None, files, as_json)


def _require_none_of(changes: Iterable[str], unread: tuple[str, ...], source: str) -> None:
    """Raise OptionError if --set changes a field that the command does not read."""
    for path in changes:
        if path.split(".")[0] in unread:
            raise OptionError(f"--set {path}: {source} gives {', '.join(unread)}; leave it out")


def _write(
    files: console.OutputFiles,
    fields: Any,
    folder: Path,
    contents: Mapping[str, Callable[[Path], bytes]],
    **tubes: PlannedTube | None,
) -> None:
    """Write contents and the problems of tubes, by the kinds of their files."""
    problems = {kind: tube.problem for kind, tube in tubes.items() if tube is not None}
    content = partial(with_problem, fields, folder)
    files.write({**{k: partial(content, problem=each) for k, each in problems.items()}, **contents})


def _motion_content(planned: PlannedTube) -> Callable[[Path], bytes]:
    """Return the function that makes the content of a motion's file."""
    trajectory, result = planned.result.trajectory, planned.result
    assert trajectory is not None
    motion = ExportedMotion(ProblemMotion(planned.problem, trajectory), result.method)
    return partial(FORMATS[0].content, motion)


def _print_answer(
    problem: PlanningProblem,
    answer: TubeAnswer,
    loading_time: float | None,
    files: console.OutputFiles,
    as_json: bool,
) -> int:
    """Print an answer and the written files by kind; return the exit status."""
    doubts = (*problem_doubts(problem), *unlimited_notes(problem.robot))
    answer = replace(answer, notes=(*doubts, *answer.notes))
    if as_json:
        fields = {**console.empty_report("", ""), **answer.as_dict()}
        fields["notes"] = list(dict.fromkeys(fields["notes"]))  # those of the plan come again
        fields |= {"loading_time": loading_time, "problem": files.path_text("problem")}
        console.print_json(fields)
    else:
        console.say(tube_text(problem.name, answer))
        if answer.succeeded or files.written:
            files.say()
    return console.SUCCESS if answer.succeeded else console.INFEASIBLE


def tube_text(name: str, answer: TubeAnswer) -> str:
    """Return the result of a search for a tube as text, after the name of the problem."""
    lines = [f"{name}: searched for {answer.search_time:.1f} s"]
    if answer.first_answer_time is not None:
        lines.append(
            f"first certified motion after {answer.first_answer_time:.1f} s; {answer.routes} "
            f"route{'s' * (answer.routes != 1)} by {answer.edges} edges"
        )
    tube = None if answer.answer is None else answer.answer.problem.tube
    if tube is not None and tube.route is not None:
        for k, q in enumerate(tube.route):
            lines.append(f"route, configuration {k}: [{', '.join(f'{x:.4f}' for x in q)}]")
    elif tube is not None:
        for k, (point, radius) in enumerate(zip(tube.points, [*tube.radius, None], strict=True)):
            location = ", ".join(f"{x:.4f}" for x in point)
            width = "" if radius is None else f", then a radius of {1000 * radius:.1f} mm"
            lines.append(f"point {k}: [{location}] m{width}")
    if answer.measured is not None and answer.measured is not answer.answer:
        radii = ", ".join(f"{1000 * radius:.1f}" for radius in answer.measured.problem.tube.radius)
        lines.append(
            f"measured tube, in which nothing collides: {answer.measured.duration:.4f} s at slack "
            f"0, within radii of {radii} mm"
        )
    lines += [f"note: {note}" for note in answer.notes]
    lines.append(f"{answer.status}: {answer.message}")
    lines += [] if answer.answer is None else bound_lines(answer.answer.result)
    if answer.answer is not None and answer.recorded_duration is not None:
        before, after = answer.recorded_duration, answer.answer.duration
        lines.append(
            f"recorded {before:.3f} s -> planned {after:.3f} s, {abs(1 - after / before):.1%} "
            f"{'less' if after <= before else 'more'}"
        )
    location = str(answer.location)
    return "\n".join([*lines, f"where: {location}"] if location else lines)


def measurement_text(problem: PlanningProblem, result: TubeMeasurement, loading_time: float) -> str:
    """Return a measured tube as a table of its bounds and their causes, and the sample counts."""
    lines = [
        f"{problem.name}: {problem.robot.name}, loaded in {loading_time:.2f} s, measured in "
        f"{result.measuring_time:.1f} s"
    ]
    if result.succeeded:
        table = new_table("Measured tube", "segment", "bound", "largest", "ended by")
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
    headings = ("segment", "signs", "reachable", "free", "radius up to", "why not")
    table = new_table(f"{problem.name}: configurations by segment", *headings)
    for row in survey.rows:
        signs = ", ".join(f"{name} {sign}" for name, sign in row.signs.items())
        radius = "" if row.radius is None else f"{1000 * row.radius:.0f} mm"
        verdicts = ["yes" if holds else "no" for holds in (row.reachable, row.free)]
        table.add_row(str(row.segment), signs, *verdicts, radius, escape(row.message))
    return f"{rendered(table)}\n{survey.message}"
