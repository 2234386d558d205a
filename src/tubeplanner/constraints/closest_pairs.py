"""Which two solids are closest along a trajectory, beyond what they must be apart.

Pairs are measured in the order of quick bounds, all times at once, until no other pair may be
closer. Of shapes that overlap by many centimetres, measured distances are too low by up to as much.
"""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.collision.collision_checker import CollisionChecker
from tubeplanner.constraints.required_of_pairs import required_of_pairs
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

# As the certificate calls them.
OBSTACLES = "obstacles"
SELF_COLLISION = "self_collision"


@dataclass(frozen=True, eq=False)
class ClosestPairs:
    """The pair of solids with the least margin, at each of K times.

    Where every pair may be in contact, distance and margin are inf.

    Attributes:
        kind: "obstacles" or "self_collision".
        time: Shape (K,) [s].
        distance: Between the two, shape (K,) [m]; negative where they overlap.
        margin: How much more than required that is, shape (K,) [m].
        names: A link, and the obstacle or the other link.
        points: Where the two are closest, on their surfaces and in the base frame, shape (K, 2, 3)
            [m].
    """

    kind: str
    time: FloatArray
    distance: FloatArray
    margin: FloatArray
    names: tuple[tuple[str, str], ...]
    points: FloatArray


def closest_pairs(
    problem: PlanningProblem, trajectory: JointTrajectory, time: FloatArray
) -> list[ClosestPairs]:
    """Return the pairs with the least margins: of links and obstacles, and of links alone.

    Of what is not checked, nothing. Pairs that may be in contact at a time are left out then.

    Args:
        problem: The planning problem.
        trajectory: Of the problem's joints, in any order.
        time: Of K samples, not decreasing, shape (K,) [s].
    """
    checker = problem.collision
    if len(checker.pairs) == 0:
        return []
    trajectory = trajectory.reordered(problem.robot.joint_names)
    poses = problem.robot.body_poses(trajectory.position(time))
    required = required_of_pairs(problem, trajectory, time)
    count = len(checker.obstacle_pairs)
    kinds = {OBSTACLES: slice(count), SELF_COLLISION: slice(count, None)}
    return [
        _closest(checker, time, poses, (kind, checker.pairs[own], required[:, own]))
        for kind, own in kinds.items()
        if len(checker.pairs[own])
    ]


def _closest(
    checker: CollisionChecker,
    time: FloatArray,
    poses: tuple[FloatArray, FloatArray],
    asked: tuple[str, IntArray, FloatArray],
) -> ClosestPairs:
    """Return the closest of pairs of a kind (P, 2), of which so much is required, (K, P) [m]."""
    kind, pairs, required = asked
    column = _closest_columns(checker, poses, pairs, required)
    pair, least = pairs[column], required[np.arange(len(time)), column]
    found = checker.closest_points(*poses, pair)
    # The points are those of cores: surfaces are as far beyond them as the shapes are rounded.
    radii = np.array([shape.shape.radius for shape in checker.shapes])[pair, None]
    first = found.first + radii[:, 0] * found.direction
    second = found.second - radii[:, 1] * found.direction
    owners = [(checker.shapes[i].owner, checker.shapes[j].owner) for i, j in pair.tolist()]
    return ClosestPairs(
        kind,
        time,
        np.where(least == -np.inf, np.inf, found.distance),
        found.distance - least,
        tuple(owners),
        np.stack([first, second], axis=1),
    )


def _closest_columns(
    checker: CollisionChecker,
    poses: tuple[FloatArray, FloatArray],
    pairs: IntArray,
    required: FloatArray,
) -> IntArray:
    """Return which of some pairs has the least margin in each of K configurations, shape (K,)."""
    every = np.arange(len(required))
    rotation, position = poses

    def margins(row: IntArray, column: IntArray) -> FloatArray:
        found = checker.closest_points(rotation[row], position[row], pairs[column])
        return found.distance - required[row, column]

    bound = checker.sphere_distances(*poses, pairs) - required
    best = bound.argmin(axis=1)
    least = margins(every, best)
    bound[every, best] = np.inf
    row, column = np.nonzero(bound < least[:, None])
    closer = checker.box_distances(*poses, row, pairs[column]) - required[row, column]
    while len(row):
        open_ = closer < least[row]
        row, column, closer = row[open_], column[open_], closer[open_]
        order = np.lexsort([closer, row])
        first = order[np.flatnonzero(np.diff(row[order], prepend=-1))]
        margin = margins(row[first], column[first])
        nearer = margin < least[row[first]]
        least[row[first[nearer]]] = margin[nearer]
        best[row[first[nearer]]] = column[first[nearer]]
        closer[first] = np.inf
    return best
