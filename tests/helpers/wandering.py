"""Cubics of all joints that wander about, continuous in position only."""

import numpy as np

from tubeplanner import JointTrajectory


def wandering(robot, seed, pieces=4, width=0.1):
    """Return pieces of a width [s] that begin within a radian of zero, within the limits."""
    rng = np.random.default_rng(seed)
    n = robot.joint_count
    first = np.clip(rng.uniform(-1, 1, n), robot.limits.lower_position, robot.limits.upper_position)
    knots = first + np.cumsum(rng.uniform(-0.3, 0.35, (pieces + 1, n)), axis=0)
    bend = rng.uniform(-3, 3, (pieces, n))
    slope = np.diff(knots, axis=0) / width - bend * width
    coefficients = np.stack([bend, slope, knots[:-1]])
    return JointTrajectory(robot.joint_names, width * np.arange(pieces + 1), coefficients)
