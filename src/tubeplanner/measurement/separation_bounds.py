"""Lower bounds on the distance of one pair of convex shapes in many configurations at once."""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.collision.collision_checker import BodyShape

_NO_LENGTH = 1e-9  # [m]
# Steps towards the shortest vector between the shapes; two of them separate most pairs.
_MAX_STEPS = 12


def separation_bounds(
    first: BodyShape,
    second: BodyShape,
    rotation: FloatArray,
    position: FloatArray,
    enough: float,
) -> FloatArray:
    """Return how far two shapes are apart along a direction that it searches for, (N,) [m].

    Gilbert's iteration ("An iterative procedure for computing the minimum of a quadratic form on a
    convex set", 1966) on all configurations together; each ends as soon as it has enough.

    Args:
        first: One shape.
        second: The other one.
        rotation: Of all bodies, shape (N, bodies, 3, 3), from `RobotModel.body_poses`.
        position: Likewise, shape (N, bodies, 3) [m].
        enough: A distance beyond which it does not matter [m].

    Returns:
        Never above the distance, except by rounding. Where shapes overlap it is negative, and says
        nothing about the depth.
    """
    # Points of the first shape in the frame of the second one's body: turned @ x + moved.
    back = rotation[:, second.body].transpose(0, 2, 1)
    turned = back @ rotation[:, first.body]
    moved = np.einsum("nij,nj->ni", back, position[:, first.body] - position[:, second.body])
    ones, others = first.shape.vertices, second.shape.vertices
    grown = first.shape.radius + second.shape.radius
    gap = second.shape.center - moved - turned @ first.shape.center
    bound = np.full(len(rotation), -np.inf)
    live = np.arange(len(rotation))
    for _ in range(_MAX_STEPS):
        length = np.linalg.norm(gap, axis=1)
        unsettled = (length > _NO_LENGTH) & (bound[live] < enough)
        live, gap, length = live[unsettled], gap[unsettled], length[unsettled]
        if len(live) == 0:
            break
        direction = gap / length[:, None]
        local = np.einsum("nij,ni->nj", turned[live], direction)
        support = ones[(local @ ones.T).argmax(axis=1)]
        behind = others[(direction @ others.T).argmin(axis=1)]
        end = behind - moved[live] - np.einsum("nij,nj->ni", turned[live], support)
        bound[live] = np.maximum(bound[live], np.sum(direction * end, axis=1) - grown)
        # On to the point of the line from the gap to that end which is nearest to the origin.
        edge = end - gap
        squared = np.maximum(np.sum(edge**2, axis=1), _NO_LENGTH**2)
        share = np.clip(-np.sum(gap * edge, axis=1) / squared, 0.0, 1.0)
        gap = gap + share[:, None] * edge
    return bound
