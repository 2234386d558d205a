"""A judged run made by hand."""

from typing import Any

import numpy as np

from tubeplanner.outcome import Place
from tubeplanner.simulation.executed_tube import Extreme
from tubeplanner.simulation.judged_runs import JudgedRun


def judged_run(**given: Any) -> JudgedRun:
    """Return a run that keeps everything at its bounds, but for what is given."""
    bounds = Extreme(0.0, Place())
    usual = {
        "tube": bounds,
        "rotation": None,
        "points": None,
        "tracking": bounds,
        "tool_tracking": bounds,
        "position": bounds,
        "velocity": None,
        "saturated": 0.0,
        "obstacles": None,
        "self_collision": None,
        "clearance": 0.0,
        "tube_by_segment": np.zeros(1),
        "rotation_by_segment": np.array([-1e3]),
        "position_by_joint": np.array([[-1e3], [0.0]]),
    }
    return JudgedRun(**(usual | given))
