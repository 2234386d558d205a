"""Vectors that must stay in regions, at samples of a spline: the tool's position, its rotation.

A region is convex: a vector p is inside if n.p <= max(n.A, n.B) + e(n) for every unit normal n, A
and B being the ends of its axis and e its extent beyond. A linear program gets a few of these
planes: at each sample the one outward and those of faces, and then the tangent planes where its own
prediction leaves the region (Kelley, "The cutting-plane method for solving convex programs", 1960).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.native.regions import plane_slack
from tubeplanner.refinement.linear_rows import Rows
from tubeplanner.refinement.sampled_spline import SampledSpline
from tubeplanner.tube.segment_regions import SegmentRegions

# A prediction may leave the region by this share of its extent.
_OUTSIDE = 0.002


@dataclass(frozen=True, eq=False)
class Planes:
    """P supporting planes of regions.

    Attributes:
        sample: Whose region, shape (P,).
        normal: Unit vectors, outward, shape (P, 3).
        segment: Whose region they hold beside the sample's own, shape (P,).
    """

    sample: IntArray
    normal: FloatArray
    segment: IntArray

    def __len__(self) -> int:
        return len(self.sample)

    def where(self, keep: BoolArray | IntArray) -> "Planes":
        """Return some of the planes."""
        return Planes(self.sample[keep], self.normal[keep], self.segment[keep])

    def and_also(self, other: "Planes") -> "Planes":
        """Return these planes and others."""
        if len(other) == 0:
            return self
        return Planes(
            np.concatenate([self.sample, other.sample]),
            np.concatenate([self.normal, other.normal]),
            np.concatenate([self.segment, other.segment]),
        )


@dataclass(frozen=True, eq=False)
class EvaluatedRegions:
    """The regions at N samples of a spline, and the vectors that must stay in them.

    Attributes:
        at: The spline at the samples.
        vector: Shape (N, 3) [m or rad].
        derivative: Returns what the vectors change by with the joints, shape (N, 3, n).
        regions: Of all segments.
        segment: The samples' own, shape (N,).
        segments_of: Returns what they would be for other vectors (N, 3).
        in_chain: Whether samples pass from one segment to another by themselves, shape (N,).
        margin: The share of the radii that stays unused, shape (N,).
        numbers: Of the regions' tolerances among the limits, by segment and kind, shape (m, kinds).
        is_crossed: Whether a step may lead from one side to the other: then all planes count as
            near.
    """

    at: SampledSpline
    vector: FloatArray
    derivative: Callable[[], FloatArray]
    regions: SegmentRegions
    segment: IntArray
    segments_of: Callable[[FloatArray], IntArray]
    in_chain: BoolArray
    margin: FloatArray
    numbers: IntArray
    is_crossed: bool = False

    @cached_property
    def excess(self) -> FloatArray:
        """How far the vectors are outside the narrowed regions, as a share of them, shape (N,)."""
        return self._excess_of(self.vector, self.segment)

    @cached_property
    def planes(self) -> Planes:
        """The planes outward and, unless segments pass into each other, those of faces."""
        normal = np.array([self.regions.outward(self.vector, self.segment), *self.faces])
        normal[1:, self.in_chain] = 0.0
        kind, sample = np.nonzero(normal.any(axis=2))
        return Planes(sample, normal[kind, sample], self.segment[sample])

    @cached_property
    def faces(self) -> Sequence[FloatArray]:
        """Normals of the regions' faces that do not depend on the vectors, each (N, 3)."""
        return self.regions.faces(self.segment)

    def planes_where_outside(self, vector: FloatArray, elastic: float) -> Planes:
        """Return the tangent planes at other vectors (N, 3) that are outside.

        Those of a sample in a chain are its planes of the segment that it would then be in.

        Args:
            vector: The other vectors.
            elastic: So many radii outside is allowed.
        """
        segment = self.segments_of(vector)
        outside = np.flatnonzero(self._excess_of(vector, segment) > elastic + _OUTSIDE)
        segment = segment[outside]
        planes = Planes(outside, self.regions.outward(vector[outside], segment), segment)
        if len(planes) == 0:
            return planes
        # Those that hold the sample's present region too may be farther out than the vectors.
        return planes.where(self.slack(planes, vector - self.vector) < -elastic)

    def after(self, control: FloatArray, switching: FloatArray) -> FloatArray:
        """Return the vectors after a step, to first order, shape (N, 3).

        Args:
            control: Change of the control points, shape (K, n).
            switching: Change of the inner switching times, shape (m-1,).
        """
        change = self.at.change(control, switching)
        moved: FloatArray = self.vector + np.einsum("nij,nj->ni", self._by_joint, change)
        return moved

    def slack(self, planes: Planes, bend: FloatArray | None = None) -> FloatArray:
        """Return how far behind planes the vectors are, in radii, shape (P,).

        Args:
            planes: The planes.
            bend: Added to the vectors, shape (N, 3).
        """
        vector = self.vector if bend is None else self.vector + bend
        at, normal = planes.sample, planes.normal
        extents = (self._extent(planes), self.regions.extent(normal, planes.segment))
        axes, known = (self.regions.begin, self.regions.end), (at, normal, planes.segment)
        slack = plane_slack(known, vector, axes, self.segment, self.margin, extents)
        return self._slack(planes, vector) if slack is None else slack

    def _slack(self, planes: Planes, vector: FloatArray) -> FloatArray:
        at, normal = planes.sample, planes.normal
        beyond = np.minimum(
            np.einsum("pi,pi->p", normal, (vector - self._begin)[at]),
            np.einsum("pi,pi->p", normal, (vector - self._end)[at]),
        )
        extent = self._extent(planes)
        slack: FloatArray = 1 - self.margin[at] - beyond / extent + self._farther(planes, extent)
        return slack

    def rows(self, planes: Planes) -> Rows:
        """Return rows that keep the vectors behind planes; they have no numbers."""
        at, segment = planes.sample, self.segment[planes.sample]
        by_joint = np.einsum("pi,pij->pj", planes.normal, self._by_joint[at])
        by_joint /= self._extent(planes)[:, None]
        control, switching = self.at.chained({0: by_joint[:, None]}, at)
        count = len(planes)
        return Rows(
            self.at.first[at],
            control[:, 0],
            switching[:, 0],
            np.zeros(count),
            self.slack(planes),
            self.numbers[segment, self.regions.kind(planes.normal, segment)],
            np.full(count, -1),
        )

    @cached_property
    def _by_joint(self) -> FloatArray:
        return self.derivative()

    @cached_property
    def _begin(self) -> FloatArray:
        return self.regions.begin[self.segment]

    @cached_property
    def _end(self) -> FloatArray:
        return self.regions.end[self.segment]

    def _extent(self, planes: Planes) -> FloatArray:
        """Return how far the samples' own regions reach beyond their axes, (P,)."""
        return self.regions.extent(planes.normal, self.segment[planes.sample])

    def _farther(self, planes: Planes, extent: FloatArray) -> FloatArray:
        """Return how much farther out planes must be to hold another segment's region too, (P,).

        As a share of the extent of the samples' own. The sample may be in either, so that both are
        held.
        """
        farther = np.zeros(len(planes))
        both = np.flatnonzero(planes.segment != self.segment[planes.sample])
        at = planes.sample[both]
        own, other = (
            self._reach(planes.normal[both], segment, at)
            for segment in (self.segment[at], planes.segment[both])
        )
        farther[both] = np.maximum(other - own, 0.0) / extent[both]
        return farther

    def _reach(self, normal: FloatArray, segment: IntArray, at: IntArray) -> FloatArray:
        """Return how far samples' narrowed regions, in some segments, reach along normals."""
        axis_ends = (self.regions.begin[segment], self.regions.end[segment])
        farthest = np.maximum(*(np.einsum("pi,pi->p", normal, end) for end in axis_ends))
        extent = self.regions.extent(normal, segment)
        reach: FloatArray = farthest + (1 - self.margin[at]) * extent
        return reach

    def _excess_of(self, vector: FloatArray, segment: IntArray) -> FloatArray:
        excess: FloatArray = self.regions.share(vector, segment) - (1 - self.margin)
        return excess
