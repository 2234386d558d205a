"""Visits: current segment and margin, for all t."""

from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.certificate.enclosure import Enclosure
from tubeplanner.certificate.segment_margins import (
    MarginMaker,
    best_switching_samples,
    segment_margins,
)
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.polynomials import bernstein_coefficients, halves

# Samples among which switching times are found; they are then refined between samples.
_MIN_SAMPLES = 2000
_MIN_SAMPLES_PER_PIECE = 20
_SWITCHING_TOLERANCE = 1e-10  # [s]
_HALVINGS = 24  # of the time between two samples
_GOLDEN = (np.sqrt(5) - 1) / 2
# The least margin is bracketed to this fraction of itself, or to this length [m] near zero.
_RELATIVE_RESOLUTION = 0.02
_RESOLUTION = 2e-7
_MIN_WIDTH = 2.0**-40  # of an interval
_MAX_ROWS = 1_000_000


@dataclass(frozen=True)
class Visit:
    """The interval of a trajectory in a tube segment."""

    segment: int  # index of the segment
    begin: float  # [s]
    end: float  # [s]


@dataclass(frozen=True)
class Passage:
    """The passage of a compulsory point."""

    point: int  # index of the point
    time: float  # time of the nearest passage [s]
    margin: float  # margin of the tool inside the ball about the point at that time [m]


@dataclass(frozen=True)
class LeastMargin:
    """The least margin of a quantity during visits: the tool's position, rotation or velocity."""

    lower_bound: float  # lower bound on the margin at all times [m, rad or relative]
    attained: float  # the least margin that was found [m, rad or relative]
    time: float  # time of that margin [s]
    segment: int  # index of the segment at that time
    intervals: int  # number of intervals tested


def tube_visits(
    problem: PlanningProblem,
    trajectory: JointTrajectory,
    tool: Enclosure,
    rotation: Enclosure | None = None,
    further: tuple[MarginMaker, ...] = (),
) -> list[Visit]:
    """Return consecutive visits that cover the whole trajectory.

    Switching times leave the largest margins of all conditions of segments, and let compulsory
    points be passed. If the tube is to be visited in order, every segment is visited once; else, as
    often as needed.

    Args:
        problem: The planning problem.
        trajectory: The trajectory.
        tool: Enclosed position of the tool.
        rotation: Enclosed rotation matrix of the tool; needed where the tube bounds the rotation.
        further: As for `segment_margins`.
    """
    fit = _Fit(problem, trajectory, tool, rotation, further)
    return fit.visits(fit.sample_times())


def telling_visits(
    problem: PlanningProblem,
    trajectory: JointTrajectory,
    tool: Enclosure,
    rotation: Enclosure | None,
    further: tuple[MarginMaker, ...],
) -> list[Visit]:
    """Return visits of a failed trajectory that break no condition for the sake of another one.

    The largest margin of all conditions together compares metres with radians and fractions: a tool
    that is 5 % too fast would rather be outside of its segment. Here conditions come in turn: as
    far as each can be kept beside those before it, it is kept.

    Args:
        problem: As for `tube_visits`, like all others.
        trajectory: The trajectory.
        tool: Enclosed position of the tool.
        rotation: Enclosed rotation matrix of the tool.
        further: Further conditions, in turn.
    """
    fit = _Fit(problem, trajectory, tool, rotation, further)
    alone = [visit.begin for one in fit.each() for visit in one.visits(one.sample_times())]
    time = np.union1d(fit.sample_times(), alone)
    # Between two samples one condition may begin to hold just before another one ends to.
    for one in fit.each():
        time = np.union1d(time, one.crossings(time))
    is_ordered, levels = problem.tube.visit == "ordered", list[float]()
    gates = fit.gate_margins(time)
    holds = np.ones((len(time), problem.tube.segment_count), dtype=bool)
    each = list(fit.each())
    for one in each:
        margin = one.at(time)
        values = np.where(holds, margin, -np.inf)
        if is_ordered:
            samples = best_switching_samples(values, gates=gates)
            most = min(_worst_visit(samples, values), _worst_gate(samples, gates))
        else:
            most = float(_least_of_steps(values).max(axis=1).min())
        levels.append(min(most, 0.0))
        holds &= margin >= levels[-1]
        if one is each[0]:  # the tube's own condition, as gates are
            gates = {k: np.where(gate >= levels[0], np.inf, -np.inf) for k, gate in gates.items()}
    fit.levels = levels
    return fit.visits(time, is_refined=False)


def ordered_switching_samples(
    values: FloatArray,
    passing: dict[int, FloatArray],
    gates: dict[int, FloatArray] | None = None,
) -> IntArray:
    """Return the best switching samples; others, if only these let compulsory points be passed.

    Not at the cost of another condition that holds: then the point is missed.

    Args:
        values: Least margins of all conditions at N samples in m segments, shape (N, m).
        passing: Margins of the samples inside the ball about each compulsory point, (N,), by index.
        gates: As of `best_switching_samples`.

    Returns:
        As `best_switching_samples`, shape (m-1,).
    """
    samples = best_switching_samples(values, gates=gates)
    if not passing or _worst_passing(samples, passing) >= 0:
        return samples
    others = best_switching_samples(values, passing, gates)
    needed = min(0.0, _worst_visit(samples, values))
    return others if _worst_visit(others, values) >= needed else samples


def _least_of_steps(values: FloatArray) -> FloatArray:
    """Return the least of values (N, m) at both ends of each step, shape (N-1, m)."""
    return np.minimum(values[:-1], values[1:])


def _worst_visit(samples: IntArray, values: FloatArray) -> float:
    """Return the least value (N, m) of an ordered visit."""
    ends = [0, *samples.tolist(), len(values) - 1]
    visits = zip(ends, ends[1:], values.T, strict=False)
    return min(float(value[begin : end + 1].min()) for begin, end, value in visits)


def _worst_gate(samples: IntArray, gates: dict[int, FloatArray]) -> float:
    """Return the least margin of gates at the switching samples of an ordered visit [m]."""
    return min([np.inf, *(float(gate[samples[k - 1]]) for k, gate in gates.items())])


def _worst_passing(samples: IntArray, passing: dict[int, FloatArray]) -> float:
    """Return the margin of the worst point, passed during the two segments beside the point [m]."""
    ends = [0, *samples.tolist(), None]
    last = {k: None if ends[k + 1] is None else ends[k + 1] + 1 for k in passing}
    return min(float(margin[ends[k - 1] : last[k]].max()) for k, margin in passing.items())


def passages(
    problem: PlanningProblem,
    trajectory: JointTrajectory,
    tool: Enclosure,
    visits: list[Visit],
    rotation: Enclosure | None = None,
    further: tuple[MarginMaker, ...] = (),
) -> list[Passage]:
    """Return the nearest passage of each compulsory point, at an instant that counts.

    An instant counts if either segment beside the point is current or, if segments are visited at
    will, may be. The margin is a lower bound, attained at that instant.
    """
    fit = _Fit(problem, trajectory, tool, rotation, further)
    time = fit.sample_times()
    nearest = []
    for k in problem.tube.compulsory_points.tolist():
        low, high = 0.0, trajectory.duration
        if problem.tube.visit == "ordered":
            low, high = visits[k - 1].begin, visits[k].end
        inside = np.unique(np.concatenate([[low], time[(time > low) & (time < high)], [high]]))
        nearest.append(fit.best_passage(k, inside))
    return nearest


def least_margin(tube: Tube, tool: Enclosure, visits: list[Visit]) -> LeastMargin:
    """Return the least margin of the tool inside the regions during its visits, for all t."""
    return least_concave_margin(tool, visits, tube.regions.margin, np.ones(tube.segment_count))


def least_concave_margin(
    vector: Enclosure,
    visits: list[Visit],
    margin_of: Callable[[FloatArray, IntArray], FloatArray],
    slope: FloatArray,
    at: Callable[[FloatArray, IntArray], FloatArray] | None = None,
) -> LeastMargin:
    """Return the least margin of a vector during visits, for all t.

    A polynomial lies in the hull of its Bernstein coefficients, and the margin is concave, as the
    distance to a segment is convex: on an interval, it is nowhere less than at the worst of them.
    Intervals that could hold the least margin are halved; the bound's excess falls to a quarter
    each time.

    Args:
        vector: Of three components.
        visits: Of the trajectory.
        margin_of: From vectors (N, R, 3) and a segment per column (R,) to margins (N, R), or to
            lower bounds on them that are concave in each column.
        slope: Bound on the margin's rate of change with the vector in each segment, shape (m,).
        at: Likewise, to the margins themselves; None: as `margin_of`.
    """
    at = at or margin_of
    interval, start, width, segment = visited_parts(vector, visits)
    attained, time, worst_segment = np.inf, 0.0, 0
    lower_bound, count = np.inf, 0
    while len(interval):
        count += len(interval)
        hull = bernstein_coefficients(vector.coefficients[:, interval], start, width)
        margin, error = margin_of(hull, segment), slope[segment] * vector.error[interval, 0]
        ends = at(hull[[0, -1]], segment)
        end, row = np.unravel_index(int(ends.argmin()), ends.shape)
        if ends[end, row] < attained:
            attained, worst_segment = float(ends[end, row]), int(segment[row])
            local = start[row] + (width[row] if end else 0.0)
            time = float(vector.start[interval[row]] + local * vector.width[interval[row]])
        lower = margin.min(axis=0) - error
        resolution = max(_RESOLUTION, _RELATIVE_RESOLUTION * abs(attained))
        split = (lower < attained - resolution - error) & (width > _MIN_WIDTH)
        split &= count < _MAX_ROWS
        lower_bound = min(lower_bound, float(lower[~split].min(initial=np.inf)))
        interval, segment = np.repeat(interval[split], 2), np.repeat(segment[split], 2)
        start, width = halves(start[split], width[split])
    return LeastMargin(lower_bound, attained, time, worst_segment, count)


def visited_parts(
    tool: Enclosure, visits: list[Visit]
) -> tuple[IntArray, FloatArray, FloatArray, IntArray]:
    """Return every part of an interval that a visit covers: interval, start, width, segment."""
    ends = tool.start + tool.width
    parts = []
    for visit in visits:
        covered = np.flatnonzero((ends >= visit.begin) & (tool.start <= visit.end))
        low = np.clip((visit.begin - tool.start[covered]) / tool.width[covered], 0.0, 1.0)
        high = np.clip((visit.end - tool.start[covered]) / tool.width[covered], 0.0, 1.0)
        parts.append((covered, low, high - low, np.full(len(covered), visit.segment)))
    interval, start, width, segment = (np.concatenate(part) for part in zip(*parts, strict=True))
    return interval, start, width, segment


class _Fit:
    """Margins of all conditions of segments on a trajectory, at any time.

    Attributes:
        levels: Of each condition, what its margin is counted from [m, rad or relative].
    """

    def __init__(
        self,
        problem: PlanningProblem,
        trajectory: JointTrajectory,
        tool: Enclosure,
        rotation: Enclosure | None,
        further: tuple[MarginMaker, ...],
    ) -> None:
        self._tube, self._trajectory, self._tool = problem.tube, trajectory, tool
        self._margins = segment_margins(problem, trajectory, tool, rotation, further)
        self.levels = [0.0] * len(self._margins)
        self._has_gates = True

    def each(self) -> Iterator["_Fit"]:
        """Yield the fit of each condition alone, the tube's first, without gates."""
        for margin, level in zip(self._margins, self.levels, strict=True):
            one = copy(self)
            one._margins, one.levels, one._has_gates = (margin,), [level], False
            yield one

    def sample_times(self) -> FloatArray:
        pieces = len(self._trajectory.widths)
        count = max(_MIN_SAMPLES_PER_PIECE, -(-_MIN_SAMPLES // pieces))
        return self._trajectory.per_piece(count).time

    def at(self, time: FloatArray) -> FloatArray:
        """Return the least margin of all conditions.

        Args:
            time: Shape (N,) [s].

        Returns:
            For every segment, shape (N, m).
        """
        both = zip(self._margins, self.levels, strict=True)
        return np.minimum.reduce([margin.at(time) - level for margin, level in both])

    def crossings(self, time: FloatArray) -> FloatArray:
        """Return the last times at which a condition holds beside times (N,), where it breaks.

        Between neighbouring times it holds at one and breaks at the other, in any segment. Shape
        (C,) [s].
        """
        (margin,), (level,) = self._margins, self.levels
        holds = margin.at(time) >= level
        sample, segment = np.nonzero(holds[:-1] != holds[1:])
        inside = time[sample + ~holds[sample, segment]]
        outside = time[sample + holds[sample, segment]]
        for _ in range(_HALVINGS):
            middle = (inside + outside) / 2
            is_inside = margin.within(segment, middle) >= level
            inside = np.where(is_inside, middle, inside)
            outside = np.where(is_inside, outside, middle)
        return inside

    def visits(self, time: FloatArray, *, is_refined: bool = True) -> list[Visit]:
        """Return the visits with the largest margins at times (N,) [s], and between if refined."""
        values, step = self.at(time), 1 if is_refined else 0
        if self._tube.visit == "ordered":
            points = self._tube.compulsory_points.tolist()
            passing = {k: self.passing_margin(k, time) for k in points}
            gates = {k: gate - self.levels[0] for k, gate in self.gate_margins(time).items()}
            samples = ordered_switching_samples(values, passing, gates)
            # The nearest other times: at a breakpoint two samples share one.
            before = np.searchsorted(time, time[samples], "left") - step
            after = np.searchsorted(time, time[samples], "right") - 1 + step
            low, high = time[np.maximum(before, 0)], time[np.minimum(after, len(time) - 1)]
            segments = np.arange(self._tube.segment_count)
        else:
            best = (values if is_refined else _least_of_steps(values)).argmax(axis=1)
            changes = np.flatnonzero(np.diff(best))
            low, high = time[changes + 1 - step], time[changes + 1]
            segments = best[np.append(changes, len(best) - 1)]
        times = self.best_times((segments[:-1], segments[1:]), low, high)
        ends = pairwise([0.0, *times.tolist(), self._trajectory.duration])
        return [
            Visit(segment, begin, end)
            for segment, (begin, end) in zip(segments.tolist(), ends, strict=True)
        ]

    def passing_margin(self, k: int, time: FloatArray) -> FloatArray:
        """Return the tool's margins inside the ball about point k at times (N,), (N,) [m]."""
        radius = self._tube.effective_radius[k - 1 : k + 1].min()
        distance = np.linalg.norm(self._tool.at(time) - self._tube.points[k], axis=1)
        margin: FloatArray = radius - distance
        return margin

    def gate_margins(self, time: FloatArray) -> dict[int, FloatArray]:
        """Return the margins of the tool beyond each gate at times (N,), (N,) [m], by its point."""
        gates = self._tube.gates if self._has_gates else ()
        return {gate.point: gate.margin(self._tool.at(time)) for gate in gates}

    def best_passage(self, k: int, time: FloatArray) -> Passage:
        """Return the nearest passage of a compulsory point, at or between times (N,) [s]."""

        def margin(t: FloatArray) -> FloatArray:
            inside = self.passing_margin(k, t)
            if self._tube.visit == "ordered":
                return inside
            return np.minimum(inside, self.at(t)[:, [k - 1, k]].max(axis=1))

        best = int(margin(time).argmax())
        around = time[[max(best - 1, 0), best, min(best + 1, len(time) - 1)]]
        candidates = [float(around[1])]
        if around[0] < around[2]:
            candidates.append(float(_highest(margin, around[:1], around[2:])[0]))
        margins = margin(np.array(candidates))
        # The tool itself may be off its enclosure by this error.
        error = float(self._tool.error.max())
        return Passage(k, candidates[margins.argmax()], float(margins.max()) - error)

    def best_times(
        self, pairs: tuple[IntArray, IntArray], low: FloatArray, high: FloatArray
    ) -> FloatArray:
        """Return the times in intervals at which the worse of two segments' margins is largest.

        Args:
            pairs: The segments before and after the switching times, each (H,).
            low: Starts of the intervals, shape (H,) [s].
            high: Ends of the intervals, shape (H,) [s].

        Returns:
            In order, shape (H,) [s].
        """

        def worse(time: FloatArray) -> FloatArray:
            before, after = (
                np.minimum.reduce(
                    [
                        margin.within(segment, time) - level
                        for margin, level in zip(self._margins, self.levels, strict=True)
                    ]
                )
                for segment in pairs
            )
            least = np.minimum(before, after)
            for gate in self._tube.gates if self._has_gates else ():
                here = pairs[1] == gate.point
                beyond = gate.margin(self._tool.at(time[here])) - self.levels[0]
                least[here] = np.minimum(least[here], beyond)
            return least

        candidates = np.array([low, high, _highest(worse, low, high)])
        best = np.array([worse(time) for time in candidates]).argmax(axis=0)
        times: FloatArray = candidates[best, np.arange(len(low))]
        # Refined on their own, switching times that share an instant could swap: then they share
        # the later one or the earlier one.
        later, earlier = np.maximum.accumulate(times), np.minimum.accumulate(times[::-1])[::-1]
        if (later == earlier).all():
            return times
        return max((later, earlier), key=lambda each: float(worse(each).min()))


def _highest(
    function: Callable[[FloatArray], FloatArray], low: FloatArray, high: FloatArray
) -> FloatArray:
    """Return the times at which a function is highest, in H intervals at once, shape (H,) [s].

    By golden sections (Kiefer, "Sequential minimax search for a maximum", 1953).
    """
    begin, end = low, high
    early, late = end - _GOLDEN * (end - begin), begin + _GOLDEN * (end - begin)
    at_early, at_late = function(early), function(late)
    while (end - begin).max(initial=0.0) > _SWITCHING_TOLERANCE:
        is_early = at_early >= at_late
        begin, end = np.where(is_early, begin, early), np.where(is_early, late, end)
        inner = np.where(is_early, end - _GOLDEN * (end - begin), begin + _GOLDEN * (end - begin))
        at_inner = function(inner)
        early, late = np.where(is_early, inner, late), np.where(is_early, early, inner)
        at_early, at_late = (
            np.where(is_early, at_inner, at_late),
            np.where(is_early, at_early, at_inner),
        )
    return (begin + end) / 2
