"""Region constraints: segment, compulsory point, rotation tolerance, goal; points' rates.

A region is convex: a vector p is inside if n.p <= max(n.A, n.B) + e(n) for every unit normal n, A
and B being the ends of its axis and e its extent beyond. A linear program gets a few of these
planes: at each sample the one outward and those of faces, and then the tangent planes where its own
prediction leaves the region (Kelley, "The cutting-plane method for solving convex programs", 1960).
"""

from collections.abc import Callable, Mapping, Sequence
from ctypes import c_int64
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import product
from typing import ClassVar

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.geometry.tube.regions import Capsules, SegmentRegions
from tubeplanner.geometry.tube.rotation import (
    SEGMENT,
    STAYING,
    TURNING,
    RotationalTube,
    Span,
)
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.limits.path_samples import LimitKey, PathSamples
from tubeplanner.limits.rates import PointRates
from tubeplanner.native.library import Doubles, Integers, native_function
from tubeplanner.optimizer.phased_spline import SampledSpline
from tubeplanner.optimizer.rows import (
    INNER_MARGIN,
    EvaluatedSpeedLimit,
    Rows,
    StepSize,
    plane_rows,
)
from tubeplanner.optimizer.step_program import Step
from tubeplanner.optimizer.tube_phases import OrderedSegments
from tubeplanner.task.problem import PlanningProblem

# ---- Vectors in regions, at samples of a spline: the tool's position, its rotation vector, or the
# velocity or acceleration of a point.

_plane_slack = native_function(
    *("plane_slack", c_int64, Integers, Doubles, Doubles, Doubles, Doubles, Integers, Integers),
    *(Integers, Doubles, Doubles, Doubles, Doubles),
)
# A prediction may leave the region by this fraction of its extent.
_OUTSIDE = 0.002
# Radii beyond which there is no bound: finite, as planes may be remembered.
_NO_BOUND = 1e3


@dataclass(frozen=True, eq=False)
class Planes:
    """P supporting planes of regions."""

    sample: IntArray  # the sample in whose region, shape (P,)
    normal: FloatArray  # unit vectors, outward, shape (P, 3)
    segment: IntArray  # the segment whose region they contain beside the sample's own, shape (P,)
    is_alone: BoolArray  # whether they contain that region alone, shape (P,)

    def __len__(self) -> int:
        return len(self.sample)

    def where(self, keep: BoolArray | IntArray) -> "Planes":
        """Return some of the planes."""
        return Planes(*(getattr(self, name)[keep] for name in self.__dataclass_fields__))

    def and_also(self, other: "Planes") -> "Planes":
        """Return these planes and others."""
        if len(other) == 0:
            return self
        names = self.__dataclass_fields__
        both = ((getattr(self, name), getattr(other, name)) for name in names)
        return Planes(*(np.concatenate(pair) for pair in both))


@dataclass(frozen=True, eq=False)
class EvaluatedRegions:
    """The vectors at N samples of a spline, and the region of each."""

    # Planes with less slack after a step [radii] are given to the next program at once.
    binding: ClassVar[float] = 0.005

    at: SampledSpline  # the spline at the samples
    vector: FloatArray  # shape (N, 3) [m or rad]
    # returns the vectors' derivatives by the joints' positions (0) and by their derivatives by x
    # (1), (N, 3, n) each
    derivative: Callable[[], Mapping[int, FloatArray]]
    regions: SegmentRegions  # of all segments
    segment: IntArray  # the samples' own, shape (N,)
    margin: FloatArray  # the fraction of the radii that stays unused, shape (N,)
    # of the regions' tolerances among the limits, by segment and kind, shape (m, kinds)
    numbers: IntArray
    # of samples in chains, whose segments follow from their vectors; None: all fixed
    segments: OrderedSegments | None = None
    # whether a step may cross the whole region: then all planes count as near
    is_crossed: bool = False
    # the power of the duration with which the regions grow: 1 for velocities, 2 for accelerations;
    # these are not elastic
    growth: int = 0

    @property
    def is_speed(self) -> bool:
        """True if the regions depend on the duration."""
        return self.growth > 0

    @cached_property
    def excess(self) -> FloatArray:
        """Distance of the vectors outside the narrowed regions, in radii, shape (N,)."""
        return self._excess_of(self.vector, self.segment)

    @cached_property
    def planes(self) -> Planes:
        """The planes outward and, unless segments pass into each other, those of faces."""
        faces = self.regions.faces(self.segment)
        normal = np.array([self.regions.outward(self.vector, self.segment), *faces])
        if self.segments is not None:
            normal[1:, self.segments.in_run] = 0.0
        kind, sample = np.nonzero(normal.any(axis=2))
        none = np.zeros(len(sample), dtype=bool)
        return Planes(sample, normal[kind, sample], self.segment[sample], none)

    def planes_where_outside(
        self, vector: FloatArray, room: float, *, are_alone: bool = False
    ) -> Planes:
        """Return the tangent planes at other vectors (N, 3) outside by more than `room` [radii].

        A sample in a chain gets the plane of the segment that it would then be in: it contains the
        region of its own segment as well or, on request, that segment's alone.
        """
        segment = self.segment if self.segments is None else self.segments.at(vector)
        outside = np.flatnonzero(self._excess_of(vector, segment) > room + _OUTSIDE)
        segment, alone = segment[outside], np.full(len(outside), are_alone)
        planes = Planes(outside, self.regions.outward(vector[outside], segment), segment, alone)
        if len(planes) == 0:
            return planes
        # Planes that contain the sample's present region too may be farther out than the vectors.
        return planes.where(self.slack(planes, vector - self.vector) < -room)

    def room(self, step: Step) -> float:
        """Return the room that a step makes beyond the regions, in radii."""
        return self.growth * step.duration / 2 if self.growth else step.elastic

    def vector_in(self, duration: float, longer: float) -> FloatArray:
        """Return the vectors (N, 3) of a run in another duration: the same."""
        return self.vector

    def after(
        self, control: FloatArray, switching: FloatArray, duration: float = 0.0
    ) -> FloatArray:
        """Return the vectors after a step, as of `Rows.used_by_step`, to first order."""
        after = self.vector.copy()
        for order, by in self._by_path.items():
            after += np.einsum("nij,nj->ni", by, self.at.change(control, switching, order))
        return after

    def slack(self, planes: Planes, bend: FloatArray | None = None) -> FloatArray:
        """Return the distance of the vectors, plus `bend` (N, 3), behind planes, in radii, (P,)."""
        vector = self.vector if bend is None else self.vector + bend
        at, normal, regions, own = planes.sample, planes.normal, self.regions, self.segment
        extent, other = (regions.extent(normal, each) for each in (own[at], planes.segment))
        if _plane_slack is not None:
            slack = np.empty(len(planes))
            place = (at, normal, vector, regions.begin, regions.end, own, planes.segment)
            is_alone = planes.is_alone.astype(np.int64)
            arrays = map(np.ascontiguousarray, (*place, is_alone, self.margin, extent, other))
            _plane_slack(len(planes), *arrays, slack)
            return slack
        beyond = np.minimum(
            *(
                np.einsum("pi,pi->p", normal, (vector - end[own])[at])
                for end in (regions.begin, regions.end)
            )
        )
        # Where the sample may be in the region of another segment, the plane contains that one too,
        # or that one alone.
        farther, both = np.zeros(len(planes)), np.flatnonzero(planes.segment != own[at])
        reaches = []
        for segment, extents in ((own[at[both]], extent), (planes.segment[both], other)):
            ends = (regions.begin[segment], regions.end[segment])
            farthest = np.maximum(*(np.einsum("pi,pi->p", normal[both], end) for end in ends))
            reaches.append(farthest + (1 - self.margin[at[both]]) * extents[both])
        least = np.where(planes.is_alone[both], -np.inf, 0.0)
        farther[both] = np.maximum(reaches[1] - reaches[0], least) / extent[both]
        slack = 1 - self.margin[at] - beyond / extent + farther
        return slack

    def rows(self, planes: Planes) -> Rows:
        """Return rows that keep the vectors behind planes; they have no numbers."""
        at, segment = planes.sample, self.segment[planes.sample]
        normal = planes.normal / self.regions.extent(planes.normal, segment)[:, None]
        by_path = {
            order: np.einsum("pi,pij->pj", normal, by[at])[:, None]
            for order, by in self._by_path.items()
        }
        control, switching = self.at.chained(by_path, at)
        count = len(planes)
        return Rows(
            self.at.first[at],
            control[:, 0],
            switching[:, 0],
            np.full(count, -0.5 * self.growth),
            self.slack(planes),
            self.numbers[segment, self.regions.kind(planes.normal, segment)],
            np.full(count, -1),
        )

    @cached_property
    def _by_path(self) -> Mapping[int, FloatArray]:
        return self.derivative()

    def _excess_of(self, vector: FloatArray, segment: IntArray) -> FloatArray:
        excess: FloatArray = self.regions.fraction(vector, segment) - (1 - self.margin)
        return excess


def evaluated_points(
    tube: Tube,
    at: SampledSpline,
    path: PathSamples,
    regions: SegmentRegions,
    margin: float,
    numbers: IntArray,
) -> EvaluatedRegions:
    """Return the balls about compulsory points, capsules without length, at switching times.

    The tool is in a ball as it passes on to the segment that begins at the point. Arguments as of
    `EvaluatedRegions`, with the regions of all segments and the numbers of their tolerances.
    """
    points, radius = tube.compulsory_points, regions.radius
    narrower = points - (radius[points - 1] < radius[points])
    index, own = tube.points[points], np.arange(len(points))
    # The ball's tolerance is the one that gives the region's extent along the segment.
    kind = regions.kind(regions.faces(narrower)[0], narrower)
    return EvaluatedRegions(
        at,
        path.tool_pose[1],
        lambda: {0: path.tool_jacobian[:, :3]},
        Capsules(index, index, radius[narrower]),
        own,
        np.full(len(points), margin),
        numbers[narrower, kind][:, None],
    )


# ---- Velocities of the tool and of points on links, and the tool's acceleration, in balls.
#
# Rows bound the vectors along their present directions alone. Where a point hardly moves or turns,
# they say nothing: tangent planes of the balls join where a step makes it too fast.


def evaluated_speeds(evaluated: EvaluatedSpeedLimit, duration: float) -> list[EvaluatedRegions]:
    """Return the derivatives by x of every point of a limit, in balls of the limit times T^k [m].

    k is the order of the derivatives.
    """
    limit = evaluated.limit
    if not isinstance(limit, PointRates):
        return []
    path, count = evaluated.path, len(evaluated.path)
    centre, own, margin = np.zeros((count, 3)), np.arange(count), np.zeros(count)
    allowed = duration**limit.order * limit.allowed(path)
    keys = np.broadcast_to(limit.key_of(path), allowed.T.shape)

    def by_path(point: int) -> Mapping[int, FloatArray]:
        return {k: by[point] for k, by in enumerate(limit.derivatives(path))}

    return [
        EvaluatedRegions(
            evaluated.at,
            vector,
            partial(by_path, point),
            Capsules(centre, centre, radius),
            own,
            margin,
            evaluated.numbers[key][:, None],
            growth=limit.order,
        )
        for point, (vector, radius, key) in enumerate(
            zip(limit.vectors(path), allowed, keys.T, strict=True)
        )
    ]


# ---- The tool's orientation within its segment's tolerance.
#
# Bounds on the three components of the rotation vector are planes; a bound on the angle is a ball.
#
# Where the nearest point of the segment passes an end, the reference stops turning: a kink, on
# which an optimum may lie. The rotations against references that turn on or have stopped are
# bounded too, where they leave more room than the rotation itself: there the larger of both is what
# is bounded, and nothing is lost. (Where they leave less, the smaller is.)

_SIDES = np.vstack([np.eye(3), -np.eye(3)])


@dataclass(frozen=True, eq=False)
class EvaluatedRotation:
    """The tool's rotation at N samples of a spline, and the bounds on its three components."""

    is_elastic: ClassVar[bool] = True

    tube: RotationalTube  # the rotational part of the tube
    at: SampledSpline  # the spline at the samples
    path: PathSamples  # the arm there
    margin: float  # the fraction of the tolerances that stays unused
    numbers: IntArray  # of the tolerances among the limits, shape (m,)
    segment: IntArray  # the samples' segments, shape (N,)
    span: Span = SEGMENT  # the u between which the reference turns
    # of the reference beyond a kink: the rotation against the reference itself, and the samples at
    # which that is the neighbouring branch, shape (N,)
    beyond: "tuple[EvaluatedRotation, BoolArray] | None" = None

    @property
    def excess(self) -> FloatArray:
        """Excess of components over the narrowed bounds, in bounds, shape (N,)."""
        excess: FloatArray = (abs(self._error) / self._bounds).max(axis=1) - (1 - self.margin)
        return excess

    @property
    def bounds_components(self) -> bool:
        """True if a component is bounded in some sample's segment."""
        return bool(np.isfinite(self._bounds).any())

    @property
    def bounds_angle(self) -> bool:
        """True if the angle is bounded in some sample's segment."""
        return bool(np.isfinite(self.tube.bounds[self.segment, 3]).any())

    def kinks(self, ends: BoolArray) -> "list[EvaluatedRotation]":
        """Return the rotation beyond the kinks at ends of segments, unless no reference turns.

        The ends (m, 2) are those of each segment that no other segment follows in its chain.
        """
        if not self.tube.angles.any():
            return []
        u, (first, last) = self.tube.projection(self.path.tool_pose[1], self.segment), ends.T
        first, last = first[self.segment], last[self.segment]
        is_inside = (u >= 0) & (u <= 1)
        turning = (u < 0) & first | (u > 1) & last
        branches = zip(
            (TURNING, *STAYING), (turning, is_inside & first, is_inside & last), strict=True
        )
        return [replace(self, span=span, beyond=(self, where)) for span, where in branches]

    def angle(self) -> EvaluatedRegions:
        """Return the bound on the angle: the rotation vector in a ball."""
        centre, margin = (
            np.zeros((len(self.tube.bounds), 3)),
            np.full(len(self.segment), self.margin),
        )
        if self.beyond is not None:
            here, where = self.beyond
            farther = np.linalg.norm(self._error, axis=1) > np.linalg.norm(here._error, axis=1)
            margin[farther | ~where] = -_NO_BOUND
        return EvaluatedRegions(
            self.at,
            self._error,
            lambda: {0: self._by_joint},
            Capsules(centre, centre, self.tube.bounds[:, 3]),
            self.segment,
            margin,
            self.numbers[:, None],
        )

    def rows(self, duration: float, size: StepSize | None) -> Rows:
        """Return rows that keep the components within their bounds, as `EvaluatedSpeedLimit`."""
        bounds = np.hstack([self._bounds, self._bounds])
        by_side = np.matmul(_SIDES, self._by_joint) / bounds[:, :, None]
        own = self._slack.reshape(bounds.shape)
        slack = np.where(np.isfinite(bounds), own, np.inf)
        if self.beyond is not None:
            here, where = self.beyond
            slack[(own < here._slack.reshape(bounds.shape)) | ~where[:, None]] = np.inf
        return plane_rows(self.at, by_side, slack, self.numbers[self.segment], size)

    @property
    def row_count(self) -> int:
        """Number of rows."""
        return len(_SIDES) * len(self.segment)

    def slack(self, duration: float, squared_duration: float) -> FloatArray:
        """Return the slack of all rows, the same for every duration."""
        return self._slack

    @property
    def _slack(self) -> FloatArray:
        bounds = np.hstack([self._bounds, self._bounds])
        slack: FloatArray = 1 - self.margin - self._error @ _SIDES.T / bounds
        return slack.ravel()

    @property
    def _bounds(self) -> FloatArray:
        return self.tube.bounds[self.segment, :3]

    @cached_property
    def _error(self) -> FloatArray:
        """Rotation vectors from the reference to the tool, shape (N, 3) [rad]."""
        return self.tube.error(*self.path.tool_pose, self.segment, self.span)

    @cached_property
    def _by_joint(self) -> FloatArray:
        """Derivatives of the rotation vectors by the joints, shape (N, 3, n)."""
        jacobian = self.path.tool_jacobian
        return self.tube.error_jacobian(*self.path.tool_pose, jacobian, self.segment, self.span)[1]


# ---- The tool in the ball and the rotation tolerance of its goal, at the end of a spline.

# Named as in the problem file.
_BALL, _ROTATION = LimitKey("tolerance"), LimitKey("rotation_tolerance")
# Towards the faces, edges and corners of a cube.
_CORNERS = [np.array(corner) for corner in product((-1.0, 0.0, 1.0), repeat=3) if any(corner)]
_AROUND = tuple(corner / np.linalg.norm(corner) for corner in _CORNERS)


class _Balls(Capsules):
    """Balls with a polyhedron of planes from the beginning.

    Steps are larger than the balls: tangent planes alone, one after each step, would be too many.
    """

    def faces(self, segment: IntArray) -> Sequence[FloatArray]:
        """Return the normals of the polyhedron."""
        return [np.tile(normal, (len(segment), 1)) for normal in _AROUND]


def goal_keys(problem: PlanningProblem) -> list[LimitKey]:
    """Return the keys of the tolerances of an open goal; none for others."""
    goal = problem.open_goal
    if goal is None:
        return []
    return [_BALL] * (goal.tolerance > 0) + [_ROTATION] * goal.bounds_rotation


def evaluated_ball(
    problem: PlanningProblem, at: SampledSpline, path: PathSamples, numbers: Mapping[LimitKey, int]
) -> list[EvaluatedRegions]:
    """Return the ball of the goal, a capsule without length, or nothing.

    Takes the spline and the arm at its end, and the numbers of the keys among those of all limits.
    """
    goal = problem.open_goal
    if goal is None or goal.tolerance == 0:
        return []
    centre, own = goal.position[None], np.zeros(1, dtype=np.int64)
    ball = EvaluatedRegions(
        at,
        path.tool_pose[1],
        lambda: {0: path.tool_jacobian[:, :3]},
        _Balls(centre, centre, np.array([goal.tolerance])),
        own,
        np.full(1, INNER_MARGIN),
        np.array([[numbers[_BALL]]]),
        is_crossed=True,
    )
    return [ball]


def evaluated_rotation(
    problem: PlanningProblem, at: SampledSpline, path: PathSamples, numbers: Mapping[LimitKey, int]
) -> list[EvaluatedRotation]:
    """Return the bound on the rotation at the goal, or nothing; arguments as for the ball."""
    goal, beyond = problem.open_goal, problem.tube.segment_count
    if goal is None or not goal.bounds_rotation:
        return []
    assert problem.rotation is not None
    own = np.full(beyond + 1, numbers[_ROTATION])
    return [EvaluatedRotation(problem.rotation, at, path, INNER_MARGIN, own, np.array([beyond]))]
