"""Clearance constraints of links, at samples of a spline where they come close."""

from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.geometry.collision_checker import CollisionChecker
from tubeplanner.geometry.convex_shapes import ClosestPoints
from tubeplanner.optimizer.phased_spline import (
    KnotGrid,
    PhasedSpline,
    SampledSpline,
    Samples,
    sampled,
    segments_of_pieces,
)
from tubeplanner.optimizer.rows import (
    INNER_MARGIN,
    MERIT_TOLERANCE,
    NO_LIMIT,
    Rows,
    StepSize,
    plane_rows,
)
from tubeplanner.outcome import MARGIN_TOLERANCE
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.required_distances import NearEnd, RequiredDistances, in_contact

# ---- Distances of single corners of a shape from a plane that bounds another shape.
#
# Of shapes that lie on each other many corners are equally near. The nearest points belong to one
# corner: a step that rotates the shape about it brings another corner nearer.

CORNERS = 4  # of a shape with distances of their own
# Corners that are farther than the nearest by more than this do not count [m].
_NEAR = 0.005


def of_corners(
    checker: CollisionChecker,
    poses: tuple[FloatArray, FloatArray],
    pairs: IntArray,
    closest: ClosestPoints,
    corner: IntArray,
) -> ClosestPoints:
    """Return the closest points of pairs (E, 2), some at a corner of the smaller shape.

    Poses of all bodies are (E, bodies, 3, 3) and (E, bodies, 3) [m]. Corners (E,) are numbered from
    0 to 3 among the nearest, in the order of the vertices; of a pair with -1 the points stay.
    """
    distance, first, second = (
        values.copy() for values in (closest.distance, closest.first, closest.second)
    )
    for row in np.flatnonzero(corner >= 0):
        shapes = [checker.shapes[index] for index in pairs[row]]
        smaller = int(np.argmin([each.shape.bounding_radius for each in shapes]))
        placed, body = shapes[smaller], shapes[smaller].body
        corners = placed.shape.vertices @ poses[0][row, body].T + poses[1][row, body]
        towards = closest.direction[row] if smaller == 1 else -closest.direction[row]
        height = corners @ towards
        nearest = np.sort(np.argsort(height, kind="stable")[:CORNERS])
        vertex = nearest[min(int(corner[row]), len(nearest) - 1)]
        more = float(height[vertex] - height.min())
        if more > _NEAR:
            continue
        distance[row] += more
        apart = distance[row] + sum(each.shape.radius for each in shapes)
        own, other = (second, first) if smaller == 1 else (first, second)
        own[row], other[row] = corners[vertex], corners[vertex] - apart * towards
    return replace(closest, distance=distance, first=first, second=second)


# ---- Required distances along a spline, smooth in its configurations.
#
# Where solids are in contact at start or goal, a smaller distance is required while the tool is
# near. That ends with a jump; here the required distance rises to its full value, late and steeply,
# so that the linearization sees the rise.

# The required distance rises with the square of the distance from the end, and is complete at this
# fraction of the range: between samples a path cuts the corner there. Higher powers cost less time,
# by .1 % where solids leave each other at a small angle, but steps do not find their way.
_RISEN_AT = 0.93
# It rises from the end on, by this fraction of the mean slope: motions of solids along each other
# are not certain to stay clear between samples.
_LEAVING = 0.3


class DistancesAlong:
    """Required distances of P pairs at samples of a spline."""

    def __init__(self, problem: PlanningProblem, ends: FloatArray, slack: float) -> None:
        """Take a problem, start and goal (2, n), and an additional distance from obstacles [m]."""
        self._problem = problem
        self._required = RequiredDistances(problem, ends[0], ends[1], slack)

    def at(self, grid: KnotGrid, samples: Samples, q: FloatArray) -> FloatArray:
        """Return required distances at samples in configurations (N, n), shape (N, P) [m]."""
        rows = self._required.by_segment
        if self._required.is_constant:
            return np.broadcast_to(rows[0], (len(q), rows.shape[1]))
        own, other = _segments(grid, samples)
        tool = self._problem.robot.tool_position(q)
        return np.maximum(self._risen(own, tool), self._risen(other, tool))

    def of_pairs(
        self, grid: KnotGrid, samples: Samples, q: FloatArray, pair: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the required distance of one pair at each of N samples, and its derivative.

        Distances (N,) [m] and their derivatives by the joints (N, n) [m/rad or 1] at q (N, n).
        """
        change = np.zeros(q.shape)
        if self._required.is_constant:
            return self._required.by_segment[0, pair], change
        own, other = _segments(grid, samples)
        tool = self._problem.robot.tool_position(q)
        required = self._required.by_segment[self._required.row_of[own], pair]
        full, by_tool = required.copy(), np.zeros(tool.shape)
        for near in self._required.near_ends:
            here = near.holds(own, tool) & near.pair[pair]
            fraction, slope = _risen_fraction(near, tool)
            more = (full - near.distance).clip(min=0)
            risen = near.distance + more * fraction
            here &= risen < required
            required = np.where(here, risen, required)
            by_tool[here] = (more[:, None] * slope)[here]
        beside = other != own
        by_tool[beside] = 0.0
        every = self.at(grid, samples, q)[np.arange(len(pair)), pair]
        jacobian = self._problem.robot.tool_jacobian(q)[1][:, :3]
        change = np.einsum("ni,nij->nj", by_tool, jacobian)
        return np.where(beside, every, required), change

    def at_ends(self, ends: FloatArray) -> FloatArray:
        """Return required distances at the start and, if in `ends`, the goal, (1 or 2, P) [m]."""
        segments = np.array([0, self._problem.tube.segment_count - 1])[: len(ends)]
        return self._required.at(segments, self._problem.robot.tool_position(ends))

    def _risen(self, segment: IntArray, tool: FloatArray) -> FloatArray:
        """Return required distances in segments (N,) with the tool at (N, 3), shape (N, P) [m]."""
        full = self._required.by_segment[self._required.row_of[segment]]
        required = full.copy()
        for near in self._required.near_ends:
            position = np.ix_(near.holds(segment, tool), near.pair)
            fraction = _risen_fraction(near, tool[position[0][:, 0]])[0][:, None]
            more = (full[position] - near.distance).clip(min=0)
            required[position] = np.minimum(required[position], near.distance + more * fraction)
        return required


def _risen_fraction(near: NearEnd, tool: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the fraction of the rise that is required with the tool at (N, 3), and its derivative.

    The fraction is 0 at the end, 1 where the rise is complete and more beyond, shape (N,); its
    derivative by the tool has shape (N, 3) [1/m].
    """
    away, length = tool - near.tool, _RISEN_AT * near.within
    distance = np.linalg.norm(away, axis=1)
    fraction = distance / length
    slope = (2 * fraction + _LEAVING * (1 - 2 * fraction)) / length
    onward = away / np.where(distance > 0, distance, 1.0)[:, None]
    return fraction**2 + _LEAVING * fraction * (1 - fraction), slope[:, None] * onward


def _segments(grid: KnotGrid, samples: Samples) -> tuple[IntArray, IntArray]:
    """Return each sample's segment and, at a switching time, its neighbour's: both (N,)."""
    own = segments_of_pieces(grid)[samples.interval]
    first = np.array([run.start for run in grid.runs])
    offset = np.where(samples.fraction == 0, -1, np.where(samples.fraction == 1, 1, 0))
    beside = first[np.clip(samples.phase + offset, 0, len(first) - 1)]
    is_inner: BoolArray = (offset != 0) & (samples.phase + offset >= 0)
    is_inner &= samples.phase + offset < len(first)
    return own, np.where(is_inner, beside, own)


# ---- Clearances of links from obstacles and each other, where they come close along a spline.

# The unit of the rows, as the radius is for the tube [arm lengths]: with other units of length, or
# an arm of another size, steps stay the same.
_UNIT = 0.046
# Pairs that come closer than this beyond the required distance are watched [units].
_WATCHED = 0.2
PER_INTERVAL = 4  # samples
# The same where links are looked for after every step. (On 20 routes through narrow cells, 4 left
# 10 motions with links 0.1 to 7 mm deep between samples, 8 left 3, 16 none.)
CAUTIOUS_PER_INTERVAL = 16
# Samples of a pair closer than this fraction of their spacing count as one; requested samples
# nearly always count.
_SAME_FRACTION, _SAME_FRACTION_ASKED = 0.3, 1e-3


class LinkConstraints:
    """The pairs of shapes that must stay apart, and the samples at which they are watched."""

    def __init__(
        self, problem: PlanningProblem, slack: float = 0.0, per_interval: int = PER_INTERVAL
    ) -> None:
        """Watch no pairs yet.

        Args:
            problem: The planning problem.
            slack: Clearance from obstacles, beyond the required distance [m].
            per_interval: Number of samples of a knot interval at which pairs are looked for.
        """
        checker = problem.collision
        self._problem, self._checker, self._slack = problem, checker, slack
        self._per_interval = per_interval
        self._pairs, self._unit = checker.pairs, _UNIT * problem.robot.arm_length
        self._samples = Samples(np.zeros(0, int), np.zeros(0), np.zeros(0, int))
        self._pair = np.zeros(0, dtype=np.int64)
        self._corner = np.zeros(0, dtype=np.int64)
        self._in_contact = in_contact(problem)
        self._spare = np.full(len(self._pairs), np.nan)
        self._approach = checker.motion_weights(self._pairs)
        self._seen: tuple[FloatArray, FloatArray] | None = None
        self._along: tuple[FloatArray, DistancesAlong] | None = None

    def at(self, spline: PhasedSpline) -> "EvaluatedLinks":
        """Return the watched pairs at a spline."""
        at = sampled(spline, self._samples)
        poses = self._problem.robot.body_poses(at.position)
        pairs = self._pairs[self._pair]
        closest = self._checker.closest_points(*poses, pairs)
        closest = of_corners(self._checker, poses, pairs, closest, self._corner)
        spare, unit = self._spare[self._pair], self._unit
        along = self._required(spline)
        required, change = along.of_pairs(spline.grid, self._samples, at.position, self._pair)
        # Where the aimed distance is smaller, the merit function may ignore less of it. Solids that
        # touch at start or goal have no slack but half of the certificate's tolerance.
        strict = MERIT_TOLERANCE * (1 - spare / (INNER_MARGIN * unit)) - MARGIN_TOLERANCE / 2 / unit
        aim = (required + spare, change, strict.clip(min=0))
        return EvaluatedLinks(self._problem, at, pairs, unit, *aim, *poses, closest)

    def on_other_knots(self, spline: PhasedSpline, other: PhasedSpline) -> "LinkConstraints":
        """Return the constraints for a spline on other knots, with samples at the same times."""
        result = copy(self)
        times = self._samples.times(spline.switching_times)
        result._samples = other.grid.samples_at(other.switching_times, times)
        result._seen = None
        return result

    def add_samples(self, spline: PhasedSpline) -> bool:
        """Watch pairs at local minima of the clearance; return True if a new pair is too close."""
        if len(self._pairs) == 0:
            return False
        samples = spline.grid.samples(np.arange(self._per_interval) / self._per_interval)
        q = sampled(spline, samples).position
        required = self._required(spline).at(spline.grid, samples, q)
        apart = np.full((len(q), len(self._pairs)), -np.inf)
        if self._seen is not None:  # the motion since the last look, times the joints' weights
            seen, distance = self._seen
            apart = distance - abs(q - seen) @ self._approach.T
        distance = self._distances(q, apart, required)
        self._seen = q, distance
        clearance = distance - required
        before = np.vstack([np.full((1, len(self._pairs)), np.inf), clearance[:-1]])
        after = np.vstack([clearance[1:], np.full((1, len(self._pairs)), np.inf)])
        lowest = (clearance < _WATCHED * self._unit) & (clearance <= before) & (clearance < after)
        sample, pair = np.nonzero(lowest)
        at = samples.where(sample)
        return self._watch(spline, at, pair, clearance[sample, pair], _SAME_FRACTION)

    def set_samples(self, spline: PhasedSpline, samples: Samples) -> None:
        """Watch the pairs that come close at samples."""
        q = sampled(spline, samples).position
        required = self._required(spline).at(spline.grid, samples, q)
        distance = self._distances(q, np.full((len(q), len(self._pairs)), -np.inf), required)
        sample, pair = np.nonzero(distance - required < _WATCHED * self._unit)
        at = samples.where(sample)
        self._watch(spline, at, pair, np.zeros(len(pair)), _SAME_FRACTION_ASKED)

    def _watch(
        self,
        spline: PhasedSpline,
        samples: Samples,
        pair: IntArray,
        clearance: FloatArray,
        same_fraction: float,
    ) -> bool:
        """Watch pairs at samples that are not watched yet; return True if a pair is too close."""
        times = spline.switching_times
        old, new = self._samples.times(times), samples.times(times)
        spacing = np.diff(spline.grid.breakpoints(times))[samples.interval] / self._per_interval
        same = (pair[:, None] == self._pair) & (
            abs(new[:, None] - old) < same_fraction * spacing[:, None]
        )
        fresh = np.flatnonzero(~same.any(axis=1))
        self._set_spare(spline, np.unique(pair[fresh]))
        # Solids in contact may lie on each other: several corners count.
        rows = np.repeat(fresh, np.where(self._in_contact[pair[fresh]], CORNERS, 1))
        number = np.arange(len(rows)) - np.searchsorted(rows, rows)
        corner = np.where(self._in_contact[pair[rows]], number, -1)
        self._samples = self._samples.and_also(samples.where(rows))
        self._pair = np.concatenate([self._pair, pair[rows]])
        self._corner = np.concatenate([self._corner, corner])
        too_close = clearance[fresh] < self._spare[pair[fresh]]
        return bool(too_close.any())

    def _required(self, spline: PhasedSpline) -> DistancesAlong:
        """Return the required distances along splines with the ends of a spline; cached."""
        ends = spline.control_points[[0, -1]]
        if self._along is None or not np.array_equal(self._along[0], ends):
            self._along = ends.copy(), DistancesAlong(self._problem, ends, self._slack)
        return self._along[1]

    def _set_spare(self, spline: PhasedSpline, pairs: IntArray) -> None:
        """Set the distance beyond the clearance: small, and only where start and goal allow."""
        pairs = pairs[np.isnan(self._spare[pairs])]
        ends = spline.control_points[[0] if self._problem.endpoints[1].is_open else [0, -1]]
        rotation, position = self._problem.robot.body_poses(ends)
        distances = [
            self._checker.distances(*pose, self._pairs[pairs])
            for pose in zip(rotation, position, strict=True)
        ]
        required = self._required(spline).at_ends(ends)[:, pairs]
        there = np.min(distances - required, axis=0) - 1e-6
        spare = self._spare.copy()  # objects from `on_other_knots` share the array
        spare[pairs] = np.clip(there, 0.0, INNER_MARGIN * self._unit)
        self._spare = spare

    def _distances(self, q: FloatArray, bounds: FloatArray, required: FloatArray) -> FloatArray:
        """Return distances of all pairs at configurations along a spline, shape (N, P) [m].

        Distances of pairs too far to be watched are lower bounds: the known ones, from spheres, or
        along the direction that separates the pair at a configuration near by.
        """
        near: FloatArray = required + _WATCHED * self._unit
        return self._checker.near_distances(q, self._pairs, near, bounds)


@dataclass(frozen=True, eq=False)
class EvaluatedLinks:
    """Watched pairs of a spline, E of them, each at its own instant."""

    is_elastic: ClassVar[bool] = True

    problem: PlanningProblem
    at: SampledSpline  # the spline at those instants
    pairs: IntArray  # indices of the shapes, shape (E, 2)
    unit: float  # of the rows [m]
    distance: FloatArray  # that steps aim at, shape (E,) [m]
    change: FloatArray  # its derivatives by the joints, shape (E, n) [m/rad or 1]
    strict: FloatArray  # added to the excess, shape (E,)
    rotation: FloatArray  # of all bodies, shape (E, bodies, 3, 3)
    position: FloatArray  # of all bodies, shape (E, bodies, 3) [m]
    closest: ClosestPoints  # the closest points of the pairs

    @cached_property
    def excess(self) -> FloatArray:
        """Violation of each pair's distance [units], shape (E,)."""
        return self.strict - self._slack

    def slack(self, duration: float, squared_duration: float) -> FloatArray:
        """Return the slack of all rows, the same for every duration, shape (E,)."""
        return self._slack

    @property
    def row_count(self) -> int:
        """Number of rows."""
        return len(self.pairs)

    def rows(self, duration: float, size: StepSize | None) -> Rows:
        """Return rows that keep the pairs apart, as `EvaluatedSpeedLimit`."""
        limit = np.full(len(self.pairs), NO_LIMIT)
        return plane_rows(self.at, self._by_joint, self._slack[:, None], limit, size)

    @cached_property
    def _by_joint(self) -> FloatArray:
        """Derivatives of the used distances by the joints, shape (E, 1, n)."""
        gradient = self.problem.collision.distance_gradient(
            self.rotation, self.position, self.pairs, self.closest
        )
        by_joint: FloatArray = (self.change - gradient)[:, None] / self.unit
        return by_joint

    @property
    def _slack(self) -> FloatArray:
        """Distance of the pairs beyond the target distance [units], shape (E,)."""
        slack: FloatArray = (self.closest.distance - self.distance) / self.unit
        return slack
