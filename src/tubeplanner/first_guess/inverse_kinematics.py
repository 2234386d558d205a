"""Inverse kinematics of position and rotation, exact or within a tolerance, native and NumPy."""

import math
from ctypes import c_int, c_int64
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, read_only
from tubeplanner.geometry.tube.rotation import RotationalTube
from tubeplanner.native.library import LIBRARY, Bytes, Doubles, native_function
from tubeplanner.orientation import inverse_right_jacobian, nearest_branch, rotation_vector
from tubeplanner.robot.model import RobotModel

_SOLVE = native_function(
    "tubeplanner_solve_positions",
    *(Doubles, c_int64, c_int64, Doubles, c_int64),
    *(Doubles, Doubles, Doubles, Doubles, Doubles, Doubles, Doubles, Bytes, Doubles, Doubles),
    returns=c_int,
)


def native_solve_positions(
    table: FloatArray,
    settings: FloatArray,
    position: FloatArray,
    joints: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    rotation: tuple[FloatArray, FloatArray, BoolArray] | None,
) -> tuple[FloatArray, FloatArray]:
    """Return configurations (N, n) and their errors (N, 2), of position [m] and rotation [rad].

    All arrays may lack the axis of N, for one configuration. The table has the joints that move the
    tool, the last body of all. Joints are seeds, lower bounds, upper bounds and preferred
    configurations, each (N, n). A rotation is references (N, 3, 3), vectors (N, 3) and a mask of
    the components that count (N, 3); None: any.
    """
    assert _SOLVE is not None
    *many, joint_count = joints[0].shape
    count = many[0] if many else 1
    q, errors = np.empty((*many, joint_count)), np.empty((*many, 2))
    targets = [np.ascontiguousarray(values, dtype=np.float64) for values in (position, *joints)]
    rotations: tuple[FloatArray | BoolArray | None, ...] = (None, None, None)
    if rotation is not None:
        reference, vector, components = rotation
        rotations = (
            np.ascontiguousarray(reference),
            np.ascontiguousarray(vector, dtype=np.float64),
            np.ascontiguousarray(components),
        )
    if _SOLVE(table, len(table), joint_count, settings, count, *targets, *rotations, q, errors):
        raise MemoryError
    return q, errors


# ---- Inverse kinematics of one tool position, optionally of its rotation, within joint bounds.
#
# Lengths are measured by the arm's: an arm of another size, or in other units, is bent alike.
#
# Damped least squares with the damping of Sugihara, "Solvability-unconcerned inverse kinematics by
# the Levenberg-Marquardt method" (IEEE T-RO 27(5), 2011): it converges at a fully stretched arm,
# and comes as near as possible to a point out of reach. The rotation comes second: it uses what the
# position leaves, in the null space of its Jacobian. A third task pulls redundant joints towards a
# preferred configuration, in the null space of both.

_DAMPING = 1e-10  # added to half the squared error
_POSITION_TOLERANCE = 1e-10
# The last step [joint units]: the remaining error is of the order of its square.
_POSTURE_TOLERANCE = 1e-6
_MAX_ITERATIONS = 100
# Near full stretch a joint is all but redundant, and a pull on it would keep the tool from its
# target: later iterations go for the target alone.
_PULLED_ITERATIONS = 40
_MAX_STEP = 0.2  # [joint units] of any joint
# Directions in which a joint moves the tool by less than this count as redundant, by joint units.
_REDUNDANT_GAIN = 1e-4
# A stretched arm cannot feel which way to fold: it is bent this much, one way, then the other.
_BENDS = (0.05, -0.05)  # [joint units], its sign alternating from joint to joint
_SETTINGS = read_only(
    [
        *(_DAMPING, _POSITION_TOLERANCE, _POSTURE_TOLERANCE, _MAX_ITERATIONS, _PULLED_ITERATIONS),
        *(_MAX_STEP, _REDUNDANT_GAIN, *_BENDS),
    ]
)


@dataclass(frozen=True, eq=False)
class WantedRotation:
    """A target orientation of the tool."""

    reference: FloatArray  # reference orientation, shape (3, 3), base frame
    # target rotation vector, in the reference's frame, shape (3,) [rad]
    vector: FloatArray = field(default_factory=lambda: np.zeros(3))
    # True for components of the vector that count, shape (3,)
    components: BoolArray = field(default_factory=lambda: np.ones(3, dtype=bool))

    @property
    def parts(self) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Reference, vector and components."""
        return self.reference, self.vector, self.components

    def repeated(self, count: int) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return the parts for N configurations: (N, 3, 3), (N, 3) and (N, 3)."""
        return (
            np.broadcast_to(self.reference, (count, 3, 3)),
            np.broadcast_to(self.vector, (count, 3)),
            np.broadcast_to(self.components, (count, 3)),
        )


@dataclass(frozen=True, eq=False)
class PositionSolution:
    """The configuration whose tool is nearest to a position."""

    q: FloatArray  # configuration within the bounds, shape (n,) [rad or m]
    error: float  # distance of the tool from the position [m]
    # distance of the rotation vector from its target, in the components that count [rad]
    rotation_error: float = 0.0


def solve_position(
    robot: RobotModel,
    target: FloatArray,
    seed: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    preferred: FloatArray | None = None,
    rotation: WantedRotation | None = None,
) -> PositionSolution:
    """Move a configuration until the tool is at a position.

    Args:
        robot: The arm.
        target: Tool position, shape (3,), base frame [m].
        seed: First configuration, shape (n,) [rad or m].
        lower: Lower joint bounds, shape (n,).
        upper: Upper joint bounds, shape (n,).
        preferred: Pulls redundant joints, shape (n,); default: the seed.
        rotation: Target orientation of the tool; default: any.

    Returns:
        The solution; its errors say whether the target was reached.
    """
    joints = (seed, lower, upper, seed if preferred is None else preferred)
    if LIBRARY.functions is None:
        return _solved(robot, target, joints, rotation)
    parts = None if rotation is None else rotation.parts
    q, errors = _natively_solved(robot, target, joints, parts)
    return PositionSolution(q, *errors.tolist())


def solve_positions(
    robot: RobotModel,
    targets: FloatArray,
    seeds: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    preferred: FloatArray | None = None,
    rotation: WantedRotation | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Move configurations until the tool is at positions, as `solve_position` moves each.

    Seeds have shape (N, n), targets (N, 3) or (3,) for all, other arrays (N, n) or (n,) for all.

    Returns:
        Configurations (N, n) within the bounds, and their errors (N, 2): of the position [m] and
        of the rotation [rad].
    """
    count, joint_count = seeds.shape
    targets = np.broadcast_to(targets, (count, 3))
    preferred = seeds if preferred is None else preferred
    lower, upper, preferred = (
        np.broadcast_to(values, seeds.shape) for values in (lower, upper, preferred)
    )
    if LIBRARY.functions is not None:
        joints = (seeds, lower, upper, preferred)
        parts = None if rotation is None else rotation.repeated(count)
        return _natively_solved(robot, targets, joints, parts)
    q, errors = np.empty((count, joint_count)), np.empty((count, 2))
    for i, joints in enumerate(zip(seeds, lower, upper, preferred, strict=True)):
        solution = _solved(robot, targets[i], joints, rotation)
        q[i], errors[i] = solution.q, (solution.error, solution.rotation_error)
    return q, errors


# A seed, lower bounds, upper bounds and a preferred configuration, each (n,).
_Joints: TypeAlias = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


def _natively_solved(
    robot: RobotModel,
    targets: FloatArray,
    joints: _Joints,
    rotation: tuple[FloatArray, FloatArray, BoolArray] | None,
) -> tuple[FloatArray, FloatArray]:
    """Return `native_solve_positions` of an arm [rad or m], [m] and [rad]."""
    length, units = robot.arm_length, robot.joint_units
    seed, lower, upper, preferred = (values / units for values in joints)
    q, errors = native_solve_positions(
        robot.tool_joints_in_units,
        _SETTINGS,
        targets / length,
        (seed, lower, upper, preferred),
        rotation,
    )
    # Division may round: a joint at its bound stays there.
    return np.clip(q * units, joints[1], joints[2]), errors * (length, 1.0)


def _solved(
    robot: RobotModel, target: FloatArray, joints: _Joints, rotation: WantedRotation | None
) -> PositionSolution:
    """Return the solution of `solve_position`, by NumPy."""
    length, units = robot.arm_length, robot.joint_units
    seed, lower, upper, preferred = (values / units for values in joints)
    descent = _Descent(robot, target / length, rotation, lower, upper)
    solution = descent.run(seed, preferred)
    pattern = (-1.0) ** np.arange(len(seed))
    for bend in _BENDS:
        if solution.error < _POSITION_TOLERANCE**0.5:
            break
        other = descent.run(solution.q + bend * pattern, preferred)
        solution = min(solution, other, key=lambda each: each.error)
    q = np.clip(solution.q * units, joints[1], joints[2])
    return PositionSolution(q, solution.error * length, solution.rotation_error)


# Jacobian (c, n) and error (c,) of one task of a step.
_Task: TypeAlias = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, eq=False)
class _Descent:
    """Damped least-squares steps from a seed to the target, in joint units and arm lengths."""

    robot: RobotModel
    target: FloatArray
    rotation: WantedRotation | None
    lower: FloatArray
    upper: FloatArray

    def run(self, seed: FloatArray, preferred: FloatArray) -> PositionSolution:
        q = last = np.minimum(np.maximum(seed, self.lower), self.upper)
        least = np.inf
        for iteration in range(_MAX_ITERATIONS):
            tasks = self._tasks(q)
            distance, angle = _lengths(tasks)
            is_pulled = iteration < _PULLED_ITERATIONS
            if not is_pulled and distance > max(least, _POSITION_TOLERANCE):
                q = (last + q) / 2  # a step beyond a target out of reach
                continue
            least, last = distance, q
            q = self._next(q, tasks, preferred - q if is_pulled else np.zeros_like(q))
            step = q - last
            if np.abs(step).max() < _POSTURE_TOLERANCE:
                # Over so short a step the errors change as their Jacobians say.
                remaining = [(jacobian, error - jacobian.dot(step)) for jacobian, error in tasks]
                return PositionSolution(q, *_lengths(remaining))
            if not is_pulled and max(distance, angle) < _POSITION_TOLERANCE:
                break
        return PositionSolution(q, *_lengths(self._tasks(q)))

    def _next(self, q: FloatArray, tasks: list[_Task], pull: FloatArray) -> FloatArray:
        """Return the next configuration (n,); joints pushed out of bounds stay there."""
        free, step = np.ones(len(q), dtype=bool), _free_step(tasks, pull)
        while True:
            ahead = q + step * min(1.0, _MAX_STEP / max(float(np.abs(step).max()), 1e-300))
            bounded: FloatArray = np.minimum(np.maximum(ahead, self.lower), self.upper)
            cut = bounded != ahead
            if not cut.any():
                return bounded
            outward = cut & (bounded == q)
            if not outward.any():
                return bounded
            free &= ~outward
            step = np.zeros_like(q)
            step[free] = _free_step([(task[:, free], error) for task, error in tasks], pull[free])

    def _tasks(self, q: FloatArray) -> list[_Task]:
        """Return the tasks at a configuration (n,), the position first."""
        length, units = self.robot.arm_length, self.robot.joint_units
        pose = self.robot.tool_pose_jacobian((q * units)[None])
        rotation, position, jacobian = pose[0][0], pose[1][0] / length, pose[2][0] * units
        tasks = [(jacobian[:3] / length, self.target - position)]
        target = self.rotation
        if target is not None and target.components.any():
            vector = rotation_vector(target.reference.T @ rotation)
            vector = nearest_branch(vector, target.vector, target.components)
            rows = inverse_right_jacobian(vector) @ rotation.T @ jacobian[3:]
            error = target.vector - vector
            tasks.append((rows[target.components], error[target.components]))
        return tasks


def _lengths(tasks: list[_Task]) -> tuple[float, float]:
    """Return the errors of position [m] and rotation [rad]."""
    lengths = [math.sqrt(error.dot(error)) for _, error in tasks]
    return lengths[0], sum(lengths[1:])


def _free_step(tasks: list[_Task], pull: FloatArray) -> FloatArray:
    """Return the step of joints without bounds: each task in the null space of earlier tasks.

    The eigenvalues of a task's J J^T are its squared gains; J^T times the eigenvectors are the
    directions of joints that they belong to, each as long as its gain.
    """
    step, remaining_pull = np.zeros_like(pull), pull
    used: list[tuple[FloatArray, FloatArray]] = []
    for jacobian, error in tasks:
        remaining = jacobian
        for directions, inverse in used:
            remaining = remaining - (remaining.dot(directions.T) * inverse).dot(directions)
        squared, vectors = np.linalg.eigh(remaining.dot(remaining.T))
        directions = vectors.T.dot(remaining)
        damping = 0.5 * error.dot(error) + _DAMPING
        rest = vectors.T.dot(error - jacobian.dot(step) if used else error)
        step = step + (rest / (squared + damping)).dot(directions)
        inverse = (squared > _REDUNDANT_GAIN**2) / np.maximum(squared, _REDUNDANT_GAIN**2)
        remaining_pull = remaining_pull - (directions.dot(pull) * inverse).dot(directions)
        used.append((directions, inverse))
    return step + remaining_pull


# ---- Inverse kinematics of a tool position, its rotation anywhere within a tolerance.
#
# Nonlinear least squares (scipy, trust region with bounds) of the tool's distance and of the excess
# of its rotation vector over the tolerance. Where the arm is nearly stretched, it finds
# configurations at the edge of the tolerance to which inverse kinematics of the reference
# orientation does not lead.

_ANGLE_WEIGHT = 0.3  # [m/rad]
_JUST_INSIDE = 0.999  # of the bounds
_MAX_EVALUATIONS = 100
_CONVERGED = 1e-10
_INSIDE = 1e-9  # [rad or m]: where a search may begin, from its bounds


def solve_within_tolerance(
    robot: RobotModel,
    target: FloatArray,
    tube: RotationalTube,
    rows: tuple[int, ...],
    seed: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
) -> PositionSolution:
    """Move a configuration until the tool is at a position and within a rotation tolerance.

    Arrays are those of `solve_position`. The rows of the tolerance that hold there have the same
    reference orientation. The rotation error of the solution is the distance outside the tolerance.
    """
    from scipy.optimize import least_squares

    bounds = _JUST_INSIDE * tube.bounds[list(rows)].min(axis=0)
    excess = _Excess(robot, target, tube, rows[0], bounds)
    solution = least_squares(
        lambda q: excess.at(q)[0],
        np.clip(seed, lower - _INSIDE, upper + _INSIDE),
        lambda q: excess.at(q)[1],
        bounds=(lower - 2 * _INSIDE, upper + 2 * _INSIDE),
        max_nfev=_MAX_EVALUATIONS,
        xtol=_CONVERGED,
        ftol=_CONVERGED**1.5,
        gtol=_CONVERGED,
    )
    q = np.clip(solution.x, lower, upper)
    rotation, tool = robot.tool_pose(q[None])
    outside = max(-float(tube.margin(rotation, tool, row)[0]) for row in rows)
    return PositionSolution(q, float(np.linalg.norm(tool[0] - target)), max(outside, 0.0))


@dataclass(frozen=True, eq=False)
class _Excess:
    """Distance from a position, and excess over bounds (4,) on the rotation vector."""

    robot: RobotModel
    target: FloatArray
    tube: RotationalTube
    row: int
    bounds: FloatArray

    def at(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the excess of a configuration (n,), (9,) [m], and its derivative (9, n)."""
        rotation, tool, jacobian = (part[0] for part in self.robot.tool_pose_jacobian(q[None]))
        error = self.tube.error(rotation[None], tool[None], self.row)[0]
        error_rows = inverse_right_jacobian(error) @ rotation.T @ jacobian[3:]
        beyond = np.maximum(abs(error) - self.bounds[:3], 0.0) * np.sign(error)
        rows = [jacobian[:3], _ANGLE_WEIGHT * (beyond != 0)[:, None] * error_rows]
        angle = float(np.linalg.norm(error))
        out, out_rows = np.zeros(3), np.zeros_like(error_rows)
        if angle > self.bounds[3]:
            ratio, axis = self.bounds[3] / angle, error / angle
            out = (1 - ratio) * error
            out_rows = ((1 - ratio) * np.eye(3) + ratio * np.outer(axis, axis)) @ error_rows
        parts = [tool - self.target, _ANGLE_WEIGHT * beyond, _ANGLE_WEIGHT * out]
        return np.concatenate(parts), np.vstack([*rows, _ANGLE_WEIGHT * out_rows])
