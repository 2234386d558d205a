"""The commands that study plans: figures, sweeps over the tolerance, comparisons of methods."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from tubeplanner.commands.console import (
    AS_JSON,
    FOLDER,
    INFEASIBLE,
    PATH,
    SLACK,
    SUCCESS,
    empty_report,
    load_timed,
    nowhere,
    print_json,
    say,
    shown_progress,
)
from tubeplanner.errors import OptionError

if TYPE_CHECKING:
    from tubeplanner.studies.comparison import Comparison
    from tubeplanner.studies.tolerance_sweep import SweepResult

_INTERRUPTED = "; interrupted, the others were not tried"


@click.command()
@click.argument("problem")
@click.argument("trajectory", type=PATH)
@click.option("-o", "--output", type=PATH, help="Figure (PNG) [default: beside TRAJECTORY].")
@AS_JSON
def plot(problem: str, trajectory: Path, output: Path | None, as_json: bool) -> int:
    """Draw the TRAJECTORY file against the limits and the tube of PROBLEM.

    Without -o the figure goes next to the trajectory, under its name with the ending .png.
    """
    from tubeplanner.files.file_notes import notes_on_file
    from tubeplanner.files.output_files import require_writable
    from tubeplanner.files.trajectory_file import read_trajectory_file
    from tubeplanner.views.plotting import plot_trajectory

    target = output or trajectory.with_suffix(".png")
    _require_ending(target, "-o", (".png",))
    read = read_trajectory_file(trajectory)
    require_writable([target], [trajectory, Path(problem)])
    with shown_progress() as enter:
        loaded, loading_time = load_timed(problem, enter)
        require_writable([target], [loaded.robot.urdf.path])
        enter("drawing")
        plot_trajectory(loaded, read.trajectory, target)
    notes = notes_on_file(loaded, read, failed=False)
    duration = read.trajectory.duration
    if as_json:
        report = empty_report("success", "drawn, not judged", nowhere())
        more = {"duration": duration, "loading_time": loading_time, "notes": notes}
        print_json({**report, **more, "plot": str(target)})
    else:
        say(*(f"note: {note}" for note in notes), sep="\n", end="\n" if notes else "")
        say(f"plot: {target} ({duration:.4f} s)")
    return SUCCESS


@click.command()
@click.argument("problem")
@click.option("--radius", help="Radii for all segments [m], such as 0.005,0.01,0.02.")
@click.option("--radius-scale", help="Factors for the problem's radii and boxes, such as 0.5,1,2.")
@click.option("-o", "--output", type=PATH, help="Table (CSV or JSON, by its ending).")
@click.option("--plot", "figure", type=PATH, help="Figure (PNG).")
@click.option("--quality", default="balanced", show_default=True, help="fast, balanced or best.")
@SLACK
@AS_JSON
def sweep(
    problem: str,
    radius: str | None,
    radius_scale: str | None,
    output: Path | None,
    figure: Path | None,
    quality: str,
    slack: float | None,
    as_json: bool,
) -> int:
    """Plan PROBLEM at several tolerances: how much time does each millimetre buy?

    Exit status 0 if any of them has a certified trajectory; the other rows say why not.
    """
    from tubeplanner.files.output_files import require_writable
    from tubeplanner.planning.plan_options import PlanOptions
    from tubeplanner.studies.tolerance_sweep import sweep as sweep_problem

    if (radius is None) == (radius_scale is None):
        raise OptionError("sweep takes either --radius or --radius-scale")
    radii, scales = _numbers("--radius", radius), _numbers("--radius-scale", radius_scale)
    options = PlanOptions(quality=quality, slack=slack)
    outputs = [path for path in (output, figure) if path is not None]
    _require_ending(output, "-o", (".csv", ".json"))
    _require_ending(figure, "--plot", (".png",))
    require_writable(outputs, [Path(problem)])
    with shown_progress() as enter:
        loaded, loading_time = load_timed(problem, enter)
        require_writable(outputs, [loaded.robot.urdf.path])
        result = sweep_problem(loaded, radii, scales=scales, options=options, progress=enter)
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
        from tubeplanner.commands.report import sweep_text

        say(sweep_text(result), message, sep="\n")
        say(*(f"{path}" for path in outputs), sep="\n", end="\n" if outputs else "")
    return SUCCESS if result.succeeded else INFEASIBLE


@click.command()
@click.argument("problem")
@click.option("--methods", help="Such as refinement,bang-bang  [default: all].")
@click.option("-o", "--output", type=PATH, help="Table (CSV or JSON, by its ending).")
@click.option("--plot", "figure", type=PATH, help="Figure (PNG).")
@click.option(
    "--trajectories", type=FOLDER, help="Folder for every trajectory (JSON), certified or not."
)
@click.option("--quality", default="balanced", show_default=True, help="fast, balanced or best.")
@SLACK
@AS_JSON
def compare(
    problem: str,
    methods: str | None,
    output: Path | None,
    figure: Path | None,
    trajectories: Path | None,
    quality: str,
    slack: float | None,
    as_json: bool,
) -> int:
    """Plan PROBLEM with every method, and with the schemes that Suh & Bishop compared with.

    Exit status 0 if any of them has a certified trajectory; the others say which conditions fail.
    """
    from tubeplanner.files.output_files import require_writable
    from tubeplanner.planning.plan_options import PlanOptions
    from tubeplanner.studies.comparison import compare as compare_methods

    options = PlanOptions(quality=quality, slack=slack)
    names = None if methods is None else [name.strip() for name in methods.split(",")]
    outputs = [path for path in (output, figure) if path is not None]
    _require_ending(output, "-o", (".csv", ".json"))
    _require_ending(figure, "--plot", (".png",))
    require_writable(outputs, [Path(problem)])
    if trajectories is not None:
        require_writable(
            [trajectories / "trajectory.json" if trajectories.is_dir() else trajectories]
        )
    with shown_progress() as enter:
        loaded, loading_time = load_timed(problem, enter)
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
        from tubeplanner.commands.report import comparison_text

        say(comparison_text(result), message, sep="\n")
        say(*(f"{path}" for path in outputs), sep="\n", end="\n" if outputs else "")
    return SUCCESS if certified else INFEASIBLE


def _write_comparison(
    result: "Comparison", output: Path | None, figure: Path | None, folder: Path | None
) -> list[Path]:
    """Write all requested files or none; return the paths of the trajectories."""
    from tubeplanner.files.output_files import write_files
    from tubeplanner.views.comparison_plot import plot_comparison
    from tubeplanner.views.figure_files import figure_png

    contents: dict[Path, bytes] = {}
    if output is not None:
        contents[output] = _table(result, output)
    if figure is not None:
        contents[figure] = figure_png(plot_comparison(result))
    trajectories = {} if folder is None else _trajectory_files(result, folder)
    write_files({**contents, **trajectories})
    return list(trajectories)


def _trajectory_files(result: "Comparison", folder: Path) -> dict[Path, bytes]:
    """Return every trajectory as a trajectory file that says whether it is certified."""
    from tubeplanner.files.export import trajectory_json
    from tubeplanner.files.fingerprint import origin
    from tubeplanner.files.output_files import make_folder

    make_folder(folder)
    files = {}
    for row in result.rows:
        if row.trajectory is not None:
            verdict = {"certified": row.certified, "failures": row.as_dict()["failures"]}
            more = {**origin(result.problem, row.answered_by or row.method), **verdict}
            files[folder / f"{row.method}.json"] = trajectory_json(row.trajectory, **more).encode()
    return files


def _table(result: "Comparison | SweepResult", path: Path) -> bytes:
    """Return a table as its file holds it: CSV or JSON, by the ending."""
    import json

    if path.suffix.lower() == ".csv":
        return result.csv().encode()
    return (json.dumps(result.as_dict(), allow_nan=False) + "\n").encode()


def _write_sweep(result: "SweepResult", output: Path | None, figure: Path | None) -> None:
    from tubeplanner.files.output_files import write_files
    from tubeplanner.views.figure_files import figure_png
    from tubeplanner.views.study_plots import plot_sweep

    contents: dict[Path, bytes] = {}
    if output is not None:
        contents[output] = _table(result, output)
    if figure is not None:
        contents[figure] = figure_png(plot_sweep(result))
    write_files(contents)


def _numbers(option: str, text: str | None) -> list[float] | None:
    if text is None:
        return None
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        raise OptionError(f"{option} '{text}' is no list of numbers with commas between") from None


def _require_ending(path: Path | None, option: str, endings: tuple[str, ...]) -> None:
    if path is not None and path.suffix.lower() not in endings:
        raise OptionError(f"{option} {path}: name a file that ends in {' or '.join(endings)}")
