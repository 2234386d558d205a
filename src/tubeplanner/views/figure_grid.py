"""Where the panels of a motion's figure are, so that they fill its page."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from tubeplanner.views.figure_files import new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

_WIDTH = 12.5  # all of these [inches]
_ABOVE_STRIP, _STRIP_ROW, _PANEL, _MOTORS = 1.0, 0.21, 1.95, 2.7
_LEAST_SPACE = 2  # rows of panels that the panel in space takes


@dataclass(frozen=True, eq=False)
class FigureGrid:
    """The panels of a figure.

    Attributes:
        figure: The figure.
        strip: What binds when, over the whole width.
        panels: Curves over time, those of the left column first.
        space: The panel in space, at the top of the right column.
        motors: For motors, below all; None: there are none.
    """

    figure: "Figure"
    strip: "Axes"
    panels: "list[Axes]"
    space: "Axes"
    motors: "SubFigure | None"

    def name_time(self) -> None:
        """Name the axis of time below the last panel of each column alone, and save the room."""
        for axis in (self.strip, *self.panels):
            spec = axis.get_subplotspec()
            is_last = axis is not self.strip and spec is not None and spec.is_last_row()
            axis.set_xlabel("time [s]" if is_last else "")


def figure_grid(strip_rows: int, panels: int, *, has_motors: bool) -> FigureGrid:
    """Return an empty figure.

    Args:
        strip_rows: Rows of the strip.
        panels: How many curves over time there are.
        has_motors: Whether there is room for motors.
    """
    rows = -(-(panels + _LEAST_SPACE) // 2)
    heights = [_ABOVE_STRIP + _STRIP_ROW * strip_rows, _PANEL * rows]
    heights += [_MOTORS] * has_motors
    figure = new_figure(_WIDTH, sum(heights))
    parts = figure.subfigures(len(heights), 1, squeeze=False, height_ratios=heights)[:, 0]
    strip = parts[0].add_subplot()
    grid = parts[1].add_gridspec(rows, 2, width_ratios=(1.1, 1))
    beside = panels - rows
    places = [(row, 0) for row in range(rows)] + [(row, 1) for row in range(rows - beside, rows)]
    axes = [parts[1].add_subplot(grid[place]) for place in places]
    space = parts[1].add_subplot(grid[: rows - beside, 1])
    return FigureGrid(figure, strip, axes, space, parts[2] if has_motors else None)
