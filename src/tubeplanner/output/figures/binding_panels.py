"""Panels of binding limits per joint, and of clearances."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tubeplanner.limits.binding_limits import OBSTACLES, SELF_COLLISION, Span
from tubeplanner.output.curves import BindingStrip, LimitedMotion
from tubeplanner.output.drawing import BINDING_STYLES, LINE_COLORS, OTHER_BINDING, BindingStyle
from tubeplanner.output.figures.panels import LIMIT, line_style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# ---- The panel "what binds when": a row per joint, of the tool and of the links, over time.

_NEARLY_ALL = 99.0  # [%]: from here on decimals are shown
_HEIGHT = 0.78  # of a row
_LETTER = 0.0062  # of the panel: what a letter of a name in a bar is wide
_LINE_FROM, _LINE_TO = -0.036, -0.005  # where a joint's line is beside its row, of the panel


def draw_strip(axis: "Axes", strip: BindingStrip) -> None:
    """Draw a strip; beside each joint's name, the line that other panels draw it with."""
    for row, spans in enumerate(strip.rows.values()):
        axis.axhspan(row - _HEIGHT / 2, row + _HEIGHT / 2, color="#F4F4F4", linewidth=0, zorder=0)
        for span in spans:
            _draw_span(axis, span, row, strip.duration)
    transform = axis.get_yaxis_transform()
    for row in range(strip.joint_count):
        place: dict[str, Any] = {"transform": transform, "clip_on": False}
        axis.plot((_LINE_FROM, _LINE_TO), (row, row), **line_style(row), **place)
    axis.set_yticks(range(len(strip.rows)), list(strip.rows), fontsize=8)
    axis.tick_params(axis="y", length=0, pad=44)
    axis.set_ylim(len(strip.rows) - 0.45, -0.55)
    _draw_legend(axis, strip)


def _draw_span(axis: "Axes", span: Span, row: int, duration: float) -> None:
    style, width = _style(span.kind), span.end - span.begin
    axis.barh(
        row,
        width,
        _HEIGHT,
        span.begin,
        color=style.color,
        hatch=style.hatch,
        edgecolor="white",
        linewidth=0.4,
        zorder=2,
    )
    name = _words(span.kind)
    if width / duration > _LETTER * (len(name) + 1):
        box = {"facecolor": style.color, "edgecolor": "none", "pad": 0.6}
        middle = span.begin + width / 2
        axis.text(
            middle,
            row,
            name,
            ha="center",
            va="center",
            fontsize=6.5,
            color=style.text,
            bbox=box,
            zorder=3,
        )


def _draw_legend(axis: "Axes", strip: BindingStrip) -> None:
    """Name the kinds that bind, above the panel, with their share of the time."""
    from matplotlib.patches import Patch

    handles = []
    for kind, share in sorted(strip.shares.items(), key=lambda pair: -pair[1]):
        style = _style(kind)
        look: dict[str, Any] = {"facecolor": style.color, "edgecolor": "white", "linewidth": 0.4}
        label = f"{_words(kind)} {percent(share)}"
        handles.append(Patch(hatch=style.hatch, label=label, **look))
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
        f"some limit on the speed {percent(strip.speed_share)} of the time"
    )
    axis.annotate(
        title,
        (0.0, 1.0),
        (0, 34),
        xycoords="axes fraction",
        textcoords="offset points",
        fontsize=9.5,
    )


def percent(share: float) -> str:
    """Return a share in percent, never rounded to all or nothing."""
    if share in (0.0, 1.0):
        return f"{100 * share:.0f} %"
    shown = min(max(100 * share, 0.1), 99.9)
    return f"{shown:.2g} %" if shown < _NEARLY_ALL else f"{shown:.3g} %"


def _words(kind: str) -> str:
    return kind.replace("_", " ")


def _style(kind: str) -> BindingStyle:
    return BINDING_STYLES.get(kind, OTHER_BINDING)


# ---- The panel of clearances: how near links come to obstacles and to each other, over time.

_MILLI = 1000.0
_TOP = 1.5  # of the largest distance: names stand above the curves
_STYLES: dict[str, tuple[str, Any]] = {
    OBSTACLES: (LINE_COLORS[1], "-"),
    SELF_COLLISION: (LINE_COLORS[0], (0, (5, 2))),
}
_WORDS = {OBSTACLES: "nearest obstacle", SELF_COLLISION: "nearest links"}


def draw_clearance(axis: "Axes", motions: Sequence[LimitedMotion]) -> None:
    """Draw the least distances in motions one after the other, and what is required, dashed.

    A point marks where a pair is nearest beyond what is required of it; the legend names the pair.
    """
    for kind, (color, dashes) in _STYLES.items():
        own = [(each.begin, pairs) for each in motions for pairs in each.closest]
        own = [(begin, pairs) for begin, pairs in own if pairs.kind == kind]
        for begin, pairs in own:
            is_known = np.isfinite(pairs.distance)
            shown = np.where(is_known, _MILLI * pairs.distance, np.nan)
            required = _MILLI * np.where(is_known, pairs.distance - pairs.margin, np.nan)
            look: dict[str, Any] = {"color": color, "linestyle": dashes, "linewidth": 1.6}
            axis.plot(begin + pairs.time, shown, **look)
            axis.plot(begin + pairs.time, required, **{**LIMIT, "color": color})
        margins = [float(pairs.margin.min()) for _, pairs in own]
        if margins and np.isfinite(min(margins)):
            begin, pairs = own[int(np.argmin(margins))]
            k = int(pairs.margin.argmin())
            distance = _MILLI * float(pairs.distance[k])
            label = f"{_WORDS[kind]}: {' - '.join(pairs.names[k])}, {distance:.3g} mm"
            look = {"color": color, "linestyle": dashes, "markersize": 5, "label": label}
            axis.plot(begin + pairs.time[k], distance, marker="o", **look)
    low, high = axis.get_ylim()
    axis.set_ylim(min(low, 0.0), _TOP * high)
    axis.set_ylabel("clearance [mm]")
    axis.legend(fontsize=7, loc="upper center", handlelength=3.0)
