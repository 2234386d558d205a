"""Marks in the panels of a cycle's figures: its moves, and what happens at rest between them."""

from itertools import groupby
from typing import TYPE_CHECKING

from tubeplanner.views.cycle_timeline import Timeline

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_STOP_COLOR = "#888888"
_LETTER = 0.009  # of the panel: what a letter of a name is wide
_FEWEST_LETTERS = 5
_LINE = 0.02  # of the panel: what a line of text is high


def mark_moves(
    axis: "Axes", timeline: Timeline, duration: float, *, names: bool, letter: float = _LETTER
) -> None:
    """Shade a panel over time by moves, name them if asked, and mark what happens at rest.

    Args:
        axis: The panel.
        timeline: What happens when.
        duration: When the panel ends [s].
        names: Whether moves are named.
        letter: How wide a letter of a name is, as a share of the panel.
    """
    for band in timeline.bands:
        axis.axvspan(band.begin, band.end, color=band.color, alpha=0.10, linewidth=0, zorder=0)
        if names:
            place = axis.get_xaxis_transform()
            middle, share = (band.begin + band.end) / 2, (band.end - band.begin) / duration
            name = shown_name(band.name, int(share / letter))
            axis.text(middle, 1.01, name, transform=place, ha="center", fontsize=7)
    for stop in timeline.stops:
        axis.axvspan(stop.begin, stop.end, color=_STOP_COLOR, alpha=0.25, linewidth=0, zorder=0)
        for time, _ in stop.ticks:
            axis.axvline(time, color="#333333", linewidth=0.8)
    axis.set_xlim(0.0, duration)
    axis.set_xlabel("time [s]")
    axis.grid(alpha=0.25)


def name_steps(axis: "Axes", timeline: Timeline, duration: float) -> None:
    """Name what happens at rest in a panel whose lines are at zero then."""
    before = -duration
    for stop in timeline.stops:
        for time, ticks in groupby(stop.ticks, lambda tick: tick[0]):
            is_last = time > 0.97 * duration  # its name goes before it
            before = time if is_last else max(time, before + _LINE * duration)
            axis.annotate(
                ", ".join(text for _, text in ticks),
                (before, 0.97),
                (-2 if is_last else 2, 0),
                xycoords=axis.get_xaxis_transform(),
                textcoords="offset points",
                rotation=90,
                fontsize=7,
                ha="right" if is_last else "left",
                va="top",
            )


def shown_name(name: str, letters: int) -> str:
    """Return a name in at most so many letters: whole, cut, or nothing if little is left."""
    if len(name) <= letters:
        return name
    return f"{name[: letters - 2]}..." if letters >= _FEWEST_LETTERS else ""
