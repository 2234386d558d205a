"""Cells of tables that spreadsheets would run: text that begins as a formula does."""

import csv
import io

_FORMULA_BEGINS = ("=", "+", "-", "@")


def without_formulas(table: str) -> str:
    """Return CSV whose cells are numbers or text: an apostrophe is put before what is a formula.

    Args:
        table: CSV with lines that end in a newline alone.
    """
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    for row in csv.reader(io.StringIO(table, newline="")):
        writer.writerow([f"'{cell}" if _is_formula(cell) else cell for cell in row])
    return stream.getvalue()


def _is_formula(cell: str) -> bool:
    if not cell.lstrip().startswith(_FORMULA_BEGINS):
        return False
    try:
        float(cell)
    except ValueError:
        return True
    return False
