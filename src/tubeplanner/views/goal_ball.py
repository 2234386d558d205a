"""The ball in which a goal asks the tool to end, as a surface."""

from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.views.surface import Surface, directions, hull_surface

_POINTS = 400


def goal_ball(problem: PlanningProblem) -> list[Surface]:
    """Return the ball of a problem's goal, base frame; none where it has no extent."""
    goal = problem.open_goal
    if goal is None or goal.tolerance == 0:
        return []
    return [hull_surface(goal.position + goal.tolerance * directions(_POINTS))]
