"""A reference tube measured and planned in: the common end of route and teach.

Measuring uses the planner's own branch along the reference points. Where that has too little space,
although the route has enough, the segment gets another reference point.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import FormerName
from tubeplanner.first_guess.joint_routes import FreeSpace
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.orientation import quaternion_of_matrix
from tubeplanner.outcome import Infeasible, Location, PlanningClock, PlanStatus, StoppedBy
from tubeplanner.planning.options import PlanOptions
from tubeplanner.planning.result import PlanResult
from tubeplanner.planning.second_stage import followed_plan
from tubeplanner.planning.strategy import plan
from tubeplanner.studies.tubes.measurement import measured_tube
from tubeplanner.studies.tubes.routes import (
    ToolCorners,
    reference_tube,
    with_another_corner,
)
from tubeplanner.studies.tubes.segment_measurement import KeptSegments, MeasureOptions
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.text import short_repr

# ---- Measure a tube's radii and ranges, and plan the trajectory.

_MAX_PARTINGS = 4
_DECIMALS = 9  # of quaternions
# A segment takes one to two seconds with as few samples as `route` and `teach` draw.
MAX_CORNER_SEGMENTS = 40


@dataclass(frozen=True, eq=False)
class PlannedTube:
    """A problem with its tube, and the certified plan."""

    problem: PlanningProblem  # the problem with the tube
    result: PlanResult  # the plan

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
    guide: FloatArray | None = None,
) -> PlannedTube:
    """Measure the tube around corners of a route, and plan the trajectory.

    Joints may leave the corners' ranges by a band [rad or m], before measuring. The needs of a
    `guide` decide, configurations (N, n) of a fast trajectory; without a guide such trajectories
    are planned. The problem's own tube does not count.

    Raises:
        Infeasible: The tube is too narrow, or there is no certified trajectory in it.
        TimeLimitReached: The clock's limit has passed.
    """
    cache: KeptSegments = {}
    for parted in range(_MAX_PARTINGS + 1):
        whole = in_tube(problem, corners, band, options.max_radius)
        try:
            with clock.within(f"tube {parted + 1} of at most {_MAX_PARTINGS + 1}"):
                measured = measured_tube(whole, options, clock, guide, cache)
                if measured.problem is None:
                    raise Infeasible(measured.status, measured.message, measured.location)
                clock.enter("planning through the measured tube")
                result = plan_under(clock, measured.problem)
                if not result.succeeded:
                    raise Infeasible(result.status, result.message, result.location)
                return PlannedTube(measured.problem, result)
        except Infeasible as reason:
            segment = reason.location.segment
            is_blocked = reason.status is PlanStatus.TUBE_BLOCKED and segment is not None
            if not is_blocked or parted == _MAX_PARTINGS:
                raise
            assert segment is not None
            finer = with_another_corner(space, corners, segment)
            if finer is None:
                raise
            corners = finer
    raise AssertionError("the last parting returns or raises")


def measure_options(max_radius: float, samples: int, seed: int) -> MeasureOptions:
    """Return the options that measure all corners of a route, with the corners added later."""
    return MeasureOptions(max_radius, samples, seed, MAX_CORNER_SEGMENTS + _MAX_PARTINGS)


def in_tube(
    problem: PlanningProblem, corners: ToolCorners, band: float, radius: float
) -> PlanningProblem:
    """Return a problem in the tube around corners of a route, not measured yet.

    The radius [m] is that of all segments; joints may leave the corners' ranges by a band [rad or
    m]. The tool radius stays, and so do speed limit and rotation tolerance, about the route's
    orientations at the corners, if they are the same in all segments.
    """
    segments = [np.vstack(pair) for pair in zip(corners.lines, corners.parts, strict=True)]
    tube = reference_tube(problem.robot, corners.points, segments, band, radius)
    own, values = problem.tube, dict[str, Any](tool_radius=problem.tube.tool_radius)
    values |= common_tool_limits(own)
    if own.rotation_tolerance is not None and len(set(own.rotation_tolerance)) == 1:
        at_corners = np.vstack([*(line[:1] for line in corners.lines), corners.lines[-1][-1:]])
        rotations = problem.robot.tool_pose(at_corners)[0]
        values["orientations"] = quaternion_of_matrix(rotations).round(_DECIMALS)
        values["rotation_tolerance"] = [own.rotation_tolerance[0]] * len(segments)
    return problem.with_tube(replace(tube, **values), corners.parts[-1][-1])


def common_tool_limits(tube: Tube) -> dict[str, Any]:
    """Return the limits on the tool's speed and acceleration that all segments have, by name."""
    limits = {name: getattr(tube, name) for name in ("tool_speed", "tool_acceleration")}
    return {
        name: float(values[0])
        for name, values in limits.items()
        if values is not None and (values == values[0]).all()
    }


def plan_under(
    clock: PlanningClock, problem: PlanningProblem, quality: str = "balanced"
) -> PlanResult:
    """Return the plan of a problem within the remaining time of a clock.

    Raises:
        TimeLimitReached: No time remains.
    """
    clock.check()
    limit = None if np.isinf(clock.remaining) else clock.remaining
    options = PlanOptions(quality=quality, time_limit=limit, slack=0.0, robust=False)
    return plan(problem, options, clock.announce)


def followed(planned: PlannedTube, clock: PlanningClock) -> PlannedTube | Infeasible:
    """Return a tube with the motion that its problem requires: smooth, in whole periods.

    Or the reason why there is no motion: the required duration is too short.
    """
    result = followed_plan(planned.problem, planned.result, None, clock)
    if not result.succeeded:
        return Infeasible(result.status, result.message, result.location)
    return replace(planned, result=result)


# ---- The result of a search for a tube: a planned problem, or the reason of the failure.


@dataclass(frozen=True, eq=False)
class TubeAnswer:
    """The result of a search for a tube.

    Attributes:
        status: Success means that the trajectory through the tube is certified.
        message: One sentence.
        location: Location of the failure, if there is no answer.
        answer: The problem with its tube, and its plan; None unless successful.
        measured: The tube in which no collision was found, and its plan: `answer`, or a slower
            plan; None if no tube was measured.
        notes: Further information.
        routes: Number of routes that were planned along.
        edges: Number of straight edges between configurations that the search for routes tested.
        first_answer_time: Wall time to the first certified motion [s]; None without one.
        search_time: Wall time from the loaded problem to the answer [s].
        stopped_by: "time_limit" or "interrupt" if that ended the search early; None otherwise.
        recorded_duration: Duration of the trail as recorded [s]; None without a trail file.
    """

    status: PlanStatus
    message: str
    location: Location
    answer: PlannedTube | None = None
    measured: PlannedTube | None = None
    notes: tuple[str, ...] = ()
    routes: int = 0
    edges: int = 0
    first_answer_time: float | None = None
    search_time: float = 0.0
    stopped_by: StoppedBy | None = None
    recorded_duration: float | None = None

    __repr__ = short_repr

    place = FormerName("location")
    found = FormerName("answer")

    @property
    def succeeded(self) -> bool:
        """True if there is a tube with a certified trajectory."""
        return self.status is PlanStatus.SUCCESS

    def as_dict(self) -> dict[str, Any]:
        """Return the fields of the command line's JSON, but for loading_time."""
        planned = {} if self.answer is None else self.answer.result.as_dict()
        measured = None
        if self.measured is not None:
            measured = {"duration": self.measured.duration, **_tube_fields(self.measured)}
        return {
            **planned,
            "status": str(self.status),
            "message": self.message,
            "where": self.location.as_dict(),
            "notes": [*self.notes, *planned.get("notes", ())],
            "search_time": self.search_time,
            "compared_durations": [],  # of former versions, which compared tubes of one radius
            "routes": self.routes,
            "edges": self.edges,
            "first_answer_time": self.first_answer_time,
            "stopped_by": self.stopped_by,
            "recorded_duration": self.recorded_duration,
            **_tube_fields(self.answer),
            "measured": measured,
        }


def answer_of(outcome: PlannedTube | Infeasible, **more: Any) -> TubeAnswer:
    """Return the answer of a search: of a planned tube or the reason of the failure."""
    if isinstance(outcome, Infeasible):
        return TubeAnswer(outcome.status, str(outcome), outcome.location, **more)
    tube, what = outcome.problem.tube, "tube of {} reference points"
    if tube.route is not None:
        what = "route of {} configurations"
    count = len(tube.points if tube.route is None else tube.route)
    message = f"{what.format(count)}; {outcome.result.message}"
    return TubeAnswer(PlanStatus.SUCCESS, message, Location(), outcome, **more)


def _tube_fields(planned: PlannedTube | None) -> dict[str, Any]:
    tube = None if planned is None else planned.problem.tube
    if tube is None or tube.route is not None:
        route = None if tube is None or tube.route is None else tube.route.tolist()
        return {"points": None, "radius": None, "route": route}
    return {"points": tube.points.tolist(), "radius": tube.radius.tolist(), "route": None}
