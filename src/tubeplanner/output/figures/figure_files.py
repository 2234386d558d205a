"""Figures without a window: creation, files, grid of panels.

Matplotlib is imported when a figure is made.
"""

import io
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tubeplanner.writing import require_ending, write_files

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

_DPI = 110
_DPI_OF_PICTURES = 150  # of pictures in vector files
# Metadata of a file by its ending, without the date, so that equal figures are equal files.
_METADATA: dict[str, dict[str, Any]] = {
    ".png": {},
    ".pdf": {"CreationDate": None},
    ".svg": {"Date": None},
}
FIGURE_ENDINGS = tuple(_METADATA)
# Text stays text, so that it can be found, copied and edited; a PDF embeds its fonts.
_VECTOR_STYLE: dict[Any, Any] = {
    "pdf.fonttype": 42,
    "svg.fonttype": "none",
    "svg.hashsalt": "tubeplanner",
}


def new_figure(width: float, height: float) -> "Figure":
    """Return an empty figure of a size [inches]."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=_DPI, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def saved(figure: "Figure", path: str | Path | None) -> "Figure":
    """Write a figure to a file, if named, as PNG, PDF or SVG by its ending; return the figure.

    Raises:
        OptionError: The name ends otherwise.
        OutputError: The file could not be written.
    """
    if path is not None:
        write_files({Path(path): figure_file(figure, Path(path))})
    return figure


def figure_file(figure: "Figure", path: Path) -> bytes:
    """Return a figure as the contents of a file: PNG, PDF or SVG, by its ending.

    Equal figures give equal contents.

    Raises:
        OptionError: The name ends otherwise.
    """
    from matplotlib import rc_context

    require_ending(path, "figure", FIGURE_ENDINGS)
    ending = path.suffix.lower()
    resolution = _DPI if ending == ".png" else _DPI_OF_PICTURES
    stream = io.BytesIO()
    with rc_context(_VECTOR_STYLE):
        kind, about = ending.removeprefix("."), _METADATA[ending]
        figure.savefig(stream, format=kind, dpi=resolution, metadata=about)
    return stream.getvalue()


# ---- The grid of panels of a motion's figure.

_WIDTH = 12.5  # all of these [inches]
_ABOVE_STRIP, _STRIP_ROW, _PANEL, _MOTORS = 1.0, 0.21, 1.95, 2.7
_MIN_SPACE = 2  # rows of panels that the panel in space takes at least


@dataclass(frozen=True, eq=False)
class FigureGrid:
    """The panels of a figure."""

    figure: "Figure"  # the figure
    strip: "Axes"  # binding limits, over the whole width
    panels: "list[Axes]"  # curves over time, the left column first
    space: "Axes"  # the panel in space, at the top of the right column
    motors: "SubFigure | None"  # for motors, at the bottom; None: none

    def name_time(self) -> None:
        """Name the axis of time below the last panel of each column alone, to save space."""
        for axis in (self.strip, *self.panels):
            spec = axis.get_subplotspec()
            is_last = axis is not self.strip and spec is not None and spec.is_last_row()
            axis.set_xlabel("time [s]" if is_last else "")


def figure_grid(strip_rows: int, panels: int, *, has_motors: bool) -> FigureGrid:
    """Return a figure with empty panels: a strip of rows, curves over time, space, motors."""
    rows = -(-(panels + _MIN_SPACE) // 2)
    heights = [_ABOVE_STRIP + _STRIP_ROW * strip_rows, _PANEL * rows]
    heights += [_MOTORS] * has_motors
    figure = new_figure(_WIDTH, sum(heights))
    parts = figure.subfigures(len(heights), 1, squeeze=False, height_ratios=heights)[:, 0]
    strip = parts[0].add_subplot()
    grid = parts[1].add_gridspec(rows, 2, width_ratios=(1.1, 1))
    beside = panels - rows
    cells = [(row, 0) for row in range(rows)] + [(row, 1) for row in range(rows - beside, rows)]
    axes = [parts[1].add_subplot(grid[cell]) for cell in cells]
    space = parts[1].add_subplot(grid[: rows - beside, 1])
    return FigureGrid(figure, strip, axes, space, parts[2] if has_motors else None)
