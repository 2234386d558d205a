"""Measures of a motion of fixed duration: energy, work, deviation from the reference, smoothness.

M knot intervals, n joints, S switching times that may move, I quantities of a sample.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.geometry.tube.regions import SegmentRegions
from tubeplanner.limits.joint_efforts import JointEffort
from tubeplanner.limits.peaks import EffortCosts
from tubeplanner.limits.rates import JointRate
from tubeplanner.optimizer.phased_spline import DEGREE, PhasedSpline, Samples, sampled
from tubeplanner.optimizer.spline_constraints import Iterate
from tubeplanner.task.demands import DEVIATION, ENERGY, SMOOTHNESS, Objective
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import from_spline

# Number of control points that count from the beginning of an interval to that of the next.
POINTS = DEGREE + 2
# Beginning, middle and end; the integral by Simpson's rule.
_SAMPLES = 3
SIMPSON = np.array([1.0, 4.0, 1.0]) / 6


class IntervalMotion:
    """A motion in a given duration, at the beginning, middle and end of every knot interval.

    Attributes:
        run_in: The duration [s].
        path: The arm at the watched samples.
        rates: The spline and the arm at the beginning of every interval, and more.
        intervals: Number M of knot intervals.
    """

    def __init__(self, current: Iterate, run_in: float) -> None:
        """Take a motion and its duration [s]."""
        self.run_in = run_in
        self._at, self.path = current.watched
        self.rates = current.rates
        self._switching_times = current.spline.switching_times
        grid = current.spline.grid
        self.intervals, self._switches = grid.interval_count, grid.switch_count
        # Of the watched samples, two per interval and the end.
        every = 2 * self.intervals
        self._which = np.append(np.arange(every), every + len(grid.fractions) - 1)
        self._positions = 2 * np.arange(self.intervals)[:, None] + np.arange(_SAMPLES)
        self._cached: dict[JointEffort, tuple[FloatArray, FloatArray]] = {}

    @cached_property
    def elapsed(self) -> FloatArray:
        """Time from sample to sample, as a fraction of the duration, shape (M, 2)."""
        return np.diff(self.at_samples(self._samples.times(self._switching_times)), axis=1)

    @cached_property
    def elapsed_by_switching(self) -> FloatArray:
        """Derivatives of `elapsed` by the switching times, shape (M, 2, S)."""
        return np.diff(self.at_samples(self._samples.times_by_switching(self._switches)), axis=1)

    @property
    def width(self) -> FloatArray:
        """Widths of the intervals, as fractions of the duration, shape (M,)."""
        return self.elapsed[:, 0] + self.elapsed[:, 1]

    @property
    def width_by_switching(self) -> FloatArray:
        """Derivatives of `width` by the switching times, shape (M, S)."""
        return self.elapsed_by_switching[:, 0] + self.elapsed_by_switching[:, 1]

    def effort(self, effort: JointEffort) -> FloatArray:
        """Return efforts as fractions of their limits, shape (M, 3, I)."""
        return self.at_samples(effort.used(self.path).at(1 / self.run_in))

    def effort_derivatives(self, effort: JointEffort) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives of `effort` as `chained` does; cached for other measures."""
        if effort not in self._cached:
            self._cached[effort] = self.chained(effort.by_path(self.path, 1 / self.run_in))
        return self._cached[effort]

    def at_samples(self, watched: FloatArray) -> FloatArray:
        """Return values at the watched samples (N, ...), by interval, shape (M, 3, ...)."""
        placed: FloatArray = watched[self._which][self._positions]
        return placed

    def chained(self, by_path: Mapping[int, FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives of I quantities of each sample, as `SampledSpline.chained`.

        By the control points of the interval and the next, (M, 3, I, 5, n), and by the switching
        times, (M, 3, I, S).
        """
        control, switching = self._at.chained(by_path)
        control = self.at_samples(control)
        placed = np.zeros((*control.shape[:3], POINTS, control.shape[4]))
        placed[:, :2, :, :-1] = control[:, :2]
        # The end of an interval depends on the control points of the next interval; the last end,
        # on those of its own.
        placed[:-1, 2, :, 1:] = control[:-1, 2]
        placed[-1, 2, :, :-1] = control[-1, 2]
        return placed, self.at_samples(switching)

    @property
    def _samples(self) -> Samples:
        assert isinstance(self._at.evaluation_points, Samples)
        return self._at.evaluation_points


# ---- Measures of a motion in a given duration, and their convex models for a step.


@dataclass(frozen=True, eq=False)
class MeasureModel:
    """A multiple of a measure near a motion, as a function of R residuals in each knot interval."""

    curvature: FloatArray  # its second derivatives by the residuals, >= 0, shape (M, R)
    slope: FloatArray  # its first derivatives by the residuals, shape (M, R)
    # the residuals' derivatives by the control points of the interval and the next, (M, R, 5 n)
    control: FloatArray
    switching: FloatArray  # the residuals' derivatives by the switching times, shape (M, R, S)

    @staticmethod
    def of(
        curvature: FloatArray, slope: FloatArray, control: FloatArray, switching: FloatArray
    ) -> "MeasureModel":
        """Return the model of residuals (M, ...) with derivatives (M, ..., 5, n), (M, ..., S)."""
        rows = len(curvature), curvature[0].size
        return MeasureModel(
            curvature.reshape(rows),
            slope.reshape(rows),
            control.reshape(*rows, -1),
            switching.reshape(*rows, switching.shape[-1]),
        )

    @staticmethod
    def stacked(models: "list[MeasureModel]") -> "MeasureModel":
        """Return the sum of models, with the residuals of all."""
        parts = ("curvature", "slope", "control", "switching")
        return MeasureModel(
            *(np.concatenate([getattr(model, part) for model in models], axis=1) for part in parts)
        )


Measure: TypeAlias = "Energy | Work | Deviation | EffortRate | EffortVariation | Jerk"
# Measures with the weights of their logarithms.
Weighted: TypeAlias = tuple[tuple[float, Measure], ...]


class _PowerSum:
    """A measure that is the sum of a power of residuals, for a run in 1 s."""

    _power = 4

    def total(self, motion: IntervalMotion) -> float:
        """Return the measure, >= 0."""
        return float((self._residual(motion) ** self._power).sum())

    def model(self, motion: IntervalMotion, fraction: float) -> MeasureModel:
        """Return the model of a multiple of the measure near a motion."""
        residual, power = self._residual(motion), self._power
        return MeasureModel.of(
            power * (power - 1) * fraction * residual ** (power - 2),
            power * fraction * residual ** (power - 1),
            *self._derivatives(motion, residual),
        )

    def _residual(self, motion: IntervalMotion) -> FloatArray:
        raise NotImplementedError

    def _derivatives(
        self, motion: IntervalMotion, residual: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        raise NotImplementedError


# Weight of the logarithm of energy, work or deviation, and the fraction of smoothness beside it:
# joints that cost nothing would wiggle, and efforts chatter where that costs next to nothing.
_WEIGHT, _SMOOTHNESS = 30.0, 0.3
_MIN_WORK = 1e-9  # [J]


def objective_measures(problem: PlanningProblem, spline: PhasedSpline, run_in: float) -> Weighted:
    """Return the measures of the problem's objective, with the weights of their logarithms.

    A motion of a duration `run_in` [s] gives the scales.
    """
    smooth = smoothness_measures(problem, spline, run_in)
    objective, robot = problem.objective or Objective(), problem.robot
    if objective.minimise == SMOOTHNESS:
        return smooth
    own: Measure
    if objective.minimise == ENERGY:
        own = Energy(objective.energy_weights(robot))
    elif objective.minimise == DEVIATION:
        own = Deviation(problem.tube.regions)
    else:
        motion = from_spline(robot.joint_names, spline.bspline()).scaled(run_in)
        own = Work(robot.joint_count, max(EffortCosts(robot, motion).work(), _MIN_WORK))
    return ((_WEIGHT, own), *((_SMOOTHNESS * weight, measure) for weight, measure in smooth))


# ---- Energy and mechanical work of the motors.

# The kink of positive power at 0 is rounded off over this fraction of the motion's mean power.
_ROUNDED = 0.5
_NOTHING = 1e-9


class _SquareIntegral(_PowerSum):
    """The integral of the squares of I quantities of samples, for a run in 1 s."""

    _power = 2

    def _quantities(self, motion: IntervalMotion) -> FloatArray:
        """Return the quantities, shape (M, 3, I)."""
        raise NotImplementedError

    def _by_variables(self, motion: IntervalMotion) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives of the quantities, as `IntervalMotion.chained` does."""
        raise NotImplementedError

    def _residual(self, motion: IntervalMotion) -> FloatArray:
        return self._quantities(motion) * _scale(motion)

    def _derivatives(
        self, motion: IntervalMotion, residual: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        control, switching = self._by_variables(motion)
        scale, wider = _scale(motion), motion.width_by_switching / (2 * motion.width[:, None])
        changing = residual[..., None] * wider[:, None, None]
        return control * scale[..., None, None], switching * scale[..., None] + changing


class Energy(_SquareIntegral):
    """The integral of the weighted squared efforts, weights (n,) >= 0: heat of the currents."""

    def __init__(self, weights: FloatArray) -> None:
        with np.errstate(divide="ignore"):
            limit = 1 / np.sqrt(weights)
        self._effort = JointEffort(limit, with_coulomb_friction=True)

    def _quantities(self, motion: IntervalMotion) -> FloatArray:
        return motion.effort(self._effort)

    def _by_variables(self, motion: IntervalMotion) -> tuple[FloatArray, FloatArray]:
        return motion.effort_derivatives(self._effort)


class Work:
    """The integral of the motors' positive power; braking gives nothing back."""

    def __init__(self, joints: int, nominal: float) -> None:
        """Take scales.

        Args:
            joints: Number of joints.
            nominal: About the work of a motion [J].
        """
        self._effort = JointEffort(np.ones(joints), with_coulomb_friction=True)
        self._rounded = _ROUNDED * nominal / joints

    def total(self, motion: IntervalMotion) -> float:
        """Return the work [J], rounded upwards where power changes its sign."""
        added, rounded = self._added(motion)
        return float((added + np.hypot(added, rounded)).sum() / 2)

    def model(self, motion: IntervalMotion, fraction: float) -> MeasureModel:
        """Return the model of a multiple near a motion.

        Residuals are the work of samples, and the sums of efforts and velocities. Power is the
        product of these, a difference of two squares: the square of the sum is its convex part.
        (The convex-concave procedure: Yuille & Rangarajan, 2003.)
        """
        added, rounded = self._added(motion)
        size = np.hypot(added, rounded)
        driving = fraction * (1 + added / size) / 2
        scale = _scale(motion)[..., None]
        path, speed = motion.path, 1 / motion.run_in
        velocity, effort = path.by_path[1], self._effort.used(path).at(speed)
        changes = self._effort.by_path(path, speed)
        by_path = {order: by * velocity[:, :, None] for order, by in changes.items()}
        by_path[1] = by_path[1] + effort[:, :, None] * np.eye(velocity.shape[1])
        control, switching = motion.chained(by_path)
        wider = motion.width_by_switching / motion.width[:, None]
        power = MeasureModel.of(
            fraction * rounded**2 / (2 * size**3),
            driving,
            control * scale[..., None] ** 2,
            switching * scale**2 + added[..., None] * wider[:, None, None],
        )
        # Efforts and velocities are scaled to equal size.
        unit = np.sqrt(_size(effort) / _size(velocity))[:, None]
        by_path = {order: by / unit for order, by in changes.items()}
        by_path[1] = by_path[1] + unit * np.eye(len(unit))
        control, switching = motion.chained(by_path)
        both = MeasureModel.of(
            driving / 2, 0 * driving, control * scale[..., None], switching * scale
        )
        return MeasureModel.stacked([power, both])

    def _added(self, motion: IntervalMotion) -> tuple[FloatArray, FloatArray]:
        """Return the work of samples, and the width over which its kink is rounded, (M, 3, n)."""
        power = motion.effort(self._effort) * motion.at_samples(motion.path.by_path[1])
        rounded = self._rounded / len(power) * SIMPSON[:, None]
        return power * _scale(motion) ** 2, np.broadcast_to(rounded, power.shape)


# ---- Deviation of the tool from the reference.

# Deviations far below this fraction of a radius count as none.
_ON_REFERENCE = 0.01


class Deviation(_SquareIntegral):
    """The mean over time of the squared distance from the segments' axes, in their tolerances."""

    def __init__(self, regions: SegmentRegions) -> None:
        """Take the regions of all segments."""
        self._regions = regions

    def total(self, motion: IntervalMotion) -> float:
        """Return the mean square, above zero [radii^2]."""
        return super().total(motion) + _ON_REFERENCE**2

    def _quantities(self, motion: IntervalMotion) -> FloatArray:
        path = motion.path
        return motion.at_samples(self._regions.deviation(path.tool_pose[1], path.segment)[0])

    def _by_variables(self, motion: IntervalMotion) -> tuple[FloatArray, FloatArray]:
        path = motion.path
        by_tool = self._regions.deviation(path.tool_pose[1], path.segment)[1]
        return motion.chained({0: by_tool @ path.tool_jacobian[:, :3]})


def _scale(motion: IntervalMotion) -> FloatArray:
    """Return the square roots of the samples' weights in the integral, (M, 3, 1)."""
    return np.sqrt(motion.width[:, None] * SIMPSON)[:, :, None]


def _size(values: FloatArray) -> FloatArray:
    """Return the root mean squares of columns, above zero."""
    return np.sqrt((values**2).mean(axis=0)) + _NOTHING


# ---- Smoothness: three measures.
#
# The total variation of the efforts sees how often motors switch, the effort rates how fast, and
# jerk sees joints of little inertia. Rates and jerks count with the fourth power, for their peaks,
# which are at both ends.

# Weights of the logarithms: of effort rate and jerk to the fourth power, variation between them.
_WEIGHTS = (0.25, 1.0, 0.175)
# Changes of effort below this fraction of the limit count for less in the variation.
_ROUNDED_CHANGE = 0.01
# Joints that hardly move count as if they moved this fraction of the farthest.
_MIN_TRAVEL = 0.05
_LOOKS = 200


def smoothness_measures(problem: PlanningProblem, spline: PhasedSpline, run_in: float) -> Weighted:
    """Return effort rate, effort variation and jerk, scaled by a motion of a duration [s]."""
    samples = spline.grid.samples_at(spline.switching_times, np.linspace(0.0, 1.0, _LOOKS))
    at = sampled(spline, samples)
    travel = np.ptp(at.position, axis=0)
    limit = problem.robot.limits.effort
    q, v, a = at.by_x[:3]
    most = abs(problem.robot.inverse_dynamics(q, v / run_in, a / run_in**2)).max(axis=0)
    nominal = np.where(np.isfinite(limit), limit, np.where(most > 0, most, 1.0))
    effort = JointEffort(nominal)
    jerk = JointRate("jerk", np.maximum(travel, _MIN_TRAVEL * travel.max()))
    measures = (EffortRate(effort), EffortVariation(effort), Jerk(jerk))
    return tuple(zip(_WEIGHTS, measures, strict=True))


@dataclass(frozen=True)
class EffortRate(_PowerSum):
    """The integral of the efforts' rates to the fourth power, efforts as fractions of limits."""

    effort: JointEffort

    def _residual(self, motion: IntervalMotion) -> FloatArray:
        rate: FloatArray = _changes(motion, self.effort) * motion.elapsed[:, :, None] ** -0.75
        return rate

    def _derivatives(
        self, motion: IntervalMotion, residual: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        elapsed = motion.elapsed[:, :, None]
        scale = elapsed**-0.75
        faster = (-0.75 * residual / elapsed)[..., None] * motion.elapsed_by_switching[:, :, None]
        control, switching = _change_derivatives(motion, self.effort)
        return control * scale[..., None, None], switching * scale[..., None] + faster


@dataclass(frozen=True)
class EffortVariation:
    """The total variation of the efforts, as fractions of limits; rounded where they rest."""

    effort: JointEffort

    def total(self, motion: IntervalMotion) -> float:
        """Return the sum of the changes' sizes."""
        change = _changes(motion, self.effort)
        return float((np.sqrt(change**2 + _ROUNDED_CHANGE**2) - _ROUNDED_CHANGE).sum())

    def model(self, motion: IntervalMotion, fraction: float) -> MeasureModel:
        """Return the model of a multiple, as reweighted squares; residuals are the changes."""
        change = _changes(motion, self.effort)
        rounded = np.sqrt(change**2 + _ROUNDED_CHANGE**2)
        derivatives = _change_derivatives(motion, self.effort)
        return MeasureModel.of(fraction / rounded, fraction * change / rounded, *derivatives)


@dataclass(frozen=True)
class Jerk(_PowerSum):
    """The integral of the jerks to the fourth power, as fractions of limits."""

    jerk: JointRate

    def _residual(self, motion: IntervalMotion) -> FloatArray:
        jerk = self.jerk.used(motion.rates[1]).at(1.0)[: motion.intervals]
        return jerk * motion.width[:, None] ** 0.25

    def _derivatives(
        self, motion: IntervalMotion, residual: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        width = motion.width[:, None]
        root = width**0.25
        at, path = motion.rates
        control, switching = (
            part[: motion.intervals] for part in at.chained(self.jerk.by_path(path, 1.0))
        )
        control = np.pad(control, ((0, 0), (0, 0), (0, 1), (0, 0)))
        wider = (residual / (4 * width))[:, :, None] * motion.width_by_switching[:, None]
        return control * root[:, :, None, None], switching * root[:, :, None] + wider


def _changes(motion: IntervalMotion, effort: JointEffort) -> FloatArray:
    """Return the changes of efforts from sample to sample, shape (M, 2, I)."""
    return np.diff(motion.effort(effort), axis=1)


def _change_derivatives(
    motion: IntervalMotion, effort: JointEffort
) -> tuple[FloatArray, FloatArray]:
    """Return the derivatives of `_changes`, (M, 2, I, 5, n) and (M, 2, I, S)."""
    control, switching = motion.effort_derivatives(effort)
    return np.diff(control, axis=1), np.diff(switching, axis=1)
