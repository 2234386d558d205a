"""The configurations of one segment: joints in ranges, tool in a capsule; samples, projection."""

from ctypes import c_int, c_int64
from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, read_only
from tubeplanner.native.library import Bytes, Doubles, native_function
from tubeplanner.orientation import inverse_right_jacobian, rotation_vector
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.problem import PlanningProblem

# ---- All configurations that one segment of a tube allows: joints in ranges, tool in a capsule.
# Targets of samples count as reached within this fraction of the radius, and this rotation [rad].
_NEAR_FRACTION, _NEAR_TURN = 0.1, 0.01
_INSIDE = 1e-9  # [m or rad]
# Fraction of the samples drawn at the surface of the allowed ball: extremes are there.
_AT_SURFACE = 0.5
_WITHIN = 0.999  # of a bound: targets stay inside, so that rounding does not end outside


@dataclass(frozen=True, eq=False)
class ConfigurationSet:
    """The configurations that a segment allows."""

    # the problem, of which the arm and the tube's reference points and rotations count
    problem: PlanningProblem
    segment: int  # index of the segment
    lower: FloatArray  # lower joint bounds, shape (n,) [rad or m]
    upper: FloatArray  # upper joint bounds, likewise
    radius: float  # largest distance of the tool centre point from the segment [m]

    def is_as(self, other: "ConfigurationSet") -> bool:
        """Return True if another set of the same segment has the same bounds."""
        same_ranges = np.array_equal(self.lower, other.lower)
        same_ranges &= np.array_equal(self.upper, other.upper)
        return self.radius == other.radius and same_ranges

    def tool_distance(self, q: FloatArray) -> FloatArray:
        """Return the distances of tools from the segment, for configurations (N, n): (N,) [m]."""
        return self._distance(self.problem.robot.tool_position(q))

    def contains(self, q: FloatArray) -> BoolArray:
        """Return a mask of the configurations (N, n) in the set, shape (N,)."""
        rotation, tool = self.problem.robot.tool_pose(q)
        inside = self._distance(tool) <= self.radius + _INSIDE
        inside &= np.all((q >= self.lower - _INSIDE) & (q <= self.upper + _INSIDE), axis=1)
        margin = self.problem.tube.rotation_margin(rotation, tool, self._alone)[:, 0]
        return np.asarray(inside & (margin >= -_INSIDE))

    def sample(self, count: int, rng: np.random.Generator) -> FloatArray:
        """Return at most `count` random configurations of the set, shape (N, n).

        Draws joint values in their ranges and tool poses in the capsule and the rotation tolerance,
        moves the joints until the tool has its pose, and drops samples that do not reach it.
        """
        q = rng.uniform(self.lower, self.upper, (count, len(self.lower)))
        begin, end = self.problem.tube.points[self.segment : self.segment + 2]
        beyond = self.radius / float(np.linalg.norm(end - begin))
        fraction = np.clip(rng.uniform(-beyond, 1 + beyond, count), 0.0, 1.0)[:, None]
        line = (1 - fraction) * begin + fraction * end
        targets = line + _WITHIN * self.radius * _in_ball(count, rng)
        bounds, rotations = self._rotation_bounds, None
        if bounds is not None and np.isfinite(bounds[3]):
            rotations = _WITHIN * bounds[3] * _in_ball(count, rng)
        elif bounds is not None:
            finite = np.where(np.isfinite(bounds[:3]), bounds[:3], 0.0)
            rotations = _WITHIN * finite * rng.uniform(-1, 1, (count, 3))
        q = self._moved(q, targets, rotations)
        return q[self.contains(q)]

    def back_inside(self, q: FloatArray) -> FloatArray:
        """Return configurations (N, n) moved towards the set, none farther than needed."""
        q = np.clip(q, self.lower, self.upper)
        rotation, tool = self.problem.robot.tool_pose(q)
        nearest = self.problem.tube.nearest(tool, self._alone)[:, 0]
        distance = np.linalg.norm(tool - nearest, axis=1, keepdims=True)
        fraction = np.minimum(1.0, _WITHIN * self.radius / np.maximum(distance, _INSIDE))
        rotations, tube, bounds = None, self.problem.tube.rotation, self._rotation_bounds
        if tube is not None and bounds is not None:
            rotations = tube.error(rotation, tool, self.segment)
            rotations = np.clip(rotations, -_WITHIN * bounds[:3], _WITHIN * bounds[:3])
            angle = np.maximum(np.linalg.norm(rotations, axis=1, keepdims=True), _INSIDE)
            rotations = rotations * np.minimum(1.0, _WITHIN * bounds[3] / angle)
        return self._moved(q, nearest + fraction * (tool - nearest), rotations, near=0.0)

    def _moved(
        self, q: FloatArray, targets: FloatArray, rotations: FloatArray | None, near: float = 1.0
    ) -> FloatArray:
        """Return `moved_tools` within the bounds; rotation vectors are against the tube's.

        The tolerance is a fraction `near` of that for samples.
        """
        close = near * np.array([_NEAR_FRACTION * self.radius, _NEAR_TURN]) + _INSIDE
        tube, bounds, rotation = self.problem.tube.rotation, self._rotation_bounds, None
        if tube is not None and bounds is not None and rotations is not None:
            counts = np.isfinite(bounds[:3]) | np.isfinite(bounds[3])
            rotation = tube.reference(targets, self.segment), rotations, counts
        ranges = self.lower, self.upper
        return moved_tools(self.problem.robot, q, ranges, targets, close, rotation)

    @property
    def _rotation_bounds(self) -> FloatArray | None:
        """Bounds on components and length of the rotation vector, (4,) [rad]; None if free."""
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
    """Return random points of the unit ball, about half on its surface, shape (count, 3)."""
    direction = rng.normal(size=(count, 3))
    size = rng.uniform(0, 1, count) ** (1 / 3)
    size[rng.uniform(0, 1, count) < _AT_SURFACE] = 1.0
    return size[:, None] * direction / np.linalg.norm(direction, axis=1, keepdims=True)


# ---- Joints moved until tools reach their targets, in many configurations at once.
#
# Damped least squares (Nakamura & Hanafusa, "Inverse kinematic solutions with singularity
# robustness", 1986). Where a target is out of reach, the tool comes as near as its joints let it;
# nothing pulls joints that are redundant.
_MAX_STEPS = 20
_MAX_STEP = 0.4  # [rad or m] of any joint
_STILL = 1e-5  # [rad or m]: joints that move less come no nearer
_DAMPING = 1e-6  # of squared metres and radians
_SETTINGS = read_only([_MAX_STEPS, _MAX_STEP, _STILL, _DAMPING])
_move = native_function(
    "tubeplanner_move_tools",
    *(Doubles, c_int64, c_int64, Doubles, Doubles, Doubles, Doubles, c_int64),
    *(Doubles, Doubles, Doubles, Bytes, Doubles),
    returns=c_int,
)


def moved_tools(
    robot: RobotModel,
    q: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    position: FloatArray,
    close: FloatArray,
    rotation: tuple[FloatArray, FloatArray, BoolArray] | None = None,
) -> FloatArray:
    """Return configurations whose tools are at their targets, or as near as joints let the tools.

    From configurations (N, n) within lower and upper bounds (n,), to positions (N, 3) [m]. A target
    rotation is reference orientations (N, 3, 3), rotation vectors against these, in their frames,
    (N, 3) [rad], and True for the components that count (3,); None: any rotation. A target is met
    within tolerances of position [m] and rotation [rad], `close` (2,).
    """
    if _move is not None:
        table, position = robot.tool_joints, np.ascontiguousarray(position)
        q, lower, upper = (np.array(each, dtype=float, order="C") for each in (q, *bounds))
        targets = (None, None, None) if rotation is None else map(np.ascontiguousarray, rotation)
        arm = table, len(table), q.shape[1], _SETTINGS, close, lower, upper
        if _move(*arm, len(q), position, *targets, q):
            raise MemoryError
        return q
    q, live = q.copy(), np.arange(len(q))
    for _ in range(_MAX_STEPS):
        orientation, tool, jacobian = robot.tool_pose_jacobian(q[live])
        error, turning = position[live] - tool, jacobian[:, 3:]
        jacobian = jacobian[:, :3]
        if rotation is not None:
            reference, target, counts = rotation
            vector = rotation_vector(reference[live].transpose(0, 2, 1) @ orientation)
            spin = inverse_right_jacobian(vector) @ orientation.transpose(0, 2, 1) @ turning
            error = np.hstack([error, (target[live] - vector)[:, counts]])
            jacobian = np.concatenate([jacobian, spin[:, counts]], axis=1)
        off = np.linalg.norm(error[:, :3], axis=1), np.linalg.norm(error[:, 3:], axis=1)
        unsettled = (off[0] > close[0]) | (off[1] > close[1])
        live, error, jacobian = live[unsettled], error[unsettled], jacobian[unsettled]
        if len(live) == 0:
            break
        stepped = _stepped(q[live], bounds, error, jacobian)
        still = abs(stepped - q[live]).max(axis=1) < _STILL
        q[live] = stepped
        live = live[~still]
    return q


def _stepped(
    q: FloatArray, bounds: tuple[FloatArray, FloatArray], error: FloatArray, jacobian: FloatArray
) -> FloatArray:
    """Return configurations after a damped step; joints at a bound are not pushed outwards."""
    lower, upper = bounds
    for _ in range(2):
        gram = jacobian @ jacobian.transpose(0, 2, 1) + _DAMPING * np.eye(error.shape[1])
        pull = np.linalg.solve(gram, error[:, :, None])
        step = (jacobian.transpose(0, 2, 1) @ pull)[:, :, 0]
        outward = ((q <= lower) & (step < 0)) | ((q >= upper) & (step > 0))
        jacobian = np.where(outward[:, None], 0.0, jacobian)
    largest = np.maximum(abs(step).max(axis=1, keepdims=True), _MAX_STEP)
    return np.clip(q + step * (_MAX_STEP / largest), lower, upper)
