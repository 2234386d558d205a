"""The command that measures how wide a tube may be."""

from pathlib import Path

import click

from tubeplanner.console import (
    AS_JSON,
    INFEASIBLE,
    PATH,
    SUCCESS,
    empty_report,
    load_timed,
    nowhere,
    print_json,
    shown_progress,
)


@click.command()
@click.argument("problem")
@click.option("-o", "--output", type=PATH, help="Problem file with the measured tube.")
@click.option(
    "--max-radius", type=float, default=0.2, show_default=True, help="No radius is larger [m]."
)
@click.option("--seed", type=int, default=0, show_default=True, help="Of the random numbers.")
@AS_JSON
def measure(
    problem: str, output: Path | None, max_radius: float, seed: int, as_json: bool
) -> int:
    """Measure how wide the tube of PROBLEM may be: radii and joint ranges without a collision.

    The file's own radii do not count; its joint signs and its start choose the configuration.
    """
    from tubeplanner.output_files import require_writable, write_files
    from tubeplanner.problem_file import with_other_tube
    from tubeplanner.resources import find_problem
    from tubeplanner.tube_measurement import MeasureOptions, measure_tube

    options = MeasureOptions(max_radius, seed=seed)
    outputs = [] if output is None else [output]
    require_writable(outputs, [Path(problem)])
    with shown_progress() as enter:
        loaded, loading_time = load_timed(problem, enter)
        source = find_problem(problem, Path())
        require_writable(outputs, [source, loaded.robot.urdf.path])
        result = measure_tube(loaded, options, enter)
    if output is not None and result.problem is not None:
        write_files({output: with_other_tube(source, output, result.problem.tube)})
    if as_json:
        fields = {**empty_report("", "", nowhere()), **result.as_dict()}
        print_json({**fields, "loading_time": loading_time})
    else:
        from tubeplanner.report import measurement_text

        print(measurement_text(loaded, result, loading_time))
        if output is not None and result.succeeded:
            print(f"problem: {output}")
    return SUCCESS if result.succeeded else INFEASIBLE
