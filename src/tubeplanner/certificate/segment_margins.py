"""Margins of each segment at any t; best switching samples between segments.

Segments are visited in order, and at a switching time the tool is in both capsules. The switching
times are those with the largest worst margin. A point that must be passed is passed while either of
the two segments that meet there is current.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple, Protocol, TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.certificate.enclosure import Enclosure
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

# ---- Margins of a trajectory in each segment of a tube, at any instant.
#
# The judge chooses switching times by these margins: where a segment becomes current, all of its
# conditions must hold. Each margin has the unit of its condition: m, rad or relative.


class SegmentMargin(Protocol):
    """A condition of a tube's segments on a trajectory."""

    def at(self, time: FloatArray) -> FloatArray:
        """Return the margins at times (N,) [s] in all segments, shape (N, m)."""
        ...

    def within(self, segment: IntArray, time: FloatArray) -> FloatArray:
        """Return the margins at times (N,) [s], each in its segment (N,): shape (N,)."""
        ...


class ToolMargin:
    """The tool in the regions about the segments [m]."""

    def __init__(self, problem: PlanningProblem, tool: Enclosure) -> None:
        self._tube, self._tool = problem.tube, tool

    def at(self, time: FloatArray) -> FloatArray:
        """Return the margins inside all regions [m]."""
        return self._tube.margin(self._tool.at(time))

    def within(self, segment: IntArray, time: FloatArray) -> FloatArray:
        """Return the margins [m], each inside its region."""
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
        """Return the margins of the worst joint in the ranges of all segments."""
        q = self._trajectory.position(time)
        margin = np.minimum(q[:, None] - self._lower, self._upper - q[:, None]).min(axis=2)
        return margin[:, self._range_of]

    def within(self, segment: IntArray, time: FloatArray) -> FloatArray:
        """Return the margins of the worst joint, each in the ranges of its segment."""
        q, row = self._trajectory.position(time), self._range_of[segment]
        margin: FloatArray = np.minimum(q - self._lower[row], self._upper[row] - q).min(axis=1)
        return margin


class RotationMargin:
    """The tool's orientation within the tolerances [rad]."""

    def __init__(self, problem: PlanningProblem, tool: Enclosure, rotation: Enclosure) -> None:
        self._tube, self._tool, self._rotation = problem.tube, tool, rotation

    def at(self, time: FloatArray) -> FloatArray:
        """Return the margins inside the tolerances of all segments [rad]."""
        rotation = self._rotation.at(time).reshape(-1, 3, 3)
        return self._tube.rotation_margin(rotation, self._tool.at(time))

    def within(self, segment: IntArray, time: FloatArray) -> FloatArray:
        """Return the margins [rad], each inside the tolerance of its segment."""
        rotation = self._rotation.at(time).reshape(-1, 3, 3)
        if self._tube.rotation is None:
            return np.full(len(time), np.inf)
        return self._tube.rotation.margin(rotation, self._tool.at(time), segment)


# Makes the margin of a further condition; returns None where the problem has no such condition.
MarginMaker: TypeAlias = Callable[[PlanningProblem, JointTrajectory], SegmentMargin | None]


def segment_margins(
    problem: PlanningProblem,
    trajectory: JointTrajectory,
    tool: Enclosure,
    rotation: Enclosure | None,
    further: tuple[MarginMaker, ...],
) -> tuple[SegmentMargin, ...]:
    """Return the margins of all conditions of a problem's segments on a trajectory.

    Of its tool's path and rotation matrix (None: the tube leaves it free), and further conditions.
    """
    margins: list[SegmentMargin] = [ToolMargin(problem, tool)]
    margins.append(JointRangeMargin(problem, trajectory))
    if rotation is not None:
        margins.append(RotationMargin(problem, tool, rotation))
    others = (make(problem, trajectory) for make in further)
    return (*margins, *(margin for margin in others if margin is not None))


# ---- Switching samples from each tube segment to the next.


class _State(NamedTuple):
    """The current segment, with the points at its ends passed or not."""

    segment: int
    first_passed: bool
    last_passed: bool


def best_switching_samples(
    margin: FloatArray,
    passing: Mapping[int, FloatArray] | None = None,
    gates: Mapping[int, FloatArray] | None = None,
) -> IntArray:
    """Return the samples at which an ordered visit passes on.

    Args:
        margin: Margins of N samples, in the order of time, in m segments, shape (N, m).
        passing: Margins of the samples at points that must be passed in a segment beside, shape
            (N,), by index of the inner point.
        gates: Margins of the samples at which a segment may be entered, (N,), by its index; none:
            it may be anywhere.

    Returns:
        Shape (m-1,), never decreasing: sample s belongs to segment k if it lies between the
        switching times k-1 and k, both included, so that a switching time counts in both its
        segments.
    """
    passing, gates = passing or {}, gates or {}
    best = _best_margins(margin, passing, gates)
    state, last = next(reversed(best)), len(margin) - 1
    switching_samples: list[int] = []
    while sources := _sources(state, passing, gates, len(margin)):
        candidates = []
        for source, gate in sources:
            here = np.minimum(margin[:, source.segment], gate)
            entered = np.minimum(best[source], gate)
            sample = _switch_before(entered, here, margin[:, state.segment], last)
            rest = margin[sample : last + 1, state.segment].min()
            candidates.append((min(entered[sample], rest), sample, source))
        _, sample, source = max(candidates, key=lambda entry: entry[0])
        if source.segment < state.segment:
            switching_samples.insert(0, sample)
        state, last = source, sample
    return np.array(switching_samples, dtype=np.int64)


def _best_margins(
    margin: FloatArray, passing: Mapping[int, FloatArray], gates: Mapping[int, FloatArray]
) -> dict[_State, FloatArray]:
    """Return the largest worst margin with which each sample can be in each state, (N,) each.

    A state comes after its sources; the last state is that at the end.
    """
    count = margin.shape[1]
    best: dict[_State, FloatArray] = {}
    for k in range(count):
        for first in (False, True) if k in passing else (True,):
            for last in (False, True) if k + 1 in passing else (True,):
                state = _State(k, first, last)
                sources = _sources(state, passing, gates, len(margin))
                entered = [np.minimum(best[source], gate) for source, gate in sources]
                if not entered:  # the state at the begin
                    entered = [np.where(np.arange(len(margin)) == 0, np.inf, -np.inf)]
                before = np.max(entered, axis=0)
                best[state] = _best_after_switch(before, margin[:, k])
    return best


def _sources(
    state: _State,
    passing: Mapping[int, FloatArray],
    gates: Mapping[int, FloatArray],
    count: int,
) -> list[tuple[_State, FloatArray]]:
    """Return the states before a state, with the margins (N,) of the passage from each to it."""
    k, first_passed, last_passed = state
    free = np.full(count, np.inf)
    sources = []
    if k > 0 and last_passed is (k + 1 not in passing):  # just entered, nothing is passed ahead
        sources.append((_State(k - 1, True, first_passed), gates.get(k, free)))
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
