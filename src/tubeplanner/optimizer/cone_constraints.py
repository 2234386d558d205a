"""Cones of held parts as regions of a step's program: planes join where a step leaves a cone.

In units of the present squared duration y = T^2, the vector of a cone is u = (1 + eta) u0 + u2 / y
with four components: three of |across W|, and the bound. A cone is convex, so that every tangent
plane contains it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.limits.holding_limit import HoldingLimit
from tubeplanner.limits.path_samples import PathSamples
from tubeplanner.optimizer.phased_spline import SampledSpline
from tubeplanner.optimizer.region_constraints import Planes
from tubeplanner.optimizer.rows import (
    INNER_MARGIN,
    MERIT_TOLERANCE,
    EvaluatedSpeedLimit,
    Rows,
)
from tubeplanner.optimizer.step_program import Step

# A prediction may leave a cone by this share of the nominal; at speed, by this fraction of the
# step's change of T^2, within bounds: what planes leave out is missing to the predicted gain.
_OUTSIDE = 0.002
_OF_GAIN, _CLOSEST = 0.5, 1e-4
# Samples outside a cone at rest, where no lower speed helps, count as inside by this share: what
# the merit function asks for, which has a price for being outside.
LEAST_AT_REST = INNER_MARGIN - MERIT_TOLERANCE


@dataclass(frozen=True, eq=False)
class EvaluatedCones:
    """The cones of a limit at N samples of a spline: J each, one of `Iterate.convex`.

    Vectors are numbered by sample and cone.
    """

    is_crossed: ClassVar[bool] = False
    # As of `EvaluatedRegions`, as a share of the nominal: more planes of more cones bind.
    binding: ClassVar[float] = 0.001

    limit: HoldingLimit
    at: SampledSpline  # the spline at the samples
    path: PathSamples  # the arm there
    duration: float  # T [s]
    numbers: IntArray  # of the limit's keys among those of all limits
    # whether the arm rests at every sample: elastic; else it runs in T, and rows of the limit bound
    # the cones already, along present directions
    is_at_rest: bool

    @property
    def is_speed(self) -> bool:
        """True if the cones' vectors depend on the duration."""
        return not self.is_at_rest

    @cached_property
    def excess(self) -> FloatArray:
        """Distance of samples outside the narrowed cones, as shares of the nominal, (N,)."""
        return self._excess_of(self.vector).reshape(len(self.path), -1).max(axis=1)

    @cached_property
    def vector(self) -> FloatArray:
        """The cones' vectors, shape (N J, 4), as shares of the nominal."""
        return self.vector_in(self.duration, 0.0)

    def vector_in(self, duration: float, longer: float) -> FloatArray:
        """Return the vectors of a run in T sqrt(1 + longer), in units of T^2."""
        still, moving = self._parts
        vector = still if self.is_at_rest else (1 + longer) * still + moving / duration**2
        return vector.reshape(-1, 4)

    @cached_property
    def planes(self) -> Planes:
        """The tangent planes along present directions."""
        return self._tangents(
            self.vector, np.flatnonzero(self._leads(self._excess_of(self.vector)))
        )

    def planes_where_outside(
        self, vector: FloatArray, room: float, *, are_alone: bool = False
    ) -> Planes:
        """Return the tangent planes where other vectors (N J, 4) are outside."""
        excess = self._excess_of(vector)
        return self._tangents(vector, np.flatnonzero((excess > room) & self._leads(excess)))

    def room(self, step: Step) -> float:
        """Return how far outside a step's vectors may be, as a share of the nominal."""
        if self.is_at_rest:
            return step.elastic + _OUTSIDE
        return min(max(_OF_GAIN * abs(step.duration), _CLOSEST), _OUTSIDE)

    def after(
        self, control: FloatArray, switching: FloatArray, duration: float = 0.0
    ) -> FloatArray:
        """Return the vectors after a step, as of `Rows.used_by_step`, to first order."""
        shape = (len(self.path), -1, 4)
        after = self.vector.reshape(shape).copy()
        if not self.is_at_rest:
            after += duration * self._parts[0]
        for order, by in self._by_path.items():
            change = self.at.change(control, switching, order)
            after += np.einsum("njki,ni->njk", by, change)
        return after.reshape(-1, 4)

    def slack(self, planes: Planes, bend: FloatArray | None = None) -> FloatArray:
        """Return the distance of the vectors, plus `bend` (N J, 4), behind planes, (P,)."""
        vector = (self.vector if bend is None else self.vector + bend)[planes.sample]
        slack: FloatArray = vector[:, 3] - (planes.normal * vector[:, :3]).sum(axis=1)
        return slack - self._margin

    def rows(self, planes: Planes) -> Rows:
        """Return rows that keep the vectors behind planes; they have no numbers."""
        sample, cone = np.divmod(planes.sample, len(self.limit.names))
        count = len(planes)
        normal = np.hstack([planes.normal, np.full((count, 1), -1.0)])
        by_path = {
            order: np.einsum("pk,pki->pi", normal, by[sample, cone])[:, None]
            for order, by in self._by_path.items()
        }
        control, switching = self.at.chained(by_path, sample)
        by_duration = np.zeros(count)
        if not self.is_at_rest:
            by_duration = (normal * self._parts[0][sample, cone]).sum(axis=1)
        return Rows(
            self.at.first[sample],
            control[:, 0],
            switching[:, 0],
            by_duration,
            self.slack(planes),
            self.numbers[self.limit.key_of(self.path)[0, cone]],
            np.full(count, -1),
        )

    @property
    def _margin(self) -> float:
        return INNER_MARGIN if self.is_at_rest else 0.0

    def _excess_of(self, vector: FloatArray) -> FloatArray:
        excess: FloatArray = np.linalg.norm(vector[:, :3], axis=1) - vector[:, 3] + self._margin
        return excess

    @cached_property
    def _parts(self) -> tuple[FloatArray, FloatArray]:
        """The vectors' parts u0 of gravity and u2 of the motion at a speed of 1, (N, J, 4) each."""
        parts = self.limit.parts(self.path)
        pairs = ((parts.x0, parts.t0), (parts.x2, parts.t2))
        still, moving = (np.concatenate([x, t[..., None]], axis=2) for x, t in pairs)
        return still, moving

    @cached_property
    def _by_path(self) -> Mapping[int, FloatArray]:
        """The vectors' derivatives by q and its derivatives by x, (N, J, 4, n) each."""
        if self.is_at_rest:
            return {0: self.limit.at_rest_by_path(self.path)}
        return self.limit.vectors_by_path(self.path, 1 / self.duration)

    def _leads(self, excess: FloatArray) -> BoolArray:
        """Return True for vectors (N J,) of the leading cones of their samples."""
        return self.limit.leading(excess.reshape(len(self.path), -1)).ravel()

    def _tangents(self, vector: FloatArray, which: IntArray) -> Planes:
        """Return the tangent planes that some vectors (N J, 4) point at."""
        x = vector[which, :3]
        size = np.linalg.norm(x, axis=1, keepdims=True)
        normal = np.divide(x, size, out=np.zeros_like(x), where=size > 0)
        none = np.zeros(len(which), dtype=np.int64)
        return Planes(which, normal, none, none.astype(bool))


def evaluated_cones(evaluated: EvaluatedSpeedLimit, duration: float) -> list[EvaluatedCones]:
    """Return the cones of held parts at speed and at rest; nothing for other limits."""
    limit = evaluated.limit
    if not isinstance(limit, HoldingLimit):
        return []
    place = (limit, evaluated.at, evaluated.path, duration, evaluated.numbers)
    return [EvaluatedCones(*place, False), EvaluatedCones(*place, True)]
