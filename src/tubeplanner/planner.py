"""From a problem to a certified trajectory, or to the reason why there is none."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.certificate import Certificate, Tolerance
from tubeplanner.errors import OptionError, unknown_name
from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.problem import PlanningProblem
from tubeplanner.reference_branch import SpareJoints, reference_branch, spare_joint_rules
from tubeplanner.stop_at_corners import stop_at_corners
from tubeplanner.trajectory import JointTrajectory
from tubeplanner.verification import verify

METHODS = ("stop-at-corners",)

Progress = Callable[[str], None]


@dataclass(frozen=True)
class PlanOptions:
    """How to plan.

    Attributes:
        method: "stop-at-corners": along the reference branch, resting at every reference point.
        time_limit: Wall time after which planning gives up [s]; None: never.
    """

    method: str = METHODS[0]
    time_limit: float | None = None

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise OptionError(unknown_name("method", self.method, METHODS))
        if self.time_limit is not None and not self.time_limit > 0:
            raise OptionError(f"time_limit is {self.time_limit:g} s; it must be > 0")


@dataclass(frozen=True, eq=False)
class PlanResult:
    """What came of planning.

    Attributes:
        status: Success means that the certificate passed.
        message: One sentence: the answer, or why there is none.
        place: Where, if there is no answer.
        method: How it was planned.
        trajectory: The answer; None unless successful.
        certificate: Of the answer, or of the best attempt; None if there was none.
        planning_time: Wall time from the loaded problem to the certified result [s].
        certificate_time: The part of it that the certificate took [s].
    """

    status: PlanStatus
    message: str
    place: Place
    method: str
    trajectory: JointTrajectory | None
    certificate: Certificate | None
    planning_time: float
    certificate_time: float

    @property
    def succeeded(self) -> bool:
        """Whether there is a certified trajectory."""
        return self.status is PlanStatus.SUCCESS

    @property
    def duration(self) -> float | None:
        """Duration of the trajectory [s], None if there is none."""
        return None if self.trajectory is None else self.trajectory.duration

    def as_dict(self) -> dict[str, Any]:
        """Return the fields of the command line's JSON, but for loading_time."""
        return {
            "status": str(self.status),
            "message": self.message,
            "where": self.place.as_dict(),
            "duration": self.duration,
            "phase1_duration": None,
            "planning_time": self.planning_time,
            "certificate_time": self.certificate_time,
            "stopped_by": None,
            "method": self.method,
            "certificate": None if self.certificate is None else self.certificate.as_dict(),
        }


def plan(
    problem: PlanningProblem,
    options: PlanOptions | None = None,
    progress: Progress | None = None,
) -> PlanResult:
    """Plan a trajectory and certify it.

    Args:
        problem: What is asked.
        options: How to plan.
        progress: Called with the name of each stage as it begins.

    Returns:
        A result whose status is success only if the certificate passed; else its message and
        place say what stands in the way.
    """
    options = options or PlanOptions()
    clock = _Clock(options.time_limit, progress)
    failures = {}
    for rule in spare_joint_rules(problem):
        result = _attempt(problem, rule, options, clock)
        if result.status in (PlanStatus.SUCCESS, *_FINAL):
            return result
        failures[rule] = result
    return replace(failures[SpareJoints.AS_NEEDED], planning_time=clock.elapsed)


# Reasons that do not depend on where the spare joints are.
_FINAL = (PlanStatus.TIME_LIMIT,)


def _attempt(
    problem: PlanningProblem, rule: SpareJoints, options: PlanOptions, clock: "_Clock"
) -> PlanResult:
    try:
        return _certified(problem, _trajectory(problem, rule, clock), options, clock)
    except Infeasible as reason:
        return PlanResult(
            reason.status, str(reason), reason.place, options.method, None, None, clock.elapsed, 0.0
        )


class _Clock:
    """Wall time since planning began; announces stages and ends planning at the time limit."""

    def __init__(self, time_limit: float | None, progress: Progress | None) -> None:
        self._begin = time.perf_counter()
        self._limit = np.inf if time_limit is None else time_limit
        self._progress = progress

    @property
    def elapsed(self) -> float:
        return time.perf_counter() - self._begin

    def enter(self, stage: str) -> None:
        self._stage = stage
        self.check()
        if self._progress is not None:
            self._progress(stage)

    def check(self) -> None:
        """Raise if the time limit has passed."""
        if self.elapsed > self._limit:
            message = f"the time limit of {self._limit:g} s passed before: {self._stage}"
            raise Infeasible(PlanStatus.TIME_LIMIT, message, Place())


def _trajectory(problem: PlanningProblem, rule: SpareJoints, clock: _Clock) -> JointTrajectory:
    clock.enter("inverse kinematics along the reference path")
    branch = reference_branch(problem, rule, clock.check)
    for name, q in (("start", branch.start), ("goal", branch.goal)):
        _require_free(problem, name, q)
    clock.enter("motion along it, stopping at corners")
    return stop_at_corners(problem, branch, clock.check)


def _require_free(problem: PlanningProblem, name: str, q: FloatArray) -> None:
    """Raise if a configuration is itself in collision or too near to an obstacle."""
    checker = problem.collision
    rotation, position = problem.robot.body_poses(q[None])
    for pairs, required in ((checker.obstacle_pairs, problem.clearance), (checker.link_pairs, 0.0)):
        if len(pairs) == 0:
            continue
        distance = checker.distances(rotation[0], position[0], pairs)
        worst = int(distance.argmin())
        if distance[worst] < required - Tolerance().absolute:
            links, obstacle = checker.owners(pairs[worst])
            where = f"in the {name} configuration"
            message = _blocked_message(problem, links, obstacle, distance[worst] - required, where)
            raise Infeasible(
                PlanStatus.TUBE_BLOCKED, message, Place(links=links, obstacle=obstacle)
            )


def _certified(
    problem: PlanningProblem, trajectory: JointTrajectory, options: PlanOptions, clock: _Clock
) -> PlanResult:
    clock.enter("certificate")
    begin = clock.elapsed
    certificate = verify(problem, trajectory)
    status, message, place = _judge(problem, trajectory, certificate)
    answer = trajectory if status is PlanStatus.SUCCESS else None
    end = clock.elapsed
    return PlanResult(status, message, place, options.method, answer, certificate, end, end - begin)


def _judge(
    problem: PlanningProblem, trajectory: JointTrajectory, certificate: Certificate
) -> tuple[PlanStatus, str, Place]:
    failures = certificate.failures()
    if not failures:
        message = f"certified motion of {trajectory.duration:.4f} s"
        if problem.goal is None:
            q = ", ".join(f"{value:.4f}" for value in trajectory.position(trajectory.duration))
            message += f"; the goal was left open and became [{q}]"
        return PlanStatus.SUCCESS, message, Place()
    blocked = [name for name in failures if name in ("obstacles", "self_collision")]
    if blocked:
        condition = certificate.conditions[blocked[0]]
        place, margin = condition.where, condition.margin or 0.0
        when = f"at t = {place.time or 0.0:.3f} s"
        message = _blocked_message(problem, place.links or (), place.obstacle, margin, when)
        return PlanStatus.TUBE_BLOCKED, message, place
    lines = "; ".join(certificate.describe(name) for name in failures)
    place = certificate.conditions[failures[0]].where
    return PlanStatus.CERTIFICATE_FAILED, f"the trajectory fails its certificate: {lines}", place


def _blocked_message(
    problem: PlanningProblem,
    links: tuple[str, ...],
    obstacle: str | None,
    margin: float,
    when: str,
) -> str:
    """Say which links are where, and how deep or how near."""
    if obstacle is None:
        return (
            f"{' and '.join(links)} overlap by {-1000 * margin:.1f} mm {when}; choose another "
            "configuration, or list the pair in collision.ignore if it may touch"
        )
    distance = 1000 * (margin + problem.clearance)
    near = f"comes within {distance:.1f} mm of"
    deed = near if distance > 0 else f"reaches {-distance:.1f} mm into"
    wanted = f" (clearance {1000 * problem.clearance:g} mm)" if problem.clearance else ""
    return (
        f"'{links[0]}' {deed} '{obstacle}'{wanted} {when}; move the reference points or choose "
        "another configuration"
    )
