"""A motion of the optimiser, certified: samples are added where its certificate fails."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Protocol

from tubeplanner.arrays import IntArray
from tubeplanner.constraints.time_scaling import scaled_to_limits
from tubeplanner.planning.plan_options import REFINEMENT
from tubeplanner.planning.plan_result import PlanResult, certified_result, stopped_result
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.progress import PlanningClock, until_stopped
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.verification.certificate import Certificate

# How often the optimiser gets the times of failed conditions from a certificate.
_MAX_OBJECTIONS = 5


class OptimisedMotion(Protocol):
    """What the optimiser works on."""

    @property
    def has_spline(self) -> bool:
        """Whether there is a trajectory yet."""
        ...

    @property
    def gave_up(self) -> bool:
        """Whether it ended early, without hope."""
        ...

    @property
    def trajectory(self) -> JointTrajectory:
        """The best so far, as a trajectory that takes one second."""
        ...

    @property
    def segments(self) -> IntArray:
        """The tube segment of each of its polynomial pieces, shape (pieces,)."""
        ...

    def answer(self, certificate: Certificate, duration: float) -> bool:
        """Continue with samples where a certificate fails; return whether there was work to do."""
        ...


def certified_motion(
    problem: PlanningProblem,
    motion: OptimisedMotion,
    work: Callable[[], bool],
    clock: PlanningClock,
    *,
    timed: Callable[[JointTrajectory], JointTrajectory] = lambda shortest: shortest,
    needs_reason: bool = True,
) -> PlanResult | None:
    """Return the result of an optimised motion, with samples added where its certificate fails.

    After Ctrl-C or the time limit, certifies the best so far.

    Args:
        problem: The problem that is certified.
        motion: Of it, or of one whose tube lies inside of its.
        work: Its first part; returns whether there is anything to certify.
        clock: The planning's.
        timed: Makes what is certified of the motion as fast as its limits allow.
        needs_reason: Whether a certificate is to say why, even where the optimiser gave up.

    Returns:
        None if it gave up and no reason was needed, or there was nothing to certify.

    Raises:
        Infeasible: Nothing to start from.
    """
    result: PlanResult | None = None
    for _ in range(_MAX_OBJECTIONS):
        has_more, stopped_by = until_stopped(work)
        if stopped_by is not None and not motion.has_spline:
            return stopped_result(clock, stopped_by, REFINEMENT)
        if has_more is False:
            break
        if motion.gave_up and not needs_reason:
            return None
        trajectory = scaled_to_limits(problem, motion.trajectory, segments=motion.segments)
        trajectory = timed(trajectory)
        result = certified_result(problem, trajectory, REFINEMENT, clock)
        result = replace(result, stopped_by=stopped_by)
        if result.succeeded or result.certificate is None:
            break
        if motion.gave_up or stopped_by is not None:
            break
        work = partial(motion.answer, result.certificate, trajectory.duration)
    return result
