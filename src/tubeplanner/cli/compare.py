"""`compare`: all methods on one problem."""

from pathlib import Path
from textwrap import TextWrapper
from typing import Any

import click
from rich.table import Table

from tubeplanner.certificate.judged_motion import RELATIVE, JudgedCondition
from tubeplanner.cli import console
from tubeplanner.cli.report import fits, rendered, terminal
from tubeplanner.output.figures.study_figures import plot_comparison
from tubeplanner.output.files.fingerprint import origin
from tubeplanner.output.files.trajectory_writer import trajectory_json
from tubeplanner.planning.options import PlanOptions
from tubeplanner.studies.comparison import Comparison
from tubeplanner.studies.comparison import compare as compare_methods
from tubeplanner.writing import require_writable

_MEASURED = ("planned in", "smooth", "peak jerk", "at a limit", "tube used", "in band")
_MANY = 999.5  # [%]: from here on three digits would be a power of ten


@click.command()
@click.argument("problem")
@click.option("--methods", help="Methods, such as refinement,bang-bang [default: all].")
@click.option("-o", "--output", type=console.PATH, help="Write the table (CSV or JSON).")
@click.option("--plot", "figure", type=console.PATH, help="Draw the figure (PNG, PDF or SVG).")
@click.option(
    "--trajectories",
    type=console.FOLDER,
    help="Write every trajectory (JSON), certified or not, to this folder.",
)
@click.option("--quality", default="balanced", show_default=True, help="fast, balanced or best.")
@console.SLACK
@console.SET
@console.AS_JSON
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
    """Plan PROBLEM with every method and with the baselines of Suh & Bishop (1988).

    The table names the conditions that fail. Exit status 0 if any trajectory is certified.
    """
    options = PlanOptions(quality=quality, slack=slack)
    console.require_used(changes, slack)
    names = None if methods is None else [name.strip() for name in methods.split(",")]
    files = console.TableFiles(output, figure, problem)
    if trajectories is not None:
        require_writable(
            [trajectories / "trajectory.json" if trajectories.is_dir() else trajectories]
        )
    with console.shown_progress() as enter:
        loaded, loading_time = console.load_timed(problem, enter, changes)
        files.spare([loaded.robot.urdf.path])
        result = compare_methods(loaded, names, options=options, progress=enter)
        motions = _motions(result, trajectories)
        files.write_result(result, plot_comparison, *motions, folder=trajectories)
    certified = sum(row.certified for row in result.rows)
    message = f"{certified} of {len(result.rows)} certified"
    message += console.OTHERS_NOT_TRIED if result.stopped_by else ""
    text = None if as_json else lambda: comparison_text(result)
    return files.answer(result, message, loading_time, text, "--trajectories")


def _motions(result: Comparison, folder: Path | None) -> list[console.Output]:
    """Return the files of the trajectories; none without a folder."""
    rows = {} if folder is None else {folder / f"{row.method}.json": row for row in result.rows}
    rows = {path: row for path, row in rows.items() if row.trajectory is not None}

    def trajectory(path: Path) -> bytes:
        row = rows[path]
        assert row.trajectory is not None
        verdict = {"certified": row.certified, "failures": row.as_dict()["failures"]}
        more = {**origin(result.problem, row.answered_by or row.method), **verdict}
        return trajectory_json(row.trajectory, **more).encode()

    return [console.Output("trajectory", path, trajectory) for path in rows]


def comparison_text(result: Comparison) -> str:
    """Return a comparison as a table and the rows' messages, as wide as the terminal.

    In a narrow terminal the last measures are left out.
    """
    most = len(_MEASURED) - (not result.problem.tube.stretches)
    for count in range(most, -1, -1):
        table = _table(result, count)
        if fits(table):
            break
    lines = rendered(table).splitlines()
    if count < most:
        names = ", ".join(_MEASURED[count:most])
        lines.append(f"left out, the terminal being narrow: {names}; -o TABLE.csv has all")
    durations = [row.duration for row in result.rows if row.certified and row.duration is not None]
    if least := result.bound.beside(min(durations, default=0.0)):
        lines.append(f"{least}: {result.bound.reason}")
    lines += [f"{row.method}: {row.message}" for row in result.rows]
    width = terminal().width  # lines that fit stay unchanged, with their runs of spaces
    wrap = TextWrapper(
        width, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
    )
    return "\n".join(line if len(line) <= width else wrap.fill(line) for line in lines)


def _table(result: Comparison, count: int) -> Table:
    """Return a comparison as a table with the first `count` of the measures."""
    table = Table(title=f"{result.problem.name}: methods compared", title_justify="left")
    table.add_column("method", no_wrap=True)
    table.add_column("duration", justify="right", no_wrap=True)
    table.add_column("certificate")
    for heading in _MEASURED[:count]:
        table.add_column(heading, justify="right", no_wrap=True)
    for row in result.rows:
        if row.duration is None:
            duration, verdict = "", str(row.status).replace("_", " ")
        else:
            duration = f"{row.duration:.4f} s"
            failed = [f"{name} {_excess(condition)}" for name, condition in row.failures.items()]
            verdict = "FAILS: " + ",\n".join(failed) if failed else "passes"
        cells = [f"{row.planning_time:.2f} s"]
        if (own := row.measures) is not None:
            jerk = "unbounded" if own.peak_jerk is None else f"{own.peak_jerk:.2g}"
            fractions = (f"{100 * value:.0f} %" for value in (own.at_limit, own.tube_use))
            cells += [own.smoothness, jerk, *fractions]
            cells += [] if own.in_band is None else [f"{100 * own.in_band:.1f} %"]
        table.add_row(row.method, duration, verdict, *cells[:count])
    return table


def _excess(condition: JudgedCondition) -> str:
    """Return the violation of a condition, with its unit."""
    excess = -(condition.margin or 0.0)
    if condition.unit != RELATIVE:
        return f"{excess:.3g} {condition.unit}"
    percent = 100 * excess
    return f"{percent:.3g} %" if percent < _MANY else f"{percent:.0f} %"
