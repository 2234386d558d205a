"""The tool in the capsule of its segment, at samples of a spline."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.refinement.linear_rows import NO_LIMIT, Rows, StepSize, plane_rows
from tubeplanner.refinement.phased_spline import PhasedSpline, Samples
from tubeplanner.refinement.sampled_spline import SampledSpline, sampled

# Planes about a capsule's axis, on both sides of the outward direction [rad].
_FAN = np.radians([0.0, 15.0, -15.0, 45.0, -45.0, 90.0, -90.0, 180.0])
_PLANES = len(_FAN) + 3  # and the outward one, and both caps
_NO_LENGTH = 1e-9  # [m]


@dataclass(frozen=True, eq=False)
class EvaluatedTube:
    """The tube at N samples of a spline.

    Attributes:
        problem: The planning problem.
        at: The spline at the samples.
        samples: Each is in the phase of its segment.
        margin: The share of the radii that stays unused.
        first_limit: Number of the first segment's radius among the limits.
    """

    problem: PlanningProblem
    at: SampledSpline
    samples: Samples
    margin: float
    first_limit: int

    @cached_property
    def excess(self) -> FloatArray:
        """How far the tool is outside the narrowed capsules, in radii, shape (N,)."""
        away = self._tool - self._nearest
        return np.linalg.norm(away, axis=1) / self._radius - (1 - self.margin)

    def rows(self, size: StepSize | None) -> Rows:
        """Return rows that keep the tool in the narrowed capsules.

        A capsule is convex: the tool is inside if it is behind every supporting plane n.p <=
        max(n.A, n.B) + r, A and B being the ends of the axis. Planes are taken about the outward
        direction, and at both caps.

        Args:
            size: Of the step; rows that it cannot break are left out. None: all rows.
        """
        slack = self._slack_behind_planes(self)
        linear = self.problem.robot.tool_jacobian(self.at.position)[1][:, :3]
        by_joint = np.matmul(self._normals, linear) / self._radius[:, None, None]
        limit = self.first_limit + self.samples.phase
        return plane_rows(self.at.first, self.at.chained(by_joint[None]), slack, limit, size)

    @property
    def row_count(self) -> int:
        """How many rows there are."""
        return len(self.at.position) * _PLANES

    def slack(self, there: "EvaluatedTube") -> FloatArray:
        """Return the slack of all rows that `rows` numbers, for the same samples elsewhere."""
        return self._slack_behind_planes(there).ravel()

    def _slack_behind_planes(self, there: "EvaluatedTube") -> FloatArray:
        """Return how far the tool elsewhere is behind the planes of here, in radii, (N, P)."""
        begin, end = self._axis_ends
        support = np.maximum(
            np.einsum("npi,ni->np", self._normals, begin),
            np.einsum("npi,ni->np", self._normals, end),
        )
        used = np.einsum("npi,ni->np", self._normals, there._tool) - support
        return 1 - self.margin - used / self._radius[:, None]

    @cached_property
    def _normals(self) -> FloatArray:
        """Normals of the supporting planes, shape (N, P, 3)."""
        begin, end = self._axis_ends
        axis = (end - begin) / np.linalg.norm(end - begin, axis=1)[:, None]
        return _normals(self._tool - self._nearest, axis)

    @cached_property
    def _tool(self) -> FloatArray:
        return self.problem.robot.tool_position(self.at.position)

    @cached_property
    def _nearest(self) -> FloatArray:
        """The points of the segments' axes that are nearest to the tool, shape (N, 3)."""
        nearest = self.problem.tube.nearest(self._tool)
        return nearest[np.arange(len(nearest)), self.samples.phase]

    @property
    def _axis_ends(self) -> tuple[FloatArray, FloatArray]:
        points, segment = self.problem.tube.points, self.samples.phase
        return points[segment], points[segment + 1]

    @property
    def _radius(self) -> FloatArray:
        radius: FloatArray = self.problem.tube.effective_radius[self.samples.phase]
        return radius


def evaluated_tube(
    problem: PlanningProblem,
    spline: PhasedSpline,
    samples: Samples,
    margin: float,
    first_limit: int = NO_LIMIT,
) -> EvaluatedTube:
    """Return the tube at samples of a spline; each phase belongs to the segment of its number."""
    return EvaluatedTube(problem, sampled(spline, samples), samples, margin, first_limit)


def _normals(away: FloatArray, axis: FloatArray) -> FloatArray:
    """Return unit normals of supporting planes, (N, 11, 3): outward, a fan about the axis, caps."""
    length = np.linalg.norm(away, axis=1, keepdims=True)
    helper = np.eye(3)[abs(axis).argmin(axis=1)]
    across = np.cross(axis, helper)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    outward = np.where(length > _NO_LENGTH, away / np.maximum(length, _NO_LENGTH), across)
    radial = outward - np.einsum("ni,ni->n", outward, axis)[:, None] * axis
    size = np.linalg.norm(radial, axis=1, keepdims=True)
    radial = np.where(size > 1e-6, radial / np.maximum(size, 1e-6), across)
    sideways = np.cross(axis, radial)
    cos, sin = np.cos(_FAN)[:, None], np.sin(_FAN)[:, None]
    fan = cos * radial[:, None] + sin * sideways[:, None]
    ends = np.stack([outward, axis, -axis], axis=1)
    return np.concatenate([ends[:, :1], fan, ends[:, 1:]], axis=1)
