"""Where the things of a scene stand, and from where they are seen."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.views.viewpoint import floor_grid, outline

_GAP = 0.15  # between trajectories side by side, of the width of one


@dataclass(frozen=True, eq=False)
class SceneFrame:
    """Where trajectories stand, the floor under them, and what a picture of all must hold.

    Attributes:
        offset: From each trajectory to the next, shape (3,) [m].
        direction: From the scene towards the viewer, unit vector (3,).
        outline: Points that a picture must hold, offsets included, shape (P, 3) [m].
        floor: Edges of a grid under all, shape (E, 2, 3) [m].
        floor_step: Length of one [m].
        top: Where a trajectory's name goes, its offset left out, shape (3,) [m].
    """

    offset: FloatArray
    direction: FloatArray
    outline: FloatArray
    floor: FloatArray
    floor_step: float
    top: FloatArray


def scene_frame(points: Sequence[FloatArray], direction: FloatArray, count: int) -> SceneFrame:
    """Return the frame of a scene.

    Args:
        points: All that one trajectory takes, each (N, 3) [m].
        direction: From the scene towards the viewer, unit vector (3,).
        count: How many trajectories stand side by side.
    """
    taken = np.vstack(points)
    # Side by side as seen from there: along x or y, whichever lies more across the view.
    across = int(abs(direction[0]) > abs(direction[1]))
    offset = np.eye(3)[across] * np.ptp(taken[:, across]) * (1 + _GAP)
    sides = outline(taken)
    held = np.vstack([sides + i * offset for i in range(count)])
    top = np.append((sides.min(axis=0) + sides.max(axis=0))[:2] / 2, sides[:, 2].max())
    return SceneFrame(offset, direction, held, *floor_grid(held), top)
