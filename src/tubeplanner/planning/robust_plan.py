"""Robust plans: survival of wrong masses, friction, delay.

What a certificate proves, it proves of the model. Of a motion at the limits little is left for
feedback, and one at the tube's border leaves it with any error. So some of every limit is kept back
and the motion planned again, until its simulated runs keep all limits: first the share of the
efforts with which, by first-order prices of what the tube then lacks, the motion is the shortest;
then radii, clearance and position limits by what is short with that.
"""

from dataclasses import replace

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.execution.error_contributions import Blame, blamed_errors, simulated_runs
from tubeplanner.execution.plants import Draw
from tubeplanner.execution.run_verdict import RunVerdict, run_verdict
from tubeplanner.geometry.tube.tube import narrowed_tube
from tubeplanner.optimizer.stages import Sensitivity
from tubeplanner.outcome import PlanningClock, until_stopped
from tubeplanner.planning.result import PlanResult, certified_result
from tubeplanner.planning.surviving_plans import (
    FEWER,
    WORKING,
    Following,
    Planning,
    TightenedPlans,
    TriedPlan,
    surviving_plan,
    tube_sizes,
)
from tubeplanner.planning.tightening import PARTS, Survival, Tightening
from tubeplanner.robot.notes import robot_notes
from tubeplanner.task.problem import PlanningProblem

# Arms that no choice was made with.
_FRESH = Draw(200, seed=1)
_DEAR = 0.05  # surviving that costs a larger share of the duration is explained


def robust_plan(
    problem: PlanningProblem,
    shortest: PlanResult,
    again: Planning,
    follow: Following,
    clock: PlanningClock,
) -> PlanResult:
    """Return a plan that survives the errors of field robustness in simulation.

    Args:
        problem: The planning problem, of joined segments.
        shortest: Its shortest motion, certified; or why there is none.
        again: What plans the problem with less room.
        follow: What makes of a shortest motion the one that is written.
        clock: The planning's.

    Returns:
        Certified for the problem itself. Where none survives, the one that lacks least, and it says
        so. Planning that is stopped early ends with what there is, not simulated if need be.
    """
    default = follow(problem, shortest)
    if default.trajectory is None or default.stopped_by is not None:
        return _not_simulated(default)
    search = _Search(problem, shortest, default, again, follow, clock)
    _, stopped_by = until_stopped(search.run)
    if stopped_by is not None:
        search.keep_survivor()
    if search.best is None:
        return _not_simulated(replace(default, stopped_by=stopped_by))
    return replace(search.answer(), stopped_by=stopped_by)


def _ends(problem: PlanningProblem, plan: PlanResult) -> FloatArray:
    """Return the configurations that all motions begin in and, if it is given, end in."""
    assert plan.trajectory is not None and plan.duration is not None
    times = [0.0] if problem.endpoints[1].is_open else [0.0, plan.duration]
    return plan.trajectory.position(np.array(times))


def _not_simulated(plan: PlanResult) -> PlanResult:
    """Return a plan that was not simulated, which says so."""
    if plan.trajectory is None:
        return plan
    return replace(plan, message=f"{plan.message}; whether it survives was not simulated")


class _Search:
    """Plans and simulates until a plan survives; keeps what it has when it is stopped."""

    def __init__(
        self,
        problem: PlanningProblem,
        shortest: PlanResult,
        default: PlanResult,
        again: Planning,
        follow: Following,
        clock: PlanningClock,
    ) -> None:
        self._problem, self._shortest, self._default = problem, shortest, default
        self._follow, self._clock = follow, clock
        assert problem.robustness is not None
        self._errors = problem.robustness
        self._plans = TightenedPlans(problem, again, _ends(problem, default), clock)
        self._first: TriedPlan | None = None
        self.best: TriedPlan | None = None
        self._verdict: RunVerdict | None = None
        self._verdict_without: RunVerdict | None = None
        self._costs: dict[str, float] = {}
        self._blame: Blame | None = None

    def run(self) -> None:
        """Do all the work.

        Raises:
            TimeLimitReached: It was not done in time; likewise KeyboardInterrupt.
        """
        nothing = Tightening.nothing(self._problem)
        self._first = self.best = self._plans.simulated(nothing, self._default, WORKING)
        if not self.best.survives:
            start = self.best
            if self._default.trajectory is not self._shortest.trajectory:
                start = self._plans.simulated(nothing, self._shortest, FEWER)
            self.best = surviving_plan(self._plans, start, self._follow)
        self._verdict = self._judged(self.best.result)
        if self.best is not self._first:
            self._verdict_without = self._judged(self._default)
            self._costs = self._split_costs(self._added)
        if not self.best.survives or self._added > _DEAR * self._first.duration:
            self._blame = self._blamed()

    def keep_survivor(self) -> None:
        """Take the shortest plan that survived so far, if the search was stopped."""
        if self.best is not None and not self.best.survives:
            self.best = self._plans.survivor or self.best

    @property
    def _added(self) -> float:
        """By how much the answer is longer than the default plan [s]."""
        assert self._first is not None and self.best is not None
        return self.best.duration - self._first.duration

    def _judged(self, plan: PlanResult) -> RunVerdict:
        """Return what becomes of a plan with arms that nothing was chosen by."""
        assert plan.trajectory is not None
        self._clock.enter(f"{_FRESH.runs} fresh simulated runs")
        checkpoint = self._clock.check
        runs = simulated_runs(self._problem, plan.trajectory, self._errors, _FRESH, checkpoint)
        return run_verdict(runs)

    def _split_costs(self, added: float) -> dict[str, float]:
        """Return what each part that is kept back costs [s], one after the other added."""
        assert self.best is not None
        kept_back = self.best.kept_back
        parts = [part for part in PARTS if kept_back.has(part)]
        durations, motion = [self._shortest.duration or 0.0], self._shortest.motion
        for count in range(1, len(parts)):
            found = self._plans.planned(kept_back.only(parts[:count]), motion)
            durations.append(durations[-1] if found is None else found.duration or 0.0)
        last = self._plans.planned(kept_back, motion) if parts else None
        durations.append(durations[-1] if last is None else last.duration or 0.0)
        steps = np.diff(durations)[: len(parts)]
        whole = float(steps.sum())
        scale = added / whole if whole > 0 else 0.0
        return {part: float(scale * step) for part, step in zip(parts, steps, strict=True)}

    def _blamed(self) -> Blame:
        """Return what errors do to the best plan, or if that survives, to the default one."""
        assert self.best is not None
        plan = self._default if self.best.survives else self.best.result
        assert plan.trajectory is not None
        self._clock.enter("which error is to blame")
        return blamed_errors(self._problem, plan.trajectory, self._errors, self._clock.check)

    def answer(self) -> PlanResult:
        """Return the best plan, certified for the problem itself."""
        assert self._first is not None and self.best is not None
        best, robot = self.best.result, self._problem.robot
        shortest = self._shortest.trajectory
        assert best.trajectory is not None
        certified = certified_result(self._problem, best.trajectory, best.method, self._clock)
        survival = Survival(
            verdict=self._verdict,
            reached=self.best.survives,
            kept_back=self.best.kept_back.of_parts(self._problem.tube),
            duration_without=self._first.duration,
            verdict_without=self._verdict_without,
            costs=self._costs,
            blame=self._blame,
        )
        return replace(
            certified,
            message=f"{certified.message}; {survival.seen}",
            search=best.search,
            sensitivities=_of_whole_limits(self._problem, self.best),
            motion=self._shortest.motion,
            shortest=None if best.trajectory is shortest else shortest,
            notes=(*dict.fromkeys((*robot_notes(robot), *best.notes)), *survival.notes),
            survival=survival,
        )


def _of_whole_limits(problem: PlanningProblem, tried: TriedPlan) -> tuple[Sensitivity, ...]:
    """Return what the problem's limits cost, from what those cost that a plan was left with.

    Shares of limits leave relative changes as they are; of a radius that is smaller by a length,
    they are larger.
    """
    tube, kept_back = problem.tube, tried.kept_back
    sizes = tube_sizes(tube)
    left = tube_sizes(narrowed_tube(tube, kept_back.radius, kept_back.rotation))
    found = []
    for one in tried.result.sensitivities:
        if one.limit in sizes and one.segment is not None:
            k = tube.segment_index(one.segment)
            larger = float(sizes[one.limit][k] / left[one.limit][k])
            one = replace(one, elasticity=larger * one.elasticity, saved=larger * one.saved)
        found.append(one)
    return tuple(sorted(found, key=lambda one: -one.saved))
