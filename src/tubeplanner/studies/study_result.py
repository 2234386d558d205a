"""What came of a study: its rows, as a table."""

import csv
import io
from collections import Counter
from dataclasses import dataclass
from typing import Any

from tubeplanner.progress import StoppedBy
from tubeplanner.short_repr import short_repr
from tubeplanner.studies.formula_cells import without_formulas
from tubeplanner.studies.json_values import value_text
from tubeplanner.studies.study import Study
from tubeplanner.studies.study_row import StudyRow


@dataclass(frozen=True, eq=False)
class StudyResult:
    """What came of a study.

    Attributes:
        study: The study.
        rows: Of every point that is done, in the order of the points.
        stopped_by: "interrupt" if Ctrl-C kept other points from being planned; None otherwise.
    """

    study: Study
    rows: tuple[StudyRow, ...]
    stopped_by: StoppedBy | None = None

    __repr__ = short_repr

    @property
    def succeeded(self) -> bool:
        """Whether any point has a certified motion."""
        return any(row.duration is not None for row in self.rows)

    @property
    def counts(self) -> dict[str, int]:
        """How many rows have each status, the most frequent first."""
        return dict(Counter(str(row.status) for row in self.rows).most_common())

    @property
    def shortest(self) -> StudyRow | None:
        """The row of the shortest duration; None if no point has a certified motion."""
        durations = [row.duration for row in self.rows if row.duration is not None]
        if not durations:
            return None
        return next(row for row in self.rows if row.duration == min(durations))

    def as_dict(self) -> dict[str, Any]:
        """Return the study as JSON values."""
        rows = [row.as_dict() for row in self.rows]
        about = {"study": self.study.name, "points": len(self.study.points), "counts": self.counts}
        return {**about, "stopped_by": self.stopped_by, "rows": rows}

    def csv(self) -> str:
        """Return the rows as CSV: a column for every field that is varied.

        Lists and maps are written as JSON, places as text, notes with semicolons between them.
        """
        stream = io.StringIO()
        paths = [axis.path for axis in self.study.axes]
        plain = StudyRow.__dataclass_fields__.keys() - {"point", "values"}
        columns = [name for name in StudyRow.__dataclass_fields__ if name in plain]
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["point", *paths, *columns])
        for row in self.rows:
            texts = {**row.as_dict(), "where": str(row.where), "notes": "; ".join(row.notes)}
            values = [value_text(row.values[path]) for path in paths]
            writer.writerow([row.point, *values, *(texts[name] for name in columns)])
        return without_formulas(stream.getvalue())
