"""The panels of an execution's figure: a quantity of the plan and of all runs over time."""

from typing import TYPE_CHECKING, Any

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.views.execution_curves import Band
from tubeplanner.views.palette import EXECUTED_COLOR, WARNING_COLOR
from tubeplanner.views.panels import LIMIT

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_PLAN: dict[str, Any] = {"color": "#000000", "linewidth": 1.3}
_BANDS = (((0.0, 1.0), 0.28, "all runs"), ((0.25, 0.75), 0.5, "half of the runs"))
_MILLI = 1e3
_LEAST_ROOM = 0.1  # [mm or mrad]
_COLUMNS = 250  # in which saturation is shown


def draw_margin(axis: "Axes", band: Band, label: str, least: float = 0.0) -> None:
    """Draw what is left of a tolerance, in another colour where runs have nothing left.

    Where much is left the panel ends.

    Args:
        axis: Where.
        band: In m or rad.
        label: Of the axis, in mm or mrad.
        least: What is asked, in m or rad.
    """
    draw_band(axis, band, label, least)
    bound = _MILLI * least
    axis.axhline(bound, **{**LIMIT, "linewidth": 1.4}, label="limit")
    values = _MILLI * np.vstack([band.runs, band.plan]) - bound
    low, top = float(np.nanmin(values)), float(np.nanmax(values))
    nearest = float(np.nanmin(values[-1]))  # of the plan, which is always seen there
    room = min(top, max(-3 * low, 2 * nearest, 0.25 * top))
    room = max(room, 0.1 * abs(low), _LEAST_ROOM)
    axis.set_ylim(bound + min(1.25 * low, -0.12 * room), bound + 1.1 * room)


def draw_band(axis: "Axes", band: Band, label: str, least: float = -np.inf) -> None:
    """Draw the plan as a line, all runs and half of them as bands.

    Args:
        axis: Where.
        band: In m or rad.
        label: Of the axis, in mm or mrad.
        least: In m or rad; what is below it has another colour.
    """
    bound = _MILLI * least
    for shares, alpha, name in _BANDS:
        low, high = _MILLI * _quantiles(band.runs, shares)
        look: dict[str, Any] = {"alpha": alpha, "linewidth": 0.7}
        above, below = (np.maximum(low, bound), high), (low, np.minimum(high, bound))
        look |= {"where": high >= bound, "color": EXECUTED_COLOR}
        axis.fill_between(band.time, *above, **look, label=name)
        if np.nanmin(low) < bound:
            look |= {"where": low < bound, "color": WARNING_COLOR, "alpha": alpha + 0.2}
            axis.fill_between(band.time, *below, **look)
    axis.plot(band.time, _MILLI * band.plan, **_PLAN, label="plan")
    axis.set_ylabel(label)


def _quantiles(runs: FloatArray, shares: tuple[float, ...]) -> FloatArray:
    """Return quantiles of R runs (R, K), NaN left out, shape (len(shares), K); NaN of nothing."""
    found = np.full((len(shares), runs.shape[1]), np.nan)
    known = ~np.isnan(runs).all(axis=0)
    found[:, known] = np.nanquantile(runs[:, known], shares, axis=0)
    return found


def draw_saturation(
    axis: "Axes", robot: RobotModel, time: FloatArray, is_saturated: BoolArray
) -> None:
    """Draw in what share of R runs each motor is at its limit, one row a joint.

    Args:
        axis: Where.
        robot: Whose motors.
        time: Shape (K,) [s].
        is_saturated: Shape (R, K, n).
    """
    from matplotlib.colors import LinearSegmentedColormap

    colors = LinearSegmentedColormap.from_list("white to red", ["#FFFFFF", WARNING_COLOR])
    first = np.arange(0, len(time), -(-len(time) // _COLUMNS))
    count = np.diff(first, append=len(time))
    share = 100 * np.add.reduceat(is_saturated.mean(axis=0), first).T / count
    rows = np.arange(robot.joint_count + 1) - 0.5
    edges = np.append(time[first], time[-1])
    image = axis.pcolormesh(edges, rows, share, cmap=colors, vmin=0, vmax=100, rasterized=True)
    axis.set_yticks(range(robot.joint_count), robot.joint_names, fontsize=7)
    axis.invert_yaxis()
    bar = axis.figure.colorbar(image, ax=axis, pad=0.01, aspect=12)
    bar.set_label("at the limit\n[% of runs]", fontsize=8)
