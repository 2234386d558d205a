"""Vectors that must stay in capsules, at samples of a spline: the tool's position, its rotation.

A capsule is convex: a vector p is inside if n.p <= max(n.A, n.B) + r for every unit normal n, A and
B being the ends of its axis. A linear program gets a few of these planes: at each sample the one
outward and those at the caps, and then the tangent planes where its own prediction leaves the
capsule (Kelley, "The cutting-plane method for solving convex programs", 1960).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.refinement.linear_rows import Rows
from tubeplanner.refinement.sampled_spline import SampledSpline

_NO_LENGTH = 1e-9  # [m or rad]
# A prediction may leave the capsule by this share of its radius.
_OUTSIDE = 0.002


@dataclass(frozen=True, eq=False)
class Planes:
    """P supporting planes of capsules.

    Attributes:
        sample: Whose capsule, shape (P,).
        normal: Unit vectors, outward, shape (P, 3).
        segment: Whose capsule they hold beside the sample's own, shape (P,).
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
        return Planes(
            np.concatenate([self.sample, other.sample]),
            np.concatenate([self.normal, other.normal]),
            np.concatenate([self.segment, other.segment]),
        )


@dataclass(frozen=True, eq=False)
class Capsules:
    """The capsules of m segments.

    Attributes:
        begin: Where their axes begin, shape (m, 3) [m or rad].
        end: Where they end, shape (m, 3).
        radius: Shape (m,) [m or rad].
    """

    begin: FloatArray
    end: FloatArray
    radius: FloatArray


@dataclass(frozen=True, eq=False)
class EvaluatedCapsules:
    """The capsules at N samples of a spline, and the vectors that must stay in them.

    Attributes:
        at: The spline at the samples.
        vector: Shape (N, 3) [m or rad].
        derivative: Returns what the vectors change by with the joints, shape (N, 3, n).
        capsules: Of all segments.
        segment: The samples' own, shape (N,).
        segments_of: Returns what they would be for other vectors (N, 3).
        in_chain: Whether samples pass from one segment to another by themselves, shape (N,).
        margin: The share of the radii that stays unused, shape (N,).
        limit: Numbers of the radii among the limits, shape (N,).
    """

    at: SampledSpline
    vector: FloatArray
    derivative: Callable[[], FloatArray]
    capsules: Capsules
    segment: IntArray
    segments_of: Callable[[FloatArray], IntArray]
    in_chain: BoolArray
    margin: FloatArray
    limit: IntArray

    @cached_property
    def begin(self) -> FloatArray:
        """Where the samples' axes begin, shape (N, 3) [m or rad]."""
        return self.capsules.begin[self.segment]

    @cached_property
    def end(self) -> FloatArray:
        """Where they end, shape (N, 3)."""
        return self.capsules.end[self.segment]

    @cached_property
    def radius(self) -> FloatArray:
        """Of the samples' capsules, shape (N,) [m or rad]."""
        return self.capsules.radius[self.segment]

    @cached_property
    def excess(self) -> FloatArray:
        """How far the vectors are outside the narrowed capsules, in radii, shape (N,)."""
        return self._excess_of(self._away(self.vector, self.segment), self.segment)

    def planes(self) -> Planes:
        """Return the planes outward and, where there is an axis that ends, those at both caps."""
        away, axis = self._away(self.vector, self.segment), self.end - self.begin
        distance, length = np.linalg.norm(away, axis=1), np.linalg.norm(axis, axis=1)
        off = np.flatnonzero(distance > _NO_LENGTH)
        long = np.flatnonzero((length > _NO_LENGTH) & ~self.in_chain)
        outward = away[off] / distance[off, None]
        along = axis[long] / length[long, None]
        sample = np.concatenate([off, long, long])
        return Planes(sample, np.concatenate([outward, along, -along]), self.segment[sample])

    def planes_where_outside(self, vector: FloatArray, elastic: float) -> Planes:
        """Return the tangent planes at other vectors (N, 3) that are outside.

        Those of a sample in a chain are its planes of the segment that it would then be in.

        Args:
            vector: The other vectors.
            elastic: So many radii outside is allowed.
        """
        segment = self.segments_of(vector)
        away = self._away(vector, segment)
        outside = np.flatnonzero(self._excess_of(away, segment) > elastic + _OUTSIDE)
        normal = away[outside] / np.linalg.norm(away[outside], axis=1)[:, None]
        planes = Planes(outside, normal, segment[outside])
        # Those that hold the sample's present capsule too may be farther out than the vectors.
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
        beyond = np.minimum(
            np.einsum("pi,pi->p", normal, (vector - self.begin)[at]),
            np.einsum("pi,pi->p", normal, (vector - self.end)[at]),
        )
        slack: FloatArray = 1 - self.margin[at] - beyond / self.radius[at] + self._farther(planes)
        return slack

    def rows(self, planes: Planes) -> Rows:
        """Return rows that keep the vectors behind planes; they have no numbers."""
        at = planes.sample
        by_joint = np.einsum("pi,pij->pj", planes.normal, self._by_joint[at])
        by_joint /= self.radius[at, None]
        control, switching = self.at.chained({0: by_joint[:, None]}, at)
        count = len(planes)
        return Rows(
            self.at.first[at],
            control[:, 0],
            switching[:, 0],
            np.zeros(count),
            self.slack(planes),
            self.limit[at],
            np.full(count, -1),
        )

    @cached_property
    def _by_joint(self) -> FloatArray:
        return self.derivative()

    def _farther(self, planes: Planes) -> FloatArray:
        """Return how much farther out planes must be to hold another segment's capsule too, (P,).

        In radii of the samples' own. The sample may be in either, so that both are held.
        """
        farther = np.zeros(len(planes))
        both = np.flatnonzero(planes.segment != self.segment[planes.sample])
        at = planes.sample[both]
        own, other = (
            self._reach(planes.normal[both], segment, at)
            for segment in (self.segment[at], planes.segment[both])
        )
        farther[both] = np.maximum(other - own, 0.0) / self.radius[at]
        return farther

    def _reach(self, normal: FloatArray, segment: IntArray, at: IntArray) -> FloatArray:
        """Return how far samples' narrowed capsules, in some segments, reach along normals."""
        axis_ends = (self.capsules.begin[segment], self.capsules.end[segment])
        farthest = np.maximum(*(np.einsum("pi,pi->p", normal, end) for end in axis_ends))
        reach: FloatArray = farthest + (1 - self.margin[at]) * self.capsules.radius[segment]
        return reach

    def _excess_of(self, away: FloatArray, segment: IntArray) -> FloatArray:
        share = np.linalg.norm(away, axis=1) / self.capsules.radius[segment]
        excess: FloatArray = share - (1 - self.margin)
        return excess

    def _away(self, vector: FloatArray, segment: IntArray) -> FloatArray:
        """Return vectors (N, 3) from the nearest points of segments' axes to vectors (N, 3)."""
        begin, end = self.capsules.begin[segment], self.capsules.end[segment]
        axis = end - begin
        square = np.maximum(np.einsum("ni,ni->n", axis, axis), _NO_LENGTH**2)
        share = np.clip(np.einsum("ni,ni->n", vector - begin, axis) / square, 0.0, 1.0)
        return vector - (begin + share[:, None] * axis)
