"""How wide a tube may be: radii and joint ranges inside which no part of the robot collides."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import OptionError
from tubeplanner.known_branches import KnownBranches
from tubeplanner.link_room import LinkRoom
from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.problem import PlanningProblem
from tubeplanner.progress import PlanningClock, Progress, ProgressCallback
from tubeplanner.reference_branch import ReferenceBranch, spare_joint_rules
from tubeplanner.segment_measurement import (
    Blocked,
    CollisionBoxes,
    SegmentSearch,
    search_segment,
)
from tubeplanner.segment_walk import as_position
from tubeplanner.tube import JointRange, Tube

# Room asked for beside the clearance [m], unless the branch itself has less: what a later attack
# may find beyond what was found here.
_EXTRA_ROOM = 1e-3
_LONGEST_STEP = 0.02  # [rad or m] between configurations at which the branch is looked at


@dataclass(frozen=True)
class MeasureOptions:
    """How to measure.

    Attributes:
        max_radius: No segment gets a larger radius [m].
        samples: How many configurations of a segment the last attack draws, which must find
            nothing. Time is in proportion.
        seed: Of the random numbers: the same seed gives the same tube.
    """

    max_radius: float = 0.2
    samples: int = 20_000
    seed: int = 0

    def __post_init__(self) -> None:
        if not 0 < self.max_radius < np.inf:
            raise OptionError(f"max_radius is {self.max_radius:g} m; it must be > 0 and finite")
        if not self.samples >= 1:
            raise OptionError(f"samples is {self.samples}; it must be >= 1")
        if not self.seed >= 0:
            raise OptionError(f"seed is {self.seed}; it must be >= 0")


@dataclass(frozen=True, eq=False)
class Binding:
    """What keeps a radius or one side of a joint range from being larger.

    Attributes:
        bound: "radius", or "lower" or "upper" side of the joint's range.
        place: Links and obstacle that come too close, the joint, and where the hand is then.
        configuration: In which they do, shape (n,) [rad or m].
    """

    bound: str
    place: Place
    configuration: FloatArray

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        place = self.place.as_dict()
        return {"bound": self.bound, **place, "configuration": self.configuration.tolist()}


@dataclass(frozen=True, eq=False)
class SegmentMeasurement:
    """The largest set found for one segment.

    Attributes:
        radius: Of the tube, the tool radius included [m].
        joint_ranges: By joint name [rad or m]; joints that need no range are left out.
        bindings: What ends the set, one entry per bound that something ends.
        samples: How many configurations the last attack drew; it found no collision.
        attacked: How many all attacks drew.
        collisions: How many collisions they found, all outside the set now.
        least_room: The least distance beyond what is required that the last attack found [m]; None
            if nothing came near.
    """

    radius: float
    joint_ranges: Mapping[str, JointRange]
    bindings: tuple[Binding, ...]
    samples: int
    attacked: int
    collisions: int
    least_room: float | None

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as JSON values; sides of ranges without an end are null."""
        ranges = {
            name: [bound if np.isfinite(bound) else None for bound in pair]
            for name, pair in self.joint_ranges.items()
        }
        return {
            "radius": self.radius,
            "joint_ranges": ranges,
            "bindings": [binding.as_dict() for binding in self.bindings],
            "samples": self.samples,
            "attacked": self.attacked,
            "collisions": self.collisions,
            "least_room": self.least_room,
        }


@dataclass(frozen=True, eq=False)
class TubeMeasurement:
    """What came of measuring a tube.

    Attributes:
        status: Success, or why there is no tube.
        message: One sentence.
        place: Where, if there is no tube.
        segments: One per segment; empty unless successful.
        problem: What was asked, with the measured tube; None unless successful.
        measuring_time: Wall time from the loaded problem [s].
    """

    status: PlanStatus
    message: str
    place: Place
    segments: tuple[SegmentMeasurement, ...] = ()
    problem: PlanningProblem | None = None
    measuring_time: float = 0.0

    @property
    def succeeded(self) -> bool:
        """Whether there is a measured tube."""
        return self.status is PlanStatus.SUCCESS

    def as_dict(self) -> dict[str, Any]:
        """Return the fields of the command line's JSON, but for loading_time."""
        return {
            "status": str(self.status),
            "message": self.message,
            "where": self.place.as_dict(),
            "measuring_time": self.measuring_time,
            "segments": [segment.as_dict() for segment in self.segments],
        }


def measure_tube(
    problem: PlanningProblem,
    options: MeasureOptions | None = None,
    progress: ProgressCallback | None = None,
) -> TubeMeasurement:
    """Measure how wide a problem's tube may be.

    For every segment: the largest radius and joint ranges around the branch along the centre line
    such that in all configurations with the hand in that capsule and the joints in those ranges
    everything keeps clear, as far as an attack of many configurations can tell. The problem's own
    radii do not count; its joint signs do.

    Args:
        problem: What is asked.
        options: How to measure.
        progress: Called as each stage begins.

    Returns:
        The tube, or why there is none: the branch along the centre line, or its surroundings,
        collide.

    Raises:
        OptionError: The largest radius is not above the tool radius.
        ProblemError: The start or the goal is farther from the tube than the largest radius.
    """
    options = options or MeasureOptions()
    tube = problem.tube
    if options.max_radius <= tube.tool_radius:
        raise OptionError(
            f"max_radius is {options.max_radius:g} m; it must be above the tool radius, "
            f"{tube.tool_radius:g} m"
        )
    clock = PlanningClock(None, progress)
    widest = problem.with_tube(tube.with_radius(options.max_radius))
    try:
        segments = _segments_of_some_branch(widest, options, clock)
    except Infeasible as reason:
        return TubeMeasurement(
            reason.status, str(reason), reason.place, measuring_time=clock.elapsed
        )
    ranges = [segment.joint_ranges for segment in segments]
    measured = problem.with_tube(_tube(tube, [segment.radius for segment in segments], ranges))
    radii = ", ".join(f"{1000 * segment.radius:.1f}" for segment in segments)
    message = f"no collision found within radii of {radii} mm and the joint ranges"
    return TubeMeasurement(
        PlanStatus.SUCCESS, message, Place(), segments, measured, clock.elapsed
    )


def _tube(tube: Tube, radii: list[float], ranges: list[Mapping[str, JointRange]]) -> Tube:
    return Tube(
        tube.points,
        radii,
        tool_radius=tube.tool_radius,
        joint_signs=ranges,
        visit=tube.visit,
        orientations=tube.orientations,
        rotation_tolerance=tube.rotation_tolerance,
    )


def _segments_of_some_branch(
    problem: PlanningProblem, options: MeasureOptions, clock: PlanningClock
) -> tuple[SegmentMeasurement, ...]:
    """Return what was measured around the first branch that has room around it.

    Raises:
        Infeasible: None has; the reason is that of the first one.
    """
    branches, first = KnownBranches(problem, clock), None
    for rule in spare_joint_rules(problem):
        try:
            return _segments(problem, branches.along(rule), options, clock)
        except Infeasible as reason:
            first = first or reason
    assert first is not None
    raise first


def _segments(
    problem: PlanningProblem,
    branch: ReferenceBranch,
    options: MeasureOptions,
    clock: PlanningClock,
) -> tuple[SegmentMeasurement, ...]:
    dense = [_dense(q) for q in branch.segments]
    room = LinkRoom(problem, 0.0)
    least = min(_require_room(problem, room, k, q) for k, q in enumerate(dense))
    room = LinkRoom(problem, min(_EXTRA_ROOM, least / 2))
    found = []
    for k, q in enumerate(dense):
        clock.announce(Progress(f"measuring segment {k} of {len(dense)}"))
        found.append(_measured(problem, k, q, room, options))
    return tuple(found)


def _dense(q: FloatArray) -> FloatArray:
    """Return configurations (P, n) with others between them, evenly, so that steps are short."""
    parts = [q[:1]]
    for begin, end in pairwise(q):
        steps = max(1, int(np.ceil(abs(end - begin).max() / _LONGEST_STEP)))
        share = np.linspace(0, 1, steps + 1)[1:, None]
        parts.append((1 - share) * begin + share * end)
    return np.concatenate(parts)


def _require_room(problem: PlanningProblem, room: LinkRoom, k: int, q: FloatArray) -> float:
    """Return the least room along a branch's segment, at most what is asked for anyway [m].

    Raises:
        Infeasible: Status tube_blocked: there is none.
    """
    found = room.least(q, 2 * _EXTRA_ROOM)
    worst = int(found.room.argmin())
    least = min(float(found.room[worst]), 2 * _EXTRA_ROOM)
    if least <= 0:
        place = _place(problem, k, q[worst], room.pairs[found.pair[worst]])
        message = (
            f"the arm collides on the centre line of segment {k}: {place}, {-1000 * least:.1f} mm "
            "too close; move the reference points or choose another configuration"
        )
        raise Infeasible(PlanStatus.TUBE_BLOCKED, message, place)
    return least


def _measured(
    problem: PlanningProblem, k: int, branch: FloatArray, room: LinkRoom, options: MeasureOptions
) -> SegmentMeasurement:
    rng = np.random.default_rng([options.seed, k])
    radius = float(problem.tube.effective_radius[k])
    found = search_segment(
        CollisionBoxes(problem, k, branch, radius, room), room, options.samples, rng
    )
    if isinstance(found, Blocked):
        place = _place(problem, k, found.q, room.pairs[found.pair])
        message = (
            f"there is no room around the branch in segment {k}: within its own joint ranges "
            f"{place}, {-1000 * found.room:.1f} mm too close; split the segment by another "
            "reference point, or move it"
        )
        raise Infeasible(PlanStatus.TUBE_BLOCKED, message, place)
    least = found.last.least_room
    return SegmentMeasurement(
        radius=found.allowed.radius + problem.tube.tool_radius,
        joint_ranges=_ranges(problem, found),
        bindings=_bindings(problem, k, found, room),
        samples=found.last.samples,
        attacked=found.samples,
        collisions=len(found.q),
        least_room=least if np.isfinite(least) else None,
    )


def _ranges(problem: PlanningProblem, found: SegmentSearch) -> dict[str, JointRange]:
    """Return the ranges that say more than the position limits, by joint name; signs as such."""
    limits, ranges = problem.robot.limits, {}
    for joint, name in enumerate(problem.robot.joint_names):
        lower, upper = float(found.allowed.lower[joint]), float(found.allowed.upper[joint])
        from_lowest = lower <= limits.lower_position[joint]
        to_highest = upper >= limits.upper_position[joint]
        if from_lowest and upper == 0:
            ranges[name] = (-np.inf, 0.0)
        elif to_highest and lower == 0:
            ranges[name] = (0.0, np.inf)
        elif not (from_lowest and to_highest):
            ranges[name] = (lower, upper)
    return ranges


def _bindings(
    problem: PlanningProblem, k: int, found: SegmentSearch, room: LinkRoom
) -> tuple[Binding, ...]:
    names = problem.robot.joint_names
    bounds = [("radius", None), *(("lower", n) for n in names), *(("upper", n) for n in names)]
    return tuple(
        Binding(
            bound,
            _place(problem, k, found.q[blocker], room.pairs[found.pair[blocker]], joint),
            found.q[blocker],
        )
        for (bound, joint), blocker in zip(bounds, found.box.blocker, strict=True)
        if blocker >= 0
    )


def _place(
    problem: PlanningProblem, k: int, q: FloatArray, pair: Any, joint: str | None = None
) -> Place:
    links, obstacle = problem.collision.owners(pair)
    hand = as_position(problem.robot.tool_position(q[None])[0])
    return Place(joint=joint, segment=k, links=links, obstacle=obstacle, position=hand)
