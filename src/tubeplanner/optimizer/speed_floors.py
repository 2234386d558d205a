"""Floors of the tool's speed in bands, and gates at the ends of stretches, as elastic rows.

The norm of a velocity is convex, so that its tangent is a lower bound: a row along the present
direction promises no speed that is not there. Run in T, the velocity J q' / T is to be at least
the floor v0: with z the step's control points and switching times, and T^2 (1 + eta) after it,

    |J q'| / (T v0) + d|J q'|/dz . dz / (T v0) >= (1 + m) (1 + eta / 2).

In a given duration, eta has no part in it.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.limits.path_samples import PathSamples
from tubeplanner.optimizer.phased_spline import SampledSpline
from tubeplanner.optimizer.rows import (
    INNER_MARGIN,
    NO_LIMIT,
    Rows,
    StepSize,
    plane_rows,
    sided_rows,
)

# Steps aim at this fraction above a floor, for what exact time scaling takes afterwards; and a
# shortfall by this fraction of a floor counts as much as a tool that is a radius outside its tube.
_ABOVE, _UNIT = 0.003, 0.25


@dataclass(frozen=True, eq=False)
class EvaluatedFloor:
    """The tool's speed at N samples of a spline above its segments' floors, one of `EvaluatedRows`.

    Quantities are shortfalls: 1 at the floor with its margin, less above it.
    """

    is_elastic: ClassVar[bool] = True

    at: SampledSpline  # the spline at the samples
    path: PathSamples  # the arm there
    floor: FloatArray  # of the tool's speed at the samples, (N,) [m/s], inf where there is none
    duration: float  # T in which the spline is run [s]
    is_run_in: bool  # whether that duration stays
    number: IntArray  # of the samples' floors among the limits, shape (N,)

    @property
    def row_count(self) -> int:
        """Number of rows."""
        return len(self.floor)

    @cached_property
    def excess(self) -> FloatArray:
        """Shortfall of the speeds, in units of a quarter of the floor, shape (N,)."""
        return self._used(1.0) - 1

    def rows(self, duration: float, size: StepSize | None) -> Rows:
        """Return the rows; arguments as of `EvaluatedSpeedLimit.rows`."""
        velocity, *derivatives = self.path.tool_rate
        length = np.linalg.norm(velocity, axis=1, keepdims=True)
        direction = velocity / np.maximum(length, np.finfo(float).tiny)
        gradient = direction / (-_UNIT * duration * self.floor[:, None])
        by_path = {
            order: np.einsum("ni,nij->nj", gradient, by)[:, None]
            for order, by in enumerate(derivatives)
        }
        used = self._used(1.0)[:, None]
        by_duration = 0.0 if self.is_run_in else (1 + _ABOVE) / 2 / _UNIT
        change = np.full(used.shape, by_duration), 0.0
        return sided_rows(self.at, by_path, used, change, self.number[:, None], (1.0,), size)

    def slack(self, duration: float, squared_duration: float) -> FloatArray:
        """Return the slack of the rows; arguments as of `EvaluatedSpeedLimit.slack`."""
        longer = 1.0 if self.is_run_in else squared_duration**0.5
        slack: FloatArray = 1 - self._used(longer, duration)
        return slack

    @property
    def rise(self) -> FloatArray:
        """The slack that rows gain by a relative rise of their floors: they lose, shape (N,)."""
        return self._shares(self.duration) / -_UNIT

    def _used(self, longer: float, duration: float | None = None) -> FloatArray:
        shares = self._shares(duration or self.duration)
        used: FloatArray = 1 + ((1 + _ABOVE) * longer - shares) / _UNIT
        return np.where(np.isfinite(self.floor), used, -np.inf)

    def _shares(self, duration: float) -> FloatArray:
        """Return the speeds of a run in some seconds as shares of the floors, (N,)."""
        shares: FloatArray = self._speed / (duration * self.floor)
        return shares

    @cached_property
    def _speed(self) -> FloatArray:
        return np.linalg.norm(self.path.tool_rate[0], axis=1)


@dataclass(frozen=True, eq=False)
class EvaluatedGates:
    """The tool at the G gates of a tube, where phases end: one of `EvaluatedRows`."""

    is_elastic: ClassVar[bool] = True

    at: SampledSpline  # the spline at the gates
    path: PathSamples  # the arm there
    tube: Tube

    @property
    def row_count(self) -> int:
        """Number of rows."""
        return len(self.path)

    @cached_property
    def excess(self) -> FloatArray:
        """Distance of the tool on the stretch's side of the narrowed gates, in radii, (G,)."""
        return -self._slack

    def rows(self, duration: float, size: StepSize | None) -> Rows:
        """Return the rows; arguments as of `EvaluatedSpeedLimit.rows`."""
        normals = np.array([gate.normal for gate in self.tube.gates])
        along = -normals / self._radius[:, None]
        by_joint = np.einsum("gi,gij->gj", along, self.path.tool_jacobian[:, :3])
        none = np.full(len(normals), NO_LIMIT)
        return plane_rows(self.at, by_joint[:, None], self._slack[:, None], none, size)

    def slack(self, duration: float, squared_duration: float) -> FloatArray:
        """Return the slack of the rows; arguments as of `EvaluatedSpeedLimit.slack`."""
        return self._slack

    @cached_property
    def _radius(self) -> FloatArray:
        radius = self.tube.effective_radius
        return np.array([radius[gate.point - 1 : gate.point + 1].min() for gate in self.tube.gates])

    @cached_property
    def _slack(self) -> FloatArray:
        tool = self.path.tool_pose[1]
        pairs = enumerate(self.tube.gates)
        beyond = np.array([gate.margin(tool[k : k + 1])[0] for k, gate in pairs])
        slack: FloatArray = beyond / self._radius - INNER_MARGIN
        return slack
