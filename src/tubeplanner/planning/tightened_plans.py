"""Plans for problems with some of their limits kept back, and what simulation shows of them."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import ProblemError
from tubeplanner.outcome import Infeasible
from tubeplanner.planning.plan_result import PlanResult
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.problem.tightening import Tightening, allowed_tightening, tightened_problem
from tubeplanner.progress import PlanningClock, TimeLimitReached
from tubeplanner.refinement.refined_motion import RefinedMotion
from tubeplanner.simulation.plant import Draw
from tubeplanner.simulation.run_verdict import RunVerdict, run_verdict
from tubeplanner.simulation.shortfall import Shortfall, shown_shortfall
from tubeplanner.simulation.simulated_runs import simulated_runs
from tubeplanner.tube.tube import Tube

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
