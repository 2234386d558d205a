"""The tool in the region of its segment and at compulsory points, at samples of a spline."""

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.constraints.path_samples import PathSamples
from tubeplanner.refinement.ordered_segments import OrderedSegments
from tubeplanner.refinement.region_constraints import EvaluatedRegions
from tubeplanner.refinement.sampled_spline import SampledSpline
from tubeplanner.tube.segment_regions import Capsules, SegmentRegions
from tubeplanner.tube.tube import Tube


def evaluated_tube(
    at: SampledSpline,
    path: PathSamples,
    segments: OrderedSegments,
    regions: SegmentRegions,
    margin: FloatArray,
    numbers: IntArray,
) -> EvaluatedRegions:
    """Return the tube at N samples of a spline, each in one of its phase's segments.

    Args:
        at: The spline at the samples.
        path: The arm there.
        segments: Those that the samples may be in.
        regions: Of all segments.
        margin: The share of the regions that stays unused, shape (m,).
        numbers: Of the regions' tolerances among the limits, by segment and kind, shape (m, kinds).
    """
    return EvaluatedRegions(
        at,
        path.tool_pose[1],
        lambda: path.tool_jacobian[:, :3],
        regions,
        path.segment,
        segments.at,
        segments.in_chain,
        margin[path.segment],
        numbers,
    )


def evaluated_points(
    tube: Tube,
    at: SampledSpline,
    path: PathSamples,
    regions: SegmentRegions,
    margin: float,
    numbers: IntArray,
) -> EvaluatedRegions:
    """Return the balls about compulsory points that the tool must be in at switching times.

    A ball is a capsule without length. The tool is in it as it passes on to the next segment.

    Args:
        tube: The tube.
        at: The spline at the switching times into the segments that begin at the points.
        path: The arm there.
        regions: Of all segments.
        margin: The share of the radii that stays unused.
        numbers: As for `evaluated_tube`.
    """
    points, radius = tube.compulsory_points, regions.radius
    narrower = points - (radius[points - 1] < radius[points])
    place, own = tube.points[points], np.arange(len(points))
    # The ball's tolerance is what gives the extent along the segment: that of its end.
    kind = regions.kind(regions.faces(narrower)[0], narrower)
    return EvaluatedRegions(
        at,
        path.tool_pose[1],
        lambda: path.tool_jacobian[:, :3],
        Capsules(place, place, radius[narrower]),
        own,
        lambda _: own,
        np.zeros(len(points), dtype=bool),
        np.full(len(points), margin),
        numbers[narrower, kind][:, None],
    )
