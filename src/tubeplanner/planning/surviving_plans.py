"""Plans for tightened problems, simulated; search for the least tightening."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import ProblemError
from tubeplanner.execution.error_contributions import shown_shortfall, simulated_runs
from tubeplanner.execution.plants import Draw
from tubeplanner.execution.run_verdict import RunVerdict, run_verdict
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.optimizer.starts import RefinedMotion
from tubeplanner.outcome import Infeasible, PlanningClock, TimeLimitReached
from tubeplanner.planning.result import PlanResult
from tubeplanner.planning.tightening import Tightening, allowed_tightening, tightened_problem
from tubeplanner.task.problem import PlanningProblem

# ---- Plans for tightened problems, and their simulated runs.

# Plans a problem, from the last motion if there is one.
Planning: TypeAlias = Callable[[PlanningProblem, RefinedMotion | None], PlanResult]
# Makes the written motion of the shortest one.
Following: TypeAlias = Callable[[PlanningProblem, PlanResult], PlanResult]

# Few runs hold none of the worst of many, but with enlarged errors they do: of 32 such runs as many
# left the tube as of 400 and more with the errors as they are.
_ENLARGED = 1.3
# Fraction of a velocity limit beyond the shortfall: of few arms the fastest is not among them.
_RESERVE = 0.01
# The parts of a tightening, beside velocity, that a shortfall changes.
_SIZES = ("radius", "rotation", "clearance", "position", "holding")
# The numbers of contacts whose relative rise gives about as much as that share of the nominal.
_NOMINAL = ("cup.force", "gripper.force", "tray.friction", "tray.foot", "liquid.tilt")


@dataclass(frozen=True, eq=False)
class Candidate:
    """A plan for a tightened problem, and the verdict of its simulated runs."""

    tightening: Tightening  # of the problem
    result: PlanResult  # the plan, certified
    verdict: RunVerdict  # verdict of the runs, with enlarged errors
    target: Tightening  # tightening without a shortfall, as far as the problem allows it
    deficit: float  # largest fraction of a tolerance by which that tightening is not allowed
    expected: float  # duration with that tightening, by first-order prices [s]

    @property
    def survives(self) -> bool:
        """True if no run failed."""
        return self.verdict.failed == 0

    @property
    def duration(self) -> float:
        """Duration of the plan [s]."""
        assert self.result.duration is not None
        return self.result.duration


def require_not_stopped(result: PlanResult) -> None:
    """Raise TimeLimitReached or KeyboardInterrupt if planning was stopped so."""
    if result.stopped_by == "time_limit":
        raise TimeLimitReached
    if result.stopped_by is not None:
        raise KeyboardInterrupt


class TightenedPlans:
    """Plans a problem with more or less tightening, and simulates the plans."""

    def __init__(
        self,
        problem: PlanningProblem,
        again: Planning,
        follow: Following,
        ends: FloatArray,
        clock: PlanningClock,
    ) -> None:
        """Take a problem of joined segments with field robustness, and ways to plan it.

        The ends are the first and, if given, the last configuration of motions, (1 or 2, n).
        """
        assert problem.robustness is not None
        self._errors = problem.robustness.enlarged(_ENLARGED)
        self.problem, self._again, self._follow = problem, again, follow
        self._ends, self.clock = ends, clock
        self._cached: dict[str, PlanResult | None] = {}
        self._simulated: list[Candidate] = []

    @property
    def survivor(self) -> Candidate | None:
        """The shortest of the plans that survived the most runs; None if no plan survived."""
        survivors = (plan for plan in self._simulated if plan.survives)
        return min(survivors, key=lambda plan: (-plan.verdict.runs, plan.duration), default=None)

    def allowed(self, requested: Tightening) -> Tightening:
        """Return a tightening reduced to the slack of limits, start and goal."""
        return allowed_tightening(self.problem, requested, self._ends)

    def planned(self, tightening: Tightening, motion: RefinedMotion | None) -> PlanResult | None:
        """Return the shortest plan of a tightened problem, from a motion if given, or None.

        Raises:
            TimeLimitReached: Before there was a plan; likewise KeyboardInterrupt.
        """
        key = str(tightening.as_dict())
        if key not in self._cached:
            self._cached[key] = None
            try:
                problem = tightened_problem(self.problem, tightening)
                shortest = self._again(problem, motion)
            except (ProblemError, Infeasible):
                return None
            require_not_stopped(shortest)
            if shortest.succeeded:
                written = self._follow(problem, replace(shortest, notes=()))
                require_not_stopped(written)
                if written.trajectory is not None:
                    self._cached[key] = replace(written, motion=shortest.motion)
        return self._cached[key]

    def simulated(self, tightening: Tightening, result: PlanResult, draw: Draw) -> Candidate:
        """Return and remember a plan with the verdict of its simulated runs.

        Raises:
            TimeLimitReached: Before the runs ended.
        """
        assert result.trajectory is not None
        problem, clock = self.problem, self.clock
        clock.enter(f"{draw.runs} simulated runs")
        runs = simulated_runs(problem, result.trajectory, self._errors, draw, clock.check)
        shortfall = shown_shortfall(problem, runs)
        # With these the runs would fall neither short nor have slack.
        sizes = {
            part: np.maximum(getattr(tightening, part) + getattr(shortfall, part), 0.0)
            for part in _SIZES
        }
        # Friction, and with it the distance from the plan, grows with the velocity.
        excess = np.maximum(shortfall.velocity + _RESERVE, shortfall.tracking)
        sizes["velocity"] = np.minimum(tightening.velocity / (1 + excess), 1.0)
        numbers = {part: float(sizes[part]) for part in ("clearance", "holding")}
        requested = replace(tightening, **(sizes | numbers))
        target = self.allowed(requested)
        more = _added_duration(
            tightened_problem(self.problem, tightening), result, tightening, target
        )
        # The largest fraction of a tolerance that is requested and not allowed.
        rotation, tube = problem.tube.rotation, problem.tube
        whole = {
            "radius": tube.effective_radius,
            "rotation": 1.0 if rotation is None else rotation.bounds.min(axis=1),
            "clearance": tube.effective_radius.min(),
            "position": 1.0,
            "holding": 1.0,
        }
        fractions = [
            (getattr(requested, part) - getattr(target, part)) / whole[part] for part in _SIZES
        ]
        fractions.append(target.velocity / requested.velocity - 1)
        deficit = max(float(np.max(each)) for each in fractions)
        candidate = Candidate(
            tightening,
            result,
            run_verdict(runs),
            target,
            deficit + max(shortfall.self_collision, 0.0) + max(shortfall.tool_tracking, 0.0),
            (result.duration or 0.0) + more,
        )
        self._simulated.append(candidate)
        return candidate

    def tried(
        self, tightening: Tightening, motion: RefinedMotion | None, draw: Draw
    ) -> Candidate | None:
        """Return the shortest plan of a tightened problem, simulated, or None without a plan.

        Raises:
            TimeLimitReached: Before the runs ended; likewise KeyboardInterrupt.
        """
        result = self.planned(tightening, motion)
        return None if result is None else self.simulated(tightening, result, draw)


def _added_duration(
    problem: PlanningProblem, result: PlanResult, tightening: Tightening, target: Tightening
) -> float:
    """Return the duration that another tightening would add to a plan, by its sensitivities [s].

    Durations change linearly with radii and rotation tolerances. They change with one over a
    fraction of a velocity limit: of half the velocities a motion takes up to twice the time.
    """
    tube, names, added = problem.tube, problem.robot.joint_names, 0.0
    sizes, slower = tube_sizes(tube), tightening.velocity / target.velocity - 1
    for sensitivity in result.sensitivities:
        if sensitivity.limit == "velocity" and sensitivity.joint in names:
            added -= sensitivity.elasticity * slower[names.index(sensitivity.joint)]
        if sensitivity.field is not None and sensitivity.field.endswith(_NOMINAL):
            added -= sensitivity.elasticity * (target.holding - tightening.holding)
        if sensitivity.limit not in sizes or sensitivity.segment is None:
            continue
        k = tube.segment_index(sensitivity.segment)
        part = "rotation" if sensitivity.limit == "rotation" else "radius"
        less = getattr(target, part)[k] - getattr(tightening, part)[k]
        added -= sensitivity.elasticity * float(less / sizes[sensitivity.limit][k])
    return added * (result.duration or 0.0)


def tube_sizes(tube: Tube) -> dict[str, FloatArray]:
    """Return the sizes of a tube's limits, by their names in sensitivities, (m,) [m or rad].

    Of boxes half the sides, as both sides are moved; of rotation the least bound of each segment.
    """
    sizes = {"radius": tube.radius}
    if tube.rotation is not None:
        sizes["rotation"] = tube.rotation.bounds.min(axis=1)
    if tube.cross_section is not None:
        sizes |= {"width": tube.cross_section[:, 0] / 2, "height": tube.cross_section[:, 1] / 2}
    return sizes


WORKING = Draw(32, seed=0)
FEWER = Draw(16, seed=0)  # of the same arms; enough to compare fractions of effort
MANY = Draw(96, seed=0)  # which the written plan is to survive
# Fractions of the effort limits.
_EFFORTS = (1, 0.98, 0.96, 0.945, 0.93, 0.91, 0.89, 0.865, 0.83, 0.79, 0.74, 0.67, 0.58, 0.48, 0.36)
_ROUNDS = 5
_MORE = 3  # smaller fractions of effort to try where radii cost more than expected
# Fraction of a shortfall that is added at a time, and fraction of slack that is given back; a round
# is worthwhile for a gain of more than this fraction of the duration.
_ADDED, _GIVEN_BACK, _MIN_GAIN = 1.1, 0.5, 2e-3


def surviving_plan(plans: TightenedPlans, default: Candidate) -> Candidate:
    """Return the shortest plan that survives, or the plan with the fewest failures.

    Raises:
        TimeLimitReached: Before the plan was known; likewise KeyboardInterrupt.
    """
    candidate = _best_effort(plans, default)
    best = _refined(plans, candidate)
    if not best.survives or _gains(candidate, best):
        # Less effort, where the candidate's radii cost too much.
        for effort in [each for each in _EFFORTS if each < candidate.tightening.effort][:_MORE]:
            tightening = replace(candidate.tightening, effort=effort)
            result = plans.planned(tightening, candidate.result.motion)
            if result is None or (best.survives and _is_surely_longer(result, best)):
                break
            lower = plans.simulated(tightening, result, FEWER)
            if not best.survives or (lower.deficit <= 0 and _gains(lower, best)):
                before, best = best, _better(best, _refined(plans, lower))
                if before.survives and best is before:
                    break
    # The shortest plan that many runs survive, or the plan with the fewest failures.
    rounds = _ROUNDS if best.survives else 0
    now = best = plans.simulated(best.tightening, best.result, MANY)
    for _ in range(rounds):
        if now.survives and not _gains(now, now):
            break
        following = plans.tried(_next(plans, now), now.result.motion, MANY)
        if following is None:
            break
        had_survivor, now = best.survives, following
        best = _better(best, now)
        if had_survivor and not now.survives:
            break
    return best


def safer_plan(plans: TightenedPlans, survivor: Candidate, draw: Draw) -> Candidate | None:
    """Return a plan that is tightened by what arms of a draw lacked, and survives; or None.

    Raises:
        TimeLimitReached: Before the plan was known; likewise KeyboardInterrupt.
    """
    now = plans.simulated(survivor.tightening, survivor.result, draw)
    for _ in range(_ROUNDS):
        following = plans.tried(_next(plans, now, given_back=0.0), now.result.motion, MANY)
        if following is None or following.survives:
            return following
        now = following
    return None


def _best_effort(plans: TightenedPlans, start: Candidate) -> Candidate:
    """Return the plan with the best fraction of effort, by its lack and expected duration.

    Every second fraction is tried, until there is no gain; then the best one's neighbours.
    """
    candidates: dict[int, Candidate] = {0: start}

    def is_better(k: int, best: int) -> bool:
        tightening, current = replace(start.tightening, effort=_EFFORTS[k]), candidates[best]
        result = plans.planned(tightening, current.result.motion)
        if result is None or _is_surely_longer(result, current):
            return False
        new = candidates[k] = plans.simulated(tightening, result, FEWER)
        # Tolerances that cannot be had count before the duration.
        return (new.deficit, new.expected) < (current.deficit, current.expected)

    best = 0
    for k in range(2, len(_EFFORTS), 2):
        if is_better(k, best):
            best = k
        elif candidates[best].deficit <= 0:
            break
    for k in (best - 1, best + 1):
        if 0 < k < len(_EFFORTS) and is_better(k, best):
            return candidates[k]
    return candidates[best]


def _is_surely_longer(result: PlanResult, other: Candidate) -> bool:
    """Return True if a plan takes longer than another's expected duration."""
    if not other.survives and other.deficit > 0:
        return False
    return (result.duration or np.inf) >= other.expected


def _refined(plans: TightenedPlans, candidate: Candidate) -> Candidate:
    """Return the shortest survivor near a candidate, or the plan with the fewest failures."""
    now = candidate
    if candidate.survives:  # of few arms; now of all
        now = plans.simulated(candidate.tightening, candidate.result, WORKING)
    best = now
    for _ in range(_ROUNDS):
        following = plans.tried(_next(plans, now), now.result.motion, WORKING)
        if following is None:
            break
        had_survivor, now = best.survives, following
        best = _better(best, now)
        has_failed = had_survivor and not now.survives
        if now.deficit > 0 or has_failed or (now.survives and not _gains(now, now)):
            break
    return best


def _gains(candidate: Candidate, best: Candidate) -> bool:
    """Return True if a plan's expected duration is worth a round, against the best or itself."""
    return best.duration - candidate.expected > _MIN_GAIN * best.duration


def _next(plans: TightenedPlans, tried: Candidate, given_back: float = _GIVEN_BACK) -> Tightening:
    """Return the next tightening after a plan: more than its shortfall, less of its slack."""
    now, target = tried.tightening, tried.target

    def between(before: FloatArray, after: FloatArray) -> FloatArray:
        change = after - before
        more: FloatArray = np.where(change > 0, _ADDED, given_back) * change
        return before + more

    following = replace(
        now,
        radius=between(now.radius, target.radius),
        rotation=between(now.rotation, target.rotation),
        position=between(now.position, target.position),
        clearance=float(between(np.array(now.clearance), np.array(target.clearance))),
        holding=float(between(np.array(now.holding), np.array(target.holding))),
        velocity=1 - between(1 - now.velocity, 1 - target.velocity),
    )
    return plans.allowed(following)


def _better(first: Candidate, second: Candidate) -> Candidate:
    """Return the shorter of two survivors, the only survivor, or the plan with fewer failures."""
    if first.survives and second.survives:
        return min(first, second, key=lambda plan: plan.duration)
    if first.survives or second.survives:
        return first if first.survives else second
    return min(first, second, key=lambda plan: plan.verdict.failed / plan.verdict.runs)
