"""Figures without a window, and their files. matplotlib is imported when a figure is made."""

import io
from pathlib import Path
from typing import TYPE_CHECKING

from tubeplanner.files.output_files import write_files

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DPI = 110


def new_figure(width: float, height: float) -> "Figure":
    """Return an empty figure of a size [inches]."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=_DPI, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def saved(figure: "Figure", path: str | Path | None) -> "Figure":
    """Return a figure, written to a PNG file if one is named.

    Raises:
        OutputError: The file could not be written.
    """
    if path is not None:
        write_files({Path(path): figure_png(figure)})
    return figure


def figure_png(figure: "Figure") -> bytes:
    """Return a figure as the contents of a PNG file."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png")
    return stream.getvalue()
