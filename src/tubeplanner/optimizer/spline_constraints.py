"""SplineConstraints: all constraints of a spline at samples, and the samples added to them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import chain, pairwise
from typing import TypeAlias

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.geometry.tube.bands import REQUIRED
from tubeplanner.geometry.tube.points import arc_lengths
from tubeplanner.limits.holding_limit import HoldingLimit
from tubeplanner.limits.joint_efforts import SidedEffort
from tubeplanner.limits.path_samples import (
    FRICTION_PIECES,
    CoulombFriction,
    LimitKey,
    PathSamples,
    SpeedLimit,
    blended_friction,
)
from tubeplanner.limits.rates import RATES, JointRate
from tubeplanner.limits.speed_limits import speed_limits
from tubeplanner.optimizer.cone_constraints import (
    LEAST_AT_REST,
    EvaluatedCones,
    evaluated_cones,
)
from tubeplanner.optimizer.link_constraints import EvaluatedLinks, LinkConstraints
from tubeplanner.optimizer.phased_spline import (
    EvaluationPoints,
    KnotGrid,
    PhasedSpline,
    SampledSpline,
    Samples,
    VelocityHull,
    sampled,
)
from tubeplanner.optimizer.region_constraints import (
    EvaluatedRegions,
    EvaluatedRotation,
    evaluated_ball,
    evaluated_points,
    evaluated_rotation,
    evaluated_speeds,
    goal_keys,
)
from tubeplanner.optimizer.rows import (
    INNER_MARGIN,
    NO_LIMIT,
    EvaluatedSpeedLimit,
    Rows,
    StepSize,
)
from tubeplanner.optimizer.speed_floors import EvaluatedFloor, EvaluatedGates
from tubeplanner.optimizer.tube_phases import OrderedSegments, largest_kink
from tubeplanner.task.problem import PlanningProblem

# ---- All constraints of a spline at samples.

# Samples per knot interval. Accelerations are straight lines there and jerks constant; other limits
# than these and velocities depend on the configuration.
_RATE_SAMPLES = np.zeros(1)
_CONFIGURATION_SAMPLES = np.arange(2) / 2
_JUMP_SAMPLES = np.arange(3) / 2  # at knots, where jerks jump, on both sides
_TUBE_SAMPLES = np.arange(3) / 3
_DENSE_SAMPLES = np.linspace(0, 1, 21)
# Where samples are added to the tube's on either side of an instant, in their spacings.
_BESIDE = np.array([-0.75, -0.5, -0.25, 0.25, 0.5, 0.75])
# Samples may lie this much farther apart than on average; and the largest margin for kinks between
# them, in radii.
_UNEVEN, _MAX_FOR_KINKS = 2, 0.03
# Over about this number of knot intervals the Coulomb friction of one direction is blended into the
# other's: first, and in the end.
WIDELY_BLENDED, BLENDED = 12.0, 5.0
# Peaks of the squared duration between samples that count.
_HIGHER, _HIGHER_IN_A_GIVEN_DURATION = 1.001, 1.0002

_SMALL_RISE = 1e-4  # for differences

# The constraints other than regions.
EvaluatedRows: TypeAlias = (
    EvaluatedSpeedLimit | EvaluatedRotation | EvaluatedFloor | EvaluatedGates | EvaluatedLinks
)


@dataclass(frozen=True, eq=False)
class Iterate:
    """A spline, its duration, and its constraints at samples."""

    spline: PhasedSpline  # control points and switching times
    squared_duration: float  # the least T^2 that the limits allow at the samples [s^2]
    duration: float  # T in which it is run [s]
    # largest violation by tool or links, >= 0: of the tool in radii or rotation tolerances beyond
    # the narrowed tube, of links in units of 5 cm
    excess: float
    limits: tuple[EvaluatedSpeedLimit, ...]  # the limits on its speed
    # the regions of the tool's position, and of its rotation angle where bounded
    regions: tuple[EvaluatedRegions, ...]
    # the velocities of the tool and of points whose speed is limited
    speeds: tuple[EvaluatedRegions, ...]
    # the cones of held parts
    cones: tuple[EvaluatedCones, ...]
    # the bounds on the components of the tool's rotation, where there are some
    rotations: tuple[EvaluatedRotation, ...]
    # the rotation beyond kinks of its reference, and efforts beyond those of friction
    rotation_kinks: tuple[EvaluatedRotation, ...]
    friction_kinks: tuple[EvaluatedSpeedLimit, ...]
    # the floors of the tool's speed where they are kept, and the gates of stretches
    pace: tuple[EvaluatedFloor | EvaluatedGates, ...]
    links: EvaluatedLinks  # the watched pairs of links
    # the spline and the arm at two samples per knot interval, at the end of every phase, and at
    # added samples
    watched: tuple[SampledSpline, PathSamples]
    # the spline and the arm at the beginning of every knot interval and the end of every phase
    rates: tuple[SampledSpline, PathSamples]

    @property
    def constraints(self) -> tuple[EvaluatedRows, ...]:
        """All constraints but regions, in the order in which their rows are numbered."""
        components = (each for each in self.rotation_kinks if each.bounds_components)
        others = (*components, *self.friction_kinks, *self.pace)
        return (*self.limits, *self.rotations, *others, self.links)

    @cached_property
    def convex(self) -> tuple[EvaluatedRegions | EvaluatedCones, ...]:
        """All regions, whose planes join where steps leave them."""
        angles = (each.angle() for each in self.rotation_kinks if each.bounds_angle)
        return (*self.regions, *self.speeds, *self.cones, *angles)

    @property
    def tool(self) -> tuple[EvaluatedRegions | EvaluatedRotation | EvaluatedFloor, ...]:
        """The constraints of the tube and of the goal on the tool."""
        floors = (each for each in self.pace if isinstance(each, EvaluatedFloor))
        return (*self.regions, *self.rotations, *floors)


class SplineConstraints:
    """All constraints of splines on one knot grid.

    Attributes:
        keys: Of all limits, in the order of their numbers.
        links: The constraints on links, with the pairs that are watched.
        has_floors: Whether the tube's bands are required.
        keeps_floors: Whether they are kept. They are for motions inside their tube: both share one
            elastic variable.
    """

    def __init__(
        self,
        problem: PlanningProblem,
        grid: KnotGrid,
        links: LinkConstraints,
        radius: FloatArray,
        run_in: float | None = None,
        slack: FloatArray | None = None,
    ) -> None:
        """Set up the usual samples.

        Args:
            problem: The planning problem.
            grid: The splines' knots.
            links: The constraints on links.
            radius: Of the tube's segments, shape (m,) [m].
            run_in: The duration in which splines are run [s]; None: the least that limits allow.
            slack: The fraction of the tube's regions that stays unused, shape (m,); None: none.
        """
        self._run_in, self._blended = run_in, BLENDED
        self._largest_rates: FloatArray | None = None
        self._problem, self._grid, self.links, self._radius = problem, grid, links, radius
        limits = tuple(
            HoldingLimit(problem, LEAST_AT_REST) if isinstance(limit, HoldingLimit) else limit
            for limit in speed_limits(problem)
        )
        self._goal_keys = goal_keys(problem)
        tube, count = problem.tube, problem.tube.segment_count
        of_speed = [key for limit in limits for key in limit.keys]
        of_regions = [
            [LimitKey(kind, segment=k) for kind in tube.regions.kinds(k)] for k in range(count)
        ]
        of_rotation = (
            [] if tube.rotation is None else [LimitKey("rotation", segment=k) for k in range(count)]
        )
        floor = tube.least_tool_speed if tube.process.steady == REQUIRED else None
        self._floor = np.full(count, np.inf) if floor is None else floor
        banded = np.flatnonzero(np.isfinite(self._floor)).tolist()
        self.has_floors = self.keeps_floors = bool(banded)
        of_floors = [LimitKey("least_tool_speed", segment=k) for k in banded]
        of_tube = (*chain(*of_regions), *of_rotation, *of_floors)
        self.keys = (*of_speed, *of_tube, *self._goal_keys)
        self._numbers = {key: number for number, key in enumerate(self.keys)}
        # The numbers of the regions' tolerances, by segment and kind, and of the rotation's.
        self._tolerances = np.zeros((count, max(map(len, of_regions))), dtype=np.int64)
        for own, keys in zip(self._tolerances, of_regions, strict=True):
            own[: len(keys)] = self._numbers_of(keys)
        # Whether each segment begins and ends its chain.
        self._chain_ends = np.zeros((count, 2), dtype=bool)
        self._chain_ends[[run.start for run in grid.runs], 0] = True
        self._chain_ends[[run.stop - 1 for run in grid.runs], 1] = True
        self._rotation_tolerances = self._numbers_of(of_rotation)
        self._floor_numbers = np.full(count, NO_LIMIT)
        self._floor_numbers[banded] = self._numbers_of(of_floors)
        self._limits = [(limit, self._numbers_of(limit.keys)) for limit in limits]
        self._regions = problem.tube.regions_of(radius)
        # Between samples at a chain's kinks the motion needs a margin, in radii.
        count = grid.interval_count * (len(_DENSE_SAMPLES) - 1)
        spacing = arc_lengths(problem.tube.points)[-1] / count
        kink = largest_kink(problem.tube, grid.runs, _UNEVEN * spacing)
        least = INNER_MARGIN + min(kink, _MAX_FOR_KINKS)
        slack = np.zeros(problem.tube.segment_count) if slack is None else slack
        self._margin = np.maximum(least, slack)
        self._higher = _HIGHER if run_in is None else _HIGHER_IN_A_GIVEN_DURATION
        # A switching time has a sample on either side, so that the tool is in both regions there.
        ends = grid.phase_ends()
        self._hull = VelocityHull(grid.control_point_count)
        self._rate_samples = grid.samples(_RATE_SAMPLES).and_also(ends)
        # By whether jerk counts.
        self._watched_samples = {
            False: grid.samples(_CONFIGURATION_SAMPLES).and_also(ends),
            True: grid.samples(_JUMP_SAMPLES),
        }
        self._tube_samples = grid.samples(_TUBE_SAMPLES).and_also(ends)
        # The segment before a compulsory point is the last of its phase, the one after it the first
        # of the next phase.
        points = [run.stop if run.stop == after.start else 0 for run, after in pairwise(grid.runs)]
        passing = [points.index(k) for k in problem.tube.compulsory_points.tolist()]
        self._passing_samples = ends.where(np.array(passing, dtype=np.int64))
        gates = [points.index(gate.point) for gate in problem.tube.gates]
        self._gate_samples = ends.where(np.array(gates, dtype=np.int64))
        self._last_sample = ends.where(np.array([len(grid.runs) - 1]))
        self._dense_samples = grid.samples(_DENSE_SAMPLES)
        # The segments of runs that get a sample wherever the tool is.
        self._is_requested = np.zeros(problem.tube.segment_count, dtype=bool)

    def blend(self, intervals: float) -> bool:
        """Blend friction over a number of knot intervals; return True if that is a change."""
        has_changed = self._problem.robot.motors.has_coulomb_friction and intervals != self._blended
        self._blended = intervals
        return has_changed

    def hold_friction(self, spline: PhasedSpline) -> None:
        """Blend friction over fractions of a spline's largest velocities from now on.

        So steps from the spline do not change the range over which it is blended: rows have no
        derivative of that.
        """
        samples = sampled(spline, self._watched_samples[False])
        self._largest_rates = abs(samples.by_x[1]).max(axis=0)

    def at(self, spline: PhasedSpline) -> Iterate:
        """Return a spline with its constraints at the samples."""
        return self._at(spline, self._watched_samples, self._tube_samples)

    def rows(self, current: Iterate, size: StepSize | None) -> tuple[Rows, FloatArray]:
        """Return the rows of all constraints but regions, and 1 for elastic ones, else 0.

        Rows that a largest step cannot break are left out; None: all rows.
        """
        parts, elastic, count = [], [], 0
        for constraint in current.constraints:
            rows = constraint.rows(current.duration, size)
            parts.append(replace(rows, index=count + rows.index))
            elastic.append(np.full(len(rows), float(constraint.is_elastic)))
            count += constraint.row_count
        names = Rows.__dataclass_fields__
        stacked = (np.concatenate([getattr(part, name) for part in parts]) for name in names)
        return Rows(*stacked), np.concatenate(elastic)

    def rise(self, current: Iterate) -> FloatArray:
        """Return the slack that rows gain by a relative rise of their limits, by their numbers."""
        rises = [
            constraint.rise
            if isinstance(constraint, EvaluatedSpeedLimit | EvaluatedFloor)
            and constraint not in current.friction_kinks
            else np.ones(constraint.row_count)
            for constraint in current.constraints
        ]
        return np.concatenate(rises)

    def shared_rise(self, current: Iterate) -> dict[int, tuple[FloatArray, list[FloatArray]]]:
        """Return gains by a relative rise of each number of contacts, by the limits' numbers.

        All cones of a contact depend on its numbers. Gains are of the rows' slack, by their
        numbers, and of the vectors of every kind of regions.
        """
        gains, before = {}, self.slack(current, current, 1.0)
        for k, evaluated in enumerate(current.limits):
            if not isinstance(evaluated.limit, HoldingLimit):
                continue
            for key, number in zip(evaluated.limit.keys, evaluated.numbers.tolist(), strict=True):
                other = replace(evaluated, limit=evaluated.limit.raised(key, _SMALL_RISE))
                limits = (*current.limits[:k], other, *current.limits[k + 1 :])
                cones = tuple(evaluated_cones(other, current.duration))
                raised = replace(current, limits=limits, cones=cones)
                rows = (self.slack(current, raised, 1.0) - before) / _SMALL_RISE
                each = zip(raised.convex, current.convex, strict=True)
                vectors = [(there.vector - here.vector) / _SMALL_RISE for there, here in each]
                gains[number] = rows, vectors
        return gains

    def slack(self, current: Iterate, trial: Iterate, squared_duration: float) -> FloatArray:
        """Return the slack at a trial of a spline's rows, by their numbers.

        The squared duration is the trial's, as a multiple of the spline's.
        """
        duration = current.duration
        parts = [constraint.slack(duration, squared_duration) for constraint in trial.constraints]
        return np.concatenate(parts)

    def between_samples(self, spline: PhasedSpline) -> Iterate:
        """Return a spline with its constraints at dense samples."""
        dense = self._dense_samples
        return self._at(spline, dict.fromkeys(self._watched_samples, dense), dense)

    def add_samples_between(self, current: Iterate) -> tuple[Iterate, bool]:
        """Return a spline with its constraints at dense samples, and whether samples were added."""
        has_more = self.links.add_samples(current.spline)
        worst, dense = self.between_samples(current.spline), self._dense_samples
        tube, *_ = worst.regions
        if self._ask_for_missed(tube.vector):
            worst, has_more = self.between_samples(current.spline), True
        here = [limit for limit in worst.limits if limit.at.evaluation_points is dense]
        for with_jerk, samples in self._watched_samples.items():
            alike = [part for part in here if _jumps_at_knots(part.limit) is with_jerk]
            if alike:
                slowest = np.max([part.squared_durations for part in alike], axis=0)
                higher = _peaks(slowest, self._higher * current.duration**2)
                self._watched_samples[with_jerk] = samples.and_also(dense.where(higher))
                has_more |= len(higher) > 0
        at_rest = (cones.excess for cones in worst.cones if cones.is_at_rest)
        for lost in (_peaks(excess, 0.0) for excess in at_rest):
            watched = self._watched_samples[False]
            self._watched_samples[False] = watched.and_also(dense.where(lost))
            has_more |= len(lost) > 0
        # Compulsory points are passed at switching times, and need no other samples.
        in_tube = [part for part in worst.tool if part.at.evaluation_points is dense]
        outside = np.concatenate([_peaks(part.excess, 0.0) for part in in_tube])
        self._tube_samples = self._tube_samples.and_also(dense.where(outside))
        return worst, has_more or len(outside) > 0

    def _ask_for_missed(self, tool: FloatArray) -> bool:
        """Require the segments that the tool misses at dense samples; return True if any is new."""
        points, runs = self._problem.tube.points, self._grid.runs
        segments = OrderedSegments(points, self._radius, runs, self._dense_samples)
        missed = segments.missed(tool) & ~self._is_requested
        self._is_requested = self._is_requested | missed
        return bool(missed.any())

    def add_samples(self, spline: PhasedSpline, x: float) -> None:
        """Add samples of all constraints at an instant x from 0 to 1.

        The tube gets some on either side too: at a corner, samples before and after the instant may
        be in one segment each, and the motion between them in neither.
        """
        samples, times = self.watch(spline, np.array([x])), spline.switching_times
        width = np.diff(self._grid.breakpoints(times))[samples.interval[0]]
        spacing = float(width / (len(_DENSE_SAMPLES) - 1))
        around = self._grid.samples_at(times, np.clip(x + _BESIDE * spacing, 0.0, 1.0))
        self._tube_samples = self._tube_samples.and_also(samples).and_also(around)
        self.links.set_samples(spline, samples)

    def watch(self, spline: PhasedSpline, x: FloatArray) -> Samples:
        """Add samples of limits on the speed at instants (N,) from 0 to 1; return the samples."""
        samples = self._grid.samples_at(spline.switching_times, x)
        for with_jerk, watched in self._watched_samples.items():
            self._watched_samples[with_jerk] = watched.and_also(samples)
        return samples

    def _at(
        self, spline: PhasedSpline, watched: Mapping[bool, Samples], tube_samples: Samples
    ) -> Iterate:
        friction = self._blended, self._largest_rates
        arm = _ArmAlong(self._problem, spline, self._radius, friction, self._is_requested)
        limits = tuple(
            EvaluatedSpeedLimit(limit, *arm.at(self._points(limit, watched)), numbers)
            for limit, numbers in self._limits
        )
        regions, rotations, kinks = self._tool_at(arm, tube_samples)
        links = self.links.at(spline)
        squared_duration = max(float(limit.squared_durations.max()) for limit in limits)
        duration = self._run_in or float(np.sqrt(squared_duration))
        cones = tuple(chain(*(evaluated_cones(limit, duration) for limit in limits)))
        pace = self._pace_at(arm, tube_samples, duration)
        at_rest = [each for each in cones if each.is_at_rest]
        elastic: list[
            EvaluatedRegions
            | EvaluatedRotation
            | EvaluatedFloor
            | EvaluatedGates
            | EvaluatedLinks
            | EvaluatedCones
        ]
        elastic = [*regions, *rotations, *pace, links, *at_rest]
        return Iterate(
            spline,
            squared_duration,
            duration,
            max(float(part.excess.max(initial=0.0)) for part in elastic),
            limits,
            regions,
            tuple(chain(*(evaluated_speeds(limit, duration) for limit in limits))),
            cones,
            rotations,
            kinks,
            tuple(chain(*(arm.friction_kinks(limit) for limit in limits))),
            pace,
            links,
            arm.at(watched[False]),
            arm.at(self._rate_samples),
        )

    def _pace_at(
        self, arm: "_ArmAlong", samples: Samples, duration: float
    ) -> tuple[EvaluatedFloor | EvaluatedGates, ...]:
        """Return the floors of the tool's speed, run in a duration [s], and the gates."""
        pace: list[EvaluatedFloor | EvaluatedGates] = []
        if self.keeps_floors:
            at, path = arm.at(samples)
            segment, run_in = path.segment, self._run_in is not None
            floors = (self._floor[segment], duration, run_in, self._floor_numbers[segment])
            pace.append(EvaluatedFloor(at, path, *floors))
        if self._problem.tube.gates:
            pace.append(EvaluatedGates(*arm.at(self._gate_samples), self._problem.tube))
        return tuple(pace)

    def _points(self, limit: SpeedLimit, watched: Mapping[bool, Samples]) -> EvaluationPoints:
        if not isinstance(limit, JointRate):
            return watched[_jumps_at_knots(limit)]
        return self._hull if limit.order == RATES["velocity"] else self._rate_samples

    def _numbers_of(self, keys: Sequence[LimitKey]) -> IntArray:
        return np.array([self._numbers[key] for key in keys])

    def _tool_at(
        self, arm: "_ArmAlong", samples: Samples
    ) -> tuple[
        tuple[EvaluatedRegions, ...],
        tuple[EvaluatedRotation, ...],
        tuple[EvaluatedRotation, ...],
    ]:
        """Return the constraints of tube and goal on the tool, and kinks, as in an iterate."""
        tube = self._problem.tube
        at, path = arm.at(samples)
        regions, numbers = self._regions, self._tolerances
        evaluated = [
            EvaluatedRegions(
                at,
                path.tool_pose[1],
                lambda: {0: path.tool_jacobian[:, :3]},
                regions,
                path.segment,
                self._margin[path.segment],
                numbers,
                arm.segments_of(samples),
            )
        ]
        rotations, kinks = [], []
        if tube.rotation is not None:
            own = self._rotation_tolerances
            rotation = EvaluatedRotation(tube.rotation, at, path, INNER_MARGIN, own, path.segment)
            rotations, kinks = [rotation], rotation.kinks(self._chain_ends)
        if self._goal_keys:
            there = arm.at(self._last_sample)
            evaluated += evaluated_ball(self._problem, *there, self._numbers)
            rotations += evaluated_rotation(self._problem, *there, self._numbers)
        evaluated += [rotation.angle() for rotation in rotations if rotation.bounds_angle]
        if len(tube.compulsory_points):
            there = arm.at(self._passing_samples)
            evaluated.append(evaluated_points(tube, *there, regions, INNER_MARGIN, numbers))
        components = tuple(each for each in rotations if each.bounds_components)
        return tuple(evaluated), components, tuple(kinks)


class _ArmAlong:
    """A spline at points, and the arm there: each evaluated once."""

    def __init__(
        self,
        problem: PlanningProblem,
        spline: PhasedSpline,
        radius: FloatArray,
        friction: tuple[float, FloatArray | None],
        is_requested: BoolArray,
    ) -> None:
        """Take the knot intervals of blended friction, and the largest velocities, if held."""
        blended, self._largest_rates = friction
        self._problem, self._spline, self._radius = problem, spline, radius
        self._is_requested = is_requested
        # Of a joint's largest velocity.
        self._blended_fraction = min(blended / spline.grid.interval_count, 1.0)
        self._is_last = blended <= BLENDED
        self._at: dict[EvaluationPoints, tuple[SampledSpline, PathSamples]] = {}

    def at(self, points: EvaluationPoints) -> tuple[SampledSpline, PathSamples]:
        """Return the spline at points, and the arm there."""
        if points not in self._at:
            at = sampled(self._spline, points)
            segments = partial(self._segment, points) if isinstance(points, Samples) else None
            friction = partial(self._friction, at, points) if isinstance(points, Samples) else None
            path = PathSamples(self._problem, at.by_x, segments, friction)
            self._at[points] = (at, path)
        return self._at[points]

    def friction_kinks(self, here: EvaluatedSpeedLimit) -> list[EvaluatedSpeedLimit]:
        """Return a limit with each piece of friction beyond its kinks, if it has some."""
        samples = here.at.evaluation_points
        if not (isinstance(here.limit, SidedEffort) and isinstance(samples, Samples)):
            return []
        if not self._problem.robot.motors.has_coulomb_friction:
            return []
        pieces = (partial(self._friction, here.at, samples, piece) for piece in FRICTION_PIECES)
        paths = (here.path.with_friction(friction) for friction in pieces)
        return [
            EvaluatedSpeedLimit(here.limit, here.at, path, here.numbers, here) for path in paths
        ]

    def _friction(
        self, at: SampledSpline, samples: Samples, piece: str | None = None
    ) -> CoulombFriction:
        rate, motors = at.by_x[1], self._problem.robot.motors
        # Widely blended friction guides the first steps: the more of it is exact, the less it does.
        largest = self._largest_rates
        largest = abs(rate).max(axis=0) if largest is None else largest
        fraction = self._blended_fraction if self._is_last else 0.0
        ends = self._spline.end_directions(samples, fraction * largest)
        return blended_friction(motors, rate, ends, self._blended_fraction, largest, piece)

    def segments_of(self, samples: Samples) -> OrderedSegments:
        tube, runs = self._problem.tube, self._spline.grid.runs
        orientation = self.at(samples)[1].tool_pose[0]
        rotation = None if tube.rotation is None else (tube.rotation, orientation)
        return OrderedSegments(
            tube.points, self._radius, runs, samples, self._is_requested, rotation
        )

    def _segment(self, samples: Samples) -> IntArray:
        return self.segments_of(samples).at(self.at(samples)[1].tool_pose[1])


def _jumps_at_knots(limit: SpeedLimit) -> bool:
    return limit.order >= RATES["jerk"]


def _peaks(values: FloatArray, floor: float) -> IntArray:
    """Return the samples above a floor that are no lower than their neighbours."""
    padded = np.concatenate([[-np.inf], values, [-np.inf]])
    return np.flatnonzero((values >= padded[:-2]) & (values > padded[2:]) & (values > floor))
