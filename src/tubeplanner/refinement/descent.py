"""Shortening one or more legs by sequential linear programs with a trust region.

Legs that follow each other may be tied: where one ends the next begins, wherever that is best for
the sum of their durations. What a leg gains counts by its share of that sum.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.refinement.linearization import BROKEN, Linearization
from tubeplanner.refinement.region_constraints import Planes
from tubeplanner.refinement.shared_columns import shared_columns
from tubeplanner.refinement.spline_constraints import Iterate
from tubeplanner.refinement.step_block import Step
from tubeplanner.refinement.step_search import StepSearch
from tubeplanner.refinement.trust_region import Outcome, TrustRegion, motion_unit

# Steps that gain less than this share of the prediction get a second-order correction.
_GOOD_RATIO = 0.3
# Those that gain less than this share in the end are not made.
_WORTH_A_MOVE = 0.02
# A step that should lose this share of T^2 obeys planes of two segments that contradict each other.
_CONTRADICTION = 5e-4
# Steps that leave less than this share of what was broken mend it, if not at once.
_MENDED = 0.9
FIRST_PENALTY, MAX_PENALTY = 3.0, 1e4


@dataclass(frozen=True, eq=False)
class Remembered:
    """What the last step's program needed beyond what was near: numbers of rows, and planes."""

    rows: IntArray
    planes: tuple[Planes, ...]


_NOTHING = Remembered(np.zeros(0, dtype=np.int64), ())


class Leg(Protocol):
    """What the descent asks of a leg."""

    def linearized(
        self, current: Iterate, trust: TrustRegion, penalty: float, remembered: Remembered
    ) -> Linearization:
        """Return the constraints and the cost of a step to first order."""
        ...

    def goal_after(self, current: Iterate, step: Step) -> FloatArray | None:
        """Return the configuration (n,) at a goal that moves; None if the tool leaves it."""
        ...

    def moved(self, current: Iterate, step: Step, start: FloatArray | None) -> Iterate | None:
        """Return where a step leads, a start that moves to a configuration; None if nowhere."""
        ...

    def gains(
        self, current: Iterate, trial: Iterate, step: Step, penalty: float
    ) -> tuple[float, float]:
        """Return what a step should have gained, and what it did, in shares of T^2."""
        ...

    def slack(self, current: Iterate, trial: Iterate, step: Step) -> FloatArray:
        """Return the slack of a linearization's rows after a step, by their numbers."""
        ...

    def squared_rates(self, current: Iterate, step: Step) -> float:
        """Return the squared rates of a step, as `StepCost.squared_rates`."""
        ...

    def radius_of(self, current: Iterate, step: Step, unit: float) -> float:
        """Return the radius of the smallest trust region, in units, that has room for a step."""
        ...

    def after(self, step: Step) -> None:
        """Take note of a step that the program found."""
        ...


@dataclass(frozen=True, eq=False)
class Improved:
    """Where an improvement ended.

    Attributes:
        iterates: The trajectories of the least sum of durations.
        trust: The next step's trust region.
        penalty: Weight of the elastic constraints.
        has_ended: Whether it ended by itself, not after the steps that it was given.
    """

    iterates: tuple[Iterate, ...]
    trust: TrustRegion
    penalty: float
    has_ended: bool = False

    @property
    def iterate(self) -> Iterate:
        """The trajectory of a single leg."""
        (iterate,) = self.iterates
        return iterate


class _Linearized:
    """All legs at their trajectories to first order: steps, and what becomes of them."""

    def __init__(
        self,
        legs: Sequence[Leg],
        is_tied: Sequence[bool],
        currents: Sequence[Iterate],
        trust: TrustRegion,
        penalty: float,
        remembered: Sequence[Remembered],
    ) -> None:
        """Linearize legs, see `Descent`; what is remembered is of the last step's programs."""
        self._legs, self._is_tied, self._currents = legs, is_tied, currents
        self._penalty = penalty
        durations = np.array([current.duration for current in currents])
        self._weights = (durations / durations.sum()).tolist()
        each = zip(legs, currents, remembered, self._weights, strict=True)
        self._linear = [
            leg.linearized(current, trust, penalty, known).weighted(weight)
            for leg, current, known, weight in each
        ]
        columns = shared_columns([linear.shape for linear in self._linear], is_tied)
        self._search = StepSearch(self._linear, columns)

    def solve(self) -> tuple[Step, ...] | None:
        """Return the step of every leg, or None if there is none."""
        return self._search.solve()

    def remembered(self, steps: Sequence[Step]) -> tuple[Remembered, ...]:
        """Return what steps needed beyond what was near."""
        each = zip(self._linear, steps, strict=True)
        return tuple(Remembered(linear.added, linear.binding(step)) for linear, step in each)

    def moved(self, steps: Sequence[Step]) -> tuple[Iterate, ...] | None:
        """Return where steps lead, tied ends agreeing; None if one leads nowhere."""
        each = list(zip(self._legs, self._currents, steps, strict=True))
        starts: list[FloatArray | None] = [None] * len(each)
        for k, (leg, current, step) in enumerate(each):
            if self._is_tied[k]:
                goal = leg.goal_after(current, step)
                if goal is None:
                    return None
                starts[(k + 1) % len(each)] = goal
        trials = []
        for (leg, current, step), start in zip(each, starts, strict=True):
            trial = leg.moved(current, step, start)
            if trial is None:
                return None
            trials.append(trial)
        return tuple(trials)

    def gains(self, trials: Sequence[Iterate], steps: Sequence[Step]) -> tuple[float, float]:
        """Return what steps should have gained, and what they did: shares of T^2, weighted."""
        predicted, gain = 0.0, 0.0
        each = zip(self._weights, self._legs, self._currents, trials, steps, strict=True)
        for weight, leg, current, trial, step in each:
            expected, found = leg.gains(current, trial, step, self._penalty)
            predicted += weight * expected
            gain += weight * found
        return predicted, gain

    def corrected(
        self, steps: Sequence[Step], trials: tuple[Iterate, ...], gain: float
    ) -> tuple[tuple[Iterate, ...], float]:
        """Return trials, or better ones corrected for the constraints' curvature.

        (Second-order correction: Nocedal & Wright, "Numerical Optimization", 2006, section 18.3.)
        """
        each = zip(self._legs, self._currents, trials, steps, strict=True)
        slack = [leg.slack(current, trial, step) for leg, current, trial, step in each]
        others = self._search.solve_again(steps, trials, slack)
        if others is None:
            return trials, gain
        second = self.moved(others)
        if second is None:
            return trials, gain
        _, second_gain = self.gains(second, others)
        return (second, second_gain) if second_gain > gain else (trials, gain)

    def squared_rates(self, steps: Sequence[Step]) -> float:
        """Return the squared rates of steps, weighted as their cost is."""
        each = zip(self._weights, self._legs, self._currents, steps, strict=True)
        return sum(weight * leg.squared_rates(own, step) for weight, leg, own, step in each)

    def radius_of(self, steps: Sequence[Step], unit: float) -> float:
        """Return the radius of the smallest trust region, in units, that has room for steps."""
        each = zip(self._legs, self._currents, steps, strict=True)
        return max(leg.radius_of(current, step, unit) for leg, current, step in each)


class Descent:
    """The optimisation of splines, each on a knot grid of its own."""

    def __init__(self, legs: Sequence[Leg], is_tied: Sequence[bool]) -> None:
        """Prepare it.

        Args:
            legs: The legs.
            is_tied: Whether each leg ends where the next one begins, after the last leg the first.
        """
        self._legs, self._is_tied = legs, is_tied

    def improved(
        self,
        currents: tuple[Iterate, ...],
        trust: TrustRegion,
        penalty: float,
        *,
        min_gain: float,
        max_steps: int,
        checkpoint: Callable[[tuple[Iterate, ...]], None],
    ) -> Improved:
        """Return trajectories with a smaller sum of durations, if there are some.

        Args:
            currents: Where to start.
            trust: The first trust region; its unit is that of the trajectories.
            penalty: First weight of the elastic constraints.
            min_gain: A step that should gain less than this share of T^2 ends it, or two that do.
            max_steps: So many steps end it too.
            checkpoint: Called with all iterates; it may raise to end the work.
        """
        unit = motion_unit(current.spline.control_points for current in currents)
        trust = replace(trust, unit=unit)
        small_gains, remembered = 0, (_NOTHING,) * len(self._legs)
        for _ in range(max_steps):
            linear = _Linearized(self._legs, self._is_tied, currents, trust, penalty, remembered)
            steps = linear.solve()
            remembered = remembered if steps is None else linear.remembered(steps)
            tried = None if steps is None else self._tried(linear, steps, unit)
            if steps is None or tried is None:
                trust = trust.smaller()
                continue
            trials, outcome = tried
            if any(map(_mends_nothing, currents, steps)):
                penalty = min(4 * penalty, MAX_PENALTY)
            if outcome.ratio > _WORTH_A_MOVE:
                currents = trials
                small_gains = small_gains + 1 if outcome.gain < min_gain else 0
            checkpoint(currents)
            trust = trust.after(outcome)
            is_small = outcome.predicted < min_gain
            if is_small and trust.may_relax:
                trust, small_gains = trust.relaxed(), 0
            elif is_small or small_gains == 2 or trust.has_collapsed:
                return Improved(currents, trust, penalty, has_ended=True)
        return Improved(currents, trust, penalty, has_ended=False)

    def _tried(
        self, linear: _Linearized, steps: tuple[Step, ...], unit: float
    ) -> tuple[tuple[Iterate, ...], Outcome] | None:
        """Return where steps lead, corrected if they gain little; None if they cannot be made."""
        trials = linear.moved(steps)
        if trials is None:
            return None
        predicted, first_gain = linear.gains(trials, steps)
        if predicted < -_CONTRADICTION:
            return None
        gain = first_gain
        if gain < _GOOD_RATIO * predicted:
            trials, gain = linear.corrected(steps, trials, gain)
        for leg, step in zip(self._legs, steps, strict=True):
            leg.after(step)
        rates = linear.squared_rates(steps)
        return trials, Outcome(predicted, first_gain, gain, linear.radius_of(steps, unit), rates)


def _mends_nothing(current: Iterate, step: Step) -> bool:
    """Return whether a step leaves nearly all broken that was, or breaks more.

    Then a higher penalty may be wanted. What mends a part is held back by its region: a higher
    penalty would mend no more, and drown the duration. (After Byrd, Nocedal & Waltz, "Steering
    exact penalty methods for nonlinear programming", 2008.)
    """
    return step.elastic > max(BROKEN, _MENDED * current.excess)
