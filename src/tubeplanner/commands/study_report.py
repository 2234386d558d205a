"""What came of a study, as text for a terminal."""

import re

from rich.markup import escape
from rich.table import Table

from tubeplanner.commands.report import rendered
from tubeplanner.options import in_figures, is_number
from tubeplanner.problem.field_paths import factor_of
from tubeplanner.studies.json_values import value_text
from tubeplanner.studies.study_result import StudyResult
from tubeplanner.studies.study_row import StudyRow

_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
_MOST_REASONS = 12


def study_text(result: StudyResult) -> str:
    """Return how many points ended how, why the others have no plan, and the shortest."""
    name, count = result.study.name, len(result.study.points)
    table = Table(title=f"{name}: {count} points", title_justify="left")
    table.add_column("status")
    table.add_column("points", justify="right")
    table.add_column("for example")
    for status, example, points in _groups(result.rows)[:_MOST_REASONS]:
        table.add_row(status, str(points), escape(example))
    lines = [rendered(table)]
    if hidden := _groups(result.rows)[_MOST_REASONS:]:
        points = sum(points for *_, points in hidden)
        lines.append(f"and {points} points for {len(hidden)} other reasons")
    if (shortest := result.shortest) is not None:
        lines.append(f"shortest: {shortest.duration:.4f} s at {_values_of(shortest)}")
    return "\n".join(lines)


def _groups(rows: tuple[StudyRow, ...]) -> list[tuple[str, str, int]]:
    """Return statuses with an example and a count; reasons that differ in numbers are the same."""
    groups: dict[tuple[str, str], list[StudyRow]] = {}
    for row in rows:
        reason = "" if row.duration is not None else _NUMBER.sub("#", row.message)
        groups.setdefault((str(row.status), reason), []).append(row)
    ordered = sorted(groups.items(), key=lambda group: (group[0][0] != "success", -len(group[1])))
    return [(status, _example(found), len(found)) for (status, _), found in ordered]


def _example(rows: list[StudyRow]) -> str:
    durations = [row.duration for row in rows if row.duration is not None]
    if durations:
        return f"{min(durations):.4f} to {max(durations):.4f} s"
    return f"{_values_of(rows[0])}: {rows[0].message}"


def _values_of(row: StudyRow) -> str:
    return ", ".join(f"{path} = {_in_figures(value)}" for path, value in row.values.items())


def _in_figures(value: object) -> str:
    """Return a value as a sentence has it: numbers and factors in six digits."""
    factor = factor_of(value)
    if factor is not None:
        return f"x{factor:g}"
    return in_figures(value) if is_number(value) else value_text(value)
