"""How wide a tube may be: radii and joint ranges inside which no part of the robot collides."""

from dataclasses import replace

import numpy as np

from tubeplanner.arguments import given_options
from tubeplanner.arrays import FloatArray
from tubeplanner.branches.configured_ends import configured_ends
from tubeplanner.branches.known_branches import KnownBranches
from tubeplanner.branches.reference_branch import redundancy_rules
from tubeplanner.errors import OptionError
from tubeplanner.measurement.branch_neighbourhood import EXTRA_CLEARANCES, BranchNeighbourhood
from tubeplanner.measurement.kept_segments import KeptSegments
from tubeplanner.measurement.measured_tube import (
    MeasureOptions,
    SegmentMeasurement,
    TubeMeasurement,
)
from tubeplanner.measurement.segment_measurement import SegmentSearch, SetPreferences
from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.progress import PlanningClock, Progress, ProgressCallback

# Trades of radii for joint ranges: how far a trajectory may leave the sets found so far, to say
# what it needs, [m] and [rad or m], and what a radius is worth. In sets that are no wider than what
# was found, it asks for the radii found, and the trade has nothing to give.
_TRADES = ((0.03, np.inf, 1.0), (0.03, 0.3, 4.0))


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
        OptionError: The largest radius is not above the tool radius, the segments are too many, or
            an argument is of another kind.
        ProblemError: The problem is none, the start or the goal is farther from the tube than the
            largest radius, or a segment has a box.
    """
    PlanningProblem.require(problem)
    options = given_options(options, MeasureOptions)
    return measured_tube(problem, options, PlanningClock(None, progress))


def measured_tube(
    problem: PlanningProblem,
    options: MeasureOptions,
    clock: PlanningClock,
    way: FloatArray | None = None,
    kept: KeptSegments | None = None,
) -> TubeMeasurement:
    """Measure as `measure_tube` does, under a clock.

    Args:
        problem: The planning problem.
        options: How to measure.
        clock: Announces progress and may end the work.
        way: Configurations of a fast trajectory, shape (N, n): then its needs decide, and no other
            one is planned.
        kept: Segments that were measured before, and that are from now on.

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
        found = _segments_of_some_branch(widest, options, clock, way, kept or KeptSegments())
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
    message += _left_out(problem)
    return TubeMeasurement(PlanStatus.SUCCESS, message, Place(), segments, measured, clock.elapsed)


def _left_out(problem: PlanningProblem) -> str:
    """Return what a message adds on pairs in contact, of which a measured tube claims nothing."""
    names = (" and ".join(f"'{name}'" for name in each.links) for each in problem.contacts)
    pairs = ", ".join(dict.fromkeys(names))
    return f"; not measured, since they may be in contact: {pairs}" if pairs else ""


def _segments_of_some_branch(
    problem: PlanningProblem,
    options: MeasureOptions,
    clock: PlanningClock,
    way: FloatArray | None,
    kept: KeptSegments,
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
                around = BranchNeighbourhood(problem, branch, options, extra, clock.check)
                return _segments(around, clock, way, kept)
            except Infeasible as reason:
                first = first or reason
    assert first is not None
    raise first


def _segments(
    around: BranchNeighbourhood,
    clock: PlanningClock,
    way: FloatArray | None,
    kept: KeptSegments,
) -> tuple[SegmentMeasurement, ...]:
    """Return what was measured around a branch.

    What is blocked at once comes before what takes time. The sets that suit a fast trajectory best
    get a thorough counterexample search.

    Raises:
        Infeasible: Status tube_blocked.
    """
    for k in range(around.count):
        around.require_space(k)
    best = _traded(around, clock) if way is None else _suited(around, clock, way, kept)
    final = []
    for k, found in enumerate(best):
        clock.announce(
            Progress(f"searching for counterexamples in segment {k + 1} of {around.count}")
        )
        final.append(around.described(k, around.without_counterexamples(k, found)))
    return tuple(final)


def _suited(
    around: BranchNeighbourhood, clock: PlanningClock, way: FloatArray, kept: KeptSegments
) -> list[SegmentSearch]:
    """Return sets that have what a trajectory (N, n) needs, as far as there is space.

    Raises:
        Infeasible: Status tube_blocked.
    """
    found = []
    for k, part in enumerate(around.parts(way)):
        clock.announce(Progress(f"measuring segment {k + 1} of {around.count}"))
        found.append(around.kept_search(k, part, kept))
    return found


def _traded(around: BranchNeighbourhood, clock: PlanningClock) -> list[SegmentSearch]:
    """Return sets that suit a fast trajectory.

    A first, rough measurement ignores trajectories. A fast one that may leave its sets a little
    then shows which radii and joint ranges it needs, and sets with another compromise between them
    are measured; once more where nothing can be planned in these.

    Raises:
        Infeasible: Status tube_blocked.
    """
    segments, rough = range(around.count), []
    for k in segments:
        clock.announce(Progress(f"measuring segment {k + 1} of {around.count}"))
        rough.append(around.first_search(k))
    for beyond_radius, beyond_range, worth in _TRADES if around.has_trades(rough) else ():
        needs = around.needs_of_trajectory(rough, beyond_radius, beyond_range)
        clock.announce(Progress(f"trading radii, worth {worth:g}, for joint ranges"))
        trade = [around.search(k, SetPreferences(needs[k], worth)) for k in segments]
        if around.has_trajectory(trade):
            return trade
    return rough
