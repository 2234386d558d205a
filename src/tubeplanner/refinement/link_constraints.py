"""Links clear of obstacles and of each other, at the samples of a spline where they come close."""

from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.collision.near_distances import near_distances
from tubeplanner.collision.separation import ClosestPoints
from tubeplanner.outcome import MARGIN_TOLERANCE
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.problem.required_distances import in_contact
from tubeplanner.refinement.corner_distances import CORNERS, of_corners
from tubeplanner.refinement.distances_along import AimedDistances, DistancesAlong
from tubeplanner.refinement.linear_rows import (
    INNER_MARGIN,
    MERIT_TOLERANCE,
    NO_LIMIT,
    Rows,
    StepSize,
    plane_rows,
)
from tubeplanner.refinement.phased_spline import PhasedSpline, Samples
from tubeplanner.refinement.sampled_spline import SampledSpline, sampled

# The unit of the rows [m], as the radius is for the tube.
_UNIT = 0.05
# Steps aim at this much more than what is required, unless start or goal have less [m].
_INNER_MARGIN = INNER_MARGIN * _UNIT
# Half of what a certificate tolerates, in units: solids that touch at start or goal have no room.
_ROUNDING = MARGIN_TOLERANCE / 2 / _UNIT
# Pairs that come closer than this beyond what is required are watched [m].
_WATCHED = 0.01
_PER_INTERVAL = 4  # samples looked at
# Samples of a pair closer than this share of their spacing count as one; requested ones nearly
# always count.
_SAME_SHARE, _SAME_SHARE_ASKED = 0.3, 1e-3


class LinkConstraints:
    """The pairs of shapes that must stay apart, and where along the spline they are watched."""

    def __init__(self, problem: PlanningProblem, room: float = 0.0) -> None:
        """Watch no pairs yet.

        Args:
            problem: The planning problem.
            room: What is to stay free from obstacles, beyond what is asked [m].
        """
        checker = problem.collision
        self._problem, self._checker, self._room = problem, checker, room
        self._pairs = checker.pairs
        self._samples = Samples(np.zeros(0, int), np.zeros(0), np.zeros(0, int))
        self._pair = np.zeros(0, dtype=np.int64)
        self._corner = np.zeros(0, dtype=np.int64)
        self._in_contact = in_contact(problem)
        self._spare = np.full(len(self._pairs), np.nan)
        self._approach = checker.motion_weights(self._pairs)
        self._seen: tuple[FloatArray, FloatArray] | None = None
        self._along: tuple[FloatArray, DistancesAlong] | None = None

    def at(self, spline: PhasedSpline) -> "EvaluatedLinks":
        """Return the pairs that are watched, at a spline."""
        at = sampled(spline, self._samples)
        rotation, position = self._problem.robot.body_poses(at.position)
        pairs = self._pairs[self._pair]
        poses = rotation, position
        closest = self._checker.closest_points(*poses, pairs)
        closest = of_corners(self._checker, poses, pairs, closest, self._corner)
        spare = self._spare[self._pair]
        along = self._required(spline)
        required, change = along.of_pairs(spline.grid, self._samples, at.position, self._pair)
        # Where the aimed distance is smaller, the merit function may ignore less of it.
        strict = (MERIT_TOLERANCE * (1 - spare / _INNER_MARGIN) - _ROUNDING).clip(min=0)
        aim = AimedDistances(required + spare, change, strict)
        return EvaluatedLinks(self._problem, at, pairs, aim, *poses, closest)

    def on_other_knots(self, spline: PhasedSpline, other: PhasedSpline) -> "LinkConstraints":
        """Return the same for a spline on other knots, watched where they were."""
        moved = copy(self)
        times = self._samples.times(spline.switching_times)
        moved._samples = other.grid.samples_at(other.switching_times, times)
        moved._seen = None
        return moved

    def look(self, spline: PhasedSpline) -> bool:
        """Watch pairs where they come closest; return whether a new one is too close."""
        if len(self._pairs) == 0:
            return False
        samples = spline.grid.samples(np.arange(_PER_INTERVAL) / _PER_INTERVAL)
        q = sampled(spline, samples).position
        required = self._required(spline).at(spline.grid, samples, q)
        distance = self._distances(q, self._still_apart(q), required)
        self._seen = q, distance
        clearance = distance - required
        before = np.vstack([np.full((1, len(self._pairs)), np.inf), clearance[:-1]])
        after = np.vstack([clearance[1:], np.full((1, len(self._pairs)), np.inf)])
        lowest = (clearance < _WATCHED) & (clearance <= before) & (clearance < after)
        sample, pair = np.nonzero(lowest)
        at = samples.where(sample)
        return self._watch(spline, at, pair, clearance[sample, pair], _SAME_SHARE)

    def look_at(self, spline: PhasedSpline, samples: Samples) -> None:
        """Watch the pairs that come close at samples."""
        q = sampled(spline, samples).position
        required = self._required(spline).at(spline.grid, samples, q)
        distance = self._distances(q, np.full((len(q), len(self._pairs)), -np.inf), required)
        sample, pair = np.nonzero(distance - required < _WATCHED)
        at = samples.where(sample)
        self._watch(spline, at, pair, np.zeros(len(pair)), _SAME_SHARE_ASKED)

    def _watch(
        self,
        spline: PhasedSpline,
        samples: Samples,
        pair: IntArray,
        clearance: FloatArray,
        same_share: float,
    ) -> bool:
        """Watch pairs at samples that are not watched yet; return whether one is too close."""
        switching_times = spline.switching_times
        known, new = self._samples.times(switching_times), samples.times(switching_times)
        spacing = (
            np.diff(spline.grid.breakpoints(switching_times))[samples.interval] / _PER_INTERVAL
        )
        same = (pair[:, None] == self._pair) & (
            abs(new[:, None] - known) < same_share * spacing[:, None]
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
        """Return what is required along splines that begin and end where this one does."""
        ends = spline.control_points[[0, -1]]
        if self._along is None or not np.array_equal(self._along[0], ends):
            self._along = ends.copy(), DistancesAlong(self._problem, ends, self._room)
        return self._along[1]

    def _set_spare(self, spline: PhasedSpline, pairs: IntArray) -> None:
        """Set what is aimed at beyond what is required: a little, where start and goal have it."""
        pairs = pairs[np.isnan(self._spare[pairs])]
        ends = spline.control_points[[0] if self._problem.given_goal is None else [0, -1]]
        rotation, position = self._problem.robot.body_poses(ends)
        found = [
            self._checker.distances(*pose, self._pairs[pairs])
            for pose in zip(rotation, position, strict=True)
        ]
        required = self._required(spline).at_ends(ends)[:, pairs]
        there = np.min(found - required, axis=0) - 1e-6
        spare = self._spare.copy()  # what another object has stays as it is
        spare[pairs] = np.clip(there, 0.0, _INNER_MARGIN)
        self._spare = spare

    def _still_apart(self, q: FloatArray) -> FloatArray:
        """Return lower bounds of the distances (N, P) [m] at configurations on these knots.

        By how far they have moved since the last look.
        """
        if self._seen is None:
            return np.full((len(q), len(self._pairs)), -np.inf)
        seen, distance = self._seen
        bounds: FloatArray = distance - abs(q - seen) @ self._approach.T
        return bounds

    def _distances(self, q: FloatArray, known: FloatArray, required: FloatArray) -> FloatArray:
        """Return distances of all pairs at configurations along a spline, shape (N, P).

        Those beyond what is watched are lower bounds: known ones, from spheres, or along the
        direction that separates the pair at a configuration near by.
        """
        matters = required + _WATCHED
        return near_distances(self._checker, q, self._pairs, matters, known)


@dataclass(frozen=True, eq=False)
class EvaluatedLinks:
    """Watched pairs of a spline, E of them, each at its own instant.

    Attributes:
        problem: The planning problem.
        at: The spline at those instants.
        pairs: Indices of the shapes, shape (E, 2).
        aim: What is aimed at.
        rotation: Of all bodies, shape (E, bodies, 3, 3).
        position: Likewise, shape (E, bodies, 3) [m].
        closest: Where the pairs are closest.
    """

    is_elastic: ClassVar[bool] = True

    problem: PlanningProblem
    at: SampledSpline
    pairs: IntArray
    aim: AimedDistances
    rotation: FloatArray
    position: FloatArray
    closest: ClosestPoints

    @cached_property
    def excess(self) -> FloatArray:
        """By how much pairs are closer than they may be, in units of 5 cm, shape (E,)."""
        return self.aim.strict - self._slack

    def slack(self, duration: float, squared_duration: float) -> FloatArray:
        """Return the slack of all rows, in whatever duration, shape (E,)."""
        return self._slack

    @property
    def row_count(self) -> int:
        """How many rows there are."""
        return len(self.pairs)

    @cached_property
    def _by_joint(self) -> FloatArray:
        """How the use of the distances changes with the joints, shape (E, 1, n)."""
        gradient = self.problem.collision.distance_gradient(
            self.rotation, self.position, self.pairs, self.closest
        )
        by_joint: FloatArray = (self.aim.change - gradient)[:, None] / _UNIT
        return by_joint

    @property
    def _slack(self) -> FloatArray:
        """By how much pairs are farther apart than is aimed at, in units of 5 cm, shape (E,)."""
        slack: FloatArray = (self.closest.distance - self.aim.distance) / _UNIT
        return slack

    def rows(self, duration: float, size: StepSize | None) -> Rows:
        """Return rows that keep the pairs apart, in whatever duration.

        Args:
            duration: T [s].
            size: Of the step; rows that it cannot break are left out. None: all rows.
        """
        limit = np.full(len(self.pairs), NO_LIMIT)
        return plane_rows(self.at, self._by_joint, self._slack[:, None], limit, size)
