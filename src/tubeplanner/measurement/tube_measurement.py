"""How wide a tube may be: radii and joint ranges inside which no part of the robot collides."""

from dataclasses import replace
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.branches.known_branches import KnownBranches
from tubeplanner.branches.reference_branch import ReferenceBranch, redundancy_rules
from tubeplanner.errors import OptionError
from tubeplanner.measurement.folding_joints import is_determined, sign_bounds
from tubeplanner.measurement.measured_tube import (
    Binding,
    MeasureOptions,
    SegmentMeasurement,
    TubeMeasurement,
)
from tubeplanner.measurement.pair_clearance import PairClearance
from tubeplanner.measurement.segment_measurement import (
    WANTED_RANGE,
    Collision,
    CollisionBoxes,
    SegmentSearch,
    SetPreferences,
    range_core,
    search_segment,
)
from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.planning.plan_options import PlanOptions
from tubeplanner.planning.plan_result import PlanResult
from tubeplanner.planning.planner import plan
from tubeplanner.polyline import densified
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.progress import PlanningClock, Progress, ProgressCallback
from tubeplanner.tube.joint_ranges import JointRange

# Extra distance beyond the clearance [m], in reserve for what later counterexample searches find:
# the second value where the first leaves nothing around the branch.
EXTRA_CLEARANCES = (1e-3, 1e-4)
_ROUNDING = 1e-9
# How far a trajectory may leave the sets found so far, to say what it needs: [m], and [rad or m].
_WIDENINGS = ((0.0, np.inf), (0.03, 0.3))
_RADIUS_WORTHS = (1.0, 4.0)  # trades of radii for joint ranges that are tried, each time
_ROUGH_SHARE = 8  # of the samples: a rough measurement has so many times fewer
_SAMPLES_PER_PIECE = 10
_MAX_STEP = 0.02  # [rad or m] between tested configurations of the branch


def measure_tube(
    problem: PlanningProblem,
    options: MeasureOptions | None = None,
    progress: ProgressCallback | None = None,
) -> TubeMeasurement:
    """Measure how wide a problem's tube may be.

    For every segment: the largest radius and joint ranges around the branch along the centre line
    such that in all configurations with the tool in that capsule and the joints in those ranges
    everything keeps clear, as far as a counterexample search over many configurations can tell.
    Where a radius can only grow at the cost of a range, the needs of a fast trajectory decide. The
    problem's own radii do not count; its joint signs do. Where there are more segments than the
    options allow, those on one line that ask the same are measured as one.

    Args:
        problem: The planning problem.
        options: How to measure.
        progress: Called as each stage begins.

    Returns:
        The tube, or why there is none. (The branch along the centre line, or its surroundings,
        collide.)

    Raises:
        OptionError: The largest radius is not above the tool radius, or the segments are too many.
        ProblemError: The start or the goal is farther from the tube than the largest radius, or a
            segment has a box.
    """
    options = options or MeasureOptions()
    tube = problem.tube
    if options.max_radius <= tube.tool_radius:
        raise OptionError(
            f"max_radius is {options.max_radius:g} m; it must be above the tool radius, "
            f"{tube.tool_radius:g} m"
        )
    tube.require_discs(
        "measuring, which gives radii",
        "leave out tube.cross_section: the file's radii do not count, any will do",
    )
    clock = PlanningClock(None, progress)
    whole = problem if tube.segment_count <= options.max_segments else problem.joined
    options.require_few(whole.tube.segment_count)
    widest = whole.with_tube(whole.tube.with_radius(options.max_radius))
    try:
        found = _segments_of_some_branch(widest, options, clock)
    except Infeasible as reason:
        return TubeMeasurement(
            reason.status, str(reason), reason.place, measuring_time=clock.elapsed
        )
    # Of joined segments, each part has what was measured for all.
    segments = tuple(found[k] for k in np.searchsorted(whole.tube.numbers, tube.numbers[1:]) - 1)
    radii = np.array([segment.radius for segment in segments])
    ranges = tuple(segment.joint_ranges for segment in segments)
    measured = problem.with_tube(replace(tube, radius=radii, joint_signs=ranges))
    shown_radii = ", ".join(f"{1000 * segment.radius:.1f}" for segment in found)
    message = f"no collision found within radii of {shown_radii} mm and the joint ranges"
    return TubeMeasurement(PlanStatus.SUCCESS, message, Place(), segments, measured, clock.elapsed)


def _segments_of_some_branch(
    problem: PlanningProblem, options: MeasureOptions, clock: PlanningClock
) -> tuple[SegmentMeasurement, ...]:
    """Return what was measured around the first branch that has free space around it.

    Raises:
        Infeasible: None has; the reason is that of the first one.
    """
    branches, first = KnownBranches(problem, clock), None
    for rule in redundancy_rules(problem):
        try:
            branch = branches.by_rule(rule)
        except Infeasible as reason:
            first = first or reason
            continue
        for extra in EXTRA_CLEARANCES:
            try:
                return _segments(BranchNeighbourhood(problem, branch, options, extra), clock)
            except Infeasible as reason:
                first = first or reason
    assert first is not None
    raise first


def _segments(
    neighbourhood: "BranchNeighbourhood", clock: PlanningClock
) -> tuple[SegmentMeasurement, ...]:
    """Return what was measured around a branch.

    A first, rough measurement ignores trajectories. Then, repeatedly, a fast trajectory that may
    leave the best sets a little shows which radii and joint ranges it needs; sets with other
    compromises between them are measured and planned in. The sets of the fastest trajectory get a
    thorough counterexample search.

    Raises:
        Infeasible: Status tube_blocked.
    """
    segments, rough = range(neighbourhood.count), []
    for k in segments:
        clock.announce(Progress(f"measuring segment {k} of {neighbourhood.count}"))
        rough.append(neighbourhood.first_search(k))
    best, shortest = rough, neighbourhood.duration(rough)
    for widening in _WIDENINGS:
        needs = neighbourhood.needs_of_trajectory(best, *widening)
        for worth in _RADIUS_WORTHS:
            clock.announce(Progress(f"trading radii, worth {worth:g}, for joint ranges"))
            trade = [neighbourhood.search(k, SetPreferences(needs[k], worth)) for k in segments]
            duration = neighbourhood.duration(trade)
            if duration < shortest:
                best, shortest = trade, duration
    final = []
    for k in segments:
        clock.announce(
            Progress(f"searching for counterexamples in segment {k} of {neighbourhood.count}")
        )
        final.append(neighbourhood.described(k, neighbourhood.without_counterexamples(k, best[k])))
    return tuple(final)


class BranchNeighbourhood:
    """The surroundings of a branch, and what searches find there.

    Attributes:
        count: Number of segments.
    """

    def __init__(
        self,
        problem: PlanningProblem,
        branch: ReferenceBranch,
        options: MeasureOptions,
        extra: float = EXTRA_CLEARANCES[0],
    ) -> None:
        """Test the branch.

        Args:
            problem: The planning problem; its radii are the largest wanted.
            branch: Along the centre line.
            options: How to measure.
            extra: Extra distance beyond the clearance, unless the branch has less [m].

        Raises:
            Infeasible: Status tube_blocked: the branch itself collides.
        """
        self._problem, self._samples = problem, options.samples
        self._rough = options.samples // _ROUGH_SHARE + 1
        self._branch = [densified(q, _MAX_STEP) for q in branch.segments]
        self.count = len(self._branch)
        clearance = PairClearance(problem, 0.0)
        least = min(
            _require_clearance(problem, clearance, k, q) for k, q in enumerate(self._branch)
        )
        self._pair_clearance = PairClearance(problem, min(extra, least / 2))
        self._rngs = [np.random.default_rng([options.seed, k]) for k in range(self.count)]
        self._boxes: dict[int, CollisionBoxes] = {}

    def first_search(self, k: int) -> SegmentSearch:
        """Return what a rough search finds for a segment.

        Signs are tried before ranges, and wider surroundings before narrow ones.

        Raises:
            Infeasible: Status tube_blocked: not even the branch's own ranges are free.
        """
        problem, branch = self._problem, self._branch[k]
        whole = (problem.joint_lower[k], problem.joint_upper[k])
        tried = [
            (range_core(problem, k, branch, WANTED_RANGE), whole),
            (range_core(problem, k, branch), whole),
        ]
        if is_determined(problem.robot):
            signs = sign_bounds(problem, k, branch)
            tried.insert(0, (signs, signs))
        for core, outer in tried:
            self._boxes[k] = CollisionBoxes(problem, k, branch, core, outer, self._pair_clearance)
            found = search_segment(self._boxes[k], self._pair_clearance, self._rough, self._rngs[k])
            if isinstance(found, SegmentSearch):
                return found
        return self._unless_collision(k, found)

    def needs_of_trajectory(
        self, found: list[SegmentSearch], beyond_radius: float, beyond_range: float
    ) -> list[FloatArray | None]:
        """Return how far a fast trajectory leaves the branch, by segment; None: there is none.

        Args:
            found: Sets, which the trajectory may leave.
            beyond_radius: By how much in space [m].
            beyond_range: By how much in the joints [rad or m].
        """
        result = self._planned(found, beyond_radius, beyond_range)
        if result.trajectory is None:
            return [None] * self.count
        q = result.trajectory.per_piece(_SAMPLES_PER_PIECE).position
        tool = self._problem.robot.tool_position(q)
        nearest = self._problem.tube.distance(tool).argmin(axis=1)
        return [self._boxes[k].needed(q[nearest == k]) for k in range(self.count)]

    def search(self, k: int, preferences: SetPreferences) -> SegmentSearch:
        """Return what a rough search finds, with the collisions known so far.

        Raises:
            Infeasible: Status tube_blocked: searches for counterexamples do not end.
        """
        found = search_segment(
            self._boxes[k], self._pair_clearance, self._rough, self._rngs[k], preferences
        )
        return self._unless_collision(k, found)

    def duration(self, found: list[SegmentSearch]) -> float:
        """Return the duration of a trajectory within sets [s]; infinite where there is none."""
        duration = self._planned(found).duration
        return np.inf if duration is None else duration

    def _planned(
        self, found: list[SegmentSearch], beyond_radius: float = 0.0, beyond_range: float = 0.0
    ) -> PlanResult:
        """Return what fast planning finds within sets, or a little beyond."""
        tube, ranges = self._problem.tube, []
        for k, each in enumerate(found):
            lower = np.maximum(each.allowed.lower - beyond_range, self._problem.joint_lower[k])
            upper = np.minimum(each.allowed.upper + beyond_range, self._problem.joint_upper[k])
            ranges.append(_ranges(self._problem, lower, upper))
        radii = [each.allowed.radius + tube.tool_radius + beyond_radius for each in found]
        other = replace(tube, radius=np.array(radii), joint_signs=tuple(ranges))
        problem = self._problem.with_tube(other)
        return plan(problem, PlanOptions(quality="fast"))

    def without_counterexamples(self, k: int, found: SegmentSearch) -> SegmentSearch:
        """Return the largest set within one that a thorough counterexample search leaves.

        Raises:
            Infeasible: Status tube_blocked: searches for counterexamples do not end.
        """
        boxes, clearance, rng = self._boxes[k], self._pair_clearance, self._rngs[k]
        last = search_segment(boxes, clearance, self._samples, rng, found.preferences, found.box)
        return self._unless_collision(k, last)

    def described(self, k: int, found: SegmentSearch) -> SegmentMeasurement:
        """Return the result of a search as radius and joint ranges of a tube segment."""
        least = found.last.least_clearance
        return SegmentMeasurement(
            radius=found.allowed.radius + self._problem.tube.tool_radius,
            joint_ranges=_ranges(self._problem, found.allowed.lower, found.allowed.upper),
            bindings=_bindings(self._problem, k, found, self._pair_clearance),
            samples=found.last.samples,
            searched=found.samples,
            collisions=len(found.q),
            least_clearance=least if np.isfinite(least) else None,
        )

    def _unless_collision(self, k: int, found: SegmentSearch | Collision) -> SegmentSearch:
        if isinstance(found, SegmentSearch):
            return found
        place = _place(self._problem, k, found.q, self._pair_clearance.pairs[found.pair])
        message = (
            f"there is no free space around the branch in segment {place.segment}: within its own "
            "joint ranges "
            f"{place}, {-1000 * found.clearance:.1f} mm too close; split the segment by another "
            "reference point, or move it"
        )
        raise Infeasible(PlanStatus.TUBE_BLOCKED, message, place)


def _require_clearance(
    problem: PlanningProblem, clearance: PairClearance, k: int, q: FloatArray
) -> float:
    """Return the least clearance along a branch's segment, at most the required one [m].

    Raises:
        Infeasible: Status tube_blocked: there is none.
    """
    found = clearance.least(q, 2 * EXTRA_CLEARANCES[0])
    worst = int(found.clearance.argmin())
    least = min(float(found.clearance[worst]), 2 * EXTRA_CLEARANCES[0])
    if least <= 0:
        place = _place(problem, k, q[worst], clearance.pairs[found.pair[worst]])
        message = (
            f"the arm collides on the centre line of segment {place.segment}: {place}, "
            f"{-1000 * least:.1f} mm too close; move the reference points or choose another "
            "configuration"
        )
        raise Infeasible(PlanStatus.TUBE_BLOCKED, message, place)
    return least


def _ranges(
    problem: PlanningProblem, lower_bounds: FloatArray, upper_bounds: FloatArray
) -> dict[str, JointRange]:
    """Return the ranges tighter than the position limits, by joint name; signs as such."""
    limits, ranges = problem.robot.limits, {}
    for joint, name in enumerate(problem.robot.joint_names):
        lower, upper = float(lower_bounds[joint]), float(upper_bounds[joint])
        from_lowest = lower <= limits.lower_position[joint]
        to_highest = upper >= limits.upper_position[joint]
        if problem.robot.revolute[joint] and upper - lower >= 2 * np.pi - _ROUNDING:
            continue  # every angle
        if from_lowest and upper == 0:
            ranges[name] = (-np.inf, 0.0)
        elif to_highest and lower == 0:
            ranges[name] = (0.0, np.inf)
        elif not (from_lowest and to_highest):
            ranges[name] = (lower, upper)
    return ranges


def _bindings(
    problem: PlanningProblem, k: int, found: SegmentSearch, clearance: PairClearance
) -> tuple[Binding, ...]:
    names = problem.robot.joint_names
    bounds = [("radius", None), *(("lower", n) for n in names), *(("upper", n) for n in names)]
    return tuple(
        Binding(
            bound,
            _place(problem, k, found.q[blocker], clearance.pairs[found.pair[blocker]], joint),
            found.q[blocker],
        )
        for (bound, joint), blocker in zip(bounds, found.box.blocker, strict=True)
        if blocker >= 0
    )


def _place(
    problem: PlanningProblem, k: int, q: FloatArray, pair: Any, joint: str | None = None
) -> Place:
    links, obstacle = problem.collision.owners(pair)
    number = problem.tube.segment_number(k)
    place = Place(joint=joint, segment=number, links=links, obstacle=obstacle)
    return place.at(problem.robot.tool_position(q[None])[0])
