"""What each tolerance and each motor costs: the sensitivities of a refined trajectory."""

from dataclasses import dataclass

from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.refinement.refinement import Refinement

_RISE = 0.1  # the rise of a limit for which `saved` holds


@dataclass(frozen=True)
class Sensitivity:
    """What one limit costs, with start, goal and all other limits fixed.

    Attributes:
        limit: "effort" (both directions together), "velocity", "acceleration", "jerk", "radius" or
            "rotation".
        joint: Whose limit; None for a radius or a rotation tolerance.
        segment: Which segment's radius or rotation tolerance; None for a joint.
        elasticity: d ln T / d ln limit, at most 0: the relative change of the duration per relative
            rise of the limit.
        saved: What 10 % more would save [s], to first order.
    """

    limit: str
    joint: str | None
    segment: int | None
    elasticity: float
    saved: float

    def __str__(self) -> str:
        place = f"segment {self.segment}" if self.joint is None else self.joint
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
    for (limit, index), elasticity in refinement.elasticities().items():
        of_segment = limit in ("radius", "rotation")
        joint = None if of_segment else problem.robot.joint_names[index]
        segment = index if of_segment else None
        saved = -elasticity * _RISE * duration
        found.append(Sensitivity(limit, joint, segment, elasticity, saved))
    return tuple(sorted(found, key=lambda sensitivity: -sensitivity.saved))
