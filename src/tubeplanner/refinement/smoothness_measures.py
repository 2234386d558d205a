"""How smooth a motion is: three measures, each seeing what the others do not.

The total variation of the efforts sees how often motors switch, their rates how fast, and jerk what
joints of little inertia do. Rates and jerks count with the fourth power, for their peaks, which are
at both ends.
"""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.constraints.joint_effort import JointEffort
from tubeplanner.constraints.joint_rate import JointRate
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.refinement.interval_motion import IntervalMotion
from tubeplanner.refinement.measure import MeasureModel, Weighted
from tubeplanner.refinement.phased_spline import PhasedSpline
from tubeplanner.refinement.sampled_spline import SampledSpline, sampled

# Weights of the logarithms: of effort rate and jerk to the fourth power, variation between them.
_WEIGHTS = (0.25, 1.0, 0.175)
_ROUNDED = 0.01  # changes of effort below this share of the limit count for less in the variation
# Joints that hardly move count as if they moved this share of the farthest.
_LEAST_TRAVEL = 0.05
_LOOKS = 200


def smoothness_measures(problem: PlanningProblem, spline: PhasedSpline, run_in: float) -> Weighted:
    """Return effort rate, effort variation and jerk, in the scales of one motion.

    Args:
        problem: The planning problem.
        spline: The motion.
        run_in: Its duration [s].
    """
    looks = spline.grid.samples_at(spline.switching_times, np.linspace(0.0, 1.0, _LOOKS))
    at = sampled(spline, looks)
    travel = np.ptp(at.position, axis=0)
    effort = JointEffort(_nominal_efforts(problem, at, run_in))
    jerk = JointRate("jerk", np.maximum(travel, _LEAST_TRAVEL * travel.max()))
    measures = (EffortRate(effort), EffortVariation(effort), Jerk(jerk))
    return tuple(zip(_WEIGHTS, measures, strict=True))


class EffortRate:
    """The integral of the efforts' rates to the fourth power."""

    def __init__(self, effort: JointEffort) -> None:
        """Take what efforts are shares of."""
        self._effort = effort

    def total(self, motion: IntervalMotion) -> float:
        """Return the integral, in one second."""
        return float((self._raised(motion) ** 4).sum())

    def model(self, motion: IntervalMotion, share: float) -> MeasureModel:
        """Return a share of it near a motion; residuals are what is raised to the fourth power."""
        rate, elapsed = self._raised(motion), motion.elapsed[:, :, None]
        scale = elapsed**-0.75
        faster = (-0.75 * rate / elapsed)[..., None] * motion.elapsed_by_switching[:, :, None]
        control, switching = _change_derivatives(motion, self._effort)
        return MeasureModel.of(
            12 * share * rate**2,
            4 * share * rate**3,
            control * scale[..., None, None],
            switching * scale[..., None] + faster,
        )

    def _raised(self, motion: IntervalMotion) -> FloatArray:
        rate: FloatArray = _changes(motion, self._effort) * motion.elapsed[:, :, None] ** -0.75
        return rate


class EffortVariation:
    """The total variation of the efforts, rounded where they hardly change."""

    def __init__(self, effort: JointEffort) -> None:
        """Take what efforts are shares of."""
        self._effort = effort

    def total(self, motion: IntervalMotion) -> float:
        """Return the sum of the changes' sizes."""
        change = _changes(motion, self._effort)
        return float((np.sqrt(change**2 + _ROUNDED**2) - _ROUNDED).sum())

    def model(self, motion: IntervalMotion, share: float) -> MeasureModel:
        """Return a share of it near a motion, as reweighted squares; residuals are the changes."""
        change = _changes(motion, self._effort)
        rounded = np.sqrt(change**2 + _ROUNDED**2)
        return MeasureModel.of(
            share / rounded,
            share * change / rounded,
            *_change_derivatives(motion, self._effort),
        )


class Jerk:
    """The integral of the jerks to the fourth power."""

    def __init__(self, jerk: JointRate) -> None:
        """Take what jerks are shares of."""
        self._jerk = jerk

    def total(self, motion: IntervalMotion) -> float:
        """Return the integral, in one second."""
        return float((self._raised(motion) ** 4).sum())

    def model(self, motion: IntervalMotion, share: float) -> MeasureModel:
        """Return a share of it near a motion; residuals are what is raised to the fourth power."""
        jerk, width = self._raised(motion), motion.width[:, None]
        root = width**0.25
        control, switching = motion.jerk_derivatives(self._jerk)
        wider = (jerk / (4 * width))[:, :, None] * motion.width_by_switching[:, None]
        return MeasureModel.of(
            12 * share * jerk**2,
            4 * share * jerk**3,
            control * root[:, :, None, None],
            switching * root[:, :, None] + wider,
        )

    def _raised(self, motion: IntervalMotion) -> FloatArray:
        jerk: FloatArray = motion.jerk(self._jerk) * motion.width[:, None] ** 0.25
        return jerk


def _changes(motion: IntervalMotion, effort: JointEffort) -> FloatArray:
    """Return by how much efforts change from sample to sample, shape (M, 2, I)."""
    return np.diff(motion.effort(effort), axis=1)


def _change_derivatives(
    motion: IntervalMotion, effort: JointEffort
) -> tuple[FloatArray, FloatArray]:
    """Return how these changes change, (M, 2, I, 5, n) and (M, 2, I, S)."""
    control, switching = motion.effort_derivatives(effort)
    return np.diff(control, axis=1), np.diff(switching, axis=1)


def _nominal_efforts(problem: PlanningProblem, at: SampledSpline, run_in: float) -> FloatArray:
    """Return the efforts that changes are shares of, (n,): limits, or what the motion takes."""
    limit = problem.robot.limits.effort
    position, velocity, acceleration = at.by_x[:3]
    taken = problem.robot.inverse_dynamics(position, velocity / run_in, acceleration / run_in**2)
    most = abs(taken).max(axis=0)
    return np.where(np.isfinite(limit), limit, np.where(most > 0, most, 1.0))
