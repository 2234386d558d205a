"""The end of both ways to a tube: its radii and ranges are measured, and it is planned."""

from collections.abc import Callable
from dataclasses import dataclass

from tubeplanner.outcome import Infeasible
from tubeplanner.planning.plan_result import PlanResult
from tubeplanner.planning.planner import plan
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.tube_sources.measured_tube import MeasureOptions
from tubeplanner.tube_sources.tube_measurement import measure_tube


@dataclass(frozen=True, eq=False)
class MeasuredPlan:
    """A problem whose tube was measured, and its certified plan.

    Attributes:
        problem: With the measured tube.
        result: Its plan.
    """

    problem: PlanningProblem
    result: PlanResult

    @property
    def duration(self) -> float:
        """Duration of the motion [s]."""
        assert self.result.duration is not None
        return self.result.duration


def measured_plan(
    problem: PlanningProblem, options: MeasureOptions, enter: Callable[[object], None]
) -> MeasuredPlan:
    """Measure a problem's tube and plan the motion through it.

    Args:
        problem: Its reference points and joint ranges count, its radii do not.
        options: How to measure.
        enter: Called with every stage as it begins.

    Raises:
        Infeasible: The tube has no room, or there is no certified motion in it.
    """
    measured = measure_tube(problem, options, enter)
    if measured.problem is None:
        raise Infeasible(measured.status, measured.message, measured.place)
    enter("planning through the measured tube")
    result = plan(measured.problem)
    if not result.succeeded:
        raise Infeasible(result.status, result.message, result.place)
    return MeasuredPlan(measured.problem, result)
