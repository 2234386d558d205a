"""A motion run in a given duration, at the beginning, middle and end of every knot interval.

It is what measures are taken of: values there, and how they change with the control points and the
switching times. There are M intervals, n joints and S switching times that may move.
"""

from collections.abc import Mapping
from functools import cached_property

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.constraints.joint_effort import JointEffort
from tubeplanner.constraints.joint_rate import JointRate
from tubeplanner.refinement.phased_spline import DEGREE, Samples
from tubeplanner.refinement.spline_constraints import Iterate

# Control points that count from the beginning of an interval to that of the next.
POINTS = DEGREE + 2
# Beginning, middle and end; the integral by Simpson's rule.
_SAMPLES = 3
SIMPSON = np.array([1.0, 4.0, 1.0]) / 6


class IntervalMotion:
    """A motion, interval by interval.

    Attributes:
        run_in: The duration [s].
        path: The arm at the samples that are watched.
    """

    def __init__(self, current: Iterate, run_in: float) -> None:
        """Take a motion and its duration [s]."""
        self.run_in = run_in
        self._at, self.path = current.watched
        self._rates = current.rates
        self._switching_times = current.spline.switching_times
        grid = current.spline.grid
        self._intervals, self._switches = grid.interval_count, grid.switch_count
        # Two per interval and the end, of those that are watched.
        every = 2 * self._intervals
        self._which = np.append(np.arange(every), every + len(grid.shares) - 1)
        self._places = 2 * np.arange(self._intervals)[:, None] + np.arange(_SAMPLES)
        self._known: dict[JointEffort, tuple[FloatArray, FloatArray]] = {}

    @cached_property
    def elapsed(self) -> FloatArray:
        """Time from sample to sample, as a share of the duration, shape (M, 2)."""
        return np.diff(self.at_samples(self._samples.times(self._switching_times)), axis=1)

    @cached_property
    def elapsed_by_switching(self) -> FloatArray:
        """Shape (M, 2, S)."""
        return np.diff(self.at_samples(self._samples.times_by_switching(self._switches)), axis=1)

    @property
    def width(self) -> FloatArray:
        """Of the intervals, as shares of the duration, shape (M,)."""
        return self.elapsed[:, 0] + self.elapsed[:, 1]

    @property
    def width_by_switching(self) -> FloatArray:
        """Shape (M, S)."""
        return self.elapsed_by_switching[:, 0] + self.elapsed_by_switching[:, 1]

    def effort(self, effort: JointEffort) -> FloatArray:
        """Return efforts in their limits, shape (M, 3, I)."""
        return self.at_samples(effort.used(self.path).at(1 / self.run_in))

    def effort_derivatives(self, effort: JointEffort) -> tuple[FloatArray, FloatArray]:
        """Return how they change, as `chained` does; kept for measures of the same efforts."""
        if effort not in self._known:
            self._known[effort] = self.chained(effort.by_path(self.path, 1 / self.run_in))
        return self._known[effort]

    def jerk(self, jerk: JointRate) -> FloatArray:
        """Return the jerks in one second, in their limits, shape (M, I)."""
        return jerk.used(self._rates[1]).at(1.0)[: self._intervals]

    def jerk_derivatives(self, jerk: JointRate) -> tuple[FloatArray, FloatArray]:
        """Return how they change: by control points (M, I, 5, n), by switching times (M, I, S)."""
        at, path = self._rates
        control, switching = at.chained(jerk.by_path(path, 1.0))
        control, switching = control[: self._intervals], switching[: self._intervals]
        return np.pad(control, ((0, 0), (0, 0), (0, 1), (0, 0))), switching

    def at_samples(self, watched: FloatArray) -> FloatArray:
        """Return what is known of the watched samples (N, ...), by interval, (M, 3, ...)."""
        placed: FloatArray = watched[self._which][self._places]
        return placed

    def chained(self, by_path: Mapping[int, FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Return how I quantities of each sample change.

        Args:
            by_path: Their derivatives, as of `SampledSpline.chained`.

        Returns:
            By the control points of the interval and the next, (M, 3, I, 5, n), and by the
            switching times, (M, 3, I, S).
        """
        control, switching = self._at.chained(by_path)
        control = self.at_samples(control)
        placed = np.zeros((*control.shape[:3], POINTS, control.shape[4]))
        placed[:, :2, :, :-1] = control[:, :2]
        # The end of an interval counts on the next one's control points; the last one is of the
        # last interval itself.
        placed[:-1, 2, :, 1:] = control[:-1, 2]
        placed[-1, 2, :, :-1] = control[-1, 2]
        return placed, self.at_samples(switching)

    @property
    def _samples(self) -> Samples:
        assert isinstance(self._at.evaluation_points, Samples)
        return self._at.evaluation_points
