"""Links that stand still against obstacles: whether the robot can stand where it is put.

Planning never asks this, as it can change neither; looking for a place for the robot does.
"""

from collections.abc import Collection

import numpy as np

from tubeplanner.arrays import IntArray
from tubeplanner.outcome import MARGIN_TOLERANCE, Infeasible, Place, PlanStatus
from tubeplanner.problem.problem import PlanningProblem

_TOUCHING = 5e-5  # [m]
_BASE = 0  # the body of what no joint moves


def require_base_free(problem: PlanningProblem, stands_on: Collection[str] = ()) -> None:
    """Raise unless the links that no joint moves keep their distance from the obstacles.

    It is that of the other links, the most that any segment asks. Pairs that the problem ignores do
    not count.

    Args:
        problem: The planning problem.
        stands_on: Names of obstacles that these links may touch.

    Raises:
        Infeasible: Status tube_blocked: the message names link and obstacle, and how deep one is in
            the other.
    """
    pairs = _base_pairs(problem, stands_on)
    if len(pairs) == 0:
        return
    checker = problem.collision
    rotation, position = problem.robot.body_poses(np.zeros((1, problem.robot.joint_count)))
    distance = checker.distances(rotation[0], position[0], pairs)
    required, worst = _required(problem), int(distance.argmin())
    if distance[worst] >= required - MARGIN_TOLERANCE:
        return
    link, obstacle = (checker.shapes[index].owner for index in pairs[worst])
    message = _words(link, obstacle, float(distance[worst]), required)
    raise Infeasible(PlanStatus.TUBE_BLOCKED, message, Place(links=(link,), obstacle=obstacle))


def _base_pairs(problem: PlanningProblem, stands_on: Collection[str]) -> IntArray:
    """Return links that stand still against obstacles, as indices of the checker's shapes (P, 2).

    Covers of links from before the obstacles, as for moving links; closer ones come behind.
    """
    shapes = problem.collision.shapes
    names = {obstacle.name for obstacle in problem.obstacles}
    ignored = {frozenset(pair) for pair in problem.ignore_collisions}
    obstacles = [k for k, shape in enumerate(shapes) if shape.owner in names]
    links = [k for k in range(min(obstacles, default=0)) if shapes[k].body == _BASE]
    found = [
        (i, j)
        for i in links
        for j in obstacles
        if shapes[j].owner not in stands_on
        and frozenset((shapes[i].owner, shapes[j].owner)) not in ignored
    ]
    return np.array(found, dtype=np.int64).reshape(-1, 2)


def _required(problem: PlanningProblem) -> float:
    """Return the distance that links must keep from obstacles [m]."""
    own = problem.tube.clearance
    if own is None:
        return float(problem.clearance)
    return float(np.where(np.isfinite(own), own, problem.clearance).max())


def _words(link: str, obstacle: str, distance: float, required: float) -> str:
    own, wanted = f"'{link}', which no joint moves,", f"(clearance {1000 * required:g} mm)"
    if abs(distance) < _TOUCHING:
        return f"{own} touches '{obstacle}'{f' {wanted}' if required else ''}"
    if distance < 0:
        return f"{own} stands {-1000 * distance:.1f} mm in '{obstacle}'"
    return f"{own} stands {1000 * distance:.1f} mm from '{obstacle}' {wanted}"
