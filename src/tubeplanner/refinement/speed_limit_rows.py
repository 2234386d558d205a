"""Limits on the speed of a spline at samples, as rows.

What a limit asks, sum of c_k s^k <= 1 with s = 1/T, is multiplied by the highest power of T: so the
terms that bring it about, inertia and jerk, do not change with y = T^2, and the rows of efforts and
accelerations are exact in y.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.constraints.path_samples import PathSamples
from tubeplanner.constraints.speed_limit import SpeedLimit
from tubeplanner.constraints.speed_polynomial import SpeedPolynomial
from tubeplanner.refinement.linear_rows import Rows, StepSize, sided_rows
from tubeplanner.refinement.sampled_spline import SampledSpline


@dataclass(frozen=True, eq=False)
class EvaluatedSpeedLimit:
    """A limit of I quantities at N samples of a spline.

    Attributes:
        limit: The limit.
        at: The spline at the samples.
        path: The arm there.
        numbers: Of the limit's keys among those of all limits.
    """

    is_elastic: ClassVar[bool] = False

    limit: SpeedLimit
    at: SampledSpline
    path: PathSamples
    numbers: IntArray
    # By duration: after a step that was rejected, the same rows are asked for again.
    _changes: dict[float, Mapping[int, FloatArray]] = field(default_factory=dict, repr=False)

    @cached_property
    def squared_durations(self) -> FloatArray:
        """The smallest y = T^2 that the limit allows at each sample, shape (N,) [s^2].

        inf where no speed is slow enough.
        """
        with np.errstate(divide="ignore"):
            slowest: FloatArray = self._used.largest_speed(self.limit.signs).min(axis=1) ** -2.0
        return slowest

    @property
    def row_count(self) -> int:
        """How many rows there are."""
        return len(self.limit.signs) * int(np.prod(self._used.shape))

    def rows(self, duration: float, size: StepSize | None) -> Rows:
        """Return the rows of all sides, of the spline run in T seconds.

        Args:
            duration: T [s].
            size: Of the step; rows that it cannot break are left out. None: all rows.
        """
        used = self._used.at(1 / duration)
        limit = np.broadcast_to(self.numbers[self.limit.key_of(self.path)], used.shape)
        by_duration = (self._by_duration(duration), self._used.degree / 2)
        by_path, signs = self._by_path(duration), self.limit.signs
        return sided_rows(self.at, by_path, used, by_duration, limit, signs, size)

    def slack(self, duration: float, squared_duration: float) -> FloatArray:
        """Return the slack of all rows that `rows` numbers, here, for rows made elsewhere.

        Args:
            duration: The duration that those were made for [s].
            squared_duration: The new squared duration, as a multiple of the old one.
        """
        degree, longer = self._used.degree, squared_duration**0.5
        powers = self._used.terms
        used = self._used.weighted({k: duration**-k * longer ** (degree - k) for k in powers})
        return np.concatenate([(longer**degree - sign * used).ravel() for sign in self.limit.signs])

    @property
    def rise(self) -> FloatArray:
        """What slack the rows gain by a relative rise of their limits, by number."""
        allowed = self._used.allowed
        by_side = np.ones(self._used.shape) if allowed is None else allowed
        return np.tile(by_side.ravel(), len(self.limit.signs))

    def _by_path(self, duration: float) -> Mapping[int, FloatArray]:
        """Return how the quantities change with position and its derivatives by x."""
        if duration not in self._changes:
            self._changes[duration] = self.limit.by_path(self.path, 1 / duration)
        return self._changes[duration]

    @cached_property
    def _used(self) -> SpeedPolynomial:
        return self.limit.used(self.path)

    def _by_duration(self, duration: float) -> FloatArray:
        """Return how the quantities, times the highest power of T, change with y, shape (N, I)."""
        degree, powers = self._used.degree, self._used.terms
        return self._used.weighted({k: duration**-k * (degree - k) / 2 for k in powers})
