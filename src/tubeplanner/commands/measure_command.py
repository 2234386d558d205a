"""The command that measures how wide a tube may be, and in which configurations of the arm."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tubeplanner.commands.answer_files import write_answer
from tubeplanner.commands.console import (
    AS_JSON,
    INFEASIBLE,
    PATH,
    SET,
    SUCCESS,
    empty_report,
    load_timed,
    nowhere,
    print_json,
    say,
    say_unwritten,
    shown_progress,
)
from tubeplanner.commands.interrupts import hold_interrupts
from tubeplanner.errors import OptionError

if TYPE_CHECKING:
    from tubeplanner.measurement.measured_tube import MeasureOptions


@click.command()
@click.argument("problem")
@click.option("-o", "--output", type=PATH, help="Problem file with the measured tube.")
@click.option(
    "--max-radius", type=float, default=0.2, show_default=True, help="No radius is larger [m]."
)
@click.option(
    "--configurations", is_flag=True, help="Which signs of joints are reachable and free, instead."
)
@click.option("--seed", type=int, default=0, show_default=True, help="Of the random numbers.")
@click.option(
    "--max-segments",
    type=int,
    default=20,
    show_default=True,
    help="Refuse a tube of more: each takes one to two seconds.",
)
@SET
@AS_JSON
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
    """Measure how wide the tube of PROBLEM may be: radii and joint ranges without a collision.

    Ignores the file's own radii; its joint signs and its start select the configuration.
    """
    from tubeplanner.measurement.measured_tube import MeasureOptions

    options = MeasureOptions(max_radius, seed=seed, max_segments=max_segments)
    if configurations and output is not None:
        raise OptionError("--configurations compares and writes no file; leave out one of them")
    if configurations:
        return _compare(problem, options, changes, as_json)
    return _measure(problem, options, changes, output, as_json)


def _measure(
    problem: str,
    options: "MeasureOptions",
    changes: dict[str, Any],
    output: Path | None,
    as_json: bool,
) -> int:
    from tubeplanner.files.output_files import require_writable
    from tubeplanner.files.problem_file import with_other_tube
    from tubeplanner.measurement.tube_measurement import measure_tube
    from tubeplanner.problem.problem_layers import ProblemLayers
    from tubeplanner.resources import find_problem

    outputs = [] if output is None else [output]
    require_writable(outputs, [Path(problem)])
    with shown_progress() as enter:
        loaded, loading_time = load_timed(problem, enter, changes)
        source = find_problem(problem, Path())
        require_writable(outputs, [*ProblemLayers.read(source).files, loaded.robot.urdf.path])
        result = measure_tube(loaded, options, enter)
    if output is not None and result.problem is not None:
        hold_interrupts()
        contents = with_other_tube(source, output, result.problem.tube, changes)
        write_answer({output: contents})
    if as_json:
        fields = {**empty_report("", "", nowhere()), **result.as_dict()}
        print_json({**fields, "loading_time": loading_time})
    else:
        from tubeplanner.commands.report import measurement_text

        say(measurement_text(loaded, result, loading_time))
        if output is not None and result.succeeded:
            say(f"problem: {output}")
        elif result.succeeded:
            say_unwritten("-o PROBLEM.yaml")
    return SUCCESS if result.succeeded else INFEASIBLE


def _compare(
    problem: str, options: "MeasureOptions", changes: dict[str, Any], as_json: bool
) -> int:
    from tubeplanner.measurement.sign_patterns import survey_patterns

    with shown_progress() as enter:
        loaded, loading_time = load_timed(problem, enter, changes)
        survey = survey_patterns(loaded, options, enter)
    if as_json:
        fields = {**empty_report("", "", nowhere()), **survey.as_dict()}
        print_json({**fields, "loading_time": loading_time})
    else:
        from tubeplanner.commands.report import patterns_text

        say(patterns_text(loaded, survey))
    return SUCCESS if survey.suggested is not None else INFEASIBLE
