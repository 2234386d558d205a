"""The panel of clearances: how near links come to obstacles and to each other, over time."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tubeplanner.constraints.closest_pairs import OBSTACLES, SELF_COLLISION
from tubeplanner.views.binding_strip import LimitedMotion
from tubeplanner.views.palette import LINE_COLORS
from tubeplanner.views.panels import LIMIT

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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
