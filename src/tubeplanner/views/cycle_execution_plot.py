"""The figure of an executed cycle: what is left of tolerances over time, from move to move."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np

from tubeplanner.cycle.cycle_motion import CycleMotion
from tubeplanner.simulation.executed_legs import ExecutedLeg, executed_legs
from tubeplanner.simulation.execution import Execution
from tubeplanner.simulation.judged_cycle import JudgedCycle
from tubeplanner.simulation.run_verdict import run_verdict
from tubeplanner.views.cycle_marks import mark_moves, name_steps
from tubeplanner.views.cycle_timeline import cycle_timeline
from tubeplanner.views.execution_curves import Band, obstacle_band, tool_runs
from tubeplanner.views.execution_panels import draw_band, draw_margin, draw_saturation
from tubeplanner.views.figure_files import new_figure, saved

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_TITLE_WIDTH = 110  # [characters]
_LETTER = 0.0055  # of the panel: what a letter of a name is wide


def plot_cycle_execution(
    motion: CycleMotion,
    execution: Execution,
    judged: JudgedCycle,
    path: str | Path | None = None,
) -> "Figure":
    """Draw how arms executed a cycle: what is left of tolerances over time.

    Of the plan and of all runs: how far inside the tube of its move the tool is; how far inside the
    rotation tolerance, if there is one; how much farther from obstacles links are than they must
    be, if there are some; how far the tool is from the plan; and in what share of the runs each
    motor is at its limit. Lines and names mark what happens at rest.

    Args:
        motion: What was to be executed.
        execution: What was.
        judged: What `judged_cycle` says of that.
        path: Where to save the figure, as PNG, PDF or SVG by its ending; None: nowhere.

    Returns:
        The figure.

    Raises:
        OptionError: The file has another ending.
        OutputError: The file could not be written.
    """
    draws = _over_time(motion, execution)
    whole = new_figure(14.0, 2.0 + 1.9 * len(draws))
    verdict = fill(str(run_verdict(judged.runs)), _TITLE_WIDTH)
    duration = motion.trajectory.duration
    whole.suptitle(f"{motion.cycle.name}: {duration:.4f} s, executed\n{verdict}", fontsize=13)
    axes = whole.subplots(len(draws), 1, sharex=True, squeeze=False)[:, 0]
    timeline, end = cycle_timeline(motion), float(execution.time[-1])
    for axis, draw in zip(axes, draws, strict=True):
        draw(axis)
        mark_moves(axis, timeline, end, names=axis is axes[0], letter=_LETTER)
        axis.set_xlabel("time [s]" if axis is axes[-1] else "")
    name_steps(axes[-2], timeline, end)  # where curves are low at rest: the tool from the plan
    handles, labels = axes[0].get_legend_handles_labels()
    whole.legend(handles, labels, fontsize=8, ncols=4, loc="outside lower center", frameon=False)
    return saved(whole, path)


def _over_time(motion: CycleMotion, execution: Execution) -> list[Callable[["Axes"], None]]:
    """Return what draws the panels over time, from top to bottom."""
    legs = executed_legs(motion, execution)
    tools = [tool_runs(leg.problem, leg.trajectory, leg.execution) for leg in legs]
    draws: list[Callable[[Axes], None]] = []
    margins: dict[str, list[Band | None]] = {
        "inside the tube [mm]": [tool.tube for tool in tools],
        "inside the rotation\ntolerance [mrad]": [tool.rotation for tool in tools],
        "farther from obstacles\nthan asked [mm]": [_beyond_clearance(leg) for leg in legs],
    }
    for label, bands in margins.items():
        if any(band is not None for band in bands):
            joined = _joined(legs, bands)
            draws.append(partial(draw_margin, band=joined, label=label))
    away = [np.linalg.norm(tool.runs - tool.plan, axis=2) for tool in tools]
    times = [leg.execution.time for leg in legs]
    tracking = [Band(time, 0 * time, runs) for time, runs in zip(times, away, strict=True)]
    draws.append(partial(draw_band, band=_joined(legs, tracking), label="tool from\nthe plan [mm]"))
    look = partial(draw_saturation, robot=motion.cycle.robot, time=execution.time)
    return [*draws, partial(look, is_saturated=execution.is_saturated)]


def _beyond_clearance(leg: ExecutedLeg) -> Band | None:
    """Return how much farther from obstacles links are than a leg asks [m]."""
    band = obstacle_band(leg.problem, leg.trajectory, leg.execution)
    asked = leg.problem.clearance
    return None if band is None else Band(band.time, band.plan - asked, band.runs - asked)


def _joined(legs: Sequence[ExecutedLeg], bands: Sequence[Band | None]) -> Band:
    """Return bands of all legs as one in times of the cycle, with gaps between them."""
    runs = len(legs[0].execution.plants)
    known = [(leg.begin, band) for leg, band in zip(legs, bands, strict=True) if band is not None]
    return Band(
        np.concatenate([begin + np.append(band.time, band.time[-1]) for begin, band in known]),
        np.concatenate([np.append(band.plan, np.nan) for _, band in known]),
        np.hstack([np.column_stack([band.runs, np.full(runs, np.nan)]) for _, band in known]),
    )
