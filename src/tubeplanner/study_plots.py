"""Figures of several plans: how refinement converges, and the duration against the tolerance."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tubeplanner.figure_files import new_figure, saved
from tubeplanner.panels import line_style
from tubeplanner.progress import Progress
from tubeplanner.tolerance_sweep import SweepResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_TANGENT = 0.35  # half the length of a slope's line, as a share of the way to the next tolerance
_WIDE = 10.0  # tolerances that differ by more than this factor are drawn on a logarithmic axis


def plot_convergence(
    told: Mapping[str, Sequence[Progress]], path: str | Path | None = None
) -> "Figure":
    """Draw how the duration falls, step by step, towards the shortest that was found.

    Args:
        told: By name, what `plan` told its `progress` callback, in order.
        path: Where to save the figure as PNG; None: nowhere.

    Raises:
        OutputError: The file could not be written.
    """
    figure = new_figure(8.0, 4.5)
    axis = figure.add_subplot()
    for number, (name, history) in enumerate(told.items()):
        durations = np.array([p.best_duration for p in history if p.best_duration is not None])
        if len(durations) == 0:
            continue
        excess = 100 * (durations / durations.min() - 1)
        axis.plot(np.arange(1, len(durations) + 1), excess, label=name, **line_style(number))
    axis.set(xlabel="step [-]", ylabel="above the shortest [%]", yscale="symlog", ylim=(-0.2, 500))
    axis.set_yticks([0, 1, 10, 100], ["0", "1", "10", "100"])
    axis.grid(alpha=0.25)
    if axis.lines:
        axis.legend(fontsize=8)
    return saved(figure, path)


def plot_sweep(result: SweepResult, path: str | Path | None = None) -> "Figure":
    """Draw the duration against the tolerance, with the slope that the price list predicts.

    Args:
        result: What `sweep` found.
        path: Where to save the figure as PNG; None: nowhere.

    Raises:
        OutputError: The file could not be written.
    """
    figure = new_figure(8.0, 4.5)
    axis = figure.add_subplot()
    figure.suptitle(f"{result.problem.name}: duration against tolerance")
    draw_sweep(axis, result)
    return saved(figure, path)


def draw_sweep(
    axis: "Axes", result: SweepResult, label: str | None = None, number: int = 0
) -> None:
    """Draw a sweep into axes: points, slopes, and where there is no plan.

    Args:
        axis: Where.
        result: What `sweep` found.
        label: In the legend; None: "certified motion".
        number: Of the line, for colour and dashes.
    """
    unit, name = (1000, "radius [mm]") if result.quantity == "radius" else (1, "scale of radii [-]")
    values = unit * np.array([row.value for row in result.rows])
    planned = [row for row in result.rows if row.duration is not None]
    style = {**line_style(number), "linewidth": 1.0}
    x = unit * np.array([row.value for row in planned])
    axis.plot(
        x, [row.duration or 0.0 for row in planned], "o", label=label or "certified motion", **style
    )
    first = True
    for row in planned:
        if row.elasticity is None or row.duration is None:
            continue
        half = _half_tangent(values, unit * row.value)
        around = unit * row.value * np.array([1 - half, 1, 1 + half])
        # A constant elasticity: straight on a logarithmic axis, and the tangent on a linear one.
        tangent = row.duration * (around / (unit * row.value)) ** row.elasticity
        said = "slope by the price list" if first and label is None else None
        axis.plot(around, tangent, color="#000000", linewidth=2.4, alpha=0.55, label=said, zorder=1)
        first = False
    for row in result.rows:
        if row.duration is None:
            axis.axvline(unit * row.value, color="#888888", linestyle=":", linewidth=1.2)
            place = (unit * row.value, 0.03)
            words = f" no plan: {str(row.status).replace('_', ' ')}"
            axis.text(*place, words, transform=axis.get_xaxis_transform(), rotation=90, fontsize=7)
    if values[-1] > _WIDE * values[0]:
        axis.set_xscale("log")
        axis.set_xticks(values, [f"{value:.3g}" for value in values], minor=False)
        axis.set_xticks([], minor=True)
    axis.set(xlabel=name, ylabel="duration [s]")
    axis.grid(alpha=0.25)
    axis.legend(fontsize=8)


def _half_tangent(values: np.ndarray, value: float) -> float:
    """Return how far a slope is drawn to either side, as a share of the value."""
    others = values[values != value]
    nearest = min(abs(others / value - 1)) if len(others) else 1.0
    return float(min(_TANGENT * nearest, 0.5))
