"""From what a problem file or a cycle file holds to its plan."""

from tubeplanner.cycle.cycle import Cycle
from tubeplanner.cycle_planning.cycle_planner import plan_cycle
from tubeplanner.cycle_planning.cycle_result import CycleResult
from tubeplanner.planning.plan_options import PlanOptions
from tubeplanner.planning.plan_result import PlanResult
from tubeplanner.planning.planner import plan
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.progress import ProgressCallback


def plan_either(
    problem: PlanningProblem | Cycle,
    options: PlanOptions,
    progress: ProgressCallback | None = None,
) -> PlanResult | CycleResult:
    """Plan a problem or a cycle; arguments and what is raised are those of `plan`."""
    if isinstance(problem, Cycle):
        return plan_cycle(problem, options, progress)
    return plan(problem, options, progress)
