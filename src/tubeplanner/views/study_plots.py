"""Figures of several plans: how refinement converges, and the duration against the tolerance."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tubeplanner.progress import Progress
from tubeplanner.studies.tolerance_sweep import SweepResult
from tubeplanner.views.figure_files import new_figure, saved
from tubeplanner.views.panels import line_style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_TANGENT = 0.35  # half the length of a slope's line, as a share of the way to the next tolerance
_WIDE = 10.0  # tolerances that differ by more than this factor are drawn on a logarithmic axis


def plot_convergence(
    histories: Mapping[str, Sequence[Progress]], path: str | Path | None = None
) -> "Figure":
    """Draw how the duration falls, step by step, towards the shortest one found.

    Args:
        histories: By name, the reports of `plan` to its `progress` callback, in order.
        path: Where to save the figure, as PNG, PDF or SVG by its ending; None: nowhere.

    Raises:
        OptionError: The file has another ending.
        OutputError: The file could not be written.
    """
    figure = new_figure(8.0, 4.5)
    axis = figure.add_subplot()
    for number, (name, history) in enumerate(histories.items()):
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
    """Draw the duration against the tolerance, with the slope that the sensitivities predict.

    Args:
        result: What `sweep` found.
        path: Where to save the figure, as PNG, PDF or SVG by its ending; None: nowhere.

    Raises:
        OptionError: The file has another ending.
        OutputError: The file could not be written.
    """
    figure = new_figure(8.0, 4.5)
    axis = figure.add_subplot()
    figure.suptitle(f"{result.problem.name}: duration against tolerance", fontsize=13)
    draw_sweep(axis, result)
    return saved(figure, path)


def draw_sweep(
    axis: "Axes", result: SweepResult, label: str | None = None, number: int = 0
) -> None:
    """Draw a sweep into axes: points, slopes, and where there is no plan.

    Args:
        axis: Where.
        result: What `sweep` found.
        label: In the legend; None: "certified trajectory".
        number: Of the line, for colour and dashes.
    """
    radius = result.quantity == "radius"
    unit, name = (1000, "radius [mm]") if radius else (1, "scale of all radii [-]")
    values = unit * np.array([row.value for row in result.rows])
    planned = [(unit * row.value, row.duration) for row in result.rows if row.duration is not None]
    style = {**line_style(number), "linewidth": 1.0}
    axis.plot(*np.reshape(planned, (-1, 2)).T, "o", label=label or "certified trajectory", **style)
    if values[-1] > _WIDE * values[0]:
        axis.set_xscale("log")
        axis.set_xticks(values, [f"{value:.3g}" for value in values], minor=False)
        axis.set_xticks([], minor=True)
    for row, value in zip(result.rows, values, strict=True):
        if row.duration is None:
            draw_gap(axis, value, str(row.status).replace("_", " "))
        elif row.elasticity is not None:
            _draw_slope(axis, value, _half_tangent(values, value), row.duration, row.elasticity)
    axis.set(xlabel=name, ylabel="duration [s]")
    axis.grid(alpha=0.25)
    axis.legend(fontsize=8)


def draw_gap(axis: "Axes", value: float, reason: str) -> None:
    """Mark a tolerance without a plan."""
    axis.axvline(value, color="#888888", linestyle=":", linewidth=1.2)
    where = axis.get_xaxis_transform()
    axis.text(value, 0.03, f" no plan: {reason}", transform=where, rotation=90, fontsize=7)


def _draw_slope(
    axis: "Axes", value: float, half: float, duration: float, elasticity: float
) -> None:
    """Draw a tangent that is straight on linear and logarithmic axes."""
    ratio = np.array([1 - half, 1, 1 + half])
    gain = np.log(ratio) if axis.get_xscale() == "log" else ratio - 1
    label = "slope by the sensitivities"
    known = {line.get_label() for line in axis.lines}
    axis.plot(
        value * ratio,
        duration * (1 + elasticity * gain),
        color="#000000",
        linewidth=2.4,
        alpha=0.55,
        label=f"_{label}" if label in known else label,
        zorder=1,
    )


def _half_tangent(values: np.ndarray, value: float) -> float:
    """Return how far a slope is drawn to either side, as a share of the value."""
    others = values[values != value]
    nearest = min(abs(others / value - 1)) if len(others) else 1.0
    return float(min(_TANGENT * nearest, 0.5))
