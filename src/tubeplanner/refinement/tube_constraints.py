"""The tool in the capsule of its segment, at samples of a spline."""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.refinement.capsule_constraints import Capsules, EvaluatedCapsules
from tubeplanner.refinement.linear_rows import NO_LIMIT
from tubeplanner.refinement.ordered_segments import OrderedSegments
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
    """Return the tube at N samples of a spline, each in one of its phase's segments.

    Args:
        problem: The planning problem.
        at: The spline at the samples.
        samples: The samples.
        radius: Of the segments, shape (m,) [m].
        margin: The share of the radii that stays unused.
        first_limit: Number of the first segment's radius among the limits.
    """
    robot, points = problem.robot, problem.tube.points
    segments = OrderedSegments(points, radius, at.spline.grid.chains, samples)
    tool = robot.tool_position(at.position)
    segment = segments.at(tool)

    def jacobian() -> FloatArray:
        linear: FloatArray = robot.tool_jacobian(at.position)[1][:, :3]
        return linear

    limit = np.full(len(segment), NO_LIMIT) if first_limit == NO_LIMIT else first_limit + segment
    return EvaluatedCapsules(
        at,
        tool,
        jacobian,
        Capsules(points[:-1], points[1:], radius),
        segment,
        segments.at,
        segments.in_chain,
        np.full(len(segment), margin),
        limit,
    )
