"""What surrounds the panel in space: a floor with a grid, and the coordinates along its sides."""

from typing import TYPE_CHECKING, Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.views.space_view import SpaceView

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_AROUND = 0.04  # of the size: how far beyond the box a view from above goes
_LINES = 6  # of the grid along the longest side, at most
_GRID: dict[str, Any] = {"color": "#D5D5D5", "linewidth": 0.7, "zorder": 1}
_AXIS: dict[str, Any] = {"color": "#777777", "linewidth": 1.0, "zorder": 1}
_UP = 2
_NAMES = ("x [m]", "y [m]", "z [m]")


def draw_frame(axis: "Axes", view: SpaceView, low: FloatArray, high: FloatArray) -> None:
    """Draw the floor of a box, and its coordinates.

    Args:
        axis: The panel, its coordinates those of the page.
        view: From where it is seen.
        low: Least corner of the box, shape (3,) [m].
        high: The opposite one.
    """
    axis.set_aspect("equal")
    if view.is_from_above:
        around = _AROUND * (high - low).max()
        axis.set(xlim=(low[0] - around, high[0] + around), ylim=(low[1] - around, high[1] + around))
        axis.set_xlabel(_NAMES[0])
        axis.set_ylabel(_NAMES[1])
        axis.grid(color=_GRID["color"], linewidth=_GRID["linewidth"])
        axis.set_axisbelow(True)
        return
    axis.set_axis_off()
    step = _step(float((high - low).max()))
    near = np.where(view.direction > 0, high, low)
    far = np.where(view.direction > 0, low, high)
    stops = [
        np.arange(np.ceil(a / step), np.floor(b / step) + 1) * step
        for a, b in zip(low, high, strict=True)
    ]
    for k in (0, 1):
        for stop in stops[k]:
            line = np.array([low, high])
            line[:, k], line[:, 2] = stop, low[2]
            axis.plot(*view.on_page(line).T, **_GRID)
        ends = np.array([near, near])
        ends[:, k], ends[:, 2] = (low[k], high[k]), low[2]
        _draw_scale(axis, view, ends, k, stops[k])
    # The upright scale stands where nothing is before it: at the left end of the floor.
    sides = np.array([[near[0], far[1]], [far[0], near[1]]])
    left = sides[view.on_page(np.column_stack([sides, low[[2, 2]]]))[:, 0].argmin()]
    ends = np.array([[*left, low[2]], [*left, high[2]]])
    _draw_scale(axis, view, ends, _UP, stops[_UP])


def _draw_scale(
    axis: "Axes",
    view: SpaceView,
    ends: FloatArray,
    k: int,
    stops: FloatArray,
) -> None:
    """Draw one scale from end to end (2, 3), with numbers at some places and its name."""
    axis.plot(*view.on_page(ends).T, **_AXIS)
    places = np.tile(ends[0], (len(stops), 1))
    places[:, k] = stops
    shift, align = _outwards(view, k, ends)
    for place, stop in zip(view.on_page(places), stops, strict=True):
        axis.annotate(
            f"{stop + 0.0:.4g}", place, shift, textcoords="offset points", fontsize=7, **align
        )
    place, far = ends.mean(axis=0), (3.0 * shift[0], 3.0 * shift[1])
    if k == _UP:
        place, far, align = ends[1], (0.0, 6.0), {"ha": "center"}
    x, y = view.on_page(place).tolist()
    axis.annotate(_NAMES[k], (x, y), far, textcoords="offset points", fontsize=8, **align)


def _outwards(
    view: SpaceView, k: int, ends: FloatArray
) -> tuple[tuple[float, float], dict[str, Any]]:
    """Return by how much numbers of a scale are beside it [points], and how they are aligned."""
    if k == _UP:
        return (-6.0, 0.0), {"ha": "right", "va": "center"}
    along = np.diff(view.on_page(ends), axis=0)[0]
    falls = along[0] * along[1] < 0
    return (-4.0 if falls else 4.0, -6.0), {"ha": "right" if falls else "left", "va": "top"}


def _step(size: float) -> float:
    """Return the distance between lines of the grid: 1, 2 or 5 times a power of ten [m]."""
    rough = size / _LINES
    power = 10.0 ** np.floor(np.log10(rough))
    return float(power * next(digit for digit in (1, 2, 5, 10) if digit * power >= rough))
