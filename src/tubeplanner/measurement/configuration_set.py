"""All configurations that one segment of a tube allows: joints in ranges, the tool in a capsule."""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray
from tubeplanner.measurement.tool_moves import WantedTools, moved_tools
from tubeplanner.problem.problem import PlanningProblem

# A tool this near to where it is wanted is there: a share of the radius, and of a rotation [rad].
_NEAR_SHARE, _NEAR_TURN = 0.1, 0.01
_INSIDE = 1e-9  # [m or rad]
# So many of the samples are wanted at the surface of what is allowed: extremes are there.
_AT_SURFACE = 0.5
_WITHIN = 0.999  # of a bound is the target, so that rounding does not end outside


@dataclass(frozen=True, eq=False)
class ConfigurationSet:
    """The configurations that a segment allows.

    Attributes:
        problem: Its arm counts, and its tube's reference points and rotations.
        segment: Index of the segment.
        lower: Lower joint bounds, shape (n,) [rad or m].
        upper: Upper joint bounds, likewise.
        radius: How far the tool centre point may be from the segment [m].
    """

    problem: PlanningProblem
    segment: int
    lower: FloatArray
    upper: FloatArray
    radius: float

    def is_as(self, other: "ConfigurationSet") -> bool:
        """Return whether another set of the same segment has the same bounds."""
        same_ranges = np.array_equal(self.lower, other.lower)
        same_ranges &= np.array_equal(self.upper, other.upper)
        return self.radius == other.radius and same_ranges

    def tool_distance(self, q: FloatArray) -> FloatArray:
        """Return how far tools are from the segment, for configurations (N, n): (N,) [m]."""
        return self._distance(self.problem.robot.tool_position(q))

    def contains(self, q: FloatArray) -> BoolArray:
        """Return which configurations (N, n) are in the set: bool, shape (N,)."""
        rotation, tool = self.problem.robot.tool_pose(q)
        inside = self._distance(tool) <= self.radius + _INSIDE
        inside &= np.all((q >= self.lower - _INSIDE) & (q <= self.upper + _INSIDE), axis=1)
        turned = self.problem.tube.rotation_margin(rotation, tool, self._alone)[:, 0]
        return np.asarray(inside & (turned >= -_INSIDE))

    def sample(self, count: int, rng: np.random.Generator) -> FloatArray:
        """Return random configurations of the set, `count` of them at most, shape (N, n).

        Draws joint values in their ranges and tool poses in the capsule and the rotation tolerance,
        then moves the joints until the tool has its pose; drops those that do not get there.
        """
        q = rng.uniform(self.lower, self.upper, (count, len(self.lower)))
        moved = self._moved(q, self._targets(count, rng), self._turns(count, rng))
        return moved[self.contains(moved)]

    def back_inside(self, q: FloatArray) -> FloatArray:
        """Return configurations (N, n) moved towards the set, none farther than needed."""
        q = np.clip(q, self.lower, self.upper)
        rotation, tool = self.problem.robot.tool_pose(q)
        nearest = self.problem.tube.nearest(tool, self._alone)[:, 0]
        distance = np.linalg.norm(tool - nearest, axis=1, keepdims=True)
        share = np.minimum(1.0, _WITHIN * self.radius / np.maximum(distance, _INSIDE))
        turns = None
        if self._turn_bounds is not None:
            tube = self.problem.tube.rotation
            assert tube is not None
            turns = self._bounded(tube.error(rotation, tool, self.segment))
        return self._moved(q, nearest + share * (tool - nearest), turns, near=0.0)

    def _moved(
        self,
        q: FloatArray,
        targets: FloatArray,
        turns: FloatArray | None,
        near: float = 1.0,
    ) -> FloatArray:
        """Return configurations (N, n) whose tools are at targets (N, 3), or as near as they come.

        Args:
            q: Where to start, shape (N, n).
            targets: Where the tools are wanted, shape (N, 3) [m].
            turns: Rotation vectors wanted against the reference there, (N, 3) [rad]; None: any.
            near: How near is near enough, as a share of the value for samples.
        """
        close = near * np.array([_NEAR_SHARE * self.radius, _NEAR_TURN]) + _INSIDE
        wanted, tube, bounds = WantedTools(targets), self.problem.tube.rotation, self._turn_bounds
        if tube is not None and bounds is not None and turns is not None:
            asked = np.isfinite(bounds[:3]) | np.isfinite(bounds[3])
            wanted = WantedTools(targets, tube.reference(targets, self.segment), turns, asked)
        return moved_tools(self.problem.robot, q, (self.lower, self.upper), wanted, close)

    def _targets(self, count: int, rng: np.random.Generator) -> FloatArray:
        """Return random points of the capsule, shape (count, 3) [m]."""
        begin, end = self.problem.tube.points[self.segment : self.segment + 2]
        beyond = self.radius / float(np.linalg.norm(end - begin))
        share = np.clip(rng.uniform(-beyond, 1 + beyond, count), 0.0, 1.0)[:, None]
        return (1 - share) * begin + share * end + _WITHIN * self.radius * _in_ball(count, rng)

    def _turns(self, count: int, rng: np.random.Generator) -> FloatArray | None:
        """Return random rotation vectors within the bounds, (count, 3); None where all is free."""
        bounds = self._turn_bounds
        if bounds is None:
            return None
        if np.isfinite(bounds[3]):
            return _WITHIN * bounds[3] * _in_ball(count, rng)
        finite = np.where(np.isfinite(bounds[:3]), bounds[:3], 0.0)
        return _WITHIN * finite * rng.uniform(-1, 1, (count, 3))

    def _bounded(self, vectors: FloatArray) -> FloatArray:
        """Return rotation vectors (N, 3) [rad] moved into the rotation tolerance."""
        bounds = self._turn_bounds
        assert bounds is not None
        vectors = np.clip(vectors, -_WITHIN * bounds[:3], _WITHIN * bounds[:3])
        angle = np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), _INSIDE)
        return vectors * np.minimum(1.0, _WITHIN * bounds[3] / angle)

    @property
    def _turn_bounds(self) -> FloatArray | None:
        """Bounds on the rotation vector's components and its length (4,), if there is any."""
        tube = self.problem.tube.rotation
        if tube is None or not np.isfinite(tube.bounds[self.segment]).any():
            return None
        return tube.bounds[self.segment]

    @property
    def _alone(self) -> slice:
        return slice(self.segment, self.segment + 1)

    def _distance(self, tool: FloatArray) -> FloatArray:
        return np.asarray(self.problem.tube.distance(tool, self._alone)[:, 0])


def _in_ball(count: int, rng: np.random.Generator) -> FloatArray:
    """Return random points of the unit ball, shape (count, 3), half of them on its surface."""
    direction = rng.normal(size=(count, 3))
    size = rng.uniform(0, 1, count) ** (1 / 3)
    size[rng.uniform(0, 1, count) < _AT_SURFACE] = 1.0
    return size[:, None] * direction / np.linalg.norm(direction, axis=1, keepdims=True)
