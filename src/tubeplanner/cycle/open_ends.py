"""What the beginning of a move asks of the one before, where that one's end is left open."""

from dataclasses import replace

import numpy as np

from tubeplanner.cycle.steps import Move
from tubeplanner.problem.goal_region import GoalRegion

_SAME_TURN = 1e-6  # of quaternions


def ending_for(move: Move, after: Move) -> Move:
    """Return a move whose open end is turned as the next one must begin, if that is bounded.

    Where both tubes have an orientation there and these differ, it stays as it is.
    """
    turned, bounds = after.tube.orientations, after.tube.rotation_tolerance
    if not move.ends_openly or turned is None or bounds is None or after.tube.rotation is None:
        return move
    tube, goal = move.tube, move.goal
    if not isinstance(goal, GoalRegion):
        goal = GoalRegion(tube.points[-1])
    if tube.orientations is None:
        free = ((np.inf, np.inf, np.inf),) * tube.segment_count
        everywhere = np.tile(turned[:1], (len(tube.points), 1))
        tube = replace(tube, orientations=everywhere, rotation_tolerance=free)
    elif min(np.linalg.norm(tube.orientations[-1] - s * turned[0]) for s in (1, -1)) > _SAME_TURN:
        return move
    if goal.rotation_tolerance is None:
        goal = replace(goal, rotation_tolerance=bounds[0])
    return replace(move, tube=tube, goal=goal)
