"""Plans for tightened problems, simulated; search for the least tightening."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import ProblemError
from tubeplanner.execution.error_contributions import Shortfall, shown_shortfall, simulated_runs
from tubeplanner.execution.plants import Draw
from tubeplanner.execution.run_verdict import RunVerdict, run_verdict
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.optimizer.starts import RefinedMotion
from tubeplanner.outcome import Infeasible, PlanningClock, TimeLimitReached
from tubeplanner.planning.result import PlanResult
from tubeplanner.planning.tightening import Tightening, allowed_tightening, tightened_problem
from tubeplanner.task.problem import PlanningProblem

# ---- Plans for problems with some of their limits kept back, and what simulation shows of them.

# What plans a problem, from the last motion if there is one.
Planning: TypeAlias = Callable[[PlanningProblem, RefinedMotion | None], PlanResult]
# What makes of the shortest motion the one that is written.
Following: TypeAlias = Callable[[PlanningProblem, PlanResult], PlanResult]

# Among few runs are none of the worst of many. With errors enlarged by so much there are: of 32
# such runs as many left the tube as of 400 and more with the errors as they are.
_ENLARGED = 1.3
_KEPT = ("radius", "rotation", "clearance", "position")


@dataclass(frozen=True, eq=False)
class TriedPlan:
    """A plan and what its runs show.

    Attributes:
        kept_back: Of the problem's limits.
        result: The plan, certified.
        verdict: Of the runs, with enlarged errors.
        shortfall: What they lack, and runs like them are expected to.
        wanted: What would have to be kept back for them to lack nothing, as far as that is allowed.
        lacking: Of what they lack, the largest share of a tolerance for which there is no room.
        expected: The duration with what is wanted kept back, by first-order prices [s].
    """

    kept_back: Tightening
    result: PlanResult
    verdict: RunVerdict
    shortfall: Shortfall
    wanted: Tightening
    lacking: float
    expected: float

    @property
    def survives(self) -> bool:
        """Whether none of its runs failed."""
        return self.verdict.failed == 0

    @property
    def duration(self) -> float:
        """Of the plan [s]."""
        assert self.result.duration is not None
        return self.result.duration


def require_not_stopped(result: PlanResult) -> None:
    """Raise TimeLimitReached or KeyboardInterrupt if that ended planning early."""
    if result.stopped_by == "time_limit":
        raise TimeLimitReached
    if result.stopped_by is not None:
        raise KeyboardInterrupt


class TightenedPlans:
    """Plans one problem with more or less kept back of its limits, and simulates the plans."""

    def __init__(
        self, problem: PlanningProblem, again: Planning, ends: FloatArray, clock: PlanningClock
    ) -> None:
        """Take a problem of joined segments with field robustness, and what plans others like it.

        Args:
            problem: The planning problem.
            again: What plans it with less room.
            ends: Configurations in which its motions begin and, if that is given, end, shape
                (1 or 2, n).
            clock: The planning's.
        """
        assert problem.robustness is not None
        self._errors = problem.robustness.enlarged(_ENLARGED)
        self._problem, self._again, self._ends, self._clock = problem, again, ends, clock
        self._known: dict[str, PlanResult | None] = {}
        self._simulated: list[TriedPlan] = []

    @property
    def survivor(self) -> TriedPlan | None:
        """Of the plans that survived the most runs the shortest; None: none has survived."""
        survivors = (tried for tried in self._simulated if tried.survives)
        return min(survivors, key=lambda one: (-one.verdict.runs, one.duration), default=None)

    def problem(self, kept_back: Tightening) -> PlanningProblem:
        """Return the problem with some of its limits kept back.

        Raises:
            ProblemError: It is none any more.
        """
        return tightened_problem(self._problem, kept_back)

    def allowed(self, asked: Tightening) -> Tightening:
        """Return as much of a tightening as limits, start and goal leave room for."""
        return allowed_tightening(self._problem, asked, self._ends)

    def planned(self, kept_back: Tightening, motion: RefinedMotion | None) -> PlanResult | None:
        """Return the shortest plan with that, from a motion if there is one; None: none was found.

        Raises:
            TimeLimitReached: Before there was one; likewise KeyboardInterrupt.
        """
        key = str(kept_back.as_dict())
        if key not in self._known:
            self._known[key] = self._planned(kept_back, motion)
        return self._known[key]

    def _planned(self, kept_back: Tightening, motion: RefinedMotion | None) -> PlanResult | None:
        try:
            found = self._again(self.problem(kept_back), motion)
        except (ProblemError, Infeasible):
            return None
        require_not_stopped(found)
        return replace(found, notes=()) if found.succeeded else None

    def simulated(self, kept_back: Tightening, result: PlanResult, draw: Draw) -> TriedPlan:
        """Return a plan with what its runs show, and remember it.

        Raises:
            TimeLimitReached: Before they ended.
        """
        assert result.trajectory is not None
        problem, clock = self._problem, self._clock
        clock.enter(f"{draw.runs} simulated runs")
        runs = simulated_runs(problem, result.trajectory, self._errors, draw, clock.check)
        found = shown_shortfall(problem, runs)
        asked = _with(kept_back, found)
        wanted = self.allowed(asked)
        prices = _prices(self.problem(kept_back).tube, result)
        more = sum(
            float(np.sum(price * (getattr(wanted, part) - getattr(kept_back, part))))
            for part, price in prices.items()
        )
        tried = TriedPlan(
            kept_back,
            result,
            run_verdict(runs),
            found,
            wanted,
            _lacking(problem, asked, wanted) + max(found.self_collision, 0.0),
            (result.duration or 0.0) + more,
        )
        self._simulated.append(tried)
        return tried

    def tried(
        self, kept_back: Tightening, motion: RefinedMotion | None, draw: Draw
    ) -> TriedPlan | None:
        """Return the shortest plan with what its runs show; None: no plan was found.

        Raises:
            TimeLimitReached: Before they ended; likewise KeyboardInterrupt.
        """
        result = self.planned(kept_back, motion)
        return None if result is None else self.simulated(kept_back, result, draw)


def _with(kept_back: Tightening, shortfall: Shortfall) -> Tightening:
    """Return what would have to be kept back, to the nearest that is short or to spare."""
    asked = {
        part: np.maximum(getattr(kept_back, part) + getattr(shortfall, part), 0.0) for part in _KEPT
    }
    return replace(kept_back, **(asked | {"clearance": float(asked["clearance"])}))


def _lacking(problem: PlanningProblem, asked: Tightening, allowed: Tightening) -> float:
    """Return the largest share of a tolerance that is asked for and not allowed."""
    rotation, tube = problem.tube.rotation, problem.tube
    whole = {
        "radius": tube.effective_radius,
        "rotation": 1.0 if rotation is None else rotation.bounds.min(axis=1),
        "clearance": tube.effective_radius.min(),
        "position": 1.0,
    }
    shares = [(getattr(asked, part) - getattr(allowed, part)) / whole[part] for part in _KEPT]
    return max(float(np.max(share)) for share in shares)


def _prices(tube: Tube, result: PlanResult) -> dict[str, FloatArray]:
    """Return what radii and rotation tolerances of a plan's tube cost, (m,) each [s/m or s/rad]."""
    sizes = tube_sizes(tube)
    prices = {part: np.zeros(tube.segment_count) for part in ("radius", "rotation")}
    for sensitivity in result.sensitivities:
        if sensitivity.limit not in sizes or sensitivity.segment is None:
            continue
        k = tube.segment_index(sensitivity.segment)
        part = "rotation" if sensitivity.limit == "rotation" else "radius"
        relative = -sensitivity.elasticity * (result.duration or 0.0)
        prices[part][k] += relative / sizes[sensitivity.limit][k]
    return prices


def tube_sizes(tube: Tube) -> dict[str, FloatArray]:
    """Return the sizes that a tube's limits have, by their names in sensitivities, (m,) each.

    Of boxes half the sides: what is kept back is taken off both [m]. Of rotation the least bound of
    each segment [rad].
    """
    sizes = {"radius": tube.radius}
    if tube.rotation is not None:
        sizes["rotation"] = tube.rotation.bounds.min(axis=1)
    if tube.cross_section is not None:
        sizes |= {"width": tube.cross_section[:, 0] / 2, "height": tube.cross_section[:, 1] / 2}
    return sizes


# ---- How much of every limit a plan keeps back, so that it survives and is still the shortest.

WORKING = Draw(32, seed=0)
FEWER = Draw(16, seed=0)  # of the same arms; enough to compare shares of effort
MANY = Draw(96, seed=0)  # which the plan that is written is to survive
# Shares of the effort limits, and of the velocity limits, that are tried.
_EFFORTS = (1, 0.98, 0.96, 0.945, 0.93, 0.91, 0.89, 0.865, 0.83, 0.79, 0.74, 0.67, 0.58, 0.48, 0.36)
_VELOCITIES = (1, 0.985, 0.97, 0.95, 0.93, 0.9, 0.86)
_BINDING = 0.01  # d ln T / d ln limit, from which on velocity limits are worth a try
_ROUNDS = 5
_MORE = 3  # smaller shares of effort that may still be better where radii cost more than expected
# So much of what is short is taken at a time, and so much of what is to spare is given back; which
# is worth a round if it gains more than this share of the duration.
_TAKEN, _GIVEN_BACK, _WORTH_IT = 1.1, 0.5, 2e-3


def surviving_plan(plans: TightenedPlans, shortest: TriedPlan, follow: Following) -> TriedPlan:
    """Return the plan that survives and is the shortest; or the one that lacks least.

    Args:
        plans: What plans and simulates.
        shortest: The shortest motion, nothing kept back.
        follow: What makes of such a motion the one that is written.

    Raises:
        TimeLimitReached: Before it was found; likewise KeyboardInterrupt.
    """
    rung = _best_share(plans, shortest, "effort", _EFFORTS)
    if _is_bound_by_velocity(rung.result):
        rung = _best_share(plans, rung, "velocity", _VELOCITIES)
    best = _settled(plans, rung)
    if not best.survives or _gains(rung, best):
        best = _with_less_effort(plans, rung, best)
    return _written(plans, best, follow)


def _with_less_effort(plans: TightenedPlans, rung: TriedPlan, best: TriedPlan) -> TriedPlan:
    """Return the best plan with less effort than one whose radii cost more than expected."""
    for effort in [share for share in _EFFORTS if share < rung.kept_back.effort][:_MORE]:
        kept_back = replace(rung.kept_back, effort=effort)
        result = plans.planned(kept_back, rung.result.motion)
        if result is None or (best.survives and _is_surely_longer(result, best)):
            break
        lower = plans.simulated(kept_back, result, FEWER)
        if not best.survives or (lower.lacking <= 0 and _gains(lower, best)):
            best = _better(best, _settled(plans, lower))
    return best


def _gains(tried: TriedPlan, best: TriedPlan) -> bool:
    """Return whether a plan, with what it lacks or has to spare, is expected to be shorter.

    Than another, or than it is itself, by what is worth a try.
    """
    return best.duration - tried.expected > _WORTH_IT * best.duration


def _is_bound_by_velocity(result: PlanResult) -> bool:
    return any(
        one.limit == "velocity" and -one.elasticity > _BINDING for one in result.sensitivities
    )


def _best_share(
    plans: TightenedPlans, start: TriedPlan, part: str, shares: Sequence[float]
) -> TriedPlan:
    """Return the plan with the best share of some limits, by what it is expected to take.

    Every second share is tried, until one is no better; then those beside the best.
    """
    found: dict[int, TriedPlan] = {0: start}

    def is_better(k: int, best: int) -> bool:
        share: dict[str, Any] = {part: shares[k]}
        kept_back = replace(start.kept_back, **share)
        result = plans.planned(kept_back, found[best].result.motion)
        if result is None or _is_surely_longer(result, found[best]):
            return False
        found[k] = plans.simulated(kept_back, result, FEWER)
        return _rank(found[k]) < _rank(found[best])

    best = 0
    for k in range(2, len(shares), 2):
        if is_better(k, best):
            best = k
        elif found[best].lacking <= 0:
            break
    for k in (best - 1, best + 1):
        if 0 < k < len(shares) and is_better(k, best):
            return found[k]
    return found[best]


def _rank(tried: TriedPlan) -> tuple[float, float]:
    """Return what is less for better plans: what cannot be had counts before the duration."""
    return tried.lacking, tried.expected


def _is_surely_longer(result: PlanResult, known: TriedPlan) -> bool:
    """Return whether a plan takes longer than a known one is expected to, whatever it lacks."""
    if not known.survives and known.lacking > 0:
        return False
    return (result.duration or np.inf) >= known.expected


def _settled(plans: TightenedPlans, rung: TriedPlan) -> TriedPlan:
    """Return the shortest plan that survives near one that lacks something, or what lacks least."""
    now = rung
    if rung.survives:  # of few arms; now of all
        now = plans.simulated(rung.kept_back, rung.result, WORKING)
    best = now
    for _ in range(_ROUNDS):
        tried = plans.tried(_next(plans, now), now.result.motion, WORKING)
        if tried is None:
            break
        had_one, now = best.survives, tried
        best = _better(best, now)
        if now.lacking > 0 or had_one or (now.survives and not _gains(now, now)):
            break
    return best


def _written(plans: TightenedPlans, settled: TriedPlan, follow: Following) -> TriedPlan:
    """Return the plan that is written: made smooth or thrifty, until it survives many arms."""
    kept_back, shortest, best = settled.kept_back, settled.result, settled
    for _ in range(_ROUNDS):
        result = follow(plans.problem(kept_back), shortest)
        require_not_stopped(result)
        if result.trajectory is None:
            break
        written = plans.simulated(kept_back, result, MANY)
        had_one = best is not settled and best.survives
        best = written if best is settled else _better(best, written)
        if had_one or not settled.survives or (written.survives and not _gains(written, written)):
            break
        kept_back = _next(plans, written)
        again = plans.planned(kept_back, shortest.motion)
        if again is None:
            break
        shortest = again
    return best


def _next(plans: TightenedPlans, tried: TriedPlan) -> Tightening:
    """Return what to keep back after a plan: all that it lacks, less of what it has to spare.

    As much as there is room for.
    """
    now, wanted = tried.kept_back, tried.wanted

    def between(before: FloatArray, after: FloatArray) -> FloatArray:
        change = after - before
        more: FloatArray = np.where(change > 0, _TAKEN, _GIVEN_BACK) * change
        return before + more

    following = replace(
        now,
        radius=between(now.radius, wanted.radius),
        rotation=between(now.rotation, wanted.rotation),
        position=between(now.position, wanted.position),
        clearance=float(between(np.array(now.clearance), np.array(wanted.clearance))),
    )
    return plans.allowed(following)


def _better(known: TriedPlan, tried: TriedPlan) -> TriedPlan:
    """Return the shorter of two plans that survive, the one that does, or what lacks less."""
    if known.survives and tried.survives:
        return min(known, tried, key=lambda plan: plan.duration)
    if known.survives or tried.survives:
        return known if known.survives else tried
    return min(known, tried, key=lambda plan: plan.verdict.failed / plan.verdict.runs)
