"""The tool in the capsule of its segment, at samples of a spline."""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.refinement.capsule_constraints import EvaluatedCapsules
from tubeplanner.refinement.linear_rows import NO_LIMIT
from tubeplanner.refinement.phased_spline import Samples
from tubeplanner.refinement.sampled_spline import SampledSpline


def evaluated_tube(
    problem: PlanningProblem,
    at: SampledSpline,
    samples: Samples,
    radius: FloatArray,
    margin: float,
    first_limit: int = NO_LIMIT,
) -> EvaluatedCapsules:
    """Return the tube at samples of a spline; each phase belongs to the segment of its number.

    Args:
        problem: The planning problem.
        at: The spline at the samples.
        samples: Each is in the phase of its segment.
        radius: Of the segments, shape (m,) [m].
        margin: The share of the radii that stays unused.
        first_limit: Number of the first segment's radius among the limits.
    """
    robot, points, segment = problem.robot, problem.tube.points, samples.phase

    def jacobian() -> FloatArray:
        linear: FloatArray = robot.tool_jacobian(at.position)[1][:, :3]
        return linear

    limit = np.full(len(segment), NO_LIMIT) if first_limit == NO_LIMIT else first_limit + segment
    return EvaluatedCapsules(
        at,
        robot.tool_position(at.position),
        jacobian,
        points[segment],
        points[segment + 1],
        radius[segment],
        margin,
        limit,
    )
