"""Short smooth bumps of one joint: defects that samples of a trajectory do not see."""

from itertools import pairwise

import numpy as np

from tubeplanner import JointTrajectory
from tubeplanner.trajectory.joint_trajectory import concatenate


def with_bump(trajectory, joint, begin, width, size):
    """Return the trajectory with a bump of one joint, as high as `size` [rad or m].

    64 u^3 (1 - u)^3 is 1 at u = 1/2 and has neither slope nor curvature at its ends.
    """
    cuts = [0.0, begin, begin + width, trajectory.duration]
    parts = [trajectory.between(low, high) for low, high in pairwise(cuts)]
    rows = [np.zeros((7, *part.coefficients.shape[1:])) for part in parts]
    for row, part in zip(rows, parts, strict=True):
        row[7 - len(part.coefficients) :] = part.coefficients
    assert rows[1].shape[1] == 1, "the bump must lie within one piece"
    bump = np.array([-1.0, 3, -3, 1, 0, 0, 0]) / width ** np.arange(6, -1, -1)
    rows[1][:, 0, joint] += 64 * size * bump
    names = trajectory.joint_names
    return concatenate(
        [JointTrajectory(names, p.breakpoints, row) for p, row in zip(parts, rows, strict=True)]
    )
