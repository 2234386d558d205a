"""How soon an arm comes to rest along its own path, from wherever on it.

The state is the place on the trajectory and the speed p at which its time runs, 1 before the arm
brakes. From every place, p^2 is lowered over the steps of a grid as steeply as the limits allow, in
which p' is bounded from both sides by every limit (Bobrow, Dubowsky & Gibson, "Time-optimal control
of robotic manipulators along specified paths", 1985). A step keeps one p', which suits the limits
at both its ends.
"""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.outcome import Place
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.verification.limit_sides import LimitSides, acceleration_sides, effort_sides
from tubeplanner.verification.path_steps import PathSteps, path_steps

_STEP = 1e-3  # [s]; at most, unless that makes too many
_FEWEST, _MOST = 1000, 20_000
_TANGENT, _CHORD = 0.5, 1.0


@dataclass(frozen=True)
class Braking:
    """Within what time and way an arm can come to rest along its path.

    Attributes:
        time: An upper bound on the shortest time, whenever the arm begins to brake [s].
        distance: Likewise of the way that the tool centre point takes [m].
        where: Where it begins to brake if it takes the longest way.
    """

    time: float
    distance: float
    where: Place


def worst_braking(
    robot: RobotModel, trajectory: JointTrajectory, tolerance: float
) -> Braking | None:
    """Return the bounds for the worst instant at which an arm may begin to brake.

    Efforts, torque-speed lines, velocities and accelerations stay in their limits; jerks and effort
    rates need not. The bounds come from at least 1,000 steps, of at most 1 ms where 20,000 of them
    suffice, in which the limits hold at both ends; one step is added for an instant between.

    Args:
        robot: The arm.
        trajectory: In its joint order, itself within the limits, at rest at both ends.
        tolerance: How much of each limit may be used beyond it.

    Returns:
        None if nothing limits efforts and accelerations.
    """
    count = np.clip(np.ceil(trajectory.duration / _STEP), _FEWEST, _MOST)
    steps = path_steps(trajectory, int(count), 1)
    sides = LimitSides.joined([effort_sides(robot, steps), acceleration_sides(robot, steps)])
    if len(sides.joint) == 0:
        return None
    width, length = steps.width, _tool_lengths(robot, steps)
    every = -(-len(width) // (2 * _MOST))
    starts = np.arange(0, len(width), every)
    table = np.stack([1 + tolerance - sides.static, sides.linear, sides.square, sides.change])
    with np.errstate(divide="ignore", invalid="ignore"):  # a side that nothing takes from
        time, distance = _rests(table.reshape(4, 2, len(width), -1), width, length, starts)
    # Whoever wants to brake after the start before it, runs on until then.
    time[1:] += np.add.reduceat(width, starts)[:-1]
    distance[1:] += np.add.reduceat(length, starts)[:-1]
    begins = steps.start[starts]
    worst = int(distance.argmax())
    tool = robot.tool_position(trajectory.position(begins[worst : worst + 1]))[0]
    where = Place(time=float(begins[worst])).at(tool)
    return Braking(float(time.max()), float(distance[worst]), where)


def _tool_lengths(robot: RobotModel, steps: PathSteps) -> FloatArray:
    """Return the way of the tool centre point in every step, (S,) [m]."""
    jacobian = robot.tool_jacobian(steps.at_ends(0))[1][:, :3]
    speed = np.linalg.norm(np.einsum("nij,nj->ni", jacobian, steps.at_ends(1)), axis=1)
    length: FloatArray = speed.reshape(2, -1).mean(axis=0) * steps.width
    return length


def _rests(
    sides: FloatArray, width: FloatArray, length: FloatArray, starts: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return time and way to rest of those who brake from the start of given steps, each (K,).

    Who cannot brake at some place could have run on to the end of the trajectory.
    """
    bounds = np.stack([np.cumsum(part[::-1])[::-1][starts] for part in (width, length)])
    run, step = np.arange(len(starts)), starts
    square, spent = np.ones(len(starts)), np.zeros((2, len(starts)))
    while len(run):
        h = width[step]
        rate, is_possible = _steepest(sides[:, :, step], h, square)
        after = np.maximum(square + 2 * h * rate, 0.0)
        share = np.where(after > 0, 1.0, -square / (2 * h * rate))
        spent += [2 * share * h / (np.sqrt(square) + np.sqrt(after)), share * length[step]]
        rests = is_possible & ((after == 0) | (step == len(width) - 1))
        bounds[:, run[rests]] = np.minimum(bounds[:, run[rests]], spent[:, rests])
        goes_on = is_possible & ~rests
        run, step, square, spent = (
            run[goes_on],
            step[goes_on] + 1,
            after[goes_on],
            spent[:, goes_on],
        )
    return bounds[0], bounds[1]


def _steepest(
    sides: FloatArray, width: FloatArray, square: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Return the least mean p' over a step for each of K runs, and where there is one: (K,).

    p' changes evenly over p's way; before rest, where that fails, it stays.

    Args:
        sides: What is left at p = 0, and what p, p^2 and p' take, at both ends: (4, 2, K, R).
        width: Of the steps, shape (K,) [s].
        square: p^2 at their starts, shape (K,).
    """
    change = sides[3]
    at_start, at_end, by_square = _left(sides, width, square)
    first, is_first = _least(change[0], at_start)
    last, is_last = _least(change[1] + by_square, at_end - by_square * first[:, None])
    rate, is_possible = (first + last) / 2, is_first & is_last
    others = ~(is_possible & (square + 2 * width * rate > 0))
    if others.any():
        rate[others], is_possible[others] = _steady(
            sides[:, :, others], width[others], square[others]
        )
    return rate, is_possible


def _steady(
    sides: FloatArray, width: FloatArray, square: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Return the least p' that suits both ends of a step, as `_steepest`."""
    left, change = sides[0], sides[3]
    at_start, at_end, by_square = _left(sides, width, square)
    taken = np.hstack([change[0], change[1] + 2 * by_square])
    rate, is_possible = _least(taken, np.hstack([at_start, at_end]))
    # Those who rest before the end are asked what they would be at rest there.
    at_rest = np.hstack([at_start, left[1]])
    harder, can_rest = _least(np.hstack([change[0], change[1]]), at_rest)
    to_rest = -square / (2 * width)
    rests = is_possible & (rate <= to_rest)
    return np.where(rests, np.minimum(harder, to_rest), rate), is_possible & (can_rest | ~rests)


def _left(
    sides: FloatArray, width: FloatArray, square: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what p leaves at both ends if it stays, and what p' takes of it at the end.

    That is by p^2, which grows over the step by its width times both ends' p'. The root of it is
    below its tangent at the start and, as p falls, above its chord from zero.
    """
    left, linear, quadratic, _ = sides
    p = np.sqrt(square)[:, None]
    at_start, at_end = left - linear * p - quadratic * square[:, None]
    bend = np.where(linear[1] > 0, _TANGENT, _CHORD) * linear[1] / p
    return at_start, at_end, width[:, None] * (quadratic[1] + bend)


def _least(taken: FloatArray, left: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return the least p' with taken p' <= left in all C columns, (K,), and if it is at most 0."""
    ratio = left / taken
    least = np.where(taken < 0, ratio, -np.inf).max(axis=1)
    most = np.where(taken > 0, ratio, 0.0).min(axis=1)
    is_blocked = ((taken == 0) & (left < 0)).any(axis=1)
    return least, (least <= np.minimum(most, 0.0)) & ~is_blocked
