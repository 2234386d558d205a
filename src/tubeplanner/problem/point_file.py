"""Reference points from a CSV file: one point per line, as CAM and scanners write them."""

import csv
import math
from dataclasses import dataclass
from pathlib import Path

from tubeplanner.documents import DocumentError, read_text
from tubeplanner.errors import ProblemError, shown, unknown_name

_POSITION, _QUATERNION, _RADIUS = ("x", "y", "z"), ("qx", "qy", "qz", "qw"), ("radius",)
_COLUMNS = (*_POSITION, *_QUATERNION, *_RADIUS)
# Without a line of names, the number of columns says which they are.
_UNNAMED = {
    3: _POSITION,
    4: (*_POSITION, *_RADIUS),
    7: (*_POSITION, *_QUATERNION),
    8: _COLUMNS,
}
_MAX_BYTES = 10_000_000


@dataclass(frozen=True)
class PointFile:
    """What a file of points holds.

    Attributes:
        points: m+1 reference points [m].
        orientations: m+1 quaternions x y z w; None if the file has none.
        radius: Of the m segments, each given where it begins [m]; None if the file has none.
    """

    points: list[list[float]]
    orientations: list[list[float]] | None
    radius: list[float] | None


def read_points(path: Path) -> PointFile:
    """Read a CSV file of reference points.

    The first line may name the columns: x, y, z, and optionally qx, qy, qz, qw and radius, in any
    order; without names they are in this one. The last radius belongs to no segment: it is empty or
    that of the line before.

    Raises:
        ProblemError: The file cannot be read, or a line is malformed; the message names file, line
            and column.
    """
    try:
        text = read_text(path, _MAX_BYTES)
        lines = [(k, row) for k, row in _rows(text) if any(cell.strip() for cell in row)]
    except (DocumentError, csv.Error) as error:
        raise ProblemError(f"tube.points: {path} cannot be read: {error}") from None
    if not lines:
        raise ProblemError(f"tube.points: {path} is empty; give a line x, y, z for every point")
    names = _names(path, lines[0][1])
    is_named = not _is_number(lines[0][1][0])
    last = lines[-1][0]
    table = [_values(path, k, row, names, k == last) for k, row in lines[is_named:]]
    columns = {name: [row[name] for row in table] for name in names}
    points = [list(point) for point in zip(*(columns[name] for name in _POSITION), strict=True)]
    turned = [columns[name] for name in _QUATERNION if name in columns]
    orientations = [list(row) for row in zip(*turned, strict=True)] if turned else None
    radius = _radius(path, columns["radius"]) if "radius" in columns else None
    return PointFile(points, orientations, radius)


def _rows(text: str) -> list[tuple[int, list[str]]]:
    """Return the lines' numbers, from 1, and cells; a line that begins with # says nothing."""
    lines = text.splitlines()
    rows = csv.reader(lines, skipinitialspace=True)
    return [(k, row) for k, row in enumerate(rows, 1) if row and not row[0].startswith("#")]


def _names(path: Path, first: list[str]) -> tuple[str, ...]:
    """Return the names of the columns, from the file's first line.

    Raises:
        ProblemError: They are unknown, doubled or incomplete.
    """
    if _is_number(first[0]):
        if len(first) not in _UNNAMED:
            raise ProblemError(
                f"tube.points: {path} has {len(first)} columns; x, y, z, then optionally "
                "qx, qy, qz, qw and radius are known, so 3, 4, 7 or 8 of them"
            )
        return _UNNAMED[len(first)]
    names = tuple(cell.strip() for cell in first)
    for name in names:
        if name not in _COLUMNS:
            raise ProblemError(f"tube.points: {path}: {unknown_name('column', name, _COLUMNS)}")
    missing = [name for name in _POSITION if name not in names]
    if any(name in names for name in _QUATERNION):
        missing += [name for name in _QUATERNION if name not in names]
    if missing or len(set(names)) < len(names):
        fault = f"no column {missing[0]}" if missing else "a column twice"
        raise ProblemError(f"tube.points: {path} has {fault}; its columns: {', '.join(names)}")
    return names


def _values(
    path: Path, line: int, row: list[str], names: tuple[str, ...], is_last: bool
) -> dict[str, float]:
    """Return a line's numbers by column; a radius that may be empty is NaN then."""
    if len(row) != len(names):
        raise ProblemError(
            f"tube.points: {path}, line {line} has {len(row)} values for {len(names)} columns"
        )
    values = {}
    for name, cell in zip(names, row, strict=True):
        may_be_empty = is_last and name == "radius" and not cell.strip()
        if not may_be_empty and not (_is_number(cell) and math.isfinite(float(cell))):
            raise ProblemError(
                f"tube.points: {path}, line {line}: {name} is {shown(cell)}; it must be a finite "
                "number"
            )
        values[name] = math.nan if may_be_empty else float(cell)
    return values


def _radius(path: Path, column: list[float]) -> list[float]:
    """Return the segments' radii, without the one after the last point."""
    *radius, beyond = column
    if radius and not math.isnan(beyond) and beyond != radius[-1]:
        raise ProblemError(
            f"tube.points: {path}: the last radius, {beyond:g} m, belongs to no segment: each is "
            f"that of the segment that begins there; leave it empty or repeat {radius[-1]:g}"
        )
    return radius


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
