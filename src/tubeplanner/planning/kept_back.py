"""How much of every limit a plan keeps back, so that it survives and is still the shortest."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.planning.plan_result import PlanResult
from tubeplanner.planning.tightened_plans import (
    Following,
    TightenedPlans,
    TriedPlan,
    require_not_stopped,
)
from tubeplanner.problem.tightening import Tightening
from tubeplanner.simulation.plant import Draw

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
