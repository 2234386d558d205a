"""How far the next step may go: a box, and a damping of its rates.

A linear program ends at the corners of its box. Where motors are not at their limits, corners are
worth hardly more than what lies within, but what the linearization leaves out grows with the square
of the step's rates: Coriolis and centrifugal efforts. That much is added to the cost.
(Lewis & Wright, "A proximal method for composite minimization", 2016.)

Both are measured by the size of the motion: in a tube of a millimetre, a step of 1e-4 rad is large.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from tubeplanner.arrays import FloatArray

# A motion in which some joint moves farther than this is as large as any [rad or m].
_LARGE_MOTION = 0.3
MIN_RADIUS, _MAX_RADIUS = 1e-4, 1.0
_POOR, _FAIR, _DECENT, _GOOD = 0.1, 0.3, 0.5, 0.7
_NEARLY_AT_RADIUS = 0.8
# Damping is at least doubled after a step that gained little, up to this share of what the step's
# cost was off by, and divided after one that gained what it should.
_SHARE_OF_ERROR = 0.2
_MORE, _LESS = 2.0, 5.0
# In a tube of a millimetre, a damping of 1e7 is a useful one: only beyond all use it is the end.
_MIN_DAMPING, _MAX_DAMPING = 1e-9, 1e14
_HOLDS_BACK, _RELAXED = 0.2, 100.0
# So often damping is relaxed where it may be what lets a step gain little.
_MOST_RELAXED = 2


@dataclass(frozen=True)
class Outcome:
    """What became of a step.

    Attributes:
        predicted: What it should have gained.
        linear: What it did as the linear program gave it.
        gain: What it did in the end.
        size: The radius of the smallest trust region, in units, that has room for the step.
        squared_rates: As in `StepCost.squared_rates`.
    """

    predicted: float
    linear: float
    gain: float
    size: float
    squared_rates: float

    @property
    def ratio(self) -> float:
        """The gain as a share of the prediction."""
        return self.gain / max(self.predicted, 1e-12)


@dataclass(frozen=True)
class TrustRegion:
    """How far a step may go.

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
        """Whether no step is left to be tried."""
        return self.radius < MIN_RADIUS or self.damping > _MAX_DAMPING

    @property
    def may_relax(self) -> bool:
        """Whether a step may have gained little because it was damped, and that is worth a try."""
        return self.damping * self.unit**2 > _HOLDS_BACK and self.times_relaxed < _MOST_RELAXED

    def relaxed(self) -> "TrustRegion":
        """Return the region with far less damping, to see what steps gain then."""
        return replace(self, damping=self.damping / _RELAXED, times_relaxed=self.times_relaxed + 1)

    def smaller(self) -> "TrustRegion":
        """Return the region after a step that could not be made or contradicts itself."""
        return replace(self, radius=0.4 * self.radius)

    def after(self, outcome: Outcome) -> "TrustRegion":
        """Return the region after a step."""
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
        enough = _SHARE_OF_ERROR * error / max(outcome.squared_rates, 1e-300)
        return max(_MORE * self.damping, enough)


def motion_unit(motions: Iterable[FloatArray]) -> float:
    """Return what steps of splines are measured in [rad or m]: 1, or less if all hardly move.

    Args:
        motions: Control points of every spline, shape (K, n).
    """
    farthest = max(float(np.ptp(points, axis=0).max()) for points in motions)
    return min(farthest / _LARGE_MOTION, 1.0) or 1.0
