"""Steps of the optimiser: trust region, the programs of a step, the cost of each limit."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.optimizer.control_variables import shared_columns
from tubeplanner.optimizer.linearization import BROKEN, Linearization, Slack
from tubeplanner.optimizer.spline_constraints import Iterate
from tubeplanner.optimizer.step_program import Block, Step, StepProgram, step_program

# ---- The trust region: a box, and a damping of the step's rates.
#
# A linear program ends at the corners of its box. Where motors are not at their limits, corners are
# worth hardly more than points within, but the error of the linearization (Coriolis and centrifugal
# efforts) grows with the square of the step's rates: the damping adds that square to the cost.
# (Lewis & Wright, "A proximal method for composite minimization", 2016.) Box and damping are
# measured by the size of the motion: in a tube of a millimetre, a step of 1e-4 rad is large.

# A motion in which some joint moves farther than this is as large as any [joint units].
_LARGE_MOTION = 0.3
MIN_RADIUS, _MAX_RADIUS = 1e-4, 1.0
_POOR, _FAIR, _DECENT, _GOOD = 0.1, 0.3, 0.5, 0.7
_NEARLY_AT_RADIUS = 0.8
# Damping is at least doubled after a step that gained little, up to this fraction of the error of
# the step's predicted cost, and divided after a step that gained what it should.
_FRACTION_OF_ERROR = 0.2
_MORE, _LESS = 2.0, 5.0
# The error counts up to this. Where motors cannot hold the arm, or a contact its part, T^2 is
# infinite: that only shrinks the box.
_LARGEST_ERROR = 10.0
# In a tube of a millimetre, a damping of 1e7 is a useful one: only beyond all use it is the end.
_MIN_DAMPING, _MAX_DAMPING = 1e-9, 1e14
_HOLDS_BACK, _RELAXED = 0.2, 100.0
# So often damping is relaxed where it may be what lets a step gain little.
_MAX_RELAXED = 2


@dataclass(frozen=True)
class Outcome:
    """Predicted and actual gain of a step, as fractions of T^2, and its size."""

    predicted: float  # gain that the linearization predicts
    linear: float  # gain of the linear program's step
    gain: float  # gain of the step after its correction
    size: float  # the radius of the smallest trust region, in units, that contains the step
    squared_rates: float  # as in `StepCost.squared_rates`

    @property
    def ratio(self) -> float:
        """The gain as a fraction of the prediction."""
        return self.gain / max(self.predicted, 1e-12)


@dataclass(frozen=True)
class TrustRegion:
    """Radius and damping of the next step."""

    radius: float  # largest change of a control point, in units
    damping: float = _MIN_DAMPING  # weight of half the step's squared rates in its cost
    unit: float = 1.0  # of the radius [joint units]: see `motion_unit`
    times_relaxed: int = 0  # how often damping was relaxed

    @property
    def largest_change(self) -> float:
        """Largest change of a control point [joint units]."""
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
        if outcome.ratio > _FAIR or not np.isfinite(outcome.gain):
            return self.damping
        error = min(max(outcome.predicted - outcome.linear, 0.0), _LARGEST_ERROR)
        enough = _FRACTION_OF_ERROR * error / max(outcome.squared_rates, 1e-300)
        return max(_MORE * self.damping, enough)


def motion_unit(motions: Iterable[FloatArray]) -> float:
    """Return the unit of the trust radius [joint units]: 1, or less if all joints hardly move.

    The control points of every spline have shape (K, n) [joint units].
    """
    farthest = max(float(np.ptp(points, axis=0).max()) for points in motions)
    return min(farthest / _LARGE_MOTION, 1.0) or 1.0


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

        The iterates are those after the steps; the slack is of every leg's rows there, by their
        numbers.
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


# ---- Cost of each limit, by the multipliers of a leg's linear program.
#
# Multipliers hold for infinitesimal changes. Where the steps that a limit bars hardly use it, as
# next to a start on a tolerance, other limits bar them at once: where a multiplier is large, the
# program is solved with a rise of the limit.

# Where elastic rows cost more than this fraction of their penalty, multipliers tell the penalty:
# then this multiple of their violation is allowed, or this much.
_FRACTION_OF_PENALTY, _SPARE_FRACTION, _MIN_SPARE = 0.5, 2.0, 1e-5
# The rise. (Beside such a start, multipliers of a tolerance said 0.3 to 400 where rises of 0.1 % to
# 10 % gained nothing. Steps of the program have room for this one.)
_RISE = 0.03
_TOLERANCE = 1e-6  # of the solution, absolute and relative


def limit_costs(
    linear: Linearization,
    plausible: FloatArray,
    rise: FloatArray,
    shared: Mapping[int, Callable[[], FloatArray]],
) -> FloatArray | None:
    """Return the cost of each limit, shape (L,): d ln T^2 by its relative rise.

    Args:
        linear: The linearization.
        plausible: Costs up to which multipliers are believed, shape (L,).
        rise: The slack of each row per relative rise of its limit, by the rows' numbers; of planes
            it is 1.
        shared: Of limits that are not the only ones of their rows, by number: a function that
            returns the slack of all the program's rows per relative rise.

    Returns:
        None if constraints stay violated: multipliers tell the penalty alone.
    """
    step = _exact_step(linear)
    if step is None or step.elastic > BROKEN:
        return None
    limit, index = linear.limits()
    gained = np.where(index >= 0, rise[index], 1.0)
    count = len(step.multipliers)  # rows that were added later are not in the program
    costs, has_limit = np.zeros(len(plausible)), limit[:count] >= 0
    by_row = np.maximum(step.multipliers, 0.0) * gained[:count]
    np.add.at(costs, limit[:count][has_limit], by_row[has_limit])
    gains = {k: gain() for k, gain in shared.items()}
    for k, gain in gains.items():
        costs[k] = np.maximum(step.multipliers, 0.0) @ gain[:count]
    for k in np.flatnonzero(costs > plausible).tolist():
        risen = _solved(linear, _RISE * gains.get(k, gained * (limit == k)))
        if risen is not None:
            costs[k] = max(step.duration - risen.duration, 0.0) / _RISE
    return costs


def _exact_step(linear: Linearization) -> Step | None:
    """Return the step to the finer tolerance, or to the usual tolerance if the solver fails.

    If elastic rows stay slightly violated, that much is allowed: else multipliers tell the penalty.
    """
    search = StepSearch([linear], shared_columns([linear.shape], [False]))
    steps = search.solve()
    if steps is None:
        return None
    (exact,) = search.solve_closely(_TOLERANCE) or steps
    elastic = linear.elastic_rows
    cost = float(abs(exact.multipliers * elastic[: len(exact.multipliers)]).sum())
    if cost < _FRACTION_OF_PENALTY * linear.penalty:
        return exact
    spare = max(_SPARE_FRACTION * exact.elastic, _MIN_SPARE)
    return _solved(linear, spare * elastic) or exact


def _solved(linear: Linearization, extra: FloatArray) -> Step | None:
    """Return the step of the program whose rows have some more slack, shape (R,)."""
    columns = shared_columns([linear.shape], [False])
    steps = step_program([linear.block(linear.plain, extra)], columns).solve(_TOLERANCE)
    return None if steps is None else steps[0]
