"""Conditions on clearance from obstacles and between links, for all t.

On a time interval the distance of a pair cannot fall below its value at the middle by more than
the joints' travel allows, which Bernstein coefficients bound. Intervals that could hold the minimum
are halved until none remains. A direction that separates a pair does so in the neighbourhood too,
so that most intervals need no exact distance.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.certificate.enclosure import Enclosure
from tubeplanner.certificate.judged_motion import (
    JudgedCondition,
    JudgedMotion,
    bracketed,
    not_required,
)
from tubeplanner.certificate.tube_visits import Visit, visited_parts
from tubeplanner.geometry.collision_checker import CollisionChecker
from tubeplanner.outcome import Location
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.required_distances import NearEnd, RequiredDistances
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.polynomials import bernstein_coefficients, halves

# ---- Links against obstacles and against each other.


def judge_obstacles(motion: JudgedMotion) -> JudgedCondition:
    """Judge links against obstacles, for all t."""
    checker = motion.problem.collision
    columns = np.arange(len(checker.obstacle_pairs))
    return _judge_clearance(motion, columns, "no link can meet an obstacle")


def judge_self_collision(motion: JudgedMotion) -> JudgedCondition:
    """Judge links against links, for all t."""
    checker = motion.problem.collision
    columns = np.arange(len(checker.obstacle_pairs), len(checker.pairs))
    return _judge_clearance(motion, columns, "no pair of links is checked")


def _judge_clearance(
    motion: JudgedMotion, columns: IntArray, not_required_reason: str
) -> JudgedCondition:
    """Judge the least distance of the checker's pairs (P,) beyond the required distance.

    Without pairs, the coverage is `not_required_reason`.
    """
    checker = motion.problem.collision
    required = AskedDistances(motion).over
    nearest = closest_approach(checker, motion.trajectory, columns, required)
    if nearest is None:
        if not checker.has_link_geometry:
            not_required_reason = "the robot has no collision geometry: nothing could be checked"
        return not_required("m", not_required_reason)
    links, obstacle = checker.owners(nearest.pair)
    location = Location(time=nearest.time, links=links, obstacle=obstacle)
    return bracketed(nearest.lower_bound, nearest.margin, "m", location)


class ClearanceMargin:
    """A `SegmentMargin`: least distance of links beyond that required in each segment [m]."""

    def __init__(self, problem: PlanningProblem, trajectory: JointTrajectory) -> None:
        self._problem, self._trajectory = problem, trajectory
        self._required = required_of_motion(problem, trajectory)
        self._most = self._required.by_segment.max(axis=0)

    @property
    def is_constant(self) -> bool:
        """True if all segments require the same distances."""
        return self._required.is_constant

    def at(self, time: FloatArray) -> FloatArray:
        """Return the margins in all segments."""
        tool, distance = self._at(time)
        rows = [(distance - row).min(axis=1, initial=np.inf) for row in self._required.by_segment]
        margin = np.column_stack(rows)[:, self._required.row_of]
        for k in {near.segment for near in self._required.near_ends}:
            margin[:, k] = self._margin(np.full(len(time), k), tool, distance)
        return margin

    def within(self, segment: IntArray, time: FloatArray) -> FloatArray:
        """Return the margins, each in its segment."""
        return self._margin(segment, *self._at(time))

    def _margin(self, segment: IntArray, tool: FloatArray, distance: FloatArray) -> FloatArray:
        margin: FloatArray = (distance - self._required.at(segment, tool)).min(
            axis=1, initial=np.inf
        )
        return margin

    def _at(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions of the tool, (N, 3) [m], and lower bounds on distances, (N, P) [m].

        The bounds are exact where they are below the requirement of some segment.
        """
        checker, q = self._problem.collision, self._trajectory.position(time)
        rotation, position = checker.robot.body_poses(q)
        distance = checker.sphere_distances(rotation, position, checker.pairs)
        row, column = np.nonzero(distance < self._most)
        boxes = checker.box_distances(rotation, position, row, checker.pairs[column])
        near = boxes < self._most[column]
        distance[row, column] = np.maximum(distance[row, column], boxes)
        row, column = row[near], column[near]
        closest = checker.closest_points(rotation, position, checker.pairs[column], row)
        distance[row, column] = closest.distance
        return checker.robot.tool_position(q), distance


def clearance_margin(
    problem: PlanningProblem, trajectory: JointTrajectory
) -> ClearanceMargin | None:
    """Return the margin of links' clearance; None if all segments require the same distances."""
    margin = ClearanceMargin(problem, trajectory)
    return None if margin.is_constant else margin


# ---- Required distances of solids over intervals of time.

# Parts of an interval this short, as a fraction, count as outside if they are not all inside.
_MIN_WIDTH = 2.0**-40
_SAME_TIME = 1e-12  # as a fraction of the duration: parts this near are merged


def required_of_motion(problem: PlanningProblem, trajectory: JointTrajectory) -> RequiredDistances:
    """Return the distances that a problem requires between a trajectory's two ends."""
    ends = trajectory.position(np.array([0.0, trajectory.duration]))
    return RequiredDistances(problem, ends[0], ends[1])


class AskedDistances:
    """The distances that pairs must keep along a trajectory, by the judge's visits."""

    def __init__(self, motion: JudgedMotion) -> None:
        """Take the requirements of a motion and, where these vary, their times."""
        self._required = required_of_motion(motion.problem, motion.trajectory)
        if self._required.is_constant:
            return
        visits = motion.visits
        self._begin = np.array([visit.begin for visit in visits])
        self._end = np.array([visit.end for visit in visits])
        self._segment = np.array([visit.segment for visit in visits])
        self._near: list[tuple[NearEnd, _Times]] = []
        for near in self._required.near_ends:
            there = [visit for visit in visits if visit.segment == near.segment]
            # The distance from a point is convex: over an interval it is nowhere more than at the
            # worst of the Bernstein coefficients.
            parts = _parts_near(motion.tool, there, near)
            self._near.append((near, _merged(parts, motion.trajectory.duration)))

    def over(self, begin: FloatArray, end: FloatArray, pair: IntArray) -> FloatArray:
        """Return the largest required distances of pairs (R,) from times to times (R,), (R,) [m].

        At a switching time, the requirements of both segments count.
        """
        rows = self._required.by_segment
        if self._required.is_constant:
            return rows[0, pair]
        first = np.minimum(np.searchsorted(self._end, begin), len(self._end) - 1)
        last = np.maximum(np.searchsorted(self._begin, end, side="right") - 1, first)
        inside = [(near, _within(times, begin, end)) for near, times in self._near]
        most = np.full(len(pair), -np.inf)
        for step in range(int((last - first).max(initial=0)) + 1):
            segment = self._segment[np.minimum(first + step, last)]
            required = rows[self._required.row_of[segment], pair]
            for near, is_inside in inside:
                less = is_inside & (segment == near.segment) & near.pair[pair]
                required = np.where(less, np.minimum(required, near.distance), required)
            most = np.maximum(most, required)
        return most


@dataclass(frozen=True, eq=False)
class _Times:
    """Disjoint intervals of time in their order: begins and ends, each (I,) [s]."""

    begin: FloatArray
    end: FloatArray


def _within(times: _Times, begin: FloatArray, end: FloatArray) -> BoolArray:
    """Return a mask of intervals, from times (R,) to times (R,), inside any of `times`, (R,)."""
    if len(times.begin) == 0:
        return np.zeros(len(begin), dtype=bool)
    before = np.searchsorted(times.begin, begin, side="right") - 1
    within: BoolArray = (before >= 0) & (end <= times.end[np.maximum(before, 0)])
    return within


def _parts_near(tool: Enclosure, visits: list[Visit], near: NearEnd) -> FloatArray:
    """Return intervals of time inside the distance of an end, in any order, shape (I, 2) [s]."""
    parts = [np.empty((0, 2))]
    interval, start, width, _ = visited_parts(tool, visits)
    while len(interval):
        hull = bernstein_coefficients(tool.coefficients[:, interval], start, width)
        error = tool.error[interval, 0]
        inside = np.linalg.norm(hull - near.tool, axis=2).max(axis=0) + error <= near.within
        middle = hull.mean(axis=0)
        spread = np.linalg.norm(hull - middle, axis=2).max(axis=0)
        outside = np.linalg.norm(middle - near.tool, axis=1) - spread - error > near.within
        fractions = np.column_stack([start, start + width])[inside]
        whole = tool.start[interval[inside], None], tool.width[interval[inside], None]
        parts.append(whole[0] + whole[1] * fractions)
        # Halves of parts whose spread is below the tool's error would decide no more.
        split = ~inside & ~outside & (width > _MIN_WIDTH) & (spread > error)
        interval = np.repeat(interval[split], 2)
        start, width = halves(start[split], width[split])
    return np.concatenate(parts)


def _merged(parts: FloatArray, duration: float) -> _Times:
    """Return intervals (I, 2) in order, with adjacent intervals merged."""
    parts = parts[np.argsort(parts[:, 0])]
    gap = parts[1:, 0] - parts[:-1, 1] > _SAME_TIME * duration
    first = np.concatenate([[True], gap])[: len(parts)]
    last = np.concatenate([gap, [True]])[-len(parts) or len(gap) + 1 :]
    return _Times(parts[first, 0], parts[last, 1])


# ---- The least distance of shapes beyond the required distance, for all t.

# The least margin is bracketed to this fraction of itself, or to this length [m] near zero.
_RELATIVE_RESOLUTION = 0.02
_RESOLUTION = 5e-7
# Intervals this short [s] are not halved: their bounds count.
_MIN_INTERVAL = 1e-7
# After this many intervals, or this multiple of the first ones, none is halved: far beyond the need
# of any sensible trajectory. Their bounds count, so that the answer stays safe.
_MAX_INTERVALS = 3_000_000
_MAX_ROUNDS = 8
_BATCH = 64  # distances evaluated before intervals are judged anew
# Required distances of pairs over intervals of time: from begins, ends and pairs to distances.
RequiredOver: TypeAlias = Callable[[FloatArray, FloatArray, IntArray], FloatArray]


@dataclass(frozen=True)
class ClosestApproach:
    """The closest approach of a set of pairs."""

    lower_bound: float  # bound on all distances beyond the required ones, at any time [m]
    margin: float  # least distance beyond the required one that was found [m]
    time: float  # time of that distance [s]
    pair: tuple[int, int]  # indices of the two shapes
    intervals: int  # number of tested intervals, each of a pair


def closest_approach(
    checker: CollisionChecker,
    trajectory: JointTrajectory,
    columns: IntArray,
    required: RequiredOver,
) -> ClosestApproach | None:
    """Return the closest approach of some pairs along a trajectory.

    Args:
        checker: The geometry.
        trajectory: In the group order of the checker's robot.
        columns: Indices of the checker's pairs, shape (P,).
        required: Largest required distance of pairs (R,) over intervals of time, from begins (R,)
            to ends (R,) [m]; the nearer distances come to it, the finer the resolution.

    Returns:
        The closest approach, or None if there are no pairs.
    """
    if len(columns) == 0:
        return None
    search = _Search(checker, trajectory, columns, required)
    search.halve_until_settled()
    first, second = (int(index) for index in checker.pairs[columns[search.pair]])
    return ClosestApproach(
        min(search.lower_bound, search.margin),
        search.margin,
        search.time,
        (first, second),
        search.intervals,
    )


@dataclass(frozen=True, eq=False)
class _Rows:
    """Pairs on undecided intervals, all halved equally often."""

    node: IntArray  # interval, as piece * 2^level + number within the piece, shape (R,)
    pair: IntArray  # index of the pair, shape (R,)
    direction: FloatArray  # the last direction that separated the pair, shape (R, 3)
    level: int  # number of halvings of the pieces

    def halves(self, split: BoolArray) -> "_Rows":
        """Return both halves of some rows."""
        node = np.repeat(2 * self.node[split], 2)
        node[1::2] += 1
        direction = np.repeat(self.direction[split], 2, axis=0)
        return _Rows(node, np.repeat(self.pair[split], 2), direction, self.level + 1)


class _Search:
    """The least distance beyond the required one so far, and a bound on all decided intervals."""

    def __init__(
        self,
        checker: CollisionChecker,
        trajectory: JointTrajectory,
        columns: IntArray,
        required: RequiredOver,
    ) -> None:
        self._checker, self._trajectory = checker, trajectory
        self._columns, self._pairs, self._required = columns, checker.pairs[columns], required
        self._weights = checker.motion_weights(self._pairs)
        self.margin, self.time, self.pair = np.inf, 0.0, 0
        self.lower_bound = np.inf
        self.intervals = 0

    def halve_until_settled(self) -> None:
        """Bound every pair on every piece; halve intervals that may hold the minimum; repeat."""
        # All pairs on all pieces, with separating directions at the start.
        rotation, position = self._checker.robot.body_poses(self._trajectory.position(np.zeros(1)))
        distance, direction = self._checker.separations(rotation[0], position[0], self._pairs)
        count, pieces = len(self._pairs), len(self._trajectory.widths)
        pair = np.tile(np.arange(count), pieces)
        self._remember(distance, np.zeros(count), np.arange(count))
        rows = _Rows(np.repeat(np.arange(pieces), count), pair, direction[pair], 0)
        most = max(_MAX_INTERVALS, _MAX_ROUNDS * len(rows.node))
        while len(rows.node):
            self.intervals += len(rows.node)
            lower, direction = self._lower_bounds(rows)
            width = self._trajectory.widths[rows.node >> rows.level] / 2**rows.level
            undecided = lower < self._settled_above()
            final = undecided & ((width < _MIN_INTERVAL) | (self.intervals > most))
            settled = lower[~undecided | final]
            self.lower_bound = min(self.lower_bound, float(settled.min(initial=np.inf)))
            rows = replace(rows, direction=direction).halves(undecided & ~final)

    def _settled_above(self) -> float:
        """Return the lower bound above which an interval cannot change the answer [m]."""
        return self.margin - max(_RESOLUTION, _RELATIVE_RESOLUTION * abs(self.margin))

    def _lower_bounds(self, rows: _Rows) -> tuple[FloatArray, FloatArray]:
        """Return lower bounds of the rows' margins [m], (R,), and separating directions, (R, 3).

        A margin is a distance less the required distance. From bounding spheres; where these do not
        decide, along the known directions; else exactly, with new directions.
        """
        nodes, interval = np.unique(rows.node, return_inverse=True)
        piece = nodes >> rows.level
        width = self._trajectory.widths[piece] / 2**rows.level
        start = (nodes - (piece << rows.level)) * width
        hull = bernstein_coefficients(self._trajectory.coefficients[:, piece], start, width)
        time = self._trajectory.breakpoints[piece] + start + width / 2
        middle = self._trajectory.position(time)
        travel, half = abs(hull - middle).max(axis=0), width / 2
        begin, end = (time - half)[interval], (time + half)[interval]
        required = self._required(begin, end, self._columns[rows.pair])
        rotation, position = self._checker.robot.body_poses(middle)
        travelled = np.einsum("rn,rn->r", self._weights[rows.pair], travel[interval])
        spheres = self._checker.sphere_distances(rotation, position, self._pairs)
        less = travelled + required
        lower = spheres[interval, rows.pair] - less
        near = np.flatnonzero(lower < self._settled_above())
        bound = self._checker.separations_along(
            rotation, position, self._pairs[rows.pair[near]], rows.direction[near], interval[near]
        )
        lower[near] = np.maximum(lower[near], bound - less[near])
        direction = rows.direction.copy()
        order = near[np.argsort(lower[near], kind="stable")]
        for first in range(0, len(order), _BATCH):
            batch = order[first : first + _BATCH]
            batch = batch[lower[batch] < self._settled_above()]
            if len(batch) == 0:
                break
            at = interval[batch]
            distance, direction[batch] = self._checker.separations_at(
                rotation, position, self._pairs[rows.pair[batch]], at
            )
            self._remember(distance, time[at], rows.pair[batch])
            lower[batch] = np.maximum(lower[batch], distance - less[batch])
        return lower, direction

    def _remember(self, distance: FloatArray, time: FloatArray, pair: IntArray) -> None:
        margin = distance - self._required(time, time, self._columns[pair])
        least = int(margin.argmin())
        if margin[least] < self.margin:
            self.margin = float(margin[least])
            self.time, self.pair = float(time[least]), int(pair[least])
