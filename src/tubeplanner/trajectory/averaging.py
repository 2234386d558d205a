"""Trajectories averaged over neighbouring intervals of time."""

import numpy as np

from tubeplanner.trajectory.b_spline import BSpline
from tubeplanner.trajectory.joint_trajectory import JointTrajectory, from_spline

_DEGREE = 3


def averaged(trajectory: JointTrajectory, intervals: int, duration: float) -> JointTrajectory:
    """Return a C2 cubic spline on equal intervals whose control points lie on a trajectory.

    Schoenberg's operator (de Boor, "A Practical Guide to Splines", chapter XI): what never falls
    never falls averaged. The first three control points are the start and the last three the goal,
    so that it begins and ends at rest and without acceleration.

    Args:
        trajectory: At any speed.
        intervals: How many, at least 3.
        duration: Of the spline [s].
    """
    knots = np.linspace(0.0, 1.0, intervals + 1)
    knots = np.concatenate([np.zeros(_DEGREE), knots, np.ones(_DEGREE)])
    means = (knots[1:-3] + knots[2:-2] + knots[3:-1]) / _DEGREE  # where control points belong
    first, last = means[2], means[-3]
    share = np.clip((means - first) / (last - first), 0.0, 1.0)
    control_points = trajectory.position(share * trajectory.duration)
    return from_spline(trajectory.joint_names, BSpline(knots * duration, control_points, _DEGREE))
