"""The tool's orientation within its segment's tolerance, at samples of a spline."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.refinement.linear_rows import Rows, StepSize, plane_rows
from tubeplanner.refinement.phased_spline import PhasedSpline, Samples
from tubeplanner.refinement.sampled_spline import SampledSpline, sampled
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.tube.rotational_tube import RotationalTube

# Both sides of every component; for a bound on the angle they are planes about its ball.
_AXES = np.vstack([np.eye(3), -np.eye(3)])
_NO_ANGLE = 1e-9  # [rad]


@dataclass(frozen=True, eq=False)
class EvaluatedRotation:
    """The rotation tolerance at N samples of a spline.

    Attributes:
        robot: The arm.
        tube: The rotational part of the tube.
        at: The spline at the samples.
        samples: Each is in the phase of its segment.
        margin: The share of the tolerances that stays unused.
        first_limit: Number of the first segment's tolerance among the limits.
    """

    robot: RobotModel
    tube: RotationalTube
    at: SampledSpline
    samples: Samples
    margin: float
    first_limit: int

    @cached_property
    def excess(self) -> FloatArray:
        """How far the tool is turned beyond the narrowed tolerances, in tolerances, shape (N,)."""
        angle = np.linalg.norm(self._error, axis=1, keepdims=True)
        used = np.hstack([abs(self._error), angle]) / self.tube.bounds[self.samples.phase]
        return used.max(axis=1) - (1 - self.margin)

    def rows(self, size: StepSize | None) -> Rows:
        """Return rows that keep the rotation vector behind planes at its bounds.

        Args:
            size: Of the step; rows that it cannot break are left out. None: all rows.
        """
        slack = self.slack(self).reshape(len(self.samples.phase), -1)
        rotation, tool, jacobian = self.robot.tool_pose_jacobian(self.at.position)
        _, by_joint = self.tube.error_jacobian(rotation, tool, jacobian, self.samples.phase)
        by_plane = np.matmul(self._normals, by_joint) / self._bounds[:, :, None]
        slack = np.where(np.isfinite(self._bounds), slack, np.inf)
        limit = self.first_limit + self.samples.phase
        return plane_rows(self.at.first, self.at.chained(by_plane[None]), slack, limit, size)

    @property
    def row_count(self) -> int:
        """How many rows there are."""
        return int(self._bounds.size)

    def slack(self, there: "EvaluatedRotation") -> FloatArray:
        """Return the slack of all rows that `rows` numbers, for the same samples elsewhere."""
        used = np.einsum("npi,ni->np", self._normals, there._error) / self._bounds
        slack: FloatArray = 1 - self.margin - used
        return slack.ravel()

    @cached_property
    def _error(self) -> FloatArray:
        """Rotation vectors from the reference to the tool, shape (N, 3) [rad]."""
        rotation, tool = self.robot.tool_pose(self.at.position)
        return self.tube.error(rotation, tool, self.samples.phase)

    @cached_property
    def _normals(self) -> FloatArray:
        """Normals of the planes: for components, for the angle, and outwards, (N, 13, 3)."""
        angle = np.linalg.norm(self._error, axis=1, keepdims=True)
        outward = np.where(angle > _NO_ANGLE, self._error / np.maximum(angle, _NO_ANGLE), _AXES[0])
        fixed = np.broadcast_to(np.vstack([_AXES, _AXES]), (len(angle), 2 * len(_AXES), 3))
        return np.concatenate([fixed, outward[:, None]], axis=1)

    @cached_property
    def _bounds(self) -> FloatArray:
        """How far away the planes are, shape (N, 13) [rad]; inf where there is none."""
        bounds = self.tube.bounds[self.samples.phase]
        angle = np.repeat(bounds[:, 3:], len(_AXES) + 1, axis=1)
        return np.hstack([bounds[:, :3], bounds[:, :3], angle])


def evaluated_rotation(
    robot: RobotModel,
    tube: RotationalTube,
    spline: PhasedSpline,
    samples: Samples,
    margin: float,
    first_limit: int,
) -> EvaluatedRotation:
    """Return the rotation tolerance at samples of a spline, each in the phase of its segment."""
    return EvaluatedRotation(robot, tube, sampled(spline, samples), samples, margin, first_limit)
