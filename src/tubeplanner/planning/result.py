"""PlanResult and CycleResult: certified, refused or stopped; proof or search of a refusal."""

from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, asdict, dataclass, fields, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.certificate.refusal import refusal
from tubeplanner.certificate.verification import Certificate, CycleCertificate
from tubeplanner.certificate.verification import quick_certificate as verify
from tubeplanner.errors import FormerName
from tubeplanner.geometry.tube.points import arc_lengths
from tubeplanner.limits.holding_limit import HoldingPeak, holding_peaks
from tubeplanner.limits.lower_bound import LowerBound, lower_bound
from tubeplanner.limits.peaks import TrajectoryPeaks, peaks_as_dict, trajectory_peaks
from tubeplanner.limits.process_stretches import StretchRun, all_marks, stretch_runs
from tubeplanner.limits.speed_limits import unused_speed
from tubeplanner.native.library import LIBRARY
from tubeplanner.optimizer.stages import Sensitivity
from tubeplanner.optimizer.starts import RefinedMotion
from tubeplanner.outcome import Infeasible, Location, PlanningClock, PlanStatus, StoppedBy
from tubeplanner.robot.notes import robot_notes, unlimited_notes
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.demands import START
from tubeplanner.task.motion import CycleMotion, MotionSection, move_rows
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.text import in_milliseconds
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.parts import Mark

if TYPE_CHECKING:
    from tubeplanner.first_guess.branch_and_bound import SearchStatistics
    from tubeplanner.first_guess.suh_bishop import PhaseTwoStatistics
    from tubeplanner.planning.tightening import Survival

_MAX_MESSAGE = 200  # [characters] in the representation
# The message names reference points at more than this distance from the tool's path.
_FAR_IN_RADII = 3.0
_SAMPLES_PER_PIECE = 20
_ATTRIBUTES = "Attributes:\n"
# Another motion may be faster if more than this fraction of the speed is unused and the duration
# is above this multiple of its lower bound.
_MAX_UNUSED, _MAX_ABOVE = 0.02, 1.05


def _no_trajectory() -> None:
    return None


@dataclass(frozen=True, eq=False)
class TaskResult:
    """The result of planning a problem or a cycle: a certified motion, or the reason without it.

    Attributes:
        status: Success means that the certificate passed.
        message: One sentence: the answer, or the reason without an answer.
        location: Place of that reason, of a cycle with the move.
        method: The method of the answer: one of `METHODS`.
        planning_time: Wall time from the loaded task to the certified result [s].
        certificate_time: Part of the planning time for the answer's certificate [s].
        stopped_by: "time_limit" or "interrupt" if planning was stopped early; None otherwise.
        notes: Further information about the answer.
        proved: True if it is proved that there is no answer; False if no answer was found; None if
            there is an answer, or planning was stopped.
        starts_tried: Number of configurations or branches from which the search failed; None
            unless `proved` is False.
        bound: Lower bound on the duration of all motions of the task; None without an answer.
    """

    status: PlanStatus
    message: str
    location: Location
    method: str
    _: KW_ONLY
    planning_time: float = 0.0
    certificate_time: float = 0.0
    stopped_by: StoppedBy | None = None
    notes: tuple[str, ...] = ()
    proved: bool | None = None
    starts_tried: int | None = None
    bound: LowerBound | None = None

    place = FormerName("location")

    def __init_subclass__(cls) -> None:
        """Put these attributes before the own ones in the docstring of a kind of result."""
        common = (TaskResult.__doc__ or "").partition(_ATTRIBUTES)[2].rstrip()
        head, title, own = (cls.__doc__ or "").partition(_ATTRIBUTES)
        cls.__doc__ = f"{head}{title}{common}\n{own}"

    def __repr__(self) -> str:
        name, message = type(self).__name__, self.message[:_MAX_MESSAGE]
        return f"<{name} {self.status.value} by {self.method}: {message}>"

    @property
    def succeeded(self) -> bool:
        """True if there is a certified motion."""
        return self.status is PlanStatus.SUCCESS

    def _as_dict(self, **more: Any) -> dict[str, Any]:
        """Return the fields of the command line's JSON in their order, with those of a kind."""
        values = {
            "status": str(self.status),
            "message": self.message,
            "where": self.location.as_dict(),
            "proved": self.proved,
            "starts_tried": self.starts_tried,
            "bound": None if self.bound is None else asdict(self.bound),
            "planning_time": self.planning_time,
            "certificate_time": self.certificate_time,
            "stopped_by": self.stopped_by,
            "method": self.method,
            "build": LIBRARY.build,
            "notes": list(self.notes),
            **more,
        }
        return {name: values[name] for name in _JSON_FIELDS if name in values}


# Of the command line's JSON, in order.
_JSON_FIELDS = (
    *("status", "message", "where", "proved", "starts_tried"),
    *("duration", "bound", "shortest_duration", "greedy_duration", "phase1_duration"),
    *("planning_time", "certificate_time", "stopped_by"),
    *(each.name for each in fields(TrajectoryPeaks)),
    *(
        "holding",
        "stretches",
        "method",
        "build",
        "moves",
        "marks",
        "notes",
        "sensitivities",
        "search",
        "phase_two",
    ),
    *("certificate", "robustness"),
)


@dataclass(frozen=True, eq=False, repr=False)
class PlanResult(TaskResult):
    """The result of planning: a certified trajectory, or the reason why there is none.

    Attributes:
        trajectory: The answer; None unless successful.
        certificate: Certificate of the answer, or of the best attempt; None without an attempt.
        search: Statistics of branch and bound; None if it did not run.
        phase_two: Statistics of phase 2 of "suh-bishop"; None if it did not run.
        sensitivities: Cost of every limit, largest first; empty unless the answer is refinement's.
        motion: Start of `Planner.replan`; None unless the answer is refinement's.
        shortest: The shortest certified trajectory, if the answer is another one that takes a
            little longer; None if the answer is the shortest.
        survival: Survival of the answer in simulation; None unless field robustness asks for it.
        configuration: Configuration of the arm at the place, shape (n,) [rad or m]; None if not
            known.
        may_be_faster: True if the answer leaves speed unused, and no lower bound on the duration is
            near.
        path_minimum: The least time [s] in which motors that switch at once could run the answer's
            path; with viscous friction or torque-speed lines an upper bound on it. Computed on
            first use; None without an answer.
        peaks: The answer's largest joint acceleration, tool speed and tool acceleration. Computed
            on first use; None without an answer.
        holding: Of every contact that holds a part, the largest share of what it carries. Computed
            on first use; empty without an answer.
        stretches: The tool's speed along every stretch with a speed band. Likewise.
        marks: When stretches begin and end, and when the tool passes the tube's events. Likewise.
    """

    trajectory: JointTrajectory | None = None
    certificate: Certificate | None = None
    search: "SearchStatistics | None" = None
    phase_two: "PhaseTwoStatistics | None" = None
    sensitivities: tuple[Sensitivity, ...] = ()
    motion: RefinedMotion | None = None
    shortest: JointTrajectory | None = None
    survival: "Survival | None" = None
    configuration: FloatArray | None = None
    may_be_faster: bool = False
    _path_minimum: Callable[[], float | None] = _no_trajectory
    _peaks: Callable[[], TrajectoryPeaks | None] = _no_trajectory
    _sections: tuple[MotionSection, ...] = ()

    @cached_property
    def path_minimum(self) -> float | None:
        """Least time for the answer's path [s], if motors switch instantly."""
        return self._path_minimum()

    @cached_property
    def peaks(self) -> TrajectoryPeaks | None:
        """Largest joint acceleration, tool speed and tool acceleration of the answer."""
        return self._peaks()

    @cached_property
    def holding(self) -> list[HoldingPeak]:
        """Largest share of what each contact carries."""
        return holding_peaks(self._sections)

    @cached_property
    def stretches(self) -> list[StretchRun]:
        """Speed of the tool along each stretch with a speed band."""
        return stretch_runs(self._sections)

    @cached_property
    def marks(self) -> list[Mark]:
        """Marks of stretches and of events on the way, in the order of time."""
        return all_marks((), self._sections)

    @property
    def duration(self) -> float | None:
        """Duration of the trajectory [s], None without a trajectory."""
        return None if self.trajectory is None else self.trajectory.duration

    @property
    def shortest_duration(self) -> float | None:
        """Duration of the shortest certified trajectory [s], None without a trajectory."""
        return self.duration if self.shortest is None else self.shortest.duration

    @property
    def phase1_duration(self) -> float | None:
        """Duration of branch and bound's trajectory [s], None if no faster."""
        return None if self.search is None else self.search.best_duration

    def as_dict(self) -> dict[str, Any]:
        """Return the fields of the command line's JSON, but for loading_time and path_minimum."""
        return self._as_dict(
            duration=self.duration,
            shortest_duration=self.shortest_duration,
            phase1_duration=self.phase1_duration,
            **peaks_as_dict(self.peaks),
            holding=[each.as_dict() for each in self.holding],
            stretches=[each.as_dict() for each in self.stretches],
            marks=[mark.as_dict() for mark in self.marks],
            sensitivities=[asdict(each) for each in self.sensitivities],
            search=None if self.search is None else self.search.as_dict(),
            phase_two=None if self.phase_two is None else self.phase_two.as_dict(),
            certificate=None if self.certificate is None else self.certificate.as_dict(),
            robustness=None if self.survival is None else self.survival.as_dict(),
        )


def refused_result(reason: Infeasible, method: str) -> PlanResult:
    """Return the result of a refusal."""
    return PlanResult(
        reason.status,
        str(reason),
        reason.location,
        method,
        proved=reason.proved,
        starts_tried=None if reason.proved else reason.starts,
        configuration=reason.configuration,
    )


def stopped_result(clock: PlanningClock, stopped_by: StoppedBy, method: str) -> PlanResult:
    """Return the result of a method that was stopped before its first trajectory."""
    if stopped_by == "interrupt":
        status, message = PlanStatus.INTERRUPTED, "interrupted before anything was certified"
    else:
        status, message = PlanStatus.TIME_LIMIT, clock.past_limit
    return PlanResult(status, message, Location(), method, stopped_by=stopped_by)


def certified_result(
    problem: PlanningProblem, trajectory: JointTrajectory, method: str, clock: PlanningClock
) -> PlanResult:
    """Return the result of a method's trajectory: success if its certificate passes."""
    begin = clock.elapsed
    certificate = verify(problem, trajectory)
    return judged_result(problem, trajectory, certificate, clock.elapsed - begin, method)


def judged_result(
    problem: PlanningProblem,
    trajectory: JointTrajectory,
    certificate: Certificate,
    certificate_time: float,
    method: str,
) -> PlanResult:
    """Return the result of a method's trajectory with its certificate, passed or not."""
    reason = refusal(problem, certificate)
    if reason is not None:
        if reason.location.time is not None:
            q = trajectory.position(reason.location.time)
            location = reason.location.at(problem.robot.tool_position(q[None])[0])
            reason = reason.replaced(configuration=q, location=location)
        refused = refused_result(reason, method)
        return replace(refused, certificate=certificate, certificate_time=certificate_time)
    message = _success_message(problem, trajectory)
    unused_note = _unused_note(problem, trajectory)
    robot = problem.robot
    on_robot = (*unlimited_notes(robot), *robot_notes(robot))
    notes = (*unused_note, *contact_notes(problem, trajectory), *on_robot)
    return PlanResult(
        PlanStatus.SUCCESS,
        message,
        Location(),
        method,
        trajectory,
        certificate,
        certificate_time=certificate_time,
        notes=notes,
        may_be_faster=bool(unused_note),
        _path_minimum=partial(path_minimum, problem, trajectory),
        _peaks=partial(trajectory_peaks, problem.robot, trajectory),
        _sections=(MotionSection(problem, trajectory),),
    )


def _unused_note(problem: PlanningProblem, trajectory: JointTrajectory) -> tuple[str, ...]:
    """Return the note on a trajectory that leaves speed unused and is above the lower bound."""
    unused = unused_speed(problem, trajectory)
    bound = lower_bound(problem).duration if unused > _MAX_UNUSED else np.inf
    if trajectory.duration <= _MAX_ABOVE * bound:
        return ()
    least = f", of {bound:.4g} s at least" if bound > 0 else ""
    return (
        f"{unused:.1%} of the speed that the limits allow is unused on average: a faster "
        f"trajectory may exist{least}; --quality best searches from more starts",
    )


def _success_message(problem: PlanningProblem, trajectory: JointTrajectory) -> str:
    """Return the message about a certified trajectory."""
    message = f"certified trajectory of {trajectory.duration:.4f} s"
    if (region := problem.open_goal) is not None:
        last = trajectory.position(trajectory.duration)
        q = ", ".join(f"{value:.4f}" for value in last)
        if region.tolerance > 0:
            away = region.distance(problem.robot.tool_position(last[None])[0])
            message += f"; the tool ends {1000 * away:.3g} mm from the goal's position"
        message += f"; the goal was left open and became [{q}]"
    reach = _FAR_IN_RADII * (problem.tube.reach.max() + problem.tube.tool_radius)
    for count in (2, _SAMPLES_PER_PIECE):  # as a rule, 2 samples show that no point is far
        tool = problem.robot.tool_position(trajectory.per_piece(count).position)
        distances = [np.linalg.norm(tool - point, axis=1).min() for point in problem.tube.points]
        far = np.flatnonzero(np.array(distances) > reach)
        if len(far) == 0:
            return message
    is_ordered = problem.tube.visit == "ordered"
    reason = "overlap elsewhere" if is_ordered else "may be left out"
    return message + "".join(
        f"; it passes reference point {problem.tube.numbers[point]} at {distances[point]:.3g} "
        f"m: the regions beside that point {reason}"
        for point in far
    )


def with_diagnosis(result: PlanResult) -> PlanResult:
    """Return a result; messages of refusals tell proof from search.

    The messages of stopped planning, and of plans that do not survive, stay as they are.
    """
    if result.proved is None or result.survival is not None:
        return result
    if result.proved:
        diagnosis = "proved: there is no motion"
    elif not result.starts_tried:
        diagnosis = "not found"
    else:
        plural = "s" if result.starts_tried > 1 else ""
        diagnosis = f"not found, {result.starts_tried} start{plural} tried"
    return replace(result, message=f"{result.message}; {diagnosis}")


# ---- Overlaps where a motion begins or ends in contact.

_MIN_DEPTH = 1e-4  # [m]: less comes of rough geometry and rounding


def contact_notes(problem: PlanningProblem, trajectory: JointTrajectory) -> tuple[str, ...]:
    """Return notes on solids that overlap in contact at start or goal by more than 0.1 mm."""
    checker = problem.collision
    times = {True: 0.0, False: trajectory.duration}
    notes = {}
    for contact in problem.contacts:
        pairs = checker.pairs[checker.between(*contact.links)]
        for end in contact.ends:
            q = trajectory.position(times[end == START])
            rotation, position = problem.robot.body_poses(q[None])
            depth = -float(np.min(checker.distances(rotation[0], position[0], pairs)))
            if depth > _MIN_DEPTH:
                first, second = contact.links
                key = (end, frozenset(contact.links))
                notes[key] = (
                    f"at the {end} '{first}' and '{second}' overlap by {1000 * depth:.3g} mm, as "
                    "their contact allows; if that is not meant, move one of them"
                )
    return tuple(notes.values())


# ---- The least time of a path by motors that switch instantly.
#
# Libraries that plans do not need are imported on first use.

_GRID_POINTS = 1600
# Points of the path nearer to each other than this fraction of its length count as one: rounding
# errors between them would look like curvature.
_APART = 1e-6


def path_minimum(problem: PlanningProblem, trajectory: JointTrajectory) -> float | None:
    """Return the least time [s] for the path of a trajectory, from rest to rest; None: no solution.

    Under the limits of velocity, acceleration, effort, motors and tool speed at up to 1,600 points
    of the path, jerk and effort rate unlimited: good to about 0.1 %; less where segments with
    different tool speeds overlap, since the loosest counts. With viscous friction or torque-speed
    lines it is an upper bound on the least time; on the paths of bundled problems, a fine search of
    the phase plane has no time that is 0.2 % less.
    """
    from tubeplanner.first_guess.fastest_parameterization import fastest_parameterization

    if not trajectory.coefficients[:-1].any():
        return None
    from scipy.interpolate import CubicSpline

    # Points at equal times are close together wherever the trajectory rests: there the path begins,
    # ends, or has a corner.
    q = trajectory.position(np.linspace(0, trajectory.duration, _GRID_POINTS))
    arc_length = arc_lengths(q)
    _, apart = np.unique(np.floor(arc_length / (_APART * arc_length[-1])), return_index=True)
    spline = CubicSpline(arc_length[apart] / arc_length[apart[-1]], q[apart])
    path = JointTrajectory(trajectory.joint_names, spline.x, spline.c)
    timing = fastest_parameterization(problem, path, path.breakpoints, at_both_ends=False)
    return None if timing is None else timing.duration


# ---- Plans of the legs of a cycle, and of the whole.


@dataclass(frozen=True, eq=False)
class LegPlan:
    """The plan of one leg of a cycle."""

    problem: PlanningProblem  # the leg's problem
    result: PlanResult  # the certified answer, the shortest or the written motion

    @property
    def duration(self) -> float:
        """Duration of the answer [s]."""
        assert self.result.duration is not None
        return self.result.duration

    @property
    def begin(self) -> FloatArray:
        """First configuration, shape (n,) [rad or m]."""
        assert self.result.trajectory is not None
        return self.result.trajectory.position(0.0)

    @property
    def end(self) -> FloatArray:
        """Last configuration, shape (n,) [rad or m]."""
        assert self.result.trajectory is not None
        return self.result.trajectory.position(self.result.trajectory.duration)

    def between(self, problem: PlanningProblem) -> "LegPlan":
        """Return the plan as a plan of a problem whose given ends are the plan's."""
        motion = self.result.motion
        if motion is not None and not motion.is_smoother:
            motion = replace(motion, problem=problem.joined)
        return LegPlan(problem, replace(self.result, motion=motion))


class BlockedLeg(Exception):
    """A leg has no answer.

    Attributes:
        leg: The leg's index.
        result: The refusal.
    """

    def __init__(self, leg: int, result: PlanResult) -> None:
        super().__init__(result.message)
        self.leg, self.result = leg, result


@dataclass(frozen=True, eq=False, repr=False)
class CycleResult(TaskResult):
    """The result of planning a cycle: a certified motion of all moves, or the reason without it.

    Attributes:
        motion: The answer; None unless successful.
        certificate: Certificate of the answer, or of a failed attempt; None without an attempt.
        legs: The plan of every leg of the answer.
        greedy_duration: Duration of the moves planned alone, each from the end of the last one,
            dwells included [s]; None if that led nowhere.
        sensitivities: Cost of every limit over the cycle, largest first; limits of segments name
            their move.
        holding: As of a `PlanResult`, over all moves.
        stretches: Likewise.
        marks: Likewise, with those of the steps.
    """

    motion: CycleMotion | None = None
    certificate: CycleCertificate | None = None
    legs: tuple[LegPlan, ...] = ()
    greedy_duration: float | None = None
    sensitivities: tuple["CycleSensitivity", ...] = ()

    @property
    def duration(self) -> float | None:
        """Duration of the cycle, dwells included [s]; None without a motion."""
        return None if self.motion is None else self.motion.trajectory.duration

    @property
    def shortest_duration(self) -> float | None:
        """Duration by the shortest motions, dwells included [s]; None without a motion."""
        if self.duration is None:
            return None
        excess = [leg.duration - (leg.result.shortest_duration or 0.0) for leg in self.legs]
        return self.duration - sum(excess)

    @cached_property
    def holding(self) -> list[HoldingPeak]:
        """Largest share of what each contact carries."""
        return [] if self.motion is None else holding_peaks(self.motion.sections)

    @cached_property
    def stretches(self) -> list[StretchRun]:
        """Speed of the tool along each stretch with a speed band."""
        return [] if self.motion is None else stretch_runs(self.motion.sections)

    @cached_property
    def marks(self) -> list[Mark]:
        """Marks of steps, of stretches and of events on the way, in the order of time."""
        return [] if self.motion is None else all_marks(self.motion.marks, self.motion.sections)

    @cached_property
    def path_minimum(self) -> float | None:
        """Least time for the paths of all legs [s], if motors switch instantly, with the dwells.

        A leg for whose path TOPP-RA has no solution counts with its duration.
        """
        if self.duration is None:
            return None
        least = [leg.result.path_minimum or leg.duration for leg in self.legs]
        return self.duration - sum(leg.duration for leg in self.legs) + sum(least)

    def as_dict(self) -> dict[str, Any]:
        """Return the fields of the command line's JSON, but for loading_time."""
        motion = self.motion
        # Of legs, by the names of their moves.
        survivals = {
            name: leg.result.survival.as_dict()
            for section, leg in zip(motion.cycle.legs if motion else (), self.legs, strict=False)
            for name in section.names
            if leg.result.survival is not None
        }
        return self._as_dict(
            duration=self.duration,
            shortest_duration=self.shortest_duration,
            greedy_duration=self.greedy_duration,
            phase1_duration=None,
            moves=[] if motion is None else move_rows(motion),
            marks=[mark.as_dict() for mark in self.marks],
            holding=[each.as_dict() for each in self.holding],
            stretches=[each.as_dict() for each in self.stretches],
            sensitivities=[asdict(each) for each in self.sensitivities],
            certificate=None if self.certificate is None else self.certificate.as_dict(),
            **({"robustness": survivals} if survivals else {}),
        )


@dataclass(frozen=True)
class CycleSensitivity:
    """The cost of one limit over a cycle, with the ends of all moves fixed.

    Attributes:
        limit: As of a `Sensitivity`, of a holding its field.
        joint: As of a `Sensitivity`.
        move: The move of a tolerance; None for limits of joints, which count in all moves.
        segment: The segment of that move, or the first of joined ones; None for others.
        saved: Time saved by 10 % more [s], to first order.
        last_segment: The last of joined segments; None for others.
    """

    limit: str
    joint: str | None
    move: str | None
    segment: int | None
    saved: float
    last_segment: int | None = None

    def __str__(self) -> str:
        location = self.joint or f"move '{self.move}'"
        if self.last_segment not in (None, self.segment):
            location = f"segments {self.segment} to {self.last_segment} of {location}"
        elif self.segment is not None:
            location = f"segment {self.segment} of {location}"
        return f"{self.limit} of {location}: {in_milliseconds(self.saved)}"


def cycle_sensitivities(cycle: Cycle, plans: Sequence[LegPlan]) -> tuple[CycleSensitivity, ...]:
    """Return the costs of all limits over a cycle, largest first: sums over its moves."""
    saved: dict[tuple[str, str | None, str | None, int | None, int | None], float] = {}
    for leg, plan in zip(cycle.legs, plans, strict=True):
        for each in plan.result.sensitivities:
            if each.joint is not None:  # a limit of all moves
                location: tuple[str | None, int | None, int | None] = None, None, None
            elif each.segment is None:
                location = leg.name, None, None
            else:
                move, first, last = leg.segments_of_move(each.segment, each.last_segment)
                location = move.name, first, last
            key = (each.field or each.limit, each.joint, *location)
            saved[key] = saved.get(key, 0.0) + each.saved
    sums = [CycleSensitivity(*key[:4], value, key[4]) for key, value in saved.items()]
    return tuple(sorted(sums, key=lambda each: -each.saved))
