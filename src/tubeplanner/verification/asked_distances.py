"""How far apart solids must be at any time of a trajectory, and over intervals of time."""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.problem.required_distances import NearEnd, RequiredDistances
from tubeplanner.trajectory.bernstein import bernstein_coefficients, halves
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.verification.enclosure import Enclosure
from tubeplanner.verification.judged_motion import JudgedMotion
from tubeplanner.verification.tube_visits import Visit, visited_parts

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
