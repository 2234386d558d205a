"""How fast motors that switch instantly could run the path of a trajectory.

What this needs and plans do not is imported when first asked for.
"""

import numpy as np

from tubeplanner.polyline import arc_lengths
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

_GRID_POINTS = 1600
# Points of the path nearer to each other than this share of its length are one: rounding errors
# between them would look like curvature.
_APART = 1e-6


def path_minimum(problem: PlanningProblem, trajectory: JointTrajectory) -> float | None:
    """Return the least time [s] for the path of a trajectory, from rest to rest.

    Under the limits of velocity, acceleration, effort, motors and tool speed at 1,600 points of the
    path, jerk and effort rate unlimited: good to about 0.1 %; less where segments with different
    tool speeds overlap, since the loosest of them counts. With viscous friction or torque-speed
    lines it is the least that was found, an upper bound on the least that there is; on the paths of
    bundled problems, the phase plane searched finely has none that is 0.2 % less.

    Args:
        problem: The planning problem.
        trajectory: Whose path is meant, of the problem's joints in their order.

    Returns:
        The time, or None if the solver finds none.
    """
    from tubeplanner.baselines.fastest_parameterization import fastest_parameterization

    path = _by_length(trajectory)
    timing = fastest_parameterization(problem, path, path.breakpoints, at_both_ends=False)
    return None if timing is None else timing.duration


def _by_length(trajectory: JointTrajectory) -> JointTrajectory:
    """Return the path over the arc length in joint space, from 0 to 1.

    Its points are equal times apart, so that they are close together wherever the trajectory rests:
    there the path begins, ends, or has a corner.
    """
    from scipy.interpolate import CubicSpline

    q = trajectory.position(np.linspace(0, trajectory.duration, _GRID_POINTS))
    arc_length = arc_lengths(q)
    _, apart = np.unique(np.floor(arc_length / (_APART * arc_length[-1])), return_index=True)
    spline = CubicSpline(arc_length[apart] / arc_length[apart[-1]], q[apart])
    return JointTrajectory(trajectory.joint_names, spline.x, spline.c)
