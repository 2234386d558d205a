"""How near executed motions come to obstacles and to themselves, at samples.

Pairs are measured where quick bounds are lowest. The direction that separates a pair there bounds
its distance at all other samples, nearly everywhere beyond the least that has been measured. Of
shapes that overlap by many centimetres, measured distances are too low by up to as much.
"""

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.collision.collision_checker import CollisionChecker
from tubeplanner.constraints.required_of_pairs import required_of_pairs
from tubeplanner.outcome import Place
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.simulation.executed_tube import Extreme
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

_ROUNDING = 1e-12  # [m], of bounds: what is nearer by less is not looked for


def least_clearances(
    problem: PlanningProblem,
    time: FloatArray,
    q: FloatArray,
    base: FloatArray,
    more: FloatArray | None = None,
) -> tuple[Extreme | None, Extreme | None]:
    """Return the least distances of links from obstacles and from each other [m].

    Args:
        problem: The planning problem.
        time: Of K samples, shape (K,) [s].
        q: Positions of the joints, shape (K, n).
        base: By how much the robot is shifted among the obstacles, shape (3,) [m].
        more: What is taken off the pairs' distances, as `additional_distances` has it, shape
            (K, P) [m]; None: nothing.

    Returns:
        Each None where no such pair is judged; negative where solids overlap.
    """
    rotation, position = problem.robot.body_poses(q)
    checker = problem.collision
    count = len(checker.obstacle_pairs)
    asked = np.zeros((len(q), len(checker.pairs))) if more is None else more
    shifted = _shifted(position, base)
    return (
        _least(problem, time, (rotation, shifted), checker.obstacle_pairs, asked[:, :count]),
        _least(problem, time, (rotation, position), checker.link_pairs, asked[:, count:]),
    )


def additional_distances(
    problem: PlanningProblem, trajectory: JointTrajectory, time: FloatArray
) -> FloatArray | None:
    """Return how much more than the clearance from obstacles pairs must keep, shape (K, P) [m].

    While a trajectory is executed, as the plan is asked it at the same time. Of links from each
    other, how much they must keep at all; of pairs that may be in contact then -inf: how solids
    touch is not simulated.

    Args:
        problem: The planning problem.
        trajectory: What is executed.
        time: Of K samples, shape (K,) [s].

    Returns:
        None where all pairs have the problem's clearance.
    """
    if problem.has_one_clearance:
        return None
    more = required_of_pairs(problem, trajectory, time)
    more[:, : len(problem.collision.obstacle_pairs)] -= problem.clearance
    return more


def obstacle_distances(
    problem: PlanningProblem, q: FloatArray, base: FloatArray, more: FloatArray | None = None
) -> FloatArray:
    """Return the least distance of links from obstacles at each of K samples, shape (K,) [m].

    Args:
        problem: With a pair of link and obstacle that is judged, at least.
        q: Positions of the joints, shape (K, n).
        base: As for `least_clearances`.
        more: Likewise; where it takes all pairs away the distance is inf.
    """
    rotation, position = problem.robot.body_poses(q)
    position, checker = _shifted(position, base), problem.collision
    pairs = checker.obstacle_pairs
    asked = np.zeros((len(q), len(pairs))) if more is None else more[:, : len(pairs)]
    bound = checker.sphere_distances(rotation, position, pairs) - asked
    first = bound.argmin(axis=1)
    found = checker.closest_points(rotation, position, pairs[first])
    least: FloatArray = found.distance - asked[np.arange(len(q)), first]
    row, column = np.nonzero(bound < least[:, None])
    boxes = checker.box_distances(rotation, position, row, pairs[column])
    nearer = boxes - asked[row, column] < least[row]
    row, column = row[nearer], column[nearer]
    others = checker.closest_points(rotation[row], position[row], pairs[column])
    np.minimum.at(least, row, others.distance - asked[row, column])
    return least


def _shifted(position: FloatArray, base: FloatArray) -> FloatArray:
    """Return positions (K, bodies, 3) of a shifted robot; body 0 carries the obstacles."""
    shifted = position.copy()
    shifted[:, 1:] += base
    return shifted


def _least(
    problem: PlanningProblem,
    time: FloatArray,
    poses: tuple[FloatArray, FloatArray],
    pairs: IntArray,
    asked: FloatArray,
) -> Extreme | None:
    """Return the least distance of pairs (P, 2), less what is asked in addition, (K, P)."""
    if len(pairs) == 0:
        return None
    checker, (rotation, position) = problem.collision, poses
    bound = checker.sphere_distances(rotation, position, pairs) - asked
    nearest = _Nearest(checker, rotation, position, pairs, asked)
    nearest.measure(*np.unravel_index([bound.argmin()], bound.shape))
    rows, columns = np.nonzero(bound < nearest.distance)
    closer = checker.box_distances(rotation, position, rows, pairs[columns]) - asked[rows, columns]
    rows, columns, closer = nearest.undecided(rows, columns, closer)
    while len(rows):
        lowest = _lowest(columns, closer)
        directions = nearest.measure(rows[lowest], columns[lowest])
        closer[lowest] = np.inf
        rows, columns, closer = nearest.undecided(rows, columns, closer)
        along = checker.separations_along(
            rotation[rows], position[rows], pairs[columns], directions[columns]
        )
        closer = np.maximum(closer, along - asked[rows, columns])
        rows, columns, closer = nearest.undecided(rows, columns, closer)
    if nearest.distance == np.inf:  # whatever may be in contact is so all along
        return None
    links, obstacle = checker.owners(pairs[nearest.column])
    where = Place(time=float(time[nearest.row]), links=links, obstacle=obstacle)
    return Extreme(nearest.distance, where)


class _Nearest:
    """The least distance that has been measured, less what is asked in addition, of pairs (P, 2).

    Attributes:
        distance: How much it is [m].
        row: In which configuration.
        column: Of which pair.
    """

    def __init__(
        self,
        checker: CollisionChecker,
        rotation: FloatArray,
        position: FloatArray,
        pairs: IntArray,
        asked: FloatArray,
    ) -> None:
        self._checker, self._rotation, self._position = checker, rotation, position
        self._pairs, self._asked = pairs, asked
        self._second = np.array([checker.shapes[index].body for index in pairs[:, 1]])
        self.distance, self.row, self.column = np.inf, 0, 0

    def measure(self, row: IntArray, column: IntArray) -> FloatArray:
        """Measure some pairs, and return directions for `separations_along` by pair, (P, 3)."""
        rotation, position = self._rotation[row], self._position[row]
        found = self._checker.closest_points(rotation, position, self._pairs[column])
        margin = found.distance - self._asked[row, column]
        best = int(margin.argmin())
        if margin[best] < self.distance:
            self.distance = float(margin[best])
            self.row, self.column = int(row[best]), int(column[best])
        frames = self._rotation[row, self._second[column]]
        directions = np.zeros((len(self._pairs), 3))
        directions[column] = np.einsum("pij,pi->pj", frames, found.direction)
        return directions

    def undecided(
        self, row: IntArray, column: IntArray, bound: FloatArray
    ) -> tuple[IntArray, IntArray, FloatArray]:
        """Return those of some pairs, and their bounds, that may be nearer."""
        may_be = bound < self.distance - _ROUNDING
        return row[may_be], column[may_be], bound[may_be]


def _lowest(columns: IntArray, bound: FloatArray) -> IntArray:
    """Return where the bound is lowest of each column that there is."""
    order = np.lexsort([bound, columns])
    return order[np.flatnonzero(np.diff(columns[order], prepend=-1))]
