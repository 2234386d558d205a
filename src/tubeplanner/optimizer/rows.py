"""Rows: linear constraints on a step, each scaled by its limit; speed limits as rows.

A step changes the control points C of a spline, its inner switching times s, and its squared
duration y = T^2, by eta = dy / y. A row is: control . dC + switching . ds + duration eta <= slack.
"""

from collections.abc import Mapping
from ctypes import c_double, c_int64
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.limits.holding_limit import HoldingLimit
from tubeplanner.limits.path_samples import PathSamples, SpeedLimit
from tubeplanner.limits.speed_polynomial import SpeedPolynomial
from tubeplanner.native.library import Doubles, Integers, native_function
from tubeplanner.optimizer.phased_spline import CHANGES, DEGREE, SampledSpline

# ---- Linear constraints on a step, each divided by its own limit.

_near = native_function(
    *("near_rows", *CHANGES, c_int64, c_int64, Doubles, Doubles, c_double),
    *(c_double, Doubles, Integers, Doubles, Doubles),
    returns=c_int64,
)
_reach = native_function(
    "row_reach", c_int64, c_int64, Doubles, c_double, c_int64, Doubles, Doubles, Doubles
)
_used = native_function(
    "used_by_step", *3 * (c_int64,), Integers, *5 * (Doubles,), c_double, Doubles
)
# Rows with less slack than this are kept, however short the step.
_CLOSE = 0.3
# Cones less used than this are left to the planes that join.
_MATTERS = 0.5
NO_LIMIT = -1
# Steps aim this far inside tube and clearances, as a fraction of a radius; the merit function
# ignores most of it, which absorbs violations between samples and rounding.
INNER_MARGIN = 0.005
MERIT_TOLERANCE: float = 0.8 * INNER_MARGIN


@dataclass(frozen=True)
class StepSize:
    """The largest step."""

    control: float  # of control points [joint units]
    switching: FloatArray  # of the inner switching times, shape (m-1,)
    units: FloatArray | None = None  # of the joints, shape (n,); None: 1 each [rad or m]


@dataclass(frozen=True, eq=False)
class Rows:
    """R linear constraints."""

    first: IntArray  # the first of the four control points that count, shape (R,)
    control: FloatArray  # shape (R, 4, n)
    switching: FloatArray  # shape (R, m-1)
    duration: FloatArray  # shape (R,)
    slack: FloatArray  # shape (R,)
    limit: IntArray  # number of the row's limit; -1 for none, shape (R,)
    index: IntArray  # number of the row among all rows of its constraints, shape (R,)

    def __len__(self) -> int:
        return len(self.slack)

    def where(self, keep: BoolArray | IntArray) -> "Rows":
        """Return some of the rows."""
        return Rows(*(getattr(self, name)[keep] for name in self.__dataclass_fields__))

    def reach(self, size: StepSize) -> FloatArray:
        """Return the largest change of each row by a step, shape (R,)."""
        return _largest_change(self.control, self.switching, size)

    def used_by_step(
        self, control_change: FloatArray, switching: FloatArray, duration: float
    ) -> FloatArray:
        """Return the slack that a step uses, shape (R,).

        Args:
            control_change: Step of the control points, shape (K, n).
            switching: Step of the inner switching times, shape (m-1,).
            duration: The relative step eta.
        """
        if _used is None:
            changes = control_change[self.first[:, None] + np.arange(DEGREE + 1)]
            used = np.einsum("rkj,rkj->r", self.control, changes)
            used += self.switching @ switching + self.duration * duration
            return used
        used, sizes = np.empty(len(self)), (self.control.shape[2], self.switching.shape[1])
        arrays = (
            self.first,
            self.control,
            self.switching,
            self.duration,
            control_change,
            switching,
        )
        _used(len(self), *sizes, *map(np.ascontiguousarray, arrays), duration, used)
        return used


def sided_rows(
    at: SampledSpline,
    by_path: Mapping[int, FloatArray],
    used: FloatArray,
    duration: tuple[FloatArray, float],
    limit: IntArray,
    signs: tuple[float, ...],
    size: StepSize | None,
    little: float = _CLOSE,
) -> Rows:
    """Return the rows of I quantities at N samples: sign * quantity <= 1 for all signs.

    Rows are numbered by side, sample and quantity.

    Args:
        at: The spline at the samples.
        by_path: The quantities' derivatives by the path's, by order, each (N, I, n).
        used: The quantities, shape (N, I).
        duration: Derivatives by eta: (a, b), with a of shape (N, I), for sign * a - b.
        limit: Number of each quantity's limit, shape (N, I).
        signs: Of the sides.
        size: Largest step; rows that it cannot break are left out. None: all rows.
        little: Rows with less slack are kept, however short the step.
    """
    slack = 1 - np.multiply.outer(signs, used)
    index, control, switching = _breakable(at, by_path, slack, signs, little, size)
    side, entry = np.divmod(index, used.size)
    with_side, on_every = duration
    return Rows(
        at.first[entry // used.shape[1]],
        control,
        switching,
        np.array(signs)[side] * with_side.ravel()[entry] - on_every,
        slack.ravel()[index],
        limit.ravel()[entry],
        index,
    )


def plane_rows(
    at: SampledSpline,
    by_joint: FloatArray,
    slack: FloatArray,
    limit: IntArray,
    size: StepSize | None,
) -> Rows:
    """Return the rows of P planes at N samples, numbered by sample and plane.

    Args:
        at: The spline at the samples.
        by_joint: Derivatives of the used slack by the joints, shape (N, P, n).
        slack: Of each sample and plane, shape (N, P); inf where there is no plane.
        limit: Number of each sample's limit, shape (N,).
        size: Largest step; rows that it cannot break are left out. None: all rows.
    """
    index, control, switching = _breakable(at, {0: by_joint}, slack[None], (1.0,), -np.inf, size)
    sample = index // slack.shape[1]
    none = np.zeros(len(index))
    return Rows(
        at.first[sample], control, switching, none, slack.ravel()[index], limit[sample], index
    )


def _breakable(
    at: SampledSpline,
    by_path: Mapping[int, FloatArray],
    slack: FloatArray,
    signs: tuple[float, ...],
    little: float,
    size: StepSize | None,
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the rows that a step can break or that have little slack.

    Args:
        at: The spline at N samples.
        by_path: Derivatives of I quantities of each sample, by order, each (N, I, n).
        slack: Shape (S, N, I).
        signs: Of the quantities on the S sides.
        little: Little slack.
        size: The largest step; None: all rows with a finite slack.

    Returns:
        The rows' flat indices in the slack, (R,), and their derivatives by control points,
        (R, 4, n), and by switching times, (R, m-1).
    """
    if _near is not None:
        control = np.empty((slack.size, DEGREE + 1, at.by_x.shape[2]))
        switching = np.empty((slack.size, len(at.by_switching)))
        index, slack = np.empty(slack.size, dtype=np.int64), np.ascontiguousarray(slack)
        sides = slack.shape[2], len(signs), np.array(signs), slack
        step = (0.0, 0.0, None) if size is None else (little, size.control, size.switching)
        units = None if size is None else size.units
        count = _near(*at.arguments(by_path, units), *sides, *step, index, control, switching)
        control = control[:count] if units is None else control[:count] / units
        return index[:count], control, switching[:count]
    # The chain rule costs most: a bound on the reach rules out most rows before.
    reach: FloatArray | float = np.inf
    if size is not None:
        orders, scale = list(by_path), 1.0 if size.units is None else size.units
        by_step = size.control * abs(at.basis[orders]).sum(axis=-1)
        most = abs(at.by_switching[:, orders] / scale).max(axis=-1, initial=0.0)
        by_step += np.einsum("gon,g->on", most, size.switching)
        sums = np.array([abs(by_path[order] * scale).sum(axis=-1) for order in orders])
        reach = np.maximum(little, np.einsum("on,oni->ni", by_step, sums))
    side, sample, quantity = near = np.nonzero(slack < reach)
    own = {order: by[sample, quantity, None] for order, by in by_path.items()}
    control, switching = (change[:, 0] for change in at.chained(own, sample))
    sign = np.array(signs)[side]
    index, control = np.ravel_multi_index(near, slack.shape), sign[:, None, None] * control
    switching = sign[:, None] * switching
    if size is None:
        return index, control, switching
    keep = slack.ravel()[index] < np.maximum(little, _largest_change(control, switching, size))
    return index[keep], control[keep], switching[keep]


def _largest_change(control: FloatArray, switching: FloatArray, size: StepSize) -> FloatArray:
    if size.units is not None:
        control = control * size.units
    if _reach is None:
        reach: FloatArray = size.control * abs(control).sum(axis=(-2, -1))
        return reach + abs(switching) @ size.switching
    reach, width = np.empty(len(control)), control.shape[1] * control.shape[2]
    control, switching = np.ascontiguousarray(control), np.ascontiguousarray(switching)
    switches = switching.shape[1]
    _reach(len(control), width, control, size.control, switches, switching, size.switching, reach)
    return reach


# ---- Limits on the speed of a spline at samples, as rows.
#
# A limit, sum of c_k s^k <= 1 with s = 1/T, is multiplied by the highest power of T: so the terms
# of that power, inertia and jerk, do not change with y = T^2, and the rows of efforts and
# accelerations are exact in y.


@dataclass(frozen=True, eq=False)
class EvaluatedSpeedLimit:
    """A limit of I quantities at N samples of a spline, one of `EvaluatedRows`."""

    is_elastic: ClassVar[bool] = False

    limit: SpeedLimit
    at: SampledSpline  # the spline at the samples
    path: PathSamples  # the arm there
    numbers: IntArray  # of the limit's keys among those of all limits
    # of a piece of friction beyond a kink: the limit with the friction itself
    beyond: "EvaluatedSpeedLimit | None" = None
    # by duration: after a step that was rejected, the same rows are requested again.
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
        """Number of rows."""
        return len(self.limit.signs) * int(np.prod(self._used.shape))

    def rows(self, duration: float, size: StepSize | None) -> Rows:
        """Return the rows of all sides, of the spline run in T seconds.

        Args:
            duration: T [s].
            size: Largest step; rows that it cannot break are left out. None: all rows.
        """
        used = self._used.at(1 / duration)
        limit = np.broadcast_to(self.numbers[self.limit.key_of(self.path)], used.shape)
        degree, powers = self._used.degree, self._used.terms
        # By eta, in T^degree, of the quantities times T^degree.
        change = self._used.weighted({k: duration**-k * (degree - k) / 2 for k in powers})
        by_path, signs = self._by_path(duration), self.limit.signs
        if self.beyond is not None:
            here = self.beyond
            is_kinked = np.any(by_path[1] != here._by_path(duration)[1], axis=2)
            used = np.where(is_kinked & (used <= here._used.at(1 / duration)), used, -np.inf)
        if isinstance(self.limit, HoldingLimit) and size is not None:
            used = np.where(self.limit.leading(used) & (used > _MATTERS), used, -np.inf)
        little = _CLOSE if self.beyond is None else -np.inf
        return sided_rows(self.at, by_path, used, (change, degree / 2), limit, signs, size, little)

    def _by_path(self, duration: float) -> Mapping[int, FloatArray]:
        if duration not in self._changes:
            self._changes[duration] = self.limit.by_path(self.path, 1 / duration)
        return self._changes[duration]

    def slack(self, duration: float, squared_duration: float) -> FloatArray:
        """Return the slack at this spline of the rows that another spline's `rows` numbers.

        Args:
            duration: The duration of those rows [s].
            squared_duration: The new squared duration, as a multiple of the old one.
        """
        degree, longer = self._used.degree, squared_duration**0.5
        weights = {k: duration**-k * longer ** (degree - k) for k in self._used.terms}
        used = self._used.weighted(weights)
        return np.concatenate([(longer**degree - sign * used).ravel() for sign in self.limit.signs])

    @property
    def rise(self) -> FloatArray:
        """The slack that rows gain by a relative rise of their limits, by number."""
        allowed = self._used.allowed
        by_side = np.ones(self._used.shape) if allowed is None else allowed
        return np.tile(by_side.ravel(), len(self.limit.signs))

    @cached_property
    def _used(self) -> SpeedPolynomial:
        return self.limit.used(self.path)
