"""Points in a CSV file, as the outside judge reads them."""

import csv
from pathlib import Path
from typing import Any

from outside.files import BadInput

POSITION, QUATERNION, RADIUS = ["x", "y", "z"], ["qx", "qy", "qz", "qw"], ["radius"]
UNNAMED = {
    3: POSITION,
    4: POSITION + RADIUS,
    7: POSITION + QUATERNION,
    8: POSITION + QUATERNION + RADIUS,
}


def read_points(path: Path) -> dict[str, Any]:
    """Return the fields of a tube that a file of points has.

    The radius in a line is that of the segment that begins there; the last one says nothing.

    Raises:
        BadInput: It cannot be read.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            cells = csv.reader(file, skipinitialspace=True)
            rows = [r for r in cells if any(c.strip() for c in r) and not r[0].startswith("#")]
        names = _names(rows)
        body = rows[1:] if _is_named(rows) else rows
        columns = dict(zip(names, zip(*body, strict=True), strict=True))
        fields: dict[str, Any] = {"points": _table(columns, POSITION)}
        if "qx" in columns:
            fields["orientations"] = _table(columns, QUATERNION)
        if "radius" in columns:
            *radius, last = columns["radius"]
            fields["radius"] = [float(cell) for cell in radius]
            if last.strip() and float(last) != fields["radius"][-1]:
                raise BadInput(f"{path}: the last radius belongs to no segment")
    except (OSError, ValueError, KeyError, IndexError, csv.Error) as error:
        raise BadInput(f"{path} cannot be read: {error}") from error
    return fields


def _is_named(rows: list[list[str]]) -> bool:
    try:
        float(rows[0][0])
    except ValueError:
        return True
    return False


def _names(rows: list[list[str]]) -> list[str]:
    if not _is_named(rows):
        return UNNAMED[len(rows[0])]
    names = [cell.strip() for cell in rows[0]]
    if unknown := set(names) - set(UNNAMED[8]):
        raise ValueError(f"column {unknown.pop()} is not known here")
    return names


def _table(columns: dict[str, Any], names: list[str]) -> list[list[float]]:
    return [[float(cell) for cell in row] for row in zip(*(columns[n] for n in names), strict=True)]
