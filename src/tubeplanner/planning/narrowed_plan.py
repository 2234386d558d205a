"""Planning through narrower tubes, where links get stuck on the way to a fast motion in a wide one.

Refinement is a local method: in a wide tube its first steps may lead links into an obstacle that
they do not get out of. Around a reference path that is free, a tube that is narrow enough has no
such way; and the motion in it is a start for the wide one.
"""

from contextlib import suppress
from dataclasses import replace

from tubeplanner.branches.known_branches import KnownBranches
from tubeplanner.errors import ProblemError
from tubeplanner.outcome import Infeasible
from tubeplanner.planning.plan_options import REFINEMENT, PlanOptions
from tubeplanner.planning.plan_result import PlanResult, certified_result
from tubeplanner.planning.refined_plan import certified_refinement, entered, refined_plan
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.progress import PlanningClock
from tubeplanner.refinement.phased_spline import PhasedSpline
from tubeplanner.refinement.refinement import Refinement

# Shares of the tube's radii that are tried.
_NARROWER = (0.5, 0.25)


def narrowed_plan(
    problem: PlanningProblem, options: PlanOptions, clock: PlanningClock
) -> PlanResult | None:
    """Return the certified motion that refinement makes of one in a narrower tube.

    Returns:
        None if there is none, or start or goal lie outside of narrower tubes.

    Raises:
        TimeLimitReached: Before there was one; likewise KeyboardInterrupt.
    """
    for share in _NARROWER:
        with suppress(ProblemError, Infeasible):  # start or goal outside, or nothing found
            narrower = problem.with_tube(problem.tube.scaled(share))
            found = refined_plan(narrower, KnownBranches(narrower, clock), options, clock)
            if found is None or found.motion is None or found.trajectory is None:
                continue
            if found.stopped_by is None:
                widened = _widened(problem, found.motion.spline, clock)
                if widened is not None and widened.succeeded:
                    return widened
            answer = certified_result(problem, found.trajectory, REFINEMENT, clock)
            return replace(answer, motion=found.motion, stopped_by=found.stopped_by)
    return None


def _widened(
    problem: PlanningProblem, start: PhasedSpline, clock: PlanningClock
) -> PlanResult | None:
    """Return what refinement in the whole tube makes of a motion in a narrower one."""
    refinement = Refinement(problem, start, (), entered(start.grid.interval_count, clock))
    return certified_refinement(problem, refinement, refinement.run_on, clock)
