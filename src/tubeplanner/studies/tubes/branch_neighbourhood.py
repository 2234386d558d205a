"""The surroundings of a branch, segment by segment; folding joints.

Where a folding joint is at zero, the arm is nearer to a singularity than elsewhere: there two
configurations with the same tool position meet.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.first_guess.branches import ReferenceBranch
from tubeplanner.geometry.tube.points import densified
from tubeplanner.geometry.tube.segment_values import JointRange
from tubeplanner.outcome import Infeasible, Location, PlanStatus
from tubeplanner.planning.options import PlanOptions
from tubeplanner.planning.result import PlanResult
from tubeplanner.planning.strategy import plan
from tubeplanner.robot.model import RobotModel
from tubeplanner.studies.tubes.clearance_bounds import PairClearance
from tubeplanner.studies.tubes.measurement_result import Binding, MeasureOptions, SegmentMeasurement
from tubeplanner.studies.tubes.segment_search import (
    WANTED_RANGE,
    Box,
    Collision,
    CollisionBoxes,
    KeptSegments,
    SegmentSearch,
    SetPreferences,
    range_core,
    search_core,
    search_segment,
)
from tubeplanner.task.problem import PlanningProblem

# Extra distance beyond the clearance [m], in reserve for later counterexample searches: the second
# value where the first leaves nothing around the branch.
EXTRA_CLEARANCES = (1e-3, 1e-4)
_ROUNDING = 1e-9
_ROUGH_FRACTION = 12  # samples of a thorough measurement over those of a rough one
_SAMPLES_PER_PIECE = 10
_MAX_STEP = 0.02  # [rad or m] between tested configurations of the branch


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
        """Test the branch.

        Args:
            problem: The planning problem; its radii are the largest wanted.
            branch: Along the centre line.
            options: How to measure.
            extra: Extra distance beyond the clearance, unless the branch has less [m].
            checkpoint: Called many times; it may raise to end the work.

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
                location = _place(problem, k, q[worst], clearance.pairs[nearest.pair[worst]])
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
        boxes = CollisionBoxes(self._problem, k, self._branch[k], core, core, self._pair_clearance)
        collision = search_core(boxes, self._pair_clearance, self._rough, self._rngs[k])
        if collision is not None:
            self._unless_collision(k, collision)

    def first_search(self, k: int, part: FloatArray | None = None) -> SegmentSearch:
        """Return the result of a rough search for a segment.

        Signs are tried before ranges, and wider surroundings before narrow ones.

        Args:
            k: Index of the segment.
            part: Configurations (N, n) whose needs decide; None: not known.
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
            boxes = CollisionBoxes(problem, k, branch, core, outer, self._pair_clearance)
            self._boxes[k] = boxes
            preferences = SetPreferences()
            if part is not None:
                preferences = SetPreferences(boxes.needed(part), 1.0)
            result = self._searched(k, self._rough, preferences)
            if isinstance(result, SegmentSearch):
                return result
        return self._unless_collision(k, result)

    def kept_search(self, k: int, part: FloatArray, cache: KeptSegments) -> SegmentSearch:
        """Return the kept search of the same segment, or else `first_search`."""
        problem, key = self._problem, self._key(k)
        cached = cache.around(key, problem, k, self._branch[k])
        if cached is not None:
            self._boxes[k], search = cached
            return search
        search = self.first_search(k, part)
        cache.keep(key, self._boxes[k], search)
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

        None for all segments if no trajectory is found.

        Args:
            sets: Sets, which the trajectory may leave.
            beyond_radius: Width by which the tool may leave them [m].
            beyond_range: Width by which joints may leave them [rad or m].
        """
        result = self._planned(sets, beyond_radius, beyond_range)
        if result.trajectory is None:
            return [None] * self.count
        q = result.trajectory.per_piece(_SAMPLES_PER_PIECE).position
        return [self._boxes[k].needed(part) for k, part in enumerate(self.parts(q))]

    def search(self, k: int, preferences: SetPreferences) -> SegmentSearch:
        """Return the result of a rough search, with the collisions known so far."""
        return self._unless_collision(k, self._searched(k, self._rough, preferences))

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

    def without_counterexamples(self, k: int, search: SegmentSearch) -> SegmentSearch:
        """Return the largest set within another that a thorough counterexample search leaves."""
        last = self._searched(k, self._samples, search.preferences, search.box)
        return self._unless_collision(k, last)

    def described(self, k: int, search: SegmentSearch) -> SegmentMeasurement:
        """Return the result of a search as radius and joint ranges of a tube segment."""
        problem, least = self._problem, search.last.least_clearance
        names, pairs = problem.robot.joint_names, self._pair_clearance.pairs
        bounds = [("radius", None), *(("lower", n) for n in names), *(("upper", n) for n in names)]
        bindings = []
        for (bound, joint), blocker in zip(bounds, search.box.blocker, strict=True):
            if blocker >= 0:
                q = search.q[blocker]
                location = _place(problem, k, q, pairs[search.pair[blocker]], joint)
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

    def _key(self, k: int) -> bytes:
        """Return all that a segment's measurement depends on, beside its branch.

        Not the extra clearance: less is tried later, and serves as well.
        """
        problem = self._problem
        bounds = problem.joint_lower[k], problem.joint_upper[k]
        return np.concatenate([problem.tube.points[k : k + 2].ravel(), *bounds]).tobytes()

    def _searched(
        self, k: int, samples: int, preferences: SetPreferences, within: Box | None = None
    ) -> SegmentSearch | Collision:
        return search_segment(
            self._boxes[k],
            self._pair_clearance,
            samples,
            self._rngs[k],
            preferences,
            within,
            self._checkpoint,
        )

    def _unless_collision(self, k: int, result: SegmentSearch | Collision) -> SegmentSearch:
        if isinstance(result, SegmentSearch):
            return result
        location = _place(self._problem, k, result.q, self._pair_clearance.pairs[result.pair])
        message = (
            f"there is no free space around the branch in segment {location.segment}: within its "
            f"own joint ranges {location}, {-1000 * result.clearance:.1f} mm too close; split the "
            "segment by another reference point, or move it"
        )
        raise Infeasible(PlanStatus.TUBE_BLOCKED, message, location)


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


def _place(
    problem: PlanningProblem, k: int, q: FloatArray, pair: Any, joint: str | None = None
) -> Location:
    links, obstacle = problem.collision.owners(pair)
    number = problem.tube.segment_number(k)
    location = Location(joint=joint, segment=number, links=links, obstacle=obstacle)
    return location.at(problem.robot.tool_position(q[None])[0])


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
