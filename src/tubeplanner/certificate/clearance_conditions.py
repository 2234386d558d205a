"""Conditions on clearance from obstacles and between links, for all t.

On a time interval the distance of a pair cannot fall below its value at the middle by more than
the joints' travel allows. Intervals that could still hold the minimum are halved until none is
left. The joints' travel is bounded by Bernstein coefficients. A direction that separates a pair
does so in the neighbourhood too, so that most intervals need no exact distance.
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
from tubeplanner.outcome import Place
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.required_distances import NearEnd, RequiredDistances
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.polynomials import bernstein_coefficients, halves

# ---- The least distance of shapes beyond what is asked, for all t and not only at samples.

# The least margin is bracketed to this share of itself, or to this length [m] where it is next to
# nothing.
_RELATIVE_RESOLUTION = 0.02
_RESOLUTION = 5e-7
# Intervals this short [s] are not halved: their bound counts as it stands.
_MIN_INTERVAL = 1e-7
# After so many intervals, or so many times those it starts with, no more are halved: far beyond
# what any sensible trajectory needs. Their bounds count as they stand, so that the answer stays
# safe.
_MAX_INTERVALS = 3_000_000
_MAX_ROUNDS = 8
_BATCH = 64  # distances evaluated before intervals are judged anew

# What is asked of pairs over intervals of time: from begins, ends and pairs to distances.
AskedOver: TypeAlias = Callable[[FloatArray, FloatArray, IntArray], FloatArray]


@dataclass(frozen=True)
class ClosestApproach:
    """Where a set of pairs comes nearest.

    Attributes:
        lower_bound: No distance beyond what is asked falls below it at any time [m].
        margin: The least distance beyond what is asked that was found [m].
        time: When [s].
        pair: Indices of the two shapes.
        intervals: How many pairs and intervals were tested.
    """

    lower_bound: float
    margin: float
    time: float
    pair: tuple[int, int]
    intervals: int


def closest_approach(
    checker: CollisionChecker,
    trajectory: JointTrajectory,
    columns: IntArray,
    asked: AskedOver,
) -> ClosestApproach | None:
    """Return the closest approach of some pairs along a trajectory.

    Args:
        checker: The geometry.
        trajectory: In the group order of the checker's robot.
        columns: Which of the checker's pairs, shape (P,).
        asked: The most that is asked of pairs (R,) over intervals of time, from begins (R,) to ends
            (R,) [m]; the nearer distances come to it, the finer they are resolved.

    Returns:
        The closest approach, or None if there are no pairs.
    """
    if len(columns) == 0:
        return None
    search = _Search(checker, trajectory, columns, asked)
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
    """Pairs on intervals that are still in question, all halved equally often.

    Attributes:
        node: Which interval, as piece * 2^level + number within the piece, shape (R,).
        pair: Which pair, shape (R,).
        direction: Along which the pair was last found apart, shape (R, 3).
        level: How often the pieces have been halved.
    """

    node: IntArray
    pair: IntArray
    direction: FloatArray
    level: int

    def halves(self, split: BoolArray) -> "_Rows":
        """Return both halves of some rows."""
        node = np.repeat(2 * self.node[split], 2)
        node[1::2] += 1
        direction = np.repeat(self.direction[split], 2, axis=0)
        return _Rows(node, np.repeat(self.pair[split], 2), direction, self.level + 1)


class _Search:
    """The intervals still in question, and the least distance beyond what is asked yet."""

    def __init__(
        self,
        checker: CollisionChecker,
        trajectory: JointTrajectory,
        columns: IntArray,
        asked: AskedOver,
    ) -> None:
        self._checker, self._trajectory = checker, trajectory
        self._columns, self._pairs, self._asked = columns, checker.pairs[columns], asked
        self._weights = checker.motion_weights(self._pairs)
        self.margin, self.time, self.pair = np.inf, 0.0, 0
        self.lower_bound = np.inf
        self.intervals = 0

    def halve_until_settled(self) -> None:
        """Bound every pair on every piece, halve what may hold the minimum, and repeat."""
        rows = self._beginning()
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

    def _beginning(self) -> _Rows:
        """Return all pairs on all pieces, with the directions that separate them at the start."""
        rotation, position = self._checker.robot.body_poses(self._trajectory.position(np.zeros(1)))
        distance, direction = self._checker.separations(rotation[0], position[0], self._pairs)
        count, pieces = len(self._pairs), len(self._trajectory.widths)
        pair = np.tile(np.arange(count), pieces)
        self._remember(distance, np.zeros(count), np.arange(count))
        return _Rows(np.repeat(np.arange(pieces), count), pair, direction[pair], 0)

    def _settled_above(self) -> float:
        """Return the lower bound above which an interval cannot change the answer [m]."""
        return self.margin - max(_RESOLUTION, _RELATIVE_RESOLUTION * abs(self.margin))

    def _lower_bounds(self, rows: _Rows) -> tuple[FloatArray, FloatArray]:
        """Return lower bounds of the rows' margins [m], (R,), and separating directions, (R, 3).

        A margin is a distance less what is asked. From bounding spheres; where these do not settle
        it, along the known directions; where neither does, exactly, with new directions.
        """
        nodes, interval = np.unique(rows.node, return_inverse=True)
        middle, travel, time, half = self._middles(nodes, rows.level)
        begin, end = (time - half)[interval], (time + half)[interval]
        asked = self._asked(begin, end, self._columns[rows.pair])
        rotation, position = self._checker.robot.body_poses(middle)
        travelled = np.einsum("rn,rn->r", self._weights[rows.pair], travel[interval])
        spheres = self._checker.sphere_distances(rotation, position, self._pairs)
        less = travelled + asked
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

    def _middles(self, node: IntArray, level: int) -> tuple[FloatArray, ...]:
        """Return mid-interval configurations, the farthest joints get from them, times, halves."""
        piece = node >> level
        width = self._trajectory.widths[piece] / 2**level
        start = (node - (piece << level)) * width
        hull = bernstein_coefficients(self._trajectory.coefficients[:, piece], start, width)
        time = self._trajectory.breakpoints[piece] + start + width / 2
        middle = self._trajectory.position(time)
        return middle, abs(hull - middle).max(axis=0), time, width / 2

    def _remember(self, distance: FloatArray, time: FloatArray, pair: IntArray) -> None:
        margin = distance - self._asked(time, time, self._columns[pair])
        least = int(margin.argmin())
        if margin[least] < self.margin:
            self.margin = float(margin[least])
            self.time, self.pair = float(time[least]), int(pair[least])


# ---- How far apart solids must be at any time of a trajectory, and over intervals of time.

# Parts of an interval this short, as a share of it, count as outside if they are not all inside.
_MIN_WIDTH = 2.0**-40
_SAME_TIME = 1e-12  # as a share of the duration: parts this near are one


def asked_of_motion(problem: PlanningProblem, trajectory: JointTrajectory) -> RequiredDistances:
    """Return what a problem requires of a trajectory, which begins and ends where it does."""
    ends = trajectory.position(np.array([0.0, trajectory.duration]))
    return RequiredDistances(problem, ends[0], ends[1])


class AskedDistances:
    """The distances that pairs must keep along a trajectory, at the judge's hand-overs."""

    def __init__(self, motion: JudgedMotion) -> None:
        """Take what is asked of a motion; where it is not the same throughout, when what is."""
        self._asked = asked_of_motion(motion.problem, motion.trajectory)
        if self._asked.is_constant:
            return
        visits = motion.visits
        self._begin = np.array([visit.begin for visit in visits])
        self._end = np.array([visit.end for visit in visits])
        self._segment = np.array([visit.segment for visit in visits])
        self._near = [(near, _times_near(motion, near)) for near in self._asked.near_ends]

    def over(self, begin: FloatArray, end: FloatArray, pair: IntArray) -> FloatArray:
        """Return the most that is asked of pairs (R,) from some times to others (R,), (R,) [m].

        At a hand-over, what both segments ask.
        """
        rows = self._asked.by_segment
        if self._asked.is_constant:
            return rows[0, pair]
        first = np.minimum(np.searchsorted(self._end, begin), len(self._end) - 1)
        last = np.maximum(np.searchsorted(self._begin, end, side="right") - 1, first)
        inside = [(near, _within(times, begin, end)) for near, times in self._near]
        most = np.full(len(pair), -np.inf)
        for step in range(int((last - first).max(initial=0)) + 1):
            segment = self._segment[np.minimum(first + step, last)]
            asked = rows[self._asked.row_of[segment], pair]
            for near, is_inside in inside:
                less = is_inside & (segment == near.segment) & near.pair[pair]
                asked = np.where(less, np.minimum(asked, near.distance), asked)
            most = np.maximum(most, asked)
        return most


@dataclass(frozen=True, eq=False)
class _Times:
    """Disjoint intervals of time in their order: begins and ends, each (I,) [s]."""

    begin: FloatArray
    end: FloatArray


def _within(times: _Times, begin: FloatArray, end: FloatArray) -> BoolArray:
    """Return which intervals, from times (R,) to times (R,), lie in one of those, shape (R,)."""
    if len(times.begin) == 0:
        return np.zeros(len(begin), dtype=bool)
    before = np.searchsorted(times.begin, begin, side="right") - 1
    within: BoolArray = (before >= 0) & (end <= times.end[np.maximum(before, 0)])
    return within


def _times_near(motion: JudgedMotion, near: NearEnd) -> _Times:
    """Return when the tool is surely within the distance of an end, in that end's segment.

    The distance from a point is convex: over an interval it is nowhere more than at the worst of
    the Bernstein coefficients.
    """
    visits = [visit for visit in motion.visits if visit.segment == near.segment]
    return _merged(_parts_near(motion.tool, visits, near), motion.trajectory.duration)


def _parts_near(tool: Enclosure, visits: list[Visit], near: NearEnd) -> FloatArray:
    """Return intervals of time that lie within, in any order, shape (I, 2) [s]."""
    found = [np.empty((0, 2))]
    interval, start, width, _ = visited_parts(tool, visits)
    while len(interval):
        hull = bernstein_coefficients(tool.coefficients[:, interval], start, width)
        error = tool.error[interval, 0]
        inside = np.linalg.norm(hull - near.tool, axis=2).max(axis=0) + error <= near.within
        middle = hull.mean(axis=0)
        spread = np.linalg.norm(hull - middle, axis=2).max(axis=0)
        outside = np.linalg.norm(middle - near.tool, axis=1) - spread - error > near.within
        shares = np.column_stack([start, start + width])[inside]
        whole = tool.start[interval[inside], None], tool.width[interval[inside], None]
        found.append(whole[0] + whole[1] * shares)
        # Halves of what spreads less than is known of the tool would tell no more.
        split = ~inside & ~outside & (width > _MIN_WIDTH) & (spread > error)
        interval = np.repeat(interval[split], 2)
        start, width = halves(start[split], width[split])
    return np.concatenate(found)


def _merged(parts: FloatArray, duration: float) -> _Times:
    """Return intervals (I, 2) in order, those that follow on each other as one."""
    parts = parts[np.argsort(parts[:, 0])]
    gap = parts[1:, 0] - parts[:-1, 1] > _SAME_TIME * duration
    first = np.concatenate([[True], gap])[: len(parts)]
    last = np.concatenate([gap, [True]])[-len(parts) or len(gap) + 1 :]
    return _Times(parts[first, 0], parts[last, 1])


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


def _judge_clearance(motion: JudgedMotion, columns: IntArray, not_asked: str) -> JudgedCondition:
    """Judge the least distance of pairs of solids beyond what is asked.

    Args:
        motion: What is judged.
        columns: Which of the checker's pairs, shape (P,).
        not_asked: What is said if there is no pair.
    """
    checker = motion.problem.collision
    asked = AskedDistances(motion).over
    nearest = closest_approach(checker, motion.trajectory, columns, asked)
    if nearest is None:
        if not checker.has_link_geometry:
            not_asked = "the robot has no collision geometry: nothing could be checked"
        return not_required("m", not_asked)
    links, obstacle = checker.owners(nearest.pair)
    place = Place(time=nearest.time, links=links, obstacle=obstacle)
    return bracketed(nearest.lower_bound, nearest.margin, "m", place)


class ClearanceMargin:
    """A `SegmentMargin`: how far links are apart beyond what each segment asks [m]."""

    def __init__(self, problem: PlanningProblem, trajectory: JointTrajectory) -> None:
        self._problem, self._trajectory = problem, trajectory
        self._asked = asked_of_motion(problem, trajectory)
        self._most = self._asked.by_segment.max(axis=0)

    @property
    def is_constant(self) -> bool:
        """Whether all segments ask the same."""
        return self._asked.is_constant

    def at(self, time: FloatArray) -> FloatArray:
        """Return what is left in all segments."""
        tool, distance = self._at(time)
        rows = [(distance - row).min(axis=1, initial=np.inf) for row in self._asked.by_segment]
        left = np.column_stack(rows)[:, self._asked.row_of]
        for k in {near.segment for near in self._asked.near_ends}:
            left[:, k] = self._left(np.full(len(time), k), tool, distance)
        return left

    def within(self, segment: IntArray, time: FloatArray) -> FloatArray:
        """Return what is left in one segment each."""
        return self._left(segment, *self._at(time))

    def _left(self, segment: IntArray, tool: FloatArray, distance: FloatArray) -> FloatArray:
        left: FloatArray = (distance - self._asked.at(segment, tool)).min(axis=1, initial=np.inf)
        return left

    def _at(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return where the tool is, (N, 3), and lower bounds on distances, (N, P) [m].

        These are exact where they are less than some segment asks: more does not matter.
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
    """Return the margin of links' clearance; None where all segments ask the same."""
    margin = ClearanceMargin(problem, trajectory)
    return None if margin.is_constant else margin
