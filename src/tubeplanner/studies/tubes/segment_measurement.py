"""The measurement of a tube's segments around a branch; folding joints; the results."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.checks import require_between, require_count
from tubeplanner.errors import FormerName, OptionError
from tubeplanner.first_guess.branches import ReferenceBranch
from tubeplanner.geometry.tube.points import JointRange, densified
from tubeplanner.outcome import Infeasible, Location, PlanStatus
from tubeplanner.planning.options import PlanOptions
from tubeplanner.planning.result import PlanResult
from tubeplanner.planning.strategy import plan
from tubeplanner.robot.model import RobotModel
from tubeplanner.studies.tubes.clearance_bounds import PairClearance
from tubeplanner.studies.tubes.segment_search import (
    WANTED_RANGE,
    Box,
    CollisionBoxes,
    JointBounds,
    SegmentSearch,
    SetPreferences,
    pair_location,
    range_core,
)
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.text import short_repr

# ---- Options and results of measuring.


@dataclass(frozen=True)
class MeasureOptions:
    """How to measure.

    Attributes:
        max_radius: Largest radius of a segment [m].
        samples: Number of configurations of a segment that the last counterexample search draws
            without finding a collision. Time is proportional.
        seed: Of the random numbers: the same seed gives the same tube.
        max_segments: Largest number of segments, since each takes one to two seconds.
    """

    max_radius: float = 0.2
    samples: int = 12_000
    seed: int = 0
    max_segments: int = 20

    def __post_init__(self) -> None:
        require_between(self, 0, np.inf, "max_radius", unit="m")
        require_count(self, 1, "samples")
        require_count(self, 0, "seed")
        require_count(self, 1, "max_segments")

    def require_few(self, count: int) -> None:
        """Check that a tube has few enough segments to be measured.

        Raises:
            OptionError: The tube has more than `max_segments`.
        """
        if count > self.max_segments:
            raise OptionError(
                f"measure: {count} segments; at most {self.max_segments} are measured, at one to "
                "two seconds each: measure a part of the path, leave out points where it hardly "
                "turns, or allow more (max_segments, --max-segments)"
            )


@dataclass(frozen=True, eq=False)
class Binding:
    """The collision that bounds a radius or a side of a joint range."""

    bound: str  # "radius", or "lower" or "upper" side of the joint's range
    location: Location  # links and obstacle that come too close, the joint, the tool's position
    configuration: FloatArray  # the configuration of the collision, shape (n,) [rad or m]

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        location = self.location.as_dict()
        return {"bound": self.bound, **location, "configuration": self.configuration.tolist()}


@dataclass(frozen=True, eq=False)
class SegmentMeasurement:
    """The largest set found for a segment.

    Attributes:
        radius: Of the tube, the tool radius included [m].
        joint_ranges: By joint name [rad or m]; joints that need no range are left out.
        bindings: One entry per bound of the set that a collision limits.
        samples: Number of configurations tested by the last counterexample search, which found no
            collision.
        searched: Number of configurations tested by all counterexample searches for this set.
        collisions: Number of collisions found by all searches; all are outside the set now.
        least_clearance: Least distance beyond the required one in the last counterexample search
            [m]; None if no pair came near.
    """

    radius: float
    joint_ranges: Mapping[str, JointRange]
    bindings: tuple[Binding, ...]
    samples: int
    searched: int
    collisions: int
    least_clearance: float | None

    __repr__ = short_repr

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
            "attacked": self.searched,
            "collisions": self.collisions,
            "least_room": self.least_clearance,
        }


@dataclass(frozen=True, eq=False)
class TubeMeasurement:
    """The result of measuring a tube.

    Attributes:
        status: Success, or why there is no tube.
        message: One sentence.
        location: Where, if there is no tube.
        segments: One per segment; empty unless successful.
        problem: The planning problem, with the measured tube; None unless successful.
        measuring_time: Wall time from the loaded problem [s].
    """

    status: PlanStatus
    message: str
    location: Location
    segments: tuple[SegmentMeasurement, ...] = ()
    problem: PlanningProblem | None = None
    measuring_time: float = 0.0

    __repr__ = short_repr

    place = FormerName("location")

    @property
    def succeeded(self) -> bool:
        """True if there is a measured tube."""
        return self.status is PlanStatus.SUCCESS

    def as_dict(self) -> dict[str, Any]:
        """Return the fields of the command line's JSON, but for loading_time."""
        return {
            "status": str(self.status),
            "message": self.message,
            "where": self.location.as_dict(),
            "measuring_time": self.measuring_time,
            "segments": [segment.as_dict() for segment in self.segments],
        }


# ---- The surroundings of a branch, segment by segment.

# Extra distance beyond the clearance [m], in reserve for later counterexample searches: the second
# value where the first leaves nothing around the branch.
EXTRA_CLEARANCES = (1e-3, 1e-4)
_ROUNDING = 1e-9
_ROUGH_FRACTION = 12  # samples of a thorough measurement over those of a rough one
_SAMPLES_PER_PIECE = 10
_MAX_STEP = 0.02  # [rad or m] between tested configurations of the branch


# Boxes and sets of measured segments by what they depend on, kept while the segments beside are
# parted. A set serves another branch, too, if that branch lies inside.
KeptSegments: TypeAlias = dict[bytes, list[tuple[CollisionBoxes, SegmentSearch]]]


class BranchNeighbourhood:
    """The surroundings of a branch, and the sets that searches find there.

    Searches raise Infeasible, status tube_blocked, where not even the branch's own ranges are free
    or searches for counterexamples do not end.

    Attributes:
        count: Number of segments.
    """

    def __init__(
        self,
        problem: PlanningProblem,
        branch: ReferenceBranch,
        options: MeasureOptions,
        extra: float = EXTRA_CLEARANCES[0],
        checkpoint: Callable[[], None] = lambda: None,
    ) -> None:
        """Test a branch along the centre line; the problem's radii are the largest wanted.

        Sets keep an extra distance beyond the clearance, unless the branch has less [m]. A
        checkpoint, called many times, may raise to end the work.

        Raises:
            Infeasible: Status tube_blocked: the branch itself collides.
        """
        self._problem, self._samples, self._checkpoint = problem, options.samples, checkpoint
        self._rough = options.samples // _ROUGH_FRACTION + 1
        self._branch = [densified(q, _MAX_STEP) for q in branch.segments]
        self.count = len(self._branch)
        clearance, least = PairClearance(problem, 0.0), 2 * EXTRA_CLEARANCES[0]
        for k, q in enumerate(self._branch):
            nearest = clearance.least(q, 2 * EXTRA_CLEARANCES[0])
            worst = int(nearest.clearance.argmin())
            least = min(least, float(nearest.clearance[worst]))
            if least <= 0:
                location = pair_location(problem, k, q[worst], clearance.pairs[nearest.pair[worst]])
                message = (
                    f"the arm collides on the centre line of segment {location.segment}: {location}"
                    f", {-1000 * least:.1f} mm too close; move the reference points or choose "
                    "another configuration"
                )
                raise Infeasible(PlanStatus.TUBE_BLOCKED, message, location)
        self._pair_clearance = PairClearance(problem, min(extra, least / 2))
        self._rngs = [np.random.default_rng([options.seed, k]) for k in range(self.count)]
        self._boxes: dict[int, CollisionBoxes] = {}

    def require_space(self, k: int) -> None:
        """Check by a rough search that the branch's own ranges are free."""
        core = range_core(self._problem, k, self._branch[k])
        self._boxes_of(k, core, core).require_free_core(
            self._pair_clearance, self._rough, self._rngs[k]
        )

    def _boxes_of(self, k: int, core: JointBounds, outer: JointBounds) -> CollisionBoxes:
        branch, clearance = self._branch[k], self._pair_clearance
        return CollisionBoxes(self._problem, k, branch, core, outer, clearance)

    def first_search(self, k: int, part: FloatArray | None = None) -> SegmentSearch:
        """Return the result of a rough search for a segment.

        Signs are tried before ranges, and wider surroundings before narrow ones. The needs of
        configurations (N, n) decide, if known.
        """
        problem, branch = self._problem, self._branch[k]
        whole = (problem.joint_lower[k], problem.joint_upper[k])
        # Joint bounds that a set must hold and stay in, the best choice first.
        cores = [
            (range_core(problem, k, branch, WANTED_RANGE), whole),
            (range_core(problem, k, branch), whole),
        ]
        if is_determined(problem.robot):
            signs = sign_bounds(problem, k, branch)
            cores.insert(0, (signs, signs))
        for core, outer in cores:
            boxes = self._boxes[k] = self._boxes_of(k, core, outer)
            preferences = SetPreferences()
            if part is not None:
                preferences = SetPreferences(boxes.needed(part), 1.0)
            try:
                return self.search(k, preferences)
            except Infeasible as reason:
                blocked = reason
        raise blocked

    def kept_search(self, k: int, part: FloatArray, cache: KeptSegments) -> SegmentSearch:
        """Return the kept search of the same segment, or else `first_search`."""
        problem = self._problem
        # Not the extra clearance: less is tried later, and serves as well.
        bounds = problem.joint_lower[k], problem.joint_upper[k]
        key = np.concatenate([problem.tube.points[k : k + 2].ravel(), *bounds]).tobytes()
        kept = cache.setdefault(key, [])
        for boxes, search in kept:
            moved = boxes.moved_to(problem, k, search, self._branch[k])
            if moved is not None:
                self._boxes[k], search = moved
                return search
        search = self.first_search(k, part)
        kept.append((self._boxes[k], search))
        return search

    def parts(self, q: FloatArray) -> list[FloatArray]:
        """Return configurations (N, n) by the segment nearest to their tools."""
        tool = self._problem.robot.tool_position(q)
        nearest = self._problem.tube.distance(tool).argmin(axis=1)
        return [q[nearest == k] for k in range(self.count)]

    def needs_of_trajectory(
        self, sets: list[SegmentSearch], beyond_radius: float, beyond_range: float
    ) -> list[FloatArray | None]:
        """Return the extents by which a fast trajectory leaves the branch, by segment.

        The tool may leave the sets by a width [m], joints by another [rad or m]. None for all
        segments if no trajectory is found.
        """
        result = self._planned(sets, beyond_radius, beyond_range)
        q = samples_of(result)
        if q is None:
            return [None] * self.count
        return [self._boxes[k].needed(part) for k, part in enumerate(self.parts(q))]

    def search(
        self, k: int, preferences: SetPreferences, within: Box | None = None
    ) -> SegmentSearch:
        """Return the result of a search with the collisions known so far.

        A rough search; within a box a thorough one: it gives the largest set there without a
        counterexample.
        """
        samples = self._rough if within is None else self._samples
        draws = self._pair_clearance, samples, self._rngs[k]
        return self._boxes[k].search(*draws, preferences, within, self._checkpoint)

    def has_trajectory(self, sets: list[SegmentSearch]) -> bool:
        """Return True if fast planning finds a certified trajectory within sets."""
        return self._planned(sets).succeeded

    def _planned(
        self, sets: list[SegmentSearch], beyond_radius: float = 0.0, beyond_range: float = 0.0
    ) -> PlanResult:
        """Return the plan of fast planning within sets, or a little beyond."""
        tube, ranges = self._problem.tube, []
        for k, each in enumerate(sets):
            lower = np.maximum(each.allowed.lower - beyond_range, self._problem.joint_lower[k])
            upper = np.minimum(each.allowed.upper + beyond_range, self._problem.joint_upper[k])
            ranges.append(_ranges(self._problem, lower, upper))
        radii = [each.allowed.radius + tube.tool_radius + beyond_radius for each in sets]
        other = replace(tube, radius=np.array(radii), joint_signs=tuple(ranges))
        problem = self._problem.with_tube(other)
        return plan(problem, PlanOptions(quality="fast", slack=0.0, robust=False))

    def described(self, k: int, search: SegmentSearch) -> SegmentMeasurement:
        """Return the result of a search as radius and joint ranges of a tube segment."""
        problem, least = self._problem, search.last.least_clearance
        names, pairs = problem.robot.joint_names, self._pair_clearance.pairs
        bounds = [("radius", None), *(("lower", n) for n in names), *(("upper", n) for n in names)]
        bindings = []
        for (bound, joint), blocker in zip(bounds, search.box.blocker, strict=True):
            if blocker >= 0:
                q = search.q[blocker]
                location = pair_location(problem, k, q, pairs[search.pair[blocker]], joint)
                bindings.append(Binding(bound, location, q))
        return SegmentMeasurement(
            radius=search.allowed.radius + problem.tube.tool_radius,
            joint_ranges=_ranges(problem, search.allowed.lower, search.allowed.upper),
            bindings=tuple(bindings),
            samples=search.last.samples,
            searched=search.samples,
            collisions=len(search.q),
            least_clearance=least if np.isfinite(least) else None,
        )


def samples_of(result: PlanResult) -> FloatArray | None:
    """Return configurations along a planned trajectory, shape (N, n); None without one."""
    motion = result.trajectory
    return None if motion is None else motion.per_piece(_SAMPLES_PER_PIECE).position


def _ranges(
    problem: PlanningProblem, lower_bounds: FloatArray, upper_bounds: FloatArray
) -> dict[str, JointRange]:
    """Return the ranges tighter than the position limits, by joint name; signs as half-lines."""
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


# ---- The joints whose signs distinguish an arm's configurations: elbows, and joints like them.

_SAMPLES = 300
_SEED = 0
# A joint folds if at its zero the arm's least gain is below this fraction of that elsewhere.
_FOLDED_FRACTION = 0.7
_NO_GAIN = 1e-6


def is_determined(robot: RobotModel) -> bool:
    """Return True if an arm has as many joints as its tool's position has degrees of freedom."""
    jacobian = robot.tool_jacobian(_random(robot))[1][:, :3]
    rank = np.median((np.linalg.svd(jacobian, compute_uv=False) > _NO_GAIN).sum(axis=1))
    return int(rank) == robot.joint_count


@lru_cache(maxsize=16)
def folding_joints(robot: RobotModel) -> tuple[int, ...]:
    """Return the indices of the joints whose signs distinguish configurations.

    Of a two-link arm the elbow, of a UR5 elbow and second wrist joint, of a Panda the second,
    fourth and sixth joint.
    """
    q = _random(robot)
    usual, folding = _min_gain(robot, q), []
    for joint in np.flatnonzero((q.min(axis=0) < 0) & (q.max(axis=0) > 0)):
        folded = q.copy()
        folded[:, joint] = 0.0
        if _min_gain(robot, folded) < _FOLDED_FRACTION * usual:
            folding.append(int(joint))
    return tuple(folding)


def sign_bounds(
    problem: PlanningProblem, segment: int, branch: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return joint bounds, (n,) each, with the signs of folding joints along a branch."""
    lower, upper = problem.joint_lower[segment].copy(), problem.joint_upper[segment].copy()
    for joint in folding_joints(problem.robot):
        if branch[:, joint].min() >= 0:
            lower[joint] = max(lower[joint], 0.0)
        if branch[:, joint].max() <= 0:
            upper[joint] = min(upper[joint], 0.0)
    turns = problem.robot.revolute & (upper - lower > 2 * np.pi)
    middle = np.clip(branch.mean(axis=0), lower + np.pi, upper - np.pi)
    return np.where(turns, middle - np.pi, lower), np.where(turns, middle + np.pi, upper)


def _random(robot: RobotModel) -> FloatArray:
    limits = robot.limits
    lower = np.maximum(limits.lower_position, -np.pi)
    upper = np.minimum(limits.upper_position, np.pi)
    lower, upper = np.minimum(lower, upper), np.maximum(lower, upper)
    return np.random.default_rng(_SEED).uniform(lower, upper, (_SAMPLES, robot.joint_count))


def _min_gain(robot: RobotModel, q: FloatArray) -> float:
    """Return the median over (N, n) of the least gain from joints to tool over the largest.

    Only the tool's position counts if the joints suffice for no more, otherwise its rotation too.
    """
    jacobian = robot.tool_jacobian(q)[1]
    if is_determined(robot):
        jacobian = jacobian[:, :3]
    gain = np.linalg.svd(jacobian, compute_uv=False)
    least = min(robot.joint_count, gain.shape[1]) - 1
    return float(np.median(gain[:, least] / np.maximum(gain[:, 0], _NO_GAIN)))
