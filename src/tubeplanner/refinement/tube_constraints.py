"""The tool in the capsule of its segment and at compulsory points, at samples of a spline."""

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.constraints.path_samples import PathSamples
from tubeplanner.refinement.capsule_constraints import Capsules, EvaluatedCapsules
from tubeplanner.refinement.ordered_segments import OrderedSegments
from tubeplanner.refinement.sampled_spline import SampledSpline
from tubeplanner.tube.tube import Tube


def evaluated_tube(
    tube: Tube,
    at: SampledSpline,
    path: PathSamples,
    segments: OrderedSegments,
    radius: FloatArray,
    margin: float,
    limit: IntArray,
) -> EvaluatedCapsules:
    """Return the tube at N samples of a spline, each in one of its phase's segments.

    Args:
        tube: The tube.
        at: The spline at the samples.
        path: The arm there.
        segments: Those that the samples may be in.
        radius: Of the segments, shape (m,) [m].
        margin: The share of the radii that stays unused.
        limit: Numbers of the radii among the limits, shape (m,).
    """
    return EvaluatedCapsules(
        at,
        path.tool_pose[1],
        lambda: path.tool_jacobian[:, :3],
        Capsules(tube.points[:-1], tube.points[1:], radius),
        path.segment,
        segments.at,
        segments.in_chain,
        np.full(len(path), margin),
        limit[path.segment],
    )


def evaluated_points(
    tube: Tube,
    at: SampledSpline,
    path: PathSamples,
    radius: FloatArray,
    margin: float,
    limit: IntArray,
) -> EvaluatedCapsules:
    """Return the balls about compulsory points that the tool must be in at switching times.

    A ball is a capsule without length. The tool is in it as it passes on to the next segment.

    Args:
        tube: The tube.
        at: The spline at the switching times into the segments that begin at the points.
        path: The arm there.
        radius: Of the segments, shape (m,) [m].
        margin: The share of the radii that stays unused.
        limit: Numbers of the radii among the limits, shape (m,).
    """
    points = tube.compulsory_points
    narrower = points - (radius[points - 1] < radius[points])
    place, own = tube.points[points], np.arange(len(points))
    return EvaluatedCapsules(
        at,
        path.tool_pose[1],
        lambda: path.tool_jacobian[:, :3],
        Capsules(place, place, radius[narrower]),
        own,
        lambda _: own,
        np.zeros(len(points), dtype=bool),
        np.full(len(points), margin),
        limit[narrower],
    )
