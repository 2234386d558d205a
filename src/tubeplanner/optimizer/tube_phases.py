"""Tubes as the optimizer takes them: chains of segments per phase, smoother and wider tubes.

A switching time is a variable, and its phase needs knots of its own. Of hundreds of short segments,
as paths from scans and drawings have them, only sharp corners are worth that, and where the
conditions on the joints or on the rotation change, or a point is compulsory. Between them lie
chains: there the segment of a sample follows from where the tool is.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.errors import ProblemError
from tubeplanner.geometry.tube.points import arc_lengths
from tubeplanner.geometry.tube.rotation import RotationalTube
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.optimizer.phased_spline import KnotGrid, Samples
from tubeplanner.task.problem import PlanningProblem

# ---- The tube segments of a phase: one, or a chain of short ones that turn little.

# Largest sharpness of corners in a run, in radii: the sag of the path there over one spacing of
# about this number of samples.
_SAMPLES = 200
_KINK = 0.02
# Up to this number of corners all end a phase; of more corners, the sharper ones do, at most as
# many.
_MANY_CORNERS, _SHARP_KINK, _MAX_SHARP = 12, 0.1, 100
# A turn counts as far as the path turns over this number of radii on both sides: noise turns back
# at once.
_WINDOW = 3.0
# A smaller turn is none [rad].
_STRAIGHT = 1e-6


def tube_chains(problem: PlanningProblem) -> tuple[range, ...]:
    """Return the segments of every phase, in order, all of the tube's."""
    tube = problem.tube
    kinks = _kinks(tube, _spacing(tube), np.minimum(_turns(tube), smoothed_angles(tube)))
    is_end = kinks >= (_KINK if len(kinks) > _MANY_CORNERS else 0.0)
    if is_end.sum() > _MANY_CORNERS:
        is_end = kinks >= _SHARP_KINK
        is_end[np.argsort(-kinks, kind="stable")[_MAX_SHARP:]] = False
    is_end |= np.array([a != b for a, b in pairwise(tube.conditions)], dtype=bool)
    is_end[tube.compulsory_points - 1] = True
    ends = 1 + np.flatnonzero(is_end)
    bounds = [0, *ends.tolist(), tube.segment_count]
    return tuple(range(begin, end) for begin, end in pairwise(bounds))


def largest_kink(tube: Tube, runs: tuple[range, ...], spacing: float) -> float:
    """Return the largest distance outside chains between samples inside, in radii.

    On the inner side of a corner the tool is farthest from both legs where it passes from one to
    the other. Samples have a spacing along the path [m].
    """
    inner = np.zeros(tube.segment_count - 1, dtype=bool)
    for run in runs:
        inner[run.start : run.stop - 1] = True
    return float(_kinks(tube, spacing, _turns(tube))[inner].max(initial=0.0))


def sharpest_bend(tube: Tube, runs: tuple[range, ...] = ()) -> float:
    """Return the largest turn of a path over the length of a radius [rad].

    Turns in opposite directions add up: the result is the inverse of the radius of curvature, in
    radii, or noise. With runs, the segments of every phase, only turns within them count.
    """
    turns = _turns(tube)
    turns[[run.stop - 1 for run in runs[:-1]]] = 0.0
    so_far = np.concatenate([[0.0], np.cumsum(turns)])
    along, radius = arc_lengths(tube.points)[1:-1], tube.effective_radius
    half = np.minimum(radius[:-1], radius[1:]) / 2
    last = np.searchsorted(along, along + half, side="right")
    first = np.searchsorted(along, along - half)
    return float((so_far[last] - so_far[first]).max(initial=0.0))


def smoothed_angles(tube: Tube) -> FloatArray:
    """Return the angles by which the path turns over some radii, shape (m-1,) [rad]."""
    points, along = tube.points, arc_lengths(tube.points)
    radius = tube.effective_radius
    window = _WINDOW * np.maximum(np.minimum(radius[:-1], radius[1:]), _spacing(tube))
    before, after = (
        np.column_stack([np.interp(s, along, column) for column in points.T])
        for s in (along[1:-1] - window, along[1:-1] + window)
    )
    return _angles(points[1:-1] - before, after - points[1:-1])


def has_turns_at_speed(problem: PlanningProblem) -> bool:
    """Return True if the tube turns where the tool's speed is limited on both sides."""
    return len(turns_at_speed(problem)[0]) > 0


def has_speed_limit(problem: PlanningProblem) -> bool:
    """Return True if the tool's speed is limited in some segment."""
    return bool(np.isfinite(_speed_limit(problem)).any())


def _speed_limit(problem: PlanningProblem) -> FloatArray:
    """Return the limit on the tool's speed in each segment, (m,) [m/s], inf where it is free."""
    limit = np.full(problem.tube.segment_count, problem.robot.limits.tool_speed)
    of_tube = problem.tube.tool_speed
    return limit if of_tube is None else np.minimum(limit, of_tube)


def turns_at_speed(problem: PlanningProblem) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the turns of a tube where the tool's speed is limited on both sides, or has a band.

    The widest arc in a strip of half width r that turns by th has the radius 2r / (1 - cos(th/2)).
    It is no longer than the segments beside it.

    Returns:
        Indices of points, their angles [rad], and the times of half an arc [s], shape (K,) each.
    """
    tube, angle = problem.tube, np.minimum(_turns(problem.tube), smoothed_angles(problem.tube))
    limit, banded = _speed_limit(problem), np.zeros(tube.segment_count, dtype=bool)
    for first, last in tube.stretches:
        banded[first : last + 1] = True
    is_limited = np.isfinite(limit)
    at_speed = (is_limited[:-1] & is_limited[1:]) | banded[:-1] | banded[1:]
    points = 1 + np.flatnonzero(at_speed & (angle > _STRAIGHT))
    angle, before, after = angle[points - 1], points - 1, points
    radius = np.minimum(tube.effective_radius[before], tube.effective_radius[after])
    length = np.linalg.norm(np.diff(tube.points, axis=0), axis=1)
    half = np.minimum(radius * angle / (1 - np.cos(angle / 2)), length[before])
    half = np.minimum(half, length[after])
    return points, angle, half / np.minimum(limit[before], limit[after])


def _spacing(tube: Tube) -> float:
    """Return the approximate spacing of samples [m]."""
    return float(arc_lengths(tube.points)[-1]) / _SAMPLES


def _kinks(tube: Tube, spacing: float, turn: FloatArray) -> FloatArray:
    """Return the sag of chords between samples at inner reference points, in radii, (m-1,).

    A chord of a length d over a turn by a small angle passes it at d / 4 times the angle, at most.
    """
    length = np.linalg.norm(np.diff(tube.points, axis=0), axis=1)
    chord = np.minimum(spacing, np.minimum(length[:-1], length[1:]))
    radius = tube.effective_radius
    kinks: FloatArray = chord * turn / 4 / np.minimum(radius[:-1], radius[1:])
    return kinks


def _turns(tube: Tube) -> FloatArray:
    """Return the angles by which the path turns at inner reference points, shape (m-1,) [rad]."""
    axis = np.diff(tube.points, axis=0)
    return _angles(axis[:-1], axis[1:])


def _angles(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the angles between vectors, each (N, 3): shape (N,) [rad]."""
    across = np.linalg.norm(np.cross(a, b), axis=1)
    angles: FloatArray = np.arctan2(across, np.einsum("ni,ni->n", a, b))
    return angles


# ---- The segment of each sample in its chain: in order, and as near as possible.
#
# Where a rotation nearly breaks its tolerance in the nearest segment, another may be better: the
# larger of both counts, the distance in radii or the rotation in tolerances. By distance alone the
# reference orientation jumps at bends, and between two samples the rotation fits neither segment.
#
# The certificate requires the segments in order too: the tool may not skip back where a path comes
# near itself, and a closed path begins in its first segment and ends in its last. Nor may it leave
# segments out, though samples do not show that: each of them may be near another segment.

# The tool takes a short cut between two samples if it leaves out this number of radii more of the
# path than it moves. Omitted segments count from this number of radii away, if they are farther
# than the samples' own, by this factor: so the program sees them before the tool has left them.
_SHORT_CUT, _FAR, _FARTHER = 0.5, 0.3, 1.1
# Rotations count from this fraction of their tolerance in the nearest segment. If all did, samples
# would change segments where nothing is at its limit; at 1, the program would be stopped before.
_TURNED = 0.9
_NO_SQUARE = 1e-30  # [m^2]
# Least distance of requested segments, in radii.
_MIN_FRACTION = 1e-9


@dataclass(frozen=True, eq=False)
class OrderedSegments:
    """The segments of N samples of a spline, as a function of the tool's positions."""

    points: FloatArray  # reference points, shape (m+1, 3) [m]
    radius: FloatArray  # of the segments, shape (m,) [m]
    runs: tuple[range, ...]  # the segments of every phase
    samples: Samples  # the samples, in any order
    # whether a segment gets a sample wherever the tool is, shape (m,): the segments that it missed
    # at denser samples. None: no segment.
    is_requested: BoolArray | None = None
    # the rotational part of the tube, and the samples' orientations, shape (N, 3, 3); None: free
    rotation: tuple[RotationalTube, FloatArray] | None = None

    @cached_property
    def in_run(self) -> BoolArray:
        """True for samples whose phase has several segments, shape (N,)."""
        several = np.array([len(run) > 1 for run in self.runs])
        in_run: BoolArray = several[self.samples.phase]
        return in_run

    def at(self, tool: FloatArray) -> IntArray:
        """Return the samples' segments with the tool at (N, 3), shape (N,)."""
        segment = np.array([run.start for run in self.runs])[self.samples.phase]
        for run, members in self._members:
            segment[members] += self._passage(tool, run, members).segments()
        return segment

    def missed(self, tool: FloatArray) -> BoolArray:
        """Return True for segments of chains with no sample inside, the tool at (N, 3); (m,)."""
        missed = np.zeros(len(self.radius), dtype=bool)
        for run, members in self._members:
            missed[run.start : run.stop] = self._passage(tool, run, members).missed()
        return missed

    def _passage(self, tool: FloatArray, run: range, members: IntArray) -> "_Passage":
        own, is_requested = slice(run.start, run.stop), np.zeros(len(run), dtype=bool)
        if self.is_requested is not None:
            is_requested = self.is_requested[own]
        points, tool, turned = self.points[run.start : run.stop + 1], tool[members], None
        if self.rotation is not None:
            tube, orientation = self.rotation[0], self.rotation[1][members]

            def turned(sample: IntArray, segment: IntArray) -> FloatArray:
                return tube.use(orientation[sample], tool[sample], run.start + segment)

        return _Passage(tool, points, self.radius[own], is_requested, turned)

    @cached_property
    def _members(self) -> list[tuple[range, IntArray]]:
        """The chains, and their samples in the order of time."""
        order = np.lexsort((self.samples.fraction, self.samples.phase))
        phase = self.samples.phase[order]
        return [
            (run, order[slice(*np.searchsorted(phase, [k, k + 1]))])
            for k, run in enumerate(self.runs)
            if len(run) > 1
        ]


def ordered_choice(cost: FloatArray) -> IntArray:
    """Return the cheapest non-decreasing choices (N,) from the first to the last of all.

    The cost is that of each of m choices at each of N samples, shape (N, m); finite.
    """
    cost = cost.copy()
    cost[0, 1:] = cost[-1, :-1] = np.inf
    nearest = cost.argmin(axis=1)
    if (np.diff(nearest) >= 0).all():  # as a rule: none can be cheaper
        return nearest
    # Dynamic programme: the least cost of all samples so far, this one's choice being at most k.
    least = cost
    for sample in range(1, len(cost)):
        np.minimum.accumulate(least[sample - 1], out=least[sample - 1])
        least[sample] += least[sample - 1]
    choice = np.full(len(cost), cost.shape[1] - 1)
    for sample in range(len(cost) - 2, -1, -1):
        choice[sample] = (least[sample] <= least[sample, choice[sample + 1]]).argmax()
    return choice


@dataclass(frozen=True, eq=False)
class _Passage:
    """The tool's passage through a chain of m segments."""

    tool: FloatArray  # tool positions at N samples, in the order of time, shape (N, 3) [m]
    points: FloatArray  # the chain's reference points, shape (m+1, 3) [m]
    radius: FloatArray  # of its segments, shape (m,) [m]
    is_requested: BoolArray  # whether a segment gets a sample in any case, shape (m,)
    # returns the rotations of samples in segments, both (K,), in tolerances; None: free
    turned: Callable[[IntArray, IntArray], FloatArray] | None

    def missed(self) -> BoolArray:
        """Return True for segments with no sample inside, shape (m,)."""
        missed: BoolArray = self._square.min(axis=0) > self.radius**2
        return missed

    def segments(self) -> IntArray:
        """Return the samples' segments, in order, shape (N,).

        The nearest segments in order leave out whole bends where the tool is as near to later
        segments. So where it takes short cuts, omitted segments have a cost too, by their distance
        from the line between two samples. If one is still far off, it gets one of the two samples.
        """
        cost = self._use**2
        choice = ordered_choice(cost)
        if not self._left_out(choice)[1].any():
            return choice  # as a rule
        # From lines, between the ends of one and the other: enough where one of both is short.
        from_points = _squared_distances(self.points, self.tool[:-1], self.tool[1:]).T
        from_samples = np.minimum(self._square[:-1], self._square[1:])
        nearest = np.minimum(from_samples, np.minimum(from_points[:, :-1], from_points[:, 1:]))
        choice = ordered_choice_paying(cost, (nearest / self.radius**2) ** 2)
        farthest, fraction = self._left_out(choice)
        is_fixed = np.zeros(len(choice), dtype=bool)
        is_fixed[[0, -1]] = True  # these stay in the first segment and the last
        for step in np.argsort(-fraction, kind="stable")[: np.count_nonzero(fraction)]:
            segment = farthest[step]
            nearer = step + np.argsort(self._use[step : step + 2, segment], kind="stable")
            free = nearer[~is_fixed[nearer]][:1]
            choice[free], is_fixed[free] = segment, True
        return choice

    @cached_property
    def _use(self) -> FloatArray:
        """Squares of distances in radii or, if larger, of rotations in tolerances, shape (N, m)."""
        use = self._square / self.radius**2
        if self.turned is not None:
            samples, nearest = np.arange(len(use)), use.argmin(axis=1)
            turned = self.turned(samples, nearest)
            # No segment that is farther than this can be better than the nearest.
            most = np.where(turned > _TURNED, np.maximum(turned**2, use[samples, nearest]), -1.0)
            near = np.nonzero(use <= most[:, None])
            use[near] = np.maximum(use[near], self.turned(*near) ** 2)
        return use

    @cached_property
    def _square(self) -> FloatArray:
        """Squared distances of the samples from the segments, shape (N, m) [m^2]."""
        return _squared_distances(self.tool, self.points[:-1], self.points[1:])

    @cached_property
    def _along(self) -> FloatArray:
        """Arc lengths of the reference points, shape (m+1,) [m]."""
        return arc_lengths(self.points)

    def _left_out(self, choice: IntArray) -> tuple[IntArray, FloatArray]:
        """Return the farthest segment that each short cut leaves out, and its distance, (N-1,).

        The distance in radii is from the line between two samples; 0: no omitted segment counts.
        """
        farthest, fraction = np.zeros(len(choice) - 1, dtype=np.int64), np.zeros(len(choice) - 1)
        left_out = self._along[choice[1:]] - self._along[choice[:-1] + 1]
        travel = np.linalg.norm(np.diff(self.tool, axis=0), axis=1)
        own = np.sqrt(self._square[np.arange(len(choice)), choice]) / self.radius[choice]
        beside = np.maximum(own[:-1], own[1:])
        several = np.diff(choice) > 1
        asked_before = np.concatenate([[0], np.cumsum(self.is_requested)])
        leaves_requested = several & (asked_before[choice[1:]] > asked_before[choice[:-1] + 1])
        for step in np.flatnonzero((several & (left_out > travel)) | leaves_requested):
            segments = np.arange(choice[step] + 1, choice[step + 1])
            line = self.tool[step : step + 2]
            between = self.points[segments[0] : segments[-1] + 2]
            from_line = _squared_distances(between, line[:1], line[1:])[:, 0]
            square = np.minimum(from_line[:-1], from_line[1:])
            square = np.minimum(square, self._square[step : step + 2, segments].min(axis=0))
            away = np.sqrt(square) / self.radius[segments]
            worst = int(away.argmax())
            segment, distance = segments[worst], away[worst]
            is_short_cut = left_out[step] > travel[step] + _SHORT_CUT * self.radius[segment]
            is_far = distance > 1 or distance > max(_FAR, _FARTHER * beside[step])
            if is_short_cut and is_far:
                farthest[step], fraction[step] = segment, distance
            elif leaves_requested[step]:
                away[~self.is_requested[segments]] = 0.0
                worst = int(away.argmax())
                farthest[step], fraction[step] = segments[worst], max(away[worst], _MIN_FRACTION)
        return farthest, fraction


def ordered_choice_paying(cost: FloatArray, passing: FloatArray) -> IntArray:
    """Return the cheapest ordered choice with a cost of choices left out between two samples, (N,).

    `passing` is the cost of a choice between those of a sample and the next, shape (N-1, m).
    """
    cost = cost.copy()
    cost[0, 1:] = cost[-1, :-1] = np.inf
    count, choices = cost.shape
    best, every = cost[0], np.arange(choices)
    origin = np.empty((count - 1, choices), dtype=np.int64)
    for step, paid in enumerate(np.cumsum(passing, axis=1)):
        unpaid = best - paid  # from j to k > j it takes paid[k - 1] - paid[j]
        least = np.minimum.accumulate(unpaid)
        cheapest = np.maximum.accumulate(np.where(unpaid <= least, every, 0))
        onward = np.concatenate([[np.inf], (least + paid)[:-1]])
        moves = onward < best
        origin[step] = np.where(moves, np.concatenate([[0], cheapest[:-1]]), every)
        best = np.where(moves, onward, best) + cost[step + 1]
    choice = np.full(count, choices - 1)
    for step in range(count - 2, -1, -1):
        choice[step] = origin[step, choice[step + 1]]
    return choice


def _squared_distances(points: FloatArray, begin: FloatArray, end: FloatArray) -> FloatArray:
    """Return the squared distances of points (N, 3) to segments (m, 3): (N, m), to rounding.

    By products of matrices, as there may be a million pairs.
    """
    origin = begin.mean(axis=0)
    points, begin, axis = points - origin, begin - origin, end - begin
    squared_length = np.einsum("mi,mi->m", axis, axis)
    along = points @ axis.T - np.einsum("mi,mi->m", begin, axis)
    fraction = np.clip(along / np.maximum(squared_length, _NO_SQUARE), 0.0, 1.0)
    square = np.einsum("ni,ni->n", points, points)[:, None] - 2 * points @ begin.T
    square += np.einsum("mi,mi->m", begin, begin) - fraction * (
        2 * along - fraction * squared_length
    )
    return np.maximum(square, 0.0)


# ---- A narrower tube inside a tube, about a smoother path, where a path bends within its radius.
#
# A scan's points scatter about the intended path, some behind their predecessors, and a drawing may
# bend more sharply than its tube is wide. Fast motions need not follow every such bend: a smoother
# path fits in the tube. Where every point moves by at most d, points within r - d of a new segment
# are within r of the old one: between two segments, distances lie between those at their ends. So
# segments keep their order, their numbers and their conditions.

# Fractions of the radius by which points may move; the first that leaves no bends sharper than this
# [rad over the length of a radius], or the last that reduces the sharpest by a tenth at least.
_SLACKS, _GENTLE, _SMOOTHER = (0.5, 0.8), 1.0, 0.9
# Largest distance of a given start or goal from its reference point, in radii.
_MAX_AT_ENDS = 0.9
# A larger turn of a path over some radii is no noise, and the tool must go there [rad].
_BACKWARDS = np.radians(150)
# Of the splitting method; distances settle to a thousandth of the slack.
_STEPS, _COUPLING, _OVERSHOOT = 200, 0.1, 1.6
_MIN_STEP = 0.3  # of the usual one


def smoother_problem(problem: PlanningProblem) -> PlanningProblem | None:
    """Return a problem whose tube lies inside a problem's and bends less; None if there is none.

    It has the same segments, and a motion inside its tube is inside the problem's: but for points
    that count as turning back by noise alone, which it need not pass, and rotations, which are
    compared at other points of the segments. Boxes have none: about another path, they would have
    another orientation.
    """
    if problem.tube.is_box.any():
        return None
    best, least = None, _SMOOTHER * sharpest_bend(problem.tube)
    for slack in _SLACKS:
        candidate = _with_slack(problem, slack)
        bend = np.inf if candidate is None else sharpest_bend(candidate.tube)
        if bend < least:
            best, least = candidate, _SMOOTHER * bend
        if bend <= _GENTLE:
            break
    return best


def _with_slack(problem: PlanningProblem, fraction: float) -> PlanningProblem | None:
    """Return a problem about a path whose points may move by a fraction of the radius, if any."""
    tube, radius = problem.tube, problem.tube.effective_radius
    ends = tube.points[[0, -1]].copy()
    for row, end in enumerate(problem.endpoints):
        if end.joints is not None:
            ends[row] = problem.robot.tool_position(end.joints[None])[0]
        elif end.region is not None:
            ends[row] = end.region.position
    at_ends = np.linalg.norm(ends - tube.points[[0, -1]], axis=1)
    if (at_ends > _MAX_AT_ENDS * radius[[0, -1]]).any():
        return None
    slack = fraction * np.minimum(np.append(radius, np.inf), np.append(np.inf, radius))
    # Compulsory points where the path turns back over some radii.
    is_fixed = np.zeros(tube.segment_count + 1, dtype=bool)
    compulsory = tube.compulsory_points
    is_fixed[compulsory] = smoothed_angles(tube)[compulsory - 1] > _BACKWARDS
    slack[is_fixed] = 0.0
    slack[[0, -1]] = 0.0
    old = tube.points.copy()
    old[[0, -1]] = ends
    points = smoothed(old, slack, is_fixed)
    shift = np.linalg.norm(points - tube.points, axis=1)
    narrower = tube.radius - np.maximum(shift[:-1], shift[1:])
    try:
        smoother = replace(tube, points=points, radius=narrower)
        if smoother.segment_count != tube.segment_count:
            return None
        object.__setattr__(smoother, "parts", tube.parts)
        return replace(problem, tube=smoother)
    except ProblemError:  # points that meet, or an end on the edge of its rotation tolerance
        return None


def smoothed(points: FloatArray, slack: FloatArray, is_free: BoolArray) -> FloatArray:
    """Return points (N, 3) near others with about the least sum of squared curvatures.

    By the alternating direction method of multipliers (Boyd et al., "Distributed optimization and
    statistical learning", 2011, section 5), which alternates between bending and distance. Points
    shift by `slack` (N,) at most [m]; the path bends at no cost at free points (N,).
    """
    from scipy import sparse
    from scipy.sparse.linalg import splu

    bending = _bending(points, is_free) + _COUPLING * sparse.identity(len(points))
    solve = splu(bending.tocsc()).solve
    near, dual = points.copy(), np.zeros_like(points)
    for _ in range(_STEPS):
        target = _OVERSHOOT * solve(_COUPLING * (near - dual)) + (1 - _OVERSHOOT) * near + dual
        away = target - points
        distance = np.linalg.norm(away, axis=1)
        near = points + away * np.minimum(1.0, slack / np.maximum(distance, 1e-15))[:, None]
        dual = target - near
    return near


def _bending(points: FloatArray, is_free: BoolArray) -> Any:
    """Return the matrix (N, N) of the sum of squared curvatures over a path.

    Spacings count in medians, so that its scale is that of distances, and as no less than a part of
    one: noise makes some of them far shorter.
    """
    from scipy import sparse

    count = len(points)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    steps = np.maximum(steps / np.median(steps), _MIN_STEP)
    direction = sparse.diags([-1 / steps, 1 / steps], [0, 1], shape=(count - 1, count))
    bending = sparse.diags([-1.0, 1.0], [0, 1], shape=(count - 2, count - 1)) @ direction
    weight = ~is_free[1:-1] * 2 / (steps[1:] + steps[:-1])
    return (bending.T @ sparse.diags(weight) @ bending).tocsr()


# ---- A tube as wide as knots are coarse: a few cubics cannot follow a narrow one.

# The radius is at least this fraction of a knot interval's part of the segment.
_INTERVAL_FRACTION = 0.2
# At a corner it is at most this fraction of the radius of the circle that touches both legs at the
# end of the shorter one.
_CORNER_FRACTION = 0.1


def widened_radius(tube: Tube, grid: KnotGrid) -> FloatArray:
    """Return radii (m,) [m] of a tube that splines on a knot grid can follow.

    Near sharp corners the tube is hardly widened: else the spline would leave out the corner.
    """
    axis = np.diff(tube.points, axis=0)
    length = np.linalg.norm(axis, axis=1)
    interval_of = np.zeros(tube.segment_count)
    for run, fractions in zip(grid.runs, grid.fractions, strict=True):
        own = slice(run.start, run.stop)
        interval_of[own] = length[own].sum() / (len(fractions) - 1)
    # A circle that touches both legs at a distance d from the corner has the radius d tan(phi / 2),
    # phi being the angle between the legs.
    along = axis / length[:, None]
    cosine = -np.einsum("mi,mi->m", along[:-1], along[1:])
    with np.errstate(divide="ignore"):
        tangent = np.sqrt(np.clip(1 - cosine, 0, None) / np.clip(1 + cosine, 0, None))
    at_corners = _CORNER_FRACTION * np.minimum(length[:-1], length[1:]) * tangent
    widest = np.append(np.append(np.inf, at_corners), np.inf)
    widest = np.minimum(widest[:-1], widest[1:])
    coarse = np.minimum(_INTERVAL_FRACTION * interval_of, widest)
    widened: FloatArray = np.maximum(tube.effective_radius, coarse)
    return widened
