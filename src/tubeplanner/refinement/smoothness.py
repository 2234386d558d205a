"""How smooth a motion is, and what a step makes of it: an objective beside the duration.

Three measures, each seeing what the others do not: the total variation of the efforts sees how
often motors switch, their rates how fast, and jerk what joints of little inertia do. Rates and
jerks count with the fourth power, for their peaks, which are at both ends. The measures' logarithms
are added, so that scales do not matter.
"""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.constraints.joint_effort import JointEffort
from tubeplanner.constraints.joint_rate import JointRate
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.refinement.control_variables import ControlVariables
from tubeplanner.refinement.interval_blocks import IntervalBlocks
from tubeplanner.refinement.linear_program import Quadratic, Step
from tubeplanner.refinement.phased_spline import DEGREE, KnotGrid, PhasedSpline, Samples
from tubeplanner.refinement.sampled_spline import SampledSpline, sampled
from tubeplanner.refinement.spline_constraints import Iterate

# Weights of the logarithms: of effort rate and jerk to the fourth power, variation between them.
_WEIGHTS = (0.25, 1.0, 0.175)
_ROUNDED = 0.01  # changes of effort below this share of the limit count for less in the variation
_NOTHING = 1e-12  # beside measures that may vanish
# Joints that hardly move count as if they moved this share of the farthest.
_LEAST_TRAVEL = 0.05
_LOOKS = 200
# What the sum of logarithms is worth at first, and at least, in shares of T^2: halved while steps
# would make the motion longer than it may be.
_FIRST_WORTH, _LEAST_WORTH = 5e-3, 5e-4
_LONGER = 1e-4
# Control points that count between two samples: those of a knot interval and the next.
_POINTS = DEGREE + 2


@dataclass(frozen=True, eq=False)
class _Measured:
    """What smoothness is measured by, over M knot intervals.

    Attributes:
        change: Changes of effort between samples, in limits, shape (2 M, n).
        elapsed: Between those samples, as a share of the duration, shape (2 M, 1).
        rate: The changes, so that their fourth powers add up to the integral of the rate's.
        jerk: So that the fourth powers add up to the integral of the jerk's, shape (M, n).
        totals: The measures: rate, variation, jerk, shape (3,).
    """

    change: FloatArray
    elapsed: FloatArray
    rate: FloatArray
    jerk: FloatArray
    totals: FloatArray


class Smoothness:
    """The `StepObjective` of a smoother motion within a duration."""

    least_duration_step = 0.0
    ignored_excess = 0.0  # gains are large here, beside what curvature brings

    def __init__(self, problem: PlanningProblem, spline: PhasedSpline, run_in: float) -> None:
        """Take scales from a trajectory.

        Args:
            problem: The planning problem.
            spline: The trajectory; others have its knots.
            run_in: The duration [s].
        """
        self.run_in = run_in
        self._worth = _FIRST_WORTH
        looks = spline.grid.samples_at(spline.switching_times, np.linspace(0.0, 1.0, _LOOKS))
        at = sampled(spline, looks)
        travel = np.ptp(at.position, axis=0)
        self._jerk = JointRate("jerk", np.maximum(travel, _LEAST_TRAVEL * travel.max()))
        self._effort = JointEffort(_nominal_efforts(problem, at, run_in))
        self._set_samples(spline.grid)
        self._blocks: IntervalBlocks | None = None
        self._last: tuple[Iterate, Quadratic] | None = None
        self._measured: list[tuple[Iterate, _Measured]] = []

    def value(self, current: Iterate) -> float:
        """Return the weighted sum of the measures' logarithms: the less, the smoother."""
        return float(np.log(self._measure(current).totals) @ _WEIGHTS)

    def cost(
        self, current: Iterate, variables: ControlVariables, regularization: Quadratic
    ) -> Quadratic:
        """Return the cost: convex quadratics of the measures, and eta."""
        own = self._model(current, variables).times(self._worth)
        self._last = current, own
        hessian = (own.hessian + regularization.hessian).tocsc()
        return Quadratic(hessian, own.gradient + regularization.gradient)

    def predicted_gain(self, current: Iterate, step: Step) -> float:
        """Return what a step should gain, of the cost that was asked for last."""
        assert self._last is not None
        change = np.concatenate([step.control.ravel(), step.switching])
        padded = np.append(change, [0.0, 0.0])
        own = self._last[1]
        less = -(own.gradient @ change) - padded @ (own.hessian @ padded) / 2
        return float(less + self._longer(current) - max(step.duration, 0.0))

    def gain(self, current: Iterate, trial: Iterate) -> float:
        """Return what being smoother is worth, less the share by which T^2 is longer."""
        if not np.isfinite(trial.squared_duration):
            return -np.inf
        longer = self._longer(trial) - self._longer(current)
        return self._worth * (self.value(current) - self.value(trial)) - longer

    def after(self, step: Step) -> None:
        """Let smoothness be worth less if the step would make the motion longer than it may be."""
        if step.duration > _LONGER:
            self._worth = max(self._worth / 2, _LEAST_WORTH)

    def _longer(self, iterate: Iterate) -> float:
        """Return by which share T^2 would have to be longer."""
        return max(iterate.squared_duration / self.run_in**2 - 1, 0.0)

    def _set_samples(self, grid: KnotGrid) -> None:
        """Choose the samples: two per knot interval and the end, of those that are watched."""
        self._intervals = grid.interval_count
        every = 2 * self._intervals
        self._which = np.append(np.arange(every), every + len(grid.shares) - 1)
        self._switches = grid.switch_count

    def _measure(self, current: Iterate) -> _Measured:
        for known, measured in self._measured:
            if known is current:
                return measured
        measured = self._measured_anew(current)
        self._measured = [*self._measured[-2:], (current, measured)]
        return measured

    def _measured_anew(self, current: Iterate) -> _Measured:
        effort = self._effort.used(current.watched[1]).at(1 / self.run_in)[self._which]
        change = np.diff(effort, axis=0)
        switching_times = current.spline.switching_times
        times = _samples(current.watched[0]).times(switching_times)[self._which]
        elapsed = np.diff(times)[:, None]
        rate = change * elapsed**-0.75
        width = elapsed[::2] + elapsed[1::2]
        jerk = self._jerk.used(current.rates[1]).at(1.0)[: self._intervals] * width**0.25
        variation = np.sqrt(change**2 + _ROUNDED**2) - _ROUNDED
        totals = np.array([(rate**4).sum(), variation.sum(), (jerk**4).sum()]) + _NOTHING
        return _Measured(change, elapsed, rate, jerk, totals)

    def _model(self, current: Iterate, variables: ControlVariables) -> Quadratic:
        """Return a convex quadratic of the value near a trajectory: that of Gauss and Newton."""
        measured = self._measure(current)
        curvature, slope = _derivatives(measured)
        control, switching = self._residuals(current, measured)
        weighted = control * curvature[:, :, None]
        by_control = np.swapaxes(control, 1, 2)
        blocks = by_control @ weighted
        mixed = np.swapaxes(weighted, 1, 2) @ switching
        corner = np.einsum("mri,mr,mrk->ik", switching, curvature, switching)
        gradient = np.einsum("mrv,mr->mv", control, slope)
        by_switching = np.einsum("mri,mr->i", switching, slope)
        if self._blocks is None:
            self._blocks = IntervalBlocks(variables, self._intervals, _POINTS, self._switches)
        return Quadratic(
            self._blocks.matrix(blocks, mixed, corner), self._blocks.vector(gradient, by_switching)
        )

    def _residuals(self, current: Iterate, measured: _Measured) -> tuple[FloatArray, FloatArray]:
        """Return how rates, changes and jerks change, interval by interval, R each.

        Returns:
            By the control points of the interval and the next, (M, R, 5 n), and by the switching
            times, (M, R, m-1).
        """
        change = self._by_effort(current)
        clock = _samples(current.watched[0]).times_by_switching(self._switches)[self._which]
        later = np.diff(clock, axis=0)[:, None, :]
        scale = measured.elapsed**-0.75
        faster = (-0.75 * measured.rate / measured.elapsed)[:, :, None] * later
        rate = change[0] * scale[:, :, None, None], change[1] * scale[:, :, None] + faster
        jerk = self._by_jerk(current, measured, later)
        control, switching = (
            [_by_interval(part, self._intervals) for part in parts]
            for parts in zip(rate, change, jerk, strict=True)
        )
        return np.concatenate(control, axis=1), np.concatenate(switching, axis=1)

    def _by_effort(self, current: Iterate) -> tuple[FloatArray, FloatArray]:
        """Return how the changes of effort change: (2 M, n, 5, n) and (2 M, n, m-1)."""
        at, path = current.watched
        control, switching = at.chained(self._effort.by_path(path, 1 / self.run_in))
        control, switching = control[self._which], switching[self._which]
        change = np.zeros((*control[1:].shape[:2], _POINTS, control.shape[3]))
        change[:, :, : DEGREE + 1] = -control[:-1]
        # The sample after the middle of an interval counts on the next one's control points; the
        # last one is of the last interval itself.
        change[::2, :, : DEGREE + 1] += control[1::2]
        change[1:-1:2, :, 1:] += control[2:-1:2]
        change[-1, :, : DEGREE + 1] += control[-1]
        return change, np.diff(switching, axis=0)

    def _by_jerk(
        self, current: Iterate, measured: _Measured, later: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return how the jerks change: (M, n, 5, n) and (M, n, m-1)."""
        at, path = current.rates
        control, switching = at.chained(self._jerk.by_path(path, 1.0))
        width = measured.elapsed[::2] + measured.elapsed[1::2]
        root = width**0.25
        wider = later[::2] + later[1::2]
        control = control[: self._intervals] * root[:, :, None, None]
        switching = switching[: self._intervals] * root[:, :, None]
        padding = [(0, 0), (0, 0), (0, 1), (0, 0)]
        return np.pad(control, padding), switching + (measured.jerk / (4 * width))[
            :, :, None
        ] * wider


def _nominal_efforts(problem: PlanningProblem, at: SampledSpline, run_in: float) -> FloatArray:
    """Return the efforts that changes are shares of, (n,): limits, or what the motion takes."""
    limit = problem.robot.limits.effort
    position, velocity, acceleration = at.by_x[:3]
    taken = problem.robot.inverse_dynamics(position, velocity / run_in, acceleration / run_in**2)
    most = abs(taken).max(axis=0)
    return np.where(np.isfinite(limit), limit, np.where(most > 0, most, 1.0))


def _samples(at: SampledSpline) -> Samples:
    assert isinstance(at.evaluation_points, Samples)
    return at.evaluation_points


def _derivatives(measured: _Measured) -> tuple[FloatArray, FloatArray]:
    """Return curvature and slope of the value by every rate, change and jerk, (M, R) each."""
    rate, change, jerk = measured.rate, measured.change, measured.jerk
    share = _WEIGHTS / measured.totals
    rounded = np.sqrt(change**2 + _ROUNDED**2)
    curvature = (12 * share[0] * rate**2, share[1] / rounded, 12 * share[2] * jerk**2)
    slope = (4 * share[0] * rate**3, share[1] * change / rounded, 4 * share[2] * jerk**3)
    rows = len(jerk)
    return (
        np.concatenate([part.reshape(rows, -1) for part in curvature], axis=1),
        np.concatenate([part.reshape(rows, -1) for part in slope], axis=1),
    )


def _by_interval(change: FloatArray, intervals: int) -> FloatArray:
    """Return derivatives of samples' quantities, (N, I, ...), by knot interval, (M, R, ...)."""
    samples, quantities = change.shape[:2]
    each = samples * quantities // intervals
    return change.reshape(intervals, each, change[0, 0].size)
