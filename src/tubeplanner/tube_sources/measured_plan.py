"""The common end of `route` and `teach`: measure a tube's radii and ranges, and plan in it.

Measuring uses the planner's own branch along the reference points. Where that has too little space,
although the route has enough, the segment gets another reference point.
"""

from dataclasses import dataclass, replace

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.measurement.kept_segments import KeptSegments
from tubeplanner.measurement.measured_tube import MeasureOptions
from tubeplanner.measurement.tube_measurement import measured_tube
from tubeplanner.outcome import Infeasible, PlanStatus
from tubeplanner.planning.followed_plan import followed_plan
from tubeplanner.planning.plan_options import PlanOptions
from tubeplanner.planning.plan_result import PlanResult
from tubeplanner.planning.planner import plan
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.progress import PlanningClock
from tubeplanner.tube_sources.free_space import FreeSpace
from tubeplanner.tube_sources.reference_tube import reference_tube
from tubeplanner.tube_sources.tool_corners import ToolCorners, with_another_corner

_MAX_PARTINGS = 4
# A segment takes one to two seconds with as few samples as `route` and `teach` draw.
MAX_CORNER_SEGMENTS = 40


@dataclass(frozen=True, eq=False)
class PlannedTube:
    """A problem with a tube that was found for it, and its certified plan.

    Attributes:
        problem: With that tube.
        result: Its plan.
    """

    problem: PlanningProblem
    result: PlanResult

    @property
    def duration(self) -> float:
        """Duration of the trajectory [s]."""
        assert self.result.duration is not None
        return self.result.duration


def measured_plan(
    problem: PlanningProblem,
    space: FreeSpace,
    corners: ToolCorners,
    band: float,
    options: MeasureOptions,
    clock: PlanningClock,
    way: FloatArray | None = None,
) -> PlannedTube:
    """Measure the tube around corners of a route, and plan the trajectory through it.

    Args:
        problem: The planning problem; its tube does not count.
        space: Which configurations are free.
        corners: Reference points, and the arm between them.
        band: How far joints may leave their ranges there, before measuring [rad or m].
        options: How to measure.
        clock: Announces progress and may end the work.
        way: Configurations of a fast trajectory, shape (N, n), whose needs decide; None: such
            trajectories are planned.

    Raises:
        Infeasible: The tube is too narrow, or there is no certified trajectory in it.
        TimeLimitReached: The clock's limit has passed.
    """
    kept = KeptSegments()
    for parted in range(_MAX_PARTINGS + 1):
        whole = in_tube(problem, corners, band, options.max_radius)
        try:
            with clock.within(f"tube {parted + 1} of at most {_MAX_PARTINGS + 1}"):
                return _measured(whole, options, clock, way, kept)
        except Infeasible as reason:
            segment = reason.place.segment
            is_blocked = reason.status is PlanStatus.TUBE_BLOCKED and segment is not None
            if not is_blocked or parted == _MAX_PARTINGS:
                raise
            assert segment is not None
            finer = with_another_corner(problem.robot, space, corners, segment)
            if finer is None:
                raise
            corners = finer
    raise AssertionError("the last parting returns or raises")


def measure_options(max_radius: float, samples: int, seed: int) -> MeasureOptions:
    """Return how the tube around corners is measured; all of them, and those added to them."""
    most = MAX_CORNER_SEGMENTS + _MAX_PARTINGS
    return MeasureOptions(max_radius, samples, seed, max_segments=most)


def in_tube(
    problem: PlanningProblem, corners: ToolCorners, band: float, radius: float
) -> PlanningProblem:
    """Return a problem in the tube around corners of a route, not measured yet.

    Args:
        problem: The planning problem; its tube does not count.
        corners: Reference points, and the arm between them.
        band: How far joints may leave their ranges there [rad or m].
        radius: Of all segments [m].
    """
    segments = [np.vstack(pair) for pair in zip(corners.lines, corners.parts, strict=True)]
    tube = reference_tube(problem.robot, corners.points, segments, band, radius)
    return problem.with_tube(tube, corners.parts[-1][-1])


def _measured(
    problem: PlanningProblem,
    options: MeasureOptions,
    clock: PlanningClock,
    way: FloatArray | None,
    kept: KeptSegments,
) -> PlannedTube:
    measured = measured_tube(problem, options, clock, way, kept)
    if measured.problem is None:
        raise Infeasible(measured.status, measured.message, measured.place)
    clock.enter("planning through the measured tube")
    result = plan_under(clock, measured.problem)
    if not result.succeeded:
        raise Infeasible(result.status, result.message, result.place)
    return PlannedTube(measured.problem, result)


def plan_under(
    clock: PlanningClock, problem: PlanningProblem, quality: str = "balanced"
) -> PlanResult:
    """Return what planning finds in the time that is left on a clock.

    Raises:
        TimeLimitReached: None is left.
    """
    clock.check()
    limit = None if np.isinf(clock.remaining) else clock.remaining
    options = PlanOptions(quality=quality, time_limit=limit, slack=0.0, robust=False)
    return plan(problem, options, clock.announce)


def followed(found: PlannedTube, clock: PlanningClock) -> PlannedTube | Infeasible:
    """Return a tube with the motion that its problem asks for: smooth, in whole periods.

    Or why there is none: the duration that is asked for is too short.
    """
    result = followed_plan(found.problem, found.result, None, clock)
    if not result.succeeded:
        return Infeasible(result.status, result.message, result.place)
    return replace(found, result=result)
