"""Which panels over time a motion's figure has."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from tubeplanner.views.panels import (
    draw_accelerations,
    draw_effort_rates,
    draw_efforts,
    draw_jerks,
    draw_points,
    draw_positions,
    draw_speed,
    draw_tube_use,
    draw_velocities,
)
from tubeplanner.views.stretch import TrajectoryCurves

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DrawPanel: TypeAlias = "Callable[[Axes, TrajectoryCurves], None]"


def time_panels(runs: Sequence[TrajectoryCurves]) -> list[DrawPanel]:
    """Return what draws the panels of motions of one arm.

    Accelerations, jerks, effort rates and points' speeds have one where they are limited.
    """
    limits = runs[0].problem.robot.limits
    found: list[DrawPanel] = [draw_positions, draw_velocities]
    found += [draw_accelerations] if np.isfinite(limits.acceleration).any() else []
    found += [draw_jerks] if np.isfinite(limits.jerk).any() else []
    found.append(draw_efforts)
    found += [draw_effort_rates] if np.isfinite(limits.effort_rate).any() else []
    found.append(draw_speed)
    found += [draw_points] if limits.point_speed else []
    return [*found, draw_tube_use]
