"""The panel "what binds when": a row per joint, of the tool and of the links, over time."""

from typing import TYPE_CHECKING, Any

from tubeplanner.constraints.binding_limits import Span
from tubeplanner.views.binding_strip import BindingStrip
from tubeplanner.views.palette import BINDING_STYLES, OTHER_BINDING, BindingStyle
from tubeplanner.views.panels import line_style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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
