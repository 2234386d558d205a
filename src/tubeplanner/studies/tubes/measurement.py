"""Measure_tube: widest radii and ranges; survey_patterns: free sign patterns."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.checks import checked_options
from tubeplanner.errors import OptionError, ProblemError
from tubeplanner.first_guess.branches import (
    KnownBranches,
    RedundancyRule,
    configured_ends,
    redundancy_rules,
    reference_branch,
)
from tubeplanner.outcome import (
    Infeasible,
    Location,
    PlanningClock,
    PlanStatus,
    Progress,
    ProgressCallback,
    require_callback,
)
from tubeplanner.studies.tubes.clearance_bounds import PairClearance
from tubeplanner.studies.tubes.configuration_sets import ConfigurationSet
from tubeplanner.studies.tubes.segment_measurement import (
    EXTRA_CLEARANCES,
    BranchNeighbourhood,
    KeptSegments,
    MeasureOptions,
    SegmentMeasurement,
    TubeMeasurement,
    folding_joints,
)
from tubeplanner.studies.tubes.segment_search import SegmentSearch, SetPreferences
from tubeplanner.task.endpoints import Seed
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.text import short_repr

# ---- The width of a tube: radii and joint ranges inside which no part of the robot collides.

# Trades of radii for joint ranges: widths by which a trajectory may leave the sets found so far, to
# show its needs, [m] and [rad or m], and the worth of a radius. Within the sets found it would need
# the radii found, and the trade would have nothing to give.
_TRADES = ((0.03, np.inf, 1.0), (0.03, 0.3, 4.0))


def measure_tube(
    problem: PlanningProblem,
    options: MeasureOptions | None = None,
    progress: ProgressCallback | None = None,
) -> TubeMeasurement:
    """Measure the widest tube of a problem.

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
        The tube, or the reason why there is none, such as that the branch along the centre line or
        its surroundings collide.

    Raises:
        OptionError: The largest radius is not above the tool radius, the segments are too many, or
            an argument is of another kind.
        ProblemError: The problem is none, the start or the goal is farther from the tube than the
            largest radius, or a segment has a box.
    """
    PlanningProblem.require(problem)
    options = checked_options(options, MeasureOptions)
    return measured_tube(problem, options, PlanningClock(None, progress))


def measured_tube(
    problem: PlanningProblem,
    options: MeasureOptions,
    clock: PlanningClock,
    guide: FloatArray | None = None,
    cache: KeptSegments | None = None,
) -> TubeMeasurement:
    """Measure as `measure_tube` does, under a clock that may end the work.

    The needs of a `guide` decide, configurations (N, n) of a fast trajectory; without a guide such
    trajectories are planned. Results of segments measured before are taken from the cache.

    Raises:
        OptionError: As for `measure_tube`.
        ProblemError: As for `measure_tube`.
        TimeLimitReached: The clock's limit has passed.
    """
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
    whole = problem if tube.segment_count <= options.max_segments else problem.joined
    options.require_few(whole.tube.segment_count)
    widest = whole.with_tube(whole.tube.with_radius(options.max_radius))
    try:
        widest, _ = configured_ends(widest)
        results = _segments_of_some_branch(
            widest, options, clock, guide, {} if cache is None else cache
        )
    except Infeasible as reason:
        return TubeMeasurement(
            reason.status, str(reason), reason.location, measuring_time=clock.elapsed
        )
    # Of joined segments, each part has the result of all.
    segments = tuple(results[k] for k in np.searchsorted(whole.tube.numbers, tube.numbers[1:]) - 1)
    radii = np.array([segment.radius for segment in segments])
    ranges = tuple(segment.joint_ranges for segment in segments)
    measured = problem.with_tube(replace(tube, radius=radii, joint_signs=ranges))
    shown_radii = ", ".join(f"{1000 * segment.radius:.1f}" for segment in results)
    message = f"no collision found within radii of {shown_radii} mm and the joint ranges"
    names = (" and ".join(f"'{name}'" for name in each.links) for each in problem.contacts)
    if pairs := ", ".join(dict.fromkeys(names)):
        message += f"; not measured, since they may be in contact: {pairs}"
    return TubeMeasurement(
        PlanStatus.SUCCESS, message, Location(), segments, measured, clock.elapsed
    )


def _segments_of_some_branch(
    problem: PlanningProblem,
    options: MeasureOptions,
    clock: PlanningClock,
    guide: FloatArray | None,
    cache: KeptSegments,
) -> tuple[SegmentMeasurement, ...]:
    """Return the measured segments around the first branch with free space around it.

    Raises:
        Infeasible: No branch has free space; the reason is that of the first branch.
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
                around = BranchNeighbourhood(problem, branch, options, extra, clock.check)
                return _segments(around, clock, guide, cache)
            except Infeasible as reason:
                first = first or reason
    assert first is not None
    raise first


def _segments(
    around: BranchNeighbourhood, clock: PlanningClock, guide: FloatArray | None, cache: KeptSegments
) -> tuple[SegmentMeasurement, ...]:
    """Return the measured segments around a branch.

    Quick refusals come before long searches. A first, rough measurement ignores trajectories. A
    fast trajectory that may leave its sets a little then shows the radii and joint ranges that it
    needs, and sets with another compromise between these are measured; once more where nothing can
    be planned in the new sets. The sets that suit it best get a thorough counterexample search.

    Raises:
        Infeasible: Status tube_blocked.
    """
    for k in range(around.count):
        around.require_space(k)
    best: list[SegmentSearch] = []
    segments, parts = range(around.count), None if guide is None else around.parts(guide)
    for k in segments:
        clock.announce(Progress(f"measuring segment {k + 1} of {around.count}"))
        if parts is None:
            best.append(around.first_search(k))
        else:  # sets for the needs of the trajectory, as far as there is space
            best.append(around.kept_search(k, parts[k], cache))
    trades = _TRADES if guide is None and any(each.box.has_choice for each in best) else ()
    for beyond_radius, beyond_range, worth in trades:
        needs = around.needs_of_trajectory(best, beyond_radius, beyond_range)
        clock.announce(Progress(f"trading radii, worth {worth:g}, for joint ranges"))
        trade = [around.search(k, SetPreferences(needs[k], worth)) for k in segments]
        if around.has_trajectory(trade):
            best = trade
            break
    final = []
    for k, search in enumerate(best):
        clock.announce(
            Progress(f"searching for counterexamples in segment {k + 1} of {around.count}")
        )
        final.append(around.described(k, around.search(k, search.preferences, search.box)))
    return tuple(final)


# ---- Reachable and free sign patterns of an arm along each segment of a tube.
#
# The signs of the joints that fold distinguish configurations: elbow up or down, and the like.

_SEEDS, _SAMPLES = 24, 600  # configurations from which to search for a branch, of these samples
_NEAR_LINE = 0.01  # [m]
_FREE_BRANCHES = 2  # free branches that are measured at most; the best counts


@dataclass(frozen=True, eq=False)
class PatternRow:
    """A sign pattern in a segment."""

    segment: int  # index of the segment
    signs: Mapping[str, str]  # "+" or "-" by joint name
    reachable: bool  # True if the arm can follow the centre line with these signs
    free: bool  # True if the arm can do so without a collision
    radius: float | None  # the best radius of a rough measurement [m]; None unless free
    message: str  # the reason, where the pattern is not free

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return {**vars(self), "signs": dict(self.signs)}


@dataclass(frozen=True, eq=False)
class PatternSurvey:
    """Sign patterns of all segments.

    Attributes:
        rows: One for every segment and pattern.
        suggested: The pattern, the same in all segments, whose smallest radius is largest; None if
            no pattern is free in all segments.
    """

    rows: tuple[PatternRow, ...]
    suggested: Mapping[str, str] | None

    __repr__ = short_repr

    @property
    def message(self) -> str:
        """The suggestion, as a sentence."""
        if self.suggested is None:
            return "no sign pattern is free in all segments"
        if not self.suggested:
            return "no joint of this arm folds: there are no signs to choose"
        signs = ", ".join(f'{name}: "{sign}"' for name, sign in self.suggested.items())
        return f"suggested joint_signs: {{{signs}}}"

    def as_dict(self) -> dict[str, Any]:
        """Return the fields of the command line's JSON, but for loading_time."""
        is_blocked = self.suggested is None
        return {
            "status": str(PlanStatus.TUBE_BLOCKED if is_blocked else PlanStatus.SUCCESS),
            "message": self.message,
            "suggested": None if self.suggested is None else dict(self.suggested),
            "configurations": [row.as_dict() for row in self.rows],
        }


def survey_patterns(
    problem: PlanningProblem,
    options: MeasureOptions | None = None,
    progress: ProgressCallback | None = None,
) -> PatternSurvey:
    """Find the reachable and the free sign patterns in each segment of a tube.

    Ignores the file's signs of folding joints, its start and its goal; its ranges of other joints
    count.

    Args:
        problem: The planning problem.
        options: How to measure.
        progress: Called as each pattern begins.

    Raises:
        OptionError: There are too many segments, or an argument is of another kind.
        ProblemError: The problem is none, or a segment has a box.
    """
    PlanningProblem.require(problem)
    options = checked_options(options, MeasureOptions)
    require_callback(progress)
    problem.tube.require_discs("measuring, which gives radii", "leave out tube.cross_section")
    options.require_few(problem.tube.segment_count)
    names = [problem.robot.joint_names[joint] for joint in folding_joints(problem.robot)]
    patterns = [dict(zip(names, signs, strict=True)) for signs in product("+-", repeat=len(names))]
    rows = []
    for k in range(problem.tube.segment_count):
        of_all = f"segment {k + 1} of {problem.tube.segment_count}"
        for number, signs in enumerate(patterns, start=1):
            if progress is not None:
                progress(Progress(f"{of_all}, sign pattern {number} of {len(patterns)}"))
            rows.append(_row(problem, k, signs, options))

    def least(signs: Mapping[str, str]) -> float:
        return min(row.radius or 0.0 for row in rows if row.signs == signs)

    best = max(patterns, key=least)
    return PatternSurvey(tuple(rows), best if least(best) > 0 else None)


def _row(
    problem: PlanningProblem, k: int, signs: Mapping[str, str], options: MeasureOptions
) -> PatternRow:
    reachable, why, radii = False, "", []
    for alone in _posed(problem, k, signs, options):
        try:
            branch = reference_branch(alone, RedundancyRule.AS_NEEDED)
            reachable = True
            search = BranchNeighbourhood(alone, branch, options).first_search(0)
            radii.append(search.allowed.radius + problem.tube.tool_radius)
        except Infeasible as reason:
            if reachable or not why:
                why = f"{reason.status}: {replace(reason.location, segment=k)}"
        if len(radii) == _FREE_BRANCHES:
            break
    radius = max(radii, default=None)
    return PatternRow(k, signs, reachable, bool(radii), radius, "" if radii else why)


def _posed(
    problem: PlanningProblem, k: int, signs: Mapping[str, str], options: MeasureOptions
) -> Iterator[PlanningProblem]:
    """Yield the problem of a segment alone, with a pattern's signs, from random seeds.

    Seeds are near the centre line, free seeds first.
    """
    tube, rng = problem.tube, np.random.default_rng([options.seed, k])
    signs_alone = ({**tube.joint_ranges[k], **signs},)
    widest = tube.with_points([k, k + 1], [k]).with_radius(options.max_radius)
    try:
        alone = problem.along(
            replace(widest, joint_signs=signs_alone),
            Seed(problem.robot.limits.clip(np.zeros(problem.robot.joint_count))),
        )
    except ProblemError:  # the position limits leave no value with such a sign
        return
    # Joint bounds narrowed to one turn about zero, as far as the joints have it.
    lower = np.maximum(alone.joint_lower[0], np.minimum(-np.pi, alone.joint_upper[0] - 2 * np.pi))
    upper = np.minimum(alone.joint_upper[0], lower + 2 * np.pi)
    q = ConfigurationSet(alone, 0, lower, upper, _NEAR_LINE).sample(_SAMPLES, rng)
    free = PairClearance(alone, 0.0).least(q, 0.0).clearance > 0
    order = np.argsort(~free, kind="stable")
    for seed in q[order[:_SEEDS]]:
        yield problem.along(alone.tube, Seed(seed))
