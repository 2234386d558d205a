"""All constraints of a spline at samples, with samples added where necessary."""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.polyline import arc_lengths
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.refinement.capsule_constraints import EvaluatedCapsules
from tubeplanner.refinement.limit_constraints import (
    ACCELERATION,
    EFFORT,
    JERK,
    VELOCITY,
    EvaluatedLimits,
    LimitConstraints,
)
from tubeplanner.refinement.linear_rows import INNER_MARGIN, Rows, StepSize, stacked
from tubeplanner.refinement.link_constraints import EvaluatedLinks, LinkConstraints
from tubeplanner.refinement.phased_spline import (
    EvaluationPoints,
    KnotGrid,
    PhasedSpline,
    Samples,
    VelocityHull,
)
from tubeplanner.refinement.rotation_constraints import EvaluatedRotation, evaluated_rotation
from tubeplanner.refinement.sampled_spline import sampled
from tubeplanner.refinement.tube_chains import largest_kink
from tubeplanner.refinement.tube_constraints import evaluated_points, evaluated_tube
from tubeplanner.tube.tube import Tube

# Samples per knot interval. There, accelerations are straight lines and jerks constant.
_EFFORT_SAMPLES = np.arange(2) / 2
_RATE_SAMPLES = np.zeros(1)
_TUBE_SAMPLES = np.arange(3) / 3
_DENSE_SAMPLES = np.linspace(0, 1, 21)
# Samples may lie this much farther apart than on average; and what their kinks may take, in radii.
_UNEVEN, _MOST_FOR_KINKS = 2, 0.03
_HIGHER = 1.001  # peaks of the squared duration between samples that count


@dataclass(frozen=True, eq=False)
class Iterate:
    """A spline and what it costs.

    Attributes:
        spline: Control points and switching times.
        squared_duration: The least T^2 that the limits allow at the samples [s^2].
        excess: How far tool or links violate their constraints, >= 0: of the tool in
            radii or rotation tolerances beyond the narrowed tube, of links in units of 5 cm.
        limits: What it was computed from: efforts and rates, as far as they are limited.
        capsules: Likewise, the tool's position and the angle of its rotation, if that is bounded.
        rotation: Likewise, the components of its rotation; None where they are free.
        links: Likewise.
    """

    spline: PhasedSpline
    squared_duration: float
    excess: float
    limits: tuple[EvaluatedLimits, ...]
    capsules: tuple[EvaluatedCapsules, ...]
    rotation: EvaluatedRotation | None
    links: EvaluatedLinks

    @property
    def tool(self) -> tuple[EvaluatedCapsules | EvaluatedRotation, ...]:
        """The constraints of the tube on the tool."""
        return self.capsules if self.rotation is None else (*self.capsules, self.rotation)

    @property
    def duration(self) -> float:
        """T [s]."""
        return float(np.sqrt(self.squared_duration))


class SplineConstraints:
    """What splines on one knot grid must keep."""

    def __init__(
        self, problem: PlanningProblem, grid: KnotGrid, links: LinkConstraints, radius: FloatArray
    ) -> None:
        """Set up the usual samples.

        Args:
            problem: The planning problem.
            grid: The splines' knots.
            links: What is watched of the links already.
            radius: Of the tube's segments, shape (m,) [m].
        """
        self._problem, self._grid, self._links, self._radius = problem, grid, links, radius
        self._limits = LimitConstraints(problem.robot)
        self._margin = INNER_MARGIN + _margin_for_kinks(problem.tube, grid)
        # A switching time has a sample on either side, so that the tool is in both capsules there.
        ends = grid.phase_ends()
        evaluation_points: dict[tuple[str, ...], EvaluationPoints] = {
            (EFFORT,): grid.samples(_EFFORT_SAMPLES).and_also(ends),
            (VELOCITY,): VelocityHull(grid.control_point_count),
            (ACCELERATION, JERK): grid.samples(_RATE_SAMPLES).and_also(ends),
        }
        self._limited = {
            kinds: at for kinds, at in evaluation_points.items() if self._limits.limited(kinds)
        }
        self._tube_samples = grid.samples(_TUBE_SAMPLES).and_also(ends)
        # The segment before a compulsory point is the last one of its phase.
        stops = [chain.stop for chain in grid.chains]
        self._passing_samples = ends.where(np.searchsorted(stops, problem.tube.compulsory_points))
        self._dense_samples = grid.samples(_DENSE_SAMPLES)

    def links_on(self, spline: PhasedSpline, other: PhasedSpline) -> LinkConstraints:
        """Return what is watched of a spline's links, for the same spline on other knots."""
        return self._links.on_other_knots(spline, other)

    @property
    def names(self) -> list[tuple[str, int]]:
        """Kind of every limit, and its joint or segment, in the order of their numbers."""
        kinds = ("radius",) if self._problem.tube.rotation is None else ("radius", "rotation")
        segments = range(self._problem.tube.segment_count)
        tolerances = [(kind, k) for kind in kinds for k in segments]
        return [*self._limits.names, *tolerances]

    def at(self, spline: PhasedSpline) -> Iterate:
        """Return a spline with what it costs at the samples."""
        return self._at(spline, self._limited, self._tube_samples)

    def rows(self, current: Iterate, size: StepSize | None) -> tuple[Rows, FloatArray]:
        """Return the rows of all but capsules, and 1 for those that may be violated, else 0.

        Args:
            current: The spline.
            size: Of the step; rows that it cannot break are left out. None: all rows.
        """
        parts = [limits.rows(current.duration, size) for limits in current.limits]
        counts = [limits.row_count for limits in current.limits]
        hard = sum(len(rows) for rows in parts)
        if current.rotation is not None:
            parts.append(current.rotation.rows(size))
            counts.append(current.rotation.row_count)
        parts.append(current.links.rows(size))
        firsts = np.concatenate([[0], np.cumsum(counts)])
        rows = stacked([rows.numbered_from(int(n)) for rows, n in zip(parts, firsts, strict=True)])
        return rows, np.repeat([0.0, 1.0], [hard, len(rows) - hard])

    def slack(self, current: Iterate, trial: Iterate, squared_duration: float) -> FloatArray:
        """Return the slack that a trial has, by the numbers of the rows at a spline.

        Args:
            current: The spline whose rows are meant.
            trial: The spline at which to evaluate them.
            squared_duration: The trial's, as a multiple of the spline's.
        """
        slacks = [limits.slack(current.duration, squared_duration) for limits in trial.limits]
        slacks += [] if trial.rotation is None else [trial.rotation.slack]
        return np.concatenate([*slacks, trial.links.slack])

    def look_for_links(self, spline: PhasedSpline) -> bool:
        """Watch links where they come close; return whether some are too close and were not."""
        return self._links.look(spline)

    def look_between_samples(self, current: Iterate) -> tuple[Iterate, bool]:
        """Return a spline's cost between samples too, and whether samples had to be added."""
        has_more = self.look_for_links(current.spline)
        limited = dict(self._limited)
        if (EFFORT,) in limited:
            limited[EFFORT,] = self._dense_samples
        worst = self._at(current.spline, limited, self._dense_samples)
        if (EFFORT,) in limited:
            floor = _HIGHER * current.squared_duration
            higher = _peaks(worst.limits[0].squared_durations, floor)
            self._watch_efforts(self._dense_samples.where(higher))
            has_more |= len(higher) > 0
        # Compulsory points are passed at switching times, and need no other samples.
        dense = [p for p in worst.tool if p.at.evaluation_points is self._dense_samples]
        outside = np.concatenate([_peaks(part.excess, 0.0) for part in dense])
        self._tube_samples = self._tube_samples.and_also(self._dense_samples.where(outside))
        return worst, has_more or len(outside) > 0

    def add_samples(self, spline: PhasedSpline, x: float) -> None:
        """Add samples of everything at an instant, from 0 to 1."""
        samples = self._grid.samples_at(spline.switching_times, np.array([x]))
        self._watch_efforts(samples)
        self._tube_samples = self._tube_samples.and_also(samples)
        self._links.look_at(spline, samples)

    def _watch_efforts(self, samples: Samples) -> None:
        known = self._limited.get((EFFORT,))
        if isinstance(known, Samples):
            self._limited[EFFORT,] = known.and_also(samples)

    def _at(
        self,
        spline: PhasedSpline,
        limited: dict[tuple[str, ...], EvaluationPoints],
        tube_samples: Samples,
    ) -> Iterate:
        limits = tuple(
            self._limits.at(spline, evaluation_points, kinds)
            for kinds, evaluation_points in limited.items()
        )
        capsules, rotation = self._tool_at(spline, tube_samples)
        if len(self._problem.tube.compulsory_points):
            capsules = (*capsules, self._points_at(spline))
        links = self._links.at(spline)
        found = [part.excess.max(initial=0.0) for part in (*capsules, rotation, links) if part]
        squared_duration = max(float(part.squared_durations.max()) for part in limits)
        excess = float(max(*found, 0.0))
        return Iterate(spline, squared_duration, excess, limits, capsules, rotation, links)

    def _tool_at(
        self, spline: PhasedSpline, samples: Samples
    ) -> tuple[tuple[EvaluatedCapsules, ...], EvaluatedRotation | None]:
        """Return the constraints of the tube on the tool, as in an iterate."""
        at, first = sampled(spline, samples), len(self._limits.names)
        tube = evaluated_tube(self._problem, at, samples, self._radius, self._margin, first)
        tolerance = self._problem.tube.rotation
        if tolerance is None:
            return (tube,), None
        first += self._problem.tube.segment_count
        robot = self._problem.robot
        rotation = evaluated_rotation(robot, tolerance, at, tube.segment, INNER_MARGIN, first)
        has_components, has_angle = (
            bool(np.isfinite(bounds).any())
            for bounds in (tolerance.bounds[:, :3], tolerance.bounds[:, 3])
        )
        capsules = (tube, rotation.angle()) if has_angle else (tube,)
        return capsules, rotation if has_components else None

    def _points_at(self, spline: PhasedSpline) -> EvaluatedCapsules:
        """Return the constraints of compulsory points, at the ends of the segments before them."""
        at, first = sampled(spline, self._passing_samples), len(self._limits.names)
        points = self._problem.tube.compulsory_points
        return evaluated_points(self._problem, at, points, self._radius, INNER_MARGIN, first)


def _margin_for_kinks(tube: Tube, grid: KnotGrid) -> float:
    """Return how far inside, in radii, samples must be for what they miss at a chain's kinks."""
    spacing = arc_lengths(tube.points)[-1] / (grid.interval_count * (len(_DENSE_SAMPLES) - 1))
    kink = largest_kink(tube, grid.chains, _UNEVEN * spacing)
    return min(kink, _MOST_FOR_KINKS)


def _peaks(values: FloatArray, floor: float) -> IntArray:
    """Return which samples above a floor are no lower than their neighbours."""
    padded = np.concatenate([[-np.inf], values, [-np.inf]])
    return np.flatnonzero((values >= padded[:-2]) & (values > padded[2:]) & (values > floor))
