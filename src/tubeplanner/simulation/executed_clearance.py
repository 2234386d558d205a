"""How near executed motions come to obstacles and to themselves, at samples."""

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.outcome import Place
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.simulation.executed_tube import Extreme

_AT_ONCE = 64  # pairs measured before the others are looked at again


def least_clearances(
    problem: PlanningProblem, time: FloatArray, q: FloatArray, base: FloatArray
) -> tuple[Extreme | None, Extreme | None]:
    """Return the least distances of links from obstacles and from each other [m].

    Args:
        problem: The planning problem.
        time: Of K samples, shape (K,) [s].
        q: Positions of the joints, shape (K, n).
        base: By how much the robot is shifted among the obstacles, shape (3,) [m].

    Returns:
        Each None where no such pair is judged; negative where solids overlap.
    """
    rotation, position = problem.robot.body_poses(q)
    checker = problem.collision
    return (
        _least(problem, time, rotation, _shifted(position, base), checker.obstacle_pairs),
        _least(problem, time, rotation, position, checker.link_pairs),
    )


def obstacle_distances(problem: PlanningProblem, q: FloatArray, base: FloatArray) -> FloatArray:
    """Return the least distance of links from obstacles at each of K samples, shape (K,) [m].

    Args:
        problem: With a pair of link and obstacle that is judged, at least.
        q: Positions of the joints, shape (K, n).
        base: As for `least_clearances`.
    """
    rotation, position = problem.robot.body_poses(q)
    position, checker = _shifted(position, base), problem.collision
    pairs = checker.obstacle_pairs
    bound = checker.sphere_distances(rotation, position, pairs)
    lowest = pairs[bound.argmin(axis=1)]
    least: FloatArray = checker.closest_points(rotation, position, lowest).distance
    row, column = np.nonzero(bound < least[:, None])
    nearer = checker.box_distances(rotation, position, row, pairs[column]) < least[row]
    row, column = row[nearer], column[nearer]
    others = checker.closest_points(rotation[row], position[row], pairs[column])
    np.minimum.at(least, row, others.distance)
    return least


def _shifted(position: FloatArray, base: FloatArray) -> FloatArray:
    """Return positions (K, bodies, 3) of a shifted robot; body 0 carries the obstacles."""
    shifted = position.copy()
    shifted[:, 1:] += base
    return shifted


def _least(
    problem: PlanningProblem,
    time: FloatArray,
    rotation: FloatArray,
    position: FloatArray,
    pairs: IntArray,
) -> Extreme | None:
    """Return the least distance of pairs (P, 2), measured where quick bounds are lowest first."""
    if len(pairs) == 0:
        return None
    checker = problem.collision
    bound = checker.sphere_distances(rotation, position, pairs)
    # Measured before anything is left out: a bound that is exact may be above it by rounding.
    lowest = bound.argmin(axis=0)
    found = checker.closest_points(rotation[lowest], position[lowest], pairs).distance
    least, column = float(found.min()), int(found.argmin())
    place = int(lowest[column]), column
    rows, columns = np.nonzero(bound < least)
    closer = checker.box_distances(rotation, position, rows, pairs[columns])
    order = np.argsort(closer, kind="stable")
    for chosen in np.split(order, range(_AT_ONCE, len(order), _AT_ONCE)):
        chosen = chosen[closer[chosen] < least]
        if len(chosen) == 0:
            break
        row, pair = rows[chosen], columns[chosen]
        found = checker.closest_points(rotation[row], position[row], pairs[pair]).distance
        if found.min() < least:
            least, best = float(found.min()), int(found.argmin())
            place = int(row[best]), int(pair[best])
    links, obstacle = checker.owners(pairs[place[1]])
    where = Place(time=float(time[place[0]]), links=links, obstacle=obstacle)
    return Extreme(least, where)
