"""Figures of durations over one value; marks of statuses without a plan."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.checks import is_number
from tubeplanner.outcome import PlanStatus, Progress
from tubeplanner.output.drawing import LINE_COLORS, SPEED_COLORS, WARNING_COLOR
from tubeplanner.output.figures.figure_files import new_figure, saved
from tubeplanner.output.figures.panels import line_style
from tubeplanner.resources import EXAMPLE_PREFIX
from tubeplanner.studies.study import StudyRow
from tubeplanner.studies.sweeps import FieldRow, FieldSweep, SweepResult
from tubeplanner.task.field_changes import factor_of
from tubeplanner.text import value_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# ---- Figures of several plans: convergence of refinement, and duration against tolerance.

_TANGENT = 0.35  # half the length of a slope's line, as a fraction of the way to the next tolerance
_WIDE = 10.0  # tolerances that differ by more than this factor are drawn on a logarithmic axis


def plot_convergence(
    histories: Mapping[str, Sequence[Progress]], path: str | Path | None = None
) -> "Figure":
    """Draw the excess of the duration over the shortest duration [%], step by step.

    Args:
        histories: By name, the reports of `plan` to its `progress` callback, in order.
        path: File to save the figure to, as PNG, PDF or SVG by its ending; None: none.

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
        result: Result of `sweep`.
        path: File to save the figure to, as PNG, PDF or SVG by its ending; None: none.

    Raises:
        OptionError: The file has another ending.
        OutputError: The file could not be written.
    """
    figure = new_figure(8.0, 4.5)
    axis = figure.add_subplot()
    figure.suptitle(f"{result.problem.name}: duration against tolerance", fontsize=13)
    radius = result.quantity == "radius"
    unit, name = (1000, "radius [mm]") if radius else (1, "scale of all radii [-]")
    values = unit * np.array([row.value for row in result.rows])
    planned = [(unit * row.value, row.duration) for row in result.rows if row.duration is not None]
    options = {**line_style(0), "linewidth": 1.0}
    axis.plot(*np.reshape(planned, (-1, 2)).T, "o", label="certified trajectory", **options)
    if values[-1] > _WIDE * values[0]:
        axis.set_xscale("log")
        axis.set_xticks(values, [f"{value:.3g}" for value in values], minor=False)
        axis.set_xticks([], minor=True)
    for row, value in zip(result.rows, values, strict=True):
        if row.duration is None:
            draw_gap(axis, value, status_words(row.status))
        elif row.elasticity is not None:
            others = values[values != value]
            nearest = min(abs(others / value - 1)) if len(others) else 1.0
            half = float(min(_TANGENT * nearest, 0.5))
            _draw_slope(axis, value, half, row.duration, row.elasticity)
    axis.set(xlabel=name, ylabel="duration [s]")
    axis.grid(alpha=0.25)
    axis.legend(fontsize=8)
    return saved(figure, path)


def plot_field_sweep(result: FieldSweep, path: str | Path | None = None) -> "Figure":
    """Draw the duration against a field's values: numbers and factors to scale, others in a row.

    Answers that were executed in simulation have the number of their failed runs above them.

    Args:
        result: Result of `sweep_field`.
        path: File to save the figure to, as PNG, PDF or SVG by its ending; None: none.

    Raises:
        OptionError: The file has another ending.
        OutputError: The file could not be written.
    """
    figure = new_figure(8.0, 4.5)
    figure.suptitle(f"{result.name}: duration against {result.path}", fontsize=13)
    scale = ValueScale.of(result.path, [row.value for row in result.rows])
    axis = figure.add_subplot()
    draw_durations(axis, scale, result.rows, with_shortest=result.varies_objective)
    return saved(figure, path)


def draw_gap(axis: "Axes", value: float, reason: str) -> None:
    """Mark a value without a plan, with the reason."""
    axis.axvline(value, color="#888888", linestyle=":", linewidth=1.2)
    where = axis.get_xaxis_transform()
    axis.text(value, 0.03, f" no plan: {reason}", transform=where, rotation=90, fontsize=7)


def _draw_slope(
    axis: "Axes", value: float, half: float, duration: float, elasticity: float
) -> None:
    """Draw a tangent, straight on linear and on logarithmic axes."""
    ratio = np.array([1 - half, 1, 1 + half])
    gain = np.log(ratio) if axis.get_xscale() == "log" else ratio - 1
    label = "slope by the sensitivities"
    labels = {line.get_label() for line in axis.lines}
    axis.plot(
        value * ratio,
        duration * (1 + elasticity * gain),
        color="#000000",
        linewidth=2.4,
        alpha=0.55,
        label=f"_{label}" if label in labels else label,
        zorder=1,
    )


# ---- Positions of a field's values on an axis: numbers and factors to scale, others in a row.

_MAX_LABEL = 24  # [characters] of a value below the axis
_MAX_UPRIGHT = 36  # [characters] of all upright labels of an axis together
# Ratio of largest to smallest value from which on a logarithmic axis may be more even.
_WIDE_RANGE = 10.0


@dataclass(frozen=True, eq=False)
class ValueScale:
    """The values of a field, and their positions on an axis."""

    path: str  # of the field
    values: Sequence[Any]  # from the file or the caller
    positions: FloatArray  # their positions on the axis
    is_scaled: bool  # True if positions are numbers or factors; else they count the values

    @classmethod
    def of(cls, path: str, values: Sequence[Any]) -> "ValueScale":
        """Return the scale of values; equal values that are not to scale share a position."""
        factors = [factor_of(value) for value in values]
        for numbers in (values, factors):
            if values and all(is_number(number) for number in numbers):
                positions = np.array(numbers, dtype=float)
                if np.isfinite(positions).all():
                    return cls(path, values, positions, True)
        texts = [value_text(value) for value in values]
        order = {text: position for position, text in enumerate(dict.fromkeys(texts))}
        return cls(path, values, np.array([float(order[text]) for text in texts]), False)

    @property
    def label(self) -> str:
        """Name of the axis."""
        is_factor = self.is_scaled and factor_of(self.values[0]) is not None
        return f"factor on {self.path} [-]" if is_factor else self.path

    @property
    def is_logarithmic(self) -> bool:
        """True if the values lie more evenly by their ratios than by their differences."""
        if not self.is_scaled or len(self.positions) < 3 or min(self.positions) <= 0:
            return False
        least, middle, most = min(self.positions), np.median(self.positions), max(self.positions)
        ratio = abs(middle - np.sqrt(least * most)) < abs(middle - (least + most) / 2)
        return bool(ratio and most >= _WIDE_RANGE * least)

    def draw(self, axis: "Axes", side: Literal["x", "y"] = "x") -> None:
        """Name and scale an axis; label the values that stand in a row."""
        from matplotlib.ticker import FormatStrFormatter, LogLocator, NullFormatter

        line = axis.xaxis if side == "x" else axis.yaxis
        axis.set(**{f"{side}label": self.label})
        if self.is_logarithmic:
            axis.set(**{f"{side}scale": "log"})
            line.set_major_locator(LogLocator(subs=(1, 2, 5)))
            line.set_major_formatter(FormatStrFormatter("%g"))
            line.set_minor_formatter(NullFormatter())
        if not self.is_scaled:
            labels = dict(zip(self.positions.tolist(), map(value_label, self.values), strict=True))
            line.set_ticks(list(labels), labels=list(labels.values()))
            axis.set(**{f"{side}lim": (min(labels) - 0.5, max(labels) + 0.5)})
            if side == "x" and sum(map(len, labels.values())) > _MAX_UPRIGHT:
                axis.tick_params("x", rotation=20)


def value_label(value: Any) -> str:
    """Return the label of a value below an axis: of long texts the end, where names differ."""
    if is_number(value):
        return f"{value:.4g}"
    text = value_text(value).removeprefix(EXAMPLE_PREFIX)
    return text if len(text) <= _MAX_LABEL else f"...{text[3 - _MAX_LABEL :]}"


# ---- The duration against one field, for sweeps and studies.

_MAX_NAMED = 12  # gaps with their reason beside them; more are drawn as marks with a legend
_ABOVE: dict[str, Any] = {
    "xytext": (0, 9),
    "textcoords": "offset points",
    "ha": "center",
    "fontsize": 7,
    "bbox": {"boxstyle": "square,pad=0.1", "color": "white", "alpha": 0.8},
}


def draw_durations(
    axis: "Axes", scale: ValueScale, rows: Sequence[FieldRow | StudyRow], *, with_shortest: bool
) -> None:
    """Draw durations against a field's values, with the number of failed runs if simulated.

    Args:
        axis: Of the panel.
        scale: Positions of the rows' values.
        rows: One per value.
        with_shortest: True to draw the shortest durations that were found as well.
    """
    scale.draw(axis)
    lines = {"certified trajectory": [row.duration for row in rows]}
    if with_shortest:
        lines["shortest that was found"] = [row.shortest_duration for row in rows]
    for number, (label, durations) in enumerate(lines.items()):
        values = np.array([np.nan if d is None else d for d in durations])
        order = np.argsort(scale.positions)
        order = order[np.isfinite(values[order])]
        style = {**line_style(number), "linewidth": 1.0 if scale.is_scaled else 0.0}
        axis.plot(scale.positions[order], values[order], "o", label=label, **style)
    gaps = [
        (position, row.status)
        for position, row in zip(scale.positions.tolist(), rows, strict=True)
        if row.duration is None
    ]
    if len(gaps) > _MAX_NAMED:
        draw_rug(axis, gaps)
    else:
        for position, status in gaps:
            draw_gap(axis, position, status_words(status))
    _mark_runs(axis, scale.positions, rows)
    axis.set_ylabel("duration [s]")
    axis.grid(alpha=0.25)
    axis.legend(fontsize=8)


def _mark_runs(axis: "Axes", positions: FloatArray, rows: Sequence[FieldRow | StudyRow]) -> None:
    """Write the number of failed runs above simulated answers, and mark answers with failures."""
    failed = []
    for row, position in zip(rows, positions, strict=True):
        if row.duration is None or row.runs is None:
            continue
        at = (position, row.duration)
        axis.annotate(f"{row.runs_failed} of {row.runs} failed", at, **_ABOVE)
        if row.runs_failed:
            failed.append(at)
    if failed:
        options: dict[str, Any] = {"color": WARNING_COLOR, "markersize": 11}
        axis.plot(*np.transpose(failed), "X", label="some of its runs failed", **options)
    if any(row.runs is not None for row in rows):
        axis.margins(0.1)


# ---- Marks of statuses without a plan: the same colour, mark and hatching in all figures.

_ORDER = (
    PlanStatus.TUBE_BLOCKED,
    PlanStatus.UNREACHABLE,
    PlanStatus.NO_TRAJECTORY,
    PlanStatus.GRAVITY_EXCEEDS_EFFORT,
    PlanStatus.CERTIFICATE_FAILED,
    PlanStatus.TIME_LIMIT,
    PlanStatus.BAD_INPUT,
    PlanStatus.CRASHED,
)
_MARKS = ("x", "v", "P", "s", "D", "^", "*", "X")
_HATCHES = ("///", "\\\\\\", "xxx", "...", "+++", "ooo", "|||", "---")
_COLORS = (*LINE_COLORS[1:], "#777777", "#7A1F1F")  # without the colour of plans


@dataclass(frozen=True)
class StatusMark:
    """Look of one status."""

    color: str  # of marks and hatching
    marker: str  # as matplotlib names it
    hatch: str  # as matplotlib names it


def status_mark(status: PlanStatus) -> StatusMark:
    """Return the look of a status without a plan."""
    number = _ORDER.index(status)
    return StatusMark(_COLORS[number], _MARKS[number], _HATCHES[number])


def status_words(status: PlanStatus) -> str:
    """Return the words of figures for a status."""
    return str(status).replace("_", " ")


def gap_label(status: PlanStatus, count: int) -> str:
    """Return the label of the marks of a status without a plan."""
    return f"no plan: {status_words(status)} ({count})"


def duration_shades() -> Any:
    """Return the colours of durations: short durations light, as high speeds in other figures."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("duration", SPEED_COLORS[::-1])


def draw_empty_cells(
    axis: "Axes",
    corners: Sequence[tuple[float, float]],
    size: tuple[float, float],
    mark: StatusMark,
    label: str,
    **style: Any,
) -> None:
    """Draw the hatched cells of a status without a plan, given by their lower left corners."""
    from matplotlib.patches import Rectangle

    style = {"facecolor": "#F4F4F4", "edgecolor": mark.color, "linewidth": 0, **style}
    for number, corner in enumerate(corners):
        own = {**style, "label": label} if number == 0 else style
        axis.add_patch(Rectangle(corner, *size, hatch=mark.hatch, **own))


def draw_rug(axis: "Axes", gaps: Iterable[tuple[float, PlanStatus]]) -> None:
    """Mark values without a plan at the lower edge of axes, by their status."""
    positions: dict[PlanStatus, list[float]] = {}
    for position, status in gaps:
        positions.setdefault(status, []).append(position)
    for status, values in positions.items():
        mark = status_mark(status)
        label = gap_label(status, len(values))
        transform = axis.get_xaxis_transform()
        options: dict[str, Any] = {"color": mark.color, "markersize": 6, "transform": transform}
        axis.plot(values, [0.03] * len(values), mark.marker, label=label, **options)
