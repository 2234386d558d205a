"""The commands that study plans: figures, sweeps over any field, comparisons of methods."""

from collections.abc import Callable, Iterable
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tubeplanner.commands.answer_files import write_answer
from tubeplanner.commands.console import (
    AS_JSON,
    FOLDER,
    INFEASIBLE,
    INPUT,
    PATH,
    SET,
    SLACK,
    SUCCESS,
    empty_report,
    load_either_timed,
    load_timed,
    nowhere,
    print_json,
    require_ending,
    say,
    say_unwritten,
    shown_progress,
)
from tubeplanner.commands.interrupts import hold_interrupts
from tubeplanner.commands.workers import processes_option, workers_of
from tubeplanner.errors import OptionError

if TYPE_CHECKING:
    from concurrent.futures import Executor
    from contextlib import AbstractContextManager

    from tubeplanner.cycle.cycle import Cycle
    from tubeplanner.planning.plan_options import PlanOptions
    from tubeplanner.problem.problem import PlanningProblem
    from tubeplanner.studies.comparison import Comparison
    from tubeplanner.studies.field_sweep import FieldSweep
    from tubeplanner.studies.tolerance_sweep import SweepResult
    from tubeplanner.trajectory.trajectory_file import TrajectoryFile

_INTERRUPTED = "; interrupted, the others were not tried"


@click.command()
@click.argument("problem")
@click.argument("trajectory", type=INPUT)
@click.option(
    "-o", "--output", type=PATH, help="Figure (PNG, PDF or SVG) [default: beside TRAJECTORY]."
)
@SET
@AS_JSON
def plot(
    problem: str, trajectory: Path, output: Path | None, changes: dict[str, Any], as_json: bool
) -> int:
    """Draw the TRAJECTORY file against the limits and the tube of PROBLEM, or those of a cycle.

    Without -o the figure goes next to the trajectory, under its name with the ending .png.
    """
    from tubeplanner.files.output_files import require_writable
    from tubeplanner.trajectory.trajectory_file import read_trajectory_file
    from tubeplanner.views.figure_files import require_figure

    target = output or trajectory.with_suffix(".png")
    require_figure(target, "-o")
    require_writable([target], [trajectory, Path(problem)])
    with shown_progress() as enter:
        loaded, loading_time = load_either_timed(problem, enter, changes)
        require_writable([target], [loaded.robot.urdf.path])
        read = read_trajectory_file(trajectory, loaded.robot.joint_names)
        enter("drawing")
        notes, figure = _drawn(loaded, trajectory, read, target)
        enter("writing")
        write_answer({target: figure})
    duration = read.trajectory.duration
    if as_json:
        report = empty_report("success", "drawn, not judged", nowhere())
        more = {"duration": duration, "loading_time": loading_time, "notes": notes}
        print_json({**report, **more, "plot": str(target)})
    else:
        say(*(f"note: {note}" for note in notes), sep="\n", end="\n" if notes else "")
        say(f"plot: {target} ({duration:.4f} s)")
    return SUCCESS


def _drawn(
    loaded: "PlanningProblem | Cycle", path: Path, read: "TrajectoryFile", target: Path
) -> tuple[list[str], bytes]:
    """Return what else is to be known of a trajectory file, and its figure."""
    from tubeplanner.cycle.cycle import Cycle
    from tubeplanner.cycle.motion_of_file import motion_of_file
    from tubeplanner.files.cycle_notes import notes_on_cycle_file
    from tubeplanner.files.file_notes import notes_on_file
    from tubeplanner.views.cycle_plot import plot_cycle
    from tubeplanner.views.figure_files import figure_file
    from tubeplanner.views.plotting import plot_trajectory

    if isinstance(loaded, Cycle):
        figure = plot_cycle(loaded, motion_of_file(loaded, path, read))
        notes = notes_on_cycle_file(loaded, read)
    else:
        figure = plot_trajectory(loaded, read.trajectory)
        notes = notes_on_file(loaded, read, failed=False)
    return notes, figure_file(figure, target)


@click.command()
@click.argument("problem")
@click.option("--radius", help="Radii for all segments [m], such as 0.005,0.01,0.02.")
@click.option("--radius-scale", help="Factors for the problem's radii and boxes, such as 0.5,1,2.")
@click.option(
    "--vary",
    "variations",
    metavar="FIELD.PATH=V1,V2,...",
    multiple=True,
    help="Values of any field, such as robot.payload.mass=0,2,5 or tube.radius=x0.5,x1.",
)
@click.option("-o", "--output", type=PATH, help="Table (CSV or JSON, by its ending).")
@click.option("--plot", "figure", type=PATH, help="Figure (PNG, PDF or SVG).")
@click.option("--quality", default="balanced", show_default=True, help="fast, balanced or best.")
@processes_option("this one, value by value")
@SLACK
@SET
@AS_JSON
def sweep(
    problem: str,
    radius: str | None,
    radius_scale: str | None,
    variations: tuple[str, ...],
    output: Path | None,
    figure: Path | None,
    quality: str,
    processes: int | None,
    slack: float | None,
    changes: dict[str, Any],
    as_json: bool,
) -> int:
    """Plan PROBLEM at several tolerances or values of a field: how much time does each cost?

    Plans the shortest motions, unless --slack or --vary objective.... says otherwise. Exit status 0
    if any of them has a certified trajectory; the other rows say why not.
    """
    from tubeplanner.files.output_files import require_writable
    from tubeplanner.planning.plan_options import PlanOptions
    from tubeplanner.studies.tolerance_sweep import sweep as sweep_problem
    from tubeplanner.views.figure_files import require_figure

    if (radius is not None) + (radius_scale is not None) + bool(variations) != 1:
        raise OptionError("sweep takes either --radius or --radius-scale or --vary")
    options = PlanOptions(quality=quality, slack=slack)
    outputs = [path for path in (output, figure) if path is not None]
    require_ending(output, "-o", (".csv", ".json"))
    require_figure(figure, "--plot")
    require_writable(outputs, [Path(problem)])
    result: SweepResult | FieldSweep
    with shown_progress() as enter, _sweepers(processes) as workers:
        if variations:
            result = _swept_field(problem, variations, changes, options, workers, enter)
            loading_time = sum(row.loading_time for row in result.rows)
        else:
            _require_used(changes, slack)
            radii, scales = _numbers("--radius", radius), _numbers("--radius-scale", radius_scale)
            loaded, loading_time = load_timed(problem, enter, changes)
            require_writable(outputs, [loaded.robot.urdf.path])
            result = sweep_problem(
                *(loaded, radii), scales=scales, options=options, executor=workers, progress=enter
            )
        _write_sweep(result, output, figure)
    status = "success" if result.succeeded else "no_trajectory"
    message = (
        f"{sum(row.duration is not None for row in result.rows)} of {len(result.rows)} planned"
    )
    message += _INTERRUPTED if result.stopped_by else ""
    if as_json:
        report = {**empty_report(status, message, nowhere()), "loading_time": loading_time}
        print_json({**report, **result.as_dict()})
    else:
        say(_sweep_text(result), message, sep="\n")
        _say_files(outputs, "-o TABLE.csv", "--plot")
    return SUCCESS if result.succeeded else INFEASIBLE


@click.command()
@click.argument("problem")
@click.option("--methods", help="Such as refinement,bang-bang  [default: all].")
@click.option("-o", "--output", type=PATH, help="Table (CSV or JSON, by its ending).")
@click.option("--plot", "figure", type=PATH, help="Figure (PNG, PDF or SVG).")
@click.option(
    "--trajectories", type=FOLDER, help="Folder for every trajectory (JSON), certified or not."
)
@click.option("--quality", default="balanced", show_default=True, help="fast, balanced or best.")
@SLACK
@SET
@AS_JSON
def compare(
    problem: str,
    methods: str | None,
    output: Path | None,
    figure: Path | None,
    trajectories: Path | None,
    quality: str,
    slack: float | None,
    changes: dict[str, Any],
    as_json: bool,
) -> int:
    """Plan PROBLEM with every method, and with the schemes that Suh & Bishop compared with.

    Exit status 0 if any of them has a certified trajectory; the others say which conditions fail.
    """
    from tubeplanner.files.output_files import require_writable
    from tubeplanner.planning.plan_options import PlanOptions
    from tubeplanner.studies.comparison import compare as compare_methods
    from tubeplanner.views.figure_files import require_figure

    options = PlanOptions(quality=quality, slack=slack)
    _require_used(changes, slack)
    names = None if methods is None else [name.strip() for name in methods.split(",")]
    outputs = [path for path in (output, figure) if path is not None]
    require_ending(output, "-o", (".csv", ".json"))
    require_figure(figure, "--plot")
    require_writable(outputs, [Path(problem)])
    if trajectories is not None:
        require_writable(
            [trajectories / "trajectory.json" if trajectories.is_dir() else trajectories]
        )
    with shown_progress() as enter:
        loaded, loading_time = load_timed(problem, enter, changes)
        require_writable(outputs, [loaded.robot.urdf.path])
        result = compare_methods(loaded, names, options=options, progress=enter)
        outputs += _write_comparison(result, output, figure, trajectories)
    certified = sum(row.certified for row in result.rows)
    message = f"{certified} of {len(result.rows)} certified"
    message += _INTERRUPTED if result.stopped_by else ""
    if as_json:
        report = empty_report("success" if certified else "no_trajectory", message, nowhere())
        print_json({**report, "loading_time": loading_time, **result.as_dict()})
    else:
        from tubeplanner.commands.comparison_report import comparison_text

        say(comparison_text(result), message, sep="\n")
        _say_files(outputs, "-o TABLE.csv", "--plot", "--trajectories")
    return SUCCESS if certified else INFEASIBLE


def _say_files(written: list[Path], *options: str) -> None:
    """Print the files that were written, each on its line, or which options write some."""
    if written:
        say(*written, sep="\n")
    else:
        say_unwritten(*options)


def _swept_field(
    problem: str,
    variations: tuple[str, ...],
    changes: dict[str, Any],
    options: "PlanOptions",
    executor: "Executor | None",
    progress: Callable[[object], None],
) -> "FieldSweep":
    """Return a sweep over the one field that is varied."""
    from tubeplanner.problem.field_paths import is_of_objective, parse_variation
    from tubeplanner.studies.field_sweep import sweep_field

    if len(variations) > 1:
        raise OptionError(f"--vary {variations[1]}: a sweep varies one field; leave out the others")
    path, values = parse_variation("--vary", variations[0])
    if not is_of_objective(path):
        _require_used(changes, options.slack)
    return sweep_field(
        *(problem, path, values),
        changes=changes,
        options=options,
        executor=executor,
        progress=progress,
    )


def _sweepers(processes: int | None) -> "AbstractContextManager[Executor | None]":
    """Return what plans a sweep; without a number, this process."""
    return nullcontext() if processes is None else workers_of(processes)


def _require_used(changes: Iterable[str], slack: float | None) -> None:
    """Raise if an objective is set that counts for nothing, as marks are the shortest durations."""
    from tubeplanner.problem.field_paths import is_of_objective

    for path in changes:
        if is_of_objective(path) and slack is None:
            raise OptionError(f"--set {path}: without --slack the shortest motions are planned")


def _sweep_text(result: "SweepResult | FieldSweep") -> str:
    from tubeplanner.commands.report import field_sweep_text, sweep_text
    from tubeplanner.studies.field_sweep import FieldSweep

    return field_sweep_text(result) if isinstance(result, FieldSweep) else sweep_text(result)


def _write_comparison(
    result: "Comparison", output: Path | None, figure: Path | None, folder: Path | None
) -> list[Path]:
    """Write all requested files or none; return the paths of the trajectories."""
    from tubeplanner.views.comparison_plot import plot_comparison
    from tubeplanner.views.figure_files import figure_file

    hold_interrupts()
    contents: dict[Path, bytes] = {}
    if output is not None:
        contents[output] = _table(result, output)
    if figure is not None:
        contents[figure] = figure_file(plot_comparison(result), figure)
    trajectories = {} if folder is None else _trajectory_files(result, folder)
    write_answer({**contents, **trajectories}, folder)
    return list(trajectories)


def _trajectory_files(result: "Comparison", folder: Path) -> dict[Path, bytes]:
    """Return every trajectory as a trajectory file that says whether it is certified."""
    from tubeplanner.files.export import trajectory_json
    from tubeplanner.files.origin import origin

    files = {}
    for row in result.rows:
        if row.trajectory is not None:
            verdict = {"certified": row.certified, "failures": row.as_dict()["failures"]}
            more = {**origin(result.problem, row.answered_by or row.method), **verdict}
            files[folder / f"{row.method}.json"] = trajectory_json(row.trajectory, **more).encode()
    return files


def _table(result: "Comparison | SweepResult | FieldSweep", path: Path) -> bytes:
    """Return a table as its file holds it: CSV or JSON, by the ending."""
    import json

    if path.suffix.lower() == ".csv":
        return result.csv().encode()
    return (json.dumps(result.as_dict(), allow_nan=False) + "\n").encode()


def _write_sweep(
    result: "SweepResult | FieldSweep", output: Path | None, figure: Path | None
) -> None:
    from tubeplanner.studies.field_sweep import FieldSweep
    from tubeplanner.views.field_plot import plot_field_sweep
    from tubeplanner.views.figure_files import figure_file
    from tubeplanner.views.study_plots import plot_sweep

    hold_interrupts()
    contents: dict[Path, bytes] = {}
    if output is not None:
        contents[output] = _table(result, output)
    if figure is not None:
        drawn = plot_field_sweep(result) if isinstance(result, FieldSweep) else plot_sweep(result)
        contents[figure] = figure_file(drawn, figure)
    write_answer(contents)


def _numbers(option: str, text: str | None) -> list[float] | None:
    if text is None:
        return None
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        raise OptionError(f"{option} '{text}' is no list of numbers with commas between") from None
