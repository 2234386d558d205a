"""The tool's orientation within its segment's tolerance, at samples of a spline.

Bounds on the three components of the rotation vector are planes; a bound on the angle is a ball.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.refinement.capsule_constraints import Capsules, EvaluatedCapsules
from tubeplanner.refinement.linear_rows import Rows, StepSize, plane_rows
from tubeplanner.refinement.sampled_spline import SampledSpline
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.tube.rotational_tube import RotationalTube

_SIDES = np.vstack([np.eye(3), -np.eye(3)])


@dataclass(frozen=True, eq=False)
class EvaluatedRotation:
    """The tool's rotation at N samples of a spline, and the bounds on its three components.

    Attributes:
        robot: The arm.
        tube: The rotational part of the tube.
        at: The spline at the samples.
        segment: The samples' segments, shape (N,).
        margin: The share of the tolerances that stays unused.
        limit: Numbers of the tolerances among the limits, shape (N,).
    """

    robot: RobotModel
    tube: RotationalTube
    at: SampledSpline
    segment: IntArray
    margin: float
    limit: IntArray

    @property
    def excess(self) -> FloatArray:
        """How far components are beyond the narrowed bounds, in bounds, shape (N,)."""
        excess: FloatArray = (abs(self._error) / self._bounds).max(axis=1) - (1 - self.margin)
        return excess

    def angle(self) -> EvaluatedCapsules:
        """Return the bound on the angle: the rotation vector in a ball."""
        centre, count = np.zeros((len(self.tube.bounds), 3)), len(self.segment)
        return EvaluatedCapsules(
            self.at,
            self._error,
            lambda: self._by_joint,
            Capsules(centre, centre, self.tube.bounds[:, 3]),
            self.segment,
            lambda _: self.segment,
            np.zeros(count, dtype=bool),
            np.full(count, self.margin),
            self.limit,
        )

    def rows(self, size: StepSize | None) -> Rows:
        """Return rows that keep the components of the rotation vector within their bounds.

        Args:
            size: Of the step; rows that it cannot break are left out. None: all rows.
        """
        bounds = np.hstack([self._bounds, self._bounds])
        by_side = np.matmul(_SIDES, self._by_joint) / bounds[:, :, None]
        slack = np.where(np.isfinite(bounds), self.slack.reshape(bounds.shape), np.inf)
        return plane_rows(self.at.first, self.at.chained(by_side[None]), slack, self.limit, size)

    @property
    def row_count(self) -> int:
        """How many rows there are."""
        return len(_SIDES) * len(self.segment)

    @property
    def slack(self) -> FloatArray:
        """The slack of all rows that `rows` numbers."""
        bounds = np.hstack([self._bounds, self._bounds])
        slack: FloatArray = 1 - self.margin - self._error @ _SIDES.T / bounds
        return slack.ravel()

    @property
    def _bounds(self) -> FloatArray:
        return self.tube.bounds[self.segment, :3]

    @cached_property
    def _error(self) -> FloatArray:
        """Rotation vectors from the reference to the tool, shape (N, 3) [rad]."""
        rotation, tool = self.robot.tool_pose(self.at.position)
        return self.tube.error(rotation, tool, self.segment)

    @cached_property
    def _by_joint(self) -> FloatArray:
        """What they change by with the joints, shape (N, 3, n)."""
        rotation, tool, jacobian = self.robot.tool_pose_jacobian(self.at.position)
        return self.tube.error_jacobian(rotation, tool, jacobian, self.segment)[1]


def evaluated_rotation(
    robot: RobotModel,
    tube: RotationalTube,
    at: SampledSpline,
    segment: IntArray,
    margin: float,
    first_limit: int,
) -> EvaluatedRotation:
    """Return the rotation tolerance at N samples of a spline, each in a segment, shape (N,)."""
    return EvaluatedRotation(robot, tube, at, segment, margin, first_limit + segment)
