"""Arms that are something else from some time on, since they carry something else."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.short_repr import short_repr
from tubeplanner.simulation.plant import Plant

_SAME_INSTANT = 1e-9  # [s], of rounding


@dataclass(frozen=True, eq=False)
class Stage:
    """What arms are from some time on, until the next stage.

    Attributes:
        begin: From when on [s].
        robot: What the controller takes them for.
        plants: What they are; of all stages equally many, with equal delays and noise.
    """

    begin: float
    robot: RobotModel
    plants: Sequence[Plant]

    __repr__ = short_repr


def first_instant(time: FloatArray, begin: float) -> int:
    """Return the first of some instants, increasing [s], that is no earlier than a time [s]."""
    return int(np.searchsorted(time, begin - _SAME_INSTANT))


def last_instant(time: FloatArray, end: float) -> int:
    """Return the last of some instants, increasing [s], that is no later than a time [s]."""
    return int(np.searchsorted(time, end + _SAME_INSTANT, side="right")) - 1
