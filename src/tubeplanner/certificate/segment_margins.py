"""Margins of each segment at any t; best switching samples between segments.

Segments are visited in order, and at a switching time the tool is in both capsules. Of all choices
of switching times, it takes the one with the largest worst margin. A point that must be passed is
passed while one of the two segments that meet there is the current one.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple, Protocol, TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.certificate.enclosure import Enclosure
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

# ---- When a trajectory passes from one tube segment to the next.


class _State(NamedTuple):
    """In which segment a trajectory is, and whether it has passed the points at its ends."""

    segment: int
    first_passed: bool
    last_passed: bool


def best_switching_samples(
    margin: FloatArray, passing: Mapping[int, FloatArray] | None = None
) -> IntArray:
    """Return the samples at which an ordered visit passes on.

    Args:
        margin: How well each of N samples fits each of m segments, shape (N, m), samples in the
            order of time.
        passing: For points that must be passed in one of the segments beside them, inner ones by
            index: how well each sample does, shape (N,).

    Returns:
        Shape (m-1,), never decreasing: sample s belongs to segment k if it lies between the
        switching times k-1 and k, both included, so that a switching time counts in both its
        segments.
    """
    passing = passing or {}
    best = _best_margins(margin, passing)
    state, last = next(reversed(best)), len(margin) - 1
    switching_samples: list[int] = []
    while sources := _sources(state, passing, len(margin)):
        found = []
        for source, gate in sources:
            here = np.minimum(margin[:, source.segment], gate)
            entered = np.minimum(best[source], gate)
            sample = _switch_before(entered, here, margin[:, state.segment], last)
            rest = margin[sample : last + 1, state.segment].min()
            found.append((min(entered[sample], rest), sample, source))
        _, sample, source = max(found, key=lambda entry: entry[0])
        if source.segment < state.segment:
            switching_samples.insert(0, sample)
        state, last = source, sample
    return np.array(switching_samples, dtype=np.int64)


def _best_margins(
    margin: FloatArray, passing: Mapping[int, FloatArray]
) -> dict[_State, FloatArray]:
    """Return the largest worst margin with which each sample can be in each state, (N,) each.

    A state comes after its sources; the last one is the one to end in.
    """
    count = margin.shape[1]
    best: dict[_State, FloatArray] = {}
    for k in range(count):
        for first in (False, True) if k in passing else (True,):
            for last in (False, True) if k + 1 in passing else (True,):
                state = _State(k, first, last)
                sources = _sources(state, passing, len(margin))
                entered = [np.minimum(best[source], gate) for source, gate in sources]
                if not entered:  # where it begins
                    entered = [np.where(np.arange(len(margin)) == 0, np.inf, -np.inf)]
                before = np.max(entered, axis=0)
                best[state] = _best_after_switch(before, margin[:, k])
    return best


def _sources(
    state: _State, passing: Mapping[int, FloatArray], count: int
) -> list[tuple[_State, FloatArray]]:
    """Return from which states one is entered, and how well N samples pass what lies between."""
    k, first_passed, last_passed = state
    free = np.full(count, np.inf)
    sources = []
    if k > 0 and last_passed is (k + 1 not in passing):  # just entered, nothing is passed ahead
        sources.append((_State(k - 1, True, first_passed), free))
    if k in passing and first_passed:
        sources.append((_State(k, False, last_passed), passing[k]))
    if k + 1 in passing and last_passed:
        sources.append((_State(k, first_passed, False), passing[k + 1]))
    return sources


def _best_after_switch(before: FloatArray, margin: FloatArray) -> FloatArray:
    """Return the largest worst margin of being in a segment at each sample, shape (N,).

    The recursion `best[i] = min(margin[i], max(best[i-1], before[i]))` is a chain of clips; clips
    compose to clips, so that the chain is a prefix scan in log2(N) steps.
    """
    low, high = np.minimum(before, margin), margin.copy()
    shift = 1
    while shift < len(margin):
        earlier_low, earlier_high = low[:-shift].copy(), high[:-shift].copy()
        later_low, later_high = low[shift:].copy(), high[shift:].copy()
        low[shift:] = np.clip(earlier_low, later_low, later_high)
        high[shift:] = np.clip(earlier_high, later_low, later_high)
        shift *= 2
    return low


def _switch_before(
    best_before: FloatArray, margin_before: FloatArray, margin_after: FloatArray, last: int
) -> int:
    """Return the best sample for a switching time, not after the sample `last`."""
    rest = np.minimum.accumulate(margin_after[last::-1])[::-1]
    worst = np.minimum(best_before[: last + 1], rest)
    candidates = np.flatnonzero(worst >= worst.max())
    local = np.minimum(margin_before[candidates], margin_after[candidates])
    return int(candidates[local.argmax()])


# ---- How well a trajectory keeps what each segment of a tube asks, at any instant.
#
# The judge chooses switching times by these margins: where a segment becomes the current one, all
# that it asks must hold. They are in m, rad or relative, whatever each condition is measured in.


class SegmentMargin(Protocol):
    """One condition of a tube's segments on a trajectory."""

    def at(self, time: FloatArray) -> FloatArray:
        """Return the margins at times (N,) [s] in all segments, shape (N, m)."""
        ...

    def within(self, segment: IntArray, time: FloatArray) -> FloatArray:
        """Return the margins at times (N,) [s], each in one segment (N,): shape (N,)."""
        ...


class ToolMargin:
    """The tool in the regions about the segments [m]."""

    def __init__(self, problem: PlanningProblem, tool: Enclosure) -> None:
        self._tube, self._tool = problem.tube, tool

    def at(self, time: FloatArray) -> FloatArray:
        """Return how far inside all regions the tool is."""
        return self._tube.margin(self._tool.at(time))

    def within(self, segment: IntArray, time: FloatArray) -> FloatArray:
        """Return how far inside one region each the tool is."""
        return self._tube.regions.margin(self._tool.at(time), segment)


class JointRangeMargin:
    """The joints in their ranges [rad or m]."""

    def __init__(self, problem: PlanningProblem, trajectory: JointTrajectory) -> None:
        self._trajectory = trajectory
        ranges = np.hstack(problem.tube.ranges_of(problem.robot.joint_names))
        distinct, which = np.unique(ranges, axis=0, return_inverse=True)
        self._lower, self._upper = np.hsplit(distinct, 2)
        self._range_of = which.ravel()

    def at(self, time: FloatArray) -> FloatArray:
        """Return how far inside the ranges of all segments the worst joint is."""
        q = self._trajectory.position(time)
        margin = np.minimum(q[:, None] - self._lower, self._upper - q[:, None]).min(axis=2)
        return margin[:, self._range_of]

    def within(self, segment: IntArray, time: FloatArray) -> FloatArray:
        """Return how far inside those of one segment each the worst joint is."""
        q, given = self._trajectory.position(time), self._range_of[segment]
        margin: FloatArray = np.minimum(q - self._lower[given], self._upper[given] - q).min(axis=1)
        return margin


class RotationMargin:
    """The tool's orientation within the tolerances [rad]."""

    def __init__(self, problem: PlanningProblem, tool: Enclosure, rotation: Enclosure) -> None:
        self._tube, self._tool, self._rotation = problem.tube, tool, rotation

    def at(self, time: FloatArray) -> FloatArray:
        """Return how far inside the tolerances of all segments the tool is turned."""
        rotation = self._rotation.at(time).reshape(-1, 3, 3)
        return self._tube.rotation_margin(rotation, self._tool.at(time))

    def within(self, segment: IntArray, time: FloatArray) -> FloatArray:
        """Return how far inside that of one segment each the tool is turned."""
        rotation = self._rotation.at(time).reshape(-1, 3, 3)
        if self._tube.rotation is None:
            return np.full(len(time), np.inf)
        return self._tube.rotation.margin(rotation, self._tool.at(time), segment)


# What makes the margin of a further condition; None where the problem does not ask it.
MarginMaker: TypeAlias = Callable[[PlanningProblem, JointTrajectory], SegmentMargin | None]


def segment_margins(
    problem: PlanningProblem,
    trajectory: JointTrajectory,
    tool: Enclosure,
    rotation: Enclosure | None,
    further: tuple[MarginMaker, ...],
) -> tuple[SegmentMargin, ...]:
    """Return what a problem asks of a trajectory segment by segment.

    Args:
        problem: The planning problem.
        trajectory: The trajectory.
        tool: Its tool's position.
        rotation: Its tool's rotation matrix; None: the tube leaves it free.
        further: What makes the margins of further conditions.
    """
    found: list[SegmentMargin] = [ToolMargin(problem, tool)]
    found.append(JointRangeMargin(problem, trajectory))
    if rotation is not None:
        found.append(RotationMargin(problem, tool, rotation))
    made = (make(problem, trajectory) for make in further)
    return (*found, *(margin for margin in made if margin is not None))
