"""The tool's orientation within its segment's tolerance, at samples of a spline.

Bounds on the three components of the rotation vector are planes; a bound on the angle is a ball.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.constraints.path_samples import PathSamples
from tubeplanner.refinement.linear_rows import Rows, StepSize, plane_rows
from tubeplanner.refinement.region_constraints import EvaluatedRegions
from tubeplanner.refinement.sampled_spline import SampledSpline
from tubeplanner.tube.rotational_tube import RotationalTube
from tubeplanner.tube.segment_regions import Capsules

_SIDES = np.vstack([np.eye(3), -np.eye(3)])


@dataclass(frozen=True, eq=False)
class EvaluatedRotation:
    """The tool's rotation at N samples of a spline, and the bounds on its three components.

    Attributes:
        tube: The rotational part of the tube.
        at: The spline at the samples.
        path: The arm there.
        margin: The share of the tolerances that stays unused.
        numbers: Of the tolerances among the limits, shape (m,).
        segment: The samples' segments, shape (N,).
    """

    is_elastic: ClassVar[bool] = True

    tube: RotationalTube
    at: SampledSpline
    path: PathSamples
    margin: float
    numbers: IntArray
    segment: IntArray

    @property
    def excess(self) -> FloatArray:
        """How far components are beyond the narrowed bounds, in bounds, shape (N,)."""
        excess: FloatArray = (abs(self._error) / self._bounds).max(axis=1) - (1 - self.margin)
        return excess

    @property
    def bounds_components(self) -> bool:
        """Whether a component is bounded in some sample's segment."""
        return bool(np.isfinite(self._bounds).any())

    @property
    def bounds_angle(self) -> bool:
        """Whether the angle is."""
        return bool(np.isfinite(self.tube.bounds[self.segment, 3]).any())

    def angle(self) -> EvaluatedRegions:
        """Return the bound on the angle: the rotation vector in a ball."""
        centre, count = np.zeros((len(self.tube.bounds), 3)), len(self.segment)
        return EvaluatedRegions(
            self.at,
            self._error,
            lambda: self._by_joint,
            Capsules(centre, centre, self.tube.bounds[:, 3]),
            self.segment,
            lambda _: self.segment,
            np.zeros(count, dtype=bool),
            np.full(count, self.margin),
            self.numbers[:, None],
        )

    def rows(self, duration: float, size: StepSize | None) -> Rows:
        """Return rows that keep the components of the rotation vector within their bounds.

        Args:
            duration: T [s], whatever it is.
            size: Of the step; rows that it cannot break are left out. None: all rows.
        """
        bounds = np.hstack([self._bounds, self._bounds])
        by_side = np.matmul(_SIDES, self._by_joint) / bounds[:, :, None]
        slack = np.where(np.isfinite(bounds), self._slack.reshape(bounds.shape), np.inf)
        return plane_rows(self.at, by_side, slack, self.numbers[self.segment], size)

    @property
    def row_count(self) -> int:
        """How many rows there are."""
        return len(_SIDES) * len(self.segment)

    def slack(self, duration: float, squared_duration: float) -> FloatArray:
        """Return the slack of all rows that `rows` numbers, in whatever duration."""
        return self._slack

    @property
    def _slack(self) -> FloatArray:
        bounds = np.hstack([self._bounds, self._bounds])
        slack: FloatArray = 1 - self.margin - self._error @ _SIDES.T / bounds
        return slack.ravel()

    @property
    def _bounds(self) -> FloatArray:
        return self.tube.bounds[self.segment, :3]

    @cached_property
    def _error(self) -> FloatArray:
        """Rotation vectors from the reference to the tool, shape (N, 3) [rad]."""
        return self.tube.error(*self.path.tool_pose, self.segment)

    @cached_property
    def _by_joint(self) -> FloatArray:
        """What they change by with the joints, shape (N, 3, n)."""
        jacobian = self.path.tool_jacobian
        return self.tube.error_jacobian(*self.path.tool_pose, jacobian, self.segment)[1]
