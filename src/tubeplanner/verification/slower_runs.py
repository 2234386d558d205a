"""Whether a trajectory can be run slower: where motors that suffice at full speed do not.

Efforts over the speed p from 0 to 1 are quadratics in p, their rates cubics. Where inertia takes
load off a motor, as that of an arm that falls, the most is needed at rest or somewhere between.
"""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.outcome import Place
from tubeplanner.robot.effort_rate import effort_rate, gravity_effort_rate
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.verification.limit_sides import effort_sides
from tubeplanner.verification.path_steps import PathSteps, path_steps

_STEPS, _STEPS_PER_PIECE = 2000, 20
_AT_ONCE = 4000  # steps, for memory


@dataclass(frozen=True)
class SlowerRun:
    """What one slower run leaves of one limit.

    Attributes:
        condition: The limit, as the certificate calls it.
        margin: 1 minus the used share of it.
        speed: How fast the trajectory is run: 1 is as fast as it is, 0 stands for as slowly as you
            like.
        where: Of the trajectory, in its own time.
    """

    condition: str
    margin: float
    speed: float
    where: Place


def tightest_slower_run(robot: RobotModel, trajectory: JointTrajectory) -> SlowerRun | None:
    """Return the slower run with the least margin in effort, torque-speed line or effort rate.

    Of speeds it is the exact one; of the trajectory 2,000 samples are looked at, and 20 of every
    piece, both sides of breakpoints and of where joints turn round.

    Args:
        robot: The arm.
        trajectory: In its joint order.

    Returns:
        None if nothing limits efforts.
    """
    steps = path_steps(trajectory, _STEPS, _STEPS_PER_PIECE)
    parts = range(0, len(steps.piece), _AT_ONCE)
    found = [_tightest(robot, steps.part(begin, begin + _AT_ONCE)) for begin in parts]
    return min((run for run in found if run is not None), key=lambda run: run.margin, default=None)


def _tightest(robot: RobotModel, steps: PathSteps) -> SlowerRun | None:
    sides = effort_sides(robot, steps)
    rates = _rate_polynomials(robot, steps)
    none = np.zeros_like(sides.static)
    smooth = np.stack([sides.static, sides.linear, sides.square, none])
    limited = np.flatnonzero(np.isfinite(robot.limits.effort_rate))
    names = sides.condition + ("effort_rate",) * rates.shape[2]
    joint = np.concatenate([sides.joint, limited, limited])
    if not names:
        return None
    used, speed = highest_up_to_one(np.concatenate([smooth, rates], axis=2))
    end, row = np.unravel_index(int(used.argmax()), used.shape)
    time = (steps.start + np.array([[0.0], [1.0]]) * steps.width).ravel()[end]
    where = Place(time=float(time), joint=robot.joint_names[joint[row]])
    return SlowerRun(names[row], 1 - float(used[end, row]), float(speed[end, row]), where)


def _rate_polynomials(robot: RobotModel, steps: PathSteps) -> FloatArray:
    """Return the used shares of limits on effort rates, by power of the speed: (4, N, R).

    As the certificate judges them: viscous friction as it is given.
    """
    limit = robot.limits.effort_rate
    joints = np.flatnonzero(np.isfinite(limit))
    if len(joints) == 0:
        return np.zeros((4, 2 * len(steps.piece), 0))
    q, v, a, jerk = (steps.at_ends(order) for order in range(4))
    gravity, friction = gravity_effort_rate(robot, q, v), robot.motors.viscous_friction * a
    inertia = effort_rate(robot, q, v, a, jerk) - gravity - friction
    ways = [way * np.stack([0 * gravity, gravity, friction, inertia]) for way in (1.0, -1.0)]
    return np.concatenate([way[:, :, joints] / limit[joints] for way in ways], axis=2)


def highest_up_to_one(coefficients: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the largest values of cubics for arguments from 0 to 1, and at which, each (...).

    Args:
        coefficients: Lowest power first, shape (4, ...).
    """
    _, one, two, three = coefficients
    # Where the derivative vanishes; any candidate outside, or none at all, is moved to an end.
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(np.maximum(two**2 - 3 * one * three, 0.0))
        sum_ = -(two + np.copysign(root, two))
        turns = np.nan_to_num(np.clip([sum_ / (3 * three), one / sum_], 0.0, 1.0))
    argument = np.concatenate([np.zeros_like(turns[:1]), np.ones_like(turns[:1]), turns])
    value = np.zeros_like(argument)
    for row in coefficients[::-1]:
        value = value * argument + row
    best = value.argmax(axis=0)[None]
    highest = np.take_along_axis(value, best, axis=0)[0]
    return highest, np.take_along_axis(argument, best, axis=0)[0]
