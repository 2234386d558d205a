"""The tool's executed paths through a whole cycle."""

import numpy as np

from tubeplanner.cycle.cycle_motion import CycleMotion
from tubeplanner.simulation.executed_legs import executed_legs
from tubeplanner.simulation.execution import Execution
from tubeplanner.views.executed_paths import EXECUTED_STEPS, ExecutedPaths, executed_paths
from tubeplanner.views.execution_curves import Band, ToolRuns, tool_runs


def cycle_executed_paths(motion: CycleMotion, execution: Execution) -> ExecutedPaths:
    """Return the paths of the runs, outside where they leave the tube of the move that runs."""
    legs = executed_legs(motion, execution)
    tools = [tool_runs(leg.problem, leg.trajectory, leg.execution) for leg in legs]
    tubes = [tool.tube for tool in tools]
    times = [leg.begin + tube.time for leg, tube in zip(legs, tubes, strict=True)]
    tube = Band(
        np.concatenate(times),
        np.concatenate([each.plan for each in tubes]),
        np.hstack([each.runs for each in tubes]),
    )
    plan = np.concatenate([tool.plan for tool in tools])
    runs = np.concatenate([tool.runs for tool in tools], axis=1)
    return executed_paths(ToolRuns(plan, runs, tube, None), EXECUTED_STEPS * len(legs))
