"""Where a robot is to stand, as text for a terminal."""

from math import degrees

from rich.markup import escape
from rich.table import Table

from tubeplanner.commands.report import rendered
from tubeplanner.studies.placement_region import Stand
from tubeplanner.studies.placement_result import Placement

_MOST_REASONS = 12


def placement_text(found: Placement) -> str:
    """Return the places given and found, what was tried, and why places have no motion."""
    grid = set(found.grid.stands)
    on_grid = sum(row.stand in grid for row in found.rows)
    known = f", {found.restored} of them from the journal" if found.restored else ""
    lines = [
        f"{found.problem.name}: {len(found.rows)} places tried, {on_grid} on the grid{known}; "
        f"{found.feasible_count} have a motion",
        *_reason_lines(found),
        f"as given: {_stand_words(found.given.stand)}: {_given_words(found)}",
        _best_line(found),
    ]
    if found.stopped_by is not None:
        lines.append("interrupted: the best so far")
    return "\n".join(lines)


def _best_line(found: Placement) -> str:
    if found.best is None or found.duration is None:
        return found.message
    gain = found.gain
    words = ""
    if gain is not None:
        words = f", {abs(gain):.1%} {'less' if gain >= 0 else 'more'} than as given"
    return f"best: {_stand_words(found.best.stand)}: {found.duration:.4f} s{words}"


def _given_words(found: Placement) -> str:
    duration = found.given.duration
    return found.given.message if duration is None else f"{duration:.4f} s"


def _stand_words(stand: Stand) -> str:
    x, y, z = (f"{value:.4g}" for value in stand[:3])
    return f"[{x}, {y}, {z}] m, yaw {stand.yaw:.4g} rad ({degrees(stand.yaw):.1f} deg)"


def _reason_lines(found: Placement) -> list[str]:
    """Return a table of why places have no motion, the most frequent reason first."""
    if not found.reasons:
        return []
    table = Table(title="places without a motion", title_justify="left")
    table.add_column("places", justify="right")
    table.add_column("reason")
    table.add_column("for example")
    for reason, count, example in found.reasons[:_MOST_REASONS]:
        table.add_row(str(count), escape(reason), escape(example))
    lines = [rendered(table)]
    if hidden := found.reasons[_MOST_REASONS:]:
        places = sum(count for _, count, _ in hidden)
        lines.append(f"and {places} places for {len(hidden)} other reasons")
    return lines
