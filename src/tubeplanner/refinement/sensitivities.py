"""What each tolerance and each motor costs: the sensitivities of a refined trajectory."""

from dataclasses import dataclass

from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.refinement.refinement import Refinement
from tubeplanner.tube.tube import Tube

_RISE = 0.1  # the rise of a limit for which `saved` holds


@dataclass(frozen=True)
class Sensitivity:
    """What one limit costs, with start, goal and all other limits fixed.

    A goal with tolerances is not fixed: it stays within them.

    Attributes:
        limit: "effort" (both directions together), "effort_rate" (likewise),
            "velocity", "acceleration", "jerk", "radius",
            "velocity_by_position", "tool_speed", "point_speed", "rotation", "width" or "height"
            of a box, or "tolerance" or "rotation_tolerance" of the goal.
        joint: Whose limit; None for a segment's, a point's or the goal's.
        segment: Which segment's, the first of those that count as one; None for other limits.
        elasticity: d ln T / d ln limit, at most 0: the relative change of the duration per relative
            rise of the limit.
        saved: What 10 % more would save [s], to first order.
        last_segment: The last of those; None for other limits.
        link: Whose point; None for other limits.
        point: Index of the point among those whose speed is limited; None for other limits.
    """

    limit: str
    joint: str | None
    segment: int | None
    elasticity: float
    saved: float
    last_segment: int | None = None
    link: str | None = None
    point: int | None = None

    def __str__(self) -> str:
        place = self.joint or ("the goal" if self.segment is None else f"segment {self.segment}")
        if self.last_segment not in (None, self.segment):
            place = f"segments {self.segment} to {self.last_segment}"
        if self.point is not None:
            place = f"point {self.point}, on {self.link}"
        return f"{self.limit} of {place}: {1000 * self.saved:.2g} ms"


def limit_sensitivities(
    problem: PlanningProblem, refinement: Refinement, duration: float
) -> tuple[Sensitivity, ...]:
    """Return what every limit costs, largest first.

    Args:
        problem: The planning problem.
        refinement: The finished refinement.
        duration: Of the answer [s].
    """
    found = []
    for key, elasticity in refinement.elasticities().items():
        joint = None if key.joint is None else problem.robot.joint_names[key.joint]
        first, last = (None, None) if key.segment is None else _numbers(problem.tube, key.segment)
        saved = -elasticity * _RISE * duration
        named = (key.link, key.point)
        found.append(Sensitivity(key.kind, joint, first, elasticity, saved, last, *named))
    return tuple(sorted(found, key=lambda sensitivity: -sensitivity.saved))


def _numbers(tube: Tube, segment: int) -> tuple[int, int]:
    """Return what messages call the first and the last of a segment's parts."""
    begin, end = (tube.points[segment + k] for k in (0, 1))
    return tube.segment_number(segment, begin), tube.segment_number(segment, end)
