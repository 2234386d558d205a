"""The plan of one leg of a cycle."""

from dataclasses import dataclass, replace

from tubeplanner.arrays import FloatArray
from tubeplanner.planning.plan_result import PlanResult
from tubeplanner.problem.problem import PlanningProblem


@dataclass(frozen=True, eq=False)
class LegPlan:
    """The plan of one leg.

    Attributes:
        problem: What was planned.
        result: Its certified answer, the shortest or what is written.
    """

    problem: PlanningProblem
    result: PlanResult

    @property
    def duration(self) -> float:
        """Of the answer [s]."""
        assert self.result.duration is not None
        return self.result.duration

    @property
    def begin(self) -> FloatArray:
        """The configuration in which it begins, shape (n,)."""
        assert self.result.trajectory is not None
        return self.result.trajectory.position(0.0)

    @property
    def end(self) -> FloatArray:
        """The configuration in which it ends, shape (n,)."""
        assert self.result.trajectory is not None
        return self.result.trajectory.position(self.result.trajectory.duration)

    def between(self, problem: PlanningProblem) -> "LegPlan":
        """Return the plan as one of a problem with given ends, those of the plan."""
        motion = self.result.motion
        if motion is not None and not motion.is_smoother:
            motion = replace(motion, problem=problem.joined)
        return LegPlan(problem, replace(self.result, motion=motion))


class BlockedLeg(Exception):
    """A leg has no answer.

    Attributes:
        leg: Which one.
        result: Why not.
    """

    def __init__(self, leg: int, result: PlanResult) -> None:
        super().__init__(result.message)
        self.leg, self.result = leg, result
