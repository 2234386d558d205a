"""Panels of binding limits, one row per joint, and of clearances over time."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tubeplanner.limits.binding_limits import OBSTACLES, SELF_COLLISION, Span
from tubeplanner.output.curves import BindingStrip, LimitedSection
from tubeplanner.output.drawing import BINDING_STYLES, LINE_COLORS, OTHER_BINDING
from tubeplanner.output.figures.panels import LIMIT, line_style

if TYPE_CHECKING:
    from matplotlib.axes import Axes


_NEARLY_ALL = 99.0  # [%]: from here on decimals are shown
_HEIGHT = 0.78  # of a row
_LETTER = 0.0062  # width of a letter of a name in a bar, of the panel
_LINE_FROM, _LINE_TO = -0.036, -0.005  # ends of a joint's line beside its row, of the panel


def draw_strip(axis: "Axes", strip: BindingStrip) -> None:
    """Draw a strip of binding limits; beside each joint's name, its line style of other panels."""
    for row, spans in enumerate(strip.rows.values()):
        axis.axhspan(row - _HEIGHT / 2, row + _HEIGHT / 2, color="#F4F4F4", linewidth=0, zorder=0)
        for span in spans:
            _draw_span(axis, span, row, strip.duration)
    transform = axis.get_yaxis_transform()
    for row in range(strip.joint_count):
        coordinates: dict[str, Any] = {"transform": transform, "clip_on": False}
        axis.plot((_LINE_FROM, _LINE_TO), (row, row), **line_style(row), **coordinates)
    axis.set_yticks(range(len(strip.rows)), list(strip.rows), fontsize=8)
    axis.tick_params(axis="y", length=0, pad=44)
    axis.set_ylim(len(strip.rows) - 0.45, -0.55)
    _draw_legend(axis, strip)


def _draw_span(axis: "Axes", span: Span, row: int, duration: float) -> None:
    style, width = BINDING_STYLES.get(span.kind, OTHER_BINDING), span.end - span.begin
    options: dict[str, Any] = {"color": style.color, "hatch": style.hatch, "edgecolor": "white"}
    axis.barh(row, width, _HEIGHT, span.begin, linewidth=0.4, zorder=2, **options)
    name = span.kind.replace("_", " ")
    if width / duration > _LETTER * (len(name) + 1):
        box = {"facecolor": style.color, "edgecolor": "none", "pad": 0.6}
        middle = span.begin + width / 2
        text: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 6.5, "zorder": 3}
        axis.text(middle, row, name, color=style.text, bbox=box, **text)


def _draw_legend(axis: "Axes", strip: BindingStrip) -> None:
    """Name the kinds that bind, with their percentage of the time, above the panel."""
    from matplotlib.patches import Patch

    handles = []
    for kind, fraction in sorted(strip.fractions.items(), key=lambda pair: -pair[1]):
        style = BINDING_STYLES.get(kind, OTHER_BINDING)
        options: dict[str, Any] = {"facecolor": style.color, "edgecolor": "white", "linewidth": 0.4}
        label = f"{kind.replace('_', ' ')} {percent(fraction)}"
        handles.append(Patch(hatch=style.hatch, label=label, **options))
    above = 2.0 if len(handles) else 1.0
    axis.legend(
        handles=handles,
        loc="lower left",
        bbox_to_anchor=(-0.01, 1.0),
        borderaxespad=above,
        ncols=len(handles) or 1,
        fontsize=8,
        frameon=False,
        handlelength=1.6,
        columnspacing=1.2,
    )
    title = (
        "What binds when (98 % of a limit or more): "
        f"some limit on the speed {percent(strip.speed_fraction)} of the time"
    )
    coordinates: dict[str, Any] = {"xycoords": "axes fraction", "textcoords": "offset points"}
    axis.annotate(title, (0.0, 1.0), (0, 34), fontsize=9.5, **coordinates)


def percent(fraction: float) -> str:
    """Return a fraction in percent, rounded to 0 or 100 % only if exactly that."""
    if fraction in (0.0, 1.0):
        return f"{100 * fraction:.0f} %"
    bounded = min(max(100 * fraction, 0.1), 99.9)
    return f"{bounded:.2g} %" if bounded < _NEARLY_ALL else f"{bounded:.3g} %"


# ---- The panel of clearances: distances of links to obstacles and to each other over time.

_MILLI = 1000.0
_TOP = 1.5  # of the largest distance: leaves room for names above the curves
_STYLES: dict[str, tuple[str, Any]] = {
    OBSTACLES: (LINE_COLORS[1], "-"),
    SELF_COLLISION: (LINE_COLORS[0], (0, (5, 2))),
}
_WORDS = {OBSTACLES: "nearest obstacle", SELF_COLLISION: "nearest links"}


def draw_clearance(axis: "Axes", sections: Sequence[LimitedSection]) -> None:
    """Draw the least distances in the sections of a motion, and the required distances, dashed.

    A point marks the pair with the least margin to its required distance; the legend names it.
    """
    for kind, (color, dashes) in _STYLES.items():
        own = [(each.begin, pairs) for each in sections for pairs in each.closest]
        own = [(begin, pairs) for begin, pairs in own if pairs.kind == kind]
        for begin, pairs in own:
            is_finite = np.isfinite(pairs.distance)
            distances = np.where(is_finite, _MILLI * pairs.distance, np.nan)
            required = _MILLI * np.where(is_finite, pairs.distance - pairs.margin, np.nan)
            options: dict[str, Any] = {"color": color, "linestyle": dashes, "linewidth": 1.6}
            axis.plot(begin + pairs.time, distances, **options)
            axis.plot(begin + pairs.time, required, **{**LIMIT, "color": color})
        margins = [float(pairs.margin.min()) for _, pairs in own]
        if margins and np.isfinite(min(margins)):
            begin, pairs = own[int(np.argmin(margins))]
            k = int(pairs.margin.argmin())
            distance = _MILLI * float(pairs.distance[k])
            label = f"{_WORDS[kind]}: {' - '.join(pairs.names[k])}, {distance:.3g} mm"
            options = {"color": color, "linestyle": dashes, "markersize": 5, "label": label}
            axis.plot(begin + pairs.time[k], distance, marker="o", **options)
    low, high = axis.get_ylim()
    axis.set_ylim(min(low, 0.0), _TOP * high)
    axis.set_ylabel("clearance [mm]")
    axis.legend(fontsize=7, loc="upper center", handlelength=3.0)
