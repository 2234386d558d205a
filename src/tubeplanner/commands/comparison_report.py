"""A comparison of methods as text for a terminal."""

from textwrap import fill
from typing import TYPE_CHECKING

from rich.table import Table

from tubeplanner.commands.report import fits, rendered, terminal
from tubeplanner.verification.judged_condition import RELATIVE

if TYPE_CHECKING:
    from tubeplanner.studies.comparison import Comparison, ComparisonRow
    from tubeplanner.verification.judged_condition import JudgedCondition

_MEASURED = ("planned in", "smooth", "peak jerk", "at a limit", "tube used")
_MANY = 999.5  # [%]: from here on three digits would be a power of ten


def comparison_text(result: "Comparison") -> str:
    """Return a comparison as a table and the rows' messages, as wide as the terminal.

    In a narrow terminal measures are left out, the last ones first.
    """
    for count in range(len(_MEASURED), -1, -1):
        table = _table(result, count)
        if fits(table):
            break
    lines = rendered(table).splitlines()
    if count < len(_MEASURED):
        names = ", ".join(_MEASURED[count:])
        lines.append(f"left out, the terminal being narrow: {names}; -o TABLE.csv has all")
    lines += [f"{row.method}: {row.message}" for row in result.rows]
    return "\n".join(_broken(line) for line in lines)


def _table(result: "Comparison", count: int) -> Table:
    """Return a comparison as a table with so many of the measures."""
    table = Table(title=f"{result.problem.name}: methods compared", title_justify="left")
    table.add_column("method", no_wrap=True)
    table.add_column("duration", justify="right", no_wrap=True)
    table.add_column("certificate")
    for heading in _MEASURED[:count]:
        table.add_column(heading, justify="right", no_wrap=True)
    for row in result.rows:
        duration = "" if row.duration is None else f"{row.duration:.4f} s"
        table.add_row(row.method, duration, _verdict(row), *_measures(row)[:count])
    return table


def _verdict(row: "ComparisonRow") -> str:
    """Return what is said of a row's certificate, a failed condition on a line."""
    if row.duration is None:
        return str(row.status).replace("_", " ")
    failed = [f"{name} {_excess(found)}" for name, found in row.failures.items()]
    return "FAILS: " + ",\n".join(failed) if failed else "passes"


def _measures(row: "ComparisonRow") -> list[str]:
    """Return the cells of `_MEASURED`."""
    spent, measured = f"{row.planning_time:.2f} s", row.measures
    if measured is None:
        return [spent]
    jerk = "unbounded" if measured.peak_jerk is None else f"{measured.peak_jerk:.2g}"
    shares = (f"{100 * share:.0f} %" for share in (measured.at_limit, measured.tube_use))
    return [spent, measured.smoothness, jerk, *shares]


def _excess(condition: "JudgedCondition") -> str:
    """Return by how much a trajectory violates a condition, with its unit."""
    missed = -(condition.margin or 0.0)
    if condition.unit != RELATIVE:
        return f"{missed:.3g} {condition.unit}"
    percent = 100 * missed
    return f"{percent:.3g} %" if percent < _MANY else f"{percent:.0f} %"


def _broken(line: str) -> str:
    """Return a line, broken between words and indented there if it is wider than the terminal."""
    width = terminal().width
    if len(line) <= width:
        return line
    return fill(line, width, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)
