"""The tool's executed paths as short straight lines, those inside the tube and those outside."""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.views.execution_curves import ToolRuns

_MAX_PATHS = 200
EXECUTED_STEPS = 240  # lines of an executed path
BESIDE_EXECUTED = 0.3  # of its usual thickness: the planned path among executed ones


@dataclass(frozen=True, eq=False)
class ExecutedPaths:
    """The paths of some runs.

    Attributes:
        inside: Lines all in the tube, shape (A, 2, 3) [m].
        outside: The others, shape (B, 2, 3) [m].
        shown: How many runs they are of.
        total: How many runs there were.
    """

    inside: FloatArray
    outside: FloatArray
    shown: int
    total: int


def executed_paths(tools: ToolRuns, steps: int) -> ExecutedPaths:
    """Return the paths of the runs that go farthest out: of all, unless there are very many.

    Args:
        tools: Where the tool is.
        steps: Of how many lines each path is made, at least, if there are as many samples.
    """
    order = np.argsort(tools.tube.runs.min(axis=1), kind="stable")[:_MAX_PATHS]
    count = tools.runs.shape[1] - 1
    step = max(1, count // steps)
    first = np.arange(0, count, step)
    ends = np.stack([first, np.minimum(first + step, count)], axis=1)
    margins = tools.tube.runs[order]
    least = np.minimum(margins[:, first], np.minimum.reduceat(margins[:, 1:], first, axis=1))
    lines = tools.runs[order][:, ends]
    return ExecutedPaths(lines[least >= 0], lines[least < 0], len(order), len(tools.runs))
