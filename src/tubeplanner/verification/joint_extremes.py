"""Where polynomials of the joints come nearest to their bounds, exactly."""

from typing import NamedTuple

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.trajectory.bernstein import Extrema, maxima
from tubeplanner.trajectory.joint_trajectory import JointTrajectory


class Highest(NamedTuple):
    """The largest of several extrema.

    Attributes:
        value: In the unit of the polynomials.
        time: From the trajectory's begin [s].
        column: Which extremum it is.
    """

    value: float
    time: float
    column: int


class JointMargin(NamedTuple):
    """The least margin between joints and their ranges.

    Attributes:
        margin: [rad or m]
        time: From the trajectory's begin [s].
        joint: Name of the joint.
    """

    margin: float
    time: float
    joint: str


def highest(extrema: Extrema, trajectory: JointTrajectory) -> Highest:
    """Return the largest of a trajectory's extrema."""
    column = int(extrema.value.argmax())
    start = trajectory.breakpoints[extrema.piece[column]]
    return Highest(float(extrema.value[column]), float(start + extrema.local_time[column]), column)


def range_margin(
    trajectory: JointTrajectory, lower: FloatArray, upper: FloatArray
) -> JointMargin | None:
    """Return the least margin between joints and their ranges; None if no joint has any.

    Args:
        trajectory: Of n joints.
        lower: Shape (n,) [rad or m]; minus infinity where there is no bound.
        upper: Likewise, infinity where there is no bound.
    """
    over, joints = [], []
    for sign, bound in ((1.0, upper), (-1.0, -lower)):
        bounded = np.flatnonzero(np.isfinite(bound))
        beyond = sign * trajectory.coefficients[:, :, bounded]
        beyond[-1] -= bound[bounded]
        over.append(beyond)
        joints += bounded.tolist()
    if not joints:
        return None
    worst = highest(maxima(np.concatenate(over, axis=2), trajectory.widths), trajectory)
    return JointMargin(-worst.value, worst.time, trajectory.joint_names[joints[worst.column]])
