"""Lower bounds on the distance of one pair of convex shapes in many configurations at once."""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.collision.collision_checker import BodyShape
from tubeplanner.collision.gilbert import separating_directions

# Steps towards the shortest vector between the shapes; two of them separate most pairs.
_MAX_STEPS = 12
_LOOSE = 2e-3  # [m]: by how much distances may fall short of what they could be


def separation_bounds(
    first: BodyShape,
    second: BodyShape,
    rotation: FloatArray,
    position: FloatArray,
    enough: float,
) -> FloatArray:
    """Return how far two shapes are apart along a direction that it searches for, (N,) [m].

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
    gap = second.shape.center - moved - turned @ first.shape.center
    grown = first.shape.radius + second.shape.radius
    apart, _ = separating_directions(
        first.shape.vertices,
        second.shape.vertices,
        turned,
        moved,
        gap,
        max_steps=_MAX_STEPS,
        enough=enough + grown,
        loose=_LOOSE,
    )
    return apart - grown
