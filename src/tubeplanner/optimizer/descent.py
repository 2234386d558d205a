"""Descent: trust region, feasible steps, accepted iterates of one or more legs."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.optimizer.control_variables import shared_columns
from tubeplanner.optimizer.linearization import BROKEN, Linearization, Slack
from tubeplanner.optimizer.region_constraints import Planes
from tubeplanner.optimizer.spline_constraints import Iterate
from tubeplanner.optimizer.step_program import Block, Step, StepProgram, step_program

# ---- The trust region: a box, and a damping of the step's rates.
#
# A linear program ends at the corners of its box. Where motors are not at their limits, corners are
# worth hardly more than points within, but the error of the linearization (Coriolis and centrifugal
# efforts) grows with the square of the step's rates: the damping adds that square to the cost.
# (Lewis & Wright, "A proximal method for composite minimization", 2016.) Box and damping are
# measured by the size of the motion: in a tube of a millimetre, a step of 1e-4 rad is large.

# A motion in which some joint moves farther than this is as large as any [rad or m].
_LARGE_MOTION = 0.3
MIN_RADIUS, _MAX_RADIUS = 1e-4, 1.0
_POOR, _FAIR, _DECENT, _GOOD = 0.1, 0.3, 0.5, 0.7
_NEARLY_AT_RADIUS = 0.8
# Damping is at least doubled after a step that gained little, up to this fraction of the error of
# the step's predicted cost, and divided after a step that gained what it should.
_FRACTION_OF_ERROR = 0.2
_MORE, _LESS = 2.0, 5.0
# In a tube of a millimetre, a damping of 1e7 is a useful one: only beyond all use it is the end.
_MIN_DAMPING, _MAX_DAMPING = 1e-9, 1e14
_HOLDS_BACK, _RELAXED = 0.2, 100.0
# So often damping is relaxed where it may be what lets a step gain little.
_MAX_RELAXED = 2


@dataclass(frozen=True)
class Outcome:
    """Predicted and actual gain of a step, as fractions of T^2, and its size.

    Attributes:
        predicted: Gain that the linearization predicts.
        linear: Gain of the linear program's step.
        gain: Gain of the step after its correction.
        size: The radius of the smallest trust region, in units, that contains the step.
        squared_rates: As in `StepCost.squared_rates`.
    """

    predicted: float
    linear: float
    gain: float
    size: float
    squared_rates: float

    @property
    def ratio(self) -> float:
        """The gain as a fraction of the prediction."""
        return self.gain / max(self.predicted, 1e-12)


@dataclass(frozen=True)
class TrustRegion:
    """Radius and damping of the next step.

    Attributes:
        radius: Largest change of a control point, in units.
        damping: Weight of half the step's squared rates in its cost.
        unit: Of the radius [rad or m]: see `motion_unit`.
        times_relaxed: How often damping was relaxed.
    """

    radius: float
    damping: float = _MIN_DAMPING
    unit: float = 1.0
    times_relaxed: int = 0

    @property
    def largest_change(self) -> float:
        """Largest change of a control point [rad or m]."""
        return self.radius * self.unit

    @property
    def has_collapsed(self) -> bool:
        """True if radius or damping has reached its bound: the descent ends."""
        return self.radius < MIN_RADIUS or self.damping > _MAX_DAMPING

    @property
    def may_relax(self) -> bool:
        """True if damping may have limited the gain and has not been relaxed too often."""
        return self.damping * self.unit**2 > _HOLDS_BACK and self.times_relaxed < _MAX_RELAXED

    def relaxed(self) -> "TrustRegion":
        """Return the region with far less damping, to see the gain of steps then."""
        return replace(self, damping=self.damping / _RELAXED, times_relaxed=self.times_relaxed + 1)

    def smaller(self) -> "TrustRegion":
        """Return the region after a step that is infeasible or predicts a loss."""
        return replace(self, radius=0.4 * self.radius)

    def after(self, outcome: Outcome) -> "TrustRegion":
        """Return the region after a step with an outcome."""
        return replace(self, radius=self._next_radius(outcome), damping=self._next_damping(outcome))

    def _next_radius(self, outcome: Outcome) -> float:
        ratio, size = outcome.ratio, outcome.size
        if ratio < _POOR:
            return 0.4 * min(self.radius, max(size, MIN_RADIUS))
        if ratio > _GOOD and size > _NEARLY_AT_RADIUS * self.radius:
            return min(2 * self.radius, _MAX_RADIUS)
        return self.radius

    def _next_damping(self, outcome: Outcome) -> float:
        if outcome.ratio > _DECENT:
            return max(self.damping / _LESS, _MIN_DAMPING)
        if outcome.ratio > _FAIR:
            return self.damping
        error = max(outcome.predicted - outcome.linear, 0.0)
        enough = _FRACTION_OF_ERROR * error / max(outcome.squared_rates, 1e-300)
        return max(_MORE * self.damping, enough)


def motion_unit(motions: Iterable[FloatArray]) -> float:
    """Return the unit of the trust radius [rad or m]: 1, or less if all joints hardly move.

    Args:
        motions: Control points of every spline, shape (K, n).
    """
    farthest = max(float(np.ptp(points, axis=0).max()) for points in motions)
    return min(farthest / _LARGE_MOTION, 1.0) or 1.0


# ---- Shortening one or more legs by sequential linear programs with a trust region.
#
# Consecutive legs may be tied: one begins where the other ends, wherever that is best for the sum
# of their durations. A leg's gain counts by the leg's fraction of that sum.

# Steps that gain less than this fraction of the prediction get a second-order correction.
_GOOD_RATIO = 0.3
# Steps that gain less than this fraction of the prediction after the correction are rejected.
_WORTH_A_MOVE = 0.02
# A step that should lose this fraction of T^2 obeys planes of two segments that contradict each
# other.
_CONTRADICTION = 5e-4
# Steps that leave less than this fraction of the violation mend it, if not at once.
_MENDED = 0.9
FIRST_PENALTY, MAX_PENALTY = 3.0, 1e4


@dataclass(frozen=True, eq=False)
class Remembered:
    """Constraints of the last step's program that were not near: numbers of rows, and planes."""

    rows: IntArray
    planes: tuple[Planes, ...]


_NOTHING = Remembered(np.zeros(0, dtype=np.int64), ())


class Leg(Protocol):
    """A leg as the descent uses it."""

    def linearized(
        self, current: Iterate, trust: TrustRegion, penalty: float, remembered: Remembered
    ) -> Linearization:
        """Return the constraints and the cost of a step to first order."""
        ...

    def goal_after(self, current: Iterate, step: Step) -> FloatArray | None:
        """Return the configuration (n,) at a goal that moves; None if the tool leaves the goal."""
        ...

    def moved(self, current: Iterate, step: Step, start: FloatArray | None) -> Iterate | None:
        """Return the iterate after a step, its moved start at (n,) if given; None if infeasible."""
        ...

    def gains(
        self, current: Iterate, trial: Iterate, step: Step, penalty: float
    ) -> tuple[float, float]:
        """Return the predicted and the actual gain of a step, as fractions of T^2."""
        ...

    def slack(self, current: Iterate, trial: Iterate, step: Step) -> FloatArray:
        """Return the slack of a linearization's rows after a step, by their numbers."""
        ...

    def squared_rates(self, current: Iterate, step: Step) -> float:
        """Return the squared rates of a step, as `StepCost.squared_rates`."""
        ...

    def radius_of(self, current: Iterate, step: Step, unit: float) -> float:
        """Return the radius of the smallest trust region, in units, that contains a step."""
        ...

    def after(self, step: Step) -> None:
        """Record a solution of the step's program."""
        ...


@dataclass(frozen=True, eq=False)
class Improved:
    """Iterates and state at the end of a descent.

    Attributes:
        iterates: The trajectories of the least sum of durations.
        trust: The next step's trust region.
        penalty: Weight of the elastic constraints.
        has_ended: Whether the descent converged before the largest number of steps.
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


class Descent:
    """The optimisation of splines, each on a knot grid of its own."""

    def __init__(self, legs: Sequence[Leg], is_tied: Sequence[bool]) -> None:
        """Take legs.

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
        """Return trajectories with a smaller sum of durations, or the first iterates.

        Args:
            currents: The first iterates.
            trust: The first trust region; its unit is that of the trajectories.
            penalty: First weight of the elastic constraints.
            min_gain: The descent ends when a step should gain less than this fraction of T^2, or
                two accepted steps in a row gain less.
            max_steps: Largest number of steps.
            checkpoint: Called with all iterates after each step; it may raise to end the work.
        """
        unit = motion_unit(current.spline.control_points for current in currents)
        trust = replace(trust, unit=unit)
        small_gains, remembered = 0, (_NOTHING,) * len(self._legs)
        for _ in range(max_steps):
            linear = _Linearized(self._legs, self._is_tied, currents, trust, penalty, remembered)
            steps = linear.solve()
            remembered = remembered if steps is None else linear.remembered(steps)
            result = None if steps is None else self._tried(linear, steps, unit)
            if steps is None or result is None:
                trust = trust.smaller()
                continue
            trials, outcome = result
            # A higher penalty may help a step that leaves nearly all of the violation. A step that
            # mends a part is limited by its trust region: a higher penalty would mend no more, and
            # drown the duration. (After Byrd, Nocedal & Waltz, "Steering exact penalty methods for
            # nonlinear programming", 2008.)
            if any(
                step.elastic > max(BROKEN, _MENDED * current.excess)
                for current, step in zip(currents, steps, strict=True)
            ):
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
        self, linear: "_Linearized", steps: tuple[Step, ...], unit: float
    ) -> tuple[tuple[Iterate, ...], Outcome] | None:
        """Return the iterates after steps, corrected if they gain little, and their outcome.

        None if a step is infeasible or its program contradicts itself.
        """
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


class _Linearized:
    """All legs at their trajectories to first order: steps, trials and gains."""

    def __init__(
        self,
        legs: Sequence[Leg],
        is_tied: Sequence[bool],
        currents: Sequence[Iterate],
        trust: TrustRegion,
        penalty: float,
        remembered: Sequence[Remembered],
    ) -> None:
        self._legs, self._is_tied, self._currents = legs, is_tied, currents
        self._penalty = penalty
        durations = np.array([current.duration for current in currents])
        self._weights = (durations / durations.sum()).tolist()
        each = zip(legs, currents, remembered, self._weights, strict=True)
        self._linear = [
            leg.linearized(current, trust, penalty, own).weighted(weight)
            for leg, current, own, weight in each
        ]
        columns = shared_columns([linear.shape for linear in self._linear], is_tied)
        self._search = StepSearch(self._linear, columns)

    def solve(self) -> tuple[Step, ...] | None:
        return self._search.solve()

    def remembered(self, steps: Sequence[Step]) -> tuple[Remembered, ...]:
        each = zip(self._linear, steps, strict=True)
        return tuple(Remembered(linear.added, linear.binding(step)) for linear, step in each)

    def moved(self, steps: Sequence[Step]) -> tuple[Iterate, ...] | None:
        """Return the iterates after steps, tied ends agreeing; None if a leg has none."""
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
        """Return the predicted and the actual gain of steps: fractions of T^2, weighted."""
        predicted, gain = 0.0, 0.0
        each = zip(self._weights, self._legs, self._currents, trials, steps, strict=True)
        for weight, leg, current, trial, step in each:
            expected, actual = leg.gains(current, trial, step, self._penalty)
            predicted += weight * expected
            gain += weight * actual
        return predicted, gain

    def corrected(
        self, steps: Sequence[Step], trials: tuple[Iterate, ...], gain: float
    ) -> tuple[tuple[Iterate, ...], float]:
        """Return trials and gain, of steps corrected for the constraints' curvature if better.

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
        each = zip(self._legs, self._currents, steps, strict=True)
        return max(leg.radius_of(current, step, unit) for leg, current, step in each)


# ---- Steps of one or more legs: programs solved until their steps break no constraint.
#
# Constraints that a step breaks and its program lacked join the next program.

_MAX_ROUNDS, _MAX_CORRECTIONS = 4, 3
STEP_TOLERANCE = 1e-4  # of a step's cost
# Where solutions go on from the last one, constraints that a step this rough breaks join at once.
_ROUGH = 0.05


class StepSearch:
    """The search for the steps of all legs, in one program."""

    def __init__(self, legs: Sequence[Linearization], columns: Sequence[IntArray]) -> None:
        """Take the linearization and, as in `step_program`, the columns of every leg."""
        self._legs, self._columns = legs, columns
        self._program: StepProgram | None = None

    def solve(self) -> tuple[Step, ...] | None:
        """Return the step of every leg, or None if the program has no solution."""
        slack, steps = [leg.plain for leg in self._legs], None
        self._program = program = step_program(self._blocks(slack), self._columns)
        if program.goes_on:
            rough = program.solve(_ROUGH)
            if rough is not None and self._absorb(rough):
                program.join(self._blocks(slack))
        for _ in range(_MAX_ROUNDS):
            better = program.solve(STEP_TOLERANCE)
            if better is None:  # the step before may break rows; the correction mends some
                break
            steps = better
            if not self._absorb(steps):
                break
            program.join(self._blocks(slack))
        return steps

    def solve_closely(self, tolerance: float) -> tuple[Step, ...] | None:
        """Return the steps to a finer tolerance, after `solve`; None without a solution."""
        assert self._program is not None
        self._program.join(self._blocks([leg.plain for leg in self._legs]))
        return self._program.solve(tolerance)

    def solve_again(
        self, steps: Sequence[Step], trials: Sequence[Iterate], slack: Sequence[FloatArray]
    ) -> tuple[Step, ...] | None:
        """Return steps corrected for the curvature of the constraints; None without a solution.

        Args:
            steps: The first step of every leg.
            trials: The iterate after it.
            slack: Of every leg's rows there, by their numbers.
        """
        program = self._program
        if program is None:
            return None
        legs = list(zip(self._legs, steps, trials, slack, strict=True))
        corrected = [leg.corrected(step, trial, own) for leg, step, trial, own in legs]
        program.correct(self._blocks(corrected))
        others = program.solve(STEP_TOLERANCE)
        for _ in range(_MAX_CORRECTIONS - 1):
            if others is None:
                break
            each = zip(self._legs, others, corrected, steps, strict=True)
            if not any([leg.absorb_bent(o, own, step.elastic) for leg, o, own, step in each]):
                break
            program.join(self._blocks(corrected))
            others = program.solve(STEP_TOLERANCE)
        return others

    def _absorb(self, steps: Sequence[Step]) -> bool:
        """Add the constraints that steps break to the linearizations; True if there are some."""
        return any([leg.absorb(step) for leg, step in zip(self._legs, steps, strict=True)])

    def _blocks(self, slack: Sequence[Slack]) -> list[Block]:
        return [leg.block(own) for leg, own in zip(self._legs, slack, strict=True)]
