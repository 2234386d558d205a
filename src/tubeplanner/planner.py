"""From a problem to a certified trajectory, or to the reason why there is none."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from tubeplanner.branch_and_bound import BranchAndBound, SearchStatistics
from tubeplanner.candidate_waypoints import candidate_waypoints
from tubeplanner.certificate import Certificate
from tubeplanner.errors import OptionError, unknown_name
from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.problem import PlanningProblem
from tubeplanner.progress import PlanningClock, Progress, ProgressCallback, StoppedBy
from tubeplanner.reference_branch import (
    ReferenceBranch,
    SpareJoints,
    reference_branch,
    spare_joint_rules,
)
from tubeplanner.refinement import refine
from tubeplanner.refusal import refusal, require_free
from tubeplanner.sensitivities import Sensitivity, price_list
from tubeplanner.stop_at_corners import stop_at_corners
from tubeplanner.time_scaling import scaled_to_limits
from tubeplanner.trajectory import JointTrajectory
from tubeplanner.verification import verify

REFINEMENT, BRANCH_AND_BOUND = "refinement", "branch-and-bound"
STOP_AT_CORNERS = "stop-at-corners"
METHODS = (REFINEMENT, BRANCH_AND_BOUND, STOP_AT_CORNERS)
# Knot intervals from coarse to fine, for every start.
QUALITIES = {
    "fast": ((8, 24),),
    "balanced": ((8, 24, 64),),
    "best": ((8, 24, 64), (8, 24, 96), (16, 32, 96)),
}

# Where links would meet something, the tube is narrowed to these shares of its radii.
_TUBE_SHARES = (1.0, 0.5, 0.25)

_FEWEST_CANDIDATES, _MOST_CANDIDATES = 2, 1000
# A reference point that the hand passes farther away than this is pointed out.
_FAR_IN_RADII = 3.0
_LOOKS_PER_PIECE = 20


@dataclass(frozen=True)
class PlanOptions:
    """How to plan.

    Attributes:
        method: "refinement": path and speed optimised together; the next one where that is not
            certified. "branch-and-bound": the fastest motion through points of the reference path
            that cuts its corners inside the tube; the next one where it finds nothing faster.
            "stop-at-corners": along the reference path, resting at every reference point.
        quality: Of refinement. "fast": few knots, about half the time. "balanced". "best": many
            knots and two starts beside the balanced ones, about four times the time.
        candidate_points: From how many points on the reference path, start and goal included,
            branch and bound chooses. More take longer, exponentially in the worst case, and give
            other motions, not always faster ones.
        node_budget: After how many nodes branch and bound ends with the best it has; the result
            says so.
        time_limit: Wall time after which planning ends with the best it has [s]; None: never.
    """

    method: str = METHODS[0]
    quality: str = "balanced"
    candidate_points: int = 30
    node_budget: int = 10_000
    time_limit: float | None = None

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise OptionError(unknown_name("method", self.method, METHODS))
        if self.quality not in QUALITIES:
            raise OptionError(unknown_name("quality", self.quality, QUALITIES))
        if not _FEWEST_CANDIDATES <= self.candidate_points <= _MOST_CANDIDATES:
            raise OptionError(
                f"candidate_points is {self.candidate_points}; {_FEWEST_CANDIDATES} to "
                f"{_MOST_CANDIDATES} are accepted"
            )
        if not self.node_budget >= 1:
            raise OptionError(f"node_budget is {self.node_budget}; it must be >= 1")
        if self.time_limit is not None and not self.time_limit > 0:
            raise OptionError(f"time_limit is {self.time_limit:g} s; it must be > 0")


@dataclass(frozen=True, eq=False)
class PlanResult:
    """What came of planning.

    Attributes:
        status: Success means that the certificate passed.
        message: One sentence: the answer, or why there is none.
        place: Where, if there is no answer.
        method: What made the answer: one of `METHODS`.
        trajectory: The answer; None unless successful.
        certificate: Of the answer, or of the best attempt; None if there was none.
        planning_time: Wall time from the loaded problem to the certified result [s].
        certificate_time: The part of it that the answer's certificate took [s].
        search: What branch and bound did; None if it did not run.
        stopped_by: "time_limit" or "interrupt" if that ended planning early; None otherwise.
        sensitivities: What every limit costs, the dearest first; computed when first asked for.
            Empty unless the answer is refinement's.
    """

    status: PlanStatus
    message: str
    place: Place
    method: str
    trajectory: JointTrajectory | None = None
    certificate: Certificate | None = None
    planning_time: float = 0.0
    certificate_time: float = 0.0
    search: SearchStatistics | None = None
    stopped_by: StoppedBy | None = None
    _prices: Callable[[], tuple[Sensitivity, ...]] = tuple

    @cached_property
    def sensitivities(self) -> tuple[Sensitivity, ...]:
        """What every limit costs, the dearest first."""
        return self._prices()

    @property
    def succeeded(self) -> bool:
        """Whether there is a certified trajectory."""
        return self.status is PlanStatus.SUCCESS

    @property
    def duration(self) -> float | None:
        """Duration of the trajectory [s], None if there is none."""
        return None if self.trajectory is None else self.trajectory.duration

    @property
    def phase1_duration(self) -> float | None:
        """Duration of what branch and bound found [s], None if it found nothing faster."""
        return None if self.search is None else self.search.best_duration

    def as_dict(self) -> dict[str, Any]:
        """Return the fields of the command line's JSON, but for loading_time."""
        return {
            "status": str(self.status),
            "message": self.message,
            "where": self.place.as_dict(),
            "duration": self.duration,
            "phase1_duration": self.phase1_duration,
            "planning_time": self.planning_time,
            "certificate_time": self.certificate_time,
            "stopped_by": self.stopped_by,
            "method": self.method,
            "sensitivities": [asdict(price) for price in self.sensitivities],
            "search": None if self.search is None else self.search.as_dict(),
            "certificate": None if self.certificate is None else self.certificate.as_dict(),
        }


def plan(
    problem: PlanningProblem,
    options: PlanOptions | None = None,
    progress: ProgressCallback | None = None,
) -> PlanResult:
    """Plan a trajectory and certify it.

    Args:
        problem: What is asked.
        options: How to plan.
        progress: Called as each stage begins, and many times during the search.

    Returns:
        A result whose status is success only if the certificate passed; else its message and
        place say what stands in the way. Ctrl-C ends the search with the best so far.

    Raises:
        KeyboardInterrupt: Ctrl-C before anything was certified.
    """
    options = options or PlanOptions()
    clock = PlanningClock(options.time_limit, progress)
    known = _stopping_at_corners(problem, clock)
    result = known.result
    if known.branch and known.branch.moving_segments and options.method != STOP_AT_CORNERS:
        ordered = problem.tube.visit == "ordered"
        if options.method == REFINEMENT and ordered:
            result = _refined(problem, known.branch, result, options, clock)
        if result.method != REFINEMENT and clock.stopped_by is None:
            result = _improved(problem, known.branch, known, options, clock)
    return replace(result, planning_time=clock.elapsed, stopped_by=clock.stopped_by)


@dataclass(frozen=True, eq=False)
class _StopAtCorners:
    """What stopping at corners gave: its result, certified or not, and what that was made from."""

    result: PlanResult
    branch: ReferenceBranch | None = None
    motion: JointTrajectory | None = None


def _stopping_at_corners(problem: PlanningProblem, clock: PlanningClock) -> _StopAtCorners:
    """Return the first certified motion that stops at corners.

    If there is none, the most natural rule for the spare joints says why; branch and motion are the
    first there are.
    """
    reasons: dict[SpareJoints, PlanResult] = {}
    first_branch = first_motion = None
    for rule in spare_joint_rules(problem):
        try:
            clock.enter("inverse kinematics along the reference path")
            branch = reference_branch(problem, rule, clock.check)
            for name, q in (("start", branch.start), ("goal", branch.goal)):
                require_free(problem, name, q)
            clock.enter("motion along it, stopping at corners")
            first_branch = first_branch or branch
            motion = stop_at_corners(problem, branch, clock.check)
            first_motion = first_motion or motion
            clock.enter("certificate")
            result = _certified(problem, motion, STOP_AT_CORNERS, clock)
        except Infeasible as reason:
            result = PlanResult(reason.status, str(reason), reason.place, STOP_AT_CORNERS)
        if result.succeeded:
            return _StopAtCorners(result, branch, motion)
        if result.status is PlanStatus.TIME_LIMIT:
            return _StopAtCorners(result)
        reasons[rule] = result
    return _StopAtCorners(reasons[SpareJoints.AS_NEEDED], first_branch, first_motion)


def _refined(
    problem: PlanningProblem,
    branch: ReferenceBranch,
    known: PlanResult,
    options: PlanOptions,
    clock: PlanningClock,
) -> PlanResult:
    """Return the fastest certified motion that refinement finds, or else what is known."""
    best = known
    for intervals in QUALITIES[options.quality]:
        try:
            for share in _TUBE_SHARES:
                found = _refined_once(problem, branch, intervals, share, clock)
                if found.succeeded:
                    best = _faster(best, found)
                    break
        except KeyboardInterrupt:
            if not best.succeeded:
                raise
            clock.stopped_by = "interrupt"
            break
        except Infeasible as reason:  # the time limit, or nothing from this start
            if reason.status is PlanStatus.TIME_LIMIT:
                clock.stopped_by = "time_limit"
                break
    return best


def _refined_once(
    problem: PlanningProblem,
    branch: ReferenceBranch,
    intervals: tuple[int, ...],
    share: float,
    clock: PlanningClock,
) -> PlanResult:
    stage = f"refinement with {intervals[-1]} knots"
    clock.enter(stage)

    def checkpoint(duration: float) -> None:
        clock.announce(Progress(stage, best_duration=duration))
        clock.check()

    found = refine(problem, branch, intervals, tube_share=share, checkpoint=checkpoint)
    motion = scaled_to_limits(problem.robot, found.trajectory)
    result = _certified(problem, motion, REFINEMENT, clock)
    return replace(result, _prices=lambda: price_list(problem, found, motion.duration))


def _faster(known: PlanResult, found: PlanResult) -> PlanResult:
    """Return the faster of two results, the second of which is certified."""
    if known.duration is None or found.duration is None:
        return found
    return found if found.duration < known.duration else known


def _improved(
    problem: PlanningProblem,
    branch: ReferenceBranch,
    corners: _StopAtCorners,
    options: PlanOptions,
    clock: PlanningClock,
) -> PlanResult:
    """Return what branch and bound finds, if it is faster than stopping at corners.

    Even where that one failed its certificate: a search without a bound takes very long.
    """
    known, search = corners.result, None
    try:
        clock.enter("candidate points on the reference path")
        search = BranchAndBound(
            problem,
            candidate_waypoints(problem, branch, options.candidate_points, clock.check),
            upper_bound=np.inf if corners.motion is None else corners.motion.duration,
            node_budget=options.node_budget,
            checkpoint=clock.check,
        )
        _run(search, known, clock)
    except KeyboardInterrupt:
        if not known.succeeded and (search is None or search.best is None):
            raise
        clock.stopped_by = "interrupt"
    except Infeasible:  # the time limit, before the search began
        clock.stopped_by = "time_limit"
    return _better(problem, known, search, options, clock)


def _run(search: BranchAndBound, known: PlanResult, clock: PlanningClock) -> None:
    """Search until there is nothing better, or until time or budget end."""
    while not search.finished:
        if clock.remaining <= 0:
            clock.stopped_by = "time_limit"
            return
        search.expand()
        now = search.statistics
        best = now.best_duration or known.duration
        clock.announce(Progress("branch and bound", now.nodes, now.lower_bound, best))


def _better(
    problem: PlanningProblem,
    known: PlanResult,
    search: BranchAndBound | None,
    options: PlanOptions,
    clock: PlanningClock,
) -> PlanResult:
    """Return the search's answer, or else what was known before, and say what is to be said."""
    result = known
    if search is not None and search.best is not None:
        result = PlanResult(
            PlanStatus.SUCCESS,
            _success(problem, search.best),
            Place(),
            BRANCH_AND_BOUND,
            search.best,
            search.certificate,
            certificate_time=search.certificate_time,
        )
    elif clock.stopped_by == "time_limit" and not known.succeeded:
        message = "the time limit passed before a motion was found"
        result = PlanResult(PlanStatus.TIME_LIMIT, message, Place(), BRANCH_AND_BOUND)
    elif clock.stopped_by is None and known.succeeded:
        message = f"{result.message}; branch and bound found nothing faster"
        result = replace(result, message=message)
    if search is None:
        return result
    if search.statistics.budget_reached:
        message = f"{result.message}; the search ended at its budget of {options.node_budget} nodes"
        result = replace(result, message=message)
    return replace(result, search=search.statistics)


def _certified(
    problem: PlanningProblem, trajectory: JointTrajectory, method: str, clock: PlanningClock
) -> PlanResult:
    begin = clock.elapsed
    certificate = verify(problem, trajectory)
    certificate_time = clock.elapsed - begin
    reason = refusal(problem, certificate)
    if reason is None:
        status, message, place = PlanStatus.SUCCESS, _success(problem, trajectory), Place()
    else:
        status, message, place = reason.status, str(reason), reason.place
    return PlanResult(
        status,
        message,
        place,
        method,
        trajectory if reason is None else None,
        certificate,
        certificate_time=certificate_time,
    )


def _success(problem: PlanningProblem, trajectory: JointTrajectory) -> str:
    message = f"certified motion of {trajectory.duration:.4f} s"
    if problem.goal is None:
        q = ", ".join(f"{value:.4f}" for value in trajectory.position(trajectory.duration))
        message += f"; the goal was left open and became [{q}]"
    hand = problem.robot.tool_position(trajectory.per_piece(_LOOKS_PER_PIECE).position)
    distance = np.linalg.norm(hand[:, None] - problem.tube.points, axis=2).min(axis=0)
    reach = _FAR_IN_RADII * problem.tube.radius.max()
    for point in np.flatnonzero(distance > reach):
        message += (
            f"; it passes reference point {point} at {distance[point]:.3g} m: the capsules beside "
            "that point overlap elsewhere"
        )
    return message
