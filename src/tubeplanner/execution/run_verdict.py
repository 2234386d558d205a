"""Verdict over n runs, of each leg and of the whole: promises, extremes, confidence bound."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import FormerName
from tubeplanner.execution.excursions import (
    Extreme,
    additional_distances,
    least_clearances,
    tube_excursions,
)
from tubeplanner.execution.held_parts import LOST, MOVED, most_used, parts_moved
from tubeplanner.execution.plants import first_instant, last_instant
from tubeplanner.execution.simulation import Execution
from tubeplanner.execution.tracking import LENGTH_PER_ANGLE
from tubeplanner.outcome import Location
from tubeplanner.task.demands import Robustness
from tubeplanner.task.motion import CycleMotion, Motion, MotionSection, ProblemMotion
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.text import short_repr
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.parts import ATTACH, DETACH, Mark, part_of

# ---- Judgement of each run: its largest excursions at samples; nothing is proved between.

_FREE = 1e3  # [rad or m]: the largest distance from position limits; they may be infinite
# The promises of a plan that a run must keep, and what controllers stop for; in messages.
_WORDS = {
    "tube": "left the tube",
    "rotation": "left the rotation tolerance",
    "points": "missed a compulsory point",
    "position": "passed a position limit",
    "obstacles": "came too near to an obstacle",
    "self_collision": "ran into themselves",
    "velocity": "passed a velocity limit",
    "tracking": "had a joint too far from the plan",
    "tool_tracking": "had the tool too far from the plan",
    "holding": "asked more of a contact than it carries",
    "part": "lost the held part or moved it by more than 1 mm",
}
KEPT = tuple(_WORDS)
_VELOCITY_TOLERANCE = 0.05  # where neither the problem nor a preset has one


@dataclass(frozen=True, eq=False)
class JudgedRun:
    """The largest excursions of one executed motion at its control instants; negative: inside.

    Attributes:
        tube: Excursion of the tool beyond the tube [m].
        rotation: Excursion beyond the rotation tolerance [rad]; None where the tube has none.
        points: Excursion at the compulsory point that is missed most [m]; None: no such point.
        tracking: Distance of a joint from the plan [rad or m], the largest for which a metre counts
            as 10 rad.
        tool_tracking: Largest distance of the tool from the plan [m].
        position: Excursion of a joint beyond its position limits [rad or m].
        velocity: Largest velocity of a joint over its limit; None where all are unlimited.
        saturated: Fraction of the control periods in which a requested effort was cut.
        obstacles: Least distance of a link from an obstacle [m], less the distance that its pair
            or segment requires beyond `clearance`; None where no such pair is judged.
        self_collision: Least distance of links from each other [m], less the distance that their
            pair requires; None where no such pair is judged.
        clearance: Clearance from obstacles that the problem requires [m].
        stops: Value of velocity, tracking and tool tracking at which the controller stops, by
            name; a quantity that it does not stop for is absent.
        tube_by_segment: As `tube`, for each of the joined segments, shape (m,) [m].
        rotation_by_segment: As `rotation`, shape (m,) [rad]; -1e3 where it is free.
        position_by_joint: Excursions below the lower and above the upper position limits, shape
            (2, n) [rad or m].
        velocity_by_joint: Largest velocity of each joint over its limit, shape (n,).
        tracking_by_joint: Largest distance of each joint from the plan over that at which the
            controller stops, shape (n,); 0 where it does not stop.
        holding: Largest share of what a contact carries at safety 1, with the plant's friction and
            mass of the part; beyond 1 it may be lost. None where nothing is held.
        part: Distance by which the held part moved in the tool, followed in MuJoCo [m]; None where
            it was not followed.
    """

    tube: Extreme
    rotation: Extreme | None
    points: Extreme | None
    tracking: Extreme
    tool_tracking: Extreme
    position: Extreme
    velocity: Extreme | None
    saturated: float
    obstacles: Extreme | None
    self_collision: Extreme | None
    clearance: float
    stops: Mapping[str, float]
    tube_by_segment: FloatArray = field(repr=False)
    rotation_by_segment: FloatArray = field(repr=False)
    position_by_joint: FloatArray = field(repr=False)
    velocity_by_joint: FloatArray = field(repr=False)
    tracking_by_joint: FloatArray = field(repr=False)
    holding: Extreme | None = None
    part: Extreme | None = None

    __repr__ = short_repr

    @property
    def loses_part(self) -> bool:
        """True if the part was followed, and lost."""
        return self.part is not None and self.part.value > LOST

    @property
    def broken(self) -> tuple[str, ...]:
        """Names of `KEPT` that the run broke."""
        nearest = {"obstacles": self.clearance, "self_collision": 0.0}
        broken = []
        for name in KEPT:
            extreme: Extreme | None = getattr(self, name)
            if extreme is None:
                continue
            if name in nearest:
                excess = nearest[name] - extreme.value
            else:
                bound = np.inf if name in _STOPS else BOUNDS.get(name, 0.0)
                excess = extreme.value - self.stops.get(name, bound)
            if excess > 0:
                broken.append(name)
        return tuple(broken)

    @property
    def survives(self) -> bool:
        """True if the run keeps all of `KEPT`."""
        return not self.broken


_STOPS = ("velocity", "tracking", "tool_tracking")
BOUNDS = {"holding": 1.0, "part": MOVED}  # of quantities whose bound is neither 0 nor a field


def judged_runs(
    problem: PlanningProblem,
    trajectory: JointTrajectory,
    execution: Execution,
    checkpoint: Callable[[], None] = lambda: None,
    errors: Robustness | None = None,
    follow_parts: bool = False,
) -> list[JudgedRun]:
    """Judge executed motions in their order.

    The tube is the problem's, in the frame of the cell: errors of tool and base count.

    Args:
        problem: The planning problem.
        trajectory: The planned motion.
        execution: Its execution.
        checkpoint: Called before every run; may raise to end the work.
        errors: The field with the controller's stops; None: the default.
        follow_parts: True to follow held parts in MuJoCo too.
    """
    trajectory = trajectory.reordered(problem.robot.joint_names)
    planned = trajectory.position(np.minimum(execution.time, trajectory.duration))
    aim = problem.robot.tool_position(planned)
    more, result = additional_distances(problem, trajectory, execution.time), []
    errors = errors or Robustness()
    parts = parts_moved(problem, execution, checkpoint) if follow_parts else None
    for run in range(len(execution.plants)):
        checkpoint()
        judged = _judged(problem, execution, run, (planned, aim), more, errors)
        result.append(replace(judged, part=None if parts is None else parts[run]))
    return result


def _judged(
    problem: PlanningProblem,
    execution: Execution,
    run: int,
    plan: tuple[FloatArray, FloatArray],
    more: FloatArray | None,
    errors: Robustness,
) -> JudgedRun:
    """Judge a run of a plan, its joints (K, n) and its tool (K, 3)."""
    planned, aim = plan
    time, q, plant = execution.time, execution.position[run], execution.plants[run]
    rotation, tool = plant.displaced(*problem.tube.tool_pose(problem.robot, q, time))
    excursions = tube_excursions(problem, time, q, rotation, tool)
    obstacles, self_collision = least_clearances(problem, time, q, plant.base, more)
    distance = np.linalg.norm(tool - aim, axis=1)
    units = np.where(problem.robot.revolute, 1.0, LENGTH_PER_ANGLE)
    off = abs(q - planned) / units
    worst = _largest(problem, time, off)
    # Of the joint farthest from the plan: 1 rad, or the length that counts as much.
    unit = float(units[problem.robot.joint_names.index(worst.location.joint)])
    farthest = int(distance.argmax())
    limits, speed = problem.robot.limits, abs(execution.velocity[run])
    tolerance, path = errors.velocity_tolerance, errors.path_tolerance
    if tolerance is None:
        tolerance = limits.velocity_tolerance
    stops = {
        "velocity": 1 + (_VELOCITY_TOLERANCE if tolerance is None else tolerance),
        "tracking": None if path is None else unit * path,
        "tool_tracking": errors.tool_tolerance,
    }
    beyond = np.array([limits.lower_position - q, q - limits.upper_position]).clip(min=-_FREE)
    return JudgedRun(
        tube=excursions.tube,
        rotation=excursions.rotation,
        points=excursions.points,
        tracking=Extreme(unit * worst.value, worst.location),
        tool_tracking=Extreme(float(distance[farthest]), Location(time=float(time[farthest]))),
        position=_largest(problem, time, beyond.max(axis=0)),
        velocity=_largest(problem, time, speed / limits.velocity)
        if np.isfinite(limits.velocity).any()
        else None,
        saturated=float(execution.is_saturated[run].any(axis=1).mean()),
        obstacles=obstacles,
        self_collision=self_collision,
        clearance=problem.clearance,
        stops={name: value for name, value in stops.items() if value is not None},
        tube_by_segment=excursions.tube_by_segment,
        rotation_by_segment=excursions.rotation_by_segment,
        position_by_joint=beyond.max(axis=1),
        velocity_by_joint=(speed / limits.velocity).max(axis=0),
        tracking_by_joint=off.max(axis=0) / (path or np.inf),
        holding=most_used(problem, execution, run),
    )


def _largest(problem: PlanningProblem, time: FloatArray, values: FloatArray) -> Extreme:
    """Return the largest of the joints' values (K, n), with its time and joint."""
    sample, joint = np.unravel_index(int(values.argmax()), values.shape)
    location = Location(time=float(time[sample]), joint=problem.robot.joint_names[joint])
    return Extreme(float(values[sample, joint]), location)


# ---- Worst and median of each quantity over the runs.

# Quantities of a run. Of those of two kinds the least value is the worst.
_QUANTITIES = (
    *("tube", "rotation", "points", "tracking", "tool_tracking", "position", "velocity"),
    *("holding", "part", "obstacles", "self_collision"),
)
_LEAST = _QUANTITIES[-2:]


@dataclass(frozen=True)
class RunSummary:
    """One quantity over all runs."""

    worst: Extreme
    run: int  # index of the run with the worst value
    median: float  # median of all runs

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        worst = {"value": self.worst.value, "place": self.worst.location.as_dict()}
        return {"worst": worst, "run": self.run, "median": self.median}


def summaries(runs: Sequence[JudgedRun]) -> dict[str, RunSummary | None]:
    """Return the worst and the median of every quantity of `JudgedRun`; None: not required."""
    result: dict[str, RunSummary | None] = dict.fromkeys(_QUANTITIES)
    for name in _QUANTITIES:
        extremes = [extreme for run in runs if (extreme := getattr(run, name)) is not None]
        if extremes:
            values = np.array([extreme.value for extreme in extremes])
            worst = int(values.argmin() if name in _LEAST else values.argmax())
            result[name] = RunSummary(extremes[worst], worst, float(np.median(values)))
    return result


# ---- Verdict: number of failed runs, and confidence bounds on the fraction of all that fail.

CONFIDENCE = 0.95


@dataclass(frozen=True)
class RunVerdict:
    """The counts of failed runs; nothing is proved of other runs.

    Attributes:
        runs: Number of runs.
        failed: Number of runs that broke any promise of `KEPT`.
        broken: Number of runs that broke each promise.
        velocity: Largest velocity of a joint over its limit; None where all are unlimited.
        tracking: Largest distance of a joint from the plan [rad or m].
    """

    runs: int
    failed: int
    broken: Mapping[str, int]
    velocity: float | None
    tracking: float

    share = FormerName("fraction")

    @property
    def fraction(self) -> tuple[float, float]:
        """Bounds on the fraction of all drawn arms that fail, with 95 % confidence.

        (Clopper and Pearson, "The use of confidence or fiducial limits illustrated in the case of
        the binomial", Biometrika 26, 1934.)
        """
        from scipy.special import betaincinv  # slow to load, and few plans are simulated

        k, n, tail = self.failed, self.runs, (1 - CONFIDENCE) / 2
        least = float(betaincinv(k, n - k + 1, tail)) if k > 0 else 0.0
        most = float(betaincinv(k + 1, n - k, 1 - tail)) if k < n else 1.0
        return least, most

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return {
            "runs": self.runs,
            "failed": self.failed,
            "share": list(self.fraction),
            "confidence": CONFIDENCE,
            "broken": dict(self.broken),
            "velocity": self.velocity,
            "tracking": self.tracking,
        }

    def survived(self, errors: Robustness) -> str:
        """Return the sentence on the arms that survived, with the bounds of their errors."""
        speed = "" if self.velocity is None else f"velocity up to {self.velocity:.3g} of its limit"
        return (
            f"survived {self.runs - self.failed} of {self.runs} simulated arms whose errors are up "
            f"to {errors.in_words}, {speed}{', ' * bool(speed)}a joint up to "
            f"{1000 * self.tracking:.3g} mrad or mm from the plan{self._counts(' fail')}"
        )

    def __str__(self) -> str:
        return f"{self.failed} of {self.runs} runs failed{self._counts()}"

    def _counts(self, verb: str = "") -> str:
        least, most = self.fraction
        counts = "; ".join(
            f"{count} {_WORDS[name]}" for name, count in self.broken.items() if count
        )
        between = f"between {100 * least:.1f} and" if self.failed else "at most"
        return (
            f"{': ' * bool(counts)}{counts} ({between} {100 * most:.1f} % of all{verb}, with "
            f"{100 * CONFIDENCE:g} % confidence)"
        )


def run_verdict(runs: Sequence[JudgedRun]) -> RunVerdict:
    """Return the counts of failed runs and of broken promises."""
    counts = Counter(name for run in runs for name in run.broken)
    failed = sum(not run.survives for run in runs)
    return RunVerdict(
        len(runs),
        failed,
        {name: counts[name] for name in KEPT},
        max((run.velocity.value for run in runs if run.velocity is not None), default=None),
        max(run.tracking.value for run in runs),
    )


# ---- Verdict over the runs of a whole motion: legs, and handovers between them.


@dataclass(frozen=True, eq=False)
class HandoverErrors:
    """The pose errors and speeds of R tools at an attach or detach.

    Attributes:
        mark: The attach or detach, with its time.
        distance: Errors of the tool centre points, of tool and base included, shape (R,) [m].
        angle: Rotation errors of the tools, shape (R,) [rad].
        speed: Speeds of the tool centre points, planned at rest, shape (R,) [m/s].
    """

    mark: Mark
    distance: FloatArray
    angle: FloatArray
    speed: FloatArray

    __repr__ = short_repr

    def as_dict(self) -> dict[str, Any]:
        """Return the mark, and the worst and the median of each quantity, as JSON values."""
        quantities = {name: getattr(self, name) for name in ("distance", "angle", "speed")}
        return self.mark.as_dict() | {
            name: {
                "worst": float(values.max()),
                "run": int(values.argmax()),
                "median": float(np.median(values)),
            }
            for name, values in quantities.items()
        }


@dataclass(frozen=True, eq=False)
class JudgedCycle:
    """The verdict over the runs of a cycle at its control instants; nothing is proved between.

    Attributes:
        legs: Runs of each leg, by the names of its moves; times and places in the cycle.
        runs: Runs of the whole cycle.
        handovers: Errors at each attach and detach.
    """

    legs: dict[tuple[str, ...], list[JudgedRun]]
    runs: list[JudgedRun]
    handovers: list[HandoverErrors]

    __repr__ = short_repr


def judged_cycle(
    motion: Motion,
    execution: Execution,
    checkpoint: Callable[[], None] = lambda: None,
    errors: Robustness | None = None,
    follow_parts: bool = False,
) -> JudgedCycle:
    """Judge the executed motions of a cycle.

    Every leg is judged as the motion of its planning problem, as `executed_legs` cuts it out. A
    run of the cycle has the worst of all its legs; saturation counts at all instants.

    Args:
        motion: The planned motion, of a cycle or of a problem.
        execution: The execution of its trajectory.
        checkpoint: Called before every run of every leg; may raise to end the work.
        errors: The field with the controller's stops; None: the default.
        follow_parts: True to follow held parts in MuJoCo too.

    Raises:
        ProblemError: A leg begins or ends where its problem does not allow it.
    """
    legs: dict[tuple[str, ...], list[JudgedRun]] = {}
    for leg in executed_legs(motion, execution):
        judged = judged_runs(
            leg.problem, leg.trajectory, leg.execution, checkpoint, errors, follow_parts
        )
        legs[leg.names] = [_in_motion(run, leg) for run in judged]
    saturated = execution.is_saturated.any(axis=2).mean(axis=1)
    runs = [
        replace(_whole(run), saturated=float(fraction))
        for run, fraction in zip(zip(*legs.values(), strict=True), saturated, strict=True)
    ]
    return JudgedCycle(legs, runs, list(handover_errors(motion, execution)))


def _in_motion(run: JudgedRun, leg: MotionSection) -> JudgedRun:
    """Return a run of a leg with the places of its extremes in the whole motion."""
    extremes: dict[str, Any] = {
        name: replace(extreme, location=leg.in_motion(extreme.location))
        for name, extreme in vars(run).items()
        if isinstance(extreme, Extreme)
    }
    return replace(run, **extremes)


def _whole(legs: Sequence[JudgedRun]) -> JudgedRun:
    """Return a run of the cycle: the worst of all legs for each quantity."""
    worst: dict[str, Any] = {}
    for name in _QUANTITIES[:-2]:
        extremes = [extreme for leg in legs if (extreme := getattr(leg, name)) is not None]
        worst[name] = max(extremes, key=lambda extreme: extreme.value, default=None)
    # Each leg has a clearance of its own: the nearest is the least distance beyond its clearance.
    slack = [leg.obstacles.value - leg.clearance if leg.obstacles else np.inf for leg in legs]
    nearest = legs[int(np.argmin(slack))]
    folded = [leg.self_collision for leg in legs if leg.self_collision is not None]
    # The unit of the joint farthest from the plan may be another in each leg.
    farthest = max(legs, key=lambda leg: (leg.tracking_by_joint.max(), leg.tracking.value))
    return replace(
        legs[0],
        **worst | {"tracking": farthest.tracking, "stops": farthest.stops},
        obstacles=nearest.obstacles,
        clearance=nearest.clearance,
        self_collision=min(folded, key=lambda extreme: extreme.value, default=None),
        tube_by_segment=np.concatenate([leg.tube_by_segment for leg in legs]),
        rotation_by_segment=np.concatenate([leg.rotation_by_segment for leg in legs]),
        position_by_joint=np.max([leg.position_by_joint for leg in legs], axis=0),
        velocity_by_joint=np.max([leg.velocity_by_joint for leg in legs], axis=0),
        tracking_by_joint=np.max([leg.tracking_by_joint for leg in legs], axis=0),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class ExecutedLeg(MotionSection):
    """The execution of one leg and of the rests beside it under the same load."""

    execution: Execution  # the executed section, in times of `trajectory`

    __repr__ = short_repr


def executed_legs(motion: Motion, execution: Execution) -> list[ExecutedLeg]:
    """Return the executed legs of a motion in order; of a problem's motion the only one.

    A leg counts from the last attach or detach before it to the first after it; where the load
    does not change, from its beginning to that of the next leg. Attached and detached objects are
    where the planned motion has them, and problems are those between the motion's junctions.

    Raises:
        ProblemError: A leg begins or ends where its problem does not allow it.
    """
    if isinstance(motion, ProblemMotion):
        (whole,) = motion.sections
        return [ExecutedLeg(**vars(whole), execution=execution)]
    time, result = execution.time, []
    for section, (begin, end) in zip(motion.ended_sections, _spans(motion), strict=True):
        part = part_of(motion.trajectory, begin, min(end, motion.trajectory.duration))
        first = first_instant(time, begin)
        instants = slice(first, max(last_instant(time, end), first) + 1)  # at least one
        names = ("position", "velocity", "effort", "is_saturated")
        parts = {name: getattr(execution, name)[:, instants] for name in names}
        executed = replace(execution, time=time[instants] - begin, **parts)
        result.append(ExecutedLeg(section.problem, part, begin, section.leg, execution=executed))
    return result


def _spans(motion: CycleMotion) -> list[tuple[float, float]]:
    """Return begin and end of each leg's section [s]; an end of inf is that of the execution."""
    handed_over = [mark.time for mark in motion.marks if mark.kind in (ATTACH, DETACH)]
    ends = [0.0, *(end for _, end in motion.leg_times)]
    begins = [*(begin for begin, _ in motion.leg_times), np.inf]
    stops = [
        [time for time in handed_over if end <= time <= begin]
        for end, begin in zip(ends, begins, strict=True)
    ]
    junctions = [
        (min(at, default=begin), max(at, default=begin))
        for at, begin in zip(stops, begins, strict=True)
    ]
    return [(last, first) for (_, last), (first, _) in pairwise(junctions)]


def handover_errors(motion: Motion, execution: Execution) -> Iterator[HandoverErrors]:
    """Yield the errors at each attach and detach, at the last control instant before."""
    robot = motion.task.robot
    for mark in motion.marks:
        if mark.kind not in (ATTACH, DETACH):
            continue
        k = last_instant(execution.time, mark.time)
        orientation, aim = robot.tool_pose(motion.trajectory.position(mark.time)[None])
        q, v = execution.position[:, k], execution.velocity[:, k]
        poses = [
            plant.displaced(*robot.tool_pose(row[None]))
            for plant, row in zip(execution.plants, q, strict=True)
        ]
        offset = np.array([position[0] - aim[0] for _, position in poses])
        angle = np.array([_angle(orientation[0].T @ rotation[0]) for rotation, _ in poses])
        speed = np.linalg.norm(robot.tool_velocity(q, v)[0], axis=1)
        yield HandoverErrors(mark, np.linalg.norm(offset, axis=1), angle, speed)


def _angle(rotation: FloatArray) -> float:
    """Return the angle of a rotation (3, 3) [rad]."""
    axis = rotation - rotation.T
    sine = np.linalg.norm(axis) / np.sqrt(8)
    return float(np.arctan2(sine, (np.trace(rotation) - 1) / 2))
