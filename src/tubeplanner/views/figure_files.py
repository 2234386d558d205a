"""Figures without a window, and their files. matplotlib is imported when a figure is made."""

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tubeplanner.errors import OptionError
from tubeplanner.files.output_files import write_files

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DPI = 110
_DPI_OF_PICTURES = 150  # of what vector files hold as pixels
# By ending: what is said of the file beside the figure, without the date, so that equal figures
# are equal files.
_METADATA: dict[str, dict[str, Any]] = {
    ".png": {},
    ".pdf": {"CreationDate": None},
    ".svg": {"Date": None},
}
FIGURE_ENDINGS = tuple(_METADATA)
# Text stays text, so that it is found, copied and edited; a PDF brings its fonts along.
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
    """Return a figure, written to a file if one is named: PNG, PDF or SVG, by its ending.

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

    require_figure(path)
    ending = path.suffix.lower()
    resolution = _DPI if ending == ".png" else _DPI_OF_PICTURES
    stream = io.BytesIO()
    with rc_context(_VECTOR_STYLE):
        kind, about = ending.removeprefix("."), _METADATA[ending]
        figure.savefig(stream, format=kind, dpi=resolution, metadata=about)
    return stream.getvalue()


def require_figure(path: Path | None, option: str = "figure") -> None:
    """Check that the name of a figure's file, if there is one, has an ending that can be written.

    Args:
        path: The file.
        option: What the message says it was given as.

    Raises:
        OptionError: It has not.
    """
    if path is not None and path.suffix.lower() not in FIGURE_ENDINGS:
        *others, last = FIGURE_ENDINGS
        known = f"{', '.join(others)} or {last}"
        raise OptionError(f"{option} {path}: name a file that ends in {known}")
