"""The ball in which a goal asks the tool to end, as a surface."""

from tubeplanner.problem.goal_region import GoalRegion
from tubeplanner.views.surface import Surface, directions, hull_surface

_POINTS = 400


def goal_ball(goal: object) -> list[Surface]:
    """Return the ball of a goal, base frame; none where it has no extent."""
    if not isinstance(goal, GoalRegion) or goal.tolerance == 0:
        return []
    return [hull_surface(goal.position + goal.tolerance * directions(_POINTS))]
