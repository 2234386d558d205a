"""What `plan` plans: a problem or a whole cycle, each with its result."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from tubeplanner.commands.plan_outputs import PlanOutputs
from tubeplanner.errors import OptionError

if TYPE_CHECKING:
    from tubeplanner.cycle.cycle import Cycle
    from tubeplanner.cycle_planning.cycle_result import CycleResult
    from tubeplanner.planning.plan_options import PlanOptions
    from tubeplanner.planning.plan_result import PlanResult
    from tubeplanner.problem.problem import PlanningProblem
    from tubeplanner.progress import ProgressCallback


@dataclass(frozen=True, eq=False)
class PlannedProblem:
    """A problem and the result of planning it.

    Attributes:
        problem: The problem.
        result: Its result.
        with_minimum: Whether to report the least time for the path.
    """

    problem: "PlanningProblem"
    result: "PlanResult"
    with_minimum: bool

    def written(self, outputs: PlanOutputs) -> "PlannedProblem":
        """Write the answer to files; return the same with notes about them."""
        assert self.result.trajectory is not None
        notes = outputs.write(self.problem, self.result.method, self.result.trajectory)
        return replace(self, result=replace(self.result, notes=(*self.result.notes, *notes)))

    def as_dict(self) -> dict[str, Any]:
        """Return what is printed as JSON."""
        minimum = self.result.path_minimum if self.with_minimum else None
        return {**self.result.as_dict(), "path_minimum": minimum}

    def text(self, loading_time: float) -> str:
        """Return what is printed otherwise; loading took so long [s]."""
        from tubeplanner.commands.report import plan_text

        return plan_text(self.problem, self.result, loading_time, with_minimum=self.with_minimum)


@dataclass(frozen=True, eq=False)
class PlannedCycle:
    """A cycle and the result of planning it.

    Attributes:
        cycle: The cycle.
        result: Its result.
    """

    cycle: "Cycle"
    result: "CycleResult"

    def written(self, outputs: PlanOutputs) -> "PlannedCycle":
        """Write the answer to files; return the same with notes about them."""
        assert self.result.motion is not None
        notes = outputs.write_cycle(self.result.method, self.result.motion)
        return replace(self, result=replace(self.result, notes=(*self.result.notes, *notes)))

    def as_dict(self) -> dict[str, Any]:
        """Return what is printed as JSON."""
        from tubeplanner.constraints.trajectory_peaks import peaks_as_dict, trajectory_peaks

        motion = self.result.motion
        peaks = None if motion is None else trajectory_peaks(self.cycle.robot, motion.trajectory)
        return {**self.result.as_dict(), **peaks_as_dict(peaks), "path_minimum": None}

    def text(self, loading_time: float) -> str:
        """Return what is printed otherwise; loading took so long [s]."""
        from tubeplanner.commands.cycle_report import cycle_plan_text

        return cycle_plan_text(self.cycle, self.result, loading_time)


def planned(
    loaded: "PlanningProblem | Cycle",
    options: "PlanOptions",
    enter: "ProgressCallback",
    *,
    with_minimum: bool,
) -> PlannedProblem | PlannedCycle:
    """Plan a problem or a cycle.

    Args:
        loaded: Which one.
        options: How.
        enter: As of `plan`.
        with_minimum: Whether to report the least time for the path, of a problem.

    Raises:
        OptionError: That is asked of a cycle.
    """
    from tubeplanner.cycle.cycle import Cycle

    if not isinstance(loaded, Cycle):
        from tubeplanner.planning.planner import plan

        return PlannedProblem(loaded, plan(loaded, options, enter), with_minimum)
    if with_minimum:
        raise OptionError(
            "--time-left is about the path of one motion, and a cycle has several; leave it out, "
            "or plan a move as a problem of its own"
        )
    from tubeplanner.cycle_planning.cycle_planner import plan_cycle

    return PlannedCycle(loaded, plan_cycle(loaded, options, enter))
