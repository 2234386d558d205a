"""Verdict over n runs: kept promises, worst and usual values, confidence bound."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
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
from tubeplanner.execution.simulation import Execution
from tubeplanner.execution.tracking import LENGTH_PER_ANGLE
from tubeplanner.outcome import Location
from tubeplanner.task.demands import Robustness
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.text import short_repr
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

# ---- Judgement of each run: its largest excursions at samples; nothing is proved between.

_FREE = 1e3  # [rad or m]: the largest distance from position limits; they may be infinite
# The promises of a plan that a run must keep, and what controllers stop for.
KEPT = (
    *("tube", "rotation", "points", "position", "obstacles", "self_collision"),
    *("velocity", "tracking", "tool_tracking"),
)
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

    __repr__ = short_repr

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
                bound = np.inf if name in _STOPS else 0.0
                excess = extreme.value - self.stops.get(name, bound)
            if excess > 0:
                broken.append(name)
        return tuple(broken)

    @property
    def survives(self) -> bool:
        """True if the run keeps all of `KEPT`."""
        return not self.broken


_STOPS = ("velocity", "tracking", "tool_tracking")


def judged_runs(
    problem: PlanningProblem,
    trajectory: JointTrajectory,
    execution: Execution,
    checkpoint: Callable[[], None] = lambda: None,
    errors: Robustness | None = None,
) -> list[JudgedRun]:
    """Judge executed motions in their order.

    The tube is the problem's, in the frame of the cell: errors of tool and base count.

    Args:
        problem: The planning problem.
        trajectory: The planned motion.
        execution: Its execution.
        checkpoint: Called before every run; may raise to end the work.
        errors: The field with the controller's stops; None: the default.
    """
    trajectory = trajectory.reordered(problem.robot.joint_names)
    planned = trajectory.position(np.minimum(execution.time, trajectory.duration))
    aim = problem.robot.tool_position(planned)
    more, result = additional_distances(problem, trajectory, execution.time), []
    errors = errors or Robustness()
    for run in range(len(execution.plants)):
        checkpoint()
        result.append(_judged(problem, execution, run, (planned, aim), more, errors))
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
    )


def _largest(problem: PlanningProblem, time: FloatArray, values: FloatArray) -> Extreme:
    """Return the largest of the joints' values (K, n), with its time and joint."""
    sample, joint = np.unravel_index(int(values.argmax()), values.shape)
    location = Location(time=float(time[sample]), joint=problem.robot.joint_names[joint])
    return Extreme(float(values[sample, joint]), location)


# ---- Worst and median of each quantity over the runs.

# Quantities of a run; True where the least value is the worst.
_QUANTITIES = {
    "tube": False,
    "rotation": False,
    "points": False,
    "tracking": False,
    "tool_tracking": False,
    "position": False,
    "velocity": False,
    "obstacles": True,
    "self_collision": True,
}


@dataclass(frozen=True)
class RunSummary:
    """One quantity over all runs.

    Attributes:
        worst: The worst value, with its time and location.
        run: Index of its run.
        median: Median of all runs.
    """

    worst: Extreme
    run: int
    median: float

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        worst = {"value": self.worst.value, "place": self.worst.location.as_dict()}
        return {"worst": worst, "run": self.run, "median": self.median}


def summaries(runs: Sequence[JudgedRun]) -> dict[str, RunSummary | None]:
    """Return the worst and the median of every quantity of `JudgedRun`; None: not required."""
    result: dict[str, RunSummary | None] = dict.fromkeys(_QUANTITIES)
    for name, is_least in _QUANTITIES.items():
        extremes = [extreme for run in runs if (extreme := getattr(run, name)) is not None]
        if extremes:
            values = np.array([extreme.value for extreme in extremes])
            worst = int(values.argmin() if is_least else values.argmax())
            result[name] = RunSummary(extremes[worst], worst, float(np.median(values)))
    return result


# ---- Verdict: number of failed runs, and confidence bounds on the fraction of all that fail.

CONFIDENCE = 0.95
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
}


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
