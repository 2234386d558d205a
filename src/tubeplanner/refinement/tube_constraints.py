"""The tool in the capsule of its segment and at compulsory points, at samples of a spline."""

from collections.abc import Callable

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.refinement.capsule_constraints import Capsules, EvaluatedCapsules
from tubeplanner.refinement.linear_rows import NO_LIMIT
from tubeplanner.refinement.ordered_segments import OrderedSegments
from tubeplanner.refinement.phased_spline import Samples
from tubeplanner.refinement.sampled_spline import SampledSpline
from tubeplanner.robot.robot_model import RobotModel


def evaluated_points(
    problem: PlanningProblem,
    at: SampledSpline,
    points: IntArray,
    radius: FloatArray,
    margin: float,
    first_limit: int = NO_LIMIT,
) -> EvaluatedCapsules:
    """Return the balls about compulsory points that the tool must be in at switching times.

    A ball is a capsule without length. The tool is in it as it passes on to the next segment.

    Args:
        problem: The planning problem.
        at: The spline at the switching times into the segments that begin at the points.
        points: Their indices, shape (N,).
        radius: Of the segments, shape (m,) [m].
        margin: The share of the radii that stays unused.
        first_limit: Number of the first segment's radius among the limits.
    """
    narrower = points - (radius[points - 1] < radius[points])
    place = problem.tube.points[points]
    limit = np.full(len(points), NO_LIMIT) if first_limit == NO_LIMIT else first_limit + narrower
    position, jacobian = _tool(problem.robot, at)
    count, own = len(points), np.arange(len(points))
    return EvaluatedCapsules(
        at,
        position,
        jacobian,
        Capsules(place, place, radius[narrower]),
        own,
        lambda _: own,
        np.zeros(count, dtype=bool),
        np.full(count, margin),
        limit,
    )


def _tool(robot: RobotModel, at: SampledSpline) -> tuple[FloatArray, Callable[[], FloatArray]]:
    """Return the tool's positions at samples, and what returns their derivative by the joints."""

    def jacobian() -> FloatArray:
        linear: FloatArray = robot.tool_jacobian(at.position)[1][:, :3]
        return linear

    return robot.tool_position(at.position), jacobian


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
    points = problem.tube.points
    segments = OrderedSegments(points, radius, at.spline.grid.chains, samples)
    position, jacobian = _tool(problem.robot, at)
    segment = segments.at(position)
    limit = np.full(len(segment), NO_LIMIT) if first_limit == NO_LIMIT else first_limit + segment
    return EvaluatedCapsules(
        at,
        position,
        jacobian,
        Capsules(points[:-1], points[1:], radius),
        segment,
        segments.at,
        segments.in_chain,
        np.full(len(segment), margin),
        limit,
    )
