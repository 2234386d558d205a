"""Robust plans: survival of wrong masses, friction, delay.

A certificate proves conditions of the model alone. A motion at the limits leaves little effort for
feedback, and a motion at the tube's border leaves the tube with any error. So the problem is
tightened and planned again, until its simulated runs keep all limits: first by the fraction of the
efforts with which the motion is the shortest, by first-order prices of what falls short; then
velocities, radii, clearance and position limits by their shortfall.
"""

from dataclasses import replace

import numpy as np

from tubeplanner.execution.error_contributions import (
    ErrorContribution,
    blamed_errors,
    simulated_runs,
)
from tubeplanner.execution.plants import Draw
from tubeplanner.execution.run_verdict import KEPT, RunVerdict, run_verdict, summaries
from tubeplanner.geometry.tube.tube import narrowed_tube
from tubeplanner.optimizer.stages import Sensitivity
from tubeplanner.outcome import Infeasible, Location, PlanningClock, PlanStatus, until_stopped
from tubeplanner.planning.result import PlanResult, certified_result, refused_result
from tubeplanner.planning.surviving_plans import (
    WORKING,
    Candidate,
    Following,
    Planning,
    TightenedPlans,
    safer_plan,
    surviving_plan,
    tube_sizes,
)
from tubeplanner.planning.tightening import PARTS, Survival, Tightening
from tubeplanner.robot.notes import robot_notes
from tubeplanner.task.problem import PlanningProblem

# Arms that no choice was made with; those of the next draw, after one of a draw has failed.
_FRESH = (Draw(200, seed=1), Draw(200, seed=2), Draw(200, seed=3))
_MAX_COST = 0.05  # a larger cost of survival, as a fraction of the duration, is explained


def robust_plan(
    problem: PlanningProblem,
    shortest: PlanResult,
    again: Planning,
    follow: Following,
    clock: PlanningClock,
) -> PlanResult:
    """Return a plan that survives the errors of field robustness in simulation.

    `again` plans tightened problems, `follow` makes the written motion of a shortest one. The plan
    is certified for the problem itself, of joined segments; a refusal where no plan survives.
    Planning that is stopped early ends with the best so far, perhaps not simulated.
    """
    default = follow(problem, shortest)
    if default.trajectory is None or default.stopped_by is not None:
        return _not_simulated(default)
    # All motions begin and, if the goal is given, end in the same configurations.
    times = [0.0] if problem.endpoints[1].is_open else [0.0, default.trajectory.duration]
    ends = default.trajectory.position(np.array(times))
    plans = TightenedPlans(problem, again, follow, ends, clock)
    search = _Search(plans, shortest, default)
    _, stopped_by = until_stopped(search.run)
    if stopped_by is not None:
        search.keep_survivor()
    if search.best is None:
        return _not_simulated(replace(default, stopped_by=stopped_by))
    refusal = search.refusal() if stopped_by is None else None
    return replace(refusal or search.answer(), stopped_by=stopped_by)


def _not_simulated(plan: PlanResult) -> PlanResult:
    """Return a plan with the message that simulation is missing."""
    if plan.trajectory is None:
        return plan
    return replace(plan, message=f"{plan.message}; whether it survives was not simulated")


class _Search:
    """Plans and simulates until a plan survives; keeps the best plan so far."""

    def __init__(self, plans: TightenedPlans, shortest: PlanResult, default: PlanResult) -> None:
        assert plans.problem.robustness is not None
        self._plans, self._problem, self._clock = plans, plans.problem, plans.clock
        self._shortest, self._default = shortest, default
        self._errors = plans.problem.robustness
        self._first: Candidate | None = None
        self.best: Candidate | None = None
        self._verdict: RunVerdict | None = None
        self._verdict_without: RunVerdict | None = None
        self._costs: dict[str, float] = {}
        self._contribution: ErrorContribution | None = None
        self._failure = Location()

    def run(self) -> None:
        """Do all the work.

        Raises:
            TimeLimitReached: Before it was done; likewise KeyboardInterrupt.
        """
        nothing = Tightening.nothing(self._problem)
        default = replace(self._default, motion=self._shortest.motion)
        self._first = self.best = self._plans.simulated(nothing, default, WORKING)
        if not self.best.survives:
            self.best = surviving_plan(self._plans, self.best)
        for fresh in _FRESH:
            self._verdict = self._judged(self.best.result, fresh)
            if self._verdict.failed == 0 or not self.best.survives or fresh is _FRESH[-1]:
                break
            safer = safer_plan(self._plans, self.best, fresh)
            if safer is None:
                break
            self.best = safer
        if self.best is not self._first:
            self._verdict_without = self._judged(self._default, fresh)
            # The cost of each part of the tightening [s], parts added in turn.
            tightening = self.best.tightening
            parts = [part for part in PARTS if tightening.has(part)]
            durations, motion = [self._shortest.duration or 0.0], self._shortest.motion
            for count in range(1, len(parts)):
                with_part = self._plans.planned(tightening.only(parts[:count]), motion)
                durations.append(durations[-1] if with_part is None else with_part.duration or 0.0)
            final = self._plans.planned(tightening, motion) if parts else None
            durations.append(durations[-1] if final is None else final.duration or 0.0)
            steps = np.diff(durations)[: len(parts)]
            whole = float(steps.sum())
            scale = self._added / whole if whole > 0 else 0.0
            self._costs = {
                part: float(scale * step) for part, step in zip(parts, steps, strict=True)
            }
        if not self.best.survives or self._added > _MAX_COST * self._first.duration:
            plan = self._default if self.best.survives else self.best.result
            assert plan.trajectory is not None
            self._clock.enter("which error is to blame")
            checkpoint = self._clock.check
            self._contribution = blamed_errors(
                self._problem, plan.trajectory, self._errors, checkpoint
            )

    def keep_survivor(self) -> None:
        """Take the shortest survivor so far, if the search was stopped."""
        if self.best is not None and not self.best.survives:
            self.best = self._plans.survivor or self.best

    @property
    def _added(self) -> float:
        """Duration of the answer beyond the default plan's [s]."""
        assert self._first is not None and self.best is not None
        return self.best.duration - self._first.duration

    def _judged(self, plan: PlanResult, fresh: Draw) -> RunVerdict:
        """Return the verdict of a plan's runs with arms that no choice was made with."""
        assert plan.trajectory is not None
        self._clock.enter(f"{fresh.runs} fresh simulated runs")
        checkpoint = self._clock.check
        runs = simulated_runs(self._problem, plan.trajectory, self._errors, fresh, checkpoint)
        verdict = run_verdict(runs)
        worst = summaries(runs)[max(KEPT, key=lambda name: verdict.broken[name])]
        if plan is not self._default and worst is not None:
            self._failure = worst.worst.location
        return verdict

    def refusal(self) -> PlanResult | None:
        """Return the refusal of errors that no plan survives; None if the best plan does."""
        assert self.best is not None and self._verdict is not None
        if self.best.survives or self._verdict.failed == 0:
            return None
        reason = Infeasible(
            PlanStatus.NO_TRAJECTORY,
            f"no plan survives these errors; of the best one {self._verdict}; "
            f"{self._contribution}; smaller errors or a wider tube would help, or more time: "
            "robot.limits.scale",
            self._failure,
        )
        return replace(refused_result(reason, self.best.result.method), survival=self._survival)

    def answer(self) -> PlanResult:
        """Return the best plan, certified for the problem itself."""
        assert self._first is not None and self.best is not None
        best, robot = self.best.result, self._problem.robot
        shortest = self._shortest.trajectory
        assert best.trajectory is not None
        certified = certified_result(self._problem, best.trajectory, best.method, self._clock)
        survival = self._survival
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

    @property
    def _survival(self) -> Survival:
        assert self._first is not None and self.best is not None
        return Survival(
            errors=self._errors,
            verdict=self._verdict,
            reached=self.best.survives,
            tightening=self.best.tightening.of_parts(self._problem.tube),
            duration_without=self._first.duration,
            verdict_without=self._verdict_without,
            costs=self._costs,
            contribution=self._contribution,
        )


def _of_whole_limits(problem: PlanningProblem, tried: Candidate) -> tuple[Sensitivity, ...]:
    """Return the sensitivities of the problem's limits, from a plan's tightened limits.

    Fractions of limits leave relative changes as they are. Of a radius reduced by a length,
    relative changes grow by the ratio of the radii.
    """
    tube, tightening = problem.tube, tried.tightening
    sizes = tube_sizes(tube)
    narrowed = tube_sizes(narrowed_tube(tube, tightening.radius, tightening.rotation))
    result = []
    for each in tried.result.sensitivities:
        if each.limit in sizes and each.segment is not None:
            k = tube.segment_index(each.segment)
            ratio = float(sizes[each.limit][k] / narrowed[each.limit][k])
            each = replace(each, elasticity=ratio * each.elasticity, saved=ratio * each.saved)
        result.append(each)
    return tuple(sorted(result, key=lambda each: -each.saved))
