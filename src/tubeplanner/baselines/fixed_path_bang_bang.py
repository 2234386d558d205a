"""Bang-bang control on given paths: the least time in which the arm can run them, rest to rest.

At every instant some motor or velocity is at its limit, and motors switch instantly: the
acceleration jumps. (Bobrow, Dubowsky & Gibson, "Time-optimal control of robotic manipulators along
specified paths", 1985; Shin & McKay, 1985.)
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.baselines.fastest_parameterization import fastest_parameterization
from tubeplanner.baselines.time_parameterization import run_along
from tubeplanner.baselines.tool_path import ToolPath
from tubeplanner.constraints.time_scaling import minimum_duration
from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory, concatenate

# Steps between the points where limits are judged: of a whole path, and of each line or arc in it.
_PATH_STEPS, _PIECE_STEPS = 800, 400


def bang_bang_parameterizations(
    problem: PlanningProblem, paths: Sequence[ToolPath]
) -> list[JointTrajectory]:
    """Return the fastest time parameterization of each path, from rest to rest.

    Raises:
        Infeasible: Gravity exceeds a motor's effort, or no time parameterization is found.
    """
    return [_parameterization(problem, path) for path in paths]


def bang_bang_trajectory(
    problem: PlanningProblem, paths: Sequence[ToolPath], timings: Sequence[JointTrajectory]
) -> tuple[JointTrajectory, float]:
    """Return the trajectory along paths with these time parameterizations: degree 6, within limits.

    The time parameterizations keep the limits at points of their paths; all are slowed uniformly by
    the share by which the trajectory exceeds limits in between. Limits of jerk are left out, since
    the acceleration jumps.

    Returns:
        The trajectory, and the share by which it is slowed.
    """
    runs = [run_along(path.joints, timing) for path, timing in zip(paths, timings, strict=True)]
    trajectory = concatenate(runs)
    share = minimum_duration(problem, trajectory, with_jerk=False) / trajectory.duration
    return trajectory.scaled(share), share - 1


def _parameterization(problem: PlanningProblem, path: ToolPath) -> JointTrajectory:
    timing = fastest_parameterization(problem, path.joints, _grid(path))
    if timing is None:
        raise Infeasible(
            PlanStatus.NO_TRAJECTORY,
            f"segment {path.segment}: TOPP-RA finds no speed at which the arm can run the tool's "
            "curve from rest to rest; move the reference points",
            Place(segment=path.segment),
        )
    return timing


def _grid(path: ToolPath) -> FloatArray:
    """Return arc lengths (N,) from the path's start to its end, all breakpoints among them."""
    breakpoints, length = path.joints.breakpoints, path.joints.duration
    least = max(_PATH_STEPS, _PIECE_STEPS * len(path.curve.start))
    counts = np.ceil(least * path.joints.widths / length).astype(int)
    parts = [
        np.linspace(begin, end, count, endpoint=False)
        for (begin, end), count in zip(pairwise(breakpoints), counts, strict=True)
    ]
    return np.append(np.concatenate(parts), length)
